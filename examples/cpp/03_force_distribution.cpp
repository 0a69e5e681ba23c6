// The force distribution of examples/01_hand_downward.toml, from the robot to the quantiles.
#include <cstdio>
#include <fstream>
#include <numbers>

#include "bumpstop/bumpstop.hpp"

int main(int count, char** arguments) {
    std::ifstream file(count > 1 ? arguments[1] : "sia5d.robot");
    std::string error;
    const auto robot = bumpstop::read_robot(file, error);
    if (!robot) {
        std::fprintf(stderr, "error: %s\n", error.c_str());
        return 2;
    }

    // The motion: 50 mm/s straight down, orientation held, joint 7 held.
    auto setup = bumpstop::line_setup(*robot, 4.5);  // rad/s2
    setup.motion.free_count = 6;
    const double degree = std::numbers::pi / 180;
    const double q[] = {0, 30 * degree, 0, -20 * degree, 0, -40 * degree, 0};

    // The detector: thresholds of five and a half standard deviations.
    bumpstop::GaussianThresholds detector;
    for (int j = 0; j < 7; ++j) detector.add_joint(j == 1 ? 10 : 20, j == 1 ? 1.818 : 3.636, 0);  // Nm

    // A clamped hand, a half-normal distance away.
    const bumpstop::Contact hand{{75000}, {bumpstop::OffsetKind::half_normal, 0.1 * 0.05}};  // N/m, m
    const auto collision = bumpstop::evaluate(setup, {q, {0, 0, -0.05}}, detector, hand);    // m/s

    std::printf("peak force: mean %.9f N, sd %.9f N\n", collision.moments().mean, collision.moments().sd);
    for (double p : {0.5, 0.95, 0.99, 0.999}) std::printf("quantile: %.9f N\n", collision.upper_quantile(1 - p));
    std::printf("over 135 N: %.3e\n", collision.exceedance(135.0));
    std::printf("false alarm before contact: %.3e\n", collision.false_alarm);
}
