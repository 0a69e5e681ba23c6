// Arms with random links and joint models, and the detector of each.
#pragma once

#include "bumpstop/detection/detector.hpp"
#include "joint/random_joint.hpp"
#include "math/check.hpp"
#include "model/random_chain.hpp"

namespace random_detector {

using namespace bumpstop;
using namespace random_chain;

const double nan_ = std::nan(""), inf = std::numeric_limits<double>::infinity();

inline LinkInertia random_link() {
    LinkInertia link;
    link.mass = checks::uniform(0.5, 5);
    for (double& c : link.center) c = checks::uniform(-0.2, 0.2);
    link.tensor = {0.05, 0.004, -0.003, 0.004, 0.06, 0.005, -0.003, 0.005, 0.03};
    link.rotor = checks::uniform(0, 0.5);
    return link;
}

inline FittedParameters random_parameters(int dof) {
    FittedParameters made;
    for (int j = 0; j < dof; ++j) made.link[j] = random_link();
    for (int m = 0; m <= dof; ++m) {
        FittedMotor& motor = made.motor[m];
        // The last one is shared.
        motor.share[m < dof ? m : 0] = 1;
        if (m == dof) motor.share[dof - 1] = 0.7;
        motor.sign_speed = 0.1;
        motor.top_speed = m % 2 ? inf : 2.0;
        for (double* value : {&motor.coulomb, &motor.viscous, &motor.rotor, &motor.bend}) *value = checks::normal();
        motor.load = m < dof ? 0.05 : 0;
        motor.presliding = m % 3 ? 0 : 0.01;
    }
    return made;
}

struct Arm {
    Case made;
    std::vector<LinkInertia> links;
    std::vector<JointTorqueParameters> joints;
    std::vector<JointTorqueErrors> errors;
    DetectorSettings settings;
    std::optional<FittedDynamics> fitted;

    explicit Arm(int dof) : made(random_case(dof)), errors(std::size_t(dof)) {
        for (int j = 0; j < dof; ++j) {
            links.push_back(random_link());
            joints.push_back(random_joint());
            settings.samples.lower[j] = -3;
            settings.samples.upper[j] = 3;
            settings.samples.velocity[j] = 4;
            settings.samples.signal[j] = 1e3;
            settings.noise_sd[j] = 1;
            ThresholdModel& law = settings.alarm.thresholds;
            law.constant[j] = 10;
            law.fast[j] = j % 2 ? 5 : inf;
            law.rest_speed[j] = 0.01;
        }
        settings.window = 0.007;  // 8 samples
        settings.samples.period = 0.001;
        settings.samples.shortest_interval = 1e-4;
        settings.samples.late_interval = 0.0015;
        settings.samples.longest_interval = 0.005;
        settings.contact = link_point(made.chain, dof - 1, {0, 0, 0.1});
    }
    Detector detector() const { return Detector(made.chain, links, joints, errors, settings, fitted); }
    /// Dynamics in place of the joint model.
    void fit() {
        const int dof = made.chain.dof;
        fitted.emplace();
        fitted->all = random_parameters(dof);
        fitted->essential = random_parameters(dof);
        fitted->motors = dof + 1;
        fitted->by_all = 0b101;
        for (double& gain : fitted->gain) gain = 2;
        joints.clear();
        errors.clear();
    }
};

}  // namespace random_detector
