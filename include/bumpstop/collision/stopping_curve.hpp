/// @file
/// The stopping curve: at every feedback tick, where the contact point is and the farthest it still gets if
/// the reaction begins there.
#pragma once

#include <algorithm>
#include <limits>

#include "bumpstop/collision/reaction.hpp"
#include "bumpstop/math/quadrature.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct StoppingCurve {
    LinePath path;
    std::vector<double> farthest;  ///< by tick: greatest distance along the normal from that tick on [m]
    int reactions_simulated = 0;   ///< the others were interpolated
};

/// Interpolated ticks may be wrong by this much at the ticks that are checked [m]. 1e-9 m is what a force law
/// can feel.
inline constexpr double farthest_tolerance = 5e-10;
/// Where a law says how probable a detection at a tick is at most, this divided by that is enough, if it is more, and
/// never more than `largest_farthest_tolerance` [m].
inline constexpr double improbable_farthest_tolerance = 2e-13;
inline constexpr double largest_farthest_tolerance = 1e-3;
/// A tick less probable than this need not be simulated because a kink is near: refinement finds what matters of it.
inline constexpr double kink_probability = 1e-6;

/// How well the overrun of every tick must be known. Without probabilities: all equally well.
struct FarthestTolerance {
    const double* probability = nullptr;  ///< by tick, at most, of a detection there

    double of(int first, int last) const {
        if (probability == nullptr) return farthest_tolerance;
        const double most = *std::max_element(probability + first, probability + last + 1);
        return std::clamp(improbable_farthest_tolerance / most, farthest_tolerance, largest_farthest_tolerance);
    }
    /// How well the reactions must be known that it is found from.
    double of_leaps(int tick) const {
        return probability == nullptr
                   ? braking_leap_tolerance
                   : std::clamp(300 * of(tick, tick), loose_braking_leap_tolerance, loosest_braking_leap_tolerance);
    }
    /// To either side of a tick without a summit, how far others may lie on straight lines.
    int longest_straight() const { return probability == nullptr ? 0 : 8; }
    bool matters(int first, int last) const {
        return probability == nullptr ||
               *std::max_element(probability + first, probability + last + 1) > kink_probability;
    }
};

namespace detail {

/// Distance still travelled after the reaction began: the greatest at a simulation step.
inline double overrun(const std::vector<double>& distance) {
    return *std::max_element(distance.begin(), distance.end()) - distance[0];
}

/// The overrun near its greatest value as a cubic in time, about the top: top + bend/2 d^2 + skew/6 d^3, where
/// d is the time since `time`, both in simulation steps.
struct Summit {
    double time, top, bend, skew;

    /// The greatest value at a whole step.
    double at_steps() const {
        const double below = std::max(0.0, std::floor(time));
        double most = 0;
        for (double step : {below, below + 1}) {
            const double d = step - time;
            most = std::max(most, top + d * d * (bend / 2 + d * skew / 6));
        }
        return most;
    }
};

/// The summit of a reaction's travel, from four steps in a row about it; NaN where there is none, because the
/// travel has no interior maximum.
inline Summit summit(const ReactionJob& job) {
    const std::vector<double>& distance = job.distance;
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const int n = int(distance.size());
    const int peak = int(std::max_element(distance.begin(), distance.end()) - distance.begin());
    if (peak == 0 || peak + 1 >= n || n < 4) return {nan, nan, nan, nan};
    int first = -1;
    for (int before : {1, 2, 0, 3}) {
        const int begin = peak - before;
        if (begin < 0 || begin + 3 >= n || job.step[begin + 3] - job.step[begin] != 3) continue;
        first = begin;
        break;
    }
    if (first < 0) return {nan, nan, nan, nan};
    // Newton's form on the steps first .. first + 3, then powers of x = time - first.
    double y[4];
    for (int i = 0; i < 4; ++i) y[i] = distance[first + i] - distance[0];
    const double d1 = y[1] - y[0], d2 = (y[2] - 2 * y[1] + y[0]) / 2, d3 = (y[3] - 3 * y[2] + 3 * y[1] - y[0]) / 6;
    const double c1 = d1 - d2 + 2 * d3, c2 = d2 - 3 * d3, c3 = d3;
    double x = peak - first;
    for (int i = 0; i < 20; ++i) {
        const double step = (c1 + x * (2 * c2 + 3 * c3 * x)) / (2 * c2 + 6 * c3 * x);
        x -= step;
        if (std::fabs(step) < 1e-14) break;
    }
    return {job.step[first] + x, y[0] + x * (c1 + x * (c2 + x * c3)), 2 * c2 + 6 * c3 * x, 6 * c3};
}

/// The overrun at tick k from reactions simulated at a few ticks. Its greatest value over the simulation steps
/// is not smooth in the tick, as the steps fall differently about the summit; the summit is.
class OverrunInterpolation {
  public:
    /// Through the jobs but number `without`, if it is not below zero.
    OverrunInterpolation(const ReactionJob* jobs, int count, int without = -1)
        : interpolation_(ticks_of(jobs, count, without)) {
        for (int m = 0; m < count; ++m) {
            if (m != without) summit_.push_back(summit(jobs[m]));
        }
    }
    double at(int k) const {
        double weight[16];
        interpolation_.weights(k, weight);
        Summit sum{0, 0, 0, 0};
        for (int m = 0; m < interpolation_.size(); ++m) {
            sum.time += weight[m] * summit_[m].time;
            sum.top += weight[m] * summit_[m].top;
            sum.bend += weight[m] * summit_[m].bend;
            sum.skew += weight[m] * summit_[m].skew;
        }
        return sum.time >= 0 ? sum.at_steps() : std::numeric_limits<double>::quiet_NaN();
    }

