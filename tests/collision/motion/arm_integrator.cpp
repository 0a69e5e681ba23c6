// Arms in lanes: what becomes of one does not depend on the others, and one that is put back goes the same way again.
#include "bumpstop/collision/motion/arm_integrator.hpp"

#include <bit>

#include "collision/random_arm.hpp"

namespace {

using namespace bumpstop;
using L = Lanes<native_lanes>;
using Braking = ArmIntegrator<L, batch_order>;

bool same_bits(double a, double b) { return std::bit_cast<std::int64_t>(a) == std::bit_cast<std::int64_t>(b); }

// A lane set out on a line that it is to go back on, at rates of its own.
void set_out(const random_arm::Arm& arm, Braking& braking, int lane) {
    for (int j = 0; j < arm.chain.dof; ++j) {
        set_lane(braking.state.q[j], lane, checks::uniform(-3, 3));
        set_lane(braking.state.qd[j], lane, 0.0);
    }
    for (int f = 0; f < arm.motion.free_count; ++f)
        set_lane(braking.state.qd[arm.motion.free_joint[std::size_t(f)]], lane, checks::uniform(-0.5, 0.5));
    set_lane(braking.target.x, lane, 0.1 * checks::normal());
    set_lane(braking.target.y, lane, 0.1 * checks::normal());
    set_lane(braking.target.z, lane, 0.1 * checks::normal());
    braking.begin(lane, batch_tolerance);
}

L advance(Braking& braking) {
    return braking.step(
        L(double(max_reaction_adams_step)), [] {}, [](const auto&, const L&) { return L(0.0) > L(1.0); });
}

// Lanes that are put back are followed again, those between them go on.
void goes_the_same_way_again(int dof, int held) {
    const random_arm::Arm arm = random_arm::make(dof, {}, held);
    for (Braking::Kind kind : {Braking::Kind::brake, Braking::Kind::track}) {
        Braking straight(arm.chain, arm.motion, kind);
        for (int lane = 0; lane < native_lanes; ++lane) set_out(arm, straight, lane);
        Braking kept = straight, back = straight;
        MaskOf<L> odd = L(0.0) > L(1.0);
        for (int lane = 1; lane < native_lanes; lane += 2) set_lane(odd, lane, true);
        for (int i = 0; i < 12; ++i) {
            if (i == 5) kept.copy_lanes(odd, straight);
            advance(straight);
        }
        Braking further = straight;
        // By other leaps, as an arm on its way home goes.
        for (int i = 0; i < 12; ++i) {
            if (i == 5) back.relax(odd, 1e4);
            advance(back);
        }
        back.copy_lanes(odd, kept);
        for (int i = 5; i < 25; ++i) {
            const L gone = advance(back);
            if (i < 12) continue;
            const L expected = advance(further);
            for (int lane = 1; lane < native_lanes; lane += 2) {
                CHECK(lane_of(gone, lane) == lane_of(expected, lane));
                CHECK(lane_of(back.near_singular(), lane) == lane_of(further.near_singular(), lane));
                CHECK(lane_of(back.reached(), lane) == lane_of(further.reached(), lane));
                for (int j = 0; j < dof; ++j) {
                    CHECK(same_bits(lane_of(back.state.q[j], lane), lane_of(further.state.q[j], lane)));
                    CHECK(same_bits(lane_of(back.state.qd[j], lane), lane_of(further.state.qd[j], lane)));
                }
            }
        }
        // The others never noticed.
        for (int i = 0; i < 20; ++i) advance(straight);
        for (int lane = 0; lane < native_lanes; lane += 2)
            for (int j = 0; j < dof; ++j)
                CHECK(same_bits(lane_of(back.state.q[j], lane), lane_of(straight.state.q[j], lane)));
    }
}

// Joints whose rates are whole numbers of greatest changes, as those of an arm that set out from rest, or a rounding beside
// that: leaps end where the rates asked for are just reached. Whatever is undone, a few looks later the arm has moved on.
template <class T, int order>
void never_stands_still(int dof, bool follows) {
    constexpr double beyond = 100;  // sub-steps after those that it takes to stop
    constexpr int most_looks = 12;  // from 1024 sub-steps to one by halves, and the one
    using Any = ArmIntegrator<T, order>;
    random_arm::Arm arm = random_arm::make(dof, {}, -1);
    // Where all is a power of two, loads are whole numbers to the last bit.
    if (checks::uniform(0, 1) < 0.5) {
        arm.motion.step = 1.0 / 512;
        arm.motion.substeps = 1;
        for (double& limit : arm.motion.acceleration_limit) limit = 4;
    }
    Any braking(arm.chain, arm.motion, follows ? Any::Kind::track : Any::Kind::brake);
    double left[Scalar<T>::lanes];  // sub-steps that the arm is followed
    int looks[Scalar<T>::lanes];
    for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
        const double changes = std::floor(checks::uniform(1, 200));
        for (int j = 0; j < arm.chain.dof; ++j) {
            set_lane(braking.state.q[j], lane, checks::uniform(-3, 3));
            const double full = arm.motion.acceleration_limit[std::size_t(j)] * arm.motion.substep();
            const double share = j % 2 == 0 ? 1 : checks::uniform(-1, 1);
            const double roundings = std::max(0.0, std::floor(checks::uniform(-3, 3)));
            const double beside = 1 + roundings * std::numeric_limits<double>::epsilon();
            set_lane(braking.state.qd[j], lane, changes * full * share * beside);
        }
        const double speed = follows ? 0.1 : 0.0;
        set_lane(braking.target.x, lane, speed * checks::normal());
        set_lane(braking.target.y, lane, speed * checks::normal());
        set_lane(braking.target.z, lane, speed * checks::normal());
        braking.begin(lane, order == exact_order ? exact_tolerance : batch_tolerance);
        left[lane] = changes + beyond;
        looks[lane] = 0;
    }
    for (int round = 0; round < 5000; ++round) {
        T most;
        bool over = true;
        for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
            // As far as where one sub-step is left, which is what a caller asks for that looks for the farthest point.
            const double last = left[lane] > beyond + 1 ? left[lane] - beyond - 1 : left[lane];
            set_lane(most, lane, std::max(0.0, std::min(1024.0, last)));
            over = over && left[lane] <= 0;
        }
        if (over) return;
        const T gone = braking.step(
            most, [] {}, [](const auto&, const T&) { return T(0.0) > T(1.0); });
        for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
            left[lane] -= lane_of(gone, lane);
            looks[lane] = lane_of(gone, lane) > 0 || left[lane] <= 0 ? 0 : looks[lane] + 1;
            CHECK(looks[lane] <= most_looks);
            if (looks[lane] > most_looks) return;
        }
    }
    CHECK(false);
}

}  // namespace

int main() {
#if defined(__OPTIMIZE__)
    constexpr int trials = 500;
#else
    constexpr int trials = 20;
#endif
    for (int trial = 0; trial < trials; ++trial) {
        for (bool follows : {false, true}) {
            never_stands_still<double, exact_order>(6 + trial % 2, follows);
            never_stands_still<Lanes<native_lanes>, exact_order>(6, follows);
            never_stands_still<L, batch_order>(7, follows);
        }
    }
    for (int trial = 0; trial < 20; ++trial) {
        goes_the_same_way_again(6, -1);
        goes_the_same_way_again(7, 2);
        goes_the_same_way_again(5, -1);
    }
    return checks::result();
}
