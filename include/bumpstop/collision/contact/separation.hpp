/// @file
/// When bodies that nothing holds separate from an arm that does not detect them.
#pragma once

#include "bumpstop/collision/contact/contact_paths.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The undetected collision with one body. Times are in steps from the start of the motion.
struct Separation {
    double offset = 0;            ///< [m]
    double touch = 0;             ///< first touch, which lies within a step
    double separated = HUGE_VAL;  ///< infinite: not before the end of the path
    double end = 0;               ///< of contact, at the latest that of the path
    bool smooth = false;          ///< for bodies up to the next one found, contact ends between these two ends

    double duration() const { return end - touch; }
};

/// When contact ends with a body between two of which the first is `smooth`, first touched at `touch`.
inline double end_between(const Separation& low, const Separation& high, double touch) {
    const double share = (touch - low.touch) / (high.touch - low.touch);
    return low.end + share * (high.end - low.end);
}

class Separations {
  public:
    Separations(const ContactPaths& paths, const ContactPropagator& by) : paths_(paths), dynamics_(by) {
        double most = -HUGE_VAL;
        for (int i = 0; i <= paths.last_step(); ++i) reached_.push_back(most = std::max(most, paths.undisturbed(i)));
    }

    /// The collision with a body at `offset`; `at_step(i, state)` is told the state after each step from the touch on.
    template <class AtStep>
    Separation operator()(double offset, AtStep at_step) const {
        int i = int(std::upper_bound(reached_.begin() + 1, reached_.end(), offset) - reached_.begin()) - 1;
        ContactState state = paths_.approaching(i);
        const double rise = paths_.undisturbed(i + 1) - paths_.undisturbed(i);
        Separation found;
        found.offset = offset;
        found.touch = rise > 0 ? i + std::clamp((offset - paths_.undisturbed(i)) / rise, 0.0, 1.0) : i + 1.0;
        for (; i < paths_.last_step() && !state.separated; ++i) {
            allow_interruption();
            const bool touched = state.touched;
            paths_.advance(dynamics_, state, i, offset);
            // An elastic arm is not quite where its reference is.
            if (!touched && state.touched && !state.separated) found.touch = i + 1 - state.elapsed / paths_.step;
            at_step(i, state);
        }
        if (state.separated) found.separated = found.touch + state.duration / paths_.step;
        found.end = std::min(found.separated, double(paths_.last_step()));
        return found;
    }
    Separation operator()(double offset) const {
        return (*this)(offset, [](int, const ContactState&) {});
    }

    /// Distances up to `largest` that the arm reaches after a step for the first time [m]: bodies there are told apart.
    std::vector<double> offsets(double largest) const {
        std::vector<double> found;
        for (double offset : reached_) {
            offset = std::min(offset, largest);
            if (found.empty() || offset > found.back()) found.push_back(offset);
        }
        return found;
    }
    /// Collisions with bodies at these offsets. Where contact ends smoothly only a few of them are simulated.
    std::vector<Separation> up_to(double largest) const {
        const std::vector<double> offset = offsets(largest);
        std::vector<Separation> found{(*this)(offset.front())};
        if (offset.size() > 1) add_between(offset, 0, offset.size() - 1, (*this)(offset.back()), found);
        return found;
    }

  private:
    /// Adds those after offset[low], which is the last one found, to `last`, which is at offset[high].
    void add_between(const std::vector<double>& offset, std::size_t low, std::size_t high, const Separation& last,
                     std::vector<Separation>& found) const {
        if (high - low > 1) {
            const std::size_t middle = (low + high) / 2;
            const Separation first = found.back(), between = (*this)(offset[middle]);
            if (!smooth(first, between, last)) {
                add_between(offset, low, middle, between, found);
                return add_between(offset, middle, high, last, found);
            }
            found.back().smooth = true;
            found.push_back(between);
            found.back().smooth = true;
        }
        found.push_back(last);
    }

    /// Whether contact ends smoothly from one body to another. With x the compression, V the speed of a rigid arm and w
    /// the natural frequency, x(t) is the integral of V(u) cos w(t - u) over u since the touch. If V stays within a
    /// twentieth of what it is at the touch, x returns to zero once, half an oscillation later within a twentieth, and
    /// the later the later the touch. Elastic arms and much damping are trusted at hardly differing speeds only.
    bool smooth(const Separation& low, const Separation& middle, const Separation& high) const {
        constexpr double most_change = 0.05, most_change_of_others = 1e-3, most_error = 1e-3;  // error in steps
        // An elastic arm may still swing after its start.
        if (!paths_.approach.empty()) return false;
        if (!(std::fabs(end_between(low, high, middle.touch) - middle.end) <= most_error)) return false;
        const double half = dynamics_.propagator().half_oscillation / paths_.step;
        bool known = !dynamics_.propagator().elastic();
        for (const Separation* each : {&low, &middle, &high})
            known = known && std::fabs(each->duration() - half) <= most_change * half;
        const double change = known ? most_change : most_change_of_others;
        double least = HUGE_VAL, most = -HUGE_VAL;
        for (int i = int(low.touch) + 1; i <= int(std::ceil(high.end)); ++i) {
            const double speed = paths_.speed(i);
            least = std::min(least, speed);
            most = std::max(most, speed);
            if (!(most - least <= change * least)) return false;
        }
        return true;
    }

    const ContactPaths& paths_;
    ContactDynamics dynamics_;
    std::vector<double> reached_;  // by step: greatest distance until then [m]
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
