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
    const ContactDynamics<double> dynamics(by);
    ContactState<double> state = dynamics.begin();
    state.reacts = 1;  // whatever the path does is sudden
    ContactCourse course;
    for (std::size_t i = 0; i < path.size(); ++i) {
        allow_interruption();
        if (i > 0) dynamics.step(state, path[i - 1], path[i], offset, 1.0);
        course.force.push_back(state.force);
        for (int j = 0; j < int(by.residual.size()); ++j) course.residual.push_back(dynamics.residual(state, j));
    }
    course.peak = state.peak;
    course.duration = state.since;
    return course;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
