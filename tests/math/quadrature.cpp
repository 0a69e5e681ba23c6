// Gauss-Legendre rules, Legendre series and interpolation against polynomials.
#include "bumpstop/math/quadrature.hpp"

#include <limits>

#include "math/check.hpp"

namespace {

using namespace bumpstop;

constexpr double epsilon = std::numeric_limits<double>::epsilon();

long double legendre(int degree, long double x) {
    long double below = 1, here = x;
    if (degree == 0) return below;
    for (int l = 1; l < degree; ++l) {
        const long double above = ((2 * l + 1) * x * here - l * below) / (l + 1);
        below = here;
        here = above;
    }
    return here;
}

void gauss_rules() {
    for (int n = 1; n <= max_order; ++n) {
        const GaussRule& rule = gauss_rule(n);
        CHECK(rule.order == n);
        for (int g = 0; g < n; ++g) {
            CHECK(rule.weight[g] > 0 && std::fabs(rule.node[g]) < 1);
            CHECK(g == 0 || rule.node[g] > rule.node[g - 1]);
            CHECK_NEAR(rule.node[g], -rule.node[n - 1 - g], 4 * epsilon);
            // What an error of the node does to the weight: d log w / dx = -2 x / (1 - x^2).
            const double spread = 16 + 2 / (1 - rule.node[g] * rule.node[g]);
            CHECK_NEAR(rule.weight[g], rule.weight[n - 1 - g], spread * epsilon * rule.weight[g]);
        }
        long double power[2 * max_order] = {}, series[2 * max_order] = {};
        for (int g = 0; g < n; ++g) {
            const long double x = rule.node[g];
            long double monomial = 1, below = 0, here = 1;
            for (int degree = 0; degree < 2 * n; ++degree) {
                power[degree] += rule.weight[g] * monomial;
                series[degree] += rule.weight[g] * here;
                monomial *= x;
                const long double above = ((2 * degree + 1) * x * here - degree * below) / (degree + 1);
                below = here;
                here = above;
            }
        }
        // The weights add up to 2 and |P_l| <= 1, |x^d| <= 1, so errors of some roundings in the weights and
        // of one in the nodes, whose slopes reach the degree, stay within this.
        for (int degree = 0; degree < 2 * n; ++degree) {
            const double bound = (16 + degree) * epsilon;
            CHECK_NEAR(power[degree], degree % 2 == 0 ? 2.0L / (degree + 1) : 0.0L, bound);
            CHECK_NEAR(series[degree], degree == 0 ? 2.0L : 0.0L, bound);
        }
        // No rule of n nodes is exact one degree higher: P_n^2 vanishes at all of them.
        long double square = 0;
        for (int g = 0; g < n; ++g) square += rule.weight[g] * std::pow(legendre(n, rule.node[g]), 2);
        CHECK_NEAR(square, 0.0L, 1e-15L);
    }
}

void to_legendre() {
    for (int n = 1; n <= max_order; ++n) {
        const GaussRule rule(n);
        long double coefficient[max_order];
        for (int l = 0; l < n; ++l) coefficient[l] = checks::uniform(-1, 1);
        long double value[max_order];
        for (int g = 0; g < n; ++g) {
            value[g] = 0;
            for (int l = 0; l < n; ++l) value[g] += coefficient[l] * legendre(l, rule.node[g]);
        }
        for (int l = 0; l < n; ++l) {
            long double found = 0, bound = 0;
            for (int g = 0; g < n; ++g) {
                const double x = rule.node[g], entry = rule.to_legendre(l, g);
                found += entry * value[g];
                // Some roundings, one for every step of the recurrence, and what an error of the node does to
                // the weight.
                bound += std::fabs(entry * value[g]) * (16 + n + 2 / (1 - x * x)) * epsilon;
            }
            CHECK_NEAR(found, coefficient[l], bound);
        }
    }
}

template <class T>
void legendre_sums() {
    for (const int order : {1, 2, 3, 4, 5, 8, 13, 24, 47, 48}) {
        double c[max_order];
        for (int l = 0; l < order; ++l) c[l] = checks::uniform(-1, 1);
        for (int trial = 0; trial < 4; ++trial) {
            double place[8];
            for (double& x : place) x = checks::uniform(-1, 1);
            place[0] = trial == 0 ? -1 : trial == 1 ? 1 : place[0];
            const T at = legendre_series<T>(order, load<T>(place), [&](int l) { return T(c[l]); });
            for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
                const long double x = place[lane];
                long double value = 0;
                for (int l = 0; l < order; ++l) value += c[l] * legendre(l, x);
                // Every term is at most 1; the recurrence adds two roundings to each, and grows them with l.
                const double bound = 2 * order * (4 + order) * epsilon;
                CHECK_NEAR(lane_of(at, lane), value, bound);
            }
        }
    }
    // P_0 to P_3 by hand.
    for (int l = 0; l < 4; ++l) {
        for (double x = -1; x <= 1; x += 0.125) {
            const T at = legendre_series<T>(4, T(x), [&](int m) { return T(m == l ? 1.0 : 0.0); });
            const double value[] = {1, x, 1.5 * x * x - 0.5, (2.5 * x * x - 1.5) * x};
            CHECK_NEAR(lane_of(at, 0), value[l], 8 * epsilon);
        }
    }
}

