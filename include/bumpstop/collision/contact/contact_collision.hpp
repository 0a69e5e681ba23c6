/// @file
/// Collisions in which something gives way, from the undisturbed path to what a reaction makes of them.
#pragma once

#include "bumpstop/collision/contact/contact_paths.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What reactions make of collisions that are under way, or to come.
class ContactReactions {
  public:
    static constexpr double negligible_chance = 1e-6;  ///< of reactions that others stand for

    /// `peak_only`: neither a lasting force nor a duration is wanted. An arm that has turned back is then followed until an
    /// oscillation has had its peak.
    ContactReactions(const ContactPaths& paths, const ContactPropagator& by, bool peak_only = false)
        : paths_(&paths),
          peak_only_(peak_only),
          dynamics_(by),
          swing_(int(std::min(4 * by.half_oscillation / paths.step, 1e6)) + 2),
          settles_(int(std::min(2 * by.servo_lag / paths.step, 1e6)) + swing_) {}

    const ContactPaths& paths() const { return *paths_; }
    const ContactDynamics& dynamics() const { return dynamics_; }
    bool peak_only() const { return peak_only_; }
    /// The arm gives way.
    bool swings() const { return dynamics_.propagator().elastic(); }

    struct Outcome {
        double peak, lasting, duration;  ///< greatest force, in all and after the transient phase [N]; in contact [s]
    };

    /// Detection at a tick; `state` is that of the collision `first` steps later, from 0 up to the latency.
    Outcome operator()(ContactState state, int tick, int first, double offset) const {
        set_out(state, paths_->tick_step(tick) + first);
        // A rigid arm that stops short of the body need not be followed. One that gives way swings beyond its path.
        const double most = paths_->max_distance[std::size_t(tick)];
        if (state.touched || most > offset - separation_tolerance || (swings() && std::isfinite(most)))
            follow(state, PathAfter(*paths_, tick, first), offset);
        return {state.peak, state.lasting, state.since};
    }
    /// Nothing reacts from `step` on: the motion goes on to its end, where the arm stands.
    Outcome undisturbed(ContactState state, int step, double offset) const {
        set_out(state, step);
        follow(state, PathAfter::undisturbed(*paths_, step), offset);
        return {state.peak, state.lasting, state.since};
    }

    /// How far the arm gets after a false alarm at a tick [m].
    double reach(int tick) const {
        const double most = paths_->max_distance[std::size_t(tick)];
        if (!swings() || !std::isfinite(most)) return most;
        ContactState state;
        set_out(state, paths_->tick_step(tick));
        follow(state, PathAfter(*paths_, tick, 0), nowhere);
        return state.farthest + nowhere;
    }
    /// How far it gets where nothing reacts from a step on [m]; of one that gives way.
    double reach_undisturbed(int step) const {
        ContactState state;
        set_out(state, step);
        follow(state, PathAfter::undisturbed(*paths_, step), nowhere);
        return state.farthest + nowhere;
    }

  private:
    /// A reaction sets out from a step: until then the reference has gone on undisturbed.
    void set_out(ContactState& state, int from) const {
        state.ramp = paths_->change(from);
        if (!state.begun) state.speed = paths_->speed(from);
        state.begun = true;
    }

    static constexpr double nowhere = 1e3;       ///< where a body stands that no arm reaches [m]
    static constexpr int max_retreat = 1 << 15;  ///< steps; an arm that falls back more slowly stands

    /// Until arm and body have separated, or the arm has come to rest. A held body that the arm has left is met again only if
    /// the reference comes back to it: what the arm's oscillation brings about then is less than before.
    void follow(ContactState& state, const PathAfter& path, double offset) const {
        const int block = dynamics_.propagator().block_steps, longest = path.length();
        // The reaction itself makes an elastic arm swing, before it touches the body, too.
        const bool swings = this->swings();
        state.reacts = true;
        int met = state.touched ? 0 : -1;  // step in which it is touched; -1: it is not
        double from = path.at(0);
        int farther = 0;  // the last step known after which the reference goes beyond where it is
        for (int i = 0; !state.separated; ++i) {
            allow_interruption();
            if (met < 0 && state.touched) met = i;
            if (peak_only_ && path.later(i) > from) farther = i;
            // One whose servo lags is pressed on by a reference that turned back long ago.
            const int calm = met < 0 ? longest + settles_ : std::max(longest, met) + swing_;
            const bool late = i >= calm,
                       turned = peak_only_ && met >= 0 && i > std::max(farther, met) + settles_ &&
                                dynamics_.propagator().static_stiffness * (from - offset) <= state.peak;
            if (turned || (late && (!path.retreats() || i >= longest + max_retreat)))
                return dynamics_.rest(state, from - offset);
            if (!state.contact) {
                if (i >= longest && (late || !may_meet(state))) return;
                if (path.later(i) <= offset && (met >= 0 || !swings)) return;
            }
            if (block > 0 && (swings || state.touched)) {
                std::array<double, ContactBlock::points + 1> ahead;
                ahead[0] = from;
                path.copy(i + 1, block, &ahead[1]);
                const int until = met < 0 ? block : steps_until_left(path, i, block, offset),
                          most = i < calm ? std::min(block, calm - i) : block,
                          steps = dynamics_.leap(state, ahead.data(), offset, until, most);
                from = ahead[std::size_t(steps)];
                i += steps;
                if (steps == most) {
                    --i;
                    continue;
                }
            }
            const double to = path.at(i + 1);
            if (swings || state.meets(to, offset)) dynamics_.step(state, from, to, offset, path.later(i + 1) <= offset);
            from = to;
        }
    }
    /// Steps, up to `block`, after which a body that is not touched has been left behind for good.
    static int steps_until_left(const PathAfter& path, int i, int block, double offset) {
        int n = block;
        while (n > 1 && path.later(i + n - 1) <= offset) --n;
        return n;
    }
    /// Whether the arm may by itself come to a body that it has not met, or back to one that is held.
    bool may_meet(const ContactState& state) const { return swings() && !state.separated; }

