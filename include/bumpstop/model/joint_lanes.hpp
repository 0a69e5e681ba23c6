/// @file
/// Newton-Euler of one arm with a joint in every lane of a register.
///
/// Link after link, every step waits for the one before. In the base frame only the orientations do: rates, accelerations,
/// forces and moments are sums over joints there, which a few shuffles add up in all lanes at once. With G registers joint
/// j stands in lane j / G of register j % G, so that neighbours stand side by side in different registers.
#pragma once

#include "bumpstop/model/inertias.hpp"
#include "bumpstop/model/kinematics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Axes x and y of every joint's computing frame and the angular velocity w of its link [rad/s]: three components, and one
/// that means nothing. All in the base frame turned by Chain::base_turn.
struct JointFrames {
    alignas(64) double x[max_joints][4], y[max_joints][4], w[max_joints][4];

    /// `qd`: rates of the chain's joints [rad/s].
    void set(const JointLanes& chain, const JointAngles<double>& angle, const double* qd) noexcept {
        using V = Lanes<4>;
        V to_x = 0.0, to_y = 0.0, to_z = 0.0, turning = 0.0;
        to_x.set(0, 1);
        to_y.set(1, 1);
        to_z.set(2, 1);
        int j = 0;
        for (; j < chain.dof; ++j) {
            const V ca = chain.cos_alpha[j], sa = chain.sin_alpha[j], c = angle.cos[j], s = angle.sin[j];
            const V tilted = to_y * ca + to_z * sa;
            to_z = to_z * ca - to_y * sa;
            to_y = tilted * c - to_x * s;
            to_x = to_x * c + tilted * s;
            turning += to_z * qd[j];
            store(to_x, x[j]);
            store(to_y, y[j]);
            store(turning, w[j]);
        }
        for (; j < chain.groups * native_lanes; ++j) {
            store(V(0.0), x[j]);
            store(V(0.0), y[j]);
            store(V(0.0), w[j]);
        }
    }
};

#if defined(__AVX__)

/// Of four vectors, `stride` numbers apart, the components: a vector in every lane.
inline Point3<Lanes<4>> gathered(const double* v, int stride) {
    const __m256d a = _mm256_loadu_pd(v), b = _mm256_loadu_pd(v + stride);
    const __m256d c = _mm256_loadu_pd(v + 2 * stride), d = _mm256_loadu_pd(v + 3 * stride);
    const __m256d xz0 = _mm256_unpacklo_pd(a, b), y0 = _mm256_unpackhi_pd(a, b);
    const __m256d xz1 = _mm256_unpacklo_pd(c, d), y1 = _mm256_unpackhi_pd(c, d);
    return {Lanes<4>::of(_mm256_insertf128_pd(xz0, _mm256_castpd256_pd128(xz1), 1)),
            Lanes<4>::of(_mm256_insertf128_pd(y0, _mm256_castpd256_pd128(y1), 1)),
            Lanes<4>::of(_mm256_permute2f128_pd(xz0, xz1, 0x31))};
}
/// In every lane the sum of the lanes before, or after.
inline Lanes<4> sum_before(Lanes<4> v) {
    const __m256d low = _mm256_permute2f128_pd(v.v, v.v, 0x08);
    const Lanes<4> one = Lanes<4>::of(_mm256_shuffle_pd(low, v.v, 0b0100)), two = v + one;
    return one + Lanes<4>::of(_mm256_permute2f128_pd(two.v, two.v, 0x08));
}
inline Lanes<4> sum_after(Lanes<4> v) {
    const __m256d high = _mm256_permute2f128_pd(v.v, v.v, 0x81);
    const Lanes<4> one = Lanes<4>::of(_mm256_shuffle_pd(v.v, high, 0b0101)), two = v + one;
    return one + Lanes<4>::of(_mm256_permute2f128_pd(two.v, two.v, 0x81));
}
/// Numbers of the joints that have a mask; zero for others, which are not read.
inline Lanes<4> loaded(const double* from, const std::int64_t* mask, Lanes<4>) {
    return Lanes<4>::of(_mm256_maskload_pd(from, _mm256_loadu_si256(reinterpret_cast<const __m256i*>(mask))));
}
/// Two registers of numbers in the order of joints, to and from the order of lanes.
inline void deal(Lanes<4> first, Lanes<4> second, Lanes<4>& even, Lanes<4>& odd) {
    const __m256d a = first.v, b = second.v;
    const __m256d low = _mm256_permute2f128_pd(a, b, 0x20), high = _mm256_permute2f128_pd(a, b, 0x31);
    even = Lanes<4>::of(_mm256_unpacklo_pd(low, high));
    odd = Lanes<4>::of(_mm256_unpackhi_pd(low, high));
}
inline void collect(Lanes<4> even, Lanes<4> odd, double* to) {
    const __m256d low = _mm256_unpacklo_pd(even.v, odd.v), high = _mm256_unpackhi_pd(even.v, odd.v);
    _mm256_storeu_pd(to, _mm256_permute2f128_pd(low, high, 0x20));
    _mm256_storeu_pd(to + 4, _mm256_permute2f128_pd(low, high, 0x31));
}

