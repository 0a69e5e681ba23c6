/// @file
/// One collision over time, along a given path.
#pragma once

#include <span>

#include "bumpstop/collision/contact/contact_dynamics.hpp"
#include "bumpstop/math/interruption.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct ContactCourse {
    std::vector<double> force;     ///< after every step [N]
    std::vector<double> residual;  ///< [step][joint] of an elastic arm, without noise [Nm]
    double peak = 0;               ///< between steps, too [N]
    double duration = 0;           ///< in contact [s]
};

/// `path`: distances of the reference after every simulation step, the start first; the body stands at `offset` [m].
/// The reaction begins after step `reaction`. Until then the arm stays on its reference, if its controller feeds all of
/// the acceleration forward, until it touches the body.
inline ContactCourse contact_course(const ContactPropagator& by, std::span<const double> path, double offset,
                                    std::size_t reaction) {
    const ContactDynamics dynamics(by);
    ContactState state;
    ContactCourse course;
    for (std::size_t i = 0; i < path.size(); ++i) {
        allow_interruption();
        if (i > reaction && !state.reacts) {
            state.reacts = true;
            if (i > 1 && !state.begun) {
                state.speed = (path[i - 1] - path[i - 2]) / by.step;
                state.begun = true;
            }
            if (i > 2) state.ramp = (path[i - 1] - 2 * path[i - 2] + path[i - 3]) / by.step;
        }
        if (i > 0 && (state.reacts || by.leaves_reference || state.needs_step(path[i], offset)))
            dynamics.step(state, path[i - 1], path[i], offset);
        course.force.push_back(state.force);
        if (by.dof == 0) continue;
        course.residual.resize(course.residual.size() + std::size_t(by.dof));
        dynamics.residuals(state, nullptr, by.dof, course.residual.data() + course.residual.size() - by.dof);
    }
    course.peak = state.peak;
    course.duration = state.duration;
    return course;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
