/// @file
/// Inverse dynamics (recursive Newton-Euler), mass matrix and effective mass, for a double or for lanes.
///
/// Everything runs in the chain's computing frames, link by link, where a joint costs a turn about x and a turn about z.
/// Units: m, kg, s, N, Nm; a prismatic joint has m for rad and N for Nm.
#pragma once

#include <limits>

#include "bumpstop/model/joint_lanes.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What the environment exerts on the robot at a point of a link, in the base frame.
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

/// The rotation of one joint, from the frame after it to the frame before: a turn about x after a turn about z.
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
    /// Of a vector along z.
    Point3<T> axis_outward(const T& z) const {
        const T y = z * sa;
        return {y * s, y * c, z * ca};
    }
};

template <class T>
Point3<T> into_first_frame(const Chain& chain, const Point3<T>& v) {
    const double c = chain.base_turn[0], s = chain.base_turn[1];
    return {v.x * c + v.y * s, v.y * c - v.x * s, v.z};
}

/// Moves a force and its moment about the origin of frame i to frame i - 1 and its origin. `Slides`: some joint may be
/// prismatic.
template <bool Slides, class T>
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

/// Of the moment that carry_inward gives, the part about the axis of joint i - 1, which turns.
template <class T>
T axial_moment_inward(const Chain& chain, const Inertias& inertias, const JointAngles<T>& angle, int i,
                      const Point3<T>& f, const Point3<T>& n) {
    const JointTurn<T> turn(chain.joint[i], angle.cos[i], angle.sin[i]);
    const auto& d = inertias.displacement[i];
    const T y = f.x * turn.s + f.y * turn.c;
    const T fx = f.x * turn.c - f.y * turn.s, fy = y * turn.ca - f.z * turn.sa;
    return (n.x * turn.s + n.y * turn.c) * turn.sa + n.z * turn.ca + (fy * d[0] - fx * d[1]);
}

