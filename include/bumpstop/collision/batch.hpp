/// @file
/// Complete distributions of many poses.
#pragma once

#include <atomic>

#include "bumpstop/collision/distribution/offset_quadrature.hpp"
#include "bumpstop/collision/distribution/survival_criterion.hpp"
#include "bumpstop/collision/motion/line_tracer.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What a batch keeps of every law; one entry (or row) a pose.
struct BatchResult {
    double* mean;        ///< peak force [N]
    double* sd;          ///< [N]
    double* quantile;    ///< [pose][probability]; infinite in the share that is never detected and has no bound
    double* exceedance;  ///< [pose][limit]: P(peak force > limit); that share counts as over
    double* trigger;     ///< [pose][dof], given detection
    double* false_alarm;
    double* undetected;
    double* no_contact;
    std::uint8_t* end;  ///< PathEnd; 255: singular start, nothing computed
};
inline constexpr std::uint8_t batch_singular_start = 255;

struct BatchProblem {
    const Chain* chain;
    const MotionSettings* motion;
    const ContactGeometry* contact;
    const Timing* timing;
    ReactionKind reaction;
    const GaussianThresholds* detector;
    double stiffness;  ///< N/m
    OffsetKind offset_kind;
    double offset_size;  ///< half-normal: sd in seconds of travel; uniform: upper end likewise; fixed: m
    int poses;
    const double* q;         ///< [pose][dof]
    const double* velocity;  ///< [pose][3], m/s
    int probabilities;
    const double* probability;
    int limits;
    const double* limit;  ///< N
};

