// What the C++ test programs share: a count of failures that names the first of each line, and random numbers.
// Few headers, as every program is compiled several times.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdio>

namespace checks {

inline int failures[1000];  // by line

[[gnu::noinline]] inline void that(bool condition, int line, const char* text) {
    if (condition || failures[line]++ > 0) return;
    std::fprintf(stderr, "line %d: not so: %s\n", line, text);
}

// |a - b| <= bound; a NaN on either side fails.
[[gnu::noinline]] inline void near(long double a, long double b, long double bound, int line, const char* text) {
    if (std::fabs(a - b) <= bound || failures[line]++ > 0) return;
    std::fprintf(stderr, "line %d: %s: %.17Lg and %.17Lg differ by %.3Lg, more than %.3Lg\n", line, text, a, b,
                 std::fabs(a - b), bound);
}

// The exit status of a program.
inline int result() {
    int lines = 0;
    for (int line = 0; line < 1000; ++line) {
        if (failures[line] == 0) continue;
        std::fprintf(stderr, "line %d: %d times\n", line, failures[line]);
        ++lines;
    }
    return lines > 0;
}

// Splitmix64.
inline std::uint64_t bits() {
    static std::uint64_t state = 20260101;
    std::uint64_t z = state += 0x9E3779B97F4A7C15;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EB;
    return z ^ (z >> 31);
}
inline double uniform(double from, double to) { return from + (to - from) * double(bits() >> 11) * 0x1p-53; }
inline double normal() {
    const double radius = std::sqrt(-2 * std::log(1 - uniform(0, 1)));
    return radius * std::cos(6.283185307179586 * uniform(0, 1));
}

}  // namespace checks

#define CHECK(condition) checks::that((condition), __LINE__, #condition)
#define CHECK_NEAR(a, b, bound) checks::near((a), (b), (bound), __LINE__, #a ", " #b)
