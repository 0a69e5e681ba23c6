// Torques of a motion and what the arm weighs to a push, for one pose and for a register full of them.
#include <cstdio>
#include <fstream>

#include "bumpstop/model/robot_description.hpp"

int main(int count, char** arguments) {
    std::ifstream file(count > 1 ? arguments[1] : "ur10e.robot");
    std::string error;
    const auto robot = bumpstop::read_robot(file, error);
    if (!robot) {
        std::fprintf(stderr, "error: %s\n", error.c_str());
        return 2;
    }
    const bumpstop::Chain chain = robot->chain();
    const auto inertias = robot->inertias(chain);
    if (!inertias) {
        std::fprintf(stderr, "error: the inertia of %s is not known\n", robot->name.c_str());
        return 2;
    }

    // The same text serves a double and lanes of doubles: here every lane is a pose of its own.
    using Lanes = bumpstop::Lanes<bumpstop::native_lanes>;
    Lanes q[bumpstop::max_joints], qd[bumpstop::max_joints], qdd[bumpstop::max_joints], tau[bumpstop::max_joints];
    for (int j = 0; j < chain.dof; ++j) {
        for (int lane = 0; lane < bumpstop::native_lanes; ++lane) set_lane(q[j], lane, 0.1 * (j + 1) + 0.05 * lane);
        qd[j] = 0.3 - 0.1 * j;  // rad/s
        qdd[j] = 0.2 * j;       // rad/s2
    }
    bumpstop::JointAngles<Lanes> angle{};
    angle.set(chain, q);
    bumpstop::inverse_dynamics(chain, *inertias, {q, angle, qd, qdd}, bumpstop::Vector3{0, 0, -9.80665}, tau);
    for (int j = 0; j < chain.dof; ++j)
        std::printf("joint %d: %.12f Nm in the first lane\n", j + 1, lane_of(tau[j], 0));

    const bumpstop::Point3<Lanes> down{Lanes(0.0), Lanes(0.0), Lanes(-1.0)};
    const Lanes mass = bumpstop::effective_mass(chain, *inertias, q, angle, robot->tip(chain), down);
    std::printf("effective mass downward: %.12f kg\n", lane_of(mass, 0));
}
