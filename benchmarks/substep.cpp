// Time of one controller sub-step (rates from the joint angles, limits, new angles) with poses in all lanes.
#include <chrono>
#include <cstdio>
#include <limits>

#include "bumpstop/collision/motion/line_motion.hpp"

using namespace bumpstop;

// A chain without a zero in it, so that nothing is spared by special geometry.
static Chain general_chain(int dof, bool on_rail) {
    std::array<JointSpec, max_joints> specs{};
    for (int i = 0; i < dof; ++i) {
        const double a = 0.3 + 0.9 * i, b = 0.7 + 1.3 * i;
        specs[i].origin = {0.05 + 0.02 * i, 0.03 * (i % 3) - 0.02, 0.2 - 0.01 * i};
        specs[i].axis = {std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a)};
    }
    specs[0].prismatic = on_rail;
    return Chain(std::span<const JointSpec>(specs.data(), std::size_t(dof)));
}

template <class T>
static double nanoseconds_per_lane(int dof, int free, bool on_rail) {
    const Chain chain = general_chain(dof, on_rail);
    MotionSettings motion;
    motion.tip = link_point(chain, dof - 1, {0.01, 0.02, 0.1});
    motion.free_count = free;
    ArmState<T> state;
    for (int j = 0; j < dof; ++j) {
        motion.free_joint[j] = j;
        motion.acceleration_limit[j] = 4.5;
        motion.lower[j] = -3;
        motion.upper[j] = 3;
        motion.velocity_limit[j] = std::numeric_limits<double>::infinity();
        for (int lane = 0; lane < Scalar<T>::lanes; ++lane) set_lane(state.q[j], lane, 0.3 + 0.2 * j + 0.01 * lane);
        state.qd[j] = 0.0;
    }
    state.refresh_angles(chain);
    const Point3<T> velocity{T(0.01), T(-0.004), T(0.005)};
    const InverseMaxRateChange full(motion);
    double best = 1e300;
    for (int repeat = 0; repeat < 40; ++repeat) {
        constexpr int count = 2000;
        const auto begin = std::chrono::steady_clock::now();
        for (int i = 0; i < count; ++i) {
            Posture<T> posture;
            forward_kinematics(chain, state.q, state.angle, posture);
            const Rates<T> wanted = resolved_rates(chain, motion, posture, velocity);
            T change[max_joints], load[max_joints];
            limited_change(motion, full, wanted.free, state, change, load);
            for (int f = 0; f < free; ++f) {
                state.qd[f] += change[f];
                state.q[f] += state.qd[f] * motion.substep();
                state.angle.set(chain, f, state.q[f]);
            }
        }
        const std::chrono::duration<double> time = std::chrono::steady_clock::now() - begin;
        best = std::min(best, time.count() / count / Scalar<T>::lanes);
    }
    volatile double sink = lane_of(state.q[0], 0);
    (void)sink;
    return best * 1e9;
}

int main() {
    using L = Lanes<native_lanes>;
    std::printf("%d %.2f %.2f %.2f %.2f\n", native_lanes, nanoseconds_per_lane<L>(7, 6, false),
                nanoseconds_per_lane<L>(7, 7, false), nanoseconds_per_lane<L>(7, 7, true),
                nanoseconds_per_lane<double>(7, 6, false));
}
