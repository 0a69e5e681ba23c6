/// @file
/// Thresholds of the detector, constant or growing with what makes the model less sure.
#pragma once

#include <array>
#include <limits>

#include "bumpstop/math/lanes.hpp"
#include "bumpstop/model/chain.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// theta_j = constant_j + speed_j |qd_j| + acceleration_j |qdd_j| + rest_j f(qd_j) + model_errors sd_j
///
/// with f 1 up to rest_speed_j, falling to 0 at twice that, and sd_j the standard error of the estimated torque.
struct ThresholdModel {
    static constexpr double unmonitored = std::numeric_limits<double>::infinity();

    std::array<double, max_joints> constant{};      ///< Nm or N; infinite: the joint is not monitored
    std::array<double, max_joints> speed{};         ///< Nm s/rad or N s/m
    std::array<double, max_joints> acceleration{};  ///< Nm s2/rad or N s2/m
    std::array<double, max_joints> rest{};          ///< Nm or N, at standstill
    std::array<double, max_joints> rest_speed{};    ///< rad/s or m/s, above 0
    std::array<double, max_joints> fast{};          ///< of the band-pass channel [Nm or N]; infinite: not monitored
    double model_errors = 0;                        ///< standard errors of the torque to add
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
