// The stopping curve: at every feedback tick, where the contact point is and the farthest it still gets if
// the reaction begins there.
#pragma once

#include <algorithm>
#include <limits>

#include "bumpstop/collision/reaction.hpp"
#include "bumpstop/math/quadrature.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct StoppingCurve {
    LinePath path;
    std::vector<double> farthest;  // by tick: greatest distance along the normal from that tick on [m]
    int reactions_simulated = 0;   // the others were interpolated
};

// Interpolated ticks may be wrong by this much at the ticks that are checked [m]. 1e-9 m is what a force law
// can feel.
inline constexpr double farthest_tolerance = 1e-11;

namespace detail {

// Distance still travelled after the reaction began, and in which step it is greatest.
struct Overrun {
    int argmax = 0;
    double most = 0;
};
inline Overrun overrun(const std::vector<double>& distance) {
    Overrun best;
    for (std::size_t i = 0; i < distance.size(); ++i) {
        if (distance[i] - distance[0] > best.most) best = {int(i), distance[i] - distance[0]};
    }
    return best;
}

// The farthest travel of one pose from reactions simulated at a few ticks. For a fixed number of steps after
// its beginning the reaction's travel is smooth in the tick; its greatest value over the steps is not, so the
// steps are interpolated and the greatest is taken afterwards.
class OverrunInterpolation {
  public:
    OverrunInterpolation(Interpolation interpolation, const ReactionJob* jobs)
        : interpolation_(std::move(interpolation)), jobs_(jobs), shortest_(longest_reaction_steps + 1) {
        for (int m = 0; m < interpolation_.size(); ++m) {
            best_.push_back(overrun(jobs_[m].distance));
            shortest_ = std::min(shortest_, int(jobs_[m].distance.size()));
        }
    }
    // Distance travelled after the reaction to tick k began; NaN where the simulated steps do not reach.
    double at(int k) const {
        const std::vector<int>& node = interpolation_.nodes();
        int m = 0;
        while (m + 2 < interpolation_.size() && node[m + 1] <= k) ++m;
        const int next = std::min(m + 1, interpolation_.size() - 1);
        const int low = std::max(0, std::min(best_[m].argmax, best_[next].argmax) - 1);
        const int high = std::max(best_[m].argmax, best_[next].argmax) + 1;
        if (high >= shortest_) return std::numeric_limits<double>::quiet_NaN();
        double weight[16];
        interpolation_.weights(k, weight);
        double most = 0;
        for (int i = low; i <= high; ++i) {
            double travelled = 0;
            for (int j = 0; j < interpolation_.size(); ++j) {
                travelled += weight[j] * (jobs_[j].distance[i] - jobs_[j].distance[0]);
            }
            most = std::max(most, travelled);
        }
        return most;
    }

  private:
    Interpolation interpolation_;
    const ReactionJob* jobs_;
    std::vector<Overrun> best_;
    int shortest_;
};

// Ticks of one curve whose overrun is found together.
struct Stretch {
    int curve, first, last;
    std::size_t job = 0;  // the first of its jobs
};

// The joint that limits the deceleration at a tick: the one farthest from standstill in units of its own
// limit.
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

// Where another joint takes over as the limiting one, the overrun has a kink. Reactions that begin up to an
// overrun before it cross it on their way. So the ticks are cut there, and those crossing it stand by
// themselves.
inline void cut_at_kinks(const MotionSettings& motion, const Timing& timing, const LinePath& path, int curve,
                         int known, std::vector<Stretch>& stretches) {
    int first = 0;
    for (int k = 1; k < known; ++k) {
        const int limiting = limiting_joint(motion, path, k);
        if (limiting == limiting_joint(motion, path, k - 1)) continue;
        const int j = motion.free_joint[limiting];
        const double qd = path.reaction_state[(std::size_t(2) * k + 1) * motion.free_count + limiting];
        const double stop_time = std::fabs(qd) / motion.acceleration_limit[j];
        const int crossing =
            int(stop_time / (2 * timing.period * motion.step)) + 2 + timing.latency / timing.period;
        const int begin = std::max(first, k - crossing), end = std::min(known - 1, k + 1);
        if (begin > first) stretches.push_back({curve, first, begin - 1});
        if (end >= begin) stretches.push_back({curve, begin, end});
        first = end + 1;
        k = end;
    }
    if (first < known) stretches.push_back({curve, first, known - 1});
}

}  // namespace detail

