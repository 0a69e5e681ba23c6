/// @file
/// Forces and delays over a piecewise density: survival functions, moments and quantiles.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "bumpstop/collision/distribution/piecewise_density.hpp"
#include "bumpstop/math/functions.hpp"
#include "bumpstop/math/interruption.hpp"
#include "bumpstop/math/quadrature.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct Moments {
    static constexpr double negligible = 1e-12;  ///< probability of infinite values: too little to count
    double mean, sd;
};

/// A quantity max(0, scale (reach - x)) that falls linearly with x inside a panel, where `reach` depends on the tick of
/// detection alone. Forces are of this kind, with the offset for x, and delays, with the time of contact.
struct LinearQuantity {
    double scale = 1;
    bool of_detected = true;    ///< exists where a collision is detected after contact,
    bool of_alarms = false;     ///< where something alarms before contact, with `PreContactAlarm::reach`,
    bool of_end = false;        ///< where nothing is ever detected, with `end_reach`
    std::vector<double> reach;  ///< by tick
    double end_reach = 0;
    std::vector<double> low, high;  ///< by panel: x at its ends; empty: its offsets
    std::vector<char> sorted;       ///< by panel: `reach` never falls from slot to slot
    double max_reach = 0;           ///< the greatest of reach - x
    double total = 0;               ///< probability that the quantity exists
    double last_step = 1e-8;        ///< a quantile's Newton step this short is the last [standard deviations]
    bool has_moments = false;       ///< whether `find_moments` has been called; quantiles need it
    Moments moments{};              ///< given that it exists

    double low_of(const PiecewiseDensity& density, std::size_t p) const {
        return low.empty() ? density.panel[p].low : low[p];
    }
    double high_of(const PiecewiseDensity& density, std::size_t p) const {
        return high.empty() ? density.panel[p].high : high[p];
    }
};

struct TailAt {
    double probability;  ///< that the quantity exceeds y
    double density;      ///< minus its derivative
};

namespace detail {

/// Sums the probabilities of parts of panels, as many at a time as there are lanes.
template <class T>
class PartialPanels {
  public:
    explicit PartialPanels(int order) : order_(order) {}

    /// `factor` times the integral of a series from -1 to `position`; `inverse_half`: 1 / half the panel's width.
    void add(const double* series, double factor, double position, double inverse_half) {
        series_[count_] = series;
        x_[count_] = position;
        factor_[count_] = factor;
        inverse_half_[count_] = inverse_half;
        if (++count_ == size) flush();
    }
    /// Adds the sums to the probability, and to the density per unit of x.
    void finish(TailAt& to) {
        if (count_ > 0) {
            // Lanes beyond the last one add nothing.
            for (int lane = count_; lane < size; ++lane) {
                series_[lane] = series_[0];
                x_[lane] = factor_[lane] = inverse_half_[lane] = 0;
            }
            flush();
        }
        to.probability += sum_of_lanes(probability_);
        to.density += sum_of_lanes(density_);
    }

  private:
    /// Two registers at a time, which hide the latency of the recurrence.
    static constexpr int lanes = Scalar<T>::lanes, registers = 2, size = registers * lanes;

    void flush() {
        count_ = 0;
        T x[registers], below[registers], slope[registers], before[registers], here[registers];
        for (int r = 0; r < registers; ++r) {
            x[r] = load<T>(x_ + r * lanes);
            here[r] = 1.0;
            before[r] = -1.0;  // so that the integral of P_0 is x + 1
            below[r] = slope[r] = 0.0;
        }
        for (int first = 0; first < order_; first += lanes) {
            T degree[registers][lanes];
            for (int r = 0; r < registers; ++r) {
                for (int lane = 0; lane < lanes; ++lane) degree[r][lane] = load<T>(series_[r * lanes + lane] + first);
                transpose(degree[r]);
            }
            BUMPSTOP_UNROLL
            for (int i = 0; i < lanes; ++i) {
                const int l = first + i;
                for (int r = 0; r < registers; ++r) {
                    const T after = fused(legendre_factors.rise[std::size_t(l)] * x[r], here[r],
                                          -legendre_factors.fall[std::size_t(l)] * before[r]);
                    below[r] = fused(after - before[r], degree[r][i], below[r]);
                    slope[r] = fused((2.0 * l + 1) * here[r], degree[r][i], slope[r]);
                    before[r] = here[r];
                    here[r] = after;
                }
            }
        }
        for (int r = 0; r < registers; ++r) {
            const T factor = load<T>(factor_ + r * lanes);
            // Where the probability is next to nothing the polynomial may be slightly negative.
            probability_ += factor * max(below[r], T(0.0));
            density_ += factor * load<T>(inverse_half_ + r * lanes) * slope[r];
        }
    }

