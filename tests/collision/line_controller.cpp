// A simulation step of the controller against its sub-steps as docs/collision.md writes them down.
#include "bumpstop/collision/line_controller.hpp"

#include "collision/random_arm.hpp"

namespace {

using namespace bumpstop;
using random_arm::Arm;
using L = Lanes<native_lanes>;

struct State {
    double q[max_joints], qd[max_joints];
    bool reached = true;
};

Rates<double> plain_rates(const Arm& arm, const Point3<double>& velocity, const double* q) {
    JointAngles<double> angle;
    angle.set(arm.chain, q);
    Posture<double> posture;
    forward_kinematics(arm.chain, q, angle, posture);
    return resolved_rates(arm.chain, arm.motion, posture, velocity);
}

// Returns whether no singularity was near.
bool plain_step(const Arm& arm, const Point3<double>& velocity, State& state) {
    const double h = arm.motion.substep();
    bool good = true;
    for (int sub = 0; sub < arm.motion.substeps; ++sub) {
        const Rates<double> wanted = plain_rates(arm, velocity, state.q);
        good = good && !wanted.conditioning.poor;
        double ratio = 1;
        for (int f = 0; f < arm.motion.free_count; ++f) {
            const int j = arm.motion.free_joint[std::size_t(f)];
            ratio = std::min(
                ratio, arm.motion.acceleration_limit[std::size_t(j)] * h / std::fabs(wanted.free[f] - state.qd[j]));
        }
        state.reached = state.reached && ratio >= 1;
        for (int f = 0; f < arm.motion.free_count; ++f) {
            const int j = arm.motion.free_joint[std::size_t(f)];
            state.qd[j] += ratio * (wanted.free[f] - state.qd[j]);
            state.q[j] += h * state.qd[j];
        }
    }
    return good;
}

// Arms at rest or under way, which lag behind their line or have the rates it asks for.
void steps_agree(int dof, const std::vector<int>& sliding, int held = -1) {
    int compared = 0, reached = 0;
    for (int i = 0; i < 30; ++i) {
        const Arm arm = random_arm::make(dof, sliding, held);
        LineController<L> controller(arm.chain, arm.motion);
        ArmState<L> state;
        State plain[native_lanes];
        Point3<double> asked[native_lanes];
        Point3<L> velocity;
        for (int lane = 0; lane < native_lanes; ++lane) {
            asked[lane] = {0.1 * checks::normal(), 0.1 * checks::normal(), 0.1 * checks::normal()};
            set_lane(velocity.x, lane, asked[lane].x);
            set_lane(velocity.y, lane, asked[lane].y);
            set_lane(velocity.z, lane, asked[lane].z);
            for (int j = 0; j < dof; ++j) {
                plain[lane].q[j] = checks::uniform(-3, 3);
                plain[lane].qd[j] = 0;
            }
            if (lane % 2 == 1) {
                const Rates<double> rates = plain_rates(arm, asked[lane], plain[lane].q);
                for (int f = 0; f < arm.motion.free_count; ++f)
                    plain[lane].qd[arm.motion.free_joint[std::size_t(f)]] = rates.free[f];
            }
            for (int j = 0; j < dof; ++j) {
                set_lane(state.q[j], lane, plain[lane].q[j]);
                set_lane(state.qd[j], lane, plain[lane].qd[j]);
            }
        }
        state.refresh_angles(arm.chain);
        controller.begin();
        bool good[native_lanes];
        std::fill_n(good, native_lanes, true);
        MaskOf<L> all_reached = L(0.0) < L(1.0);
        for (int step = 0; step < 20; ++step) {
            Rates<L> wanted;
            controller.find_rates(state, velocity, wanted);
            all_reached = all_reached & controller.step(wanted, velocity, state);
            for (int lane = 0; lane < native_lanes; ++lane)
                good[lane] = good[lane] && plain_step(arm, asked[lane], plain[lane]);
        }
        for (int lane = 0; lane < native_lanes; ++lane) {
            if (!good[lane]) continue;
            ++compared;
            reached += plain[lane].reached;
            CHECK(lane_of(all_reached, lane) == plain[lane].reached);
            for (int j = 0; j < dof; ++j) {
                CHECK_NEAR(lane_of(state.q[j], lane), plain[lane].q[j], 1e-11);
                CHECK_NEAR(lane_of(state.qd[j], lane), plain[lane].qd[j], 1e-9);
            }
        }
    }
    CHECK(compared > 10);
    CHECK(reached > 0 && reached < compared);
}

}  // namespace

int main() {
    steps_agree(6, {});
    steps_agree(7, {});
    steps_agree(7, {}, 6);
    steps_agree(7, {0});
    steps_agree(7, {3});
    steps_agree(7, {1}, 1);
    steps_agree(8, {0});
    return checks::result();
}
