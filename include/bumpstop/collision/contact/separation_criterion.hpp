/// @file
/// How far a line has to be followed where something gives way.
#pragma once

#include "bumpstop/collision/contact/contact_dynamics.hpp"
#include "bumpstop/collision/motion/stopping_curve.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Ends a line once even the farthest body has been struck and should have got away: at constant speed that takes
/// half an oscillation, and three halves leave room for an arm that does not keep its speed. One that speeds up may
/// push for longer: see `all_separated`.
template <class T>
class SeparationCriterion {
  public:
    /// `longest`: the line goes on for this after it has touched the farthest body [s].
    SeparationCriterion(double largest_offset, double longest, const CollisionSetup& setup)
        : largest_offset_(largest_offset), max_ticks_(longest / (setup.timing.period * setup.motion.step) + 2) {}

    void observe(const T& s, const T*) { s_ = s; }
    bool finished(int moment) {
        if (lane_of(s_, moment) > largest_offset_) ++ticks_;
        return ticks_ > max_ticks_;
    }

  private:
    double largest_offset_;  ///< m
    double max_ticks_;       ///< beyond the farthest body
    T s_;                    ///< distances of the moments observed [m]
    int ticks_ = 0;          ///< beyond the farthest body so far
};

/// Whether every body up to `largest_offset` has got away before the last tick of a path, which touches all of them. A
/// body struck after every step tells.
inline bool all_separated(const LinePath& path, const ContactPropagator& by, const Timing& timing,
                          double largest_offset) {
    const ContactDynamics dynamics(by);
    const std::size_t last = std::size_t(path.ticks - 1) * std::size_t(timing.period) + 1;
    double offset = -HUGE_VAL;
    for (std::size_t first = 0; first < last && offset < largest_offset; ++first) {
        if (!(path.s[first] > offset)) continue;  // whoever stands here has been struck before
        offset = std::min(path.s[first], largest_offset);
        ContactState state;
        // The farthest body stands before this step.
        for (std::size_t i = first > 0 ? first - 1 : 0; i < last && !state.separated; ++i)
            dynamics.step(state, path.s[i], path.s[i + 1], offset);
        if (!state.separated) return false;
    }
    return true;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
