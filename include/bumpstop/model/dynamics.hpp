/// @file
/// Inverse dynamics (recursive Newton-Euler), mass matrix and effective mass, for a double or for lanes.
///
/// All recursions run in the chain's computing frames, where a joint costs a rotation about x and one about z.
/// Units: m, kg, s, N, Nm; a prismatic joint has m for rad and N for Nm.
#pragma once

#include <limits>

#include "bumpstop/model/inertias.hpp"
#include "bumpstop/model/kinematics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// A wrench that the environment exerts on the robot at a point of a link, in the base frame.
template <class T>
struct Wrench {
    LinkPoint point;
    Point3<T> force;   ///< N
    Point3<T> moment;  ///< about the point [Nm]
};

/// Joint positions [rad or m] with their sines and cosines, rates and accelerations: max_joints numbers each.
template <class T>
struct JointMotion {
    const T* q;
    const JointAngles<T>& angle;
    const T* qd;
    const T* qdd;
};

/// The rotation of one joint, from the frame after it to the frame before it: about z, then about x.
template <class T>
struct JointTurn {
    double ca, sa;
    T c, s;

    JointTurn(const Chain::Joint& joint, T cosine, T sine)
        : ca(joint.cos_alpha), sa(joint.sin_alpha), c(cosine), s(sine) {}
    Point3<T> inward(const Point3<T>& v) const {
        const T y = v.x * s + v.y * c;
        return {v.x * c - v.y * s, y * ca - v.z * sa, y * sa + v.z * ca};
    }
    Point3<T> outward(const Point3<T>& v) const {
        const T y = v.y * ca + v.z * sa;
        return {v.x * c + y * s, y * c - v.x * s, v.z * ca - v.y * sa};
    }
};

template <class T>
Point3<T> into_first_frame(const Chain& chain, const Point3<T>& v) {
    const double c = chain.base_turn[0], s = chain.base_turn[1];
    return {v.x * c + v.y * s, v.y * c - v.x * s, v.z};
}

/// Moves a force and its moment about the origin of frame i to frame i - 1 and its origin.
template <class T>
void carry_inward(const Chain& chain, const Inertias& inertias, const T* q, const JointAngles<T>& angle, int i,
                  Point3<T>& f, Point3<T>& n) {
    const Chain::Joint& joint = chain.joint[i];
    const JointTurn<T> turn(joint, angle.cos[i], angle.sin[i]);
    const auto& d = inertias.displacement[i];
    if (joint.prismatic) [[unlikely]]
        n = {n.x - f.y * q[i], n.y + f.x * q[i], n.z};
    f = turn.inward(f);
    n = turn.inward(n);
    n = {n.x + f.z * d[1], n.y - f.z * d[0], n.z + (f.y * d[0] - f.x * d[1])};
}

