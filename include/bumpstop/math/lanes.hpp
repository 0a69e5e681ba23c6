/// @file
/// Lanes<N>: N doubles in one vector register, and the few operations that let one text serve a lane and a
/// double.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

/// Every instruction set compiles the headers once. The inline namespace keeps the linker from merging a
/// function built for a wide machine into the code of a narrow one.
#ifndef BUMPSTOP_TARGET
#define BUMPSTOP_TARGET native
#endif

/// Before a loop that is short and hot. Compilers spell it differently.
#if defined(__clang__)
#define BUMPSTOP_UNROLL _Pragma("clang loop unroll(full)")
#else
#define BUMPSTOP_UNROLL _Pragma("GCC unroll 16")
#endif

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The register types are spelled out because gcc 12 rejects a vector_size that depends on a template
/// parameter when the class can be built both from a double and from a register.
template <int N>
struct Register;
template <>
struct Register<2> {
    typedef double Real __attribute__((vector_size(16)));
    typedef std::int64_t Int __attribute__((vector_size(16)));
    typedef std::uint64_t Unsigned __attribute__((vector_size(16)));
};
template <>
struct Register<4> {
    typedef double Real __attribute__((vector_size(32)));
    typedef std::int64_t Int __attribute__((vector_size(32)));
    typedef std::uint64_t Unsigned __attribute__((vector_size(32)));
};
template <>
struct Register<8> {
    typedef double Real __attribute__((vector_size(64)));
    typedef std::int64_t Int __attribute__((vector_size(64)));
    typedef std::uint64_t Unsigned __attribute__((vector_size(64)));
};

/// Lanes of one vector register of the instruction set being compiled for.
#if defined(__AVX512F__)
inline constexpr int native_lanes = 8;
#elif defined(__AVX__)
inline constexpr int native_lanes = 4;
#else
inline constexpr int native_lanes = 2;
#endif

/// N truth values, all bits of a lane set or none.
template <int N>
struct Mask {
    using Int = typename Register<N>::Int;
    Int bits;

    friend Mask operator&(Mask a, Mask b) { return {a.bits & b.bits}; }
    friend Mask operator|(Mask a, Mask b) { return {a.bits | b.bits}; }
    friend Mask operator!(Mask a) { return {~a.bits}; }
    bool operator[](int lane) const { return bits[lane] != 0; }
};

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
    friend Mask<N> operator==(IntLanes a, IntLanes b) { return {a.v == b.v}; }
};

/// N doubles.
template <int N>
struct Lanes {
    using Real = typename Register<N>::Real;
    Real v;

    Lanes() = default;
    Lanes(double x) : v(x - Real{}) {}  ///< x - 0 is x for a compiler too; x + 0 is not, where x is -0
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
    Lanes& operator*=(Lanes b) { return v *= b.v, *this; }
    friend Mask<N> operator<(Lanes a, Lanes b) { return {a.v < b.v}; }
    friend Mask<N> operator>(Lanes a, Lanes b) { return {a.v > b.v}; }
    friend Mask<N> operator<=(Lanes a, Lanes b) { return {a.v <= b.v}; }
    friend Mask<N> operator>=(Lanes a, Lanes b) { return {a.v >= b.v}; }
    friend Mask<N> operator==(Lanes a, Lanes b) { return {a.v == b.v}; }
};

/// What differs between a double and a lane: the mask, the integer of the same size, and how many there are.
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

inline std::int64_t bits_of(double x) { return std::bit_cast<std::int64_t>(x); }
inline double real_of(std::int64_t x) { return std::bit_cast<double>(x); }
template <int N>
IntLanes<N> bits_of(Lanes<N> x) {
    return IntLanes<N>::of(std::bit_cast<typename Register<N>::Int>(x.v));
}
template <int N>
Lanes<N> real_of(IntLanes<N> x) {
    return Lanes<N>::of(std::bit_cast<typename Register<N>::Real>(x.v));
}

/// x >> n, zeros shifted in.
inline std::int64_t shifted_right(std::int64_t x, int n) { return std::int64_t(std::uint64_t(x) >> n); }
template <int N>
IntLanes<N> shifted_right(IntLanes<N> x, int n) {
    using Unsigned = typename Register<N>::Unsigned;
    return IntLanes<N>::of(std::bit_cast<typename Register<N>::Int>(std::bit_cast<Unsigned>(x.v) >> n));
}

inline double select(bool m, double a, double b) { return m ? a : b; }
template <int N>
Lanes<N> select(Mask<N> m, Lanes<N> a, Lanes<N> b) {
#if defined(__AVX__)
    // All bits of a lane are alike; gcc compares them with zero once more.
    if constexpr (N == 4) return Lanes<N>::of(_mm256_blendv_pd(b.v, a.v, (__m256d)m.bits));
#endif
    return Lanes<N>::of(m.bits ? a.v : b.v);
}

inline bool any(bool m) { return m; }
inline bool all(bool m) { return m; }
template <int N>
bool any(Mask<N> m) {
#if defined(__AVX512F__)
    if constexpr (N == 8) return _mm512_test_epi64_mask((__m512i)m.bits, (__m512i)m.bits) != 0;
#endif
#if defined(__AVX__)
    if constexpr (N == 4) return _mm256_movemask_pd((__m256d)m.bits) != 0;
#endif
#if defined(__SSE2__)
    if constexpr (N == 2) return _mm_movemask_pd((__m128d)m.bits) != 0;
#endif
    std::int64_t set = 0;
    for (int lane = 0; lane < N; ++lane) set |= m.bits[lane];
    return set != 0;
}
template <int N>
bool all(Mask<N> m) {
    return !any(!m);
}

inline double minimum(double a, double b) { return a < b ? a : b; }
inline double maximum(double a, double b) { return a > b ? a : b; }
template <int N>
Lanes<N> minimum(Lanes<N> a, Lanes<N> b) {
#if defined(__AVX__)
    // The second of the two where one is NaN, as below.
    if constexpr (N == 4) return Lanes<N>::of(_mm256_min_pd(a.v, b.v));
#endif
    return Lanes<N>::of(a.v < b.v ? a.v : b.v);
}
template <int N>
Lanes<N> maximum(Lanes<N> a, Lanes<N> b) {
#if defined(__AVX__)
    // The second of the two where one is NaN, as below.
    if constexpr (N == 4) return Lanes<N>::of(_mm256_max_pd(a.v, b.v));
#endif
    return Lanes<N>::of(a.v > b.v ? a.v : b.v);
}

inline constexpr std::int64_t sign_bit = std::int64_t(1) << 63;
inline double absolute(double x) { return std::fabs(x); }
template <int N>
Lanes<N> absolute(Lanes<N> x) {
    return real_of(bits_of(x) & IntLanes<N>(~sign_bit));
}

inline double square_root(double x) { return std::sqrt(x); }
template <int N>
Lanes<N> square_root(Lanes<N> x) {
#if defined(__AVX512F__)
    if constexpr (N == 8) return Lanes<N>::of(_mm512_sqrt_pd(x.v));
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

/// Lane `lane` of x; a double has the one lane.
inline double lane_of(double x, int) { return x; }
template <int N>
double lane_of(Lanes<N> x, int lane) {
    return x.v[lane];
}
inline bool lane_of(bool m, int) { return m; }
template <int N>
bool lane_of(Mask<N> m, int lane) {
    return m[lane];
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
