// Arms in lanes: what becomes of one does not depend on the others, and one that is put back goes the same way again.
#include "bumpstop/collision/braking_arm.hpp"

#include "collision/random_arm.hpp"

namespace {

using namespace bumpstop;
using L = Unfused<Lanes<native_lanes>>;
using Braking = BrakingArm<L, loose_braking_order>;

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
    braking.begin(lane, loose_braking_leap_tolerance, 1.0);
}

L advance(Braking& braking) {
    return braking.advance(
        L(double(longest_braking_leap)), [] {}, [](const auto&, const L&) { return L(0.0) > L(1.0); });
}

// Lanes that are put back are followed again, those between them go on.
void goes_the_same_way_again(int dof, int held) {
    const random_arm::Arm arm = random_arm::make(dof, {}, held);
    for (Braking::Kind kind : {Braking::Kind::stops, Braking::Kind::follows}) {
        Braking straight(arm.chain, arm.motion, kind);
        for (int lane = 0; lane < native_lanes; ++lane) set_out(arm, straight, lane);
        Braking kept = straight, back = straight;
        MaskOf<L> odd = L(0.0) > L(1.0);
        for (int lane = 1; lane < native_lanes; lane += 2) set_lane(odd, lane, true);
        for (int i = 0; i < 12; ++i) {
            if (i == 5) kept.take(odd, straight);
            advance(straight);
        }
        Braking further = straight;
        // By other leaps, as an arm on its way home goes.
        for (int i = 0; i < 12; ++i) {
            if (i == 5) back.loosen(odd, 1e4);
            advance(back);
        }
        back.take(odd, kept);
        for (int i = 5; i < 25; ++i) {
            const L gone = advance(back);
            if (i < 12) continue;
            const L expected = advance(further);
            for (int lane = 1; lane < native_lanes; lane += 2) {
                CHECK(lane_of(gone, lane) == lane_of(expected, lane));
                CHECK(lane_of(back.poor(), lane) == lane_of(further.poor(), lane));
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

}  // namespace

int main() {
    for (int trial = 0; trial < 20; ++trial) {
        goes_the_same_way_again(6, -1);
        goes_the_same_way_again(7, 2);
        goes_the_same_way_again(5, -1);
    }
    return checks::result();
}
