/// @file
/// Lanes<N>: N doubles in one vector register, and functions that let templates run with a double or with lanes.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "bumpstop/math/mask.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// N integers of 64 bits.
template <int N>
struct IntLanes {
    using Int = typename Register<N>::Int;
    Int v;

    IntLanes() = default;
    IntLanes(std::int64_t x) : v(Int{} + x) {}
    static IntLanes of(Int v) {
        IntLanes r;
        r.v = v;
        return r;
    }
    friend IntLanes operator+(IntLanes a, IntLanes b) { return of(a.v + b.v); }
    friend IntLanes operator-(IntLanes a, IntLanes b) { return of(a.v - b.v); }
    friend IntLanes operator&(IntLanes a, IntLanes b) { return of(a.v & b.v); }
    friend IntLanes operator|(IntLanes a, IntLanes b) { return of(a.v | b.v); }
    friend IntLanes operator^(IntLanes a, IntLanes b) { return of(a.v ^ b.v); }
    friend IntLanes operator<<(IntLanes a, int n) { return of(a.v << n); }
    friend Mask<N> operator==(IntLanes a, IntLanes b) { return Mask<N>::equal(a.v, b.v); }
};

/// N doubles.
template <int N>
struct Lanes {
    using Real = typename Register<N>::Real;
    Real v;

    Lanes() = default;
    Lanes(double x) : v(x - Real{}) {}  ///< x - 0 is x for every x, so it costs nothing; x + 0 changes -0
    static Lanes of(Real v) {
        Lanes r;
        r.v = v;
        return r;
    }
    static Lanes load(const double* p) {
        Lanes r;
        std::memcpy(&r.v, p, sizeof r.v);
        return r;
    }
    void store(double* p) const { std::memcpy(p, &v, sizeof v); }
    double operator[](int lane) const { return v[lane]; }
    void set(int lane, double x) { v[lane] = x; }

    friend Lanes operator+(Lanes a, Lanes b) { return of(a.v + b.v); }
    friend Lanes operator-(Lanes a, Lanes b) { return of(a.v - b.v); }
    friend Lanes operator*(Lanes a, Lanes b) { return of(a.v * b.v); }
    friend Lanes operator/(Lanes a, Lanes b) { return of(a.v / b.v); }
    friend Lanes operator-(Lanes a) { return of(-a.v); }
    Lanes& operator+=(Lanes b) { return v += b.v, *this; }
    Lanes& operator-=(Lanes b) { return v -= b.v, *this; }
    Lanes& operator*=(Lanes b) { return *this = *this * b; }
    friend Mask<N> operator<(Lanes a, Lanes b) { return Mask<N>::less(a.v, b.v); }
    friend Mask<N> operator>(Lanes a, Lanes b) { return Mask<N>::less(b.v, a.v); }
    friend Mask<N> operator<=(Lanes a, Lanes b) { return Mask<N>::at_most(a.v, b.v); }
    friend Mask<N> operator>=(Lanes a, Lanes b) { return Mask<N>::at_most(b.v, a.v); }
    friend Mask<N> operator==(Lanes a, Lanes b) { return Mask<N>::equal(a.v, b.v); }
};

/// Properties of a double or of lanes: how many there are, their mask, and the integers of the same size.
template <class T>
struct Scalar;
template <>
struct Scalar<double> {
    static constexpr int lanes = 1;
    using Mask = bool;
    using Int = std::int64_t;
};
template <int N>
struct Scalar<Lanes<N>> {
    static constexpr int lanes = N;
    using Mask = bumpstop::Mask<N>;
    using Int = IntLanes<N>;
};
template <class T>
using MaskOf = typename Scalar<T>::Mask;
template <class T>
using IntOf = typename Scalar<T>::Int;

/// The same truth value in all lanes.
template <class T>
MaskOf<T> mask_of(bool value) {
    return T(value ? 1.0 : 0.0) > T(0.5);
}

// As std::bit_cast, which the standard library of emscripten lacks.
inline std::int64_t bits_of(double x) { return __builtin_bit_cast(std::int64_t, x); }
inline double real_of(std::int64_t x) { return __builtin_bit_cast(double, x); }
template <int N>
IntLanes<N> bits_of(Lanes<N> x) {
    return IntLanes<N>::of(__builtin_bit_cast(typename Register<N>::Int, x.v));
}
template <int N>
Lanes<N> real_of(IntLanes<N> x) {
    return Lanes<N>::of(__builtin_bit_cast(typename Register<N>::Real, x.v));
}

/// x >> n, zeros shifted in.
inline std::int64_t shifted_right(std::int64_t x, int n) { return std::int64_t(std::uint64_t(x) >> n); }
template <int N>
IntLanes<N> shifted_right(IntLanes<N> x, int n) {
    using Unsigned = typename Register<N>::Unsigned;
    return IntLanes<N>::of(__builtin_bit_cast(typename Register<N>::Int, __builtin_bit_cast(Unsigned, x.v) >> n));
}

inline double select(bool m, double a, double b) { return m ? a : b; }
template <int N>
Lanes<N> select(Mask<N> m, Lanes<N> a, Lanes<N> b) {
    return Lanes<N>::of(m.choose(a.v, b.v));
}