// Against the sums written out.
template <class T>
void products_with_legendre() {
    for (int n = 8; n <= max_order; n += 8) {
        const GaussRule& rule = gauss_rule(n);
        std::vector<double> value(static_cast<std::size_t>(n)), found(value.size());
        for (double& x : value) x = double(checks::normal());
        half_legendre_sums<T>(rule, value.data(), found.data());
        for (int l = 0; l < n; ++l) {
            long double sum = 0, bound = 0;
            for (int g = 0; g < n; ++g) {
                const double x = rule.node[g];
                sum += 0.5L * legendre(l, x) * value[std::size_t(g)];
                // Roundings of the sums, of every step of the recurrence, and what an error of the node does to it: a
                // polynomial serves both nodes of a pair.
                bound += std::fabs(value[std::size_t(g)]) * (16 + 2 * n + 2 / (1 - x * x)) * epsilon;
            }
            CHECK_NEAR(found[std::size_t(l)], sum, bound);
        }
    }
}

void nodes_lie_in_their_range() {
    for (int range = 0; range <= 120; ++range) {
        for (int count = 2; count <= 40; ++count) {
            const int first = 7;
            const std::vector<int> node = interpolation_nodes(first, first + range, count);
            CHECK(int(node.size()) == std::min(count, range + 1));
            CHECK(node.front() == first);
            CHECK(node.back() == first + range);
            for (std::size_t i = 1; i < node.size(); ++i) CHECK(node[i] > node[i - 1]);
        }
    }
}

void interpolation() {
    for (const int count : {2, 3, 4, 6, 10, 16}) {
        for (const int range : {count - 1, 60, 300, 3000}) {
            const int first = 5;
            const Interpolation rule(interpolation_nodes(first, first + range, count));
            CHECK(rule.size() == count);
            // A random polynomial of the highest degree, in Chebyshev's form, which keeps it small.
            long double c[16];
            for (int d = 0; d < count; ++d) c[d] = checks::uniform(-1, 1);
            auto polynomial = [&](double place) {
                const long double x = 2 * (static_cast<long double>(place) - first) / range - 1;
                long double below = 1, here = x, sum = c[0] + (count > 1 ? c[1] * x : 0);
                for (int d = 2; d < count; ++d) {
                    const long double above = 2 * x * here - below;
                    below = here;
                    here = above;
                    sum += c[d] * here;
                }
                return sum;
            };
            auto check = [&](double place, const double* weight) {
                long double sum = 0, value = 0, size = 0;
                for (int m = 0; m < count; ++m) {
                    sum += weight[m];
                    size += std::fabs(weight[m]);
                    value += weight[m] * polynomial(rule.nodes()[std::size_t(m)]);
                }
                // A weight is made of `count` differences and a quotient; the polynomial is at most `count`.
                CHECK_NEAR(sum, 1.0L, 4 * count * epsilon * size);
                CHECK_NEAR(value, polynomial(place), 8 * count * count * epsilon * size);
            };
            for (int k = first; k <= first + range; k += 1 + range / 200) {
                double weight[16];
                rule.weights(k, weight);
                check(k, weight);
            }
            for (int m = 0; m < count; ++m) {
                double weight[16];
                rule.weights(rule.nodes()[std::size_t(m)], weight);
                for (int j = 0; j < count; ++j) CHECK(j == m ? weight[j] == 1 : std::fabs(weight[j]) < 1e-90);
            }
            // A register of places that are not whole numbers, the first node and the last among them.
            constexpr int lanes = 4;
            Lanes<lanes> place, weights[16];
            for (int lane = 0; lane < lanes; ++lane) set_lane(place, lane, first + range * lane / (lanes - 1.0));
            rule.weights(place, weights);
            for (int lane = 0; lane < lanes; ++lane) {
                double weight[16];
                for (int m = 0; m < count; ++m) weight[m] = lane_of(weights[m], lane);
                check(lane_of(place, lane), weight);
            }
        }
    }
    double weight[1];
    Interpolation({4}).weights(9, weight);
    CHECK(weight[0] == 1);
}

}  // namespace

int main() {
    gauss_rules();
    to_legendre();
    legendre_sums<double>();
    legendre_sums<Lanes<2>>();
    legendre_sums<Lanes<4>>();
    legendre_sums<Lanes<8>>();
    products_with_legendre<Lanes<2>>();
    products_with_legendre<Lanes<4>>();
    products_with_legendre<Lanes<8>>();
    nodes_lie_in_their_range();
    interpolation();
    return checks::result();
}
