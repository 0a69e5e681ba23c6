/// @file
/// Distributions as mixtures of many small cells, for dynamic contact.
#pragma once

#include "bumpstop/collision/distribution/collision_distribution.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// A mixture of uniform distributions over cells, some of which are points, with the moments of the nodes of a
/// quadrature. Nothing is sorted: a tail is a sum over all cells, in lanes.
class CellMixture {
  public:
    CellMixture() = default;

    void add_cell(double one_end, double other_end, double mass) {
        make_room(1);
        if (!(mass > 0)) return;
        const double low = std::min(one_end, other_end), high = std::max(one_end, other_end);
        if (std::isinf(high)) {
            infinite_ += mass;
        } else {
            low_.push_back(low);
            high_.push_back(high);
            mass_.push_back(mass);
            max_ = std::max(max_, high);
            min_ = std::min(min_, low);
        }
        total_ += mass;
    }
    /// Adds adjacent cells between `count` + 1 finite edges.
    void add_cells(const double* edge, const double* mass, std::size_t count) {
        make_room(count);
        const std::size_t first = mass_.size();
        for (std::vector<double>* values : {&low_, &high_, &mass_}) values->resize(first + count);
        for (std::size_t i = 0; i < count; ++i) {
            const double low = std::min(edge[i], edge[i + 1]), high = std::max(edge[i], edge[i + 1]);
            const double here = std::max(mass[i], 0.0);
            low_[first + i] = low;
            high_[first + i] = high;
            mass_[first + i] = here;
            max_ = std::max(max_, here > 0 ? high : max_);
            min_ = std::min(min_, here > 0 ? low : min_);
            total_ += here;
        }
    }
    void add_node(double value, double mass) {
        // Moments about a value that occurs lose no digits.
        if (node_mass_ == 0 && std::isfinite(value)) about_ = value;
        node_mass_ += mass;
        node_sum_ += mass * (value - about_);
        node_square_ += mass * (value - about_) * (value - about_);
    }

    /// Probability of all cells, and of those at infinity.
    double total() const { return total_; }
    double infinite() const { return infinite_; }

    Moments moments() const {
        const double mean = node_sum_ / node_mass_;
        if (!std::isfinite(mean)) return {about_ + mean, NAN};
        return {about_ + mean, std::sqrt(std::max(0.0, node_square_ / node_mass_ - mean * mean))};
    }

    /// P(value > x).
    template <class T>
    double above(double x) const {
        constexpr int lanes = Scalar<T>::lanes;
        T sum = 0.0;
        std::size_t i = 0;
        for (; i + lanes <= mass_.size(); i += lanes)
            sum += beyond(load<T>(&low_[i]), load<T>(&high_[i]), load<T>(&mass_[i]), x);
        double rest = 0;
        for (; i < mass_.size(); ++i) rest += beyond(low_[i], high_[i], mass_[i], x);
        return infinite_ + sum_of_lanes(sum) + rest;
    }

    /// The smallest x with P(value > x) <= allowed; infinite where more than that is beyond every value.
    template <class T>
    double upper_quantile(double allowed) const {
        if (infinite_ > allowed) return HUGE_VAL;
        double low = std::min(0.0, min_), high = std::max(max_, 0.0);
        if (!(above<T>(low) > allowed)) return min_above(low);
        CellMixture near;
        const CellMixture* of = this;
        // Bisection, because a tail has jumps at which secants hardly converge.
        for (int i = 1; i <= 200 && high - low > 1e-14 * high; ++i) {
            const double x = 0.5 * (low + high);
            (of->above<T>(x) > allowed ? low : high) = x;
            // A copy of nearly all cells would save no time and double the memory.
            if (i % 8 == 0 && 4 * of->count_between(low, high) <= of->mass_.size()) {
                near = of->between(low, high);
                of = &near;
            }
        }
        return high;
    }

  private:
    static constexpr std::size_t most_cells = 1 << 18, bins = 1 << 16;

