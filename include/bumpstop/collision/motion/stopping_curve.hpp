/// @file
/// The stopping curve: where the contact point is at every feedback tick, and how far it gets if the arm reacts to it.
#pragma once

#include "bumpstop/collision/motion/adaptive_tick_grid.hpp"
#include "bumpstop/collision/motion/line_tracer.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct StoppingCurve {
    LinePath path;
    std::vector<double> max_distance;  ///< stopping distance by tick: the greatest along the normal from it on [m]
};

namespace detail {

/// The free joint that limits the deceleration at a tick: the one with the longest stopping time.
inline int limiting_joint(const MotionSettings& motion, const double* inverse_limit, const LinePath& path, int k) {
    const double* qd = &path.reaction_state[(std::size_t(2) * k + 1) * motion.free_count];
    int limiting = 0;
    double most = -1;
    for (int f = 0; f < motion.free_count; ++f) {
        const double share = std::fabs(qd[f]) * inverse_limit[f];
        if (share > most) {
            most = share;
            limiting = f;
        }
    }
    return limiting;
}

/// Greatest distance from `step` on of an arm that continues on its line and brakes at its end.
inline double max_distance_on_line(const LinePath& path, int step) {
    double most = *std::max_element(path.s.begin() + step, path.s.end());
    for (double distance : path.braking) most = std::max(most, distance);
    return most;
}

/// About the largest number of simulated reactions that begin before that to tick 0.
inline constexpr int max_early_reactions = 16;

/// The ticks before tick 0 whose reactions are simulated: evenly spaced, the earliest and the latest among them.
inline std::vector<int> early_ticks(const CollisionSetup& setup, const LinePath& path) {
    const int lead = LinePath::early_ticks(setup.timing);
    const int known = path.known_early_reactions();
    const int spacing = std::max(1, (known + max_early_reactions - 1) / max_early_reactions);
    std::vector<int> ticks;
    for (int i = 0; i < known; i += spacing) ticks.push_back(i - lead);
    if (known > 0 && ticks.back() != known - 1 - lead) ticks.push_back(known - 1 - lead);
    return ticks;
}

/// Greatest distances of reactions with the steps they begin in, in order.
using Reach = std::vector<std::pair<int, double>>;

/// Whether a later reaction always gets farther, as far as `reach` and the curve show: then no reaction that begins
/// between them can get farther than its successor. Where the arm brakes at the end of its line this is not known.
inline bool grows_with_latency(const Reach& reach, const StoppingCurve& curve) {
    if (!curve.path.braking.empty()) return false;
    const auto known = curve.max_distance.begin() + curve.path.known_reactions();
    const auto less = [](const auto& a, const auto& b) { return b.second < a.second; };
    return std::is_sorted(curve.max_distance.begin(), known) &&
           std::adjacent_find(reach.begin(), reach.end(), less) == reach.end() &&
           (reach.empty() || known == curve.max_distance.begin() || reach.back().second <= curve.max_distance.front());
}

/// The latency is an upper bound: the reaction may begin at any step up to it, and the one that gets farthest counts,
/// which near a singularity may be an earlier one. So a longer latency never makes a collision less severe. Where the
/// line ends before the reaction is due, the arm brakes as it does without a detection.
/// `reach`: of reactions to ticks below 0, or, with `every_step`, of reactions that begin in every step.
inline void widen_by_latency(const CollisionSetup& setup, Reach reach, bool every_step, StoppingCurve& curve) {
    const Timing& timing = setup.timing;
    if (timing.latency == 0) return;
    const LinePath& path = curve.path;
    const int known = path.known_reactions();
    for (int k = 0; k < known && !every_step; ++k)
        reach.emplace_back(LinePath::reaction_step(k, timing), curve.max_distance[std::size_t(k)]);
    // Sliding maximum over the reactions that begin from a tick on, up to the latency after it.
    std::size_t first = 0, next = 0;   // the first that begins at the tick or later; the first not in the window yet
    std::vector<std::size_t> falling;  // candidates for the maximum, by falling distance
    std::size_t head = 0;              // the first candidate that begins at the tick or later
    for (int k = 0; k < path.ticks; ++k) {
        const int step = k * timing.period + 1;
        double& most = curve.max_distance[std::size_t(k)];
        if (k >= known) most = max_distance_on_line(path, step);
        while (first < reach.size() && reach[first].first < step) ++first;
        for (; next < reach.size() && reach[next].first <= step + timing.latency; ++next) {
            while (falling.size() > head && reach[falling.back()].second <= reach[next].second) falling.pop_back();
            falling.push_back(next);
        }
        while (head < falling.size() && falling[head] < first) ++head;
        if (head < falling.size()) most = std::max(most, reach[falling[head]].second);
        if (first == 0) continue;
        if (first == reach.size()) {  // after the last reaction
            most = std::max(most, reach.back().second);
            continue;
        }
        // The reaction that begins at the tick itself, interpolated between two.
        const auto &before = reach[first - 1], &after = reach[first];
        const double share = double(step - before.first) / (after.first - before.first);
        most = std::max(most, before.second + share * (after.second - before.second));
    }
}

/// Where another joint becomes the limiting one, the overtravel has a switching point as a function of the tick.
/// Reactions that begin up to an overtravel before it, which is half a stopping time at the speed of the line, cross it
/// on their way. So the ticks are split there, and those whose reactions cross it form a range of their own, in which
/// every tick is simulated.
inline void split_at_switches(const CollisionSetup& setup, const LinePath& path, int curve,
                              const OvertravelTolerance& tolerance, std::vector<TickRange>& ranges) {
    const MotionSettings& motion = setup.motion;
    const Timing& timing = setup.timing;
    const int known = path.known_reactions();
    if (known == 0) return;
    if (motion.deceleration.law == DecelerationLaw::table || motion.deceleration.independent) {
        // Every grid value of a table is a switching point, and so is the stop of every joint.
        ranges.push_back({curve, 0, known - 1, true});
        return;
    }
    const InverseMaxRateChange inverse(motion);
    int first = 0, limiting = limiting_joint(motion, inverse.of.data(), path, 0);
    for (int k = 1; k < known; ++k) {
        const int before = limiting;
        limiting = limiting_joint(motion, inverse.of.data(), path, k);
        if (limiting == before) continue;
        const int j = motion.free_joint[limiting];
        const double qd = path.reaction_state[(std::size_t(2) * k + 1) * motion.free_count + limiting];
        const double stop_time = motion.deceleration.time_to_stop(std::fabs(qd) / motion.acceleration_limit[j]);
        const double ticks = std::min(stop_time / (2 * timing.period * motion.step), double(k));
        const int crossing = int(ticks) + 2 + timing.latency / timing.period;
        const int begin = std::max(first, k - crossing), end = std::min(known - 1, k + 1);
        if (!tolerance.matters(begin, end)) continue;
        if (begin > first) ranges.push_back({curve, first, begin - 1});
        if (end >= begin) ranges.push_back({curve, begin, end, true});
        first = end + 1;
        if (k != end) limiting = limiting_joint(motion, inverse.of.data(), path, end);
        k = end;
    }
    if (first < known) ranges.push_back({curve, first, known - 1});
}

template <class T>
Reach reach_of_every_step(const CollisionSetup& setup, const LinePath& path);  // it uses complete_curves

}  // namespace detail

