// Chain and inertia as Python holds them.
#pragma once

#include "bumpstop/model/dynamics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

// A chain, and its inertia in the form that belongs to it.
struct Dynamics {
    Chain chain;
    Inertias inertias;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