    /// Very soft bodies have millions of cells. Once there are too many a histogram takes the place of all that are
    /// not points: at the ends of its bins P(value > x) stays what it is.
    void make_room(std::size_t count) {
        if (mass_.size() + count <= room_) return;
        const double width = (max_ - min_) / double(bins);
        std::vector<double> in_bin(bins, 0.0);
        std::size_t points = 0;
        for (std::size_t i = 0; i < mass_.size(); ++i) {
            if (!(mass_[i] > 0)) continue;  // it may lie below all others
            const double from = (low_[i] - min_) / width, to = (high_[i] - min_) / width;
            if (!(from < to)) {
                low_[points] = low_[i];
                high_[points] = high_[i];
                mass_[points++] = mass_[i];
                continue;
            }
            const std::size_t first = std::min(std::size_t(from), bins - 1), end = std::min(std::size_t(to) + 1, bins);
            for (std::size_t bin = first; bin < end; ++bin)
                in_bin[bin] += mass_[i] * (std::min(to, double(bin + 1)) - std::max(from, double(bin))) / (to - from);
        }
        for (std::vector<double>* values : {&low_, &high_, &mass_}) values->resize(points);
        for (std::size_t bin = 0; bin < bins; ++bin) {
            if (!(in_bin[bin] > 0)) continue;
            low_.push_back(min_ + double(bin) * width);
            high_.push_back(min_ + double(bin + 1) * width);
            mass_.push_back(in_bin[bin]);
        }
        room_ = std::max(most_cells, 2 * mass_.size() + count);
    }
    /// Number of cells that overlap `low` to `high`.
    std::size_t count_between(double low, double high) const {
        std::size_t count = 0;
        for (std::size_t i = 0; i < mass_.size(); ++i) count += low_[i] < high && high_[i] > low;
        return count;
    }
    /// A mixture with the same P(value > x) for x from `low` to `high`: without cells below, those above at infinity.
    CellMixture between(double low, double high) const {
        CellMixture out;
        const std::size_t count = count_between(low, high);
        double beyond_all = 0;
        for (std::size_t i = 0; i < mass_.size(); ++i) beyond_all += low_[i] >= high ? mass_[i] : 0.0;
        out.infinite_ = infinite_ + beyond_all;
        for (std::vector<double>* values : {&out.low_, &out.high_, &out.mass_}) values->reserve(count);
        for (std::size_t i = 0; i < mass_.size(); ++i) {
            if (!(low_[i] < high && high_[i] > low)) continue;
            out.low_.push_back(low_[i]);
            out.high_.push_back(high_[i]);
            out.mass_.push_back(mass_[i]);
        }
        return out;
    }
    /// The smallest value, or `low` where there is none.
    double min_above(double low) const { return mass_.empty() ? low : std::max(low, std::min(min_, max_)); }

    template <class V>
    static V beyond(V low, V high, V mass, double x) {
        // A cell that is a point lies beyond x as a whole or not at all.
        const V width = max(high - low, V(1e-300));
        return mass * min(max((high - V(x)) / width, V(0.0)), V(1.0));
    }

    std::vector<double> low_, high_, mass_;
    double total_ = 0, infinite_ = 0, max_ = 0, min_ = HUGE_VAL;
    double about_ = 0, node_mass_ = 0, node_sum_ = 0, node_square_ = 0;  ///< sums of the nodes, about a value
    std::size_t room_ = most_cells;                                      ///< of cells, before they become a histogram
};

/// Quantities of dynamic contact.
enum class ContactQuantity { peak_force, duration, force_at_detection };

/// Weights of a force in the transient phase and after it; the greater weighted force counts.
struct PhaseShares {
    double transient = 1, lasting = 1;  ///< `lasting` is not less [1/N]
};

