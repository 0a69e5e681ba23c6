// What a scenario is to the kernels.
#pragma once

#include "bumpstop/collision/distribution/offset_distribution.hpp"
#include "bumpstop/collision/motion/line_tracer.hpp"
#include "bumpstop/collision/motion/reaction.hpp"
#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

// Arm, motion, contact point and reaction: all that a stopping curve depends on but the pose and the
// velocity.
struct Setup {
    Chain chain;
    MotionSettings motion;
    ContactGeometry contact;
    Timing timing;
    ReactionKind reaction = ReactionKind::reverse;
};

// The path of one line until `criterion` ends it.
template <class Criterion>
LinePath trace_line(const Setup& setup, const double* q, Vector velocity, Criterion criterion) {
    return trace_line<NativeLanes>(setup.chain, setup.motion, setup.contact, setup.timing,
                                   LineRequest{q, {velocity(0), velocity(1), velocity(2)}}, std::move(criterion));
}

inline OffsetDistribution offset_distribution(const std::string& kind, double size) {
    return {kind == "half_normal" ? OffsetKind::half_normal
            : kind == "uniform"   ? OffsetKind::uniform
                                  : OffsetKind::fixed,
            size};
}

inline Vector3 vector3(Vector v) { return {v(0), v(1), v(2)}; }

}  // namespace bumpstop::inline BUMPSTOP_TARGET
