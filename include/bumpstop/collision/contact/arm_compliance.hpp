/// @file
/// The elastic parts of an arm.
#pragma once

#include "bumpstop/model/inertias.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Links, rotors, gears and position servos of an arm, by joint. A servo of velocity bandwidth w_v and position gain
/// w_p holds a motor with D = w_v (B + M_jj) and P = w_p D; damping is a share of what is critical for rotor and link
/// about the gear, 2 sqrt(Kg / (1 / B + 1 / M_jj)).
struct ArmCompliance {
    Inertias inertias;                                          ///< of the links; rotors in it do not count
    std::array<double, max_joints> rotor_inertia{};             ///< B, seen at the joint [kg m2]
    std::array<double, max_joints> gear_stiffness{};            ///< Kg [Nm/rad]
    std::array<double, max_joints> gear_damping{};              ///< share of critical damping [1]
    std::array<double, max_joints> servo_bandwidth{};           ///< w_v [rad/s]
    std::array<double, max_joints> servo_position_gain{};       ///< w_p [1/s]
    std::array<double, max_joints> acceleration_feedforward{};  ///< 0 to 1
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