/// Distribution of a quantity: of the peak force over all collisions, with zero where there is no contact; of the
/// duration over contacts; of the force at detection over detections in contact. `never`: value of undetected
/// collisions, if not that at the end of the motion. `phases`: not the peak force, but the greater weighted force.
template <class T>
CellMixture contact_mixture(const CollisionDistribution& collision, ContactQuantity quantity,
                            std::optional<double> never = std::nullopt,
                            std::optional<PhaseShares> phases = std::nullopt) {
    constexpr int lanes = Scalar<T>::lanes;
    const PiecewiseDensity& density = collision.density;
    const std::size_t order = std::size_t(density.order);
    const bool positive = quantity == ContactQuantity::duration,
               kinks = collision.nodes.kinks && quantity != ContactQuantity::force_at_detection;
    // A slot less probable than this is one cell from its smallest value to its greatest.
    constexpr double one_cell = 1e-14;
    // Of a panel. They are narrow because in a far tail the density falls steeply, while that of a cell is constant.
    // The force at detection decides its own probability, which rises steeply with it.
    const std::size_t cells = quantity == ContactQuantity::force_at_detection ? 32 : 16;
    const std::size_t panels = density.panel.size();
    const std::size_t rows =
        (std::max(cells + 1, order) + std::size_t(lanes) - 1) / std::size_t(lanes) * std::size_t(lanes);
    const GaussRule& rule = gauss_rule(int(order));
    // By degree l, the integral of P_l over every cell, and its weighted value at every node; by node, the weight of
    // its value at every end of a cell.
    std::vector<double> below(order * rows, 0.0), to_edge(order * rows, 0.0), at_nodes(order * rows, 0.0);
    const auto legendre = [&](double x, std::vector<double>& value) {
        value.assign(order + 1, 1.0);
        value[1] = x;
        for (std::size_t l = 1; l < order; ++l)
            value[l + 1] = (double(2 * l + 1) * x * value[l] - double(l) * value[l - 1]) / double(l + 1);
    };
    std::vector<double> left, right;
    for (std::size_t i = 0; i <= cells; ++i) {
        const double x = 2.0 * double(i) / double(cells) - 1;
        legendre(x, right);
        for (std::size_t g = 0; g < order; ++g) {
            double sum = 0;
            for (std::size_t l = 0; l < order; ++l) sum += right[l] * rule.to_legendre(int(l), int(g));
            to_edge[g * rows + i] = sum;
        }
        for (std::size_t l = 0; i > 0 && l < order; ++l) {
            const auto integral = [&](const std::vector<double>& p, double at) {
                return l == 0 ? at : (p[l + 1] - p[l - 1]) / double(2 * l + 1);
            };
            below[l * rows + i - 1] = integral(right, x) - integral(left, x - 2.0 / double(cells));
        }
        std::swap(left, right);
    }
    for (std::size_t g = 0; g < order; ++g)
        for (std::size_t l = 0; l < order; ++l) at_nodes[l * rows + g] = rule.legendre[g * order + l] * rule.weight[g];
    const auto product = [&](const std::vector<double>& matrix, const double* x, auto factor, double* out) {
        for (std::size_t r = 0; r < rows; r += std::size_t(lanes)) {
            T sum = 0.0;
            for (std::size_t l = 0; l < order; ++l) sum += factor(l) * x[l] * load<T>(&matrix[l * rows + r]);
            store(sum, out + r);
        }
    };
    const auto once = [](std::size_t) { return 1.0; };
    const auto series = [](std::size_t l) { return double(2 * l + 1); };
    CellMixture out;
    std::vector<double> mass(rows), edge(rows), node_mass(rows);
    const auto add = [&](const double* coefficient, const double* value) {
        product(below, coefficient, series, mass.data());
        product(to_edge, value, once, edge.data());
        // Where a later peak becomes the greatest the values have a kink, about which the polynomial oscillates.
        // Between nodes no value lies beyond all of theirs.
        const auto [least, most] = std::minmax_element(value, value + order);
        for (std::size_t i = 0; kinks && i <= cells; ++i)
            if (std::fabs(2.0 * double(i) / double(cells) - 1) < rule.node[order - 1])
                edge[i] = std::clamp(edge[i], *least, *most);
        for (std::size_t i = 0; i <= cells; ++i) edge[i] = std::max(edge[i], 0.0);
        if (!positive) out.add_cells(edge.data(), mass.data(), cells);
        for (std::size_t i = 0; positive && i < cells; ++i)
            if (std::max(edge[i], edge[i + 1]) > 0) out.add_cell(edge[i], edge[i + 1], mass[i]);
        product(at_nodes, coefficient, series, node_mass.data());
        for (std::size_t g = 0; g < order; ++g)
            if (!positive || value[g] > 0) out.add_node(value[g], node_mass[g]);
    };
    const ContactNodes& nodes = collision.nodes;
    const auto& by_slot = quantity == ContactQuantity::peak_force ? nodes.peak_force
                          : positive                              ? nodes.duration
                                                                  : nodes.force_at_detection;
    const auto& missed = positive ? nodes.undetected_duration : nodes.undetected_peak_force;
    // The lasting force is at most the peak force, so only its weight can make it count.
    const auto weighted = [&](double value, double lasting) {
        return phases ? std::max(value * phases->transient, lasting * phases->lasting) : value;
    };
    std::vector<double> weighted_values(order);
    // Values at the nodes from `first` on, weighted by phase if asked.
    const auto values_of = [&](const std::vector<double>& values, const std::vector<double>& lasting,
                               std::size_t first) {
        const double* value = &values[first];
        if (!phases) return value;
        for (std::size_t i = 0; i < order; ++i) weighted_values[i] = weighted(value[i], lasting[first + i]);
        return static_cast<const double*>(weighted_values.data());
    };
    const bool of_all = quantity != ContactQuantity::force_at_detection;
    for (std::size_t p = 0; p < panels; ++p) {
        const PiecewiseDensity::Panel& panel = density.panel[p];
        for (int slot = 0; slot < panel.slots && !by_slot.empty(); ++slot) {
            const std::size_t at = panel.first_slot + std::size_t(slot);
            const double* value = values_of(by_slot, nodes.lasting_force, at * order);
            if (density.mass[at] > one_cell) {
                add(density.series_of(panel, slot), value);
            } else {
                const auto [low, high] = std::minmax_element(value, value + order);
                if (!positive || *high > 0) out.add_cell(std::max(*low, 0.0), std::max(*high, 0.0), density.mass[at]);
            }
        }
        if (of_all && !never && !density.end_series.empty() && (p + 1) * order <= missed.size())
            add(density.end_series_of(p), values_of(missed, nodes.undetected_lasting_force, p * order));
    }
    if (!of_all) return out;
    if (never && collision.undetected > 0) {
        out.add_cell(*never, *never, collision.undetected);
        if (std::isfinite(*never) || collision.undetected > Moments::negligible)
            out.add_node(*never, collision.undetected);
    }
    const EarlyReactions& early = collision.early_reactions;
    const auto value_of = [&](const ContactReactions::Outcome& one) {
        return positive ? weighted(one.duration, one.lasting) : weighted(one.peak, one.lasting);
    };
    for (std::size_t i = 0; i < early.pieces(); ++i) {
        for (std::size_t c = i * EarlyReactions::cells; c < (i + 1) * EarlyReactions::cells; ++c) {
            const double low = value_of(early.edge[c + i]), high = value_of(early.edge[c + i + 1]);
            if (!positive || std::max(low, high) > 0) out.add_cell(low, high, early.mass[c]);
        }
        for (std::size_t g = i * EarlyReactions::nodes; g < (i + 1) * EarlyReactions::nodes; ++g)
            if (const double value = value_of(early.node[g]); !positive || value > 0)
                out.add_node(value, early.node_mass[g]);
    }
    if (!positive) {
        out.add_cell(0, 0, collision.zero_force);
        out.add_node(0, collision.zero_force);
    }
    return out;
}

