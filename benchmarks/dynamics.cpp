// Time of Newton-Euler for seven joints, sines and cosines included, with different configurations in all lanes.
#include "bumpstop/model/dynamics.hpp"

#include <chrono>
#include <cstdio>

using namespace bumpstop;

// A chain without a zero in it, so that nothing is spared by special geometry.
struct GeneralArm {
    static constexpr int dof = 7;
    Chain chain;
    Inertias inertias;

    GeneralArm() {
        std::array<JointSpec, dof> specs{};
        std::array<LinkInertia, dof> given{};
        for (int i = 0; i < dof; ++i) {
            const double a = 0.3 + 0.9 * i, b = 0.7 + 1.3 * i;
            specs[i].origin = {0.05 + 0.02 * i, 0.03 * (i % 3) - 0.02, 0.2 - 0.01 * i};
            specs[i].axis = {std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a)};
            given[i].mass = 5 - 0.6 * i;
            given[i].center = {0.01 + 0.01 * i, 0.02 - 0.015 * i, 0.1 - 0.01 * i};
            given[i].tensor = {0.05, 0.004, -0.003, 0.004, 0.06, 0.005, -0.003, 0.005, 0.03};
            given[i].rotor = 0.1;
        }
        chain = Chain(specs);
        inertias = Inertias(chain, given);
    }
};

template <class T>
static double nanoseconds_per_lane() {
    const GeneralArm arm;
    constexpr int rows = 64;
    static T q[rows][max_joints], qd[rows][max_joints], qdd[rows][max_joints], tau[rows][max_joints];
    for (int row = 0; row < rows; ++row) {
        for (int j = 0; j < arm.dof; ++j) {
            for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
                const double phase = 0.37 * row + 1.1 * j + 0.013 * lane;
                set_lane(q[row][j], lane, 2 * std::sin(phase));
                set_lane(qd[row][j], lane, std::cos(1.3 * phase));
                set_lane(qdd[row][j], lane, 3 * std::sin(2.1 * phase));
            }
        }
    }
    double best = 1e300;
    for (int repeat = 0; repeat < 3000; ++repeat) {
        const auto begin = std::chrono::steady_clock::now();
        for (int row = 0; row < rows; ++row) {
            JointAngles<T> angle;
            angle.set(arm.chain, q[row]);
            inverse_dynamics(arm.chain, arm.inertias, {q[row], angle, qd[row], qdd[row]}, {0, 0, -9.80665}, tau[row]);
        }
        const std::chrono::duration<double> time = std::chrono::steady_clock::now() - begin;
        best = std::min(best, time.count() / rows / Scalar<T>::lanes);
    }
    volatile double sink = lane_of(tau[rows - 1][0], 0);
    (void)sink;
    return best * 1e9;
}

int main() {
    std::printf("%d %.2f %.2f\n", native_lanes, nanoseconds_per_lane<Lanes<native_lanes>>(),
                nanoseconds_per_lane<double>());
}
