/// @file
/// Collisions of an arm with a body, carried on in time.
#pragma once

#include "bumpstop/collision/contact/contact_propagator.hpp"
#include "bumpstop/collision/contact/hermite_course.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// How long a collision is transient after the first touch: ISO/TS 15066, 5.5.5.3 [s].
inline constexpr double transient_phase = 0.5;

/// One collision in each lane.
template <class T>
struct ContactState {
    int states = 0;     ///< entries of `z` in use; the others are not set
    T touched = 0.0;    ///< 1 since the first touch
    T contact = 0.0;    ///< 1 while arm and body push one another
    T separated = 0.0;  ///< 1 once a body that nothing holds has got away
    T force = 0.0;      ///< of the contact [N]
    T peak = 0.0;       ///< greatest force so far [N]
    T lasting = 0.0;    ///< greatest force after the transient phase [N]
    T elapsed = 0.0;    ///< since the first touch [s]
    T since = 0.0;      ///< time in contact [s]
    T begun = 0.0;      ///< 1 after the first step, before which the reference went on as in it
    T speed = 0.0;      ///< of the reference in the step before [m/s]
    T reacts = 0.0;     ///< 1 in a reaction
    T ramp = 0.0;       ///< change of its speed in every step before a reaction: gears have wound up for it [m/s]
    std::array<T, ContactSystem::max_states> z;

    explicit ContactState(int count = 0) : states(count) { std::fill_n(z.begin(), count, T(0.0)); }
    ContactState(const ContactState& other) { *this = other; }
    ContactState& operator=(const ContactState& other) {
        states = other.states;
        for (auto member : values()) this->*member = other.*member;
        std::copy_n(other.z.begin(), states, z.begin());
        return *this;
    }

    /// Takes one lane of another collision.
    void take_lane(const ContactState& other, int lane) {
        if (states == 0) std::fill_n(z.begin(), states = other.states, T(0.0));
        for (auto member : values()) set_lane(this->*member, lane, lane_of(other.*member, lane));
        for (int i = 0; i < states; ++i) set_lane(z[std::size_t(i)], lane, lane_of(other.z[std::size_t(i)], lane));
    }

    /// Takes some lanes of the same collisions.
    void take_lanes(const ContactState& other, MaskOf<T> lanes) {
        if (all(lanes)) {
            *this = other;
            return;
        }
        for (auto member : values()) this->*member = select(lanes, other.*member, this->*member);
        for (int i = 0; i < states; ++i) z[std::size_t(i)] = select(lanes, other.z[std::size_t(i)], z[std::size_t(i)]);
    }

    /// Lanes in which arm and body push one another.
    MaskOf<T> in_contact() const { return contact > T(0.5); }
    /// Notes a force of some lanes, `later` after what has elapsed.
    void meet(MaskOf<T> lanes, T found, T later) {
        peak = select(lanes, max(peak, found), peak);
        lasting = select(lanes & (elapsed + later >= T(transient_phase)), max(lasting, found), lasting);
    }
    /// Lanes in which something goes on in a step that ends at `to`: the body has been touched, or is touched then.
    MaskOf<T> meets(T to, T offset) const {
        return (separated < T(0.5)) & ((touched > T(0.5)) | (to > offset - T(separation_tolerance)));
    }

  private:
    static constexpr auto values() {
        return std::array{&ContactState::touched, &ContactState::contact, &ContactState::separated,
                          &ContactState::force,   &ContactState::peak,    &ContactState::lasting,
                          &ContactState::elapsed, &ContactState::begun,   &ContactState::since,
                          &ContactState::speed,   &ContactState::reacts,  &ContactState::ramp};
    }
};

/// Carries collisions on, one simulation step at a time. The reference goes straight in time within a step. A step is cut
/// where arm and body meet or part: on either side of the cut the system is linear, and its solution exact.
template <class T>
class ContactDynamics {
  public:
    using State = ContactState<T>;

    explicit ContactDynamics(const ContactPropagator& by) : by_(&by), states_(by.states) {}

    const ContactPropagator& propagator() const { return *by_; }
    State begin() const { return State(states_); }

