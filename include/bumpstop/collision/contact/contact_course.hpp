/// @file
/// One collision in time, along a path that is given.
#pragma once

#include <span>

#include "bumpstop/collision/contact/contact_dynamics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct ContactCourse {
    std::vector<double> force;     ///< after every step [N]
    std::vector<double> residual;  ///< [step][joint] of an elastic arm, without noise [Nm]
    double peak = 0;               ///< between steps, too [N]
    double duration = 0;           ///< in contact [s]
};

/// `path`: distances of the reference after every simulation step, the start first; the body stands at `offset` [m].
inline ContactCourse contact_course(const ContactPropagator& by, std::span<const double> path, double offset) {
    const ContactDynamics dynamics(by);
    ContactState state;
    state.reacts = true;  // whatever the path does is sudden
    ContactCourse course;
    for (std::size_t i = 0; i < path.size(); ++i) {
        allow_interruption();
        if (i > 0) dynamics.step(state, path[i - 1], path[i], offset);
        course.force.push_back(state.force);
        if (by.dof == 0) continue;
        course.residual.resize(course.residual.size() + std::size_t(by.dof));
        dynamics.residuals(state, nullptr, by.dof, course.residual.data() + course.residual.size() - by.dof);
    }
    course.peak = state.peak;
    course.duration = state.since;
    return course;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
