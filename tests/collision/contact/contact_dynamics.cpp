/// One collision by the library's contact dynamics, step by step: numbers in, numbers out.
///
/// In: joints, steps, step [s], offset [m], 1 in a reaction; K, c, m, ground stiffness of the body; M by rows, then B, Kg, Dg, P, D, f, a and g,
/// a number for each joint; the path at the ends of steps, the start included.
/// Out, for every step: force, greatest force so far and after the transient phase, time in contact, residual of each joint.
#include "bumpstop/collision/contact/contact_dynamics.hpp"

#include <cstdio>
#include <iostream>
#include <vector>

int main() {
    using namespace bumpstop;
    const auto read = [] {
        double value = 0;
        std::cin >> value;
        return value;
    };
    ElasticArm arm;
    arm.dof = int(read());
    const int steps = int(read());
    const double step = read(), offset = read(), reacts = read();
    ContactBody body;
    for (double* value : {&body.stiffness, &body.damping, &body.mass, &body.ground_stiffness}) *value = read();
    for (int i = 0; i < arm.dof * arm.dof; ++i) arm.mass[std::size_t(i)] = read();
    for (auto* values : {&arm.rotor_inertia, &arm.gear_stiffness, &arm.gear_damping, &arm.position_gain,
                         &arm.velocity_gain, &arm.feedforward, &arm.torque_per_N, &arm.rate_per_speed})
        for (int j = 0; j < arm.dof; ++j) (*values)[std::size_t(j)] = read();
    std::vector<double> path(std::size_t(steps + 1));
    for (double& s : path) s = read();
    if (!std::cin) return 1;

    const ContactSystem system(arm, body);
    const ContactPropagator propagator(system, step);
    const ContactDynamics dynamics(propagator);
    ContactState state;
    state.speed = (path[1] - path[0]) / step;  // the arm is on its way already
    state.reacts = reacts;
    for (int i = 0; i < steps; ++i) {
        dynamics.step(state, path[std::size_t(i)], path[std::size_t(i + 1)], offset);
        std::printf("%.17g %.17g %.17g %.17g", state.force, state.peak, state.lasting, state.duration);
        double residual[max_joints];
        if (arm.dof > 0) dynamics.residuals(state, nullptr, arm.dof, residual);
        for (int j = 0; j < arm.dof; ++j) std::printf(" %.17g", residual[j]);
        std::printf("\n");
    }
}
