/// @file
/// The overtravels of a range of ticks, from reactions on a grid that is refined where interpolation fails.
#pragma once

#include "bumpstop/collision/motion/overtravel_tolerance.hpp"
#include "bumpstop/collision/motion/peak_fit.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// Ticks of one curve whose overtravels are found together.
struct TickRange {
    int curve, first, last;
    bool contains_switch = false;  ///< every tick is simulated
    std::size_t job = 0;           ///< index of the first of its jobs

    int ticks() const { return last - first + 1; }
};

/// A range that is too rough for one polynomial. Ticks on a grid are simulated, and the spacing is halved wherever the
/// middle of two grid points differs from what the six nearest points predict. Every simulated tick is used.
class AdaptiveTickGrid {
  public:
    AdaptiveTickGrid(const TickRange& range, const OvertravelTolerance& tolerance)
        : curve(range.curve), tolerance_(tolerance), first_(range.first), last_(range.last) {
        tick_.resize(std::size_t(range.ticks()));
        while (2 * spacing_ < range.ticks() / 5 && spacing_ < 64) spacing_ *= 2;
        for (int k = first_; k < last_; k += spacing_) intervals_.push_back(k);
        requested = intervals_;
        requested.push_back(last_);
    }

    int curve;
    std::vector<int> requested;  ///< ticks to simulate before the next `take`
    std::size_t job = 0;         ///< index of the first of their jobs

    int first() const { return first_; }
    int last() const { return last_; }
    double overtravel_at(int k) const { return tick_[std::size_t(k - first_)].overtravel; }

    /// Takes the results of the requested ticks, accepts accurate intervals and requests the next ticks.
    void take(const ReactionJob* jobs) {
        std::vector<int> unsettled = std::exchange(too_short_, {});
        for (std::size_t i = 0; i < requested.size(); ++i) {
            const int k = requested[i];
            // Predicted from the other ticks: k itself is not known yet.
            at(k) = {peak_fit(jobs[i]), -1, jobs[i].rebounded};
            const double from_peaks = middles_ ? interpolate(k, 2 * spacing_) : -1;
            const bool smooth = from_peaks >= 0;
            const double predicted = smooth ? from_peaks : middles_ ? interpolate_linear(k) : 0;
            at(k).overtravel = overtravel(jobs[i].distance);
            if (!middles_) continue;
            const double difference = predicted - at(k).overtravel;
            const int low = k - spacing_, high = std::min(k + spacing_, last_);
            // Small differences decide whether a reaction rebounds: interpolation is ill-conditioned there.
            const bool ill_conditioned = at(low).rebounded || at(k).rebounded || at(high).rebounded;
            // At half the spacing the error is smaller by 2^6, and by 2^2 where the interpolation is linear.
            if (!(ill_conditioned && tolerance_.matters(low, high)) &&
                (smooth || spacing_ <= tolerance_.max_linear()) &&
                std::fabs(difference) <= (smooth ? 8 : 1) * tolerance_.of(low, high) && accept(low, high, smooth))
                continue;
            unsettled.push_back(k - spacing_);
            unsettled.push_back(k);
        }
        if (!middles_) unsettled = intervals_;
        middles_ = true;
        requested.clear();
        while (spacing_ > 1 && requested.empty() && !unsettled.empty()) {
            spacing_ /= 2;
            for (int k : unsettled) {
                if (k + spacing_ < last_) {
                    requested.push_back(k + spacing_);
                } else {
                    too_short_.push_back(k);
                }
            }
            if (requested.empty()) unsettled = std::exchange(too_short_, {});
        }
    }

    /// Interpolates the accepted ticks, once all requested ones are known.
    void finish() {
        std::vector<double> filled;
        for (const auto& [k, spacing] : accepted_) {
            const double from_peaks = interpolate(k, spacing);
            filled.push_back(from_peaks >= 0 ? from_peaks : interpolate_linear(k));
        }
        for (std::size_t i = 0; i < filled.size(); ++i) at(accepted_[i].first).overtravel = filled[i];
    }

  private:
    static constexpr int max_points = 6;

    struct Tick {
        PeakFit peak{};
        double overtravel = -1;  ///< negative: not known
        bool rebounded = false;

        bool known() const { return overtravel >= 0; }
        bool has_peak() const { return peak.time >= 0; }
    };

    Tick& at(int k) { return tick_[std::size_t(k - first_)]; }
    const Tick& at(int k) const { return tick_[std::size_t(k - first_)]; }

    /// The overtravel at k from the peaks of the six nearest known ticks on this spacing's grid; negative: there is
    /// none.
    double interpolate(int k, int spacing) const {
        // Beyond the ticks with a peak the points on one side would have to be extrapolated.
        if (!at(neighbour(k, -1)).has_peak() || !at(neighbour(k, 1)).has_peak()) return -1;
        std::vector<int> ticks;
        const int base = first_ + (k - first_) / spacing * spacing;
        for (int reach = 0; reach < max_points && int(ticks.size()) < max_points; ++reach) {
            for (int near : {base - reach * spacing, base + (reach + 1) * spacing}) {
                if (near < first_ || near > last_ || near == k || int(ticks.size()) == max_points) continue;
                if (at(near).known() && at(near).has_peak()) ticks.push_back(near);
            }
        }
        if (ticks.size() < 4) return -1;
        std::sort(ticks.begin(), ticks.end());
        std::vector<PeakFit> peaks;
        for (int tick : ticks) peaks.push_back(at(tick).peak);
        return OvertravelInterpolation(std::move(ticks), std::move(peaks)).at(double(k));
    }

    /// The overtravel at tick k on the straight line between its known neighbours. It serves where a reaction retreats
    /// from its first step on, so that there is no peak to interpolate.
    double interpolate_linear(int k) const {
        const int low = neighbour(k, -1), high = neighbour(k, 1);
        const double left = overtravel_at(low), right = overtravel_at(high);
        return left + (right - left) * (k - low) / (high - low);
    }
    /// The nearest tick whose overtravel is known, in steps of 1 or -1.
    int neighbour(int k, int step) const {
        do k += step;
        while (!at(k).known());
        return k;
    }

    /// Leaves the ticks between two points to interpolation, where the same kind is possible at all of them.
    bool accept(int low, int high, bool smooth) {
        for (int k = low + 1; smooth && k < high; ++k)
            if (!at(k).known() && interpolate(k, spacing_) < 0) return false;
        for (int k = low + 1; k < high; ++k)
            if (!at(k).known()) accepted_.push_back({k, spacing_});
        return true;
    }

    OvertravelTolerance tolerance_;
    int first_, last_, spacing_ = 1;
    bool middles_ = false;  ///< the requested ticks are middles of intervals; in the first round they are the grid
    std::vector<int> intervals_;
    std::vector<int> too_short_;  ///< last intervals that have no middle at this spacing yet, by their first tick
    std::vector<Tick> tick_;
    std::vector<std::pair<int, int>> accepted_;  ///< ticks to interpolate, with the spacing of the grid around them
};

}  // namespace detail

}  // namespace bumpstop::inline BUMPSTOP_TARGET
