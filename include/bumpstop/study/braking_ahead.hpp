/// @file
/// How far an arm still goes once it brakes: along a straight line in joint space, or followed in a few steps.
#pragma once

#include "bumpstop/study/arm_ahead.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Travel along the normal from a tick to the farthest point of the reaction to it.
template <class T>
struct BrakingAhead {
    T travel;  ///< expected [m]
    T most;    ///< never less than it, but for what two numbers of steps have in common [m]
    T bent;    ///< how much the rates of the line change where the arm brakes, in shares of themselves
};

namespace detail {

inline constexpr int braking_steps = 8;    ///< until standstill of a reversing arm; half as many tell how good they are
inline constexpr int braking_places = 17;  ///< on the straight line of an arm that stops

template <class T>
struct Overrun {
    T expected, most;
};

/// An arm that stops: its rates fall in one proportion, so q + qd x is all it reaches.
template <class T>
Overrun<T> stop_ahead(const ArmOnLine& arm, const Point3<T>& normal, const Moment<T>& begin) {
    const T time = time_for(arm, begin.qd);
    const double h = arm.motion.substep();
    const Point3<T> from = begin.posture.position(arm.contact.point);
    Moment<T> at;
    const auto way = [&](T x) {
        for (int j = 0; j < arm.chain.dof; ++j) at.q[j] = begin.q[j] + begin.qd[j] * x;
        at.look(arm.chain);
        return dot(at.posture.position(arm.contact.point) - from, normal);
    };
    // Rates fall by equal parts in every sub-step and positions follow the new rates, so the controller ends short of
    // time / 2, where an arm that brakes evenly ends.
    const T parts = minimum(time * (1.0 / h), T(1e12)), whole = whole_part(parts);
    const T reach =
        select(whole > T(0.0), h * (whole - whole * (whole + 1.0) / maximum(2.0 * parts, T(1e-300))), T(0.0));
    T inside = 0.0, farthest = 0.0, above = 0.0, before = 0.0, last = 0.0;
    for (int i = 1; i < braking_places; ++i) {
        const T x = time * (0.5 * i / (braking_places - 1));
        const T here = way(x);
        // Between two places a curve rises above both by at most an eighth of its second difference.
        if (i > 1) above = maximum(above, absolute(here - 2.0 * last + before));
        inside = maximum(inside, select(x <= reach, here, T(0.0)));
        farthest = maximum(farthest, here);
        before = last;
        last = here;
    }
    return {maximum(way(reach), inside), farthest + above * 0.125};
}

/// Overrun of an arm that reverses without sub-steps [m], by so many steps of the midpoint rule to standstill. `bent`
/// grows to the greatest change of the line's rates on the way, in shares of those at the beginning.
template <class T>
T reverse_ahead(const ArmOnLine& arm, const Point3<T>& normal, const Point3<T>& velocity, const Moment<T>& begin,
                int steps, T& bent) {
    const int dof = arm.chain.dof;
    const Point3<T> from = begin.posture.position(arm.contact.point);
    const T step = time_for(arm, begin.qd) * (1.0 / steps);
    const T own = maximum(norm_of(arm, begin.qd), T(1e-300));
    MaskOf<T> forth = T(0.0) < T(1.0);  // until it first turns back
    const auto change = [&](const Moment<T>& at, const T* rate, T* found) {
        line_rates(arm, at.posture, velocity, found);
        T apart[max_joints];
        for (int j = 0; j < dof; ++j) apart[j] = found[j] - begin.qd[j];
        bent = select(forth, maximum(bent, norm_of(arm, apart) / own), bent);
        for (int j = 0; j < dof; ++j) found[j] = -found[j] - rate[j];
        const T share = 1.0 / maximum(maximum(time_for(arm, found), step), T(1e-300));
        for (int j = 0; j < dof; ++j) found[j] *= share;
    };
    const auto speed_of = [&](const Moment<T>& at) {
        T torque[max_joints];
        contact_torque(arm, at.posture, normal, torque);
        return dot_joints(arm, torque, at.qd);
    };
    Moment<T> at = begin, half;
    T slope[max_joints], speed = speed_of(at), farthest = 0.0, reached = 0.0;
    for (int i = 0; i < 2 * steps; ++i) {
        change(at, at.qd, slope);
        for (int j = 0; j < dof; ++j) {
            half.q[j] = at.q[j] + 0.5 * step * at.qd[j];
            half.qd[j] = at.qd[j] + 0.5 * step * slope[j];
        }
        half.look(arm.chain);
        change(half, half.qd, slope);
        for (int j = 0; j < dof; ++j) {
            at.q[j] += step * half.qd[j];
            at.qd[j] += step * slope[j];
        }
        at.look(arm.chain);
        const T here = dot(at.posture.position(arm.contact.point) - from, normal), later = speed_of(at);
        // Where it turns back within a step the top lies above both ends.
        const MaskOf<T> forward = speed > T(0.0), backward = later < T(0.0);
        const MaskOf<T> turns = forward & backward;
        const T top = reached + 0.5 * step * speed * speed / select(turns, speed - later, T(1.0));
        farthest = select(forth, maximum(farthest, maximum(here, select(turns, top, here))), farthest);
        reached = here;
        speed = later;
        const MaskOf<T> still = speed > T(0.0);
        forth = forth & still;
        if (!any(forth)) break;
    }
    return farthest;
}

}  // namespace detail

/// Foretells the reaction to a tick at `time` of a motion.
template <class T, int steps>
BrakingAhead<T> braking_ahead(const ArmAhead<T, steps>& path, T time, double latency, bool reverse) {
    const ArmOnLine& arm = *path.arm;
    Moment<T> at;
    path.position_at(time, at.q);
    at.look(arm.chain);
    const Point3<T> noticed = at.posture.position(arm.contact.point);
    if (latency > 0) {
        path.position_at(time + latency, at.q);
        at.look(arm.chain);
    }
    path.rates_at(time + latency, at.qd);
    const T before = dot(at.posture.position(arm.contact.point) - noticed, path.normal);
    const T stop = time_for(arm, at.qd), own = norm_of(arm, at.qd);
    Moment<T> middle;
    for (int j = 0; j < arm.chain.dof; ++j) middle.q[j] = at.q[j] + at.qd[j] * stop * 0.5;
    middle.look(arm.chain);
    line_rates(arm, middle.posture, path.velocity, middle.qd);
    for (int j = 0; j < arm.chain.dof; ++j) middle.qd[j] -= at.qd[j];
    T bent = select(own > T(0.0), norm_of(arm, middle.qd) / maximum(own, T(1e-300)), T(1e300));
    if (!reverse) {
        const detail::Overrun<T> over = detail::stop_ahead(arm, path.normal, at);
        return {before + over.expected, before + over.most, bent};
    }
    const T rough = detail::reverse_ahead(arm, path.normal, path.velocity, at, detail::braking_steps / 2, bent);
    const T fine = detail::reverse_ahead(arm, path.normal, path.velocity, at, detail::braking_steps, bent);
    T torque[max_joints];
    contact_torque(arm, at.posture, path.normal, torque);
    // The positions follow the new rates of a sub-step, not their mean over it.
    const T expected = fine - dot_joints(arm, torque, at.qd) * (0.5 * arm.motion.substep());
    return {before + maximum(expected, T(0.0)), before + maximum(rough, fine) + absolute(fine - rough), bent};
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
