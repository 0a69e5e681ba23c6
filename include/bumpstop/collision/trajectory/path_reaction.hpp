/// @file
/// Reactions along the path of a trajectory, and the greatest deceleration on it.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "bumpstop/model/kinematics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Motion along the path after a tick, by simulation step from the beginning of the reaction.
struct PathReaction {
    std::vector<double> u;              ///< place on the path, until the final speed of the reaction is reached [s]
    std::vector<Point3<double>> point;  ///< contact point, while the arm moves forward and one step more [m]
    double reach = 0;                   ///< the greatest u
};

/// The acceleration w = dv/dt <= 0 along the path, v = du/dt, that brakes hardest within the joints' limits:
/// |first_j w + second_j v^2| <= limit_j. Where the curvature of the path alone exceeds a limit at this speed, w makes
/// the largest ratio of acceleration to limit as small as possible. `acceleration_overload`: that ratio, else 1.
inline double max_deceleration(int dof, const double* first, const double* second, const double* limit, double v,
                               double& acceleration_overload) {
    constexpr double at_once = 1e12;  // bounds w where no joint moves
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
    // With w = 0 the ratio is that of the curvature alone: an upper bound of the smallest one, which bisection finds.
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