    /// Goes on by one simulation step, in which the reference goes from `from` to `to`; `offset` is where the body stands at
    /// rest. Lanes with `active` 0 stay as they are.
    void step(State& at, T from, T to, T offset, T active) const {
        const T speed = (to - from) * (1 / by_->step);
        const auto moves = (active > T(0.5)) & (at.separated < T(0.5));
        if (by_->elastic) {
            const T change = select(moves & (at.begun > T(0.5)), speed - at.speed, T(0.0));
            const T sudden = select(moves & (at.begun > T(0.5)) & (at.reacts > T(0.5)), change - at.ramp, T(0.0));
            for (int i = 0; i < states_; ++i)
                at.z[std::size_t(i)] +=
                    by_->jump[std::size_t(i)] * (change - sudden) + by_->reaction_jump[std::size_t(i)] * sudden;
        }
        at.speed = select(moves, speed, at.speed);
        at.begun = select(moves, T(1.0), at.begun);
        for (int piece = 0; piece < by_->pieces; ++piece)
            advance(at, from - offset + speed * (by_->piece * piece), speed, moves & (at.separated < T(0.5)));
    }

    /// Goes on by a block of steps of a reaction, whose begins and end are `place`, where no active lane meets or parts in it
    /// before its step `until`; the answer is 0 then. Else nothing happens, and the answer is the number of steps up to the
    /// first in which one does.
    int leap(State& at, const T* place, T offset, T active, T until) const {
        constexpr int points = ContactBlock::points;
        const int steps = by_->block_steps;
        const auto moves = (active > T(0.5)) & (at.separated < T(0.5));
        std::array<T, ContactBlock::max_columns> in;
        std::copy_n(at.z.begin(), states_, in.begin());
        in[std::size_t(states_)] = place[0] - offset;
        T* speed = &in[std::size_t(states_) + 1];
        for (int i = 0; i < steps; ++i) speed[i + 1] = (place[i + 1] - place[i]) * (1 / by_->step);
        speed[0] = select(at.begun > T(0.5), at.speed, speed[1] - at.ramp);
        speed[steps + 1] = at.ramp;
        State next = at;
        T broken = points;
        std::array<T, ContactBlock::max_rows> out;
        const auto go = [&](const ContactBlock& block, MaskOf<T> lanes) {
            std::fill_n(out.begin(), block.rows(), T(0.0));
            block(in.data(), out.data());
            for (int i = 0; i < states_; ++i)
                next.z[std::size_t(i)] = select(lanes, out[std::size_t(i)], next.z[std::size_t(i)]);
            return &out[std::size_t(states_)];
        };
        const auto in_contact = moves & at.in_contact(), loose = moves & !at.in_contact();
        if (any(in_contact)) {
            const T* force = go(by_->block_in_contact, in_contact);
            for (int i = points; i-- > 0;) broken = select(in_contact & (force[i] < T(-by_->grazing)), T(i), broken);
            const double piece = by_->piece, square = piece * piece;
            const T* rate = force + points;
            const T* bend = rate + points;
            T value = dot(by_->force[0], at, in[std::size_t(states_)], speed[0]);
            T slope = dot(by_->force[1], at, in[std::size_t(states_)], speed[0]);
            T curvature = dot(by_->force[2], at, in[std::size_t(states_)], speed[0]);
            for (int i = 0; i < points; ++i) {
                if (i % by_->pieces == 0) {
                    const T change = speed[i / by_->pieces + 1] - speed[i / by_->pieces];
                    value += by_->by_speed[0] * change + by_->by_ramp[0] * at.ramp;
                    slope += by_->by_speed[1] * change + by_->by_ramp[1] * at.ramp;
                    curvature += by_->by_speed[2] * change + by_->by_ramp[2] * at.ramp;
                }
                next.meet(in_contact, force[i], T((i + 1) * piece));
                const auto turns = in_contact & (slope > T(0.0)) & (rate[i] < T(0.0));
                if (any(turns)) {
                    const HermiteCourse<T> course(value, slope * piece, curvature * square, force[i], rate[i] * piece,
                                                  bend[i] * square);
                    next.meet(turns, course.summit(), T((i + 1) * piece));
                }
                value = force[i];
                slope = rate[i];
                curvature = bend[i];
            }
            next.force = select(in_contact, value, next.force);
            next.since = select(in_contact, at.since + steps * by_->step, next.since);
        }
        if (any(loose)) {
            const T* gap = go(by_->block_apart, loose);
            for (int i = points; i-- > 0;)
                broken = select(loose & (gap[i] > T(0.0)) & (T(i / by_->pieces) < until), T(i), broken);
            next.force = select(loose, T(0.0), next.force);
        }
        int first = points;
        for (int lane = 0; lane < Scalar<T>::lanes; ++lane) first = std::min(first, int(lane_of(broken, lane)));
        if (first < points) return first / by_->pieces + 1;
        next.elapsed = select(moves & (at.touched > T(0.5)), at.elapsed + steps * by_->step, at.elapsed);
        next.speed = select(moves, speed[steps], at.speed);
        next.begun = select(moves, T(1.0), at.begun);
        at.take_lanes(next, moves);
        return 0;
    }

