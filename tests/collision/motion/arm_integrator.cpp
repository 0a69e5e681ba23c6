// Arms in lanes, each with Adams steps of its own length: none is left standing.
#include "bumpstop/collision/motion/arm_integrator.hpp"

#include "collision/random_arm.hpp"

namespace {

using namespace bumpstop;
using L = Lanes<native_lanes>;

// Joints whose rates are whole numbers of greatest changes, as those of an arm that set out from rest, or a rounding beside
// that: leaps end where the rates asked for are just reached. Whatever is undone, a few looks later the arm has moved on.
template <class T>
void never_stands_still(int dof, bool follows, double tolerance) {
    constexpr double beyond = 100;  // sub-steps after those that it takes to stop
    constexpr int most_looks = 12;  // from 1024 sub-steps to one by halves, and the one
    using Any = ArmIntegrator<T>;
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
        braking.begin(lane, tolerance);
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
            never_stands_still<double>(6 + trial % 2, follows, exact_tolerance);
            never_stands_still<L>(6, follows, exact_tolerance);
            never_stands_still<L>(7, follows, batch_tolerance);
        }
    }
    return checks::result();
}
