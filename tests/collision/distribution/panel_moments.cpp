// Moments of the peak force on a panel of offsets against the integral they stand for.
#include "bumpstop/collision/panel_moments.hpp"

#include <array>

#include "math/check.hpp"

namespace {

using namespace bumpstop;
using L = Lanes<native_lanes>;
constexpr int order = 8;

// A density of offsets on [low, high], as powers of the place on [-1, 1], and where its stopping path ends.
struct Stopped {
    std::array<double, order> power;
    double factor, farthest;

    double density(double x) const {
        double sum = 0;
        for (int p = order; p-- > 0;) sum = sum * x + power[std::size_t(p)];
        return factor * sum;
    }
};

struct Integral {
    double mass = 0, first = 0, second = 0;
};

// Over each side of the kink, where force and density are polynomials, Gauss's rule of 16 nodes is exact.
Integral integral(const Stopped& stopped, double low, double high, double stiffness) {
    const GaussRule rule(16);
    const double edge = std::clamp(stopped.farthest, low, high);
    Integral made;
    for (const auto& [from, to] : {std::pair{low, edge}, std::pair{edge, high}}) {
        for (int g = 0; g < rule.order; ++g) {
            const double offset = 0.5 * (from + to) + 0.5 * (to - from) * rule.node[std::size_t(g)];
            const double x = (2 * offset - low - high) / (high - low);
            const double mass = stopped.density(x) * rule.weight[std::size_t(g)] * (to - from) / (high - low);
            const double force = stiffness * std::max(0.0, stopped.farthest - offset);
            made.mass += mass;
            made.first += mass * force;
            made.second += mass * force * force;
        }
    }
    return made;
}

// Legendre's polynomials times the density, integrated over [-1, 1] and halved: by degree.
std::array<double, order> series_of(const Stopped& stopped) {
    const GaussRule rule(order);
    std::array<double, order> series{};
    for (int g = 0; g < order; ++g) {
        const double x = rule.node[std::size_t(g)];
        double before = 1, here = x;
        for (int l = 0; l < order; ++l) {
            const double value = l == 0 ? 1.0 : here;
            series[std::size_t(l)] += 0.5 * value * rule.weight[std::size_t(g)] * stopped.density(x) / stopped.factor;
            if (l == 0) continue;
            const double after = ((2 * l + 1) * x * here - l * before) / (l + 1);
            before = here;
            here = after;
        }
    }
    return series;
}

template <class T>
void sums_are_integrals() {
    const GaussRule rule(order);
    const double stiffness = 75000;
    for (int i = 0; i < 50; ++i) {
        const double about = checks::uniform(0, 60);
        PanelMoments<T, order> moments(stiffness, about, rule.node.data(), rule.weight.data());
        Integral wanted;
        for (int p = 0; p < 5; ++p) {
            const double low = 1e-3 * checks::uniform(0, 3), high = low + 1e-3 * checks::uniform(0.1, 1);
            moments.begin(low, high);
            for (int k = 0; k < 6; ++k) {
                Stopped stopped{{}, checks::uniform(0.1, 2), low + (high - low) * checks::uniform(-1, 3)};
                stopped.power[0] = 2;
                for (std::size_t q = 1; q < order; ++q) stopped.power[q] = checks::uniform(-0.25, 0.25);
                moments.add(series_of(stopped).data(), stopped.factor, stopped.farthest);
                const Integral own = integral(stopped, low, high, stiffness);
                wanted.mass += own.mass;
                wanted.first += own.first;
                wanted.second += own.second;
            }
            moments.end();
        }
        moments.add_nothing(0.7);
        wanted.mass += 0.7;
        const double second = wanted.second - 2 * about * wanted.first + about * about * wanted.mass;
        CHECK_NEAR(moments.first(), wanted.first - about * wanted.mass, 1e-12 * wanted.mass * 200);
        CHECK_NEAR(moments.second(), second, 1e-12 * wanted.mass * 200 * 200);
    }
}

}  // namespace

int main() {
    sums_are_integrals<double>();
    sums_are_integrals<L>();
    return checks::result();
}