    /// What a detector sees of a joint of an elastic arm [Nm].
    T residual(const State& at, int joint) const {
        const Row& row = by_->residual[std::size_t(joint)];
        T sum = 0.0;
        for (int i = 0; i < states_; ++i) sum += row[std::size_t(i)] * at.z[std::size_t(i)];
        return sum;
    }
    /// What it sees of all joints at a tick of a path, whose torques per newton count where the arm is rigid.
    template <class Path>
    void residuals(const State& at, const Path& path, int tick, T* residual) const {
        for (int j = 0; j < path.dof; ++j)
            residual[j] =
                by_->elastic ? this->residual(at, j) : at.force * path.torque_per_N[std::size_t(tick * path.dof + j)];
    }
    /// The arm of a lane stands still for good, its reference `beyond` the body's place: a clamped body is pressed on.
    void rest(State& at, T beyond, int lane) const {
        if (!lane_of(at.in_contact(), lane) || by_->gets_away) return;
        set_lane(at.force, lane, std::max(0.0, lane_of(beyond, lane)) * by_->static_stiffness);
        set_lane(at.peak, lane, std::max(lane_of(at.peak, lane), lane_of(at.force, lane)));
        set_lane(at.lasting, lane, std::max(lane_of(at.lasting, lane), lane_of(at.force, lane)));
        set_lane(at.since, lane, HUGE_VAL);
    }

  private:
    using Row = ContactPropagator::Row;
    static constexpr int max_cuts = 16;  ///< of a piece; an arm that chatters faster stays as it is until its end

    T dot(const Row& row, const State& at, T r, T speed) const {
        T sum = row[std::size_t(states_)] * r + row[std::size_t(states_) + 1] * speed;
        for (int i = 0; i < states_; ++i) sum += row[std::size_t(i)] * at.z[std::size_t(i)];
        return sum;
    }

