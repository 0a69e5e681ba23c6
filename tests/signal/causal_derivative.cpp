// The causal derivative: exact on polynomials, lanes equal to doubles, a late sample dropped, nothing allocated.
#include "bumpstop/signal/causal_derivative.hpp"

#include <cstdlib>
#include <new>

#include "math/check.hpp"

static long allocations = 0;
void* operator new(std::size_t size) {
    ++allocations;
    if (void* p = std::malloc(size)) return p;
    std::abort();
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }

using namespace bumpstop;

static_assert(noexcept(CausalDerivative<double>(8, 2).update(0.0, 0.0)));

// Derivative r at s of 1 - 2 s + 3 s^2 - ... up to `degree`.
static double polynomial_derivative(double s, int degree, int r) {
    double sum = 0;
    for (int k = degree; k >= r; --k) {
        double a = (k % 2 ? -1.0 : 1.0) * (k + 1);
        for (int j = 0; j < r; ++j) a *= k - j;
        sum = sum * s + a;
    }
    return sum;
}

// Uneven times, from 100 s on; the tolerance is rounding in q over the shortest window, squared.
static void exact_on_polynomials() {
    for (int degree = 2; degree <= max_fit_degree; ++degree)
        for (int window : {degree + 1, 12, CausalDerivative<double>::max_window}) {
            CausalDerivative<double> derivative(window, degree);
            double t = 100;
            for (int i = 0; i < 2 * window; ++i) {
                t += checks::uniform(0.5, 2) * 0.05;
                const double s = (t - 100) / 10;
                const CausalEstimate<double> e = derivative.update(t, polynomial_derivative(s, degree, 0));
                CHECK(e.known == (i >= window - 1));
                CHECK(derivative.samples() == std::min(i + 1, window));
                if (!e.known) {
                    CHECK(e.rate == 0 && e.acceleration == 0);
                    continue;
                }
                const double scale = std::fabs(polynomial_derivative(s, degree, 0)) + 1;
                CHECK_NEAR(e.rate, polynomial_derivative(s, degree, 1) / 10, 1e-10 * scale);
                CHECK_NEAR(e.acceleration, polynomial_derivative(s, degree, 2) / 100, 1e-8 * scale);
            }
        }
}

static void samples_that_tell_nothing_and_reset() {
    const double nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
    CausalDerivative<double> derivative(4, 2), undisturbed(4, 2);
    CausalEstimate<double> e, u;
    CHECK(derivative.update(nan, 1.0).rate == 0 && derivative.samples() == 0);
    for (int i = 0; i < 6; ++i) {
        const double t = 0.01 * i, q = checks::normal();
        e = derivative.update(t, q);
        u = undisturbed.update(t, q);
        e = derivative.update(t, 1e6);
        e = derivative.update(t - 0.005, -1e6);
        e = derivative.update(t + 0.005, nan);
        e = derivative.update(t + 0.005, -infinity);
        e = derivative.update(infinity, q);
        CHECK(e.rate == u.rate && e.acceleration == u.acceleration && e.known == u.known);
    }
    derivative.reset();
    CHECK(derivative.samples() == 0);
    CHECK(!derivative.update(0.0, 1.0).known);
    CHECK(derivative.samples() == 1);
}

static void lanes_are_doubles() {
    using L = Lanes<native_lanes>;
    CausalDerivative<L> together(8, 3);
    CausalDerivative<double> single[native_lanes] = {
        {8, 3},
        {8, 3},
#if defined(__AVX__)
        {8, 3},
        {8, 3},
#endif
#if defined(__AVX512F__)
        {8, 3},
        {8, 3},
        {8, 3},
        {8, 3},
#endif
    };
    double t = 0;
    for (int i = 0; i < 40; ++i) {
        t += checks::uniform(0.001, 0.002);
        L q = 0.0;
        for (int lane = 0; lane < native_lanes; ++lane) set_lane(q, lane, checks::normal());
        const CausalEstimate<L> e = together.update(t, q);
        for (int lane = 0; lane < native_lanes; ++lane) {
            const CausalEstimate<double> one = single[lane].update(t, q[lane]);
            CHECK_NEAR(e.rate[lane], one.rate, 1e-12 * (1 + std::fabs(one.rate)));
            CHECK_NEAR(e.acceleration[lane], one.acceleration, 1e-12 * (1 + std::fabs(one.acceleration)) * 1e3);
        }
    }
}

int main() {
    const long before = allocations;
    exact_on_polynomials();
    samples_that_tell_nothing_and_reset();
    lanes_are_doubles();
    CHECK(allocations == before);
    // The batch beside it, at the edges of its memory.
    for (std::size_t rows : {4u, 5u, 9u, 40u})
        for (std::size_t columns : {1u, 3u, 8u, 9u}) {
            std::vector<double> t(rows), q(rows * columns), position(q), rate(q), acceleration(q);
            for (std::size_t i = 0; i < rows; ++i) t[i] = 0.01 * double(i) + checks::uniform(0, 0.005);
            for (std::size_t i = 0; i < q.size(); ++i) q[i] = std::pow(t[i / columns], 3);
            local_derivatives(t.data(), q.data(), rows, columns, 0.05, 3,
                              {position.data(), rate.data(), acceleration.data()});
            for (std::size_t i = 0; i < q.size(); ++i) {
                const double s = t[i / columns];
                CHECK_NEAR(position[i], s * s * s, 1e-12);
                CHECK_NEAR(rate[i], 3 * s * s, 1e-10);
                CHECK_NEAR(acceleration[i], 6 * s, 1e-7);
            }
        }
    return checks::result();
}
