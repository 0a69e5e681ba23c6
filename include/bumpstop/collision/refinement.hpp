/// @file
/// The overruns of a stretch of ticks, from reactions on a grid that is halved where it must be.
#pragma once

#include "bumpstop/collision/farthest_tolerance.hpp"
#include "bumpstop/collision/summit.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// Ticks of one curve whose overrun is found together.
struct Stretch {
    int curve, first, last;
    bool crosses_kink = false;  ///< not to be interpolated
    std::size_t job = 0;        ///< the first of its jobs

    int ticks() const { return last - first + 1; }
};

/// A stretch too rough for one polynomial: ticks simulated on a grid that is halved wherever the middle of two
/// of its points is not where the six nearest points say. Nothing simulated is thrown away.
class Refinement {
  public:
    Refinement(const Stretch& stretch, const FarthestTolerance& tolerance)
        : curve(stretch.curve), tolerance_(tolerance), first_(stretch.first), last_(stretch.last) {
        known_.assign(std::size_t(stretch.ticks()), Summit{});
        overrun_.assign(known_.size(), -1.0);
        came_back_.assign(known_.size(), 0);
        while (2 * spacing_ < stretch.ticks() / 5 && spacing_ < 64) spacing_ *= 2;
        for (int k = first_; k < last_; k += spacing_) open_.push_back(k);
        for (int k : open_) wanted.push_back(k);
        wanted.push_back(last_);
    }

    int curve;
    std::vector<int> wanted;  ///< ticks to simulate before the next `take`
    std::size_t job = 0;      ///< the first of their jobs

    /// Takes the jobs of the wanted ticks, settles what can be settled and says what is wanted next.
    void take(const ReactionJob* jobs) {
        std::vector<int> unsettled = std::move(too_short_);
        too_short_.clear();
        for (std::size_t i = 0; i < wanted.size(); ++i) {
            const int k = wanted[i];
            known_[std::size_t(k - first_)] = summit(jobs[i]);
            came_back_[std::size_t(k - first_)] = jobs[i].came_back;
            overrun_[std::size_t(k - first_)] = -1;  // what the points say without it
            const double predicted = middles_ ? predict(k, 2 * spacing_) : 0;
            const bool bent = !std::isnan(predicted);
            const double difference = (bent || !middles_ ? predicted : straight(k)) - overrun(jobs[i].distance);
            overrun_[std::size_t(k - first_)] = overrun(jobs[i].distance);
            const int low = k - spacing_, high = std::min(k + spacing_, last_);
            // Where arms come back, which do hangs on little.
            auto came_back = [&](int tick) { return came_back_[std::size_t(tick - first_)] != 0; };
            const bool erratic = middles_ && (came_back(low) || came_back(k) || came_back(high));
            // With half the distance between points the error falls by 2^6, or by 2^2 where a straight line must do.
            if (middles_ && !(erratic && tolerance_.matters(low, high)) &&
                (bent || spacing_ <= tolerance_.longest_straight()) &&
                std::fabs(difference) <= (bent ? 8 : 1) * tolerance_.of(low, high) && settle(low, high, bent))
                continue;
            if (middles_) {
                unsettled.push_back(k - spacing_);
                unsettled.push_back(k);
            }
        }
        if (!middles_) unsettled = open_;
        middles_ = true;
        wanted.clear();
        while (spacing_ > 1 && wanted.empty() && !unsettled.empty()) {
            spacing_ /= 2;
            for (int k : unsettled) {
                if (k + spacing_ < last_) {
                    wanted.push_back(k + spacing_);
                } else {
                    too_short_.push_back(k);
                }
            }
            if (!wanted.empty()) break;
            unsettled = std::move(too_short_);
            too_short_.clear();
        }
    }

    /// Fills in what was settled, once every point is known.
    void finish() {
        std::vector<double> filled = overrun_;
        for (const auto& [k, spacing] : settled_) {
            const double bent = predict(k, spacing);
            filled[std::size_t(k - first_)] = bent >= 0 ? bent : straight(k);
        }
        overrun_ = filled;
    }

