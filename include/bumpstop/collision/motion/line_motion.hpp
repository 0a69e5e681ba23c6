/// @file
/// Resolved-rate controller of an arm that moves its tool along a straight line.
#pragma once

#include "bumpstop/collision/collision_setup.hpp"
#include "bumpstop/math/interruption.hpp"
#include "bumpstop/model/kinematics.hpp"
#include "bumpstop/model/min_norm.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// One over the greatest change of a rate in a controller sub-step, by free joint [s/rad or s/m].
struct InverseMaxRateChange {
    std::array<double, max_joints> of{};

    explicit InverseMaxRateChange(const MotionSettings& motion) {
        for (int f = 0; f < motion.free_count; ++f)
            of[f] = 1 / (motion.acceleration_limit[motion.free_joint[f]] * motion.substep());
    }
};

template <class T>
struct ArmState {
    T q[max_joints];   ///< rad or m
    T qd[max_joints];  ///< rad/s or m/s; zero for held joints
    JointAngles<T> angle;

    void refresh_angles(const Chain& chain) {
        for (int j = 0; j < chain.dof; ++j) angle.set(chain, j, q[j]);
    }
};

template <class T>
struct Rates {
    T free[max_columns];  ///< by free joint
    Conditioning<T> conditioning;
    MaskOf<T> velocity_limited;
    T velocity_saturation;  ///< the largest ratio of a rate to its velocity limit, before scaling
};

/// Scales all rates by one factor where one would exceed its velocity limit.
template <class T>
void slow_to_velocity_limits(const MotionSettings& motion, Rates<T>& rates) {
    T largest = 0.0;
    for (int f = 0; f < motion.free_count; ++f) {
        const double limit = motion.velocity_limit[motion.free_joint[f]];
        if (std::isfinite(limit)) largest = max(largest, abs(rates.free[f]) * (1.0 / limit));
    }
    rates.velocity_saturation = largest;
    rates.velocity_limited = largest > T(1.0);
    if (any(rates.velocity_limited)) {
        const T scale = 1.0 / max(largest, T(1.0));
        for (int f = 0; f < motion.free_count; ++f) rates.free[f] *= scale;
    }
}

/// As resolved_rates, without velocity limits. `Rows`: 6 holds the orientation, 3 leaves it free.
template <int Rows, class T>
Rates<T> least_norm_rates(const Chain& chain, const MotionSettings& motion, const Posture<T>& posture,
                          const Point3<T>& velocity) {
    Rates<T> rates;
    const Point3<T> tip = posture.position(motion.tip);
    const int n = motion.free_count;
    // For the conditioning a row counts as no shorter than the quadratic mean of the three rows of its kind: where all
    // joints move the tip in one plane, or turn it about axes in one plane, the row across it is rounding alone.
    T rotation = 0.0, translation = 0.0;  // mean squares of the rows
    T row[Rows][max_columns], target[Rows], min_length[Rows];
    const auto put = [](T(*rows)[max_columns], int f, const Point3<T>& v) {
        rows[0][f] = v.x;
        rows[1][f] = v.y;
        rows[2][f] = v.z;
    };
    for (int f = 0; f < n; ++f) {
        const int j = motion.free_joint[f];
        const Point3<T> linear = linear_column(chain, posture, tip, j);
        put(row + (Rows - 3), f, linear);
        translation += dot(linear, linear) * (1.0 / 3);
        if constexpr (Rows == 6) {
            const bool turns = !chain.joint[j].prismatic;
            put(row, f, turns ? posture.axis[j] : point3<T>({0, 0, 0}));
            rotation += turns ? 1.0 / 3 : 0.0;
        }
    }
    const T wanted[3] = {velocity.x, velocity.y, velocity.z};
    for (int c = 0; c < Rows; ++c) {
        const bool moves = c >= Rows - 3;
        target[c] = moves ? wanted[c % 3] : T(0.0);
        min_length[c] = moves ? translation : rotation;
    }
    rates.conditioning = damped_min_norm<Rows>(row, n, target, motion.damping, rates.free, min_length);
    // Any damping bounds the rates.
    if (motion.damping > 0) rates.conditioning.singular = mask_of<T>(false);
    return rates;
}

/// Least-norm joint rates that move the tip with `velocity` (base frame, m/s) and without rotation, scaled by one
/// factor where one would exceed its velocity limit.
template <class T>
Rates<T> resolved_rates(const Chain& chain, const MotionSettings& motion, const Posture<T>& posture,
                        const Point3<T>& velocity) {
    Rates<T> rates = motion.task_rows == 6 ? least_norm_rates<6>(chain, motion, posture, velocity)
                                           : least_norm_rates<3>(chain, motion, posture, velocity);
    slow_to_velocity_limits(motion, rates);
    return rates;
}

/// Rate changes in one controller sub-step toward `wanted` (by free joint): one ratio scales all of them so that no
/// joint exceeds its acceleration limit. Returns where the wanted rates are reached. `saturation`: the changes that
/// remain, in units of the greatest allowed one. `tightened`: one over the scale of the limits, by free joint; null:
/// full limits. `independent`: every joint has a ratio of its own.
template <class T>
MaskOf<T> limited_change(const MotionSettings& motion, const InverseMaxRateChange& full, const T* wanted,
                         const ArmState<T>& state, T* change, T* saturation, const T* tightened = nullptr,
                         bool independent = false) {
    const int n = motion.free_count;
    T largest = 0.0;
    for (int f = 0; f < n; ++f) {
        change[f] = wanted[f] - state.qd[motion.free_joint[f]];
        saturation[f] = abs(change[f]) * full.of[f];
        if (tightened != nullptr) saturation[f] *= tightened[f];
        largest = max(largest, saturation[f]);
    }
    const auto reached = largest <= T(1.0);
    if (!all(reached)) {
        const T ratio = 1.0 / max(largest, T(1.0));
        for (int f = 0; f < n; ++f) change[f] *= independent ? 1.0 / max(saturation[f], T(1.0)) : ratio;
    }
    return reached;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
