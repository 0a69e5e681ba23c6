/// @file
/// Complete distributions of many poses.
#pragma once

#include <atomic>
#include <optional>

#include "bumpstop/collision/collision.hpp"
#include "bumpstop/collision/distribution/cell_mixture.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Poses of a batch, and the velocities they move with.
struct BatchPoses {
    int count = 0;
    const double* q = nullptr;         ///< [pose][dof]
    const double* velocity = nullptr;  ///< [pose][3], m/s
    /// [pose]: force of an elastic arm on a held body that it never detects [N]; null: unbounded.
    const double* pressed_with = nullptr;
};

/// What is computed of every pose.
struct BatchSettings {
    std::vector<double> probability;  ///< of the quantiles
    std::vector<double> limit;        ///< of the exceedances [N]
    int threads = 1;
};

/// Figures of the distributions, an entry or a row for each pose; NaN where nothing could be computed.
struct BatchResult {
    std::vector<double> mean;        ///< peak force [N]
    std::vector<double> sd;          ///< [N]
    std::vector<double> quantile;    ///< [pose][probability]; infinite in the share that is undetected and has no bound
    std::vector<double> exceedance;  ///< [pose][limit]: P(peak force > limit); that share counts as over
    std::vector<double> trigger;     ///< [pose][dof], given detection
    std::vector<double> false_alarm;
    std::vector<double> undetected;
    std::vector<double> no_contact;
    std::vector<std::uint8_t> end;  ///< PathEnd; 255: singular start, nothing computed
    BatchSettings settings;
    std::size_t dof;

    BatchResult(std::size_t poses, std::size_t joints, const BatchSettings& asked)
        : mean(poses, nan),
          sd(poses, nan),
          quantile(poses * asked.probability.size(), nan),
          exceedance(poses * asked.limit.size(), nan),
          trigger(poses * joints, nan),
          false_alarm(poses, nan),
          undetected(poses, nan),
          no_contact(poses, nan),
          end(poses),
          settings(asked),
          dof(joints) {}

  private:
    static constexpr double nan = std::numeric_limits<double>::quiet_NaN();
};
inline constexpr std::uint8_t batch_singular_start = 255;

namespace detail {

struct BatchProblem {
    const CollisionSetup& setup;
    const GaussianThresholds& detector;
    const Contact& contact;  ///< the size of its offset is in seconds of travel, unless it is fixed
    const BatchPoses& poses;
    const BatchSettings& settings;

