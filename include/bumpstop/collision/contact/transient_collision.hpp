/// @file
/// Collisions with a body that can get away, from the undisturbed path to what a reaction makes of them.
#pragma once

#include "bumpstop/collision/contact/transient_paths.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What reactions make of collisions that are under way, or to come.
template <class T>
class TransientReactions {
  public:
    using State = ImpactState<T>;
    static constexpr int lanes = Scalar<T>::lanes;

    TransientReactions(const TransientPaths& paths, const TransientBody& body)
        : paths_(&paths),
          stiffness_(body.stiffness),
          impact_(body, paths.step),
          swing_(int(std::min(std::numbers::pi / body.frequency() / paths.step, 1e9)) + 2) {}

    const TransientPaths& paths() const { return *paths_; }
    const TransientImpact<T>& impact() const { return impact_; }
    T force(T compression) const { return compression * stiffness_; }

    struct Outcome {
        T peak, duration;  ///< [N], [s]
    };

    /// Detection at tick[lane]; `state` is that of the collision first[lane] steps later, from 0 up to the latency.
    Outcome operator()(State state, const int* tick, const int* first, T offset) const {
        PathAfter path[lanes];
        int longest = 0;
        for (int lane = 0; lane < lanes; ++lane) {
            path[lane] = PathAfter(*paths_, tick[lane], first[lane]);
            // An arm that stops short of the body need not be followed.
            const bool arrives =
                paths_->farthest[std::size_t(tick[lane])] > lane_of(offset, lane) - separation_tolerance;
            if (arrives || lane_of(state.together(), lane)) longest = std::max(longest, path[lane].length());
        }
        if (longest > 0) follow(state, path, longest, offset);
        return {force(state.peak), state.since};
    }

  private:
    static T place(const PathAfter* path, int i) {
        double here[lanes];
        for (int lane = 0; lane < lanes; ++lane) here[lane] = path[lane].at(i);
        return load<T>(here);
    }

    /// Until arm and body have parted in all lanes.
    void follow(State& state, const PathAfter* path, int longest, T offset) const {
        T from = place(path, 0);
        // Left behind at constant speed, a body parts within half an oscillation.
        for (int i = 0; i < longest + swing_; ++i) {
            allow_interruption();
            if (i >= longest) {
                for (int lane = 0; lane < lanes; ++lane)
                    if (!path[lane].retreats()) impact_.rest(state, lane);
                if (!any(state.together())) return;
            }
            const T to = place(path, i + 1);
            if (any(state.meets(to, offset))) {
                impact_.step(state, from, to, offset, T(1.0));
                if (all(state.parted > T(0.5))) return;
            }
            from = to;
        }
    }

    const TransientPaths* paths_;
    double stiffness_;
    TransientImpact<T> impact_;
    int swing_;  // simulation steps of half an oscillation, and two
};

/// One offset in each lane, whose first tick beyond it is `tick`: force at every tick of the undetected collision, and
/// what a reaction makes of it.
template <class T>
class FreeCollision {
  public:
    static constexpr int lanes = Scalar<T>::lanes;
    using Outcome = typename TransientReactions<T>::Outcome;

    FreeCollision(const TransientReactions<T>& reactions, const int* tick, T offset)
        : reactions_(&reactions), offset_(offset) {
        // From the tick before the first one in contact: contact begins after it. Only an arm that turns back at once may
        // have touched the body before, between two ticks.
        for (int lane = 0; lane < lanes; ++lane) {
            tick_[lane] = tick[lane];
            first_[lane] = reactions.paths().tick_step(tick[lane] - 1);
            earlier_ = std::max(earlier_, first_[lane] - reactions.paths().step_before(lane_of(offset, lane)));
        }
        run();
    }

    std::vector<T> force;    ///< by tick in contact, before any reaction [N]
    std::vector<T> touched;  ///< 1 where the body has not got away by then
    T peak, duration;        ///< undetected: greatest force [N] and time in contact [s]

    /// The collision is detected at tick tick[lane] + i[lane] of each lane; i below zero: before contact.
    Outcome detected(const int* i) const {
        const TransientPaths& paths = reactions_->paths();
        State state;
        int tick[lanes], first[lanes];
        for (int lane = 0; lane < lanes; ++lane) {
            tick[lane] = std::clamp(tick_[lane] + i[lane], 0, paths.path->ticks - 1);
            first[lane] = i[lane] >= 0 ? paths.latency : 0;
            if (i[lane] >= 0) state.take_lane(begun_[std::min(std::size_t(i[lane]), begun_.size() - 1)], lane);
        }
        return (*reactions_)(state, tick, first, offset_);
    }

  private:
    using State = ImpactState<T>;

    /// Distance in every lane `r` steps after the tick before contact.
    T undisturbed(int r) const {
        const TransientPaths& paths = reactions_->paths();
        double here[lanes];
        for (int lane = 0; lane < lanes; ++lane) here[lane] = paths.undisturbed(first_[lane] + r);
        return load<T>(here);
    }

    void run() {
        const TransientPaths& paths = reactions_->paths();
        const TransientImpact<T>& impact = reactions_->impact();
        State state, end;  // end: when the undetected motion ends
        bool ended[lanes];
        for (int lane = 0; lane < lanes; ++lane) ended[lane] = first_[lane] >= paths.end_step;
        T from = undisturbed(-earlier_), active = 0.0;
        for (int r = 1 - earlier_;; ++r) {
            allow_interruption();
            bool over = true;
            for (int lane = 0; lane < lanes; ++lane) {
                const int step = first_[lane] + r;
                const bool moves = step > 0 && step <= paths.last_step();
                set_lane(active, lane, moves ? 1.0 : 0.0);
                over = over && (lane_of(state.parted, lane) > 0.5 || step > paths.last_step());
            }
            // What is asked for of later ticks is what is known last; a tick in contact must be among them.
            if (over && r > paths.period) break;
            const T to = undisturbed(r);
            if (any(state.meets(to, offset_))) impact.step(state, from, to, offset_, active);
            from = to;
            if (r > 0 && r % paths.period == 0) {
                force.push_back(reactions_->force(state.compression));
                touched.push_back(1.0 - state.parted);
            }
            if (r > paths.latency && (r - paths.latency) % paths.period == 0) begun_.push_back(state);
            for (int lane = 0; lane < lanes; ++lane) {
                if (first_[lane] + r != paths.end_step) continue;
                end.take_lane(state, lane);
                ended[lane] = true;
            }
        }
        begun_.push_back(state);
        for (int lane = 0; lane < lanes; ++lane) {
            if (!ended[lane]) end.take_lane(state, lane);
            impact.rest(end, lane);
        }
        peak = reactions_->force(end.peak);
        duration = end.since;
    }

    const TransientReactions<T>* reactions_;
    T offset_;
    int earlier_ = 0;                 // steps to look back for the first touch
    int tick_[lanes], first_[lanes];  // first_: step of the tick before the first one in contact
    std::vector<State> begun_;        // by tick in contact: when the reaction to it begins; at last, the end
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
