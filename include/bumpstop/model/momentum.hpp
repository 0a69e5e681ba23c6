/// @file
/// Generalised momentum of a chain and the forces that change it, in one recursion outward and one inward.
#pragma once

#include "bumpstop/model/dynamics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The terms of a momentum observer. By Lagrange, dp/dt = tau + tau_ext + `velocity_force` - `gravity`.
template <class T>
struct MomentumTerms {
    T momentum[max_joints];        ///< p = M(q) qd = dT/dqd, rotors included [kg m2/s or kg m/s]
    T velocity_force[max_joints];  ///< dT/dq = C(q, qd)' qd [Nm or N]
    T gravity[max_joints];         ///< g(q) [Nm or N]
};

/// `gravity` is the acceleration of free fall in the base frame [m/s2].
///
/// In the frame after joint i, the twist (w, v) of the link before it appears rotated by -q_i, which is how q_i enters
/// the kinetic energy T of the links from i on. With their angular and linear momenta (l, f) about the origin of frame
/// i, dT/dq_i = -(z x w) l - (z x v) f; for a prismatic joint (w x z) f.
template <class T>
void momentum_terms(const Chain& chain, const Inertias& inertias, const T* q, const JointAngles<T>& angle, const T* qd,
                    const Vector3& gravity, MomentumTerms<T>& out) noexcept {
    const T zero = 0.0;
    Point3<T> momentum[max_joints], spin[max_joints], weight[max_joints], moment[max_joints];
    T wx[max_joints], wy[max_joints], vx[max_joints], vy[max_joints];  // twist of the previous link
    Point3<T> w{zero, zero, zero}, v = w;
    Point3<T> a = into_first_frame(chain, Point3<T>{T(-gravity[0]), T(-gravity[1]), T(-gravity[2])});
    for (int i = 0; i < chain.dof; ++i) {
        const Chain::Joint& joint = chain.joint[i];
        const MassMoments& mass = inertias.link[i];
        const JointTurn<T> turn(joint, angle.cos[i], angle.sin[i]);
        a = turn.outward(a);
        if (i > 0) {
            const auto& d = inertias.displacement[i];
            v = {v.x - w.z * d[1], v.y + w.z * d[0], v.z + (w.x * d[1] - w.y * d[0])};
            v = turn.outward(v);
            w = turn.outward(w);
        }
        wx[i] = w.x;
        wy[i] = w.y;
        vx[i] = v.x;
        vy[i] = v.y;
        if (joint.prismatic) {
            v = {v.x + w.y * q[i], v.y - w.x * q[i], v.z + qd[i]};
        } else {
            w.z += qd[i];
        }
        const Point3<T> h = point3<T>(mass.first), hv = cross(h, v);
        momentum[i] = mass.mass * v + cross(w, h);
        spin[i] = {hv.x + w.x * (mass.yy + mass.zz) - w.y * mass.xy - w.z * mass.xz,
                   hv.y + w.y * (mass.xx + mass.zz) - w.x * mass.xy - w.z * mass.yz,
                   hv.z + w.z * (mass.xx + mass.yy) - w.x * mass.xz - w.y * mass.yz};
        weight[i] = mass.mass * a;
        moment[i] = cross(h, a);
    }
    Point3<T> f{zero, zero, zero}, l = f, g = f, m = f;
    for (int i = chain.dof - 1;; --i) {
        f = f + momentum[i];
        l = l + spin[i];
        g = g + weight[i];
        m = m + moment[i];
        const bool slides = chain.joint[i].prismatic;
        out.momentum[i] = (slides ? f.z : l.z) + qd[i] * inertias.rotor[i];
        out.velocity_force[i] =
            slides ? wy[i] * f.x - wx[i] * f.y : wy[i] * l.x - wx[i] * l.y + vy[i] * f.x - vx[i] * f.y;
        out.gravity[i] = slides ? g.z : m.z;
        if (i == 0) break;
        carry_inward(chain, inertias, q, angle, i, f, l);
        carry_inward(chain, inertias, q, angle, i, g, m);
    }
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