#endif
#if defined(__AVX512F__)

inline Point3<Lanes<8>> gathered8(const double* v, int stride) {
    const Point3<Lanes<4>> low = gathered(v, stride), high = gathered(v + 4 * stride, stride);
    const auto both = [](Lanes<4> a, Lanes<4> b) {
        return Lanes<8>::of(_mm512_maskz_insertf64x4(all_lanes, _mm512_castpd256_pd512(a.v), b.v, 1));
    };
    return {both(low.x, high.x), both(low.y, high.y), both(low.z, high.z)};
}
/// The lanes moved up, or down, and zeros in what becomes free.
template <int by>
Lanes<8> moved_up(Lanes<8> v) {
    return Lanes<8>::of(_mm512_castsi512_pd(
        _mm512_maskz_alignr_epi64(all_lanes, _mm512_castpd_si512(v.v), _mm512_setzero_si512(), 8 - by)));
}
template <int by>
Lanes<8> moved_down(Lanes<8> v) {
    return Lanes<8>::of(_mm512_castsi512_pd(
        _mm512_maskz_alignr_epi64(all_lanes, _mm512_setzero_si512(), _mm512_castpd_si512(v.v), by)));
}
inline Lanes<8> sum_before(Lanes<8> v) {
    const Lanes<8> one = moved_up<1>(v), two = v + one, four = two + moved_up<2>(two);
    return one + moved_up<2>(two) + moved_up<4>(four);
}
inline Lanes<8> sum_after(Lanes<8> v) {
    const Lanes<8> one = moved_down<1>(v), two = v + one, four = two + moved_down<2>(two);
    return one + moved_down<2>(two) + moved_down<4>(four);
}
inline Lanes<8> loaded(const double* from, const std::int64_t* mask, Lanes<8>) {
    const __m512i ours = _mm512_loadu_si512(mask);
    return Lanes<8>::of(_mm512_maskz_loadu_pd(_mm512_test_epi64_mask(ours, ours), from));
}
inline void deal(Lanes<8> first, Lanes<8> second, Lanes<8>& even, Lanes<8>& odd) {
    const __m512d a = first.v, b = second.v;
    even = Lanes<8>::of(_mm512_permutex2var_pd(a, _mm512_setr_epi64(0, 2, 4, 6, 8, 10, 12, 14), b));
    odd = Lanes<8>::of(_mm512_permutex2var_pd(a, _mm512_setr_epi64(1, 3, 5, 7, 9, 11, 13, 15), b));
}
inline void collect(Lanes<8> even, Lanes<8> odd, double* to) {
    _mm512_storeu_pd(to, _mm512_permutex2var_pd(even.v, _mm512_setr_epi64(0, 8, 1, 9, 2, 10, 3, 11), odd.v));
    _mm512_storeu_pd(to + 8, _mm512_permutex2var_pd(even.v, _mm512_setr_epi64(4, 12, 5, 13, 6, 14, 7, 15), odd.v));
}

#endif
#if defined(__AVX__)

