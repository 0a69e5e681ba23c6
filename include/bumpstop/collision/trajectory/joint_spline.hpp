/// @file
/// Joint trajectories as cubic splines.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "bumpstop/math/mask.hpp"

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

}  // namespace bumpstop::inline BUMPSTOP_TARGET
