/// @file
/// Newton-Euler of one arm with a joint in every lane of a register.
///
/// Link after link, every step waits for the one before. In the base frame only the orientations do: rates, accelerations,
/// forces and moments are sums over joints there, which a few shuffles add up in all lanes at once.
#pragma once

#include "bumpstop/model/inertias.hpp"
#include "bumpstop/model/kinematics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Axes x, y and z of every joint's computing frame and the angular velocity w of its link [rad/s], in the base frame
/// turned by Chain::base_turn: three numbers each, and one that means nothing.
struct JointFrames {
    static constexpr int width = 16;
    alignas(64) double row[max_joints][width];  ///< x, y, z, w

    /// `qd`: rates of the chain's joints [rad/s].
    void set(const JointLanes& chain, const JointAngles<double>& angle, const double* qd) noexcept {
        using V = Lanes<4>;
        V x = 0.0, y = 0.0, z = 0.0, w = 0.0;
        x.set(0, 1);
        y.set(1, 1);
        z.set(2, 1);
        for (int j = 0; j < chain.groups * native_lanes; ++j) {
            const bool ours = j < chain.dof;
            if (ours) {
                const V ca = chain.cos_alpha[j], sa = chain.sin_alpha[j], c = angle.cos[j], s = angle.sin[j];
                const V tilted = y * ca + z * sa;
                z = z * ca - y * sa;
                y = tilted * c - x * s;
                x = x * c + tilted * s;
                w += z * qd[j];
            }
            store(ours ? x : V(0.0), row[j]);
            store(ours ? y : V(0.0), row[j] + 4);
            store(ours ? z : V(0.0), row[j] + 8);
            store(ours ? w : V(0.0), row[j] + 12);
        }
    }
};

/// A number of every joint, in G registers.
template <int G>
struct JointNumbers {
    using L = Lanes<native_lanes>;
    L at[G];

    JointNumbers() = default;
    JointNumbers(double same) {
        for (L& one : at) one = same;
    }
    explicit JointNumbers(const double* of_joints) {
        for (int g = 0; g < G; ++g) at[g] = load<L>(of_joints + g * native_lanes);
    }

    friend JointNumbers operator+(JointNumbers a, const JointNumbers& b) {
        for (int g = 0; g < G; ++g) a.at[g] += b.at[g];
        return a;
    }
    friend JointNumbers operator-(JointNumbers a, const JointNumbers& b) {
        for (int g = 0; g < G; ++g) a.at[g] -= b.at[g];
        return a;
    }
    friend JointNumbers operator*(JointNumbers a, const JointNumbers& b) {
        for (int g = 0; g < G; ++g) a.at[g] *= b.at[g];
        return a;
    }

    /// Sums over the joints before each.
    JointNumbers before() const {
        JointNumbers sum;
        double all = 0;
        for (int g = 0; g < G; ++g) {
            sum.at[g] = sum_of_lanes_before(at[g]);
            if (g > 0) sum.at[g] += all;
            if (g + 1 < G) all += sum_of_lanes(at[g]);
        }
        return sum;
    }
    /// Sums over the joints after each.
    JointNumbers after() const {
        JointNumbers sum;
        double all = 0;
        for (int g = G - 1; g >= 0; --g) {
            sum.at[g] = sum_of_lanes_after(at[g]);
            if (g + 1 < G) sum.at[g] += all;
            if (g > 0) all += sum_of_lanes(at[g]);
        }
        return sum;
    }
};

/// Sums over the joints before each, or after.
template <class V>
Point3<V> before(const Point3<V>& v) {
    return {v.x.before(), v.y.before(), v.z.before()};
}
template <class V>
Point3<V> after(const Point3<V>& v) {
    return {v.x.after(), v.y.after(), v.z.after()};
}

/// U = [wd x] + [w x][w x], which a vector fixed to a link is multiplied by for its second derivative.
template <class V>
struct SecondDerivative {
    V xx, yy, zz, xy, yx, xz, zx, yz, zy;  ///< of the diagonal the negative

