/// @file
/// Forward kinematics and the Jacobian at a point of a link, for a double or for lanes of configurations.
#pragma once

#include "bumpstop/math/functions.hpp"
#include "bumpstop/model/chain.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

template <class T>
struct Point3 {
    T x, y, z;

    friend Point3 operator-(const Point3& a, const Point3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
    friend Point3 operator+(const Point3& a, const Point3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
    friend Point3 operator*(T factor, const Point3& a) { return {factor * a.x, factor * a.y, factor * a.z}; }
};
template <class T>
T dot(const Point3<T>& a, const Point3<T>& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T>
Point3<T> cross(const Point3<T>& a, const Point3<T>& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// A vector in all lanes, and the vector of one lane.
template <class T>
Point3<T> point3(const Vector3& v) {
    return {T(v[0]), T(v[1]), T(v[2])};
}
template <class T>
Vector3 lane_of(const Point3<T>& p, int lane) {
    return {lane_of(p.x, lane), lane_of(p.y, lane), lane_of(p.z, lane)};
}
template <class T>
void set_lane(Point3<T>& p, int lane, const Vector3& v) {
    set_lane(p.x, lane, v[0]);
    set_lane(p.y, lane, v[1]);
    set_lane(p.z, lane, v[2]);
}

/// A point fixed to a link; link -1 is the base. `offset` is in the computing frame of the link (see Chain).
struct LinkPoint {
    int link = -1;
    Vector3 offset{};
};

inline LinkPoint link_point(const Chain& chain, int link, const Vector3& in_link_frame) {
    if (link < 0) return {link, in_link_frame};
    return {link, chain.joint[link].to_link * in_link_frame};
}

/// Sine and cosine of every joint's angle, which is constant for a prismatic joint.
template <class T>
struct JointAngles {
    T sin[max_joints], cos[max_joints];

    void set(const Chain& chain, int j, T q) {
        const Chain::Joint& joint = chain.joint[j];
        const SinCos<T> sc = sincos(joint.prismatic ? T(joint.offset) : q + joint.offset);
        sin[j] = sc.sin;
        cos[j] = sc.cos;
    }
    /// Sets all joints, in registers, from an array of max_joints finite numbers.
    void set_padded(const Chain& chain, const double* q) {
        using L = Lanes<native_lanes>;
        for (int first = 0; first < chain.dof; first += native_lanes) {
            const L x = load<L>(q + first) * load<L>(&chain.turns[first]) + load<L>(&chain.offsets[first]);
            const SinCos<L> sc = sincos(x);
            store(sc.sin, &sin[first]);
            store(sc.cos, &cos[first]);
        }
    }
    /// Sets all joints.
    void set(const Chain& chain, const T* q) {
        if constexpr (Scalar<T>::lanes == 1) {
            double padded[max_joints] = {};
            std::copy_n(q, chain.dof, padded);
            set_padded(chain, padded);
        } else {
            for (int j = 0; j < chain.dof; ++j) set(chain, j, q[j]);
        }
    }
};

/// Joint axes and link frames at a configuration, in the base frame.
template <class T>
struct Posture {
    Point3<T> axis[max_joints];    ///< unit vectors
    Point3<T> origin[max_joints];  ///< m; of a prismatic joint without its travel
    /// x and y axes of the computing frame after each joint, whose z axis is `axis`, and its position [m].
    Point3<T> frame_x[max_joints], frame_y[max_joints], frame_position[max_joints];

    Point3<T> position(const LinkPoint& point) const {
        if (point.link < 0) return point3<T>(point.offset);
        const Point3<T>&x = frame_x[point.link], &y = frame_y[point.link], &z = axis[point.link];
        return frame_position[point.link] + point.offset[0] * x + point.offset[1] * y + point.offset[2] * z;
    }
};

template <class T>
void forward_kinematics(const Chain& chain, const T* q, const JointAngles<T>& angle, Posture<T>& posture) {
    const T c0 = chain.base_turn[0], s0 = chain.base_turn[1];
    Point3<T> x{c0, s0, T(0.0)}, y{-s0, c0, T(0.0)}, z{T(0.0), T(0.0), T(1.0)}, p{T(0.0), T(0.0), T(0.0)};
    for (int i = 0; i < chain.dof; ++i) {
        const Chain::Joint& joint = chain.joint[i];
        const Vector3& d = joint.displacement;
        // Most of these numbers are zero in most chains. The branches depend on the chain alone, so they are predicted.
        if (d[0] != 0) p = p + d[0] * x;
        if (d[1] != 0) p = p + d[1] * y;
        if (d[2] != 0) p = p + d[2] * z;
        const double ca = joint.cos_alpha, sa = joint.sin_alpha;
        const Point3<T> tilted = ca * y + sa * z;
        z = ca * z - sa * y;
        const T c = angle.cos[i], s = angle.sin[i];
        y = c * tilted - s * x;
        x = c * x + s * tilted;
        posture.axis[i] = z;
        posture.origin[i] = p;
        if (joint.prismatic) p = p + q[i] * z;
        posture.frame_x[i] = x;
        posture.frame_y[i] = y;
        posture.frame_position[i] = p;
    }
}

/// Column j of the Jacobian's translational rows at point p [m/rad or 1].
template <class T>
Point3<T> linear_column(const Chain& chain, const Posture<T>& posture, const Point3<T>& p, int j) {
    if (chain.joint[j].prismatic) return posture.axis[j];
    return cross(posture.axis[j], p - posture.origin[j]);
}

/// Square of the length below which column j at p counts as zero [(m/rad)^2 or 1]: rounding of positions, and of angles
/// written with ten digits in a robot's file, leaves less than this where the joint does not move the point.
template <class T>
T negligible_square(const Chain& chain, const Posture<T>& posture, const Point3<T>& p, int j) {
    if (chain.joint[j].prismatic) return T(1e-18);
    return 1e-18 * (dot(p, p) + dot(posture.origin[j], posture.origin[j]));
}

/// Velocity of a point of a link that is at p [m/s]. `qd`: by joint.
template <class T>
Point3<T> point_velocity(const Chain& chain, const Posture<T>& posture, int link, const Point3<T>& p, const T* qd) {
    Point3<T> v{T(0.0), T(0.0), T(0.0)};
    for (int j = 0; j <= link; ++j) v = v + qd[j] * linear_column(chain, posture, p, j);
    return v;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