/// The peak force in dynamic contact. `pressed_with`: force on a held body that is never detected [N].
template <class T>
CellMixture peak_force_mixture(const CollisionDistribution& collision, double pressed_with = HUGE_VAL) {
    return contact_mixture<T>(collision, ContactQuantity::peak_force,
                              collision.nodes.pressed ? std::optional(pressed_with) : std::nullopt);
}

template <class T>
double CollisionDistribution::exceedance(double force) const {
    if (!nodes.gives_way) return tail<T>(density, peak_force, force).probability + unbounded();
    const CellMixture mixture = peak_force_mixture<T>(*this);
    return std::min(1.0, mixture.template above<T>(force) / mixture.total());
}
template <class T>
double CollisionDistribution::upper_quantile(double allowed) const {
    if (std::isnan(undetected)) return NAN;
    if (!nodes.gives_way) return bumpstop::upper_quantile<T>(density, peak_force, allowed, unbounded());
    const CellMixture mixture = peak_force_mixture<T>(*this);
    return mixture.template upper_quantile<T>(allowed * mixture.total());
}
template <class T>
Moments CollisionDistribution::moments() const {
    if (std::isnan(undetected)) return {NAN, NAN};
    if (nodes.gives_way) return peak_force_mixture<T>(*this).moments();
    if (unbounded() > Moments::negligible) return {HUGE_VAL, NAN};
    return mixture(peak_force.total, peak_force.moments, zero_force, {0, 0});
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
