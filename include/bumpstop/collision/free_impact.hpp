/// @file
/// A body that can get away: struck by the arm's path, it answers as a spring with its mass behind it.
#pragma once

#include "bumpstop/collision/outcomes.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Stiffness K in N/m and mass m in kg of the body. The arm is driven along its path s(t) whatever it hits, straight in
/// time between simulation steps; the body's surface, at offset o when it is at rest, answers
///   y = s - o - x,  m x'' = K max(0, y),
/// until they part. Within a step y is a harmonic oscillation, whose highest value is taken and not only those at its
/// ends.
struct FreeBody {
    double stiffness = 0, mass = 0;

    double frequency() const { return std::sqrt(stiffness / mass); }  ///< rad/s
};

/// An arm this far from a body does not touch it, whatever rounding does [m].
inline constexpr double surely_apart = 1e-12;

/// One collision in each lane.
template <class T>
class FreeImpact {
  public:
    FreeImpact(const FreeBody& body, double step)
        : body_(body), step_(step), pieces_(std::max(1, int(std::ceil(body.frequency() * step / 0.5)))) {
        const double h = step / pieces_;
        cos_ = std::cos(body.frequency() * h);
        sin_ = std::sin(body.frequency() * h);
    }

    T compression = 0.0;  ///< y [m]; zero before contact and after the parting
    T peak = 0.0;         ///< greatest y so far [m]
    T since = 0.0;        ///< time in contact [s]
    T parted = 0.0;       ///< 1 once the body has got away

    /// Goes on by one simulation step, in which the arm goes straight from `from` to `to`; `offset` is where the body
    /// stands at rest. Lanes with `active` 0 stay as they are.
    void step(T from, T to, T offset, T active) {
        const double h = step_ / pieces_;
        const T speed = (to - from) * (1 / step_);
        for (int piece = 0; piece < pieces_; ++piece) {
            const T begin = from + speed * (h * piece);
            advance(begin, speed, h, offset, active);
        }
    }

    /// Takes one lane of another collision with the same body.
    void take_lane(const FreeImpact& other, int lane) {
        for (auto member : {&FreeImpact::compression, &FreeImpact::peak, &FreeImpact::since, &FreeImpact::parted,
                            &FreeImpact::body_speed_, &FreeImpact::touching_})
            set_lane(this->*member, lane, lane_of(other.*member, lane));
    }

    /// Lanes in which a step that ends at `to` changes something: the body is being touched, or is touched then.
    auto meets(T to, T offset) const {
        return (parted < T(0.5)) & ((touching_ > T(0.5)) | (to > offset - T(surely_apart)));
    }
    /// Has the body of a lane been touched?
    bool touched(int lane) const { return lane_of(touching_, lane) > 0.5; }

    T force() const { return compression * body_.stiffness; }
    T peak_force() const { return peak * body_.stiffness; }

  private:
    void advance(T begin, T speed, double h, T offset, T active) {
        const auto live = (active > T(0.5)) & (parted < T(0.5));
        const auto inside = touching_ > T(0.5);
        // A body not yet touched waits at its place.
        const T gap = offset - begin;
        const auto touches = (speed * h > gap) & (speed > T(0.0));
        const T wait = select(inside, T(0.0), maximum(gap, T(0.0)) / maximum(speed, T(1e-300)));
        const T left = select(inside, T(h), minimum(maximum(h - wait, T(0.0)), T(h)));
        const double w = body_.frequency();
        T c = cos_, s = sin_;
        if (!all(inside)) {
            const SinCos<T> turned = sincos(T(left * w));
            c = select(inside, T(cos_), turned.cos);
            s = select(inside, T(sin_), turned.sin);
        }
        const T y0 = select(inside, compression, maximum(-gap, T(0.0)));
        const T v0 = speed - body_speed_;
        const T y1 = y0 * c + v0 * (1 / w) * s;
        const T v1 = v0 * c - y0 * w * s;
        T highest = maximum(y0, y1);
        const auto turns = (v0 > T(0.0)) & (v1 < T(0.0));
        highest = select(turns, square_root(y0 * y0 + v0 * v0 * (1 / (w * w))), highest);
        const auto moves = live & (inside | touches);
        const auto parts = moves & (y1 <= T(0.0));
        compression = select(moves, maximum(y1, T(0.0)), compression);
        body_speed_ = select(moves, speed - v1, body_speed_);
        peak = select(moves, maximum(peak, highest), peak);
        T lasted = left;
        if (any(parts)) {
            // Where y passes zero: the chord's guess, mended by one step of Newton's.
            const T guess = left * (y0 / maximum(y0 - y1, T(1e-300)));
            const SinCos<T> there = sincos(T(guess * w));
            const T value = y0 * there.cos + v0 * (1 / w) * there.sin, slope = v0 * there.cos - y0 * w * there.sin;
            lasted = select(parts, guess - value / select(slope < T(0.0), slope, T(-1.0)), left);
        }
        since = select(moves, since + lasted, since);
        touching_ = select(moves, T(1.0), touching_);
        parted = select(parts, T(1.0), parted);
    }