/// A vector of every joint, in G registers each component.
template <int G>
class JointVectors {
  public:
    using L = Lanes<native_lanes>;
    Point3<L>& operator[](int group) { return at_[group]; }
    const Point3<L>& operator[](int group) const { return at_[group]; }

    /// Sums over all joints up to each.
    void add_up_from_base() {
        const Point3<L> before = before_groups();
        if constexpr (G == 2) at_[1] = at_[1] + at_[0] + before;
        at_[0] = at_[0] + before;
    }
    /// `start` and the sums over all joints before each.
    void add_up_before(const Point3<L>& start) {
        const Point3<L> before = start + before_groups();
        if constexpr (G == 2) at_[1] = at_[0] + before;
        at_[0] = before;
    }
    /// Sums over all joints from each on.
    void add_up_from_tip() {
        const Point3<L> all = total();
        const Point3<L> after{sum_after(all.x), sum_after(all.y), sum_after(all.z)};
        if constexpr (G == 2) at_[1] = at_[1] + after;
        at_[0] = all + after;
    }

  private:
    Point3<L> total() const {
        if constexpr (G == 1) return at_[0];
        return at_[0] + at_[G - 1];
    }
    Point3<L> before_groups() const {
        const Point3<L> all = total();
        return {sum_before(all.x), sum_before(all.y), sum_before(all.z)};
    }
    Point3<L> at_[G];
};

template <class T>
Point3<T> operator*(const Point3<T>& a, T b) {
    return {a.x * b, a.y * b, a.z * b};
}

/// a + b x c, two steps after the last of them.
template <class T>
Point3<T> with_cross(const Point3<T>& a, const Point3<T>& b, const Point3<T>& c) {
    return {(a.x + b.y * c.z) - b.z * c.y, (a.y + b.z * c.x) - b.x * c.z, (a.z + b.x * c.y) - b.y * c.x};
}

