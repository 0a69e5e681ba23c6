/// @file
/// The overtravels of a range of ticks, from reactions on a grid that is halved where it must be.
#pragma once

#include "bumpstop/collision/motion/overtravel_tolerance.hpp"
#include "bumpstop/collision/motion/peak_fit.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// Ticks of one curve whose overtravel is found together.
struct TickRange {
    int curve, first, last;
    bool contains_switch = false;  ///< not to be interpolated
    std::size_t job = 0;           ///< the first of its jobs

    int ticks() const { return last - first + 1; }
};

/// A range too rough for one polynomial: ticks simulated on a grid that is halved wherever the middle of two
/// of its points is not where the six nearest points say. Nothing simulated is thrown away.
class AdaptiveTickGrid {
  public:
    AdaptiveTickGrid(const TickRange& range, const OvertravelTolerance& tolerance)
        : curve(range.curve), tolerance_(tolerance), first_(range.first), last_(range.last) {
        known_.assign(std::size_t(range.ticks()), PeakFit{});
        overtravel_.assign(known_.size(), -1.0);
        rebounded_.assign(known_.size(), 0);
        while (2 * spacing_ < range.ticks() / 5 && spacing_ < 64) spacing_ *= 2;
        for (int k = first_; k < last_; k += spacing_) intervals_.push_back(k);
        for (int k : intervals_) requested.push_back(k);
        requested.push_back(last_);
    }

    int curve;
    std::vector<int> requested;  ///< ticks to simulate before the next `take`
    std::size_t job = 0;         ///< the first of their jobs

    /// Takes the jobs of the requested ticks, accepts what is accurate enough and says what is requested next.
    void take(const ReactionJob* jobs) {
        std::vector<int> unsettled = std::move(too_short_);
        too_short_.clear();
        for (std::size_t i = 0; i < requested.size(); ++i) {
            const int k = requested[i];
            known_[std::size_t(k - first_)] = peak_fit(jobs[i]);
            rebounded_[std::size_t(k - first_)] = jobs[i].rebounded;
            overtravel_[std::size_t(k - first_)] = -1;  // what the points say without it
            const double predicted = middles_ ? interpolate(k, 2 * spacing_) : 0;
            const bool bent = !std::isnan(predicted);
            const double difference =
                (bent || !middles_ ? predicted : interpolate_linear(k)) - overtravel(jobs[i].distance);
            overtravel_[std::size_t(k - first_)] = overtravel(jobs[i].distance);
            const int low = k - spacing_, high = std::min(k + spacing_, last_);
            // Where arms come back, which do hangs on little.
            auto rebounded = [&](int tick) { return rebounded_[std::size_t(tick - first_)] != 0; };
            const bool ill_conditioned = middles_ && (rebounded(low) || rebounded(k) || rebounded(high));
            // With half the distance between points the error falls by 2^6, or by 2^2 where a straight line must do.
            if (middles_ && !(ill_conditioned && tolerance_.matters(low, high)) &&
                (bent || spacing_ <= tolerance_.max_linear()) &&
                std::fabs(difference) <= (bent ? 8 : 1) * tolerance_.of(low, high) && accept(low, high, bent))
                continue;
            if (middles_) {
                unsettled.push_back(k - spacing_);
                unsettled.push_back(k);
            }
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
            if (!requested.empty()) break;
            unsettled = std::move(too_short_);
            too_short_.clear();
        }
    }

    /// Fills in what was settled, once every point is known.
    void finish() {
        std::vector<double> filled = overtravel_;
        for (const auto& [k, spacing] : settled_) {
            const double bent = interpolate(k, spacing);
            filled[std::size_t(k - first_)] = bent >= 0 ? bent : interpolate_linear(k);
        }
        overtravel_ = filled;
    }

    int first() const { return first_; }
    const std::vector<double>& overtravels() const { return overtravel_; }

  private:
    static constexpr int max_points = 6;

    /// The overtravel at tick k from the six known points nearest to it whose distance is `spacing`, without k.
    double interpolate(int k, int spacing) const {
        const double nan = std::numeric_limits<double>::quiet_NaN();
        if (!(known_[std::size_t(neighbour(k, -1) - first_)].time >= 0) ||
            !(known_[std::size_t(neighbour(k, 1) - first_)].time >= 0))
            return nan;  // beyond the peaks: points on one side would have to be extrapolated
        std::vector<int> point;
        const int base = first_ + (k - first_) / spacing * spacing;
        for (int reach = 0; reach < max_points && int(point.size()) < max_points; ++reach) {
            for (int at : {base - reach * spacing, base + (reach + 1) * spacing}) {
                if (at < first_ || at > last_ || at == k || int(point.size()) == max_points) continue;
                if (overtravel_[std::size_t(at - first_)] >= 0 && known_[std::size_t(at - first_)].time >= 0)
                    point.push_back(at);
            }
        }
        if (point.size() < 4) return nan;
        std::sort(point.begin(), point.end());
        double weight[max_points];
        Interpolation(point).weights(double(k), weight);
        PeakFit sum{0, 0, 0, 0};
        for (std::size_t m = 0; m < point.size(); ++m) sum.add(weight[m], known_[std::size_t(point[m] - first_)]);
        return sum.time >= 0 ? sum.at_steps() : nan;
    }

    /// The overtravel at tick k on the straight line between its known neighbours: where the point retreats from the
    /// first, and there is no peak to interpolate.
    double interpolate_linear(int k) const {
        const int low = neighbour(k, -1), high = neighbour(k, 1);
        const double left = overtravel_[std::size_t(low - first_)], right = overtravel_[std::size_t(high - first_)];
        return left + (right - left) * (k - low) / (high - low);
    }
    /// The nearest tick whose overtravel is known, in steps of 1 or -1.
    int neighbour(int k, int step) const {
        do k += step;
        while (overtravel_[std::size_t(k - first_)] < 0);
        return k;
    }

    /// Leaves the ticks between two points to interpolation, where the same serves them all.
    bool accept(int low, int high, bool bent) {
        for (int k = low + 1; bent && k < high; ++k) {
            if (overtravel_[std::size_t(k - first_)] < 0 && !(interpolate(k, spacing_) >= 0)) return false;
        }
        for (int k = low + 1; k < high; ++k) {
            if (overtravel_[std::size_t(k - first_)] < 0) settled_.push_back({k, spacing_});
        }
        return true;
    }

    OvertravelTolerance tolerance_;
    int first_, last_, spacing_ = 1;
    bool middles_ = false;  ///< the first round asks for the grid itself
    std::vector<int> intervals_;
    std::vector<int> too_short_;  ///< points before the end that have no middle yet, at the spacing there is
    std::vector<PeakFit> known_;
    std::vector<double> overtravel_;  ///< negative: not known
    std::vector<char> rebounded_;     ///< by tick
    std::vector<std::pair<int, int>> settled_;
};

}  // namespace detail

}  // namespace bumpstop::inline BUMPSTOP_TARGET