    FreeBody body_;
    double step_;
    int pieces_;  ///< of a step, each a small part of an oscillation
    double cos_, sin_;
    T body_speed_ = 0.0;  ///< x' [m/s]
    T touching_ = 0.0;    ///< 1 since the first touch
};

/// All that free contact needs of a motion: its path, and the path of every reaction.
struct FreePaths {
    const LinePath* path = nullptr;
    int period = 0, latency = 0, end_step = 0;  ///< end_step: in which the undetected motion ends
    double step = 0;
    std::vector<std::vector<double>> reaction;  ///< by tick, from the step in which it begins on; may be empty
    std::vector<double> farthest;               ///< by tick: the greatest distance of its reaction; infinite if empty

    /// Distance after a step of the undetected motion. Before the start, and after the end, the arm stands.
    double undisturbed(int i) const { return path->s[std::size_t(std::clamp(i, 0, end_step))]; }
    int tick_step(int k) const { return k * period + 1; }
    int reaction_step(int k) const { return tick_step(k) + latency; }
    /// Distance `i` steps into the reaction of tick k.
    double reacting(int k, int i) const {
        const std::vector<double>& own = reaction[std::size_t(k)];
        if (own.empty()) return undisturbed(reaction_step(k) + i);
        return own[std::min(std::size_t(i), own.size() - 1)];
    }
    int reaction_length(int k) const { return std::max(1, int(reaction[std::size_t(k)].size()) - 1); }
};

template <class T, class Pose>
FreePaths free_paths(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                     const Timing& timing, ReactionKind kind, const StoppingCurve& curve, Pose pose) {
    const LinePath& path = curve.path;
    FreePaths paths{&path,
                    timing.period,
                    timing.latency,
                    int(std::min(path.s.size() - 1, std::size_t(timing.steps))),
                    motion.step,
                    {},
                    {}};
    const int known = std::min(path.ticks, int(path.reaction_state.size() / (2 * std::size_t(motion.free_count))));
    std::vector<ReactionJob> jobs;
    for (int k = 0; k < known; ++k) jobs.push_back({&path, 0, k, {}, {}});
    // A body in contact has not been passed again before the point is back where it was at the tick.
    simulate_reactions<T>(
        chain, motion, contact, timing, kind, jobs.data(), known, ReactionDetail::every_step,
        [&](const ReactionJob&) { return pose; },
        [&](const ReactionJob& job) { return path.at_tick(job.tick, timing.period); });
    paths.reaction.resize(std::size_t(path.ticks));
    for (int k = 0; k < known; ++k) paths.reaction[std::size_t(k)] = std::move(jobs[std::size_t(k)].distance);
    for (const std::vector<double>& own : paths.reaction) {
        const double most = own.empty() ? HUGE_VAL : *std::max_element(own.begin(), own.end());
        paths.farthest.push_back(most);
    }
    return paths;
}

/// One offset in each lane, whose first tick beyond it is `tick`: force at every tick of the undetected collision, and
/// what a reaction makes of it.
template <class T>
class FreeCollision {
  public:
    static constexpr int lanes = Scalar<T>::lanes;

    FreeCollision(const FreePaths& paths, const FreeBody& body, const int* tick, T offset)
        : paths_(paths), body_(body), offset_(offset), state_(body, paths.step) {
        for (int lane = 0; lane < lanes; ++lane) tick_[lane] = tick[lane];
        // From the tick before the first one in contact: contact begins after it.
        history_.push_back(state_);
        for (int i = 0;; ++i) {
            go_to((i + 1) * paths_.period);
            force.push_back(state_.force());
            touched.push_back(1.0 - state_.parted);
            bool over = true;
            for (int lane = 0; lane < lanes; ++lane)
                over = over && (lane_of(state_.parted, lane) > 0.5 || tick_[lane] + i + 1 >= paths.path->ticks);
            if (over) break;
        }
        // To the parting, or the end of the motion; at least until the last reaction begins.
        go_to(int(history_.size()) - 1 + paths.latency);
        while (moving()) go_to(int(history_.size()));
        peak = state_.peak_force();
        duration = state_.since;
    }

    std::vector<T> force;    ///< by tick in contact, before any reaction [N]
    std::vector<T> touched;  ///< 1 where the body has not got away by then
    T peak, duration;        ///< undetected: greatest force [N] and time in contact [s]

    struct Outcome {
        T peak, duration;
    };

    /// The collision is detected at tick tick[lane] + i[lane] of each lane; i below zero: before contact.
    Outcome detected(const int* i) const {
        const FreeImpact<T> state = begun(i);
        int longest = 0;
        Reacting reacting[lanes];
        for (int lane = 0; lane < lanes; ++lane) {
            const int k = clamped(lane, i[lane]);
            reacting[lane] = Reacting(paths_, k);
            // An arm that stops short of the body need not be followed.
            const bool arrives = paths_.farthest[std::size_t(k)] > lane_of(offset_, lane) - surely_apart;
            if (arrives || state.touched(lane)) longest = std::max(longest, paths_.reaction_length(k));
        }
        return longest > 0 ? followed(state, reacting, longest) : Outcome{state.peak_force(), state.since};
    }

