/// @file
/// The body that the arm hits, and its distance.
#pragma once

#include <optional>

#include "bumpstop/collision/contact/contact_propagator.hpp"
#include "bumpstop/collision/distribution/offset_distribution.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct Contact {
    ContactBody body{};
    OffsetDistribution offset{};  ///< how far the body is from the contact point when the motion begins

    /// A rigid arm and the body as a linear system; none for a clamped spring, which needs no state.
    std::optional<ContactSystem> system() const {
        if (body.clamped() && !(body.damping > 0)) return std::nullopt;
        return ContactSystem(ElasticArm{}, body);
    }
    /// The same body at the place where contact begins.
    Contact at_body() const { return {body, {OffsetKind::fixed, 0.0}}; }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