    int first() const { return first_; }
    const std::vector<double>& overruns() const { return overrun_; }

  private:
    static constexpr int most_points = 6;

    /// The overrun at tick k from the six known points nearest to it whose distance is `spacing`, without k.
    double predict(int k, int spacing) const {
        const double nan = std::numeric_limits<double>::quiet_NaN();
        if (!(known_[std::size_t(neighbour(k, -1) - first_)].time >= 0) ||
            !(known_[std::size_t(neighbour(k, 1) - first_)].time >= 0))
            return nan;  // beyond the summits: points on one side would have to be extrapolated
        int point[most_points], points = 0;
        const int base = first_ + (k - first_) / spacing * spacing;
        bool even = base != k;
        for (int reach = 0; reach < most_points && points < most_points; ++reach) {
            for (int at : {base - reach * spacing, base + (reach + 1) * spacing}) {
                if (at < first_ || at > last_ || at == k || points == most_points) continue;
                if (overrun_[std::size_t(at - first_)] >= 0 && known_[std::size_t(at - first_)].time >= 0) {
                    even = even && reach < most_points / 2;
                    point[points++] = at;
                }
            }
        }
        if (points < 4) return nan;
        // Lagrange's polynomial in barycentric form. Where three points lie to either side, the products of their distances
        // are one divided by binomial coefficients, in the order of `point`.
        constexpr double binomial[most_points] = {10, -10, -5, 5, 1, -1};
        even = even && points == most_points;
        Summit sum{0, 0, 0, 0};
        double weights = 0;
        for (int m = 0; m < points; ++m) {
            double product = k - point[m];
            for (int j = 0; j < points && !even; ++j) {
                if (j != m) product *= point[m] - point[j];
            }
            const double weight = (even ? binomial[m] : 1.0) / product;
            const Summit& at = known_[std::size_t(point[m] - first_)];
            weights += weight;
            sum.time += weight * at.time;
            sum.top += weight * at.top;
            sum.bend += weight * at.bend;
            sum.skew += weight * at.skew;
        }
        sum = {sum.time / weights, sum.top / weights, sum.bend / weights, sum.skew / weights};
        return sum.time >= 0 ? sum.at_steps() : nan;
    }

    /// The overrun at tick k on the straight line between its known neighbours: where the point retreats from the
    /// first, and there is no summit to interpolate.
    double straight(int k) const {
        const int low = neighbour(k, -1), high = neighbour(k, 1);
        const double left = overrun_[std::size_t(low - first_)], right = overrun_[std::size_t(high - first_)];
        return left + (right - left) * (k - low) / (high - low);
    }
    /// The nearest tick whose overrun is known, in steps of 1 or -1.
    int neighbour(int k, int step) const {
        do k += step;
        while (overrun_[std::size_t(k - first_)] < 0);
        return k;
    }

    /// Leaves the ticks between two points to interpolation, where the same serves them all.
    bool settle(int low, int high, bool bent) {
        for (int k = low + 1; bent && k < high; ++k) {
            if (overrun_[std::size_t(k - first_)] < 0 && !(predict(k, spacing_) >= 0)) return false;
        }
        for (int k = low + 1; k < high; ++k) {
            if (overrun_[std::size_t(k - first_)] < 0) settled_.push_back({k, spacing_});
        }
        return true;
    }

    FarthestTolerance tolerance_;
    int first_, last_, spacing_ = 1;
    bool middles_ = false;  ///< the first round asks for the grid itself
    std::vector<int> open_;
    std::vector<int> too_short_;  ///< points before the end that have no middle yet, at the spacing there is
    std::vector<Summit> known_;
    std::vector<double> overrun_;  ///< negative: not known
    std::vector<char> came_back_;  ///< by tick
    std::vector<std::pair<int, int>> settled_;
};

}  // namespace detail

}  // namespace bumpstop::inline BUMPSTOP_TARGET