    int order_, count_ = 0;
    const double* series_[size];
    alignas(64) double x_[size];
    alignas(64) double factor_[size];
    alignas(64) double inverse_half_[size];
    T probability_ = 0.0, density_ = 0.0;
};

/// P(reach - x > depth) over the panels of a quantity, and its density per unit of x.
template <class T>
class TailSum {
  public:
    TailSum(const PiecewiseDensity& density, const LinearQuantity& quantity, double depth)
        : density_(density), quantity_(quantity), depth_(depth), partial_(density.order) {}

    TailAt operator()() {
        int passing = 0;  // first slot of the panel before that exceeds the depth everywhere: a guess for the next
        for (std::size_t p = 0; p < density_.panel.size(); ++p) {
            const PiecewiseDensity::Panel& panel = density_.panel[p];
            const double low = quantity_.low_of(density_, p), high = quantity_.high_of(density_, p);
            if (quantity_.of_detected && panel.mass != 0) {
                if (quantity_.sorted[p]) {
                    passing = add_sorted(panel, low, high, passing);
                } else {
                    for (int slot = 0; slot < panel.slots; ++slot) add_slot(panel, slot, low, high);
                }
            }
            if (quantity_.of_end && !density_.end_series.empty())
                add(density_.end_series_of(p), 1.0, quantity_.end_reach, low, high);
            if (quantity_.of_alarms) add_alarms(panel, p, low, high);
        }
        partial_.finish(sum_);
        return sum_;
    }

  private:
    void add(const double* series, double factor, double reach, double low, double high) {
        if (reach - depth_ > high) {
            sum_.probability += 2 * factor * series[0];
        } else if (reach - depth_ > low) {
            add_partial(series, factor, reach, low, high);
        }
    }
    void add_partial(const double* series, double factor, double reach, double low, double high) {
        const double inverse_half = 2 / (high - low);
        partial_.add(series, factor, (reach - depth_ - 0.5 * (low + high)) * inverse_half, inverse_half);
    }
    void add_slot(const PiecewiseDensity::Panel& panel, int slot, double low, double high) {
        if (density_.mass_of(panel, slot) > 0)
            add(density_.series_of(panel, slot), 1.0, quantity_.reach[std::size_t(panel.tick(slot))], low, high);
    }

    /// Where the reach grows from slot to slot the last slots exceed the depth over the whole panel. Returns the first
    /// of them, searched from `guess` on.
    int add_sorted(const PiecewiseDensity::Panel& panel, double low, double high, int guess) {
        const double* reach = quantity_.reach.data() + panel.first_tick;
        int slot = std::min(guess, panel.slots);
        while (slot > 0 && reach[slot - 1] - depth_ > high) --slot;
        while (slot < panel.slots && !(reach[slot] - depth_ > high)) ++slot;
        if (slot < panel.slots) sum_.probability += density_.later_mass[panel.first_slot + std::size_t(slot)];
        for (int other = slot - 1; other >= 0 && reach[other] - depth_ > low; --other)
            if (density_.mass_of(panel, other) > 0)
                add_partial(density_.series_of(panel, other), 1.0, reach[other], low, high);
        return slot;
    }

    void add_alarms(const PiecewiseDensity::Panel& panel, std::size_t p, double low, double high) {
        if (panel.first_alarm == panel.end_alarm) return;
        const PreContactAlarm *const first = density_.alarm.data() + panel.first_alarm, *const end =
                                                                                            density_.alarm.data() +
                                                                                            panel.end_alarm;
        if (!(first->reach - depth_ > low)) return;
        const PreContactAlarm* one =
            std::partition_point(first, end, [&](const PreContactAlarm& a) { return a.reach - depth_ > high; });
        const double* series = density_.offset_series_of(p);
        sum_.probability += 2 * (one == end ? (end - 1)->before + (end - 1)->chance : one->before) * series[0];
        for (; one != end && one->reach - depth_ > low; ++one) add_partial(series, one->chance, one->reach, low, high);
    }

    const PiecewiseDensity& density_;
    const LinearQuantity& quantity_;
    const double depth_;
    TailAt sum_{0, 0};
    PartialPanels<T> partial_;
};

/// First and second moment of a quantity about `about`, in units of x.
template <class T>
class MomentSum {
  public:
    MomentSum(const PiecewiseDensity& density, double about)
        : order_(density.order), about_(about), rule_(gauss_rule(density.order)) {}

