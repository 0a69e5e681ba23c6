// The spring.
#pragma once

#include <cmath>

#include "kinematics.hpp"

namespace reference {

struct Contact {
    Vec3 force{};          // that the arm exerts on the spring
    double magnitude = 0;  // of that force
    double travel = 0;     // s: how far the point has moved along the normal
    double depth = 0;      // how far it is past the surface; negative before it
    double deflection = 0;
    Vec3 deflection_axis{};
};

// A single plane across the normal, at `offset` from where the contact point started.
inline Contact plane_contact(const Problem& problem, const Vec3& normal, const Vec3& moved, double offset) {
    Contact contact;
    contact.travel = dot(normal, moved);
    contact.depth = contact.travel - offset;
    contact.magnitude = problem.stiffness * std::max(0.0, contact.depth);
    contact.force = contact.magnitude * normal;
    contact.deflection = std::fabs(contact.depth);
    for (int d = 0; d < 3; ++d) contact.deflection_axis[d] = std::fabs(contact.depth * normal[d]);
    return contact;
}

// The appendix's version: a wall across each axis along which the tip is to move. Each pushes for itself, and
// its force component is positive whichever way the arm moves.
//
// The appendix asks how far the tip is from its start, not on which side. So each wall is also touched,
// mirrored, behind the start, and there its spring is measured from the true wall on the far side: an arm
// that reverses past its start by more than the offset meets a force of K (distance + offset) out of nowhere.
inline Contact walls_contact(const Problem& problem, const Vec3& normal, const Vec3& moved, const double* offsets) {
    Contact contact;
    contact.travel = dot(normal, moved);
    contact.depth = -kInfinity;
    for (int d = 0; d < 3; ++d) {
        if (problem.velocity[d] == 0) continue;
        const double direction = std::copysign(1.0, problem.velocity[d]);
        const double wall_distance = std::fabs(offsets[d]);
        const double distance = problem.mirrored_walls ? std::fabs(moved[d]) : direction * moved[d];
        const double deflection = std::fabs(moved[d] - direction * wall_distance);
        contact.depth = std::max(contact.depth, distance - wall_distance);
        contact.deflection_axis[d] = deflection;
        if (distance > wall_distance) contact.force[d] = problem.stiffness * deflection;
    }
    contact.magnitude = norm(contact.force);
    contact.deflection = norm(contact.deflection_axis);
    return contact;
}

}  // namespace reference
