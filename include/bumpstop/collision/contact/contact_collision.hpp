/// @file
/// Collisions of an elastic arm, or with a body that moves, from first contact to the end of the reaction.
#pragma once

#include "bumpstop/collision/contact/contact_paths.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Simulates collisions from the reaction to a tick on.
class ContactReactions {
  public:
    /// Reactions less probable than this are interpolated, or represented by others.
    static constexpr double negligible_chance = 1e-6;

    /// `peak_only`: lasting force and duration are not needed. An arm that retreats is then simulated only until the
    /// oscillation has had its peak.
    ContactReactions(const ContactPaths& paths, const ContactPropagator& by, bool peak_only = false)
        : paths_(&paths),
          peak_only_(peak_only),
          dynamics_(by),
          oscillation_steps_(int(std::min(4 * by.half_oscillation / paths.step, 1e6)) + 2),
          settling_steps_(int(std::min(2 * by.servo_lag / paths.step, 1e6)) + oscillation_steps_) {}

    const ContactPaths& paths() const { return *paths_; }
    const ContactDynamics& dynamics() const { return dynamics_; }
    bool peak_only() const { return peak_only_; }
    bool elastic() const { return dynamics_.propagator().elastic(); }

    struct Outcome {
        double peak, lasting, duration;  ///< greatest force, in all and after the transient phase [N]; in contact [s]
    };

    /// Detection at a tick; `state` is that of the collision when the arm leaves its line.
    Outcome operator()(ContactState state, int tick, double offset) const {
        paths_->begin_reaction(state, paths_->reaction_begin(tick));
        // A rigid arm that stops short of the body need not be simulated. An elastic one oscillates beyond its path.
        const double most = paths_->max_distance[std::size_t(tick)];
        if (state.touched || most > offset - separation_tolerance || (elastic() && std::isfinite(most)))
            simulate(state, after(tick), offset);
        return {state.peak, state.lasting, state.duration};
    }
    /// The same before contact.
    Outcome without_contact(int tick, double offset) const {
        const int begin = paths_->reaction_begin(tick);
        int step = std::min(begin, paths_->step_before(offset));
        ContactState state = paths_->approaching(step);
        for (; step < begin; ++step) paths_->advance(dynamics_, state, step, offset);
        return (*this)(state, tick, offset);
    }
    /// Without a detection; `state` is that of the collision at the end of the motion, where the arm stops.
    Outcome undetected(ContactState state, double offset) const {
        paths_->begin_reaction(state, paths_->motion_end());
        simulate(state, PathAfter::undisturbed(*paths_, paths_->motion_end()), offset);
        return {state.peak, state.lasting, state.duration};
    }

    /// Greatest distance of the arm after a false alarm at a tick [m].
    double max_distance(int tick) const {
        const double most = paths_->max_distance[std::size_t(tick)];
        if (!elastic() || !std::isfinite(most)) return most;
        return max_distance(after(tick), paths_->reaction_begin(tick));
    }
    /// The same of an elastic arm without an alarm.
    double max_distance_undetected() const {
        return max_distance(PathAfter::undisturbed(*paths_, paths_->motion_end()), paths_->motion_end());
    }

  private:
    PathAfter after(int tick) const {
        return PathAfter(*paths_, tick, paths_->reaction_begin(tick) - paths_->tick_step(tick));
    }
    double max_distance(const PathAfter& path, int from) const {
        ContactState state = paths_->approaching(from);
        paths_->begin_reaction(state, from);
        simulate(state, path, ContactPaths::out_of_reach);
        return std::max(paths_->max_before[std::size_t(from)], state.max_penetration + ContactPaths::out_of_reach);
    }

    static constexpr int max_retreat = 1 << 15;  ///< steps; an arm that retreats more slowly counts as standing

    /// Simulates until arm and body have separated, or the arm has come to rest. A held body that the arm has left is
    /// touched again only if the reference comes back to it, because its oscillation makes no greater force.
    void simulate(ContactState& state, const PathAfter& path, double offset) const {
        const int block = dynamics_.propagator().block_steps, longest = path.length();
        // The reaction itself makes an elastic arm oscillate, also before it touches the body.
        const bool elastic = this->elastic();
        int touch = state.touched ? 0 : -1;  // step of the first touch; -1: none so far
        double from = path.at(0);
        int farther = 0;  // the last step so far after which the reference still comes farther
        for (int i = 0; !state.separated; ++i) {
            allow_interruption();
            if (touch < 0 && state.touched) touch = i;
            if (peak_only_ && path.max_later(i) > from) farther = i;
            // Because its servo lags, the arm still presses long after the reference has turned back.
            const int settled = touch < 0 ? longest + settling_steps_ : std::max(longest, touch) + oscillation_steps_;
            const bool late = i >= settled,
                       turned = peak_only_ && touch >= 0 && i > std::max(farther, touch) + settling_steps_ &&
                                dynamics_.propagator().static_stiffness * (from - offset) <= state.peak;
            if (turned || (late && (!path.retreats() || i >= longest + max_retreat)))
                return dynamics_.rest(state, from - offset);
            if (!state.contact) {
                if (i >= longest && (late || !elastic)) return;
                if (path.max_later(i) <= offset && (touch >= 0 || !elastic)) return;
            }
            if (block > 0 && (elastic || state.touched)) {
                std::array<double, ContactBlock::points + 1> ahead;
                ahead[0] = from;
                path.copy(i + 1, block, &ahead[1]);
                const int until = touch < 0 ? block : steps_until_left(path, i, block, offset),
                          most = i < settled ? std::min(block, settled - i) : block,
                          steps = dynamics_.step_block(state, ahead.data(), offset, until, most);
                from = ahead[std::size_t(steps)];
                i += steps;
                if (steps == most) {
                    --i;
                    continue;
                }
            }
            const double to = path.at(i + 1);
            if (elastic || state.needs_step(to, offset))
                dynamics_.step(state, from, to, offset, path.max_later(i + 1) <= offset);
            from = to;
        }
    }
    /// Steps, up to `block`, after which the reference stays behind a body that is not touched.
    static int steps_until_left(const PathAfter& path, int i, int block, double offset) {
        int n = block;
        while (n > 1 && path.max_later(i + n - 1) <= offset) --n;
        return n;
    }