    /// Adds a piece: `factor` times a series, with its reach.
    void add(const double* series, double factor, double reach, double low, double high) {
        if (reach >= high) {
            const double middle = reach - 0.5 * (low + high) - about_, slope = 0.5 * (high - low);
            // x is P_1, and x^2 is (2 P_2 + 1) / 3.
            first += 2 * factor * (middle * series[0] - slope * series[1]);
            second += 2 * factor *
                      (middle * (middle * series[0] - 2 * slope * series[1]) +
                       slope * slope * (2 * series[2] + series[0]) * (1.0 / 3));
        } else if (reach > low) {
            add_partial(series, factor, reach, low, high);
        } else {
            add_zero(2 * factor * series[0]);
        }
    }

    double first = 0, second = 0;

  private:
    void add_zero(double probability) {
        first -= probability * about_;
        second += probability * about_ * about_;
    }
    /// Beyond the reach the quantity is zero; before it, where it is linear, Gauss's rule integrates it.
    void add_partial(const double* series, double factor, double reach, double low, double high) {
        const double share = (reach - low) / (high - low);
        T probability = 0.0, one = 0.0, two = 0.0;
        for (int g = 0; g < order_; g += Scalar<T>::lanes) {
            const T part = 0.5 * (load<T>(&rule_.node[std::size_t(g)]) + 1.0);  // of the way from `low` to `reach`
            const T here =
                (share * factor) * load<T>(&rule_.weight[std::size_t(g)]) *
                legendre_series(order_, T(2.0 * share * part - 1.0), [&](int l) { return T((2 * l + 1) * series[l]); });
            const T value = (reach - low) * (1.0 - part) - about_;
            probability += here;
            one += here * value;
            two += here * value * value;
        }
        first += sum_of_lanes(one);
        second += sum_of_lanes(two);
        add_zero(2 * factor * series[0] - sum_of_lanes(probability));
    }

    const int order_;
    const double about_;
    const GaussRule& rule_;
};

}  // namespace detail

/// Fills `total`, `max_reach` and `sorted`, which tails need.
inline void summarise(const PiecewiseDensity& density, LinearQuantity& quantity) {
    quantity.total = quantity.max_reach = 0;
    quantity.sorted.assign(density.panel.size(), 1);
    const auto include = [&](double mass, double reach, double low) {
        quantity.total += mass;
        if (mass > 0) quantity.max_reach = std::max(quantity.max_reach, reach - low);
    };
    for (std::size_t p = 0; p < density.panel.size(); ++p) {
        const PiecewiseDensity::Panel& panel = density.panel[p];
        const double low = quantity.low_of(density, p);
        if (quantity.of_detected && panel.mass > 0) {
            const double *first = &quantity.reach[std::size_t(panel.first_tick)], *end = first + panel.slots;
            quantity.sorted[p] = std::is_sorted(first, end);
            include(panel.mass, *std::max_element(first, end), low);
        }
        if (quantity.of_end && !density.end_series.empty())
            include(2 * *density.end_series_of(p), quantity.end_reach, low);
        for (int i = panel.first_alarm; quantity.of_alarms && i < panel.end_alarm; ++i) {
            const PreContactAlarm& alarm = density.alarm[std::size_t(i)];
            include(2 * alarm.chance * *density.offset_series_of(p), alarm.reach, low);
        }
    }
}

