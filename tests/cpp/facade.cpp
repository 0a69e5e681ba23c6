// Peak forces by the facade, for all kinds of bodies, without detection, and for motions that cannot begin.
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <numbers>

#include "bumpstop/bumpstop.hpp"

namespace {

void print(const bumpstop::CollisionDistribution& collision) {
    const bumpstop::Moments moments = collision.moments();
    std::printf("%.9f %.9f %.9f %.9f %.9f\n", moments.mean, moments.sd, collision.upper_quantile(0.5),
                collision.upper_quantile(0.001), collision.exceedance(60.0));
}

}  // namespace

int main(int, char** arguments) {
    std::ifstream file(arguments[1]);
    std::string error;
    const auto robot = bumpstop::read_robot(file, error);
    if (!robot) return 2;
    const double degree = std::numbers::pi / 180, threshold[] = {40, 40, 30, 12, 12, 12};
    const auto setup = bumpstop::line_setup(*robot, 6.0);
    bumpstop::GaussianThresholds detector;
    for (double each : threshold) detector.add_joint(each, each / 5.5, 0);
    const bumpstop::OffsetDistribution offset{bumpstop::OffsetKind::half_normal, 0.025};
    const double q[] = {10 * degree, -80 * degree, 110 * degree, -120 * degree, -90 * degree, 20 * degree};
    for (int i = 0; i < 6; ++i) {
        // Clamped; damped; damped more than it is stiff; a gauge; free to move; the same, lighter.
        const bumpstop::ContactBody bodies[] = {{1e4},          {1e4, 500},    {1e4, 1500}, {75e3, 0, 0.5, 3e4},
                                                {25e3, 0, 4.4}, {75e3, 0, 0.6}};
        print(bumpstop::evaluate(setup, {q, {0, 0.15, -0.2}}, detector, {bodies[i], offset}));
    }
    // Nothing is detected in half a second: clamped, and a gauge.
    bumpstop::GaussianThresholds unarmed;
    for (int j = 0; j < 6; ++j) unarmed.add_joint(1e4, 1, 0);
    auto brief = setup;
    brief.timing.steps = 500;
    for (const bumpstop::ContactBody& body : {bumpstop::ContactBody{1e4}, {75e3, 0, 0.5, 3e4}})
        print(bumpstop::evaluate(brief, {q, {0, 0.15, -0.2}}, unarmed, {body, offset}));
    // A singular pose, and one beyond a joint's limit.
    const double stretched[] = {0, -90 * degree, 0, -90 * degree, 0, 0}, beyond[] = {7, -1, 1, -1, -1, 0};
    print(bumpstop::evaluate(setup, {stretched, {0, 0.15, -0.2}}, detector, {{1e4}, offset}));
    print(bumpstop::evaluate(setup, {beyond, {0, 0.15, -0.2}}, detector, {{1e4}, offset}));
}
