// Lanes<2>, <4> and <8> against doubles, and every function on lanes against the same function on a double.
#include <bit>
#include <cstdint>
#include <limits>
#include <vector>

#include "bumpstop/math/functions.hpp"
#include "bumpstop/math/philox.hpp"
#include "math/check.hpp"

namespace {

using namespace bumpstop;

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double epsilon = 0x1p-52;

bool same_bits(double a, double b) { return std::bit_cast<std::int64_t>(a) == std::bit_cast<std::int64_t>(b); }

// Pairs with zeros of both signs, equal numbers, infinities and ordinary ones.
const std::vector<double>& operands() {
    static const std::vector<double> values = [] {
        std::vector<double> v{0.0, -0.0, 1.0, -1.0, infinity, -infinity, 0x1p-1074, 0x1p1023, 3.5, -2.25};
        for (int i = 0; i < 30; ++i) v.push_back(checks::uniform(-10, 10));
        return v;
    }();
    return values;
}

template <int N>
Lanes<N> filled(double shift, int start) {
    double buffer[N];
    const auto& v = operands();
    for (int lane = 0; lane < N; ++lane) buffer[lane] = v[std::size_t(start + lane) % v.size()] + shift;
    return Lanes<N>::load(buffer);
}

/// Of powers of two every order of adding up is exact, and every lane that is left out or taken twice shows.
template <int N>
void sums() {
    double powers[N];
    for (int lane = 0; lane < N; ++lane) powers[lane] = std::ldexp(1.0, lane);
    CHECK(sum_of_lanes(Lanes<N>::load(powers)) == std::ldexp(1.0, N) - 1);
}

template <int N>
void transposition() {
    Lanes<N> row[N];
    for (int i = 0; i < N; ++i)
        for (int lane = 0; lane < N; ++lane) row[i].set(lane, 10 * i + lane);
    transpose(row);
    for (int i = 0; i < N; ++i)
        for (int lane = 0; lane < N; ++lane) CHECK(row[i][lane] == 10 * lane + i);
}

template <int N>
void masks_by_lane() {
    Mask<N> mask = Lanes<N>(0.0) > Lanes<N>(1.0);
    for (int lane = 0; lane < N; lane += 2) set_lane(mask, lane, true);
    set_lane(mask, 0, false);
    for (int lane = 0; lane < N; ++lane) CHECK(lane_of(mask, lane) == (lane > 0 && lane % 2 == 0));
}

template <int N>
void arithmetic() {
    using L = Lanes<N>;
    const int count = int(operands().size());
    for (int i = 0; i < count; ++i) {
        for (int j = 0; j < count; ++j) {
            const L a = filled<N>(0, i), b = filled<N>(0, j);
            const L sum = a + b, difference = a - b, product = a * b, negative = -a;
            const L low = min(a, b), high = max(a, b), chosen = select(a < b, a, b);
            const Mask<N> less = a<b, more = a> b, at_most = a <= b, at_least = a >= b;
            for (int lane = 0; lane < N; ++lane) {
                const double x = a[lane], y = b[lane];
                CHECK(same_bits(sum[lane], x + y) || std::isnan(x + y));
                CHECK(same_bits(difference[lane], x - y) || std::isnan(x - y));
                CHECK(same_bits(product[lane], x * y) || std::isnan(x * y));
                CHECK(same_bits(negative[lane], -x));
                CHECK(same_bits(low[lane], min(x, y)));
                CHECK(same_bits(high[lane], max(x, y)));
                CHECK(low[lane] == std::min(x, y) && high[lane] == std::max(x, y));
                CHECK(same_bits(chosen[lane], x < y ? x : y));
                CHECK(less[lane] == (x < y) && more[lane] == (x > y));
                CHECK(at_most[lane] == (x <= y) && at_least[lane] == (x >= y));
                CHECK((!less)[lane] == !(x < y) && (less & at_most)[lane] == (x < y));
                CHECK((less | more)[lane] == (x != y));
                CHECK(lane_of(less, lane) == (x < y) && same_bits(lane_of(a, lane), x));
            }
        }
        const L a = filled<N>(0, i), quotient = 1.0 / filled<N>(20, i);
        const L size = abs(a), root = sqrt(abs(a)), back = real_of(bits_of(a));
        L compound = a;
        compound += L(1.0);
        compound *= L(0.5);
        compound -= L(2.0);
        double buffer[N];
        store(a, buffer);
        for (int lane = 0; lane < N; ++lane) {
            const double x = a[lane];
            CHECK(same_bits(buffer[lane], x) && same_bits(load<L>(buffer)[lane], x));
            CHECK(same_bits(size[lane], std::fabs(x)) && same_bits(root[lane], std::sqrt(std::fabs(x))));
            CHECK(same_bits(back[lane], x) && bits_of(a).v[lane] == std::bit_cast<std::int64_t>(x));
            CHECK(same_bits(quotient[lane], 1.0 / filled<N>(20, i)[lane]));
            CHECK(same_bits(compound[lane], (x + 1.0) * 0.5 - 2.0));
        }
    }
    const L same = 2.5;
    for (int lane = 0; lane < N; ++lane) CHECK(same[lane] == 2.5);
}

// Every pattern of truth values.
template <int N>
void masks() {
    for (int pattern = 0; pattern < 1 << N; ++pattern) {
        Lanes<N> x = 0.0;
        for (int lane = 0; lane < N; ++lane) set_lane(x, lane, pattern >> lane & 1);
        const Mask<N> mask = x > Lanes<N>(0.5);
        CHECK(any(mask) == (pattern != 0));
        CHECK(all(mask) == (pattern == (1 << N) - 1));
        CHECK(any(!mask) == !all(mask));
    }
    CHECK(any(true) && !any(false) && all(true) && !all(false));
}

template <int N>
void integers() {
    using I = IntLanes<N>;
    for (int trial = 0; trial < 200; ++trial) {
        I a(0), b(0);
        for (int lane = 0; lane < N; ++lane) {
            a.v[lane] = std::int64_t(checks::bits()) >> 2;
            b.v[lane] = trial % 3 == 0 ? a.v[lane] : std::int64_t(checks::bits()) >> 2;
        }
        const std::uint32_t factor = std::uint32_t(checks::bits());
        const I product = multiply_low_words(a, factor), high = high_word(a);
        for (int lane = 0; lane < N; ++lane) {
            const std::int64_t x = a.v[lane], y = b.v[lane];
            CHECK((a + b).v[lane] == x + y && (a - b).v[lane] == x - y);
            CHECK((a & b).v[lane] == (x & y) && (a | b).v[lane] == (x | y) && (a ^ b).v[lane] == (x ^ y));
            CHECK((a << 13).v[lane] == x << 13 && (a == b)[lane] == (x == y));
            CHECK(product.v[lane] == multiply_low_words(x, factor));
            CHECK(std::uint64_t(product.v[lane]) == (std::uint64_t(x) & 0xFFFFFFFF) * factor);
            CHECK(high.v[lane] == high_word(x) && high.v[lane] == std::int64_t(std::uint64_t(x) >> 32));
        }
    }
}

// One register against its lanes. The compiler may fuse a product and a sum in one and not in the other: the
// difference is then within both errors.
template <int N, class Function>
void agrees(double from, double to, double bound, Function function) {
    for (int trial = 0; trial < 500; ++trial) {
        double x[N];
        for (double& value : x) value = checks::uniform(from, to);
        const Lanes<N> y = function(Lanes<N>::load(x));
        for (int lane = 0; lane < N; ++lane) {
            const double alone = function(x[lane]);
            CHECK_NEAR(y[lane], alone, 2 * bound * std::fabs(alone));
        }
    }
}

template <int N>
void functions() {
    agrees<N>(-1e5, 1e5, 2 * epsilon, [](auto x) { return sincos(x).sin; });
    agrees<N>(-1e5, 1e5, 2 * epsilon, [](auto x) { return sincos(x).cos; });
    agrees<N>(-6, 26.5, 1e-15, [](auto x) { return erfc(x); });
    agrees<N>(1e-3, 10, 1e-15, [](auto x) { return log(x); });
    agrees<N>(1e-9, 0.5, 1e-15, [](auto p) { return normal_upper_quantile(p); });
    // Centre, tail and far tail in one register.
    agrees<N>(-30, -1, 1e-15, [](auto x) { return normal_upper_quantile(exp_minus(-x, decltype(x)(0.0))); });
}

template <int N>
void random_numbers() {
    using I = IntLanes<N>;
    for (int trial = 0; trial < 100; ++trial) {
        const std::uint64_t seed = checks::bits();
        I run(0);
        for (int lane = 0; lane < N; ++lane) run.v[lane] = std::int64_t(checks::bits() >> 2);
        const PhiloxBlock<I> block = noise_block(seed, run, trial, 3);
        for (int lane = 0; lane < N; ++lane) {
            const PhiloxBlock<std::int64_t> alone = noise_block(seed, std::int64_t(run.v[lane]), trial, 3);
            for (int word = 0; word < 4; ++word) CHECK(block.word[word].v[lane] == alone.word[word]);
            for (int half = 0; half < 2; ++half) {
                const auto together = signed_probability<Lanes<N>>(block, half);
                const auto single = signed_probability<double>(alone, half);
                CHECK(same_bits(together.p[lane], single.p) && together.negative[lane] == single.negative);
                CHECK(single.p > 0 && single.p < 0.5);
                CHECK_NEAR(together.normal()[lane], single.normal(), 2e-15 * std::fabs(single.normal()));
            }
        }
    }
    // The two ends of the 52 random bits.
    const auto least = signed_probability<double>(PhiloxBlock<std::int64_t>{{0, 0, 0, 0}}, 0);
    const auto most = signed_probability<double>(PhiloxBlock<std::int64_t>{{0xFFFFFFFF, 0xFFFFFFFF, 0, 0}}, 0);
    CHECK(least.p == 0x1p-54 && !least.negative);
    CHECK(most.p == 0.5 - 0x1p-54 && most.negative);
}

void exponential() {
    // exp(-(a + b)) with a exact, as erfc uses it, against long double.
    for (int trial = 0; trial < 2000; ++trial) {
        const double a = std::floor(checks::uniform(0, 707) * 16) / 16, b = checks::uniform(0, 1);
        const long double exact = std::exp(-(static_cast<long double>(a) + b));
        CHECK_NEAR(exp_minus(a, b), exact, 4 * epsilon * exact);
    }
    CHECK(exp_minus(0.0, 0.0) == 1);
    CHECK(exp_minus(708.0, 0.0) == 0 && exp_minus(707.99, 0.0) > 0 && exp_minus(745.0, 0.0) == 0);
}

template <int N>
void run() {
    arithmetic<N>();
    sums<N>();
    transposition<N>();
    masks_by_lane<N>();
    masks<N>();
    integers<N>();
    functions<N>();
    random_numbers<N>();
}

}  // namespace

int main() {
    run<2>();
    run<4>();
    run<8>();
    exponential();
    return checks::result();
}
