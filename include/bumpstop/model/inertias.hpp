/// @file
/// The inertia of a chain: of its links, and regrouped for computing.
#pragma once

#include "bumpstop/model/chain.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Inertia of a link in the frame of that link.
struct LinkInertia {
    double mass = 0;   ///< kg
    Vector3 center{};  ///< centre of mass [m]
    Matrix3 tensor{};  ///< about the centre of mass [kg m2]
    double rotor = 0;  ///< inertia of the motor, reflected to the joint [kg m2 or kg]
};

/// Moments of mass about the origin of the computing frame after a joint.
struct MassMoments {
    double mass = 0;                                        ///< integral of dm [kg]
    Vector3 first{};                                        ///< integral of r dm [kg m]
    double xx = 0, yy = 0, zz = 0, xy = 0, xz = 0, yz = 0;  ///< integral of r r' dm [kg m2]
};

/// The inertia of a chain, regrouped so that Newton-Euler needs fewer operations. The joint torques do not change; the
/// constraint forces in the joints do, and are not computed.
///
/// Mass on the axis of a revolute joint may belong to either of its links. So `mass`, `first[2]` and `zz` of a link
/// behind a revolute joint are moved to the previous link, and are zero in all that follows; what reaches the base does
/// not move. The origin of a frame may be anywhere on its joint's axis: from the tip on, each is slid to where the
/// displacement to the next one is perpendicular to the axis.
struct Inertias {
    std::array<MassMoments, max_joints> link{};
    std::array<double, max_joints> rotor{};
    std::array<double, max_joints> slide{};  ///< of the origin along the joint's axis [m]
    /// x and y of the displacement between the slid origins, see Chain::Joint; z is zero.
    std::array<std::array<double, 2>, max_joints> displacement{};

    Inertias() = default;
    Inertias(const Chain& chain, std::span<const LinkInertia> given) {
        for (int i = chain.dof - 1; i > 0; --i) {
            const Chain::Joint& joint = chain.joint[i];
            const Vector3& d = joint.displacement;
            displacement[i] = {d[0], d[1] - slide[i] * joint.sin_alpha};
            slide[i - 1] = d[2] + slide[i] * joint.cos_alpha;
        }
        for (int i = chain.dof - 1; i >= 0; --i) {
            const Chain::Joint& joint = chain.joint[i];
            rotor[i] = given[i].rotor;
            MassMoments& own = link[i];
            add(own, given[i], joint.to_link, slide[i]);
            if (joint.prismatic) continue;
            if (i > 0) {
                const Vector3 axis{0, -joint.sin_alpha, joint.cos_alpha};
                const Vector3 origin{displacement[i][0], displacement[i][1], 0};
                add_line(link[i - 1], own.mass, own.first[2], own.zz, origin, axis);
            }
            own.mass = own.first[2] = own.zz = 0;
        }
    }

  private:
    static void add(MassMoments& sum, const LinkInertia& given, const Matrix3& to_link, double slide) {
        const double m = given.mass;
        Vector3 c = to_link * given.center;
        c[2] -= slide;
        const Matrix3 t = to_link * given.tensor * transposed(to_link);
        const double half_trace = 0.5 * (t[0] + t[4] + t[8]);
        sum.mass += m;
        for (int k = 0; k < 3; ++k) sum.first[k] += m * c[k];
        sum.xx += half_trace - t[0] + m * c[0] * c[0];
        sum.yy += half_trace - t[4] + m * c[1] * c[1];
        sum.zz += half_trace - t[8] + m * c[2] * c[2];
        sum.xy += m * c[0] * c[1] - 0.5 * (t[1] + t[3]);
        sum.xz += m * c[0] * c[2] - 0.5 * (t[2] + t[6]);
        sum.yz += m * c[1] * c[2] - 0.5 * (t[5] + t[7]);
    }
    /// Mass on the line r = p + s u, given by the integrals of dm, s dm and s^2 dm.
    static void add_line(MassMoments& sum, double m, double ms, double mss, const Vector3& p, const Vector3& u) {
        const auto second = [&](int k, int l) {
            return m * p[k] * p[l] + ms * (p[k] * u[l] + u[k] * p[l]) + mss * u[k] * u[l];
        };
        sum.mass += m;
        for (int k = 0; k < 3; ++k) sum.first[k] += m * p[k] + ms * u[k];
        sum.xx += second(0, 0);
        sum.yy += second(1, 1);
        sum.zz += second(2, 2);
        sum.xy += second(0, 1);
        sum.xz += second(0, 2);
        sum.yz += second(1, 2);
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
