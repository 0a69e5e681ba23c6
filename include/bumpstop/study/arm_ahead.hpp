/// @file
/// An arm that moves along its line, as far as a collision needs it: a few moments of the way, and what lies between.
#pragma once

#include "bumpstop/collision/line_path.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// A scenario's arm and contact point.
struct ArmOnLine {
    Chain chain;
    MotionSettings motion;
    ContactGeometry contact;
    bool from_rest = false;
};

/// Joint positions and rates, and the posture they belong to.
template <class T>
struct Moment {
    T q[max_joints]{}, qd[max_joints]{};  ///< rad or m, rad/s or m/s
    Posture<T> posture;

    void look(const Chain& chain) {
        JointAngles<T> angle{};
        for (int j = 0; j < chain.dof; ++j) angle.set(chain, j, q[j]);
        forward_kinematics(chain, q, angle, posture);
    }
};

/// J_v' n of the contact point, by joint [Nm/N or 1].
template <class T>
void contact_torque(const ArmOnLine& arm, const Posture<T>& posture, const Point3<T>& normal, T* torque) {
    const Point3<T> p = posture.position(arm.contact.point);
    for (int j = 0; j < arm.chain.dof; ++j)
        torque[j] = j > arm.contact.point.link ? T(0.0) : dot(linear_column(arm.chain, posture, p, j), normal);
}

template <class T>
T dot_joints(const ArmOnLine& arm, const T* a, const T* b) {
    T sum = 0.0;
    for (int j = 0; j < arm.chain.dof; ++j) sum += a[j] * b[j];
    return sum;
}

/// Rates of all joints that move the tip with `velocity`, the controller's own; true where the posture is singular.
template <class T>
MaskOf<T> line_rates(const ArmOnLine& arm, const Posture<T>& posture, const Point3<T>& velocity, T* rate) {
    const Rates<T> found = resolved_rates(arm.chain, arm.motion, posture, velocity);
    for (int j = 0; j < arm.chain.dof; ++j) rate[j] = 0.0;
    for (int f = 0; f < arm.motion.free_count; ++f) rate[arm.motion.free_joint[f]] = found.free[f];
    return found.conditioning.singular;
}

/// Time in which joints could change their rates by `change` [s].
template <class T>
T time_for(const ArmOnLine& arm, const T* change) {
    T longest = 0.0;
    for (int f = 0; f < arm.motion.free_count; ++f) {
        const int j = arm.motion.free_joint[f];
        longest = maximum(longest, absolute(change[j]) * (1.0 / arm.motion.acceleration_limit[j]));
    }
    return longest;
}

template <class T>
T norm_of(const ArmOnLine& arm, const T* a) {
    return square_root(dot_joints(arm, a, a));
}

/// A stretch of `length` seconds of a motion, known at `steps` + 1 moments that follow each other evenly. Between them
/// distance, speed, torque and rates lie on the parabola through the three nearest moments, positions on the cubic that
/// has position and rate of both ends.
template <class T, int steps>
struct ArmAhead {
    static_assert(steps % 2 == 0);
    const ArmOnLine* arm;
    Point3<T> normal, velocity;
    T length;  ///< s
    Moment<T> first;
    T q[steps + 1][max_joints], qd[steps + 1][max_joints];
    T torque[steps + 1][max_joints];          ///< J_v' n
    T distance[steps + 1], speed[steps + 1];  ///< of the contact point along the normal [m], [m/s]
    T off_speed;                              ///< largest error of the tip's velocity, in shares of it
    T turned;                                 ///< greatest change of the rates, in shares of those at the start

    /// Follows the motion from `start` (posture and full rates known) by steps of the midpoint rule. The line is left
    /// where joints cannot follow it: rates change no faster than their limits allow.
    void follow(const ArmOnLine& of, const Moment<T>& start, const Point3<T>& along, const Point3<T>& tip_velocity,
                T duration) {
        arm = &of;
        normal = along;
        velocity = tip_velocity;
        length = duration;
        first = start;
        if (of.from_rest)
            for (int j = 0; j < of.chain.dof; ++j) first.qd[j] = 0.0;
        const T step = duration * (1.0 / steps);
        const Point3<T> begin = first.posture.position(of.contact.point);
        off_speed = turned = 0.0;
        Moment<T> at = first, middle;
        T wanted[max_joints];
        for (int m = 0;; ++m) {
            keep(m, at, begin);
            if (m == steps) break;
            for (int j = 0; j < of.chain.dof; ++j) middle.q[j] = at.q[j] + 0.5 * step * at.qd[j];
            middle.look(of.chain);
            line_rates(of, middle.posture, velocity, wanted);
            limited(at.qd, wanted, 0.5 * step, middle.qd);
            for (int j = 0; j < of.chain.dof; ++j) at.q[j] += step * middle.qd[j];
            at.look(of.chain);
            line_rates(of, at.posture, velocity, wanted);
            limited(at.qd, wanted, step, at.qd);
        }
    }

    /// The share of the stretch after which the contact point is that far, 0 to 1.
    T share_at(T far) const {
        T x = clipped(far / maximum(distance[steps], T(1e-12)));
        for (int round = 0; round < 2; ++round) {
            // Newton's method; the speed is the slope, and hardly changes where anything is foretold.
            const Place at = place(x);
            const T slope = parabola(at, [&](int m) { return speed[m]; }) * length;
            const T error = parabola(at, [&](int m) { return distance[m]; }) - far;
            x = clipped(x - select(slope > T(0.0), error / select(slope > T(0.0), slope, T(1.0)), T(0.0)));
        }
        return x;
    }
    T time_of(T far) const { return share_at(far) * length; }

