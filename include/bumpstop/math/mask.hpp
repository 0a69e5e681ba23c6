/// @file
/// Mask<N>: truth values of the lanes of a vector register; and the registers of the target instruction set.
#pragma once

#include <cstdint>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

// Rounding to integers adds and subtracts a large number, and samples that are NaN must be recognised.
#if defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__) || \
    (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ != 0)
#error "bumpstop needs arithmetic as written: no -ffast-math, -Ofast, -fassociative-math or -ffinite-math-only"
#endif

/// The headers are compiled once for every instruction set. The inline namespace keeps the linker from using a function
/// built for one instruction set in code for another, and from linking files whose register types differ in size.
#ifndef BUMPSTOP_TARGET
#if defined(__AVX512F__)
#define BUMPSTOP_TARGET native_avx512
#elif defined(__AVX2__)
#define BUMPSTOP_TARGET native_avx2
#elif defined(__AVX__)
#define BUMPSTOP_TARGET native_avx
#else
#define BUMPSTOP_TARGET native
#endif
#endif

/// Unrolls the loop that follows.
#if defined(__clang__)
#define BUMPSTOP_UNROLL _Pragma("clang loop unroll(full)")
#else
#define BUMPSTOP_UNROLL _Pragma("GCC unroll 16")
#endif

namespace bumpstop::inline BUMPSTOP_TARGET {

/// One specialisation per width, because gcc 12 rejects a vector_size that depends on a template parameter in a class
/// that can be constructed from both a double and a register.
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

/// Lanes of a vector register of the target instruction set.
#if defined(__AVX512F__)
inline constexpr int native_lanes = 8;
#elif defined(__AVX__)
inline constexpr int native_lanes = 4;
#else
inline constexpr int native_lanes = 2;
#endif

#if defined(__AVX512F__)
/// Mask of the zero-masking intrinsics. Those without a mask read an undefined register in the header of gcc 12, which
/// then warns; with all lanes given both compile to the same instruction.
inline constexpr __mmask8 all_lanes = 0xFF;
#endif

/// N truth values, all bits of a lane set or none.
template <int N>
struct Mask {
    using Real = typename Register<N>::Real;
    using Int = typename Register<N>::Int;
    Int bits;

    static Mask less(Real a, Real b) { return {a < b}; }
    static Mask at_most(Real a, Real b) { return {a <= b}; }
    static Mask equal(Real a, Real b) { return {a == b}; }
    static Mask equal(Int a, Int b) { return {a == b}; }
    Real choose(Real a, Real b) const {
#if defined(__AVX__)
        // gcc would compare the mask with zero again, although all bits of a lane are equal.
        if constexpr (N == 4) return _mm256_blendv_pd(b, a, (__m256d)bits);
#endif
        return bits ? a : b;
    }
    friend Mask operator&(Mask a, Mask b) { return {a.bits & b.bits}; }
    friend Mask operator|(Mask a, Mask b) { return {a.bits | b.bits}; }
    friend Mask operator!(Mask a) { return {~a.bits}; }
    bool operator[](int lane) const { return bits[lane] != 0; }
    void set(int lane, bool value) { bits[lane] = value ? -1 : 0; }
};

#if defined(__AVX512F__)
/// AVX-512 compares into mask registers with one bit per lane; as vectors the masks would have to be compared again.
template <>
struct Mask<8> {
    using Real = Register<8>::Real;
    using Int = Register<8>::Int;
    __mmask8 bits;

    static Mask less(Real a, Real b) { return {_mm512_cmp_pd_mask(a, b, _CMP_LT_OQ)}; }
    static Mask at_most(Real a, Real b) { return {_mm512_cmp_pd_mask(a, b, _CMP_LE_OQ)}; }
    static Mask equal(Real a, Real b) { return {_mm512_cmp_pd_mask(a, b, _CMP_EQ_OQ)}; }
    static Mask equal(Int a, Int b) { return {_mm512_cmpeq_epi64_mask((__m512i)a, (__m512i)b)}; }
    Real choose(Real a, Real b) const { return _mm512_mask_blend_pd(bits, b, a); }
    friend Mask operator&(Mask a, Mask b) { return {__mmask8(a.bits & b.bits)}; }
    friend Mask operator|(Mask a, Mask b) { return {__mmask8(a.bits | b.bits)}; }
    friend Mask operator!(Mask a) { return {__mmask8(~a.bits)}; }
    bool operator[](int lane) const { return (bits >> lane & 1) != 0; }
    void set(int lane, bool value) { bits = __mmask8((bits & ~(1 << lane)) | (value ? 1 << lane : 0)); }
};
#endif

inline bool select(bool m, bool a, bool b) { return m ? a : b; }
template <int N>
Mask<N> select(Mask<N> m, Mask<N> a, Mask<N> b) {
    return (m & a) | ((!m) & b);
}
inline bool differ(bool a, bool b) { return a != b; }
template <int N>
Mask<N> differ(Mask<N> a, Mask<N> b) {
    return (a & (!b)) | ((!a) & b);
}

inline bool any(bool m) { return m; }
inline bool all(bool m) { return m; }
template <int N>
bool any(Mask<N> m) {
#if defined(__AVX512F__)
    if constexpr (N == 8) return m.bits != 0;
#endif
#if defined(__AVX__)
    if constexpr (N == 4) return _mm256_movemask_pd((__m256d)m.bits) != 0;
#endif
#if defined(__SSE2__)
    if constexpr (N == 2) return _mm_movemask_pd((__m128d)m.bits) != 0;
#endif
    bool set = false;
    for (int lane = 0; lane < N; ++lane) set |= m[lane];
    return set;
}
template <int N>
bool all(Mask<N> m) {
    return !any(!m);
}

inline bool lane_of(bool m, int) { return m; }
template <int N>
bool lane_of(Mask<N> m, int lane) {
    return m[lane];
}
inline void set_lane(bool& m, int, bool value) { m = value; }
template <int N>
void set_lane(Mask<N>& m, int lane, bool value) {
    m.set(lane, value);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
