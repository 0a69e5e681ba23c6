/// @file
/// A reaction to simulate, and what of it is wanted.
#pragma once

#include <limits>
#include <vector>

#include "bumpstop/collision/motion/arm_integrator.hpp"
#include "bumpstop/collision/motion/line_path.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// One reaction to simulate: that of `tick` on `path`. distance[i] is the distance along the normal step[i] simulation
/// steps into the reaction; step[0] is 0, where it begins.
struct ReactionJob {
    const LinePath* path;
    int curve;                                                ///< number of the curve that the path belongs to
    int tick;                                                 ///< that it reacts to; below 0: one before the first
    std::vector<double> distance;                             ///< result [m]
    std::vector<int> step;                                    ///< result
    double tolerance = exact_tolerance;                       ///< as of ArmIntegrator::begin
    double enough = std::numeric_limits<double>::infinity();  ///< nothing is asked beyond this distance [m]
    double return_to = 0;          ///< distance [m] behind which a point that reverses is back
    bool may_rebound = true;       ///< else the first retreat is accepted, whatever is near
    bool rebounded = false;        ///< result: during its retreat the point came near its farthest again
    bool met_singularity = false;  ///< result: a singularity was near somewhere on its way
};

/// What of a reaction is wanted. `only_peak`: steps far from a farthest point may be missing, and a reaction that
/// reverses ends once the point retreats for good: on the way back nothing brings it forward again unless a singularity
/// was near, or the arm did not follow its line and swings on. Such an arm is followed until half again the time has
/// passed that the slowest joint needs to stop, and 50 ms more: the length of a run after detection in Schroeder
/// (2013); and to its first retreat, if that is later. `every_step`: all steps; one that reverses is followed for as
/// long, and until the point is back behind `return_to`. If after that time it gets farther than ever before instead,
/// it ends before that: no force counts that `only_peak` does not know. A reaction that stops is followed until it has.
enum class ReactionDetail { every_step, only_peak };

/// Steps after which a reaction is left where it is: an arm that cannot reverse near a singularity must not run for
/// ever. Any other is done long before. Its slowest joint stands after `stop_time` [s] and has reversed after twice
/// that; it then goes back no farther than it came on its way of `path_steps`. `substeps` keeps controller sub-steps
/// countable.
inline int max_reaction_steps(double stop_time, std::size_t path_steps, double step, int substeps) {
    const double needed = std::min(4 * stop_time / step, 2e6) + 2 * double(path_steps);
    return int(std::min(std::max(needed, 20000.0), 2e9 / substeps));
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