/// Fills the moments of a quantity that is summarised.
template <class T>
void find_moments(const PiecewiseDensity& density, LinearQuantity& quantity) {
    const bool of_end = quantity.of_end && !density.end_series.empty();
    // About a value near the mean, so that a narrow distribution far from zero keeps its digits.
    double mass = 0, sum = 0;
    for (std::size_t p = 0; p < density.panel.size(); ++p) {
        const PiecewiseDensity::Panel& panel = density.panel[p];
        const double middle = 0.5 * (quantity.low_of(density, p) + quantity.high_of(density, p));
        if (quantity.of_detected && panel.mass > 0) {
            const double* own = &density.mass[panel.first_slot];
            mass += panel.mass;
            sum += std::inner_product(own, own + panel.slots, &quantity.reach[std::size_t(panel.first_tick)],
                                      -panel.mass * middle);
        }
        if (of_end) {
            mass += 2 * *density.end_series_of(p);
            sum += 2 * *density.end_series_of(p) * (quantity.end_reach - middle);
        }
    }
    const double about = mass > 0 ? std::max(0.0, sum / mass) : 0;
    detail::MomentSum<T> moments(density, about);
    for (std::size_t p = 0; p < density.panel.size(); ++p) {
        const PiecewiseDensity::Panel& panel = density.panel[p];
        const double low = quantity.low_of(density, p), high = quantity.high_of(density, p);
        for (int slot = 0; quantity.of_detected && slot < panel.slots; ++slot)
            moments.add(density.series_of(panel, slot), 1.0, quantity.reach[std::size_t(panel.tick(slot))], low, high);
        if (of_end) moments.add(density.end_series_of(p), 1.0, quantity.end_reach, low, high);
        for (int i = panel.first_alarm; quantity.of_alarms && i < panel.end_alarm; ++i) {
            const PreContactAlarm& alarm = density.alarm[std::size_t(i)];
            moments.add(density.offset_series_of(p), alarm.chance, alarm.reach, low, high);
        }
    }
    const double off = moments.first / quantity.total;
    quantity.moments = {quantity.scale * (about + off),
                        quantity.scale * std::sqrt(std::max(0.0, moments.second / quantity.total - off * off))};
    quantity.has_moments = true;
}

/// P(quantity > y) for y >= 0.
template <class T>
TailAt tail(const PiecewiseDensity& density, const LinearQuantity& quantity, double y) {
    const double depth = y / quantity.scale;
    if (!(depth < quantity.max_reach)) return {0, 0};
    allow_interruption();
    const TailAt sum = detail::TailSum<T>(density, quantity, depth)();
    return {std::max(0.0, sum.probability), std::max(0.0, sum.density) / quantity.scale};
}

/// Moments of a mixture of two distributions, by their probabilities.
inline Moments mixture(double one_mass, const Moments& one, double two_mass, const Moments& two) {
    if (!(two_mass > 0)) return one;
    if (!(one_mass > 0)) return two;
    const double weight = two_mass / (one_mass + two_mass), apart = two.mean - one.mean;
    return {one.mean + weight * apart, std::sqrt((1 - weight) * one.sd * one.sd + weight * two.sd * two.sd +
                                                 weight * (1 - weight) * apart * apart)};
}

/// z with P(Z > z) = p for a standard normal Z.
inline double normal_score(double p) {
    p = std::clamp(p, 1e-300, 1 - 1e-16);
    return p <= 0.5 ? normal_upper_quantile(p) : -normal_upper_quantile(1 - p);
}
inline double normal_density(double z) { return std::exp(-0.5 * z * z) / std::sqrt(2 * std::numbers::pi); }

/// The smallest y with P(quantity > y) <= allowed, to 1e-13 of the largest value. `never` is probability that counts as
/// beyond every y. Infinite where `never` alone is too much.
template <class T>
double upper_quantile(const PiecewiseDensity& density, const LinearQuantity& quantity, double allowed, double never) {
    if (never > allowed) return std::numeric_limits<double>::infinity();
    const double target = allowed - never;
    if (!(target < quantity.total)) return 0;
    const double score = normal_score(target / quantity.total);
    // Below zero while it is not known that the quantile is positive.
    double low = -1, high = std::max(0.0, quantity.scale * quantity.max_reach);
    const double resolution = 1e-13 * high, short_step = std::max(resolution, quantity.last_step * quantity.moments.sd);
    double y = quantity.moments.mean + quantity.moments.sd * score;
    if (!(y > 0 && y < high)) y = 0.5 * high;
    // Newton's method for the normal score of the tail, which grows nearly linearly; bisection where a step would leave
    // the bracket, and every fourth time: far from the quantile the steps may be as short as they like.
    for (int iteration = 0; iteration < 200 && high - low > resolution; ++iteration) {
        const TailAt at = tail<T>(density, quantity, y);
        const double excess = at.probability - target;
        (excess > 0 ? low : high) = y;
        if (high == 0) return 0;
        double next = low < 0 ? 0 : 0.5 * (low + high);
        if (at.density > 0 && y > 0) {
            const double here = normal_score(at.probability / quantity.total);
            const double newton = y + (score - here) * normal_density(here) * quantity.total / at.density;
            // Where the tail falls in steps, a short step of the value may be a large one of the probability.
            if (std::fabs(excess) <= std::min(short_step * at.density, 1e-5 * target)) return std::max(0.0, newton);
            if (newton > std::max(low, 0.0) && newton < high && iteration % 4 != 3) next = newton;
        }
        y = next;
    }
    return y;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
