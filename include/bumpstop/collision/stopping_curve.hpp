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
inline constexpr double farthest_tolerance = 5e-10;

namespace detail {

// Distance still travelled after the reaction began: the greatest at a simulation step.
inline double overrun(const std::vector<double>& distance) {
    return *std::max_element(distance.begin(), distance.end()) - distance[0];
}

// The overrun near its greatest value as a cubic in time, about the top: top + bend/2 d^2 + skew/6 d^3, where
// d is the time since `time`, both in simulation steps.
struct Summit {
    double time, top, bend, skew;

    // The greatest value at a whole step.
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

// The summit of a reaction's travel, from the four steps about it; NaN where there is none, because the
// travel has no interior maximum.
inline Summit summit(const std::vector<double>& distance) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const int n = int(distance.size());
    const int peak = int(std::max_element(distance.begin(), distance.end()) - distance.begin());
    if (peak == 0 || peak + 1 >= n || n < 4) return {nan, nan, nan, nan};
    const int first = std::min(std::max(0, peak - 1), n - 4);
    // Newton's form on the steps first .. first + 3, then powers of x = time - first.
    double y[4];
    for (int i = 0; i < 4; ++i) y[i] = distance[first + i] - distance[0];
    const double d1 = y[1] - y[0], d2 = (y[2] - 2 * y[1] + y[0]) / 2,
                 d3 = (y[3] - 3 * y[2] + 3 * y[1] - y[0]) / 6;
    const double c1 = d1 - d2 + 2 * d3, c2 = d2 - 3 * d3, c3 = d3;
    double x = peak - first;
    for (int i = 0; i < 20; ++i) {
        const double step = (c1 + x * (2 * c2 + 3 * c3 * x)) / (2 * c2 + 6 * c3 * x);
        x -= step;
        if (std::fabs(step) < 1e-14) break;
    }
    return {first + x, y[0] + x * (c1 + x * (c2 + x * c3)), 2 * c2 + 6 * c3 * x, 6 * c3};
}

// The overrun at tick k from reactions simulated at a few ticks. Its greatest value over the simulation steps
// is not smooth in the tick, as the steps fall differently about the summit; the summit is.
class OverrunInterpolation {
  public:
    OverrunInterpolation(Interpolation interpolation, const ReactionJob* jobs)
        : interpolation_(std::move(interpolation)) {
        for (int m = 0; m < interpolation_.size(); ++m) summit_.push_back(summit(jobs[m].distance));
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
    Interpolation interpolation_;
    std::vector<Summit> summit_;
};

// Ticks of one curve whose overrun is found together.
struct Stretch {
    int curve, first, last;
    bool crosses_kink = false;  // not to be interpolated
    std::size_t job = 0;        // the first of its jobs

    int ticks() const { return last - first + 1; }
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
        if (end >= begin) stretches.push_back({curve, begin, end, true});
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
            const bool every_tick = stretch.crosses_kink || stretch.ticks() <= nodes + checks;
            const int wanted = every_tick ? stretch.ticks() : nodes;
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
            if (stretch.crosses_kink || stretch.ticks() <= nodes + checks) {
                curve.reactions_simulated += stretch.ticks();
                for (int i = 0; i < stretch.ticks(); ++i)
                    curve.farthest[stretch.first + i] =
                        place(stretch.first + i, detail::overrun(own[i].distance));
                continue;
            }
            curve.reactions_simulated += nodes + checks;
            const Interpolation interpolation(interpolation_nodes(stretch.first, stretch.last, nodes));
            const detail::OverrunInterpolation overrun(interpolation, own);
            bool smooth = true;
            for (int i = 0; i < checks; ++i) {
                const ReactionJob& check = own[nodes + i];
                const double difference = overrun.at(check.tick) - detail::overrun(check.distance);
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
