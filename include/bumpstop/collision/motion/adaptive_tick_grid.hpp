/// @file
/// The overtravels of a range of ticks, from reactions on a grid that is refined where interpolation fails, and how
/// accurate they must be.
#pragma once

#include "bumpstop/collision/motion/peak_fit.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Largest error of interpolated overtravels at the ticks that are checked [m]. A force distribution needs 1e-9 m.
inline constexpr double min_overtravel_tolerance = 5e-10;
/// With an upper bound of the detection probability at a tick, the tolerance is this divided by that bound, clamped to
/// the least and the greatest tolerance [m]. `make validate` (batches) shows the accuracy of distributions with it.
inline constexpr double negligible_overtravel = 1e-10;
inline constexpr double max_overtravel_tolerance = 1e-3;
/// Ticks near a switching point are all simulated, unless they are less probable than this.
inline constexpr double switch_probability = 1e-5;

/// A reaction to a tick less probable than this ends with its first retreat, even where the arm might swing forward
/// again. A path has some 1000 ticks, so together they change an exceedance probability by 1e-5 at most.
inline constexpr double negligible_detection_probability = 1e-8;

/// Near a singularity the error of an Adams step grows by orders of magnitude, and with a wide tolerance the arm's
/// swing forward may be missed. So reactions to ticks more probable than this are simulated again with a narrow one.
inline constexpr double singular_probability = 1e-5;

/// How accurately the overtravel of every tick must be known. Without probabilities all ticks count equally.
struct OvertravelTolerance {
    const double* probability = nullptr;  ///< upper bounds of the detection probability, by tick

    /// Tolerance of the ticks from `first` to `last` [m].
    double of(int first, int last) const {
        if (probability == nullptr) return min_overtravel_tolerance;
        const double most = *std::max_element(probability + first, probability + last + 1);
        return std::clamp(negligible_overtravel / most, min_overtravel_tolerance, max_overtravel_tolerance);
    }
    /// Tolerance of the Adams steps of a simulated reaction.
    double of_reaction(int tick) const {
        return probability == nullptr ? exact_tolerance
                                      : std::clamp(300 * of(tick, tick), batch_tolerance, max_batch_tolerance);
    }
    /// Whether an arm that may swing forward again near a singularity is followed until it no longer can.
    bool follows(int tick) const {
        return probability == nullptr || probability[tick] > negligible_detection_probability;
    }
    /// Whether a reaction that met a singularity is simulated again. Those to ticks before tick 0 always are.
    bool refines_near_singular(int tick) const {
        return probability == nullptr || tick < 0 || probability[tick] > singular_probability;
    }
    /// Largest distance of ticks between which overtravels without a peak are interpolated linearly.
    int max_linear() const { return probability == nullptr ? 0 : 8; }
    /// Whether a detection from tick `first` to `last` is likely enough to matter near a switching point.
    bool matters(int first, int last) const {
        return probability == nullptr ||
               *std::max_element(probability + first, probability + last + 1) > switch_probability;
    }
};

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
            const double by_peaks = middles_ ? from_peaks({k, k, 2 * spacing_})[0] : -1;
            const bool smooth = by_peaks >= 0;
            const double predicted = smooth ? by_peaks : middles_ ? interpolate_linear(k) : 0;
            at(k).overtravel = overtravel(jobs[i].distance);
            if (!middles_) continue;
            const double difference = predicted - at(k).overtravel;
            const int low = k - spacing_, high = std::min(k + spacing_, last_);
            // Small differences decide whether a reaction rebounds: interpolation is ill-conditioned there.
            const bool ill_conditioned = at(low).rebounded || at(k).rebounded || at(high).rebounded;
            // At half the spacing the error is smaller by 2^6, and by 2^2 where the interpolation is linear.
            if (!(ill_conditioned && tolerance_.matters(low, high)) &&
                (smooth || spacing_ <= tolerance_.max_linear()) &&
                std::fabs(difference) <= (smooth ? 8 : 1) * tolerance_.of(low, high) &&
                accept({low + 1, k - 1, spacing_}, {k + 1, high - 1, spacing_}, smooth))
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
        std::vector<std::vector<double>> filled;
        for (const Gap& gap : accepted_) {
            filled.push_back(from_peaks(gap));
            for (int k = gap.first; k <= gap.last; ++k)
                if (double& here = filled.back()[std::size_t(k - gap.first)]; here < 0) here = interpolate_linear(k);
        }
        for (std::size_t i = 0; i < filled.size(); ++i)
            for (std::size_t j = 0; j < filled[i].size(); ++j)
                at(accepted_[i].first + int(j)).overtravel = filled[i][j];
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
    /// Ticks between two known ones that lie next to each other on the grid with a spacing.
    struct Gap {
        int first, last, spacing;
    };

    Tick& at(int k) { return tick_[std::size_t(k - first_)]; }
    const Tick& at(int k) const { return tick_[std::size_t(k - first_)]; }

    /// The overtravels in a gap, or a part of it, from the peaks of the six nearest known ticks on its grid; negative
    /// where there is none.
    std::vector<double> from_peaks(const Gap& gap) const {
        const std::vector<double> none(std::size_t(gap.last - gap.first) + 1, -1.0);
        // Beyond the ticks with a peak the points on one side would have to be extrapolated.
        if (!at(neighbour(gap.first, -1)).has_peak() || !at(neighbour(gap.last, 1)).has_peak()) return none;
        std::vector<int> ticks;
        const int base = first_ + (gap.first - first_) / gap.spacing * gap.spacing;
        for (int reach = 0; reach < max_points && int(ticks.size()) < max_points; ++reach) {
            for (int near : {base - reach * gap.spacing, base + (reach + 1) * gap.spacing}) {
                if (near < first_ || near > last_ || int(ticks.size()) == max_points) continue;
                if (at(near).known() && at(near).has_peak()) ticks.push_back(near);
            }
        }
        if (ticks.size() < 4) return none;
        std::sort(ticks.begin(), ticks.end());
        std::vector<PeakFit> peaks;
        for (int tick : ticks) peaks.push_back(at(tick).peak);
        return OvertravelInterpolation(std::move(ticks), std::move(peaks))
            .between<Lanes<native_lanes>>(gap.first, gap.last);
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

    /// Leaves the ticks of two gaps to interpolation, where the same kind is possible at all of them.
    bool accept(const Gap& before, const Gap& after, bool smooth) {
        std::vector<Gap> gaps;
        for (const Gap& gap : {before, after})
            if (gap.first <= gap.last) gaps.push_back(gap);
        for (const Gap& gap : gaps)
            for (double travel : smooth ? from_peaks(gap) : std::vector<double>())
                if (travel < 0) return false;
        accepted_.insert(accepted_.end(), gaps.begin(), gaps.end());
        return true;
    }

    OvertravelTolerance tolerance_;
    int first_, last_, spacing_ = 1;
    bool middles_ = false;  ///< the requested ticks are middles of intervals; in the first round they are the grid
    std::vector<int> intervals_;
    std::vector<int> too_short_;  ///< last intervals that have no middle at this spacing yet, by their first tick
    std::vector<Tick> tick_;
    std::vector<Gap> accepted_;  ///< to interpolate
};

}  // namespace detail

}  // namespace bumpstop::inline BUMPSTOP_TARGET