  private:
    /// Where the arm of a lane is in its reaction.
    struct Reacting {
        const FreePaths* paths = nullptr;
        const double* own = nullptr;
        int last = 0, tick = 0;

        Reacting() = default;
        Reacting(const FreePaths& all, int k) : paths(&all), tick(k) {
            const std::vector<double>& known = all.reaction[std::size_t(k)];
            own = known.empty() ? nullptr : known.data();
            last = int(known.size()) - 1;
        }
        double operator()(int i) const { return own != nullptr ? own[std::min(i, last)] : paths->reacting(tick, i); }
    };
    static T place(const Reacting* reacting, int i) {
        double here[lanes];
        for (int lane = 0; lane < lanes; ++lane) here[lane] = reacting[lane](i);
        return load<T>(here);
    }

    /// The body when the reactions to detections at tick[lane] + i[lane] begin.
    FreeImpact<T> begun(const int* i) const {
        auto steps = [&](int lane) {
            const int before = (i[lane] + 1) * paths_.period + paths_.latency;
            return std::size_t(std::clamp(before, 0, int(history_.size()) - 1));
        };
        FreeImpact<T> state = history_[steps(0)];
        for (int lane = 1; lane < lanes; ++lane)
            if (steps(lane) != steps(0)) state.take_lane(history_[steps(lane)], lane);
        return state;
    }

    Outcome followed(FreeImpact<T> state, const Reacting* reacting, int longest) const {
        T from = place(reacting, 0);
        for (int r = 0; r < longest; ++r) {
            const T to = place(reacting, r + 1);
            if (any(state.meets(to, offset_))) {
                state.step(from, to, offset_, T(1.0));
                if (all(state.parted > T(0.5))) break;
            }
            from = to;
        }
        return {state.peak_force(), state.since};
    }

    int clamped(int lane, int i) const { return std::clamp(tick_[lane] + i, 0, paths_.path->ticks - 1); }

    /// Simulation step in a lane that is `r` steps after the tick before the first one in contact.
    int absolute(int lane, int r) const { return paths_.tick_step(tick_[lane] - 1) + r; }

    bool moving() const {
        for (int lane = 0; lane < lanes; ++lane) {
            if (absolute(lane, int(history_.size()) - 1) < paths_.end_step && !(lane_of(state_.parted, lane) > 0.5))
                return true;
        }
        return false;
    }

    void go_to(int r) {
        for (int here = int(history_.size()) - 1; here < r; ++here) {
            T from = 0.0, to = 0.0, active = 0.0;
            for (int lane = 0; lane < lanes; ++lane) {
                const int at = absolute(lane, here);
                set_lane(from, lane, paths_.undisturbed(at));
                set_lane(to, lane, paths_.undisturbed(at + 1));
                set_lane(active, lane, at >= 0 && at < paths_.end_step ? 1.0 : 0.0);
            }
            state_.step(from, to, offset_, active);
            history_.push_back(state_);
        }
    }

    const FreePaths& paths_;
    const FreeBody& body_;
    T offset_;
    int tick_[lanes];
    FreeImpact<T> state_;
    std::vector<FreeImpact<T>> history_;  ///< by simulation step from the tick before the first one in contact
};

/// Tells the tracer when even the farthest body has been struck and has got away: at constant speed that takes half an
/// oscillation, and three halves leave room for an arm that does not keep its speed.
template <class T>
class CertainParting {
  public:
    CertainParting(const FreeBody& body, const Timing& timing, double step, T largest_offset)
        : largest_(largest_offset), patience_(3 * std::numbers::pi / body.frequency() / (timing.period * step) + 2) {}

    MaskOf<T> operator()(const T& s, const T*) {
        beyond_ += select(s > largest_, T(1.0), T(0.0));
        return beyond_ > T(patience_);
    }

  private:
    T largest_;
    double patience_;  ///< ticks beyond the farthest body
    T beyond_ = 0.0;
};

/// Free contact as the outcomes' finder sees it.
struct FreeContact {
    const FreePaths& paths;
    const FreeBody& body;

    template <class T>
    struct Collision {
        FreeCollision<T> collision;

        T force(const T&, int i) const {
            return std::size_t(i) < collision.force.size() ? collision.force[std::size_t(i)] : T(0.0);
        }
        // A body that has got away cannot be felt.
        T felt(int i) const {
            return std::size_t(i) < collision.touched.size() ? collision.touched[std::size_t(i)] : T(0.0);
        }
    };
    template <class T>
    Collision<T> begin(const int* tick, T offset) const {
        return {FreeCollision<T>(paths, body, tick, offset)};
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
