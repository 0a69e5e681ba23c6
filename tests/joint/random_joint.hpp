// Joints as a motor of some amperes drives them, with every term of their models.
#pragma once

#include "bumpstop/joint/joint_torque.hpp"
#include "math/check.hpp"

namespace bumpstop {

inline JointTorqueParameters random_joint() {
    JointTorqueParameters p;
    p.map = checks::uniform(0, 1) < 0.5 ? CurrentMap::odd : CurrentMap::load_dependent;
    p.friction = checks::uniform(0, 1) < 0.5 ? FrictionLaw::power : FrictionLaw::stribeck;
    p.B = checks::uniform(5, 12);
    p.A = checks::uniform(0, 0.2);
    p.D = checks::uniform(0, 3);
    p.F = checks::uniform(0.2, 2);
    p.coulomb = checks::uniform(0, 2);
    p.viscous = checks::uniform(0, 1);
    p.stribeck = checks::uniform(0, 2);
    p.stribeck_speed = checks::uniform(0.01, 0.2);
    p.load = checks::uniform(0, 0.3);
    p.hysteresis = checks::uniform(-2, 2);
    p.inertia = checks::uniform(0, 1);
    p.rest_speed = checks::uniform(0.005, 0.02);
    p.current_low = checks::uniform(-8, -2);
    p.current_high = checks::uniform(2, 8);
    return p;
}

}  // namespace bumpstop
