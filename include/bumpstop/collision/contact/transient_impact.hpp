/// @file
/// A body that can get away: struck by the arm's path, it answers as a spring with its mass behind it.
#pragma once

#include "bumpstop/collision/motion/stopping_curve.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Stiffness K in N/m and mass m in kg of the body. The arm is driven along its path s(t) whatever it hits, straight in
/// time between simulation steps; the body's surface, at offset o when it is at rest, answers
///   y = s - o - x,  m x'' = K max(0, y),
/// until they part. Within a step y is a harmonic oscillation, whose highest value is taken and not only those at its
/// ends.
struct TransientBody {
    double stiffness = 0, mass = 0;

    double frequency() const { return std::sqrt(stiffness / mass); }  ///< rad/s
};

/// An arm this far from a body does not touch it, whatever rounding does [m].
inline constexpr double separation_tolerance = 1e-12;

/// One collision in each lane.
template <class T>
struct ImpactState {
    T compression = 0.0;  ///< y [m]; zero before contact and after the parting
    T body_speed = 0.0;   ///< x' [m/s]; never below zero
    T peak = 0.0;         ///< greatest y so far [m]
    T since = 0.0;        ///< time in contact [s]
    T touching = 0.0;     ///< 1 since the first touch
    T parted = 0.0;       ///< 1 once the body has got away

    /// Takes one lane of another collision.
    void take_lane(const ImpactState& other, int lane) {
        for (auto member : {&ImpactState::compression, &ImpactState::body_speed, &ImpactState::peak,
                            &ImpactState::since, &ImpactState::touching, &ImpactState::parted})
            set_lane(this->*member, lane, lane_of(other.*member, lane));
    }

    /// Lanes in which arm and body push one another.
    MaskOf<T> together() const { return (touching > T(0.5)) & (parted < T(0.5)); }
    /// Lanes in which a step that ends at `to` changes something: the body is being touched, or is touched then.
    MaskOf<T> meets(T to, T offset) const {
        return (parted < T(0.5)) & ((touching > T(0.5)) | (to > offset - T(separation_tolerance)));
    }
};

/// Carries collisions with a body on, one simulation step at a time.
template <class T>
class TransientImpact {
  public:
    using State = ImpactState<T>;

    TransientImpact(const TransientBody& body, double step)
        : frequency_(body.frequency()),
          pieces_(std::max(1, int(std::ceil(body.frequency() * step / 0.5)))),
          step_(step),
          piece_(step / pieces_),
          cos_(std::cos(body.frequency() * piece_)),
          sin_(std::sin(body.frequency() * piece_)) {}

    /// Goes on by one simulation step, in which the arm goes straight from `from` to `to`; `offset` is where the body
    /// stands at rest. Lanes with `active` 0 stay as they are.
    void step(State& at, T from, T to, T offset, T active) const {
        const T speed = (to - from) * (1 / step_);
        for (int piece = 0; piece < pieces_; ++piece)
            advance(at, from + speed * (piece_ * piece), speed, offset, active > T(0.5));
    }

    /// The arm of a lane stands still for good: a body it still pushes swings away, x' = u being its speed, after
    /// atan(y w / u) / w, and is pushed no deeper.
    void rest(State& at, int lane) const {
        if (!lane_of(at.together(), lane)) return;
        const double swing = std::atan2(lane_of(at.compression, lane) * frequency_, lane_of(at.body_speed, lane));
        set_lane(at.since, lane, lane_of(at.since, lane) + swing / frequency_);
        set_lane(at.compression, lane, 0.0);
        set_lane(at.parted, lane, 1.0);
    }

  private:
    void advance(State& at, T begin, T speed, T offset, MaskOf<T> active) const {
        const double w = frequency_;
        const auto live = active & (at.parted < T(0.5));
        const auto inside = at.touching > T(0.5);
        auto moves = live & inside;
        T left = piece_, c = cos_, s = sin_, y0 = at.compression;
        if (!all(inside)) {
            // A body not yet touched waits at its place.
            const T gap = offset - begin;
            moves = live & (inside | ((speed * piece_ > gap) & (speed > T(0.0))));
            const T wait = max(gap, T(0.0)) / max(speed, T(1e-300));
            left = select(inside, T(piece_), min(max(piece_ - wait, T(0.0)), T(piece_)));
            const SinCos<T> turned = sincos(T(left * w));
            c = select(inside, T(cos_), turned.cos);
            s = select(inside, T(sin_), turned.sin);
            y0 = select(inside, y0, max(-gap, T(0.0)));
        }
        const T v0 = speed - at.body_speed;
        const T y1 = y0 * c + v0 * (1 / w) * s;
        const T v1 = v0 * c - y0 * w * s;
        T highest = max(y0, y1);
        const auto turns = (v0 > T(0.0)) & (v1 < T(0.0));
        if (any(turns)) highest = select(turns, sqrt(y0 * y0 + v0 * v0 * (1 / (w * w))), highest);
        // A body first touched where a piece ends has no time in it to be pressed: it is still being approached.
        const auto parts = moves & (y1 <= T(0.0)) & (v1 <= T(0.0));
        at.compression = select(moves, max(y1, T(0.0)), at.compression);
        at.body_speed = select(moves, speed - v1, at.body_speed);
        at.peak = select(moves, max(at.peak, highest), at.peak);
        at.touching = select(moves, T(1.0), at.touching);
        if (any(parts)) {
            // Where y passes zero: the chord's guess, mended by one step of Newton's.
            const T guess = left * (y0 / max(y0 - y1, T(1e-300)));
            const SinCos<T> there = sincos(T(guess * w));
            const T value = y0 * there.cos + v0 * (1 / w) * there.sin, slope = v0 * there.cos - y0 * w * there.sin;
            left = select(parts, guess - value / select(slope < T(0.0), slope, T(-1.0)), left);
            at.parted = select(parts, T(1.0), at.parted);
        }
        at.since = select(moves, at.since + left, at.since);
    }

    double frequency_;  // rad/s
    int pieces_;        // of a step, each a small part of an oscillation
    double step_, piece_;
    double cos_, sin_;
};

/// Ends a line once even the farthest body has been struck and should have got away: at constant speed that takes
/// half an oscillation, and three halves leave room for an arm that does not keep its speed. One that speeds up may
/// push for longer: see `all_separated`.
template <class T>
class SeparationCriterion {
  public:
    SeparationCriterion(const TransientBody& body, const Timing& timing, double step, double largest_offset,
                        double half_oscillations = 3)
        : largest_offset_(largest_offset),
          max_ticks_(half_oscillations * std::numbers::pi / body.frequency() / (timing.period * step) + 2) {}

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
inline bool all_separated(const LinePath& path, const TransientBody& body, const Timing& timing, double step,
                          double largest_offset) {
    const TransientImpact<double> impact(body, step);
    const std::size_t last = std::size_t(path.ticks - 1) * timing.period + 1;
    double offset = -HUGE_VAL;
    for (std::size_t first = 0; first < last && offset < largest_offset; ++first) {
        if (!(path.s[first] > offset)) continue;  // whoever stands here has been struck before
        offset = std::min(path.s[first], largest_offset);
        ImpactState<double> state;
        // The farthest body stands before this step.
        for (std::size_t i = first > 0 ? first - 1 : 0; i < last && !(state.parted > 0.5); ++i)
            impact.step(state, path.s[i], path.s[i + 1], offset, 1.0);
        if (!(state.parted > 0.5)) return false;
    }
    return true;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
