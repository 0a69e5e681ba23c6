// The joint torque of a sample: against its formulas, continuous, odd, lanes equal to doubles.
#include "bumpstop/joint/joint_torque.hpp"

#include "joint/random_joint.hpp"
#include "math/check.hpp"

using namespace bumpstop;

static_assert(noexcept(joint_torque(JointTorqueParameters{}, 0.0, 0.0, 0.0,
                                    std::declval<JointTorqueState<double>&>())));

// Written from the equations, with the library's pow and exp; in motion, away from rest.
static double plain_joint_current(const JointTorqueParameters& p, double i, double qd) {
    const double sign = qd > 0 ? 1 : -1, v = std::fabs(qd);
    const double friction = p.friction == FrictionLaw::power
                                ? p.D * std::pow(v, p.F)
                                : p.coulomb + p.stribeck * std::exp(-std::pow(v / p.stribeck_speed, 2));
    return i - sign * (friction + p.load * std::fabs(i) + p.viscous * v);
}

static double plain_torque(const JointTorqueParameters& p, double i, double qd, double qdd) {
    const double sign = qd > 0 ? 1 : -1, ij = plain_joint_current(p, i, qd);
    const auto f = [&](double x) {
        return p.map == CurrentMap::odd ? p.B * x + p.A * x * std::fabs(x) : p.B * x - sign * p.A * x * x;
    };
    const auto slope = [&](double x) {
        return p.map == CurrentMap::odd ? p.B + 2 * p.A * std::fabs(x) : p.B - 2 * sign * p.A * x;
    };
    const double edge = std::min(std::max(ij, p.current_low), p.current_high);
    return f(edge) + slope(edge) * (ij - edge) - p.inertia * qdd;
}

int main() {
    using L = Lanes<native_lanes>;
    for (int trial = 0; trial < 400; ++trial) {
        JointTorqueParameters p = random_joint();
        p.speed_high = 1.5;
        JointTorqueParameters mirrored = p;
        mirrored.current_low = -p.current_high;
        mirrored.current_high = -p.current_low;
        JointTorqueState<double> state, opposite, single[native_lanes];
        JointTorqueState<L> together;
        for (int k = 0; k < 50; ++k) {
            const double i = checks::uniform(-20, 20), qdd = checks::uniform(-5, 5);
            const double qd = checks::uniform(-1, 1) * (k % 2 ? 2 : 2 * p.rest_speed);
            const JointTorqueState<double> before = state;
            const double tau = joint_torque(p, i, qd, qdd, state);
            CHECK(joint_torque(mirrored, -i, -qd, -qdd, opposite) == -tau);
            CHECK(state.direction == -opposite.direction);
            if (std::fabs(qd) > 2 * p.rest_speed) {
                CHECK_NEAR(tau, plain_torque(p, i, qd, qdd), 1e-11 * (1 + std::fabs(tau)) * 10);
                CHECK(state.direction == (qd > 0 ? 1 : -1));
                const double ij = plain_joint_current(p, i, qd);
                CHECK(state.outside_current - before.outside_current == (ij < p.current_low || ij > p.current_high));
            }
            CHECK(state.outside_speed - before.outside_speed == (std::fabs(qd) > p.speed_high));
            L current = 0.0, rate = 0.0;
            for (int lane = 0; lane < native_lanes; ++lane) {
                set_lane(current, lane, checks::uniform(-20, 20));
                set_lane(rate, lane, checks::uniform(-3, 3) * (k % 3 ? 1 : p.rest_speed));
            }
            const L all = joint_torque(p, current, rate, L(qdd), together);
            for (int lane = 0; lane < native_lanes; ++lane) {
                CHECK_NEAR(all[lane], joint_torque(p, current[lane], rate[lane], qdd, single[lane]), 1e-9);
                CHECK(together.direction[lane] == single[lane].direction);
                CHECK(together.outside_current[lane] == single[lane].outside_current);
                CHECK(together.outside_speed[lane] == single[lane].outside_speed);
            }
        }
        // A slow reversal, there and back: no jump beyond what the steepest slope allows in a step.
        JointTorqueState<double> moved;
        const double step = p.rest_speed * 1e-4;
        double before = 0, largest = 0;
        for (int k = 0; k <= 100000; ++k) {
            const double qd = step * (k <= 50000 ? 25000 - k : k - 75000);
            const double tau = joint_torque(p, 5.0, qd, 0.0, moved);
            if (k > 0) largest = std::max(largest, std::fabs(tau - before));
            before = tau;
            if (trial >= 8) break;
        }
        CHECK(largest < 0.05);
        if (trial < 8) CHECK(largest > 0);
    }
    return checks::result();
}
