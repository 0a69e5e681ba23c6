// All joints of an arm at once: their torques are those of single joints, their errors the derivatives.
#include "bumpstop/joint/joint_torque_batch.hpp"

#include <vector>

#include "joint/random_joint.hpp"
#include "math/check.hpp"

using namespace bumpstop;

static void bank_is_joint_torque() {
    for (int n = 1; n <= max_joints; ++n) {
        std::vector<JointTorqueParameters> joints;
        std::vector<JointTorqueErrors> errors(std::size_t(n), JointTorqueErrors{});
        for (int j = 0; j < n; ++j) joints.push_back(random_joint());
        // One standard error at a time, so that the sd is a derivative.
        double JointTorqueErrors::*const error[] = {&JointTorqueErrors::A,        &JointTorqueErrors::B,
                                                    &JointTorqueErrors::D,        &JointTorqueErrors::F,
                                                    &JointTorqueErrors::coulomb,  &JointTorqueErrors::viscous,
                                                    &JointTorqueErrors::stribeck, &JointTorqueErrors::stribeck_speed,
                                                    &JointTorqueErrors::load,     &JointTorqueErrors::hysteresis,
                                                    &JointTorqueErrors::inertia};
        double JointTorqueParameters::*const figure[] = {
            &JointTorqueParameters::A,        &JointTorqueParameters::B,
            &JointTorqueParameters::D,        &JointTorqueParameters::F,
            &JointTorqueParameters::coulomb,  &JointTorqueParameters::viscous,
            &JointTorqueParameters::stribeck, &JointTorqueParameters::stribeck_speed,
            &JointTorqueParameters::load,     &JointTorqueParameters::hysteresis,
            &JointTorqueParameters::inertia};
        for (int which = 0; which < 11; ++which) {
            for (JointTorqueErrors& e : errors) {
                e = {};
                e.*error[which] = 1;
            }
            JointTorqueBank bank(joints, errors);
            std::vector<JointTorqueState<double>> state(std::size_t(n), JointTorqueState<double>{});
            for (int i = 0; i < 30; ++i) {
                double current[max_joints] = {}, qd[max_joints] = {}, qdd[max_joints] = {}, tau[max_joints],
                       sd[max_joints];
                for (int j = 0; j < n; ++j) {
                    current[j] = checks::uniform(-6, 6);
                    qd[j] = i % 3 == 0 ? checks::uniform(-0.03, 0.03) : checks::uniform(-1, 1);
                    qdd[j] = checks::uniform(-3, 3);
                }
                if (i == 20) {
                    bank.reset();
                    for (auto& one : state) one = {};
                }
                bank.torque(current, qd, qdd, tau, sd);
                for (int j = 0; j < n; ++j) {
                    const JointTorqueState<double> before = state[std::size_t(j)];
                    const double wanted =
                        joint_torque(joints[std::size_t(j)], current[j], qd[j], qdd[j], state[std::size_t(j)]);
                    CHECK_NEAR(tau[j], wanted, 1e-11 * (1 + std::fabs(wanted)));
                    CHECK(bank.direction(j) == state[std::size_t(j)].direction);
                    // Where the fitted range ends the torque has a corner in its parameters.
                    const auto shifted = [&](double step) {
                        JointTorqueParameters p = joints[std::size_t(j)];
                        p.*figure[which] += step;
                        JointTorqueState<double> again = before;
                        return joint_torque(p, current[j], qd[j], qdd[j], again);
                    };
                    const double forward = (shifted(1e-6) - wanted) / 1e-6, back = (wanted - shifted(-1e-6)) / 1e-6;
                    const bool power = joints[std::size_t(j)].friction == FrictionLaw::power;
                    const bool used = power ? which != 4 && which != 6 && which != 7 : which != 2 && which != 3;
                    if (!used || std::fabs(forward - back) > 1e-3) continue;
                    // With the load-dependent map A and the slope depend on the rate alone beside the range's corner.
                    CHECK_NEAR(sd[j], std::fabs(forward), 2e-4 * (1 + std::fabs(forward)));
                }
            }
        }
    }
}

int main() {
    bank_is_joint_torque();
    return checks::result();
}