namespace detail {

/// The poses by how hard their start works the joints: by the time the slowest needs to get to its rate. Poses near a
/// singularity take more steps.
inline std::vector<int> order_of_work(const BatchProblem& problem) {
    const int dof = problem.chain->dof;
    std::vector<double> effort(std::size_t(problem.poses));
    for (int pose = 0; pose < problem.poses; ++pose) {
        ArmState<double> state;
        for (int j = 0; j < dof; ++j) state.q[j] = problem.q[std::size_t(pose) * dof + j];
        state.refresh_angles(*problem.chain);
        Posture<double> posture;
        forward_kinematics(*problem.chain, state.q, state.angle, posture);
        const double* v = problem.velocity + 3 * std::size_t(pose);
        const Rates<double> rates =
            resolved_rates(*problem.chain, *problem.motion, posture, Point3<double>{v[0], v[1], v[2]});
        double most = 0;
        for (int f = 0; f < problem.motion->free_count; ++f)
            most = std::max(
                most, std::fabs(rates.free[f]) / problem.motion->acceleration_limit[problem.motion->free_joint[f]]);
        effort[std::size_t(pose)] = most;
    }
    std::vector<int> order(effort.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = int(i);
    // Hard ones first, so that no thread is left with one at the end.
    std::stable_sort(order.begin(), order.end(),
                     [&](int a, int b) { return effort[std::size_t(a)] > effort[std::size_t(b)]; });
    return order;
}

/// The probability of an alarm at every tick when the body is as near as it can be: no collision's is greater.
template <class L>
std::vector<double> most_alarm(const GaussianThresholds& detector, const Timing& timing, const LinePath& path,
                               double stiffness) {
    constexpr int lanes = Scalar<L>::lanes;
    std::vector<double> probability(std::size_t(path.ticks), 1.0);
    for (int first = 0; first < path.ticks; first += lanes) {
        L force, torque[max_joints];
        for (int lane = 0; lane < lanes; ++lane) {
            const int k = std::min(first + lane, path.ticks - 1);
            set_lane(force, lane, stiffness * std::max(0.0, path.at_tick(k, timing.period)));
            for (int w = 0; w < detector.watched; ++w)
                set_lane(torque[w], lane, path.torque_per_N[std::size_t(k) * path.dof + detector.joint[w]]);
        }
        const auto chance = any_alarm<L>(detector, [&](int w) { return torque[w] * force; });
        for (int lane = 0; lane < lanes && first + lane < path.ticks; ++lane)
            probability[std::size_t(first + lane)] = lane_of(chance.alarm, lane);
    }
    return probability;
}

/// Poses whose reactions are simulated together: few for their laws to stay in a near cache, many for lanes to have a next
/// one while others still follow their last.
inline constexpr int longest_group = 16;
/// Registers full of poses that are traced together at most: their paths stay near.
inline constexpr int longest_round = 8;

/// What a thread keeps from group to group.
template <class L>
struct BatchWorker {
    BatchWorker(const BatchProblem& problem, const AlarmTable& table, const PreContactAlarms& before) {
        for (int i = 0; i < longest_group; ++i)
            quadrature.emplace_back(*problem.timing, *problem.motion, *problem.detector, before,
                                    TabulatedAlarms<L>(*problem.detector, table), probabilities);
    }
    BatchWorker(const BatchWorker&) = delete;  // its quadratures know where its probabilities are

    DetectionProbabilities probabilities;
    std::vector<OffsetQuadrature<L, TabulatedAlarms<L>>> quadrature;  ///< by place in the group
    std::vector<LinePath> path;                                       ///< of the poses that are traced together
    StoppingCurve curve[longest_group];
    std::vector<double> probability[longest_group];
};

/// A pose whose path could not begin.
inline void write_nothing(const BatchProblem& problem, std::size_t pose, const BatchResult& out) {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const int dof = problem.chain->dof;
    for (double* value : {out.mean, out.sd, out.false_alarm, out.undetected, out.no_contact}) value[pose] = nan;
    std::fill_n(out.quantile + pose * problem.probabilities, problem.probabilities, nan);
    std::fill_n(out.exceedance + pose * problem.limits, problem.limits, nan);
    std::fill_n(out.trigger + pose * dof, dof, nan);
}

template <class L>
void write_distribution(const BatchProblem& problem, std::size_t pose, PathEnd end, const CollisionDistribution& found,
                        const BatchResult& out) {
    const bool endless = found.undetected > 1e-12 && end == PathEnd::horizon;
    const int dof = problem.chain->dof;
    const Moments force = peak_force_moments(found);
    out.mean[pose] = endless ? std::numeric_limits<double>::infinity() : force.mean;
    out.sd[pose] = endless ? std::numeric_limits<double>::quiet_NaN() : force.sd;
    for (int i = 0; i < problem.limits; ++i)
        out.exceedance[pose * problem.limits + i] = peak_force_over<L>(found, problem.limit[i]);
    for (int i = 0; i < problem.probabilities; ++i)
        out.quantile[pose * problem.probabilities + i] =
            peak_force_upper_quantile<L>(found, 1 - problem.probability[i]);
    const double given = found.detected > 0 ? found.detected : std::numeric_limits<double>::quiet_NaN();
    for (int j = 0; j < dof; ++j) out.trigger[pose * dof + j] = found.trigger[j] / given;
    out.false_alarm[pose] = found.false_alarm;
    out.undetected[pose] = found.undetected;
    out.no_contact[pose] = found.no_contact;
}

/// The paths of `count` poses into worker.path.
template <class L>
void trace_poses(const BatchProblem& problem, BatchWorker<L>& worker, const int* poses, int count) {
    const Timing& timing = *problem.timing;
    using P = Unfused<L>;  // loose leaps enlarge what instruction sets round otherwise
    std::vector<LineRequest> requests;
    std::vector<SurvivalCriterion<P>> criteria;
    auto add = [&](int i) {
        const double* v = problem.velocity + 3 * std::size_t(poses[i]);
        // The offset's size follows from the approach speed, which is the tool's own speed along its line.
        const double speed = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        const double size = problem.offset_size * (problem.offset_kind == OffsetKind::fixed ? 1.0 : speed);
        requests.push_back({problem.q + std::size_t(poses[i]) * problem.chain->dof, {v[0], v[1], v[2]}});
        criteria.emplace_back(*problem.detector, timing, problem.motion->step, problem.stiffness,
                              OffsetDistribution{problem.offset_kind, size}.largest());
    };
    for (int i = 0; i < count; ++i) add(i);
    worker.path.resize(std::max(worker.path.size(), std::size_t(count)));
    LineTracer<P, Tracing::fast, SurvivalCriterion<P>>(*problem.chain, *problem.motion, *problem.contact, timing)
        .trace(requests.data(), criteria.data(), worker.path.data(), count);
    // Near a singularity what a leap leaves out decides where the arm goes, and whether it meets the singularity: there a
    // batch traces as a single law does.
    std::vector<int> again;
    for (int i = 0; i < count; ++i)
        if (worker.path[std::size_t(i)].met_singularity && !worker.path[std::size_t(i)].singular_start)
            again.push_back(i);
    if (again.empty()) return;
    requests.clear();
    criteria.clear();
    for (int i : again) add(i);
    std::vector<LinePath> path(again.size());
    LineTracer<P, Tracing::exact, SurvivalCriterion<P>>(*problem.chain, *problem.motion, *problem.contact, timing)
        .trace(requests.data(), criteria.data(), path.data(), int(again.size()));
    for (std::size_t i = 0; i < again.size(); ++i) worker.path[std::size_t(again[i])] = std::move(path[i]);
}

/// The distributions of poses whose paths are traced.
template <class L>
void batch_group(const BatchProblem& problem, BatchWorker<L>& worker, bool tabulated, const int* poses, LinePath* path,
                 int count, const BatchResult& out) {
    const int dof = problem.chain->dof;
    StoppingCurve* curve = worker.curve;
    QuadratureSettings settings[longest_group];
    bool detected[longest_group];
    for (int i = 0; i < count; ++i) {
        std::swap(curve[i].path, path[i]);  // both keep their memory for the next pose
        const LinePath& traced = curve[i].path;
        const double size =
            problem.offset_size * (problem.offset_kind == OffsetKind::fixed ? 1.0 : traced.approach_speed);
        settings[i] = {problem.stiffness, {problem.offset_kind, size}, 1, false};
        detected[i] = tabulated && traced.ticks > 0 && worker.quadrature[std::size_t(i)].detect(traced, settings[i]);
        worker.probability[i] = detected[i]
                                    ? worker.quadrature[std::size_t(i)].detection()
                                    : most_alarm<L>(*problem.detector, *problem.timing, traced, problem.stiffness);
    }
    complete_curves<L>(
        *problem.chain, *problem.motion, *problem.contact, *problem.timing, problem.reaction, curve, count,
        [&](int c) { return problem.q + std::size_t(poses[c]) * dof; },
        [&](int c) { return OvertravelTolerance{worker.probability[c].data()}; });
    for (int i = 0; i < count; ++i) {
        const std::size_t pose = std::size_t(poses[i]);
        const LinePath& done = curve[i].path;
        out.end[pose] = done.singular_start ? batch_singular_start : std::uint8_t(done.end);
        if (done.singular_start) {
            write_nothing(problem, pose, out);
        } else if (detected[i]) {
            worker.quadrature[std::size_t(i)].finish(curve[i].farthest);
            write_distribution<L>(problem, pose, done.end, worker.quadrature[std::size_t(i)].result(), out);
        } else {
            write_distribution<L>(
                problem, pose, done.end,
                integrate<L>(curve[i], *problem.timing, *problem.motion, *problem.detector, settings[i]), out);
        }
    }
}

}  // namespace detail

/// All poses, in rounds handed to `threads` threads. Which thread takes a round, and which poses are in it, does not touch
/// a pose's numbers.
template <class L>
void evaluate_batch(const BatchProblem& problem, int threads, const BatchResult& out) {
    constexpr int lanes = Scalar<L>::lanes;
    const std::vector<int> order = detail::order_of_work(problem);
    const AlarmTable table(*problem.detector);
    const bool tabulated = !problem.detector->remembers() && problem.detector->watched > 0 && table.usable() &&
                           problem.offset_kind != OffsetKind::fixed;
    const int ticks = (problem.timing->steps + problem.timing->period - 1) / problem.timing->period;
    const PreContactAlarms before(*problem.detector, *problem.timing, problem.motion->step, tabulated ? ticks : 0);
    // Lanes that follow their lines take one pose after another, so a round is best long, and short enough for no thread to
    // be left with the last.
    const int share = problem.poses / (8 * threads * lanes);
    const int round = lanes * std::clamp(share, 1, detail::longest_round);
    std::atomic<int> next{0};
    work_in_threads(threads, [&] {
        detail::BatchWorker<L> worker(problem, table, before);
        for (int begin = round * next++; begin < problem.poses; begin = round * next++) {
            const int end = std::min(begin + round, problem.poses);
            detail::trace_poses(problem, worker, &order[std::size_t(begin)], end - begin);
            for (int first = begin; first < end; first += detail::longest_group)
                detail::batch_group<L>(problem, worker, tabulated, &order[std::size_t(first)],
                                       &worker.path[std::size_t(first - begin)],
                                       std::min(detail::longest_group, end - first), out);
        }
    });
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
