/// @file
/// Joint trajectories as cubic splines, reactions along their path, and the greatest deceleration on it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "bumpstop/model/kinematics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Joint positions as piecewise cubics of the path parameter u: the time when the undisturbed arm is there.
struct JointSpline {
    int dof = 0;
    std::vector<double> time;         ///< ends of the pieces, from 0 on [s]
    std::vector<double> coefficient;  ///< [piece][power 3, 2, 1, 0 of the time since the piece began][dof]

    double duration() const { return time.back(); }

    /// Positions and their first two derivatives by u (dof each). Past its end the arm stands still.
    void at(double u, double* q, double* first, double* second) const {
        const bool past = u >= duration();
        u = std::clamp(u, 0.0, duration());
        const auto above = std::upper_bound(time.begin() + 1, time.end() - 1, u);
        const std::size_t piece = std::size_t(above - time.begin()) - 1;
        const double x = u - time[piece];
        const double* c = &coefficient[piece * 4 * std::size_t(dof)];
        for (int j = 0; j < dof; ++j) {
            const double c3 = c[j], c2 = c[dof + j], c1 = c[2 * dof + j], c0 = c[3 * dof + j];
            q[j] = c0 + x * (c1 + x * (c2 + x * c3));
            first[j] = past ? 0 : c1 + x * (2 * c2 + x * 3 * c3);
            second[j] = past ? 0 : 2 * c2 + x * 6 * c3;
        }
    }
};

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
