/// @file
/// Elementary functions, templates over a double or lanes. tests/math/test_functions.py tabulates their errors.
#pragma once

#include "bumpstop/math/erfc_coefficients.hpp"
#include "bumpstop/math/lanes.hpp"
#include "bumpstop/math/sincos_coefficients.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Adding 1.5 * 2^52 rounds to the nearest integer and leaves that integer in the low bits of the mantissa.
inline constexpr double rounding_shift = 6755399441055744.0;

/// The largest integer not above x, |x| < 2^51.
template <class T>
T floor(T x) {
    const T near = (x + rounding_shift) - rounding_shift;
    return select(near > x, near - 1.0, near);
}

/// How a product and a sum after it are rounded: one by one, alike on every instruction set, or as `fused` does.
enum class Rounding { separate, fused };

/// c[0] + c[1] x + ... + c[n-1] x^(n-1), by two or four interleaved Horner schemes whose latencies overlap.
template <Rounding rounding = Rounding::separate, class T, int n>
T polynomial(const double (&c)[n], T x) {
    static_assert(n >= 4);
    const auto add = [](T a, T b, T sum) {
        if constexpr (rounding == Rounding::fused)
            return fused(a, b, sum);
        else
            return a * b + sum;
    };
    constexpr int chains = n >= 12 ? 4 : 2;
    const T square = x * x;
    const T stride = chains == 4 ? square * square : square;
    T sum[chains];
    BUMPSTOP_UNROLL
    for (int chain = 0; chain < chains; ++chain) {
        constexpr int rows = (n + chains - 1) / chains;
        const int top = (rows - 1) * chains + chain < n ? (rows - 1) * chains + chain : (rows - 2) * chains + chain;
        T value = c[top];
        BUMPSTOP_UNROLL
        for (int i = top - chains; i >= 0; i -= chains) value = add(value, stride, T(c[i]));
        sum[chain] = value;
    }
    if constexpr (chains == 2)
        return add(sum[1], x, sum[0]);
    else
        return add(add(sum[3], x, sum[2]), square, add(sum[1], x, sum[0]));
}

template <class T>
struct SinCos {
    T sin, cos;
};

/// sin x and cos x, |x| <= 1e5 rad. Argument reduction by three parts of pi/2 (Cody and Waite), then polynomials on
/// [-pi/4, pi/4] with errors of a tenth of a rounding: see tools/sincos_coefficients.py.
template <class T>
SinCos<T> sincos(T x) {
    constexpr double part1 = 0x1.921fb544p+0, part2 = 0x1.0b4611a6p-34, part3 = 0x1.3198a2e037073p-69;
    const T shifted = x * 0.63661977236758134308 + rounding_shift;
    const T n = shifted - rounding_shift;
    const T r = ((x - n * part1) - n * part2) - n * part3;
    const T square = r * r;
    const T sine = r + r * square * polynomial(sincos_polynomial::sine, square);
    const T cosine = 1.0 + square * (square * polynomial(sincos_polynomial::cosine, square) - 0.5);
    const IntOf<T> quadrant = bits_of(shifted);
    const auto odd = (quadrant & IntOf<T>(1)) == IntOf<T>(1);
    const T a = select(odd, cosine, sine), b = select(odd, sine, cosine);
    // Bit 1 of the quadrant is the sign of the sine; of the quadrant plus one, that of the cosine.
    const IntOf<T> sine_sign = (quadrant & IntOf<T>(2)) << 62;
    const IntOf<T> cosine_sign = ((quadrant + IntOf<T>(1)) & IntOf<T>(2)) << 62;
    return {real_of(bits_of(a) ^ sine_sign), real_of(bits_of(b) ^ cosine_sign)};
}

/// exp(-(a + b)) for a + b in [0, 745]; zero beyond 708. Two parts keep an exponent that one double cannot hold: erfc
/// passes an exact square of few bits and a small remainder.
template <class T>
T exp_minus(T a, T b) {
    constexpr double ln2_high = 0x1.62e42fefap-1, ln2_low = 0x1.cf79abc9e3b3ap-40;
    const T total = a + b;
    const T shifted = fused(total, T(-1.4426950408889634074), T(rounding_shift));
    const T n = shifted - rounding_shift;
    const T r = fused(n, T(-ln2_low), fused(n, T(-ln2_high), T(-a))) - b;
    constexpr double c[] = {1.0 / 2,         1.0 / 6,          1.0 / 24,         1.0 / 120,
                            1.0 / 720,       1.0 / 5040,       1.0 / 40320.0,    1.0 / 362880.0,
                            1.0 / 3628800.0, 1.0 / 39916800.0, 1.0 / 479001600.0};
    const T series = 1.0 + fused(r * r, polynomial<Rounding::fused>(c, r), r);
    const T scaled = real_of(bits_of(series) + (bits_of(shifted) << 52));
    return select(total < T(708.0), scaled, T(0.0));
}

