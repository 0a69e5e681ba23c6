// Moments, tails and quantiles of a force on panels of offsets against the integrals they stand for.
#include "bumpstop/collision/distribution/linear_quantity.hpp"

#include <array>

#include "math/check.hpp"

namespace {

using namespace bumpstop;
using L = Lanes<native_lanes>;
constexpr int order = 8;

// A density of offsets on [low, high], as powers of the place on [-1, 1], and where its stopping path ends.
struct Stopped {
    std::array<double, order> power;
    double factor, max_distance;

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
    const double edge = std::clamp(stopped.max_distance, low, high);
    Integral made;
    for (const auto& [from, to] : {std::pair{low, edge}, std::pair{edge, high}}) {
        for (int g = 0; g < rule.order; ++g) {
            const double offset = 0.5 * (from + to) + 0.5 * (to - from) * rule.node[std::size_t(g)];
            const double x = (2 * offset - low - high) / (high - low);
            const double mass = stopped.density(x) * rule.weight[std::size_t(g)] * (to - from) / (high - low);
            const double force = stiffness * std::max(0.0, stopped.max_distance - offset);
            made.mass += mass;
            made.first += mass * force;
            made.second += mass * force * force;
        }
    }
    return made;
}

double mass_below(const Stopped& stopped, double low, double high) {
    const GaussRule rule(16);
    const double share = (std::clamp(stopped.max_distance, low, high) - low) / (high - low);
    double mass = 0;
    for (int g = 0; g < rule.order; ++g)
        mass += stopped.density(share * (rule.node[std::size_t(g)] + 1) - 1) * rule.weight[std::size_t(g)] * share;
    return mass;
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

// Five panels, and detections at six ticks in each, whose stopping paths end before the panel, in it and beyond it.
template <class T>
void moments_and_tails_are_integrals() {
    const double stiffness = 75000;
    for (int i = 0; i < 50; ++i) {
        PiecewiseDensity density;
        density.clear(order);
        LinearQuantity force;
        force.scale = stiffness;
        Integral wanted;
        double above = 0;
        const double y = checks::uniform(0, 150);
        for (int p = 0; p < 5; ++p) {
            const double low = 1e-3 * checks::uniform(0, 3), high = low + 1e-3 * checks::uniform(0.1, 1);
            density.panel.push_back({low, high, 6 * p, 6, density.mass.size()});
            for (int k = 0; k < 6; ++k) {
                Stopped stopped{{}, checks::uniform(0.1, 2), low + (high - low) * checks::uniform(-1, 3)};
                stopped.power[0] = 2;
                for (std::size_t q = 1; q < order; ++q) stopped.power[q] = checks::uniform(-0.25, 0.25);
                for (double c : series_of(stopped)) density.series.push_back(stopped.factor * c);
                density.mass.push_back(2 * stopped.factor * series_of(stopped)[0]);
                density.panel.back().mass += density.mass.back();
                force.reach.push_back(stopped.max_distance);
                const Integral own = integral(stopped, low, high, stiffness);
                wanted.mass += own.mass;
                wanted.first += own.first;
                wanted.second += own.second;
                // What lies nearer than a force from the end of its stopping path exceeds it.
                Stopped nearer = stopped;
                nearer.max_distance -= y / stiffness;
                above += mass_below(nearer, low, high);
            }
        }
        density.sum_later_masses();
        summarise(density, force);
        find_moments<T>(density, force);
        const double mean = wanted.first / wanted.mass;
        CHECK_NEAR(force.total, wanted.mass, 1e-12 * wanted.mass);
        CHECK_NEAR(force.moments.mean, mean, 1e-11 * 200);
        CHECK_NEAR(force.moments.sd, std::sqrt(wanted.second / wanted.mass - mean * mean), 1e-10 * 200);
        CHECK_NEAR(tail<T>(density, force, y).probability, above, 1e-12 * wanted.mass);
        const double quantile = upper_quantile<T>(density, force, 0.3 * wanted.mass, 0);
        const TailAt at = tail<T>(density, force, quantile);
        CHECK_NEAR(at.probability, 0.3 * wanted.mass, 1e-9 * wanted.mass);
        const double step = 1e-4;
        CHECK_NEAR(
            at.density * 2 * step,
            tail<T>(density, force, quantile - step).probability - tail<T>(density, force, quantile + step).probability,
            1e-6 * wanted.mass);
    }
}

}  // namespace

int main() {
    moments_and_tails_are_integrals<double>();
    moments_and_tails_are_integrals<L>();
    return checks::result();
}
