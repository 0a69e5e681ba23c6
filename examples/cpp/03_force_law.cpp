// The force law of examples/01_hand_downward.toml, from the chain to the quantiles.
#include <cstdio>
#include <fstream>
#include <numbers>

#include "bumpstop/collision/distribution/offset_quadrature.hpp"
#include "bumpstop/collision/distribution/survival_criterion.hpp"
#include "bumpstop/collision/motion/line_tracer.hpp"
#include "bumpstop/model/robot_description.hpp"

using namespace bumpstop;
using L = Lanes<native_lanes>;

int main(int count, char** arguments) {
    std::ifstream file(count > 1 ? arguments[1] : "sia5d.robot");
    std::string error;
    const auto robot = read_robot(file, error);
    if (!robot) {
        std::fprintf(stderr, "error: %s\n", error.c_str());
        return 2;
    }
    const Chain chain = robot->chain();

    // The motion: 50 mm/s straight down, orientation held, joint 7 held.
    const double degree = std::numbers::pi / 180;
    double q[max_joints] = {0, 30 * degree, 0, -20 * degree, 0, -40 * degree, 0};
    MotionSettings motion;
    motion.tip = robot->tip(chain);
    motion.free_count = 6;
    for (int j = 0; j < chain.dof; ++j) {
        motion.free_joint[j] = j;
        motion.acceleration_limit[j] = 4.5;  // rad/s2
        motion.velocity_limit[j] = robot->joints[j].velocity;
        motion.lower[j] = robot->joints[j].lower;
        motion.upper[j] = robot->joints[j].upper;
    }
    ContactGeometry contact;
    contact.point = motion.tip;
    const Timing timing;  // 1 ms steps, feedback every fourth

    // The detector: thresholds of five and a half standard deviations.
    GaussianThresholds detector;
    for (int j = 0; j < chain.dof; ++j) {
        const double threshold = j == 1 ? 10 : 20, sd = j == 1 ? 1.818 : 3.636;  // Nm
        detector.noise_sd[j] = sd;
        detector.watch(j, threshold, sd, 0);
    }

    // The stopping curve, then the law: a clamped hand, a half-normal distance away.
    const double stiffness = 75000, offset_sd = 0.1 * 0.05;  // N/m, m
    StoppingCurve curve;
    const SurvivalCriterion<L> criterion(detector, timing, motion.step, stiffness, 7 * offset_sd);
    curve.path = trace_line<L>(chain, motion, contact, timing, {q, {0, 0, -0.05}}, criterion);  // m/s
    complete_curves<L>(
        chain, motion, contact, timing, ReactionKind::reverse, &curve, 1, [&](int) { return q; },
        [](int) { return OvertravelTolerance{}; });
    QuadratureSettings settings;
    settings.stiffness = stiffness;
    settings.offset = {OffsetKind::half_normal, offset_sd};
    const CollisionDistribution law = integrate<L>(curve, timing, motion, detector, settings);

    const Moments force = peak_force_moments(law);
    std::printf("peak force: mean %.9f N, sd %.9f N\n", force.mean, force.sd);
    struct Quantile {
        const char* name;
        double p;
    };
    for (const auto& [name, p] : {Quantile{"p50", 0.5}, {"p95", 0.95}, {"p99", 0.99}, {"p999", 0.999}})
        std::printf("%s: %.9f N\n", name, peak_force_upper_quantile<L>(law, 1 - p));
    std::printf("over 135 N: %.3e\n", peak_force_over<L>(law, 135.0));
    std::printf("false alarm before contact: %.3e\n", law.false_alarm);
}
