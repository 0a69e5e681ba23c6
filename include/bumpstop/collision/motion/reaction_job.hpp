/// @file
/// A reaction to simulate, and which part of it is needed.
#pragma once

#include <vector>

#include "bumpstop/collision/motion/arm_integrator.hpp"
#include "bumpstop/collision/motion/line_path.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The reaction to `tick` on `path`. Result: distance[i] is the distance along the normal after step[i] simulation
/// steps of the reaction; step[0] = 0 is its beginning.
struct ReactionJob {
    const LinePath* path;
    int curve;                           ///< index of the curve that the path belongs to
    int tick;                            ///< may be negative, see LinePath::early_ticks
    std::vector<double> distance;        ///< result [m]
    std::vector<int> step;               ///< result
    double tolerance = exact_tolerance;  ///< as in ArmIntegrator::begin
    double return_to = 0;                ///< a point that reverses is followed until behind this distance [m]
    bool may_rebound = true;             ///< false: the first peak is accepted, even near a singularity
    bool rebounded = false;              ///< result: while retreating the point came near its peak again
    bool met_singularity = false;        ///< result: a singularity was near somewhere on the way
};

/// Which part of a reaction is needed.
///
/// `only_peak`: steps far from the peak may be missing, and a reaction that reverses ends once the point retreats, as
/// it comes forward again only if a singularity was near or the arm did not follow its line and swings on. Such an arm
/// is followed for 1.5 times the stopping time of its slowest joint plus 50 ms, the length of a run after detection in
/// Schroeder (2013), and at least to its first retreat.
///
/// `every_step`: all steps, for as long, and until the point is behind `return_to`. If after that time it exceeds its
/// peak instead, the reaction ends before: no force may count that `only_peak` does not find.
///
/// In both cases a reaction that stops is followed until the arm stands.
enum class ReactionDetail { every_step, only_peak };

/// Steps after which a reaction is ended in any case, because an arm near a singularity may never reverse. All others
/// end long before: the slowest joint stands after `stop_time` [s], has reversed after twice that, and goes back no
/// farther than it came in `path_steps`. The limit by `substeps` keeps the count of sub-steps within an int.
inline int max_reaction_steps(double stop_time, std::size_t path_steps, double step, int substeps) {
    const double needed = std::min(4 * stop_time / step, 2e6) + 2 * double(path_steps);
    return int(std::min(std::max(needed, 20000.0), 2e9 / substeps));
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
