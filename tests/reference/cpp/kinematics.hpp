// Vectors, rotations, and where the links of an arm are.
#pragma once

#include <cmath>

#include "problem.hpp"

namespace reference {

inline Vec3 vec3(const double* p) { return {p[0], p[1], p[2]}; }
inline Vec3 operator+(const Vec3& a, const Vec3& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
inline Vec3 operator-(const Vec3& a, const Vec3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Vec3 operator*(double k, const Vec3& a) { return {k * a[0], k * a[1], k * a[2]}; }
inline double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline double norm(const Vec3& a) { return std::sqrt(dot(a, a)); }

inline Vec3 cross(const Vec3& a, const Vec3& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline Vec3 multiply(const Mat3& m, const Vec3& v) {
    return {m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
            m[6] * v[0] + m[7] * v[1] + m[8] * v[2]};
}

inline Mat3 multiply(const Mat3& a, const Mat3& b) {
    Mat3 product{};
    for (int row = 0; row < 3; ++row) {
        for (int column = 0; column < 3; ++column) {
            double sum = 0;
            for (int k = 0; k < 3; ++k) sum += a[3 * row + k] * b[3 * k + column];
            product[3 * row + column] = sum;
        }
    }
    return product;
}

// Rodrigues' formula: turn by `angle` about the unit vector `u`.
inline Mat3 rotation_about(const Vec3& u, double angle) {
    const double c = std::cos(angle);
    const double s = std::sin(angle);
    const double k = 1 - c;
    return {c + k * u[0] * u[0],        k * u[0] * u[1] - s * u[2], k * u[0] * u[2] + s * u[1],
            k * u[1] * u[0] + s * u[2], c + k * u[1] * u[1],        k * u[1] * u[2] - s * u[0],
            k * u[2] * u[0] - s * u[1], k * u[2] * u[1] + s * u[0], c + k * u[2] * u[2]};
}

struct Frames {
    std::array<Vec3, kMaxJoints> joint_origin;  // a point on each joint's axis
    std::array<Vec3, kMaxJoints> joint_axis;
    std::array<Mat3, kMaxJoints> link_rotation;  // the link that each joint moves
    std::array<Vec3, kMaxJoints> link_origin;
};

inline void forward_kinematics(const Problem& problem, const PerJoint& position, Frames& frames) {
    Mat3 rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    Vec3 origin = {0, 0, 0};
    for (int j = 0; j < problem.joint_count; ++j) {
        Mat3 fixed;
        std::copy_n(problem.origin_rotation[j], 9, fixed.begin());
        const Vec3 axis = vec3(problem.axis[j]);
        origin = origin + multiply(rotation, vec3(problem.origin_xyz[j]));
        rotation = multiply(rotation, fixed);
        frames.joint_origin[j] = origin;
        frames.joint_axis[j] = multiply(rotation, axis);
        if (problem.kind[j] == kRevolute) {
            rotation = multiply(rotation, rotation_about(axis, position[j]));
        } else {
            origin = origin + position[j] * frames.joint_axis[j];
        }
        frames.link_rotation[j] = rotation;
        frames.link_origin[j] = origin;
    }
}

inline Vec3 point_on_link(const Frames& frames, int link, const double* point) {
    return frames.link_origin[link] + multiply(frames.link_rotation[link], vec3(point));
}

// Column of the geometric Jacobian: what joint j moving at unit speed does to a point of a link.
struct JacobianColumn {
    Vec3 linear;
    Vec3 angular;
};

inline JacobianColumn jacobian_column(const Problem& problem, const Frames& frames, int joint, int link,
                                      const Vec3& point) {
    if (joint > link) return {{0, 0, 0}, {0, 0, 0}};  // a joint beyond the link does not move it
    const Vec3& axis = frames.joint_axis[joint];
    if (problem.kind[joint] == kPrismatic) return {axis, {0, 0, 0}};
    return {cross(axis, point - frames.joint_origin[joint]), axis};
}

}  // namespace reference
