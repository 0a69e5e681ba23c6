/// @file
/// Made by tools/sincos_coefficients.py; do not edit.
#pragma once

namespace bumpstop::sincos_polynomial {

/// (sin x - x) / x^3 in powers of x^2 on [0, pi/4], lowest first.
inline constexpr double sine[6] = {
    -0.16666666666666666,   0.00833333333333095,     -0.0001984126983675979,
    2.7557316103105014e-06, -2.5051131947374594e-08, 1.5918135932869774e-10,
};
/// (cos x - 1 + x^2 / 2) / x^4 in powers of x^2 on [0, pi/4], lowest first.
inline constexpr double cosine[6] = {
    0.041666666666666664,    -0.0013888888888887398, 2.4801587298766363e-05,
    -2.7557317272036996e-07, 2.087614632531677e-09,  -1.1382636115964061e-11,
};

}  // namespace bumpstop::sincos_polynomial