/// tau = M(q) qdd + C(q, qd) qd + g(q): the torques the motors must give, positive along the joints. `gravity` is the
/// acceleration of free fall in the base frame [m/s2]. A rotor adds its inertia times qdd; the gyroscopic torque of
/// rotors on moving links is neglected.
template <class T>
void inverse_dynamics(const Chain& chain, const Inertias& inertias, const JointMotion<T>& motion,
                      const Vector3& gravity, T* tau) noexcept {
    const T *q = motion.q, *qd = motion.qd, *qdd = motion.qdd;
    const JointAngles<T>& angle = motion.angle;
    const T zero = 0.0;
    Point3<T> force[max_joints], moment[max_joints];  // on the links, in their frames, about their origins
    // Angular velocity, its rate, and the acceleration of the origin relative to free fall: of the previous link, then,
    // with the joint's own motion, of the link.
    Point3<T> w{zero, zero, zero}, wd = w;
    Point3<T> a = into_first_frame(chain, Point3<T>{T(-gravity[0]), T(-gravity[1]), T(-gravity[2])});
    for (int i = 0; i < chain.dof; ++i) {
        const Chain::Joint& joint = chain.joint[i];
        const MassMoments& mass = inertias.link[i];
        const JointTurn<T> turn(joint, angle.cos[i], angle.sin[i]);
        a = turn.outward(a);
        if (i > 0) {
            w = turn.outward(w);
            wd = turn.outward(wd);
        }
        if (!joint.prismatic) {
            wd = {wd.x + w.y * qd[i], wd.y - w.x * qd[i], wd.z + qdd[i]};
            w.z += qd[i];
        }
        // A point at r has the acceleration a + U r. These are the elements of U, the diagonal with the opposite sign.
        const T xx = w.x * w.x, yy = w.y * w.y, zz = w.z * w.z;
        const T xy = w.x * w.y, xz = w.x * w.z, yz = w.y * w.z;
        const T minus_uxx = yy + zz, minus_uyy = zz + xx, minus_uzz = xx + yy;
        const T uxy = xy - wd.z, uyx = xy + wd.z;
        const T uzx = xz - wd.y, uxz = xz + wd.y;
        const T uyz = yz - wd.x, uzy = yz + wd.x;
        const double hx = mass.first[0], hy = mass.first[1];
        force[i] = {uxy * hy - minus_uxx * hx, uyx * hx - minus_uyy * hy, uzx * hx + uzy * hy};
        // First moment times a, and the integral of (r x U r) dm without its terms in `mass.zz`, which is 0 where the
        // joint is revolute.
        moment[i] = {a.z * hy + uzy * mass.yy + (zz - yy) * mass.yz + uzx * mass.xy - uyx * mass.xz,
                     uxy * mass.yz - uzx * mass.xx + (xx - zz) * mass.xz - uzy * mass.xy - a.z * hx,
                     a.y * hx + uyx * mass.xx - uxy * mass.yy + (yy - xx) * mass.xy +
                         (uyz * mass.xz - uxz * mass.yz - a.x * hy)};
        if (joint.prismatic) [[unlikely]] {
            // The origin moves, and the mass on the axis was not moved to the previous link.
            const Point3<T> travel{uxz * q[i] + w.y * (2.0 * qd[i]), uyz * q[i] - w.x * (2.0 * qd[i]),
                                   qdd[i] - minus_uzz * q[i]};
            a = a + travel;
            const double m = mass.mass, hz = mass.first[2];
            force[i] = force[i] + Point3<T>{a.x * m + uxz * hz, a.y * m + uyz * hz, a.z * m - minus_uzz * hz};
            moment[i] = moment[i] + Point3<T>{travel.z * hy - a.y * hz - uyz * mass.zz,
                                              a.x * hz - travel.z * hx + uxz * mass.zz, travel.y * hx - travel.x * hy};
        }
        if (i + 1 == chain.dof) break;
        const auto& d = inertias.displacement[i + 1];
        a = {a.x + (uxy * d[1] - minus_uxx * d[0]), a.y + (uyx * d[0] - minus_uyy * d[1]),
             a.z + (uzx * d[0] + uzy * d[1])};
    }
    Point3<T> f{zero, zero, zero}, n = f;
    for (int i = chain.dof - 1;; --i) {
        f = f + force[i];
        n = n + moment[i];
        tau[i] = (chain.joint[i].prismatic ? f.z : n.z) + qdd[i] * inertias.rotor[i];
        if (i == 0) return;
        carry_inward(chain, inertias, q, angle, i, f, n);
    }
}

/// J' wrench: its joint torques, positive along the joints.
template <class T>
void external_torque(const Chain& chain, const Posture<T>& posture, const Wrench<T>& wrench, T* tau) noexcept {
    const Point3<T> p = posture.position(wrench.point);
    for (int j = 0; j < chain.dof; ++j) {
        if (j > wrench.point.link) {
            tau[j] = 0.0;
            continue;
        }
        tau[j] = dot(linear_column(chain, posture, p, j), wrench.force);
        if (!chain.joint[j].prismatic) tau[j] += dot(posture.axis[j], wrench.moment);
    }
}

/// The same with an external wrench: tau = M qdd + C qd + g - J' wrench.
template <class T>
void inverse_dynamics(const Chain& chain, const Inertias& inertias, const JointMotion<T>& motion,
                      const Vector3& gravity, const Wrench<T>& wrench, T* tau) noexcept {
    Posture<T> posture;
    forward_kinematics(chain, motion.q, motion.angle, posture);
    T external[max_joints];
    external_torque(chain, posture, wrench, external);
    inverse_dynamics(chain, inertias, motion, gravity, tau);
    for (int j = 0; j < chain.dof; ++j) tau[j] -= external[j];
}

