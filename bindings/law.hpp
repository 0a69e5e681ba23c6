// An exact law as Python holds it.
#pragma once

#include <string>

#include "bumpstop/collision/exact_law.hpp"
#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct Law {
    ExactLaw law;
    int dof;

    const LawQuantity& quantity(const std::string& name) const {
        if (name == "force_at_detection") return law.force_at_detection;
        if (name == "detection_delay") return law.detection_delay;
        if (name == "end_force") return law.end_force;
        return law.peak_force;
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
