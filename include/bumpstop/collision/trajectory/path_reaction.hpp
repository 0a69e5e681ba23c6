/// @file
/// Reactions along the path of a trajectory, and how hard an arm brakes on it.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "bumpstop/model/kinematics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What the arm does along its path after a tick, by simulation step from the reaction's beginning.
struct PathReaction {
    std::vector<double> u;              ///< until the reaction's final speed is reached [s]
    std::vector<Point3<double>> point;  ///< of contact, as long as the arm goes forward and one step more [m]
    double reach = 0;                   ///< the greatest u
};

/// Acceleration along the path, du/dt' <= 0, that brakes hardest while no joint passes its limit:
/// |first_j w + second_j v^2| <= limit_j. Where the path's own curvature passes a limit at this speed, the one that passes
/// it least; `acceleration_overload` then is by how much (1: not at all).
inline double max_deceleration(int dof, const double* first, const double* second, const double* limit, double v,
                               double& acceleration_overload) {
    constexpr double at_once = 1e12;  // an arm that stands still needs no time
    auto lowest = [&](double level, double& low) {
        double high = 0;
        low = -at_once;
        for (int j = 0; j < dof; ++j) {
            const double own = second[j] * v * v, most = level * limit[j];
            if (std::fabs(first[j]) * at_once <= most) {
                if (std::fabs(own) > most) return false;
                continue;
            }
            const double a = (most - own) / first[j], b = (-most - own) / first[j];
            low = std::max(low, std::min(a, b));
            high = std::min(high, std::max(a, b));
        }
        return low <= high;
    };
    double w;
    acceleration_overload = 1;
    if (lowest(1, w)) return w;
    // At constant speed the acceleration_overload is that of the curvature alone, so the least lies below.
    double allowed = 0, below = 1;
    for (int j = 0; j < dof; ++j) allowed = std::max(allowed, std::fabs(second[j]) * v * v / limit[j]);
    allowed *= 1 + 1e-12;
    for (int i = 0; i < 40; ++i) {
        const double middle = 0.5 * (below + allowed);
        (lowest(middle, w) ? allowed : below) = middle;
    }
    acceleration_overload = allowed;
    return lowest(allowed, w) ? std::min(w, 0.0) : 0.0;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