    /// Lanes in contact, and lanes that are apart from the body, go on by a piece.
    void move(State& at, MaskOf<T> in_contact, MaskOf<T> apart, T r, T speed) const {
        std::array<T, ContactSystem::max_size> x;
        std::copy_n(at.z.begin(), states_, x.begin());
        x[std::size_t(states_)] = r;
        x[std::size_t(states_) + 1] = speed;
        for (const auto& [lanes, by] : {std::pair{in_contact, &by_->in_contact}, std::pair{apart, &by_->apart}}) {
            if (!any(lanes)) continue;
            if (all(lanes)) return by->add(x.data(), at.z.data(), states_);
            std::array<T, ContactSystem::max_states> z;
            std::copy_n(x.begin(), states_, z.begin());
            by->add(x.data(), z.data(), states_);
            for (int i = 0; i < states_; ++i)
                at.z[std::size_t(i)] = select(lanes, z[std::size_t(i)], at.z[std::size_t(i)]);
        }
    }
    /// They go on by a share of a piece, one after the other: few lanes meet or part in the same piece.
    void move(State& at, MaskOf<T> in_contact, MaskOf<T> apart, T r, T speed, T share) const {
        const T pressed = select(in_contact, T(1.0), T(0.0)), moves = select(in_contact | apart, T(1.0), T(0.0));
        for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
            if (!(lane_of(moves, lane) > 0)) continue;
            std::array<double, Transitions::padded> x{};
            for (int i = 0; i < states_; ++i) x[std::size_t(i)] = lane_of(at.z[std::size_t(i)], lane);
            x[std::size_t(states_)] = lane_of(r, lane);
            x[std::size_t(states_) + 1] = lane_of(speed, lane);
            (lane_of(pressed, lane) > 0 ? by_->in_contact : by_->apart).advance(x.data(), lane_of(share, lane));
            for (int i = 0; i < states_; ++i) set_lane(at.z[std::size_t(i)], lane, x[std::size_t(i)]);
        }
    }

    void advance(State& at, T r, T speed, MaskOf<T> open) const {
        if (!by_->elastic && !any(open & ((at.touched > T(0.5)) | (r + speed * by_->piece > T(0.0))))) return;
        T left = 1.0;  // share of the piece
        for (int cut = 0; any(open) && cut < max_cuts; ++cut) {
            const auto in_contact = open & at.in_contact(), loose = open & !at.in_contact();
            const T time = left * by_->piece, end = r + speed * time;
            State next = at;
            if (cut == 0)
                move(next, in_contact, loose, r, speed);
            else
                move(next, in_contact, loose, r, speed, left);
            T share = 1.0;  // of what is left, when arm and body meet or part
            auto meets = loose, parts = in_contact;
            const T force0 = dot(by_->force[0], at, r, speed), force1 = dot(by_->force[0], next, end, speed);
            if (any(in_contact)) {
                const T rate0 = dot(by_->force[1], at, r, speed) * time,
                        rate1 = dot(by_->force[1], next, end, speed) * time;
                parts = in_contact & (force1 < T(-by_->grazing));
                const auto turns = in_contact & (rate0 > T(0.0)) & (rate1 < T(0.0));
                T highest = max(force0, force1);
                if (any(turns | parts)) {
                    const T square = time * time;
                    const HermiteCourse<T> course(force0, rate0, dot(by_->force[2], at, r, speed) * square, force1,
                                                  rate1, dot(by_->force[2], next, end, speed) * square);
                    highest = select(turns, max(highest, course.summit()), highest);
                    share = select(parts, course.root(), share);
                }
                next.meet(in_contact, highest, share * time);
                next.since = select(in_contact, at.since + share * time, next.since);
            }
            if (any(loose)) {
                const T gap0 = dot(by_->gap[0], at, r, speed), gap1 = dot(by_->gap[0], next, end, speed);
                meets = loose & (gap1 > T(0.0)) & (force1 > T(by_->grazing));
                if (any(meets)) {
                    const HermiteCourse<T> course(gap0, dot(by_->gap[1], at, r, speed) * time, gap1,
                                                  dot(by_->gap[1], next, end, speed) * time);
                    // A body with damping may be pressed still where its force ended: then the force tells.
                    const T pressed = select(force0 < T(0.0), force0 / (force0 - force1), T(0.0));
                    share = select(meets, select(gap0 < T(0.0), course.root(), pressed), share);
                }
            }
            const auto cuts = meets | parts;
            if (any(cuts)) {
                State there = at;
                move(there, parts, meets, r, speed, left * share);
                for (int i = 0; i < states_; ++i)
                    next.z[std::size_t(i)] = select(cuts, there.z[std::size_t(i)], next.z[std::size_t(i)]);
            }
            next.contact = select(meets, T(1.0), select(parts, T(0.0), next.contact));
            next.touched = select(meets, T(1.0), next.touched);
            if (by_->gets_away) next.separated = select(parts, T(1.0), next.separated);
            next.force = select(in_contact & !parts, force1, T(0.0));
            next.elapsed = select(at.touched > T(0.5), at.elapsed + share * time, next.elapsed);
            at.take_lanes(next, open);
            r = select(cuts, r + speed * time * share, end);
            left = select(cuts, left * (1.0 - share), T(0.0));
            open = open & cuts & (at.separated < T(0.5)) & (left > T(0.0));
        }
    }

    const ContactPropagator* by_;
    int states_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
