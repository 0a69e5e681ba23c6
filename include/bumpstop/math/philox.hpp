/// @file
/// Counter-based random numbers: Philox4x32-10 of Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as
/// easy as 1, 2, 3", 2011. A number depends only on its key and counter, so results do not depend on lanes,
/// threads or order.
#pragma once

#include "bumpstop/math/functions.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Product of the low 32 bits of each lane with a 32-bit constant, as 64 bits.
inline std::int64_t multiply_low_words(std::int64_t a, std::uint32_t b) {
    return std::int64_t((std::uint64_t(a) & 0xFFFFFFFFu) * b);
}
template <int N>
IntLanes<N> multiply_low_words(IntLanes<N> a, std::uint32_t b) {
    [[maybe_unused]] const typename Register<N>::Int factor = typename Register<N>::Int{} + std::int64_t(b);
#if defined(__AVX512F__)
    if constexpr (N == 8)
        return IntLanes<N>::of(
            (typename Register<N>::Int)_mm512_maskz_mul_epu32(all_lanes, (__m512i)a.v, (__m512i)factor));
#endif
#if defined(__AVX2__)
    if constexpr (N == 4)
        return IntLanes<N>::of((typename Register<N>::Int)_mm256_mul_epu32((__m256i)a.v, (__m256i)factor));
#endif
#if defined(__SSE2__)
    if constexpr (N == 2)
        return IntLanes<N>::of((typename Register<N>::Int)_mm_mul_epu32((__m128i)a.v, (__m128i)factor));
#endif
    IntLanes<N> r;
    for (int lane = 0; lane < N; ++lane) r.v[lane] = multiply_low_words(std::int64_t(a.v[lane]), b);
    return r;
}

inline std::int64_t high_word(std::int64_t a) { return std::int64_t(std::uint64_t(a) >> 32); }
template <int N>
IntLanes<N> high_word(IntLanes<N> a) {
    return IntLanes<N>::of((a.v >> 32) & 0xFFFFFFFF);
}

/// Four words of 32 bits, each in the low half of a 64-bit integer.
template <class I>
struct PhiloxBlock {
    I word[4];
};

template <class I>
PhiloxBlock<I> philox(PhiloxBlock<I> counter, std::uint64_t seed) {
    const I low = I(0xFFFFFFFF);
    std::uint32_t key0 = std::uint32_t(seed), key1 = std::uint32_t(seed >> 32);
    for (int round = 0; round < 10; ++round) {
        const I product0 = multiply_low_words(counter.word[0], 0xD2511F53u);
        const I product1 = multiply_low_words(counter.word[2], 0xCD9E8D57u);
        counter = {{high_word(product1) ^ counter.word[1] ^ I(key0), product1 & low,
                    high_word(product0) ^ counter.word[3] ^ I(key1), product0 & low}};
        key0 += 0x9E3779B9u;
        key1 += 0xBB67AE85u;
    }
    return counter;
}

/// A fair sign and a probability in (0, 1/2) with 52 random bits, from which inversion gives a standard normal number.
template <class T>
struct SignedProbability {
    T p;
    MaskOf<T> negative;

    T normal() const {
        const T z = normal_upper_quantile(p);
        return select(negative, -z, z);
    }
};

/// The first (half 0) or second (half 1) of two from one block: words 0, 1 or words 2, 3.
template <class T>
SignedProbability<T> signed_probability(const PhiloxBlock<IntOf<T>>& block, int half) {
    using I = IntOf<T>;
    const I low = block.word[2 * half], high = block.word[2 * half + 1];
    const I bits52 = ((high & I(0xFFFFF)) << 32) | low;
    // A double of exponent 0 with these 52 bits as mantissa lies in [1, 2).
    const T unit = real_of(bits52 | I(std::int64_t(0x3FF) << 52)) - 1.0;
    return {unit * 0.5 + 0x1p-54, (high & I(0x100000)) == I(0x100000)};
}

/// Counters in place of a tick, for draws that belong to a whole run; ticks are smaller.
inline constexpr std::int64_t offset_tick = 0xFFFFFFFF;  // the offset of the body
inline constexpr std::int64_t block_tick = 0xFFFFFFFE;   // the beginnings of blocks of a residual record

/// The block of joints 2 pair and 2 pair + 1 at one tick of one run. run < 2^62.
template <class I>
PhiloxBlock<I> noise_block(std::uint64_t seed, I run, std::int64_t tick, int pair) {
    return philox(PhiloxBlock<I>{{run & I(0xFFFFFFFF), high_word(run), I(tick), I(pair)}}, seed);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
