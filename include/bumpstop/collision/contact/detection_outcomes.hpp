/// @file
/// Outcomes of the detections of collisions at the nodes of a panel: few are simulated, the others interpolated.
#pragma once

#include "bumpstop/collision/contact/contact_collision.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What follows a detection depends on the time since the touch, and hardly on the tick: over all slots and nodes
/// together an outcome is a smooth function of that time, but for kinks where a later peak becomes the greatest. A range
/// of detections is interpolated from five of them where two more agree; else it is halved.
class DetectionOutcomes {
  public:
    static constexpr std::size_t quantities = 3;  ///< of an outcome: peak, lasting force, duration
    /// At the slot-th tick in contact of one of the collisions.
    struct Detection {
        std::size_t slot, node;
        double time;  ///< since the touch, but for a constant [ticks]
    };

    /// `chance`: probability of a detection by slot. `share`: allowed error of a certain outcome by quantity, as a share
    /// of the greatest; infinite: it is not needed. `negligible`: a range that is less probable takes the outcomes
    /// of its ends. `widest`: no range that is interpolated is wider [ticks].
    DetectionOutcomes(const std::vector<double>& chance, const double* share, double negligible, double widest)
        : chance_(chance), share_(share), negligible_(negligible), widest_(widest) {}

    /// Calls set(detection, outcome) for all detections from the first slot to the last that have a probability.
    /// `touch`: when each collision begins, but for a constant [ticks].
    template <class Set>
    void operator()(std::vector<ContactCollision>& collisions, const std::vector<double>& touch, Set set) {
        std::size_t first = 0, end = chance_.size();
        while (first < end && !(chance_[first] > 0)) ++first;
        while (end > first && !(chance_[end - 1] > 0)) --end;
        if (first == end) return;
        collisions_ = &collisions;
        for (std::size_t slot = first; slot < end; ++slot)
            for (std::size_t node = 0; node < collisions.size(); ++node)
                detection_.push_back({slot, node, double(slot) - touch[node]});
        std::stable_sort(detection_.begin(), detection_.end(),
                         [](const Detection& a, const Detection& b) { return a.time < b.time; });
        outcome_.resize(detection_.size());
        known_.resize(detection_.size());
        const std::size_t last = detection_.size() - 1;
        simulate(0);
        simulate(last);
        // Halves of a whole number of widest ranges are as wide as they may be.
        const double ranges = std::ceil((detection_[last].time - detection_[0].time) / widest_);
        const std::size_t parts = std::isfinite(ranges) ? std::clamp(std::size_t(ranges), std::size_t(1), last) : 1;
        for (std::size_t part = 0; part < parts; ++part) {
            const std::size_t low = last * part / parts, high = last * (part + 1) / parts;
            simulate(high);
            find_between(low, high);
        }
        for (std::size_t i = 0; i <= last; ++i) set(detection_[i], outcome_[i]);
    }

  private:
    static constexpr std::size_t nodes = 5, fewest = 12;  ///< of a range that is interpolated
    /// The rest of the allowed error is for interpolation from tick to tick.
    static constexpr double error_part = 0.3;
    /// A range less probable than this is as exact as one of this probability, for the sake of rare forces.
    static constexpr double least_chance = 0.1;
    using Values = std::array<double, quantities>;
    using Nodes = std::array<std::size_t, nodes>;

    void simulate(std::size_t i) {
        if (known_[i]) return;
        const auto outcome = (*collisions_)[detection_[i].node].detected(int(detection_[i].slot));
        outcome_[i] = {outcome.peak, outcome.lasting, outcome.duration};
        known_[i] = true;
        for (std::size_t q = 0; q < quantities; ++q)
            if (std::isfinite(outcome_[i][q])) greatest_[q] = std::max(greatest_[q], outcome_[i][q]);
    }

    /// Finds the outcomes between two detections that are simulated.
    void find_between(std::size_t low, std::size_t high) {
        if (high - low < fewest) {
            for (std::size_t i = low + 1; i < high; ++i) simulate(i);
            return;
        }
        const double chance = chance_of(low, high);
        if (chance <= negligible_) {
            for (std::size_t i = low + 1; i < high; ++i) outcome_[i] = outcome_[i - low < high - i ? low : high];
            return;
        }
        Nodes at;
        for (std::size_t m = 0; m < nodes; ++m) at[m] = low + (high - low) * m / (nodes - 1);
        if (detection_[high].time - detection_[low].time <= widest_ && smooth(at, chance)) {
            for (std::size_t i = low + 1; i < high; ++i)
                if (!known_[i]) outcome_[i] = interpolated(at, i);
            return;
        }
        simulate(at[2]);
        find_between(low, at[2]);
        find_between(at[2], high);
    }
    /// Of the slots of some detections.
    double chance_of(std::size_t low, std::size_t high) const {
        const auto begin = detection_.begin() + std::ptrdiff_t(low),
                   end = detection_.begin() + std::ptrdiff_t(high) + 1;
        const auto [first, last] =
            std::minmax_element(begin, end, [](const Detection& a, const Detection& b) { return a.slot < b.slot; });
        return std::accumulate(chance_.begin() + std::ptrdiff_t(first->slot),
                               chance_.begin() + std::ptrdiff_t(last->slot) + 1, 0.0);
    }
    /// Whether outcomes interpolated from those at the nodes agree with two more.
    bool smooth(const Nodes& at, double chance) {
        for (std::size_t i : at) simulate(i);
        for (std::size_t i : {(at[0] + at[1]) / 2, (at[3] + at[4]) / 2}) {
            simulate(i);
            const Values mixed = interpolated(at, i);
            for (std::size_t q = 0; q < quantities; ++q) {
                if (std::isinf(share_[q]) || mixed[q] == outcome_[i][q]) continue;
                const double error = std::fabs(mixed[q] - outcome_[i][q]) * std::max(chance, least_chance);
                if (!(error <= error_part * share_[q] * greatest_[q])) return false;
            }
        }
        return true;
    }
    /// By the polynomial through the outcomes at the nodes; infinite where one of them is.
    Values interpolated(const Nodes& at, std::size_t i) const {
        Values sum{};
        for (std::size_t m : at) {
            double weight = 1;
            for (std::size_t j : at)
                if (j != m)
                    weight *= (detection_[i].time - detection_[j].time) / (detection_[m].time - detection_[j].time);
            for (std::size_t q = 0; q < quantities; ++q) sum[q] += weight * outcome_[m][q];
        }
        for (double& value : sum)
            if (!std::isfinite(value)) value = HUGE_VAL;
        return sum;
    }

    const std::vector<double>& chance_;
    const double* share_;
    double negligible_, widest_;
    std::vector<ContactCollision>* collisions_ = nullptr;
    std::vector<Detection> detection_;  ///< by time
    std::vector<Values> outcome_;       ///< by detection
    std::vector<bool> known_;           ///< by detection: simulated
    Values greatest_{};                 ///< finite ones
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
