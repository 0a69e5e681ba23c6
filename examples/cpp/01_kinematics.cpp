// Where the tool is and how it moves: robots come from the file that `bumpstop robots export NAME FILE` writes.
#include <cstdio>
#include <fstream>

#include "bumpstop/model/robot_description.hpp"

int main(int count, char** arguments) {
    std::ifstream file(count > 1 ? arguments[1] : "sia5d.robot");
    std::string error;
    const auto robot = bumpstop::read_robot(file, error);
    if (!robot) {
        std::fprintf(stderr, "error: %s\n", error.c_str());
        return 2;
    }
    const bumpstop::Chain chain = robot->chain();
    const bumpstop::LinkPoint tip = robot->tip(chain);

    double q[bumpstop::max_joints] = {};  // rad or m
    for (int j = 0; j < chain.dof; ++j) q[j] = 0.1 * (j + 1);
    bumpstop::JointAngles<double> angle{};
    angle.set(chain, q);
    bumpstop::Posture<double> posture;
    bumpstop::forward_kinematics(chain, q, angle, posture);
    const auto p = posture.position(tip);
    std::printf("%s: %d joints\n", robot->name.c_str(), chain.dof);
    std::printf("tip at %.12f %.12f %.12f m\n", p.x, p.y, p.z);
    for (int j = 0; j < chain.dof; ++j) {
        const auto column = bumpstop::linear_column(chain, posture, p, j);
        std::printf("joint %d moves it by %.12f %.12f %.12f m/rad\n", j + 1, column.x, column.y, column.z);
    }
}