template <bool Slides, class T>
void newton_euler(const Chain& chain, const Inertias& inertias, const JointMotion<T>& motion, const Vector3& gravity,
                  T* tau) noexcept {
    const T *q = motion.q, *qd = motion.qd, *qdd = motion.qdd;
    const JointAngles<T>& angle = motion.angle;
    const T zero = 0.0;
    Point3<T> force[max_joints], moment[max_joints];  // on the links, in their frames, about their origins
    auto turn_of = [&](int i) { return JointTurn<T>(chain.joint[i], angle.cos[i], angle.sin[i]); };
    // Of the link: angular velocity, its rate, and the acceleration of its origin against free fall; before its own joint
    // adds to them.
    Point3<T> w{zero, zero, zero}, wd = w;
    Point3<T> a =
        turn_of(0).outward(into_first_frame(chain, Point3<T>{T(-gravity[0]), T(-gravity[1]), T(-gravity[2])}));
    // A first link that turns about its fixed axis needs but the moment about it.
    const bool first_turns = !Slides || !chain.joint[0].prismatic;
    T about_first = zero;
    if (first_turns) {
        const MassMoments<double>& mass = inertias.link[0];
        about_first = a.y * mass.first[0] - a.x * mass.first[1] + qdd[0] * (mass.xx + mass.yy + inertias.rotor[0]);
        if (chain.dof == 1) {
            tau[0] = about_first;
            return;
        }
        const auto& d = inertias.displacement[1];
        const T zz = qd[0] * qd[0];
        const JointTurn<T> turn = turn_of(1);
        a = turn.outward({a.x - (qdd[0] * d[1] + zz * d[0]), a.y + (qdd[0] * d[0] - zz * d[1]), a.z});
        w = turn.axis_outward(qd[0]);
        wd = turn.axis_outward(qdd[0]);
    }
    const int first = first_turns ? 1 : 0;
    for (int i = first;; ++i) {
        const Chain::Joint& joint = chain.joint[i];
        const MassMoments<double>& mass = inertias.link[i];
        if (!Slides || !joint.prismatic) {
            wd = {wd.x + w.y * qd[i], wd.y - w.x * qd[i], wd.z + qdd[i]};
            w.z += qd[i];
        }
        // A point at r has the acceleration a + U r, with these for U; of its diagonal the negative.
        const T xx = w.x * w.x, yy = w.y * w.y, zz = w.z * w.z;
        const T xy = w.x * w.y, xz = w.x * w.z, yz = w.y * w.z;
        const T minus_uxx = yy + zz, minus_uyy = zz + xx, minus_uzz = xx + yy;
        const T uxy = xy - wd.z, uyx = xy + wd.z;
        const T uzx = xz - wd.y, uxz = xz + wd.y;
        const T uyz = yz - wd.x, uzy = yz + wd.x;
        const double hx = mass.first[0], hy = mass.first[1];
        force[i] = {uxy * hy - minus_uxx * hx, uyx * hx - minus_uyy * hy, uzx * hx + uzy * hy};
        // First moment times a, and the part of the integral of (r x U r) dm that `zz` has no share in.
        moment[i] = {a.z * hy + uzy * mass.yy + (zz - yy) * mass.yz + uzx * mass.xy - uyx * mass.xz,
                     uxy * mass.yz - uzx * mass.xx + (xx - zz) * mass.xz - uzy * mass.xy - a.z * hx,
                     a.y * hx + uyx * mass.xx - uxy * mass.yy + (yy - xx) * mass.xy +
                         (uyz * mass.xz - uxz * mass.yz - a.x * hy)};
        if (Slides && joint.prismatic) {
            // The origin travels, and the joint before could not take over the mass on its axis.
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
        const JointTurn<T> turn = turn_of(i + 1);
        a = turn.outward(a);
        w = turn.outward(w);
        wd = turn.outward(wd);
    }
    Point3<T> f{zero, zero, zero}, n = f;
    for (int i = chain.dof - 1;; --i) {
        f = f + force[i];
        n = n + moment[i];
        tau[i] = (Slides && chain.joint[i].prismatic ? f.z : n.z) + qdd[i] * inertias.rotor[i];
        if (i == first) break;
        carry_inward<Slides>(chain, inertias, q, angle, i, f, n);
    }
    if (!first_turns) return;
    if (Slides && chain.joint[1].prismatic) {
        carry_inward<Slides>(chain, inertias, q, angle, 1, f, n);
        tau[0] = about_first + n.z;
    } else {
        tau[0] = about_first + axial_moment_inward(chain, inertias, angle, 1, f, n);
    }
}

/// Joints from which on one arm goes in lanes.
inline constexpr int min_joints_in_lanes = 7;

/// tau = M(q) qdd + C(q, qd) qd + g(q): the torques the motors must give, positive along the joints. `gravity` is the
/// acceleration of free fall in the base frame [m/s2]. A rotor adds its inertia times qdd. That it is also carried
/// around by the links before is neglected.
///
/// One arm of seven joints or more has a joint in every lane, where registers hold them: with fewer, adding up over lanes
/// takes longer than going from link to link.
template <class T>
void inverse_dynamics(const Chain& chain, const Inertias& inertias, const JointMotion<T>& motion,
                      const Vector3& gravity, T* tau) noexcept {
    if constexpr (Scalar<T>::lanes == 1) {
        if (inertias.lanes.groups > 0 && chain.dof >= min_joints_in_lanes) {
            const Point3<T> free_fall = into_first_frame(chain, Point3<T>{-gravity[0], -gravity[1], -gravity[2]});
            JointFrames frames;
            frames.set(inertias.lanes, motion.angle, motion.qd);
            T padded[max_joints];
            newton_euler_in_lanes(inertias.lanes, frames, motion.qd, motion.qdd, free_fall, padded);
            std::copy_n(padded, chain.dof, tau);
            return;
        }
    }
    if (inertias.slides) {
        newton_euler<true>(chain, inertias, motion, gravity, tau);
    } else {
        newton_euler<false>(chain, inertias, motion, gravity, tau);
    }
}

/// J' wrench: the torques it works with, positive along the joints.
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

/// The same with what the environment exerts: tau = M qdd + C qd + g - J' wrench.
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

/// g(q): what holds the arm still.
template <class T>
void gravity_torque(const Chain& chain, const Inertias& inertias, const T* q, const JointAngles<T>& angle,
                    const Vector3& gravity, T* tau) noexcept {
    T rest[max_joints];
    for (int j = 0; j < chain.dof; ++j) rest[j] = 0.0;
    inverse_dynamics(chain, inertias, {q, angle, rest, rest}, gravity, tau);
}

/// C(q, qd) qd: what keeps the rates constant, without gravity.
template <class T>
void coriolis_torque(const Chain& chain, const Inertias& inertias, const T* q, const JointAngles<T>& angle, const T* qd,
                     T* tau) noexcept {
    T rest[max_joints];
    for (int j = 0; j < chain.dof; ++j) rest[j] = 0.0;
    inverse_dynamics(chain, inertias, {q, angle, qd, rest}, {0, 0, 0}, tau);
}

/// A symmetric matrix [[a, b], [b, c]] and the vector (u, v), turned by an angle with this cosine and sine.
template <class T, class Angle>
void turn_plane(Angle cosine, Angle sine, T& a, T& b, T& c, T& u, T& v) {
    const T top = a * cosine - b * sine, across = b * cosine - c * sine;
    const T side = a * sine + b * cosine, bottom = b * sine + c * cosine;
    a = top * cosine - across * sine;
    b = top * sine + across * cosine;
    c = side * sine + bottom * cosine;
    const T turned = u * cosine - v * sine;
    v = u * sine + v * cosine;
    u = turned;
}

/// Joint-space mass matrix M(q) with the rotors on its diagonal [kg m2, kg m or kg]. Composite bodies: column j is what a
/// unit acceleration of joint j asks of the joints before, with all links from j on as one body.
template <class T>
void mass_matrix(const Chain& chain, const Inertias& inertias, const T* q, const JointAngles<T>& angle,
                 T (*m)[max_joints]) noexcept {
    const T zero = 0.0;
    MassMoments<T> body;
    for (int j = chain.dof - 1; j >= 0; --j) {
        const Chain::Joint& joint = chain.joint[j];
        const MassMoments<double>& own = inertias.link[j];
        body.mass += own.mass;
        for (int k = 0; k < 3; ++k) body.first[k] += own.first[k];
        body.xx += own.xx;
        body.yy += own.yy;
        body.zz += own.zz;
        body.xy += own.xy;
        body.xz += own.xz;
        body.yz += own.yz;

        Point3<T> f{zero, zero, body.mass}, n{body.first[1], -body.first[0], zero};
        if (!joint.prismatic) {
            f = {-body.first[1], body.first[0], zero};
            n = {-body.xz, -body.yz, body.xx + body.yy};
        }
        m[j][j] = (joint.prismatic ? f.z : n.z) + inertias.rotor[j];
        for (int i = j; i > 0; --i) {
            carry_inward<true>(chain, inertias, q, angle, i, f, n);
            m[i - 1][j] = m[j][i - 1] = chain.joint[i - 1].prismatic ? f.z : n.z;
        }

        if (j == 0) break;
        if (joint.prismatic) {
            body.zz += (body.first[2] * 2.0 + body.mass * q[j]) * q[j];
            body.xz += body.first[0] * q[j];
            body.yz += body.first[1] * q[j];
            body.first[2] += body.mass * q[j];
        }
        turn_plane(angle.cos[j], angle.sin[j], body.xx, body.xy, body.yy, body.xz, body.yz);
        turn_plane(joint.cos_alpha, joint.sin_alpha, body.yy, body.yz, body.zz, body.xy, body.xz);
        const JointTurn<T> turn(joint, angle.cos[j], angle.sin[j]);
        const Point3<T> h = turn.inward({body.first[0], body.first[1], body.first[2]});
        const auto& d = inertias.displacement[j];
        const T mx = body.mass * d[0], my = body.mass * d[1];
        body.xx += (h.x * 2.0 + mx) * d[0];
        body.yy += (h.y * 2.0 + my) * d[1];
        body.xy += h.x * d[1] + (h.y + my) * d[0];
        body.xz += h.z * d[0];
        body.yz += h.z * d[1];
        body.first = {h.x + mx, h.y + my, h.z};
    }
}

/// Factors a symmetric matrix into L L', L in its lower triangle (Cholesky). False where it is not positive definite to
/// the accuracy of a double; its factor is of no use there.
template <class T>
MaskOf<T> cholesky(T (*m)[max_joints], int n) noexcept {
    MaskOf<T> definite = T(0.0) < T(1.0);
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

/// 1 / (n' J M^-1 J' n) [kg]: what the arm, free in its joints, weighs to a push along the unit vector n at a point of a
/// link. Infinite where no joint moves the point along n by more than 1e-15 of what it moves it at all, NaN where the
/// mass matrix is singular.
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
        const Point3<T> column = linear_column(chain, posture, p, j);
        const T share = dot(column, direction);
        // Across n, but for rounding.
        x[j] = select(share * share > 1e-30 * dot(column, column), share, x[j]);
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