    const ContactPaths* paths_;
    bool peak_only_;
    ContactDynamics dynamics_;
    int swing_;    // simulation steps until an oscillation at rest has had its peak
    int settles_;  // the same, after the servo has brought the arm to its reference
};

/// One body, whose first tick in contact is `tick`: the contact at every tick of the undetected collision, and what a reaction
/// makes of it. Ticks are computed when they are first asked for.
class ContactCollision {
  public:
    using Outcome = ContactReactions::Outcome;

    ContactCollision(const ContactReactions& reactions, int tick, double offset)
        : reactions_(&reactions),
          tick_(tick),
          first_(reactions.paths().tick_step(tick - 1)),
          // From the tick before the first one in contact: contact begins after it. Only an arm that turns back at once may
          // have touched the body before, between two ticks.
          begin_(std::min(first_, reactions.paths().step_before(offset))),
          step_(begin_),
          offset_(offset) {}

    double force(int i) { return i < 0 ? 0.0 : at(i).force; }
    /// Whether the body has got away by the i-th tick in contact.
    bool separated(int i) { return at(i).separated; }
    /// What a joint's residual shows of an elastic arm at the i-th tick in contact [Nm].
    double residual(int i, int joint) {
        at(i);
        return residual_[std::size_t(i * reactions_->dynamics().propagator().dof + joint)];
    }

    /// The collision is detected at the i-th tick in contact; i below zero: before contact.
    Outcome detected(int i) {
        const ContactPaths& paths = reactions_->paths();
        const int tick = std::clamp(tick_ + i, 0, paths.path->ticks - 1);
        if (i < 0) return (*reactions_)(ContactState(), tick, 0, offset_);
        go_on_to(steps_to(i) + paths.latency);
        return (*reactions_)(begun_[std::size_t(i)], tick, paths.latency, offset_);
    }
    /// It is not detected.
    Outcome undetected() {
        // Up to the last tick the arm does not react to anything, not even to the end of its motion.
        while (step_ < last_tick() && !now_.separated) go_on_to(step_ + 1);
        return reactions_->undisturbed(step_ < last_tick() ? now_ : at_last_tick_, last_tick(), offset_);
    }

  private:
    struct Tick {
        double force;  ///< N
        bool separated;
    };
    const Tick& at(int i) {
        go_on_to(steps_to(i));
        return at_tick_[std::size_t(i)];
    }
    int last_tick() const { return reactions_->paths().tick_step(reactions_->paths().path->ticks - 1); }
    /// The step of the i-th tick in contact.
    int steps_to(int i) const { return first_ + (i + 1) * reactions_->paths().period; }

    void go_on_to(int last) {
        const ContactPaths& paths = reactions_->paths();
        const ContactDynamics& dynamics = reactions_->dynamics();
        while (step_ < last) {
            allow_interruption();
            const double from = paths.undisturbed(step_), to = paths.undisturbed(++step_);
            const bool known = step_ > 0 && step_ <= paths.last_step();
            if (known && now_.meets(to, offset_)) dynamics.step(now_, from, to, offset_);
            if (step_ == last_tick()) at_last_tick_ = now_;
            const int since = step_ - first_;
            if (since > 0 && since % paths.period == 0) {
                at_tick_.push_back({now_.force, now_.separated});
                const int dof = dynamics.propagator().dof;
                residual_.resize(residual_.size() + std::size_t(dof));
                if (dof > 0) dynamics.residuals(now_, nullptr, dof, residual_.data() + residual_.size() - dof);
            }
            if (since > paths.latency && (since - paths.latency) % paths.period == 0) begun_.push_back(now_);
        }
    }

    const ContactReactions* reactions_;
    int tick_, first_;  // first_: step of the tick before the first one in contact
    int begin_, step_;  // simulation steps
    double offset_;
    ContactState now_, at_last_tick_;  // after step_ steps; where contact begins after the last tick, before it
    std::vector<Tick> at_tick_;        // by tick in contact
    std::vector<double> residual_;     // [tick in contact][joint]
    std::vector<ContactState> begun_;  // when the reaction to a tick in contact begins
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
