// The collision kernels under the address and undefined-behaviour sanitizers: ordinary and awkward cases, each checked by
// a property it must have.
#include <cstdio>
#include <cstdlib>

#include "bumpstop/collision/batch.hpp"
#include "bumpstop/collision/collision.hpp"
#include "bumpstop/collision/distribution/tail_without_interpolation.hpp"
#include "bumpstop/collision/trajectory/onset_monte_carlo.hpp"

using namespace bumpstop;
using L = Lanes<native_lanes>;

namespace {

void require(bool holds, const char* what) {
    if (holds) return;
    std::fprintf(stderr, "failed: %s\n", what);
    std::exit(1);
}

struct Arm : CollisionSetup {
    GaussianThresholds detector;
    std::array<double, max_joints> q{};
};

// A general chain of `dof` joints, one of them prismatic.
Arm make_arm(int dof, int rows) {
    std::array<JointSpec, max_joints> specs{};
    Arm arm;
    for (int i = 0; i < dof; ++i) {
        const double a = 0.4 + 1.1 * i, b = 0.2 + 0.7 * i;
        specs[i].prismatic = i == 2 && dof > 6;
        specs[i].origin = {0.1, 0.02 * i, 0.15};
        specs[i].axis = {std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a)};
        arm.q[i] = 0.3 + 0.25 * i;
    }
    arm.chain = Chain(std::span<const JointSpec>(specs.data(), std::size_t(dof)));
    arm.motion.tip = link_point(arm.chain, dof - 1, {0.0, 0.05, 0.1});
    arm.motion.task_rows = rows;
    arm.motion.free_count = dof;
    for (int j = 0; j < dof; ++j) {
        arm.motion.free_joint[j] = j;
        arm.motion.acceleration_limit[j] = 5;
        arm.motion.velocity_limit[j] = 3;
        arm.motion.lower[j] = arm.q[j] - 0.5;
        arm.motion.upper[j] = arm.q[j] + 0.5;
        arm.detector.add_joint(15, j % 2 == 0 ? 2.5 : 0.0, 0.1 * j);
    }
    arm.contact.point = arm.motion.tip;
    arm.timing.steps = 300;
    return arm;
}

void check_case(const Arm& arm, OffsetDistribution offset) {
    const Contact contact{{20000}, offset};
    const StoppingCurve curve = stopping_curve<L>(arm, {arm.q.data(), {0.03, -0.02, 0.04}}, &arm.detector, contact);
    for (int k = 0; k < curve.path.ticks; ++k)
        require(curve.max_distance[k] >= curve.path.at_tick(k, arm.timing.period) - 1e-12,
                "the farthest point is ahead");
    const CollisionDistribution law = integrate<L>(arm, curve, arm.detector, {contact});
    const double total = law.peak_force.total + law.zero_force + law.unbounded();
    require(std::fabs(total - 1) < 1e-8, "probabilities add up");
    const double half = tail<L>(law.density, law.peak_force, 20).probability;
    const double direct = tail_without_interpolation<L>(arm, curve, arm.detector, contact, 20);
    require(std::fabs(half - direct) < 1e-6, "two routes to a tail");

    constexpr int runs = 1025;
    const MonteCarloRuns drawn = monte_carlo<L>(arm, curve, arm.detector, contact, {.seed = 42, .count = runs});
    double over = 0;
    const double end = curve.path.max_distance(std::size_t(arm.timing.steps));
    for (int i = 0; i < runs; ++i) {
        const int tick = drawn.tick[i];
        require((tick >= 0) == (drawn.triggers[i] != 0), "a detected run has a joint that detected it");
        // An arm that comes to rest has a force for what it never detects, too.
        if (tick < 0 && !law.rests) continue;
        over += 20000 * ((tick < 0 ? end : curve.max_distance[tick]) - drawn.offset[i]) > 20;
    }
    require(std::fabs(over / runs - half) < 5 * std::sqrt(0.25 / runs), "exact and sampled agree");
}

// Correlated noise, an observer, and a body that nothing holds.
void check_memory_and_free_contact(Arm arm) {
    const Contact contact{{20000, 0, 3.0}, {OffsetKind::uniform, 0.0005}};
    arm.timing.steps = 60;
    for (const auto& [correlation, filter] : {std::pair{0.0, 0.0}, std::pair{0.6, 0.7}}) {
        arm.detector.correlation = correlation;
        arm.detector.filter = filter;
        check_case(arm, {OffsetKind::fixed, 0.0004});
        const StoppingCurve curve = stopping_curve<L>(arm, {arm.q.data(), {0.03, -0.02, 0.04}}, &arm.detector, contact);
        const CollisionDistribution law = integrate<L>(arm, curve, arm.detector, {contact});
        // No body is struck harder than by an arm that never reacts.
        const double most = curve.path.approach_speed * std::sqrt(contact.body.stiffness * contact.body.mass) * 1.01;
        for (double force : law.nodes.peak_force) require(force <= most && force >= 0, "free contact is bounded");

        constexpr int runs = 129;
        const ResidualRecord record{std::vector<double>(std::size_t(40) * arm.chain.dof, 0.5), 40, 7};
        for (const ResidualRecord* noise_of : {static_cast<const ResidualRecord*>(nullptr), &record}) {
            const MonteCarloRuns drawn =
                monte_carlo<L>(arm, curve, arm.detector, contact, {.seed = 42, .count = runs}, noise_of);
            for (double peak : drawn.peak_force) require(peak <= most && peak >= 0, "so are single runs");
        }
    }
}