inline double min(double a, double b) { return a < b ? a : b; }
inline double max(double a, double b) { return a > b ? a : b; }
template <int N>
Lanes<N> min(Lanes<N> a, Lanes<N> b) {
    // Where one of the two is NaN the intrinsics return b, as the comparison below does.
#if defined(__AVX512F__)
    if constexpr (N == 8) return Lanes<N>::of(_mm512_maskz_min_pd(all_lanes, a.v, b.v));
#endif
#if defined(__AVX__)
    if constexpr (N == 4) return Lanes<N>::of(_mm256_min_pd(a.v, b.v));
#endif
    return Lanes<N>::of(a.v < b.v ? a.v : b.v);
}
template <int N>
Lanes<N> max(Lanes<N> a, Lanes<N> b) {
#if defined(__AVX512F__)
    if constexpr (N == 8) return Lanes<N>::of(_mm512_maskz_max_pd(all_lanes, a.v, b.v));
#endif
#if defined(__AVX__)
    if constexpr (N == 4) return Lanes<N>::of(_mm256_max_pd(a.v, b.v));
#endif
    return Lanes<N>::of(a.v > b.v ? a.v : b.v);
}

/// a b + c, of lanes by a fused multiply-add where the instruction set has one. Paths do without: beside singularities
/// they make much of one rounding, and instruction sets would disagree.
inline double fused(double a, double b, double c) { return a * b + c; }
template <int N>
Lanes<N> fused(Lanes<N> a, Lanes<N> b, Lanes<N> c) {
#if defined(__AVX512F__)
    if constexpr (N == 8) return Lanes<N>::of(_mm512_maskz_fmadd_pd(all_lanes, a.v, b.v, c.v));
#endif
#if defined(__FMA__)
    if constexpr (N == 4) return Lanes<N>::of(_mm256_fmadd_pd(a.v, b.v, c.v));
#endif
    return a * b + c;
}

/// The sum of all lanes.
inline double sum_of_lanes(double x) { return x; }
template <int N>
double sum_of_lanes(Lanes<N> x) {
#if defined(__AVX512F__)
    if constexpr (N == 8) {
        return sum_of_lanes(Lanes<4>::of(_mm512_maskz_extractf64x4_pd(all_lanes, x.v, 0)) +
                            Lanes<4>::of(_mm512_maskz_extractf64x4_pd(all_lanes, x.v, 1)));
    }
#endif
#if defined(__AVX__)
    if constexpr (N == 4)
        return sum_of_lanes(Lanes<2>::of(_mm256_castpd256_pd128(x.v)) + Lanes<2>::of(_mm256_extractf128_pd(x.v, 1)));
#endif
    double total = x.v[0];
    for (int lane = 1; lane < N; ++lane) total += x.v[lane];
    return total;
}

namespace detail {

/// Exchanges the off-diagonal blocks of S by S, then those of half the size in every block.
template <int S, int N, int... I>
void transpose_blocks(Lanes<N>* row, std::integer_sequence<int, I...> lanes) {
    for (int i = 0; i < N; ++i) {
        if (i & S) continue;
        const auto a = row[i].v, b = row[i + S].v;
        row[i] = Lanes<N>::of(__builtin_shufflevector(a, b, ((I & S) == 0 ? I : N + I - S)...));
        row[i + S] = Lanes<N>::of(__builtin_shufflevector(a, b, ((I & S) == 0 ? I + S : N + I)...));
    }
    if constexpr (S > 1) transpose_blocks<S / 2>(row, lanes);
}

}  // namespace detail

/// Transposes N registers of N lanes: exchanges lane j of row[i] and lane i of row[j].
inline void transpose(double*) {}
template <int N>
void transpose(Lanes<N>* row) {
    detail::transpose_blocks<N / 2>(row, std::make_integer_sequence<int, N>());
}

inline constexpr std::int64_t sign_bit = std::int64_t(1) << 63;
inline double abs(double x) { return std::fabs(x); }
template <int N>
Lanes<N> abs(Lanes<N> x) {
    return Lanes<N>::of(real_of(bits_of(x) & IntLanes<N>(~sign_bit)).v);
}

inline double sqrt(double x) { return std::sqrt(x); }
template <int N>
Lanes<N> sqrt(Lanes<N> x) {
#if defined(__AVX512F__)
    if constexpr (N == 8) return Lanes<N>::of(_mm512_maskz_sqrt_pd(all_lanes, x.v));
#endif
#if defined(__AVX__)
    if constexpr (N == 4) return Lanes<N>::of(_mm256_sqrt_pd(x.v));
#endif
#if defined(__SSE2__)
    if constexpr (N == 2) return Lanes<N>::of(_mm_sqrt_pd(x.v));
#endif
    Lanes<N> r;
    for (int lane = 0; lane < N; ++lane) r.v[lane] = std::sqrt(x.v[lane]);
    return r;
}

/// Lane `lane` of x; a double has one lane.
inline double lane_of(double x, int) { return x; }
template <int N>
double lane_of(Lanes<N> x, int lane) {
    return x.v[lane];
}
inline void set_lane(double& x, int, double value) { x = value; }
template <int N>
void set_lane(Lanes<N>& x, int lane, double value) {
    x.v[lane] = value;
}
template <class T>
T load(const double* p) {
    if constexpr (Scalar<T>::lanes == 1) {
        return *p;
    } else {
        return T::load(p);
    }
}
inline void store(double x, double* p) { *p = x; }
template <int N>
void store(Lanes<N> x, double* p) {
    x.store(p);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