    LineRequest request(int pose) const {
        const double* v = poses.velocity + 3 * std::size_t(pose);
        return {poses.q + std::size_t(pose) * setup.chain.dof, {v[0], v[1], v[2]}};
    }
    /// The contact of an arm that approaches with a speed [m/s].
    Contact contact_at(double speed) const { return {contact.body, contact.offset.at_speed(speed)}; }
};

/// The poses in descending order of the time in which the slowest joint reaches its rate. Those near a singularity take
/// more steps: they are traced together, and first, so that no thread is left with one at the end.
inline std::vector<int> order_of_work(const BatchProblem& problem) {
    const CollisionSetup& setup = problem.setup;
    const MotionSettings& motion = setup.motion;
    std::vector<double> effort(std::size_t(problem.poses.count));
    for (int pose = 0; pose < problem.poses.count; ++pose) {
        const LineRequest request = problem.request(pose);
        const Rates<double> rates =
            begin_line<double>(setup, request.q, point3<double>(request.velocity), nullptr, 0).rates;
        double most = 0;
        for (int f = 0; f < motion.free_count; ++f)
            most = std::max(most, std::fabs(rates.free[f]) / motion.acceleration_limit[motion.free_joint[f]]);
        effort[std::size_t(pose)] = most;
    }
    std::vector<int> order(effort.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = int(i);
    std::stable_sort(order.begin(), order.end(),
                     [&](int a, int b) { return effort[std::size_t(a)] > effort[std::size_t(b)]; });
    return order;
}

/// Probability of an alarm at every tick in contact with the nearest body, which no other collision exceeds.
template <class L>
std::vector<double> max_alarm_probability(const GaussianThresholds& detector, const Timing& timing,
                                          const LinePath& path, double stiffness) {
    constexpr int lanes = Scalar<L>::lanes;
    std::vector<double> probability(std::size_t(path.ticks), 1.0);
    for (int first = 0; first < path.ticks; first += lanes) {
        L force, torque[max_joints];
        for (int lane = 0; lane < lanes; ++lane) {
            const int k = std::min(first + lane, path.ticks - 1);
            set_lane(force, lane, stiffness * std::max(0.0, path.at_tick(k, timing.period)));
            for (int w = 0; w < detector.monitored; ++w)
                set_lane(torque[w], lane, path.torque_per_N[std::size_t(k) * path.dof + detector.joint[w]]);
        }
        const auto chance = any_alarm<L>(detector, [&](int w) { return torque[w] * force; });
        for (int lane = 0; lane < lanes && first + lane < path.ticks; ++lane)
            probability[std::size_t(first + lane)] = lane_of(chance.alarm, lane);
    }
    return probability;
}

/// Greatest number of poses whose reactions are simulated together: few enough for their distributions to stay in a
/// near cache, many enough to keep all lanes busy.
inline constexpr int max_group_size = 16;
/// Greatest number of registers full of poses that are traced together, so that their paths stay in a near cache.
inline constexpr int max_round_size = 8;

/// Memory that a thread keeps from group to group.
template <class L>
struct BatchWorker {
    BatchWorker(const BatchProblem& problem, const AlarmTable& table, const PreContactAlarms& before) {
        for (int i = 0; i < max_group_size; ++i)
            quadrature.emplace_back(problem.setup, problem.detector, before,
                                    TabulatedAlarms<L>(problem.detector, table), probabilities);
    }
    BatchWorker(const BatchWorker&) = delete;  // its quadratures refer to its probabilities

    DetectionProbabilities probabilities;
    std::vector<OffsetQuadrature<L, TabulatedAlarms<L>>> quadrature;  ///< by place in the group
    std::vector<LinePath> path;                                       ///< of the poses that are traced together
    StoppingCurve curve[max_group_size];
    std::vector<double> probability[max_group_size];
};

/// Writes the figures of a distribution to its place in `out`.
template <class L>
void write_distribution(const BatchProblem& problem, std::size_t pose, const CollisionDistribution& found,
                        BatchResult& out) {
    const std::size_t dof = std::size_t(problem.setup.chain.dof);
    const std::vector<double>&probability = problem.settings.probability, &limit = problem.settings.limit;
    const double most = problem.poses.pressed_with != nullptr ? problem.poses.pressed_with[pose] : HUGE_VAL;
    std::optional<CellMixture> cells;
    if (found.nodes.gives_way) cells = peak_force_mixture<L>(found, most);
    const double total = cells ? cells->total() : 1;
    const Moments force = cells ? cells->moments() : found.moments<L>();
    out.mean[pose] = force.mean;
    out.sd[pose] = force.sd;
    for (std::size_t i = 0; i < limit.size(); ++i)
        out.exceedance[pose * limit.size() + i] =
            cells ? std::min(1.0, cells->above<L>(limit[i]) / total) : found.exceedance<L>(limit[i]);
    for (std::size_t i = 0; i < probability.size(); ++i)
        out.quantile[pose * probability.size() + i] = cells ? cells->upper_quantile<L>((1 - probability[i]) * total)
                                                            : found.upper_quantile<L>(1 - probability[i]);
    // Every detection has a joint that triggered it. Where next to nothing is detected, interpolation may leave less.
    double least = 0, sum = 0;
    for (std::size_t j = 0; j < dof; ++j) {
        least = std::min(least, found.trigger[j]);
        sum += found.trigger[j];
    }
    constexpr double tolerance = 1e-3;
    const bool known = least > -tolerance * found.detected && sum > (1 - tolerance) * found.detected;
    for (std::size_t j = 0; j < dof; ++j)
        out.trigger[pose * dof + j] = known ? std::clamp(found.trigger[j] / found.detected, 0.0, 1.0) : NAN;
    out.false_alarm[pose] = found.false_alarm;
    out.undetected[pose] = found.undetected;
    out.no_contact[pose] = found.no_contact;
}

/// A pose with dynamic contact: a single distribution.
template <class L>
void write_dynamic(const BatchProblem& problem, int pose, BatchResult& out) {
    const LineRequest request = problem.request(pose);
    const StoppingCurve curve =
        stopping_curve<L>(problem.setup, request, &problem.detector, problem.contact_at(request.speed()));
    const LinePath& path = curve.path;
    const Contact contact = problem.contact_at(path.approach_speed);
    out.end[std::size_t(pose)] = path.singular_start ? batch_singular_start : std::uint8_t(path.end);
    if (path.singular_start) return;
    write_distribution<L>(problem, std::size_t(pose),
                          integrate<L>(problem.setup, curve, problem.detector, {contact, 1, true}), out);
}

/// The paths of `count` poses into worker.path.
template <class L>
void trace_poses(const BatchProblem& problem, BatchWorker<L>& worker, const int* poses, int count) {
    std::vector<LineRequest> requests;
    std::vector<SurvivalCriterion<L>> criteria;
    auto add = [&](int i) {
        requests.push_back(problem.request(poses[i]));
        // The approach speed is the tool's own speed along its line.
        criteria.emplace_back(problem.setup, problem.detector, problem.contact_at(requests.back().speed()));
    };
    for (int i = 0; i < count; ++i) add(i);
    worker.path.resize(std::max(worker.path.size(), std::size_t(count)));
    LineTracer<L, SurvivalCriterion<L>>(problem.setup, batch_line)
        .trace(requests.data(), criteria.data(), worker.path.data(), count);
    // Near a singularity the error of an Adams step decides where the arm goes, and whether it reaches the singularity:
    // such poses are traced again as exactly as a single distribution.
    std::vector<int> again;
    for (int i = 0; i < count; ++i)
        if (worker.path[std::size_t(i)].met_singularity && !worker.path[std::size_t(i)].singular_start)
            again.push_back(i);
    if (again.empty()) return;
    requests.clear();
    criteria.clear();
    for (int i : again) add(i);
    std::vector<LinePath> path(again.size());
    LineTracer<L, SurvivalCriterion<L>>(problem.setup)
        .trace(requests.data(), criteria.data(), path.data(), int(again.size()));
    for (std::size_t i = 0; i < again.size(); ++i) worker.path[std::size_t(again[i])] = std::move(path[i]);
}

/// The distributions of poses whose paths are traced.
template <class L>
void batch_group(const BatchProblem& problem, BatchWorker<L>& worker, bool tabulated, const int* poses, LinePath* path,
                 int count, BatchResult& out) {
    StoppingCurve* curve = worker.curve;
    QuadratureSettings settings[max_group_size];
    bool detected[max_group_size];
    for (int i = 0; i < count; ++i) {
        std::swap(curve[i].path, path[i]);  // so that both keep their memory
        const LinePath& traced = curve[i].path;
        settings[i] = {problem.contact_at(traced.approach_speed), 1, true};
        detected[i] = tabulated && traced.ticks > 0 && worker.quadrature[std::size_t(i)].detect(traced, settings[i]);
        worker.probability[i] = detected[i] ? worker.quadrature[std::size_t(i)].detection()
                                            : max_alarm_probability<L>(problem.detector, problem.setup.timing, traced,
                                                                       problem.contact.body.stiffness);
    }
    complete_curves<L>(problem.setup, curve, count,
                       [&](int c) { return OvertravelTolerance{worker.probability[c].data()}; });
    for (int i = 0; i < count; ++i) {
        const std::size_t pose = std::size_t(poses[i]);
        const LinePath& done = curve[i].path;
        out.end[pose] = done.singular_start ? batch_singular_start : std::uint8_t(done.end);
        if (done.singular_start) continue;
        if (detected[i]) {
            worker.quadrature[std::size_t(i)].finish(curve[i].max_distance);
            write_distribution<L>(problem, pose, worker.quadrature[std::size_t(i)].result(), out);
        } else {
            write_distribution<L>(problem, pose, integrate<L>(problem.setup, curve[i], problem.detector, settings[i]),
                                  out);
        }
    }
}

}  // namespace detail

/// The distributions of all poses. The size of the offset is in seconds of travel unless it is fixed.
/// Threads take rounds of poses; a pose's figures do not depend on its thread or round.
template <class L>
BatchResult evaluate_batch(const CollisionSetup& setup, const GaussianThresholds& detector, const Contact& contact,
                           const BatchPoses& poses, const BatchSettings& settings) {
    constexpr int lanes = Scalar<L>::lanes;
    const detail::BatchProblem problem{setup, detector, contact, poses, settings};
    BatchResult out(std::size_t(poses.count), std::size_t(setup.chain.dof), settings);
    if (setup.arm || contact.system()) {
        std::atomic<int> next{0};
        work_in_threads(settings.threads, [&] {
            for (int pose = next++; pose < poses.count; pose = next++) detail::write_dynamic<L>(problem, pose, out);
        });
        return out;
    }
    const std::vector<int> order = detail::order_of_work(problem);
    const AlarmTable table(detector);
    const bool tabulated = !detector.correlated_noise() && detector.monitored > 0 && table.usable() &&
                           contact.offset.kind != OffsetKind::fixed;
    const int ticks = (setup.timing.steps + setup.timing.period - 1) / setup.timing.period;
    const PreContactAlarms before(setup, detector, tabulated ? ticks : 0);
    // A lane takes the next pose as soon as its line ends, so long rounds keep lanes busy, short ones threads.
    const int share = poses.count / (8 * settings.threads * lanes);
    const int round = lanes * std::clamp(share, 1, detail::max_round_size);
    std::atomic<int> next{0};
    work_in_threads(settings.threads, [&] {
        detail::BatchWorker<L> worker(problem, table, before);
        for (int begin = round * next++; begin < poses.count; begin = round * next++) {
            const int end = std::min(begin + round, poses.count);
            detail::trace_poses(problem, worker, &order[std::size_t(begin)], end - begin);
            for (int first = begin; first < end; first += detail::max_group_size)
                detail::batch_group<L>(problem, worker, tabulated, &order[std::size_t(first)],
                                       &worker.path[std::size_t(first - begin)],
                                       std::min(detail::max_group_size, end - first), out);
        }
    });
    return out;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