// Fills `farthest` of `count` curves whose paths are traced. Reactions are simulated at a few ticks of each
// stretch and interpolated between; a stretch where a check between the nodes disagrees is halved, down to
// single ticks. `pose(i)` gives the joint positions curve i started in.
template <class T, class Pose>
void complete_curves(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                     const Timing& timing, ReactionKind kind, StoppingCurve* curves, int count, Pose pose) {
    constexpr int nodes = 6, checks = 2;
    std::vector<detail::Stretch> pending, halves;
    for (int c = 0; c < count; ++c) {
        StoppingCurve& curve = curves[c];
        const LinePath& path = curve.path;
        curve.farthest.assign(path.ticks, 0.0);
        curve.reactions_simulated = 0;
        const int known =
            std::min(path.ticks, int(path.reaction_state.size() / (2 * std::size_t(motion.free_count))));
        // A path that ends before the reaction begins ends for both: the arm stands still there.
        for (int k = known; k < path.ticks; ++k) {
            const auto from = path.s.begin() + std::ptrdiff_t(k) * timing.period + 1;
            curve.farthest[k] = *std::max_element(from, path.s.end());
        }
        if (known > 0) detail::cut_at_kinks(motion, timing, path, c, known, pending);
    }
    std::vector<ReactionJob> jobs;
    while (!pending.empty()) {
        jobs.clear();
        for (detail::Stretch& stretch : pending) {
            stretch.job = jobs.size();
            const int curve = stretch.curve;
            const bool every_tick = stretch.last - stretch.first < nodes + checks;
            const int wanted = every_tick ? stretch.last - stretch.first + 1 : nodes;
            const std::vector<int> tick = interpolation_nodes(stretch.first, stretch.last, wanted);
            for (int k : tick) jobs.push_back({&curves[curve].path, curve, k, {}});
            for (int i = 0; !every_tick && i < checks; ++i) {
                const std::size_t gap =
                    i == 0 ? 1 : nodes / 2;  // where the nodes leave the widest gaps, and near an end
                jobs.push_back({&curves[curve].path, curve, (tick[gap] + tick[gap + 1]) / 2, {}});
            }
        }
        simulate_reactions<T>(
            chain, motion, contact, timing, kind, jobs.data(), int(jobs.size()), true,
            [&](const ReactionJob& job) { return pose(job.curve); },
            [&](const ReactionJob& job) { return job.path->at_tick(job.tick, timing.period); });
        halves.clear();
        for (const detail::Stretch& stretch : pending) {
            StoppingCurve& curve = curves[stretch.curve];
            const LinePath& path = curve.path;
            const ReactionJob* own = &jobs[stretch.job];
            auto place = [&](int k, double travelled) {
                const auto from = path.s.begin() + std::ptrdiff_t(k) * timing.period + 1;
                const double before = *std::max_element(from, from + timing.latency + 1);
                return std::max(before, from[timing.latency] + travelled);
            };
            const int length = stretch.last - stretch.first + 1;
            if (length <= nodes + checks) {
                curve.reactions_simulated += length;
                for (int i = 0; i < length; ++i)
                    curve.farthest[stretch.first + i] =
                        place(stretch.first + i, detail::overrun(own[i].distance).most);
                continue;
            }
            curve.reactions_simulated += nodes + checks;
            const Interpolation interpolation(interpolation_nodes(stretch.first, stretch.last, nodes));
            const detail::OverrunInterpolation overrun(interpolation, own);
            bool smooth = true;
            for (int i = 0; i < checks; ++i) {
                const ReactionJob& check = own[nodes + i];
                const double difference = overrun.at(check.tick) - detail::overrun(check.distance).most;
                smooth = smooth && std::fabs(difference) <= farthest_tolerance;
            }
            for (int k = stretch.first; smooth && k <= stretch.last; ++k) {
                const double travelled = overrun.at(k);
                smooth = smooth && travelled >= 0;
                curve.farthest[k] = place(k, travelled);
            }
            if (smooth) continue;
            const int middle = (stretch.first + stretch.last) / 2;
            halves.push_back({stretch.curve, stretch.first, middle});
            halves.push_back({stretch.curve, middle + 1, stretch.last});
        }
        pending.swap(halves);
    }
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
