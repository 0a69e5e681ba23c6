/// @file
/// The stopping curve: at every feedback tick, where the contact point is and the farthest it still gets if
/// the reaction begins there.
#pragma once

#include "bumpstop/collision/refinement.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct StoppingCurve {
    LinePath path;
    std::vector<double> farthest;  ///< by tick: greatest distance along the normal from that tick on [m]
    int reactions_simulated = 0;   ///< the others were interpolated
};

namespace detail {

/// The joint that limits the deceleration at a tick: the one farthest from standstill in units of its own
/// limit. `inverse_limit`: by free joint.
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

/// Where another joint takes over as the limiting one, the overrun has a kink. Reactions that begin up to an
/// overrun before it cross it on their way. So the ticks are cut there, and those crossing it stand by
/// themselves.
inline void cut_at_kinks(const MotionSettings& motion, const Timing& timing, const LinePath& path, int curve, int known,
                         const FarthestTolerance& tolerance, std::vector<Stretch>& stretches) {
    const FullChangeInverse inverse(motion);
    int first = 0, limiting = limiting_joint(motion, inverse.of.data(), path, 0);
    for (int k = 1; k < known; ++k) {
        const int before = limiting;
        limiting = limiting_joint(motion, inverse.of.data(), path, k);
        if (limiting == before) continue;
        const int j = motion.free_joint[limiting];
        const double qd = path.reaction_state[(std::size_t(2) * k + 1) * motion.free_count + limiting];
        const double stop_time = std::fabs(qd) / motion.acceleration_limit[j];
        const double ticks = std::min(stop_time / (2 * timing.period * motion.step), double(k));
        const int crossing = int(ticks) + 2 + timing.latency / timing.period;
        const int begin = std::max(first, k - crossing), end = std::min(known - 1, k + 1);
        if (!tolerance.matters(begin, end)) continue;
        if (begin > first) stretches.push_back({curve, first, begin - 1});
        if (end >= begin) stretches.push_back({curve, begin, end, true});
        first = end + 1;
        if (k != end) limiting = limiting_joint(motion, inverse.of.data(), path, end);
        k = end;
    }
    if (first < known) stretches.push_back({curve, first, known - 1});
}

}  // namespace detail

/// Fills `farthest` of `count` curves whose paths are traced. Reactions are simulated at a few ticks of each stretch and
/// interpolated between; a stretch where the others say something else of one of them is simulated on a grid that is
/// halved where it must be. `pose(i)` gives the joint positions curve i started in, `tolerance(i)` how well its ticks
/// must be known.
template <class T, class Pose, class Tolerance>
void complete_curves(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                     const Timing& timing, ReactionKind kind, StoppingCurve* curves, int count, Pose pose,
                     Tolerance tolerance) {
    constexpr int nodes = 6, fewest_ticks = 9, lanes = Scalar<T>::lanes;
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
        jobs.back().comes_back = tolerance(curve).follows(tick);
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
        bool smooth = std::none_of(own, own + nodes, [](const ReactionJob& job) { return job.came_back; });
        detail::Summit summits[nodes];
        std::transform(own, own + nodes, summits, detail::summit);
        for (int i : {1, nodes / 2}) {  // near an end, and in the middle
            const double difference = detail::OverrunInterpolation(own, summits, nodes, i).at(double(own[i].tick)) -
                                      detail::overrun(own[i].distance);
            smooth = smooth && std::fabs(difference) <= tolerance(stretch.curve).of(stretch.first, stretch.last);
        }
        const detail::OverrunInterpolation overrun(own, summits, nodes);
        for (int first = stretch.first; smooth && first <= stretch.last; first += lanes) {
            T k;
            for (int lane = 0; lane < lanes; ++lane) set_lane(k, lane, double(first + lane));
            const T travelled = overrun.at(k);
            for (int lane = 0; lane < lanes && first + lane <= stretch.last; ++lane) {
                smooth = smooth && lane_of(travelled, lane) >= 0;
                place(stretch.curve, first + lane, lane_of(travelled, lane));
            }
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
