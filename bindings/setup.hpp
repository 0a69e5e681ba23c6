// What a scenario is to the kernels.
#pragma once

#include <functional>

#include "bumpstop/collision/line_tracer.hpp"
#include "bumpstop/collision/offset_law.hpp"
#include "bumpstop/collision/reaction.hpp"
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

// Tells where a path is over. One type for all that may tell: the tracer is compiled once.
using PathIsOver = std::function<bool(double, const double*)>;

inline LinePath trace_line(const Setup& setup, const double* q, Vector velocity, PathIsOver is_over) {
    LinePath path;
    LineTracer<double, PathIsOver>(setup.chain, setup.motion, setup.contact, setup.timing, is_over)
        .trace(q, {velocity(0), velocity(1), velocity(2)}, &path, 1);
    return path;
}

inline OffsetLaw offset_law(const std::string& kind, double size) {
    return {kind == "half_normal" ? OffsetKind::half_normal
            : kind == "uniform"   ? OffsetKind::uniform
                                  : OffsetKind::fixed,
            size};
}

inline Vector3 vector3(Vector v) { return {v(0), v(1), v(2)}; }

}  // namespace bumpstop::inline BUMPSTOP_TARGET
