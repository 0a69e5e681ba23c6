/// @file
/// The paths of a motion and of its reactions, for contact of an elastic arm or with a body that moves.
#pragma once

#include "bumpstop/collision/contact/contact_dynamics.hpp"
#include "bumpstop/collision/motion/stopping_curve.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct ContactPaths {
    static constexpr double out_of_reach = 1e3;  ///< where a body stands that no arm touches [m]

    const LinePath* path = nullptr;
    int period = 0, latency = 0;                ///< as of Timing [simulation steps]
    int end_step = 0;                           ///< in which the undetected motion ends
    double step = 0;                            ///< simulation step [s]
    bool from_rest = false;                     ///< the motion begins at rest; else at the speed of its first step
    bool reverses = false;                      ///< reactions retreat; else they come to rest
    std::vector<std::vector<double>> reaction;  ///< by tick: distances from its first step on [m]; may be empty
    std::vector<double> max_distance;           ///< by tick: greatest distance from the tick on [m]
    std::vector<std::vector<double>>
        max_later;                   ///< by tick and step of its reaction: greatest distance from there on [m]
    std::vector<double> max_before;  ///< by step: greatest distance of the undisturbed motion until then [m]
    /// By step of the undisturbed motion: an elastic arm that has touched nothing. Empty where its controller feeds all
    /// of the acceleration forward, so that it stays on its reference.
    std::vector<ContactState> approach;

    ContactPaths() = default;
    /// The ticks of a path; their reactions are still empty.
    ContactPaths(const CollisionSetup& setup, const LinePath& of)
        : path(&of),
          period(setup.timing.period),
          latency(setup.timing.latency),
          end_step(int(of.brakes() ? of.s.size() + of.braking.size() - 1 : of.end_step(setup.timing))),
          step(setup.motion.step),
          from_rest(setup.timing.from_rest),
          reverses(setup.reaction == ReactionKind::reverse),
          reaction(std::size_t(of.ticks)),
          max_later(std::size_t(of.ticks)) {}

    /// The last step of the undisturbed motion: a latency after its end, for the reactions, or when an arm that cannot
    /// follow its line has come to rest.
    int last_step() const { return int(path->s.size() + path->braking.size()) - 1; }
    /// Distance after a step of the undisturbed motion; before its start and after its end the arm stands.
    double undisturbed(int i) const {
        const std::size_t at = std::size_t(std::clamp(i, 0, last_step())), line = path->s.size();
        return at < line ? path->s[at] : path->braking[at - line];
    }
    /// Change of the undisturbed speed from the step before to this one [m/s].
    double change(int i) const {
        return i < 2 ? 0.0 : (undisturbed(i) - 2 * undisturbed(i - 1) + undisturbed(i - 2)) / step;
    }
    /// Undisturbed speed in the step that ends with this one; before the start it is that of the start [m/s].
    double speed(int i) const {
        const int at = from_rest ? i : std::max(1, i);
        return (undisturbed(at) - undisturbed(at - 1)) / step;
    }
    /// The last step of the line; from there an arm that cannot follow it any more brakes.
    int line_end() const { return int(path->s.size()) - 1; }
    /// The step after which an arm that has detected nothing stands, or brakes because it cannot follow its line.
    int motion_end() const { return std::min(end_step, line_end()); }
    int tick_step(int k) const { return k * period + 1; }
    int reaction_step(int k) const { return tick_step(k) + latency; }
    /// The step after which the arm leaves its line, detected at a tick: no reaction begins where it brakes already.
    int reaction_begin(int k) const { return std::min(reaction_step(k), line_end()); }

    /// The step before that in which a body at `offset` is touched; the last step if it is not.
    int step_before(double offset) const {
        return int(std::upper_bound(max_before.begin() + 1, max_before.end(), offset) - max_before.begin()) - 1;
    }

    /// The arm after a step of the undisturbed motion, before it touches a body.
    ContactState approaching(int step) const {
        if (approach.empty()) return {};
        ContactState state = approach[std::size_t(std::clamp(step, 0, int(approach.size()) - 1))];
        state.max_penetration = -HUGE_VAL;
        return state;
    }
    /// From step `from` on the reference is that of a reaction. Until then it has moved undisturbed.
    void begin_reaction(ContactState& state, int from) const {
        state.ramp = change(from);
        if (!state.begun) state.speed = speed(from);
        state.begun = state.reacts = true;
    }
    /// Advances a collision by the step of the undisturbed motion after step i. An arm brakes at the end of its line as
    /// in a reaction: its controller does not foresee it.
    void advance(const ContactDynamics& dynamics, ContactState& state, int i, double offset) const {
        if (i == line_end() && !path->braking.empty()) begin_reaction(state, i);
        const double to = undisturbed(i + 1);
        if (state.begun || dynamics.propagator().leaves_reference || state.needs_step(to, offset))
            dynamics.step(state, undisturbed(i), to, offset);
    }
    void follow_approach(const ContactPropagator& by) {
        approach.clear();
        if (!by.leaves_reference) return;
        const ContactDynamics dynamics(by);
        ContactState state;
        state.begun = from_rest;
        approach.push_back(state);
        for (int i = 0; i < last_step(); ++i) {
            allow_interruption();
            advance(dynamics, state, i, out_of_reach);
            approach.push_back(state);
        }
    }

    void find_max_distance() {
        max_distance.clear();
        max_before = path->s;
        max_before.insert(max_before.end(), path->braking.begin(), path->braking.end());
        // An arm whose links are ahead of their reference touches a body before that does.
        for (std::size_t i = 0; i < approach.size(); ++i)
            max_before[i] = std::max(max_before[i], approach[i].max_penetration + out_of_reach);
        for (std::size_t i = 1; i < max_before.size(); ++i) max_before[i] = std::max(max_before[i], max_before[i - 1]);
        // By step: greatest distance of the undisturbed motion from there on.
        std::vector<double> rest(std::size_t(last_step()) + 1);
        for (std::size_t i = rest.size(); i-- > 0;)
            rest[i] = std::max(undisturbed(int(i)), i + 1 < rest.size() ? rest[i + 1] : -HUGE_VAL);
        for (std::size_t k = 0; k < reaction.size(); ++k) {
            const int from = tick_step(int(k));
            double most = -HUGE_VAL;
            if (reaction[k].empty())
                most = rest[std::size_t(std::min(from, last_step()))];
            else
                for (int i = from; i <= reaction_step(int(k)); ++i) most = std::max(most, undisturbed(i));
            for (double s : reaction[k]) most = std::max(most, s);
            max_distance.push_back(most);
        }
        max_later = reaction;
        for (std::vector<double>& own : max_later)
            for (std::size_t i = own.size(); i-- > 1;) own[i - 1] = std::max(own[i - 1], own[i]);
    }
};