/// g(q): the torques that hold the arm at rest.
template <class T>
void gravity_torque(const Chain& chain, const Inertias& inertias, const T* q, const JointAngles<T>& angle,
                    const Vector3& gravity, T* tau) noexcept {
    T rest[max_joints];
    for (int j = 0; j < chain.dof; ++j) rest[j] = 0.0;
    inverse_dynamics(chain, inertias, {q, angle, rest, rest}, gravity, tau);
}

/// C(q, qd) qd: the torques that keep the rates constant, without gravity.
template <class T>
void coriolis_torque(const Chain& chain, const Inertias& inertias, const T* q, const JointAngles<T>& angle, const T* qd,
                     T* tau) noexcept {
    T rest[max_joints];
    for (int j = 0; j < chain.dof; ++j) rest[j] = 0.0;
    inverse_dynamics(chain, inertias, {q, angle, qd, rest}, {0, 0, 0}, tau);
}

/// Joint-space mass matrix M(q) with the rotors on its diagonal [kg m2, kg m or kg]: column j is the torque that a unit
/// acceleration of joint j needs.
template <class T>
void mass_matrix(const Chain& chain, const Inertias& inertias, const T* q, const JointAngles<T>& angle,
                 T (*m)[max_joints]) noexcept {
    T rest[max_joints], unit[max_joints], column[max_joints];
    for (int j = 0; j < chain.dof; ++j) rest[j] = unit[j] = 0.0;
    for (int j = 0; j < chain.dof; ++j) {
        unit[j] = 1.0;
        inverse_dynamics(chain, inertias, {q, angle, rest, unit}, {0, 0, 0}, column);
        unit[j] = 0.0;
        for (int i = 0; i <= j; ++i) m[i][j] = m[j][i] = column[i];
    }
}

/// Cholesky factorisation L L' of a symmetric matrix, with L in its lower triangle. False where the matrix is not
/// positive definite to double precision; the factor is not valid there.
template <class T>
MaskOf<T> cholesky(T (*m)[max_joints], int n) noexcept {
    MaskOf<T> definite = mask_of<T>(true);
    for (int j = 0; j < n; ++j) {
        T pivot = m[j][j];
        for (int k = 0; k < j; ++k) pivot -= m[j][k] * m[j][k];
        definite = definite & (pivot > m[j][j] * (n * 0x1p-52));
        m[j][j] = sqrt(pivot);
        const T inverse = 1.0 / m[j][j];
        for (int i = j + 1; i < n; ++i) {
            T sum = m[i][j];
            for (int k = 0; k < j; ++k) sum -= m[i][k] * m[j][k];
            m[i][j] = sum * inverse;
        }
    }
    return definite;
}

/// Effective mass 1 / (n' J M^-1 J' n) along the unit vector n at a point of a link, with all joints free [kg].
/// Infinite where no joint moves the point along n (see negligible_square), NaN where the mass matrix is singular.
template <class T>
T effective_mass(const Chain& chain, const Inertias& inertias, const T* q, const JointAngles<T>& angle,
                 const LinkPoint& point, const Point3<T>& direction) noexcept {
    Posture<T> posture;
    forward_kinematics(chain, q, angle, posture);
    const Point3<T> p = posture.position(point);
    T x[max_joints], m[max_joints][max_joints];
    for (int j = 0; j < chain.dof; ++j) {
        x[j] = 0.0;
        if (j > point.link) continue;
        const T share = dot(linear_column(chain, posture, p, j), direction);
        x[j] = select(share * share > negligible_square(chain, posture, p, j), share, x[j]);
    }
    mass_matrix(chain, inertias, q, angle, m);
    const MaskOf<T> definite = cholesky(m, chain.dof);
    T square = 0.0;
    for (int j = 0; j < chain.dof; ++j) {
        for (int k = 0; k < j; ++k) x[j] -= m[j][k] * x[k];
        x[j] = x[j] / m[j][j];
        square += x[j] * x[j];
    }
    return select(definite, 1.0 / square, T(std::numeric_limits<double>::quiet_NaN()));
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
