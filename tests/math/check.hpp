// What the C++ test programs share: a count of failures that names the first of each place, and random numbers.
#pragma once

#include <cmath>
#include <cstdio>
#include <map>
#include <random>

namespace checks {

inline std::map<int, int> failures;  // by line

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
    for (const auto& [line, count] : failures) std::fprintf(stderr, "line %d: %d times\n", line, count);
    return failures.empty() ? 0 : 1;
}

inline std::mt19937_64 generator(20260101);
// The standard library's distributions differ from one library to the next.
inline double uniform(double from, double to) { return from + (to - from) * double(generator() >> 11) * 0x1p-53; }
inline double normal() {
    const double radius = std::sqrt(-2 * std::log(1 - uniform(0, 1)));
    return radius * std::cos(6.283185307179586 * uniform(0, 1));
}

}  // namespace checks

#define CHECK(condition) checks::that((condition), __LINE__, #condition)
#define CHECK_NEAR(a, b, bound) checks::near((a), (b), (bound), __LINE__, #a ", " #b)