    const ContactPaths* paths_;
    bool peak_only_;
    ContactDynamics dynamics_;
    int oscillation_steps_;  // simulation steps until an oscillation about rest has had its peak
    int settling_steps_;     // the same, after the servo has brought the arm to its reference
};

/// The collision with one body, whose first tick in contact is `tick`: force and residual at every tick as long as it
/// is not detected, and the outcome of a detection at any of them. Ticks are computed when they are first needed.
class ContactCollision {
  public:
    using Outcome = ContactReactions::Outcome;

    ContactCollision(const ContactReactions& reactions, int tick, double offset)
        : reactions_(&reactions),
          tick_(tick),
          first_(reactions.paths().tick_step(tick - 1)),
          // Contact begins after the tick before the first one in contact. Only an arm that retreats at once may have
          // touched the body earlier, between two ticks.
          step_(std::min(first_, reactions.paths().step_before(offset))),
          offset_(offset),
          state_(reactions.paths().approaching(step_)),
          at_motion_end_(state_),
          at_line_end_(state_) {}

    double force(int i) { return i < 0 ? 0.0 : at(i).force; }
    /// Whether the body has separated by the i-th tick in contact.
    bool separated(int i) { return at(i).separated; }
    /// Residual of a joint of an elastic arm at the i-th tick in contact, without noise [Nm].
    double residual(int i, int joint) {
        at(i);
        return residual_[std::size_t(i * reactions_->dynamics().propagator().dof + joint)];
    }

    /// The collision is detected at the i-th tick in contact; i below zero: before contact.
    Outcome detected(int i) {
        const ContactPaths& paths = reactions_->paths();
        const int tick = std::clamp(tick_ + i, 0, paths.path->ticks - 1);
        if (i < 0) return reactions_->without_contact(tick, offset_);
        const int begin = std::min(step_of(i) + paths.latency, paths.line_end());
        advance_to(begin);
        return (*reactions_)(begin < step_of(i) + paths.latency ? at_line_end_ : at_reaction_[std::size_t(i)], tick,
                             offset_);
    }
    /// It is not detected: the arm reacts to nothing but the end of its motion.
    Outcome undetected() {
        const int end = reactions_->paths().motion_end();
        while (step_ < end && !state_.separated) advance_to(step_ + 1);
        return reactions_->undetected(step_ < end ? state_ : at_motion_end_, offset_);
    }

  private:
    struct Tick {
        double force;  ///< N
        bool separated;
    };
    const Tick& at(int i) {
        advance_to(step_of(i));
        return at_tick_[std::size_t(i)];
    }
    /// The step of the i-th tick in contact.
    int step_of(int i) const { return first_ + (i + 1) * reactions_->paths().period; }

    void advance_to(int last) {
        const ContactPaths& paths = reactions_->paths();
        const ContactDynamics& dynamics = reactions_->dynamics();
        while (step_ < last) {
            allow_interruption();
            if (step_ >= 0 && step_ < paths.last_step()) paths.advance(dynamics, state_, step_, offset_);
            ++step_;
            if (step_ == paths.motion_end()) at_motion_end_ = state_;
            if (step_ == paths.line_end()) at_line_end_ = state_;
            const int since = step_ - first_;
            if (since > 0 && since % paths.period == 0) {
                at_tick_.push_back({state_.force, state_.separated});
                const int dof = dynamics.propagator().dof;
                residual_.resize(residual_.size() + std::size_t(dof));
                if (dof > 0) dynamics.residuals(state_, nullptr, dof, residual_.data() + residual_.size() - dof);
            }
            if (since > paths.latency && (since - paths.latency) % paths.period == 0) at_reaction_.push_back(state_);
        }
    }

    const ContactReactions* reactions_;
    int tick_, first_;  // first_: step of the tick before the first one in contact
    int step_;          // simulation steps so far
    double offset_;
    ContactState state_, at_motion_end_, at_line_end_;  // after step_ steps; at these ends, once they are reached
    std::vector<Tick> at_tick_;                         // by tick in contact
    std::vector<double> residual_;                      // [tick in contact][joint]
    std::vector<ContactState> at_reaction_;             // when the reaction to a tick in contact begins
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