/// Distances of the reference after a tick whose reaction begins a latency later. Where that reaction has no path the
/// motion goes on until the arm has braked. Beyond the end of a retreat the reference keeps its last speed.
class PathAfter {
  public:
    PathAfter() = default;
    /// `first`: steps from the tick to the step that is number 0 here.
    PathAfter(const ContactPaths& paths, int tick, int first)
        : paths_(&paths), from_(paths.tick_step(tick) + first), lead_(paths.latency - first) {
        const std::vector<double>& own = paths.reaction[std::size_t(tick)];
        if (own.empty()) {
            lead_ = std::max(0, paths.last_step() - from_);
            return;
        }
        own_ = &own;
        max_later_ = &paths.max_later[std::size_t(tick)];
        if (paths.reverses && own.size() > 1) retreat_ = std::min(0.0, own.back() - own[own.size() - 2]);
    }
    /// Without a reaction: the motion goes on from a step to its end.
    static PathAfter undisturbed(const ContactPaths& paths, int step) {
        PathAfter path;
        path.paths_ = &paths;
        path.from_ = step;
        path.lead_ = std::max(0, paths.end_step - step);
        return path;
    }

    double at(int i) const {
        if (i < lead_) return paths_->undisturbed(from_ + i);
        if (own_ == nullptr) return paths_->undisturbed(from_ + lead_);
        const int last = int(own_->size()) - 1, here = i - lead_;
        return here <= last ? (*own_)[std::size_t(here)] : own_->back() + (here - last) * retreat_;
    }
    /// The distances of `count` steps from the i-th on.
    void copy(int i, int count, double* to) const {
        const int first = i - lead_, known = own_ != nullptr && first >= 0 ? int(own_->size()) - first : 0;
        int n = std::clamp(known, 0, count);
        if (n > 0) std::copy_n(own_->begin() + first, n, to);
        for (; n < count; ++n) to[n] = at(i + n);
    }
    /// Greatest distance from step i on [m].
    double max_later(int i) const {
        if (own_ == nullptr) return HUGE_VAL;
        if (i < lead_) return std::max(paths_->undisturbed(from_ + lead_), max_later_->front());
        return i - lead_ < int(max_later_->size()) ? (*max_later_)[std::size_t(i - lead_)] : own_->back();
    }
    /// Steps until the reference stands, or retreats at constant speed.
    int length() const { return own_ == nullptr ? lead_ : lead_ + std::max(1, int(own_->size()) - 1); }
    bool retreats() const { return retreat_ < 0; }

  private:
    const ContactPaths* paths_ = nullptr;
    const std::vector<double>*own_ = nullptr, *max_later_ = nullptr;  // null: no reaction
    int from_ = 0, lead_ = 0;                                         // the first step; steps of the undisturbed motion
    double retreat_ = 0;  // distance in a step beyond the end of the path [m]
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
