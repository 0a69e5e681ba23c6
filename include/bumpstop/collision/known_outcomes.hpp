/// @file
/// Outcomes known at some panels, and how those of every panel follow from them.
#pragma once

#include "bumpstop/collision/free_law.hpp"
#include "bumpstop/collision/panel_cutter.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Interpolated detection probabilities may be wrong by this much; rounding of the joint positions alone gives
/// 1e-12.
inline constexpr double outcome_tolerance = 1e-10;
/// Interpolated quantities of free contact, times the probability of meeting them, as shares of the greatest: the arm's
/// path is straight within a simulation step, which leaves kinks of this size.
inline constexpr double free_force_tolerance = 1e-5, free_duration_tolerance = 5e-5;

/// While the arm moves steadily the panels differ only by the slow change of the Jacobian, so what happens at a given node
/// and slot is smooth in the tick: a few panels of every part are worked out and the others interpolated.
template <class T>
class KnownOutcomes {
  public:
    struct Found {
        Outcomes outcomes;
        FreeNodes free;  // of free contact
    };

    /// `find(list)` works out panels; the first parts * regular of them are `regular` alike ones part by part.
    template <class Find>
    KnownOutcomes(const std::vector<Panel>& panels, int parts, int regular, int order, Find find)
        : parts_(parts), regular_(regular), order_(order) {
        for (int nodes : {fewest_nodes, 12, most_nodes}) {
            if (regular < 2 * nodes) break;
            const Interpolation interpolation(interpolation_nodes(0, regular - 1, nodes));
            const std::vector<int>& node = interpolation.nodes();
            const int check[check_count] = {(node[0] + node[1]) / 2, (node[nodes / 2] + node[nodes / 2 - 1]) / 2};
            std::vector<Panel> sample;
            for (int part = 0; part < parts; ++part) {
                for (int k : node) sample.push_back(panels[std::size_t(part * regular + k)]);
                for (int k : check) sample.push_back(panels[std::size_t(part * regular + k)]);
            }
            irregular_ = int(sample.size());
            sample.insert(sample.end(), panels.begin() + std::ptrdiff_t(parts) * regular, panels.end());
            found_ = find(sample);
            stride_ = nodes + check_count;
            if (!agrees(interpolation, check)) continue;
            nodes_ = nodes;
            weight_.resize(std::size_t(nodes) * regular);
            double at[most_nodes];
            for (int k = 0; k < regular; ++k) {
                interpolation.weights(k, at);
                for (int m = 0; m < nodes; ++m) weight_[std::size_t(m) * regular + k] = at[m];
            }
            return;
        }
        found_ = find(panels);
    }

    const Outcomes& outcomes() const { return found_.outcomes; }
    const FreeNodes& free() const { return found_.free; }
    bool interpolated() const { return nodes_ > 0; }

    /// Writes the values of all `total` panels at one node from those of the known ones.
    void spread(const double* from, int total, double* to) const {
        if (nodes_ == 0) {
            std::copy(from, from + total, to);
            return;
        }
        const int count = regular_;
        for (int part = 0; part < parts_; ++part) {
            T value[most_nodes];
            for (int m = 0; m < nodes_; ++m) value[m] = from[part * stride_ + m];
            double* run = to + std::size_t(part) * count;
            int k = 0;
            for (; k + lanes <= count; k += lanes) {
                T sum = load<T>(&weight_[k]) * value[0];
                for (int m = 1; m < nodes_; ++m) sum += load<T>(&weight_[std::size_t(m) * count + k]) * value[m];
                store(sum, run + k);
            }
            for (; k < count; ++k) {
                run[k] = 0;
                for (int m = 0; m < nodes_; ++m)
                    run[k] += weight_[std::size_t(m) * count + k] * from[part * stride_ + m];
            }
        }
        std::copy(from + irregular_, from + irregular_ + (total - parts_ * count), to + parts_ * count);
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;
    static constexpr int fewest_nodes = fewest_known_panels, most_nodes = 20, check_count = 2;

    /// Do interpolated and direct outcomes agree at the check panels?
    bool agrees(const Interpolation& interpolation, const int* check) const {
        const Outcomes& known = found_.outcomes;
        const bool free = found_.free.panels > 0;
        double weight[most_nodes];
        const int nodes = interpolation.size();
        for (int c = 0; c < check_count; ++c) {
            interpolation.weights(check[c], weight);
            for (int part = 0; part < parts_; ++part) {
                allow_interruption();
                for (int g = 0; g < order_; ++g) {
                    const std::size_t row = std::size_t(g) * known.panels + std::size_t(part) * stride_;
                    auto error = [&](const double* value) {
                        double sum = 0;
                        for (int m = 0; m < nodes; ++m) sum += weight[m] * value[row + m];
                        return std::fabs(sum - value[row + nodes + c]);
                    };
                    // Where the motion's end decides what goes unnoticed, nothing is smooth.
                    for (int m = 0; m < nodes && !free; ++m) {
                        if (known.survived[row + m] > negligible_survival) return false;
                    }
                    if (free && error(known.survived.data()) > outcome_tolerance) return false;
                    for (const std::vector<double>& slot : known.detected) {
                        if (error(slot.data()) > outcome_tolerance) return false;
                    }
                    if (free && !free_agrees(error, row + nodes + c)) return false;
                }
            }
        }
        return true;
    }

    template <class Error>
    bool free_agrees(Error error, std::size_t place) const {
        const Outcomes& known = found_.outcomes;
        const std::size_t block = known.survived.size();
        const std::pair<std::vector<double> FreeNodes::*, double> quantities[] = {
            {&FreeNodes::peak_force, free_force_tolerance}, {&FreeNodes::duration, free_duration_tolerance}};
        for (const auto& [quantity, tolerance] : quantities) {
            const std::vector<double>& values = found_.free.*quantity;
            const double most = *std::max_element(values.begin(), values.end());
            for (std::size_t slot = 0; slot * block < values.size(); ++slot) {
                const double chance =
                    slot < known.detected.size() ? known.detected[slot][place] : known.survived[place];
                if (error(&values[slot * block]) * chance > tolerance * most) return false;
            }
        }
        return true;
    }

    int parts_, regular_, order_;
    Found found_;
    int nodes_ = 0;               // of the interpolation; 0: every panel is known
    int stride_ = 0;              // known panels of a part: the nodes and the checks
    int irregular_ = 0;           // the first known panel that stands for itself
    std::vector<double> weight_;  // [node][regular panel]
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
