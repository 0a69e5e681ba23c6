/// @file
/// Collisions in which something gives way, from the undisturbed path to what a reaction makes of them.
#pragma once

#include "bumpstop/collision/contact/contact_paths.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What reactions make of collisions that are under way, or to come.
template <class T>
class ContactReactions {
  public:
    using State = ContactState<T>;
    static constexpr int lanes = Scalar<T>::lanes;

    ContactReactions(const ContactPaths& paths, const ContactPropagator& by)
        : paths_(&paths),
          dynamics_(by),
          swing_(int(std::min((by.elastic ? 4 : 1) * by.half_oscillation / paths.step, 1e6)) + 2) {}

    const ContactPaths& paths() const { return *paths_; }
    const ContactDynamics<T>& dynamics() const { return dynamics_; }

    struct Outcome {
        T peak, lasting, duration;  ///< greatest force, in all and after the transient phase [N]; in contact [s]
    };

    /// Detection at tick[lane]; `state` is that of the collision first[lane] steps later, from 0 up to the latency.
    Outcome operator()(State state, const int* tick, const int* first, T offset) const {
        PathAfter path[lanes];
        int longest = 0;
        for (int lane = 0; lane < lanes; ++lane) {
            path[lane] = PathAfter(*paths_, tick[lane], first[lane]);
            set_lane(state.ramp, lane, paths_->change(paths_->tick_step(tick[lane])));
            // An arm that stops short of the body need not be followed.
            const bool arrives =
                paths_->max_distance[std::size_t(tick[lane])] > lane_of(offset, lane) - separation_tolerance;
            if (arrives || lane_of(state.touched, lane) > 0.5) longest = std::max(longest, path[lane].length());
        }
        if (longest > 0) follow(state, path, longest, offset);
        return {state.peak, state.lasting, state.since};
    }
    /// Nothing reacts from step[lane] on: the motion goes on to its end, where the arm stands.
    Outcome undisturbed(State state, const int* step, T offset) const {
        PathAfter path[lanes];
        int longest = 0;
        for (int lane = 0; lane < lanes; ++lane) {
            path[lane] = PathAfter::undisturbed(*paths_, step[lane]);
            set_lane(state.ramp, lane, paths_->change(step[lane]));
            longest = std::max(longest, path[lane].length());
        }
        follow(state, path, longest, offset);
        return {state.peak, state.lasting, state.since};
    }

  private:
    static constexpr int max_retreat = 1 << 15;  ///< steps; an arm that falls back more slowly stands

    static T place(const PathAfter* path, int i) {
        double here[lanes];
        for (int lane = 0; lane < lanes; ++lane) here[lane] = path[lane].at(i);
        return load<T>(here);
    }

    /// Until all lanes have separated, or their arms have come to rest. A held body that the arm has left is met again only if
    /// the reference comes back to it: what the arm's oscillation brings about then is less than before.
    void follow(State& state, const PathAfter* path, int longest, T offset) const {
        const int block = dynamics_.propagator().block_steps;
        state.reacts = 1.0;
        T from = place(path, 0), active = 1.0;
        int wait = 0;  // steps until a leap is tried
        for (int i = 0;; ++i, --wait) {
            allow_interruption();
            if (i >= longest) {
                bool over = true, late = i >= longest + swing_;
                for (int lane = 0; lane < lanes; ++lane) {
                    if (late && (!path[lane].retreats() || i >= longest + max_retreat)) {
                        dynamics_.rest(state, from - offset, lane);
                        set_lane(active, lane, 0.0);
                    }
                    over = over && (lane_of(active, lane) < 0.5 || !lane_of(state.in_contact(), lane));
                }
                if (over && (late || !may_return(state))) return;
            }
            for (int lane = 0; lane < lanes; ++lane) {
                if (!lane_of(state.in_contact(), lane) && path[lane].later(i) <= lane_of(offset, lane))
                    set_lane(active, lane, 0.0);
            }
            if (all((active < T(0.5)) | (state.separated > T(0.5)))) return;
            const bool ends = i < longest + swing_ && i + block > longest + swing_;
            if (wait <= 0 && block > 0 && !ends && any((active > T(0.5)) & (state.touched > T(0.5)))) {
                T ahead[ContactBlock::points + 1];
                ahead[0] = from;
                for (int n = 1; n <= block; ++n) ahead[n] = place(path, i + n);
                wait = dynamics_.leap(state, ahead, offset, active, steps_until_left(path, i, block, offset));
                if (wait == 0) {
                    from = ahead[block];
                    i += block - 1;
                    continue;
                }
            }
            const T to = place(path, i + 1);
            if (any((active > T(0.5)) & state.meets(to, offset))) dynamics_.step(state, from, to, offset, active);
            from = to;
        }
    }
    /// Steps, up to `block`, after which a body that is not touched has been left behind for good.
    static T steps_until_left(const PathAfter* path, int i, int block, T offset) {
        T until = block;
        for (int lane = 0; lane < lanes; ++lane) {
            const double o = lane_of(offset, lane);
            if (path[lane].later(i + block) > o) continue;
            int n = block - 1;
            while (n > 0 && path[lane].later(i + n) <= o) --n;
            set_lane(until, lane, n + 1);
        }
        return until;
    }
    /// Arms that may come back by themselves to a body that is held.
    bool may_return(const State& state) const {
        return dynamics_.propagator().elastic && any((state.touched > T(0.5)) & (state.separated < T(0.5)));
    }