    T speed_at(T far) const {
        return parabola(place(share_at(far)), [&](int m) { return speed[m]; });
    }
    /// J_v' n at a share of the stretch, of `count` joints given by number.
    void torque_at(T share, const int* joint, int count, T* found) const {
        const Place at = place(share);
        for (int w = 0; w < count; ++w) found[w] = parabola(at, [&](int m) { return torque[m][joint[w]]; });
    }
    T torque_of(T share, int joint) const {
        return parabola(place(share), [&](int m) { return torque[m][joint]; });
    }
    /// Greatest speed of the contact point along the normal [m/s].
    T fastest() const {
        T found = speed[0];
        for (int i = 1; i <= 4 * steps; ++i) {
            found = maximum(found, parabola(place(T(double(i) / (4 * steps))), [&](int m) { return speed[m]; }));
        }
        return found;
    }
    void rates_at(T time, T* found) const {
        const Place at = place(clipped(time / length));
        for (int j = 0; j < arm->chain.dof; ++j) found[j] = parabola(at, [&](int m) { return qd[m][j]; });
    }
    void position_at(T time, T* found) const {
        const T x = clipped(time / length) * double(steps);
        const T low = minimum(whole_part(x), T(steps - 1.0));
        const T y = x - low, step = length * (1.0 / steps);
        const Place at = index(low);
        for (int j = 0; j < arm->chain.dof; ++j) {
            const T q0 = pick(at, 0, [&](int m) { return q[m][j]; }), q1 = pick(at, 1, [&](int m) { return q[m][j]; });
            const T d0 = step * pick(at, 0, [&](int m) { return qd[m][j]; });
            const T d1 = step * pick(at, 1, [&](int m) { return qd[m][j]; });
            found[j] = q0 + y * (d0 + y * ((3.0 * (q1 - q0) - 2.0 * d0 - d1) + y * (2.0 * (q0 - q1) + d0 + d1)));
        }
    }

  private:
    /// Where in the tables a share is: the moment the parabola begins at, by lane, and how far along it, 0 to 1.
    struct Place {
        T x;
        int first[Scalar<T>::lanes];
    };
    static T clipped(T share) { return minimum(maximum(share, T(0.0)), T(1.0)); }
    static Place index(T low) {
        Place at;
        at.x = 0.0;
        for (int lane = 0; lane < Scalar<T>::lanes; ++lane) at.first[lane] = int(lane_of(low, lane));
        return at;
    }
    static Place place(T share) {
        const T x = clipped(share) * double(steps);
        if constexpr (steps == 2) {
            Place at = {0.5 * x, {}};
            return at;
        } else {
            const T low = 2.0 * minimum(whole_part(0.5 * x), T(steps / 2 - 1.0));
            Place at = index(low);
            at.x = 0.5 * (x - low);
            return at;
        }
    }
    template <class Table>
    static T pick(const Place& at, int offset, const Table& table) {
        T found;
        for (int lane = 0; lane < Scalar<T>::lanes; ++lane)
            set_lane(found, lane, lane_of(table(at.first[lane] + offset), lane));
        return found;
    }
    template <class Table>
    static T parabola(const Place& at, const Table& table) {
        T y0, y1, y2;
        if constexpr (steps == 2) {
            y0 = table(0), y1 = table(1), y2 = table(2);
        } else {
            y0 = pick(at, 0, table), y1 = pick(at, 1, table), y2 = pick(at, 2, table);
        }
        return y0 + at.x * ((4.0 * y1 - 3.0 * y0 - y2) + at.x * (2.0 * y0 + 2.0 * y2 - 4.0 * y1));
    }

    /// Rates as near to those wanted as joints come in a time, all by one share.
    void limited(const T* rate, const T* wanted, T time, T* found) const {
        T change[max_joints];
        for (int j = 0; j < arm->chain.dof; ++j) change[j] = wanted[j] - rate[j];
        const T share = 1.0 / maximum(time_for(*arm, change) / time, T(1.0));
        for (int j = 0; j < arm->chain.dof; ++j) found[j] = rate[j] + change[j] * share;
    }

    void keep(int m, const Moment<T>& at, const Point3<T>& begin) {
        const Chain& chain = arm->chain;
        contact_torque(*arm, at.posture, normal, torque[m]);
        T change[max_joints];
        for (int j = 0; j < chain.dof; ++j) {
            q[m][j] = at.q[j];
            qd[m][j] = at.qd[j];
            change[j] = at.qd[j] - first.qd[j];
        }
        distance[m] = dot(at.posture.position(arm->contact.point) - begin, normal);
        speed[m] = dot_joints(*arm, torque[m], at.qd);
        const Point3<T> tip = at.posture.position(arm->motion.tip);
        Point3<T> error{-velocity.x, -velocity.y, -velocity.z};
        for (int f = 0; f < arm->motion.free_count; ++f) {
            const int j = arm->motion.free_joint[f];
            if (j > arm->motion.tip.link) continue;
            const Point3<T> column = linear_column(chain, at.posture, tip, j);
            error = {error.x + column.x * at.qd[j], error.y + column.y * at.qd[j], error.z + column.z * at.qd[j]};
        }
        off_speed = maximum(off_speed, square_root(dot(error, error) / dot(velocity, velocity)));
        const T beside = norm_of(*arm, first.qd);
        turned = maximum(turned, select(beside > T(0.0), norm_of(*arm, change) / beside, T(1e300)));
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
