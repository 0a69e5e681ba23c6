// The causal derivative: exact on polynomials, columns beside each other like each by itself, nothing allocated.
#include "bumpstop/signal/causal_derivative.hpp"

#include <cstdlib>
#include <memory>
#include <new>

#include "bumpstop/model/chain.hpp"
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
using Derivative = CausalDerivative<max_joints>;

static_assert(noexcept(std::declval<Derivative&>().update(0.0, nullptr)));

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

// Uneven times, from 100 s on; the tolerance is rounding in q over the shortest window, squared. Columns beyond the last may
// hold anything.
static void exact_on_polynomials() {
    for (int degree = 2; degree <= max_fit_degree; ++degree)
        for (int window : {degree + 1, 12, 64}) {
            for (int columns : {1, 7, 16}) {
                Derivative derivative(window, degree, columns);
                double q[max_joints], t = 100;
                for (double& beyond : q) beyond = std::nan("");
                for (int i = 0; i < 2 * window; ++i) {
                    t += checks::uniform(0.5, 2) * 0.05;
                    const double s = (t - 100) / 10;
                    for (int j = 0; j < columns; ++j) q[j] = (j + 1) * polynomial_derivative(s, degree, 0);
                    const bool full = derivative.update(t, q);
                    CHECK(full == (i >= window - 1));
                    CHECK(derivative.samples() == std::min(i + 1, window));
                    for (int j = 0; j < columns; ++j) {
                        const double scale = (j + 1) * (std::fabs(polynomial_derivative(s, degree, 0)) + 1);
                        const double share = full ? j + 1 : 0;
                        CHECK_NEAR(derivative.rate()[j], share * polynomial_derivative(s, degree, 1) / 10,
                                   1e-10 * scale);
                        CHECK_NEAR(derivative.acceleration()[j], share * polynomial_derivative(s, degree, 2) / 100,
                                   1e-8 * scale);
                    }
                }
            }
        }
}

// Shares of even times are kept from sample to sample; those of an even window and of an uneven one are of one kind.
static void even_times_and_reset() {
    Derivative derivative(8, 2, 1);
    double q[max_joints] = {};
    for (int begin : {0, 1}) {
        for (int i = 0; i < 40; ++i) {
            const double t = begin + 0.01 * i + (i == 25 ? 0.004 : 0.0);
            q[0] = 1 + 2 * t + 3 * t * t;
            if (!derivative.update(t, q)) continue;
            CHECK_NEAR(derivative.rate()[0], 2 + 6 * t, 1e-10);
            CHECK_NEAR(derivative.acceleration()[0], 6, 1e-7);
        }
        derivative.reset();
        CHECK(derivative.samples() == 0 && !derivative.full());
    }
}

int main() {
    const long before = allocations;
    exact_on_polynomials();
    even_times_and_reset();
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