/// newton_euler_in_lanes in G registers.
template <int G>
[[gnu::flatten]] void newton_euler_in_groups(const JointLanes& chain, const JointFrames& frames, const double* qd,
                                             const double* qdd, const Point3<double>& free_fall, double* tau) noexcept {
    using L = Lanes<native_lanes>;
    constexpr int stride = 4 * G;
    JointVectors<G> x, y, z, w, wd, a, d, h, f, n;
    L rate[G], rise[G];
    rate[0] = loaded(qd, chain.mask.data(), L());
    rise[0] = loaded(qdd, chain.mask.data(), L());
    if constexpr (G == 2) {
        deal(rate[0], loaded(qd + native_lanes, &chain.mask[native_lanes], L()), rate[0], rate[1]);
        deal(rise[0], loaded(qdd + native_lanes, &chain.mask[native_lanes], L()), rise[0], rise[1]);
    }
    const auto gather = [](const double* v) {
#if defined(__AVX512F__)
        return gathered8(v, stride);
#else
        return gathered(v, stride);
#endif
    };
    // Sums over joints wait for shuffles. What does not need them comes next, and runs meanwhile.
    BUMPSTOP_UNROLL
    for (int g = 0; g < G; ++g) {
        x[g] = gather(frames.x[g]);
        y[g] = gather(frames.y[g]);
        z[g] = cross(x[g], y[g]);
        w[g] = gather(frames.w[g]);
        wd[g] = z[g] * rise[g] + cross(w[g], z[g]) * rate[g];
    }
    wd.add_up_from_base();
    BUMPSTOP_UNROLL
    for (int g = 0; g < G; ++g) {
        const auto at = std::size_t(g * native_lanes);
        d[g] = x[g] * load<L>(&chain.dx[at]) + y[g] * load<L>(&chain.dy[at]);
        h[g] = x[g] * load<L>(&chain.hx[at]) + y[g] * load<L>(&chain.hy[at]);
    }
    JointVectors<G> p = d;
    p.add_up_before({L(0.0), L(0.0), L(0.0)});
    // A vector r on a link adds U r = wd x r + w x (w x r): to the acceleration of origins for a displacement, to the force
    // for the first moment of mass.
    BUMPSTOP_UNROLL
    for (int g = 0; g < G; ++g) {
        const Point3<L>&u = w[g], &ud = wd[g];
        const L xx = u.x * u.x, yy = u.y * u.y, zz = u.z * u.z;
        const L minus_uxx = yy + zz, minus_uyy = zz + xx, minus_uzz = xx + yy;
        const L uxy = u.x * u.y - ud.z, uyx = u.x * u.y + ud.z;
        const L uzx = u.x * u.z - ud.y, uxz = u.x * u.z + ud.y;
        const L uyz = u.y * u.z - ud.x, uzy = u.y * u.z + ud.x;
        const auto added = [&](const Point3<L>& r) {
            return Point3<L>{uxy * r.y + (uxz * r.z - minus_uxx * r.x), uyx * r.x + (uyz * r.z - minus_uyy * r.y),
                             uzx * r.x + (uzy * r.y - minus_uzz * r.z)};
        };
        f[g] = added(h[g]);
        a[g] = added(d[g]);
    }
    a.add_up_before({L(free_fall.x), L(free_fall.y), L(free_fall.z)});
    BUMPSTOP_UNROLL
    for (int g = 0; g < G; ++g) {
        const auto at = std::size_t(g * native_lanes);
        // The moment as in newton_euler, in the frame of the link, but for that of the acceleration of the origin.
        const Point3<L> v{dot(x[g], w[g]), dot(y[g], w[g]), dot(z[g], w[g])};
        const L vxx = v.x * v.x, vyy = v.y * v.y, vzz = v.z * v.z;
        const Point3<L> vd{dot(x[g], wd[g]), dot(y[g], wd[g]), dot(z[g], wd[g])};
        const L uxy = v.x * v.y - vd.z, uyx = v.x * v.y + vd.z;
        const L uzx = v.x * v.z - vd.y, uxz = v.x * v.z + vd.y;
        const L uyz = v.y * v.z - vd.x, uzy = v.y * v.z + vd.x;
        const L xx = load<L>(&chain.xx[at]), yy = load<L>(&chain.yy[at]);
        const L xy = load<L>(&chain.xy[at]), xz = load<L>(&chain.xz[at]), yz = load<L>(&chain.yz[at]);
        const Point3<L> moment{uzy * yy + (vzz - vyy) * yz + (uzx * xy - uyx * xz),
                               uxy * yz - uzx * xx + ((vxx - vzz) * xz - uzy * xy),
                               uyx * xx - uxy * yy + ((vyy - vxx) * xy + (uyz * xz - uxz * yz))};
        n[g] = x[g] * moment.x + y[g] * moment.y + z[g] * moment.z + cross(p[g], f[g]);
    }
    f.add_up_from_tip();
    BUMPSTOP_UNROLL
    for (int g = 0; g < G; ++g) n[g] = with_cross(n[g], h[g], a[g]);
    n.add_up_from_tip();
    L torque[G];
    BUMPSTOP_UNROLL
    for (int g = 0; g < G; ++g)
        torque[g] = dot(z[g], n[g]) +
                    (rise[g] * load<L>(&chain.rotor[std::size_t(g * native_lanes)]) - dot(cross(z[g], p[g]), f[g]));
    if constexpr (G == 1) {
        store(torque[0], tau);
    } else {
        collect(torque[0], torque[1], tau);
    }
}

/// What newton_euler gives, for a chain with JointLanes::groups above 0. `tau` has max_joints numbers; those beyond the last
/// joint mean nothing. `free_fall`: acceleration of the base against free fall, in the frame that `frames` are in [m/s2].
inline void newton_euler_in_lanes(const JointLanes& chain, const JointFrames& frames, const double* qd,
                                  const double* qdd, const Point3<double>& free_fall, double* tau) noexcept {
    if (chain.groups == 1) {
        newton_euler_in_groups<1>(chain, frames, qd, qdd, free_fall, tau);
    } else {
        newton_euler_in_groups<2>(chain, frames, qd, qdd, free_fall, tau);
    }
}

#else

/// No chain has groups where registers are short.
inline void newton_euler_in_lanes(const JointLanes&, const JointFrames&, const double*, const double*,
                                  const Point3<double>&, double*) noexcept {}

#endif

}  // namespace bumpstop::inline BUMPSTOP_TARGET
