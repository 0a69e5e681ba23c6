/// @file
/// How long an event lasts, and how large its residuals get.
#pragma once

#include <array>
#include <cmath>

#include "bumpstop/model/chain.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// From the first to the last tick of an event in which some residual is over its threshold. Times in s.
struct EventSpan {
    double begin = 0, end = 0;
    std::array<double, max_joints> largest{};  ///< residual of the largest magnitude, with its sign, by joint [Nm or N]
    double largest_share = 0;                  ///< largest ratio of a residual to its threshold
    double largest_time = 0;                   ///< time of that residual
    int largest_joint = -1;                    ///< its joint, from 0; -1: no joint is monitored

    /// Begins the event at time t with residuals and thresholds of `joints` joints.
    void start(double t, const double* residual, const double* threshold, int joints) noexcept {
        *this = {};
        begin = t;
        extend(t, residual, threshold, joints);
    }
    /// Extends the event to time t, where some residual is over its threshold again.
    void extend(double t, const double* residual, const double* threshold, int joints) noexcept {
        end = t;
        for (int j = 0; j < joints; ++j) {
            const double size = std::fabs(residual[j]);
            if (size > std::fabs(largest[j])) largest[j] = residual[j];
            if (!(size > largest_share * threshold[j])) continue;
            largest_share = size / threshold[j];
            largest_time = t;
            largest_joint = j;
        }
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
