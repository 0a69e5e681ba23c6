/// @file
/// Where a point of an arm is and how it moves.
#pragma once

#include "bumpstop/model/kinematics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Of a point of a link, in the base frame.
template <class T>
struct PointMotion {
    Point3<T> position;  ///< m
    Point3<T> velocity;  ///< m/s
};

/// From the point to the base, joint by joint: without the posture of the whole arm. `q`, `qd`: by joint.
template <class T>
PointMotion<T> point_motion(const Chain& chain, const T* q, const T* qd, const JointAngles<T>& angle,
                            const LinkPoint& point) {
    Point3<T> p = point3<T>(point.offset), v{T(0.0), T(0.0), T(0.0)};
    for (int j = point.link; j >= 0; --j) {
        const Chain::Joint& joint = chain.joint[j];
        if (joint.prismatic) {
            p.z += q[j];
            v.z += qd[j];
        } else {
            v.x -= qd[j] * p.y;
            v.y += qd[j] * p.x;
        }
        for (Point3<T>* a : {&p, &v}) {
            turn_z(angle.cos[j], angle.sin[j], *a);
            turn_x(joint.cos_alpha, joint.sin_alpha, *a);
        }
        const Vector3& d = joint.displacement;
        p = {p.x + d[0], p.y + d[1], p.z + d[2]};
    }
    if (point.link >= 0)
        for (Point3<T>* a : {&p, &v}) turn_z(chain.base_turn[0], chain.base_turn[1], *a);
    return {p, v};
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