void check_batch(const Arm& arm) {
    constexpr int poses = 7;
    const int dof = arm.chain.dof;
    std::vector<double> q, velocity;
    for (int i = 0; i < poses; ++i) {
        for (int j = 0; j < dof; ++j) q.push_back(arm.q[j] + 0.02 * i);
        velocity.insert(velocity.end(), {0.02, 0.01 * i, 0.03});
    }
    const BatchResult found = evaluate_batch<L>(arm, arm.detector, {{20000}, {OffsetKind::half_normal, 0.05}},
                                                {poses, q.data(), velocity.data()}, {{0.5, 0.99}, {50.0}, 2});
    const std::vector<double>& quantile = found.quantile;
    for (int i = 0; i < poses; ++i) require(quantile[2 * i] <= quantile[2 * i + 1], "quantiles are in order");
}

// A motion of two cubics from rest to rest, hit at its very beginning, near its end and between.
void check_trajectory(const Arm& arm, double duration) {
    const int dof = arm.chain.dof;
    JointSpline spline;
    spline.dof = dof;
    spline.time = {0, duration / 2, duration};
    for (int piece = 0; piece < 2; ++piece) {
        // q = start + way (3 x^2 - 2 x^3), in powers of the time since the piece began.
        const double x = piece * 0.5, d = duration;
        const double power[4] = {-2 / (d * d * d), (3 - 6 * x) / (d * d), (6 * x - 6 * x * x) / d,
                                 3 * x * x - 2 * x * x * x};
        for (int c = 0; c < 4; ++c)
            for (int j = 0; j < dof; ++j)
                spline.coefficient.push_back(0.2 * duration * power[c] + (c == 3 ? arm.q[j] : 0));
    }
    const ArmTrajectory trajectory(arm, spline);
    const PreContactAlarms before(trajectory.setup(), arm.detector, trajectory.ticks());
    for (double share : {0.001, 0.3, 0.5, 0.8, 0.999}) {
        const double begin = share * duration, h = 1e-6 * duration;
        const Point3<double> way = trajectory.point_at(begin + h) - trajectory.point_at(begin - h);
        const double length = std::sqrt(dot(way, way));
        const Point3<double> normal{way.x / length, way.y / length, way.z / length};
        for (double mass : {2.0, 0.0}) {
            const Contact contact{{20000, 0, mass}};
            const auto by = propagator_of(contact.system(), trajectory.step());
            const OnsetDistribution law =
                integrate_onset<L>(trajectory, begin, normal, arm.detector, contact, by ? &*by : nullptr, before);
            double all = law.zero_force + law.undetected;
            for (const OnsetDistribution::Detection& one : law.detection) {
                all += one.probability;
                require(one.peak >= 0 && one.duration >= 0, "free contact is bounded");
            }
            require(std::fabs(all - 1) < 1e-8, "probabilities add up");
        }
        const OnsetDistribution law =
            integrate_onset<L>(trajectory, begin, normal, arm.detector, {{20000}}, nullptr, before);
        double total = law.zero_force + law.undetected;
        for (const OnsetDistribution::Detection& one : law.detection) {
            total += one.probability;
            require(one.tick >= 0 && one.tick < trajectory.ticks(), "detections are at ticks");
            require(one.max_distance >= one.distance, "the farthest point is ahead");
            if (arm.reaction != ReactionKind::reverse || !(one.max_distance > 0)) continue;
            require(trajectory.contact_duration(one.tick, begin) > 0, "a reversing arm lets go");
            require(trajectory.reaction_distances(one.tick, begin, normal).back() <= 0, "and is back before the body");
        }
        require(std::fabs(total - 1) < 1e-8, "probabilities add up");
    }
}

}  // namespace

int main() {
    for (const auto& [dof, rows] : {std::pair{6, 6}, std::pair{8, 6}, std::pair{4, 3}}) {
        Arm arm = make_arm(dof, rows);
        for (ReactionKind reaction : {ReactionKind::stop, ReactionKind::reverse}) {
            arm.reaction = reaction;
            check_case(arm, {OffsetKind::half_normal, 0.004});
            check_case(arm, {OffsetKind::uniform, 0.0003});
            check_case(arm, {OffsetKind::fixed, 0.0011});
            for (double duration : {0.0015, 0.05, 0.9}) check_trajectory(arm, duration);
            arm.timing.latency = 3;
            arm.timing.from_rest = !arm.timing.from_rest;
        }
        check_batch(arm);
        if (dof == 6) check_memory_and_free_contact(arm);
        // A motion that ends at a joint limit before the body is reached.
        arm.motion.upper[0] = arm.q[0] + 0.001;
        arm.motion.lower[0] = arm.q[0] - 0.001;
        check_case(arm, {OffsetKind::half_normal, 0.004});
    }
    return 0;
}