    SecondDerivative(const Point3<V>& w, const Point3<V>& wd)
        : xx(w.y * w.y + w.z * w.z),
          yy(w.z * w.z + w.x * w.x),
          zz(w.x * w.x + w.y * w.y),
          xy(w.x * w.y - wd.z),
          yx(w.x * w.y + wd.z),
          xz(w.x * w.z + wd.y),
          zx(w.x * w.z - wd.y),
          yz(w.y * w.z - wd.x),
          zy(w.y * w.z + wd.x) {}
    Point3<V> operator*(const Point3<V>& r) const {
        return {xy * r.y + (xz * r.z - xx * r.x), yx * r.x + (yz * r.z - yy * r.y), zx * r.x + (zy * r.y - zz * r.z)};
    }
};

/// newton_euler_in_lanes in G registers.
template <int G>
[[gnu::flatten]] void newton_euler_in_registers(const JointLanes& chain, const JointFrames& frames, const double* qd,
                                                const double* qdd, const Point3<double>& free_fall,
                                                double* tau) noexcept {
    using L = Lanes<native_lanes>;
    using V = JointNumbers<G>;
    V frame[JointFrames::width], rate, rise;
    for (int g = 0; g < G; ++g) {
        const int first = g * native_lanes;
        for (int c = 0; c < JointFrames::width; c += native_lanes) {
            L part[native_lanes];
            for (int i = 0; i < native_lanes; ++i) part[i] = load<L>(frames.row[first + i] + c);
            transpose(part);
            for (int i = 0; i < native_lanes; ++i) frame[c + i].at[g] = part[i];
        }
        // What lies beyond the last joint may be anything.
        const MaskOf<L> ours = load<L>(&chain.ours[std::size_t(first)]) > L(0.5);
        rate.at[g] = select(ours, load<L>(qd + first), L(0.0));
        rise.at[g] = select(ours, load<L>(qdd + first), L(0.0));
    }
    const Point3<V> x{frame[0], frame[1], frame[2]}, y{frame[4], frame[5], frame[6]};
    const Point3<V> z{frame[8], frame[9], frame[10]}, w{frame[12], frame[13], frame[14]};
    const Point3<V> own = rise * z + rate * cross(w, z), wd = own + before(own);
    const Point3<V> d = V(chain.dx.data()) * x + V(chain.dy.data()) * y;
    const Point3<V> h = V(chain.hx.data()) * x + V(chain.hy.data()) * y;
    const Point3<V> p = before(d);
    const SecondDerivative<V> of_link(w, wd);
    const Point3<V> force = of_link * h, fall{free_fall.x, free_fall.y, free_fall.z}, a = fall + before(of_link * d);
    // The moment as in newton_euler, in the frame of the link, but for that of the acceleration of the origin.
    const Point3<V> v{dot(x, w), dot(y, w), dot(z, w)}, vd{dot(x, wd), dot(y, wd), dot(z, wd)};
    const SecondDerivative<V> u(v, vd);
    const V xx(chain.xx.data()), yy(chain.yy.data()), xy(chain.xy.data()), xz(chain.xz.data()), yz(chain.yz.data());
    const V across_xy = v.x * v.x - v.y * v.y, across_yz = v.y * v.y - v.z * v.z, across_zx = v.z * v.z - v.x * v.x;
    const V about_x = u.zy * yy - across_yz * yz + (u.zx * xy - u.yx * xz);
    const V about_y = u.xy * yz - u.zx * xx - (across_zx * xz + u.zy * xy);
    const V about_z = u.yx * xx - u.xy * yy - (across_xy * xy - (u.yz * xz - u.xz * yz));
    const Point3<V> moment = about_x * x + about_y * y + about_z * z + cross(p, force) + cross(h, a);
    const Point3<V> f = force + after(force), n = moment + after(moment);
    const V torque = dot(z, n) + (rise * V(chain.rotor.data()) - dot(cross(z, p), f));
    for (int g = 0; g < G; ++g) store(torque.at[g], tau + g * native_lanes);
}

/// What newton_euler gives, for a chain with JointLanes::groups above 0. `tau` has max_joints numbers; those beyond the last
/// joint mean nothing. `free_fall`: acceleration of the base against free fall, in the frame that `frames` are in [m/s2].
inline void newton_euler_in_lanes(const JointLanes& chain, const JointFrames& frames, const double* qd,
                                  const double* qdd, const Point3<double>& free_fall, double* tau) noexcept {
    if (chain.groups == 1) {
        newton_euler_in_registers<1>(chain, frames, qd, qdd, free_fall, tau);
    } else {
        newton_euler_in_registers<2>(chain, frames, qd, qdd, free_fall, tau);
    }
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