/// Computes `max_distance` of `count` curves whose paths are traced. In each range of ticks the reactions to a few are
/// simulated and interpolated. Where leaving one of them out shows that this is not accurate enough, the range is
/// simulated on an adaptive grid. `tolerance(i)` is the OvertravelTolerance of curve i.
template <class T, class Tolerance>
void complete_curves(const CollisionSetup& setup, StoppingCurve* curves, int count, Tolerance tolerance) {
    const Timing& timing = setup.timing;
    constexpr int nodes = 6, min_ticks = 9;
    std::vector<detail::TickRange> pending;
    std::vector<detail::AdaptiveTickGrid> rough;
    for (int c = 0; c < count; ++c) {
        StoppingCurve& curve = curves[c];
        curve.max_distance.assign(curve.path.ticks, 0.0);
        detail::split_at_switches(setup, curve.path, c, tolerance(c), pending);
    }
    std::vector<ReactionJob> jobs;
    auto add = [&](int curve, int tick) {
        jobs.push_back({&curves[curve].path, curve, tick, {}, {}, tolerance(curve).of_reaction(tick)});
        jobs.back().may_rebound = tolerance(curve).follows(tick);
        jobs.back().return_to = curves[curve].path.at_tick(std::max(tick, 0), timing.period);
    };
    auto simulate = [&] {
        if (jobs.empty()) return;
        simulate_reactions<T>(setup, jobs.data(), int(jobs.size()), ReactionDetail::only_peak);
        refine_near_singularities<T>(setup, jobs, ReactionDetail::only_peak, [&](const ReactionJob& job) {
            return tolerance(job.curve).refines_near_singular(job.tick);
        });
    };
    auto place = [&](int curve, int k, double travelled) {
        const LinePath& path = curves[curve].path;
        const auto from = path.s.begin() + std::ptrdiff_t(k) * timing.period + 1;
        const double before = *std::max_element(from, from + timing.latency + 1);
        curves[curve].max_distance[k] = std::max(before, from[timing.latency] + travelled);
    };

    for (detail::TickRange& range : pending) {
        range.job = jobs.size();
        const bool every_tick = range.contains_switch || range.ticks() < min_ticks;
        const int wanted = every_tick ? range.ticks() : nodes;
        for (int k : interpolation_nodes(range.first, range.last, wanted)) add(range.curve, k);
    }
    simulate();
    for (const detail::TickRange& range : pending) {
        const ReactionJob* own = &jobs[range.job];
        if (range.contains_switch || range.ticks() < min_ticks) {
            for (int i = 0; i < range.ticks(); ++i)
                place(range.curve, range.first + i, detail::overtravel(own[i].distance));
            continue;
        }
        bool smooth = std::none_of(own, own + nodes, [](const ReactionJob& job) { return job.rebounded; });
        std::vector<int> ticks;
        std::vector<detail::PeakFit> peaks;
        for (int i = 0; i < nodes; ++i) {
            ticks.push_back(own[i].tick);
            peaks.push_back(detail::peak_fit(own[i]));
        }
        for (int i : {1, nodes / 2}) {  // near an end, and in the middle
            auto other_ticks = ticks;
            auto other_peaks = peaks;
            other_ticks.erase(other_ticks.begin() + i);
            other_peaks.erase(other_peaks.begin() + i);
            const detail::OvertravelInterpolation without(std::move(other_ticks), std::move(other_peaks));
            const int left_out = ticks[std::size_t(i)];
            const double difference =
                without.between<double>(left_out, left_out)[0] - detail::overtravel(own[i].distance);
            smooth = smooth && std::fabs(difference) <= tolerance(range.curve).of(range.first, range.last);
        }
        std::vector<double> travelled;
        if (smooth)
            travelled =
                detail::OvertravelInterpolation(std::move(ticks), std::move(peaks)).between<T>(range.first, range.last);
        smooth = smooth && std::all_of(travelled.begin(), travelled.end(), [](double travel) { return travel >= 0; });
        for (int k = range.first; smooth && k <= range.last; ++k)
            place(range.curve, k, travelled[std::size_t(k - range.first)]);
        if (!smooth) rough.emplace_back(range, tolerance(range.curve));
    }
    for (bool working = !rough.empty(); working;) {
        jobs.clear();
        for (detail::AdaptiveTickGrid& grid : rough) {
            grid.job = jobs.size();
            for (int k : grid.requested) add(grid.curve, k);
        }
        simulate();
        working = false;
        for (detail::AdaptiveTickGrid& grid : rough) {
            if (grid.requested.empty()) continue;
            grid.take(&jobs[grid.job]);
            working = working || !grid.requested.empty();
        }
    }
    for (detail::AdaptiveTickGrid& grid : rough) {
        grid.finish();
        for (int k = grid.first(); k <= grid.last(); ++k) place(grid.curve, k, std::max(0.0, grid.overtravel_at(k)));
    }
    jobs.clear();
    for (int c = 0; c < count; ++c) {
        if (curves[c].path.ticks == 0) continue;
        // A reaction to a tick before tick 0 stands for reactions to the first ticks: it gets the narrowest of their
        // tolerances.
        const int last = std::min(LinePath::early_ticks(timing), curves[c].path.ticks - 1);
        int narrowest = 0;
        for (int k = 1; k <= last; ++k)
            if (tolerance(c).of(k, k) < tolerance(c).of(narrowest, narrowest)) narrowest = k;
        for (int k : detail::early_ticks(setup, curves[c].path)) {
            add(c, narrowest);
            jobs.back().tick = k;
        }
    }
    simulate();
    std::size_t next = 0;
    for (int c = 0; c < count; ++c) {
        detail::Reach reach;
        for (; next < jobs.size() && jobs[next].curve == c; ++next) {
            const std::vector<double>& distance = jobs[next].distance;
            reach.emplace_back(LinePath::reaction_step(jobs[next].tick, timing),
                               *std::max_element(distance.begin(), distance.end()));
        }
        const bool every_step =
            timing.latency > 0 && curves[c].path.ticks > 0 && !detail::grows_with_latency(reach, curves[c]);
        if (every_step) reach = detail::reach_of_every_step<T>(setup, curves[c].path);
        detail::widen_by_latency(setup, std::move(reach), every_step, curves[c]);
    }
}

namespace detail {

/// Traces a path again with a tick in every step and without latency, so that a reaction begins in every step.
template <class T>
Reach reach_of_every_step(const CollisionSetup& setup, const LinePath& path) {
    CollisionSetup every = setup;
    every.timing.period = 1;
    every.timing.latency = 0;
    every.timing.steps = int(path.s.size()) - 1;
    StoppingCurve curve;
    curve.path = trace_line<T>(every, {path.q.data(), path.velocity}, NoCriterion<T>());
    complete_curves<T>(every, &curve, 1, [](int) { return OvertravelTolerance{}; });
    Reach reach;
    for (int k = 0; k < curve.path.known_reactions(); ++k)
        reach.emplace_back(LinePath::reaction_step(k, every.timing), curve.max_distance[std::size_t(k)]);
    return reach;
}

}  // namespace detail

}  // namespace bumpstop::inline BUMPSTOP_TARGET