  private:
    static std::vector<int> ticks_of(const ReactionJob* jobs, int count, int without) {
        std::vector<int> ticks;
        for (int m = 0; m < count; ++m) {
            if (m != without) ticks.push_back(jobs[m].tick);
        }
        return ticks;
    }

    Interpolation interpolation_;
    std::vector<Summit> summit_;
};

/// Ticks of one curve whose overrun is found together.
struct Stretch {
    int curve, first, last;
    bool crosses_kink = false;  ///< not to be interpolated
    std::size_t job = 0;        ///< the first of its jobs

    int ticks() const { return last - first + 1; }
};

/// The joint that limits the deceleration at a tick: the one farthest from standstill in units of its own
/// limit.
inline int limiting_joint(const MotionSettings& motion, const LinePath& path, int k) {
    const double* qd = &path.reaction_state[(std::size_t(2) * k + 1) * motion.free_count];
    int limiting = 0;
    double most = -1;
    for (int f = 0; f < motion.free_count; ++f) {
        const double share = std::fabs(qd[f]) / motion.acceleration_limit[motion.free_joint[f]];
        if (share > most) {
            most = share;
            limiting = f;
        }
    }
    return limiting;
}

/// Where another joint takes over as the limiting one, the overrun has a kink. Reactions that begin up to an
/// overrun before it cross it on their way. So the ticks are cut there, and those crossing it stand by
/// themselves.
inline void cut_at_kinks(const MotionSettings& motion, const Timing& timing, const LinePath& path, int curve, int known,
                         const FarthestTolerance& tolerance, std::vector<Stretch>& stretches) {
    int first = 0;
    for (int k = 1; k < known; ++k) {
        const int limiting = limiting_joint(motion, path, k);
        if (limiting == limiting_joint(motion, path, k - 1)) continue;
        const int j = motion.free_joint[limiting];
        const double qd = path.reaction_state[(std::size_t(2) * k + 1) * motion.free_count + limiting];
        const double stop_time = std::fabs(qd) / motion.acceleration_limit[j];
        const int crossing = int(stop_time / (2 * timing.period * motion.step)) + 2 + timing.latency / timing.period;
        const int begin = std::max(first, k - crossing), end = std::min(known - 1, k + 1);
        if (!tolerance.matters(begin, end)) continue;
        if (begin > first) stretches.push_back({curve, first, begin - 1});
        if (end >= begin) stretches.push_back({curve, begin, end, true});
        first = end + 1;
        k = end;
    }
    if (first < known) stretches.push_back({curve, first, known - 1});
}

/// A stretch too rough for one polynomial: ticks simulated on a grid that is halved wherever the middle of two
/// of its points is not where the six nearest points say. Nothing simulated is thrown away.
class Refinement {
  public:
    Refinement(const Stretch& stretch, const FarthestTolerance& tolerance)
        : curve(stretch.curve), tolerance_(tolerance), first_(stretch.first), last_(stretch.last) {
        known_.assign(std::size_t(stretch.ticks()), Summit{});
        overrun_.assign(known_.size(), -1.0);
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
            overrun_[std::size_t(k - first_)] = -1;  // what the points say without it
            const double predicted = middles_ ? predict(k, 2 * spacing_, k) : 0;
            const bool bent = !std::isnan(predicted);
            const double difference = (bent || !middles_ ? predicted : straight(k)) - overrun(jobs[i].distance);
            overrun_[std::size_t(k - first_)] = overrun(jobs[i].distance);
            const int low = k - spacing_, high = std::min(k + spacing_, last_);
            // With half the distance between points the error falls by 2^6, or by 2^2 where a straight line must do.
            if (middles_ && (bent || spacing_ <= tolerance_.longest_straight()) &&
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

    int first() const { return first_; }
    const std::vector<double>& overruns() const { return overrun_; }

  private:
    /// The overrun at tick k from the six known points nearest to `centre` whose distance is `spacing`,
    /// without k.
    double predict(int k, int spacing, int centre) const {
        const double nan = std::numeric_limits<double>::quiet_NaN();
        if (!(known_[std::size_t(neighbour(k, -1) - first_)].time >= 0) ||
            !(known_[std::size_t(neighbour(k, 1) - first_)].time >= 0))
            return nan;  // beyond the summits: points on one side would have to be extrapolated
        std::vector<int> points;
        const int base = first_ + (centre - first_) / spacing * spacing;
        for (int reach = 0; reach <= 5 && points.size() < 6; ++reach) {
            for (int at : {base - reach * spacing, base + (reach + 1) * spacing}) {
                if (at < first_ || at > last_ || at == k || points.size() >= 6) continue;
                if (overrun_[std::size_t(at - first_)] >= 0 && known_[std::size_t(at - first_)].time >= 0)
                    points.push_back(at);
            }
        }
        if (points.size() < 4) return nan;
        std::sort(points.begin(), points.end());
        const Interpolation interpolation(points);
        double weight[6];
        interpolation.weights(k, weight);
        Summit sum{0, 0, 0, 0};
        for (std::size_t m = 0; m < points.size(); ++m) {
            const Summit& at = known_[std::size_t(points[m] - first_)];
            sum.time += weight[m] * at.time;
            sum.top += weight[m] * at.top;
            sum.bend += weight[m] * at.bend;
            sum.skew += weight[m] * at.skew;
        }
        return sum.time >= 0 ? sum.at_steps() : std::numeric_limits<double>::quiet_NaN();
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
            if (overrun_[std::size_t(k - first_)] < 0 && !(predict(k, spacing_, k) >= 0)) return false;
        }
        for (int k = low + 1; k < high; ++k) {
            if (overrun_[std::size_t(k - first_)] < 0) settled_.push_back({k, spacing_});
        }
        return true;
    }

  public:
    /// Fills in what was settled, once every point is known.
    void finish() {
        std::vector<double> filled = overrun_;
        for (const auto& [k, spacing] : settled_) {
            const double bent = predict(k, spacing, k);
            filled[std::size_t(k - first_)] = bent >= 0 ? bent : straight(k);
        }
        overrun_ = filled;
    }

  private:
    FarthestTolerance tolerance_;
    int first_, last_, spacing_ = 1;
    bool middles_ = false;  ///< the first round asks for the grid itself
    std::vector<int> open_;
    std::vector<int> too_short_;  ///< points before the end that have no middle yet, at the spacing there is
    std::vector<Summit> known_;
    std::vector<double> overrun_;  ///< negative: not known
    std::vector<std::pair<int, int>> settled_;
};

}  // namespace detail

/// Fills `farthest` of `count` curves whose paths are traced. Reactions are simulated at a few ticks of each
/// stretch and interpolated between; a stretch where the others say something else of one of them is halved, down to
/// single ticks. `pose(i)` gives the joint positions curve i started in, `tolerance(i)` how well its ticks must be known.
template <class T, class Pose, class Tolerance>
void complete_curves(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                     const Timing& timing, ReactionKind kind, StoppingCurve* curves, int count, Pose pose,
                     Tolerance tolerance) {
    constexpr int nodes = 6, fewest_ticks = 9;
    std::vector<detail::Stretch> pending;
    std::vector<detail::Refinement> rough;
    for (int c = 0; c < count; ++c) {
        StoppingCurve& curve = curves[c];
        const LinePath& path = curve.path;
        curve.farthest.assign(path.ticks, 0.0);
        curve.reactions_simulated = 0;
        const int known = std::min(path.ticks, int(path.reaction_state.size() / (2 * std::size_t(motion.free_count))));
        // A path that ends before the reaction begins ends for both: the arm stands still there.
        for (int k = known; k < path.ticks; ++k) {
            const auto from = path.s.begin() + std::ptrdiff_t(k) * timing.period + 1;
            curve.farthest[k] = *std::max_element(from, path.s.end());
        }
        if (known > 0) detail::cut_at_kinks(motion, timing, path, c, known, tolerance(c), pending);
    }
    std::vector<ReactionJob> jobs;
    auto add = [&](int curve, int tick) {
        jobs.push_back({&curves[curve].path, curve, tick, {}, {}, tolerance(curve).of_leaps(tick)});
    };
    auto simulate = [&] {
        if (jobs.empty()) return;
        simulate_reactions<T>(
            chain, motion, contact, timing, kind, jobs.data(), int(jobs.size()), ReactionDetail::only_peak,
            [&](const ReactionJob& job) { return pose(job.curve); },
            [&](const ReactionJob& job) { return job.path->at_tick(job.tick, timing.period); });
        for (const ReactionJob& job : jobs) ++curves[job.curve].reactions_simulated;
    };
    auto place = [&](int curve, int k, double travelled) {
        const LinePath& path = curves[curve].path;
        const auto from = path.s.begin() + std::ptrdiff_t(k) * timing.period + 1;
        const double before = *std::max_element(from, from + timing.latency + 1);
        curves[curve].farthest[k] = std::max(before, from[timing.latency] + travelled);
    };

    for (detail::Stretch& stretch : pending) {
        stretch.job = jobs.size();
        const bool every_tick = stretch.crosses_kink || stretch.ticks() < fewest_ticks;
        const int wanted = every_tick ? stretch.ticks() : nodes;
        for (int k : interpolation_nodes(stretch.first, stretch.last, wanted)) add(stretch.curve, k);
    }
    simulate();
    for (const detail::Stretch& stretch : pending) {
        const ReactionJob* own = &jobs[stretch.job];
        if (stretch.crosses_kink || stretch.ticks() < fewest_ticks) {
            for (int i = 0; i < stretch.ticks(); ++i)
                place(stretch.curve, stretch.first + i, detail::overrun(own[i].distance));
            continue;
        }
        bool smooth = true;
        for (int i : {1, nodes / 2}) {  // near an end, and in the middle
            const double difference =
                detail::OverrunInterpolation(own, nodes, i).at(own[i].tick) - detail::overrun(own[i].distance);
            smooth = smooth && std::fabs(difference) <= tolerance(stretch.curve).of(stretch.first, stretch.last);
        }
        const detail::OverrunInterpolation overrun(own, nodes);
        for (int k = stretch.first; smooth && k <= stretch.last; ++k) {
            const double travelled = overrun.at(k);
            smooth = smooth && travelled >= 0;
            place(stretch.curve, k, travelled);
        }
        if (!smooth) rough.emplace_back(stretch, tolerance(stretch.curve));
    }
    for (bool working = !rough.empty(); working;) {
        jobs.clear();
        for (detail::Refinement& refinement : rough) {
            refinement.job = jobs.size();
            for (int k : refinement.wanted) add(refinement.curve, k);
        }
        simulate();
        working = false;
        for (detail::Refinement& refinement : rough) {
            if (refinement.wanted.empty()) continue;
            refinement.take(&jobs[refinement.job]);
            working = working || !refinement.wanted.empty();
        }
    }
    for (detail::Refinement& refinement : rough) {
        refinement.finish();
        for (std::size_t i = 0; i < refinement.overruns().size(); ++i)
            place(refinement.curve, refinement.first() + int(i), std::max(0.0, refinement.overruns()[i]));
    }
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