/// erfc x, relative error below 1e-15 wherever the result is a normal number; zero beyond 26.6, 2 below -6.
/// exp(-x^2) (1 + 2x)^-1 p(t): see tools/erfc_coefficients.py for the polynomial.
template <class T>
T erfc(T x) {
    const T magnitude = min(abs(x), T(30.0));
    const T twice = 1.0 + 2.0 * magnitude, inverse = 1.0 / ((magnitude + erfc_polynomial::shift) * twice);
    const T t = (magnitude - erfc_polynomial::shift) * twice * inverse;
    const T scaled =
        polynomial<Rounding::fused>(erfc_polynomial::coefficients, t) * (magnitude + erfc_polynomial::shift) * inverse;
    // x^2 = brief^2 + (x - brief)(x + brief) with `brief` a multiple of 1/16: brief^2 is exact.
    const T brief = (magnitude + 0x1.8p+48) - 0x1.8p+48;
    const T upper = exp_minus(brief * brief, (magnitude - brief) * (magnitude + brief)) * scaled;
    return select(x < T(0.0), 2.0 - upper, upper);
}

/// Natural logarithm of a normal positive x, relative error below 1e-15.
template <class T>
T log(T x) {
    // Subtracting the bits of sqrt(1/2) before splitting puts the mantissa into [sqrt(1/2), sqrt(2)).
    constexpr std::int64_t root_half = 0x3FE6A09E667F3BCD;
    constexpr std::int64_t exponent_mask = std::int64_t(0xFFF) << 52;
    const IntOf<T> offset = bits_of(x) - IntOf<T>(root_half);
    const IntOf<T> exponent_bits = offset & IntOf<T>(exponent_mask);
    const T m = real_of(bits_of(x) - exponent_bits);
    // exponent_bits = e 2^52 as an integer. The bits of e + 1024, which is not negative, added to those of 2^52 are the
    // double 2^52 + e + 1024: instruction sets before AVX-512 cannot convert 64-bit integers.
    const IntOf<T> raised = shifted_right(offset + IntOf<T>(std::int64_t(1024) << 52), 52);
    const T e = real_of(raised | IntOf<T>(bits_of(0x1p52))) - (0x1p52 + 1024.0);
    const T f = m - 1.0;
    const T s = f / (2.0 + f);
    const T z = s * s;
    // log m = 2 atanh s = 2 s (1 + z/3 + z^2/5 + ...), |s| < 0.1716.
    constexpr double c[] = {2.0 / 3,  2.0 / 5,  2.0 / 7,  2.0 / 9,  2.0 / 11,
                            2.0 / 13, 2.0 / 15, 2.0 / 17, 2.0 / 19, 2.0 / 21};
    const T half_square = 0.5 * f * f;
    const T series = s * (half_square + z * polynomial(c, z));
    constexpr double ln2_high = 0x1.62e42fefap-1, ln2_low = 0x1.cf79abc9e3b3ap-40;
    return e * ln2_high - ((half_square - (series + e * ln2_low)) - f);
}

/// z with P(Z > z) = p for a standard normal Z and 0 < p <= 1/2: z >= 0. Rational functions of Wichura,
/// "Algorithm AS 241: the percentage points of the normal distribution" (PPND16), Applied Statistics 37, 1988;
/// 1e-15 relative.
template <class T>
T normal_upper_quantile(T p) {
    constexpr double a[] = {3.3871328727963666080e0,  1.3314166789178437745e+2, 1.9715909503065514427e+3,
                            1.3731693765509461125e+4, 4.5921953931549871457e+4, 6.7265770927008700853e+4,
                            3.3430575583588128105e+4, 2.5090809287301226727e+3};
    constexpr double b[] = {1.0,
                            4.2313330701600911252e+1,
                            6.8718700749205790830e+2,
                            5.3941960214247511077e+3,
                            2.1213794301586595867e+4,
                            3.9307895800092710610e+4,
                            2.8729085735721942674e+4,
                            5.2264952788528545610e+3};
    const T q = 0.5 - p;
    const T central_r = 0.180625 - q * q;
    const T central = q * polynomial(a, central_r) / polynomial(b, central_r);
    const auto tail = q > T(0.425);
    if (!any(tail)) return central;

    constexpr double c[] = {1.42343711074968357734e0,  4.63033784615654529590e0, 5.76949722146069140550e0,
                            3.64784832476320460504e0,  1.27045825245236838258e0, 2.41780725177450611770e-1,
                            2.27238449892691845833e-2, 7.74545014278341407640e-4};
    constexpr double d[] = {1.0,
                            2.05319162663775882187e0,
                            1.67638483018380384940e0,
                            6.89767334985100004550e-1,
                            1.48103976427480074590e-1,
                            1.51986665636164571966e-2,
                            5.47593808499534494600e-4,
                            1.05075007164441684324e-9};
    const T r = sqrt(-log(p));
    T outer = polynomial(c, r - 1.6) / polynomial(d, r - 1.6);
    const auto far = r > T(5.0);
    if (any(far)) {
        constexpr double e[] = {6.65790464350110377720e0,  5.46378491116411436990e0,  1.78482653991729133580e0,
                                2.96560571828504891230e-1, 2.65321895265761230930e-2, 1.24266094738807843860e-3,
                                2.71155556874348757815e-5, 2.01033439929228813265e-7};
        constexpr double f[] = {1.0,
                                5.99832206555887937690e-1,
                                1.36929880922735805310e-1,
                                1.48753612908506148525e-2,
                                7.86869131145613259100e-4,
                                1.84631831751005468180e-5,
                                1.42151175831644588870e-7,
                                2.04426310338993978564e-15};
        outer = select(far, polynomial(e, r - 5.0) / polynomial(f, r - 5.0), outer);
    }
    return select(tail, outer, central);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
