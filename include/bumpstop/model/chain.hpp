/// @file
/// A serial chain as specified in the manner of URDF, and in the frames that are used for computing.
#pragma once

#include <array>
#include <cmath>
#include <span>

#include "bumpstop/math/lanes.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

inline constexpr int max_joints = 16;

using Vector3 = std::array<double, 3>;
using Matrix3 = std::array<double, 9>;  // row-major

inline Vector3 operator*(const Matrix3& m, const Vector3& v) {
    Vector3 r{};
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) r[i] += m[3 * i + k] * v[k];
    return r;
}
inline Matrix3 operator*(const Matrix3& a, const Matrix3& b) {
    Matrix3 r{};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k) r[3 * i + j] += a[3 * i + k] * b[3 * k + j];
    return r;
}
inline Matrix3 transposed(const Matrix3& m) { return {m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]}; }
inline Matrix3 rotation_z(double angle) {
    const double c = std::cos(angle), s = std::sin(angle);
    return {c, -s, 0, s, c, 0, 0, 0, 1};
}
/// A rotation that takes z to the given unit vector.
inline Matrix3 rotation_from_z(const Vector3& axis) {
    const double horizontal = std::hypot(axis[0], axis[1]);
    if (horizontal == 0) return axis[2] > 0 ? Matrix3{1, 0, 0, 0, 1, 0, 0, 0, 1} : Matrix3{1, 0, 0, 0, -1, 0, 0, 0, -1};
    const double cp = axis[0] / horizontal, sp = axis[1] / horizontal;  // rotation about y, then about z
    return {cp * axis[2], -sp, axis[0], sp * axis[2], cp, axis[1], -horizontal, 0, axis[2]};
}

/// One joint and the link it moves, in the manner of URDF: `origin` and `rotation` give the joint's frame in the frame
/// of the previous link; the link turns about (revolute) or slides along (prismatic) the unit vector `axis`.
struct JointSpec {
    bool prismatic = false;
    Vector3 origin{};  ///< m
    Matrix3 rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};
    Vector3 axis{0, 0, 1};
};

/// The chain in computing frames: every joint moves about or along its own z axis, and the constant rotation between
/// two joints is one rotation about x. Any rotation is Rz(beta) Rx(alpha) Rz(gamma); those about z are added to the
/// joint angles before and after. A joint then costs two plane rotations instead of a product of matrices.
struct Chain {
    struct Joint {
        bool prismatic = false;
        double turns = 1;                     // 1, or 0 for a prismatic joint: the joint's angle is turns * q + offset
        double cos_alpha = 1, sin_alpha = 0;  // rotation about x before the joint
        double offset = 0;       // added to a revolute joint's angle; a prismatic joint's constant angle [rad]
        Vector3 displacement{};  // from the previous frame to this joint, in the previous frame [m]
        Matrix3 to_link{};       // orientation of the link's own frame in the computing frame after the joint
    };
    int dof = 0;
    std::array<double, 2> base_turn{1, 0};  ///< cosine and sine of the rotation about z at the base of the chain
    std::array<Joint, max_joints> joint{};
    /// `turns` and `offset` of the joints as arrays, for loading registers; zero beyond the last.
    std::array<double, max_joints> turns{}, offsets{};

    Chain() = default;
    explicit Chain(std::span<const JointSpec> specs) : dof(int(specs.size())) {
        Matrix3 frame_to_link{1, 0, 0, 0, 1, 0, 0, 0, 1};  // `to_link` of the previous link
        for (int i = 0; i < dof; ++i) {
            const JointSpec& spec = specs[i];
            const Matrix3 align = rotation_from_z(spec.axis);
            // In the previous computing frame, whose rotation about z is still to be chosen.
            const Matrix3 between = frame_to_link * spec.rotation * align;
            // For nearly parallel axes beta is determined by rounding alone. alpha and gamma are computed from the rest
            // after beta, so that the product of the three rotations is exact to rounding for any beta.
            const double beta = std::hypot(between[2], between[5]) > 0 ? std::atan2(between[2], -between[5]) : 0;
            const Matrix3 turn_back = rotation_z(-beta);
            const Matrix3 rest = turn_back * between;
            const double alpha = std::atan2(-rest[5], rest[8]), gamma = std::atan2(-rest[1], rest[0]);
            if (i == 0) {
                base_turn = {std::cos(beta), std::sin(beta)};
            } else {
                joint[i - 1].offset += beta;
                joint[i - 1].to_link = turn_back * joint[i - 1].to_link;
            }
            Joint& j = joint[i];
            j.prismatic = spec.prismatic;
            j.turns = spec.prismatic ? 0 : 1;
            j.cos_alpha = std::cos(alpha);
            j.sin_alpha = std::sin(alpha);
            j.offset = gamma;
            j.displacement = turn_back * (frame_to_link * spec.origin);
            frame_to_link = transposed(align);
            j.to_link = frame_to_link;
        }
        for (int i = 0; i < dof; ++i) {
            turns[i] = joint[i].turns;
            offsets[i] = joint[i].offset;
        }
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