    const ContactPaths* paths_;
    ContactDynamics<T> dynamics_;
    int swing_;  // simulation steps until an oscillation at rest has had its peak
};

/// One offset in each lane, whose first tick beyond it is `tick`: the contact at every tick of the undetected collision,
/// and what a reaction makes of it. Ticks are computed when they are first asked for.
template <class T>
class ContactCollision {
  public:
    static constexpr int lanes = Scalar<T>::lanes;
    using State = ContactState<T>;
    using Outcome = typename ContactReactions<T>::Outcome;

    ContactCollision(const ContactReactions<T>& reactions, const int* tick, T offset)
        : reactions_(&reactions), offset_(offset), now_(reactions.dynamics().begin()) {
        // From the tick before the first one in contact: contact begins after it. Only an arm that turns back at once may
        // have touched the body before, between two ticks.
        for (int lane = 0; lane < lanes; ++lane) {
            tick_[lane] = tick[lane];
            first_[lane] = reactions.paths().tick_step(tick[lane] - 1);
            earlier_ = std::max(earlier_, first_[lane] - reactions.paths().step_before(lane_of(offset, lane)));
        }
        step_ = -earlier_;
        from_ = undisturbed(step_);
    }

    /// The i-th tick in contact.
    const State& at(int i) {
        go_on_to(steps_to(i));
        return at_tick_[std::size_t(i)];
    }
    T force(int i) { return i < 0 ? T(0.0) : at(i).force; }
    /// 1 where the body has not got away by the i-th tick in contact.
    T touched(int i) { return 1.0 - at(i).separated; }

    /// The collision is detected at tick tick[lane] + i[lane] of each lane; i below zero: before contact.
    Outcome detected(const int* i) {
        const ContactPaths& paths = reactions_->paths();
        State state = reactions_->dynamics().begin();
        int tick[lanes], first[lanes];
        for (int lane = 0; lane < lanes; ++lane) {
            tick[lane] = std::clamp(tick_[lane] + i[lane], 0, paths.path->ticks - 1);
            first[lane] = i[lane] >= 0 ? paths.latency : 0;
            if (i[lane] < 0) continue;
            go_on_to(steps_to(i[lane]) + paths.latency);
            state.take_lane(begun_[std::size_t(i[lane])], lane);
        }
        return (*reactions_)(std::move(state), tick, first, offset_);
    }
    /// It is not detected.
    Outcome undetected() {
        int step[lanes];
        bool known = true;  // as far as the motion goes
        for (int lane = 0; lane < lanes; ++lane) {
            step[lane] = first_[lane] + step_;
            known = known && step[lane] <= reactions_->paths().end_step;
        }
        if (known) return reactions_->undisturbed(now_, step, offset_);
        for (int lane = 0; lane < lanes; ++lane) step[lane] = first_[lane] - earlier_;
        return reactions_->undisturbed(reactions_->dynamics().begin(), step, offset_);
    }

  private:
    /// Steps from the tick before contact to the i-th one in it.
    int steps_to(int i) const { return (i + 1) * reactions_->paths().period; }
    /// Distance in every lane `r` steps after the tick before contact.
    T undisturbed(int r) const {
        const ContactPaths& paths = reactions_->paths();
        double here[lanes];
        for (int lane = 0; lane < lanes; ++lane) here[lane] = paths.undisturbed(first_[lane] + r);
        return load<T>(here);
    }

    void go_on_to(int last) {
        const ContactPaths& paths = reactions_->paths();
        while (step_ < last) {
            allow_interruption();
            ++step_;
            double active[lanes];
            for (int lane = 0; lane < lanes; ++lane) {
                const int step = first_[lane] + step_;
                active[lane] = step > 0 && step <= paths.last_step() ? 1.0 : 0.0;
            }
            const T to = undisturbed(step_);
            if (any(now_.meets(to, offset_))) reactions_->dynamics().step(now_, from_, to, offset_, load<T>(active));
            from_ = to;
            if (step_ > 0 && step_ % paths.period == 0) at_tick_.push_back(now_);
            if (step_ > paths.latency && (step_ - paths.latency) % paths.period == 0) begun_.push_back(now_);
        }
    }

    const ContactReactions<T>* reactions_;
    T offset_;
    State now_;                           // after step_ steps from the tick before contact
    int step_ = 0, earlier_ = 0;          // earlier_: steps to look back for the first touch
    T from_;                              // where the reference is then
    int tick_[lanes], first_[lanes];      // first_: step of the tick before the first one in contact
    std::vector<State> at_tick_, begun_;  // by tick in contact: then, and when the reaction to it begins
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
