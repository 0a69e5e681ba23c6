/// @file
/// Collisions of an arm with a body, carried on in time.
#pragma once

#include "bumpstop/collision/contact/contact_propagator.hpp"
#include "bumpstop/collision/contact/hermite_course.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// How long a collision is transient after the first touch: ISO/TS 15066, 5.5.5.3 [s].
inline constexpr double transient_phase = 0.5;

/// One collision.
struct ContactState {
    bool touched = false;         ///< since the first touch
    bool contact = false;         ///< while arm and body push one another
    bool separated = false;       ///< once arm and body have parted for good: their state is not carried on
    bool begun = false;           ///< after the first step, before which the reference went on as in it
    bool reacts = false;          ///< in a reaction
    double force = 0;             ///< of the contact [N]
    double peak = 0;              ///< greatest force so far [N]
    double lasting = 0;           ///< greatest force after the transient phase [N]
    double farthest = -HUGE_VAL;  ///< beyond the body's place, while arm and body are apart [m]
    double elapsed = 0;           ///< since the first touch [s]
    double since = 0;             ///< time in contact [s]
    double speed = 0;             ///< of the reference in the step before [m/s]
    double ramp = 0;  ///< change of its speed in every step before a reaction: gears have wound up for it [m/s]
    std::array<double, Transitions::padded> z{};  ///< as of ContactSystem, then zeros

    /// Notes a force that is `highest` between two times after what has elapsed, and `last` at the second.
    void meet(double highest, double last, double from, double to) {
        peak = std::max(peak, highest);
        if (elapsed + to >= transient_phase)
            lasting = std::max(lasting, elapsed + from >= transient_phase ? highest : last);
    }
    /// Whether something goes on in a step that ends at `to`: the body has been touched, or is touched then.
    bool meets(double to, double offset) const { return !separated && (touched || to > offset - separation_tolerance); }
};

/// Carries collisions on, one simulation step at a time. The reference goes straight in time within a step. A step is cut
/// where arm and body meet or part: on either side of the cut the system is linear, and its solution exact.
class ContactDynamics {
  public:
    explicit ContactDynamics(const ContactPropagator& by) : by_(&by), states_(std::size_t(by.states)) {}

    const ContactPropagator& propagator() const { return *by_; }

    /// Goes on by one simulation step, in which the reference goes from `from` to `to`; `offset` is where the body stands at
    /// rest. `final`: arm and body that part do not meet again, and the arm need not be followed.
    void step(ContactState& at, double from, double to, double offset, bool final = false) const {
        if (at.separated) return;
        const double speed = (to - from) * (1 / by_->step);
        if (by_->elastic() && at.begun) {
            const double change = speed - at.speed, sudden = at.reacts ? change - at.ramp : 0.0;
            for (std::size_t i = 0; i < states_; ++i)
                at.z[i] += by_->jump[i] * (change - sudden) + by_->reaction_jump[i] * sudden;
        }
        at.speed = speed;
        at.begun = true;
        for (int piece = 0; piece < by_->pieces && !at.separated; ++piece)
            advance(at, from - offset + speed * (by_->piece * piece), speed, final || by_->gets_away);
    }

    /// Goes on by up to `most` steps of a reaction, no more than a block has, whose begins and ends are `place`: to the step in
    /// which arm and body meet or part; they do not meet from step `until` on. Returns how many.
    int leap(ContactState& at, const double* place, double offset, int until, int most) const {
        constexpr int points = ContactBlock::points;
        const int steps = by_->block_steps, pieces = by_->pieces;
        alignas(64) std::array<double, ContactBlock::max_columns> in;
        std::copy_n(at.z.begin(), states_, in.begin());
        in[states_] = place[0] - offset;
        double* speed = &in[states_ + 1];
        for (int i = 0; i < steps; ++i) speed[i + 1] = (place[i + 1] - place[i]) * (1 / by_->step);
        speed[0] = at.begun ? at.speed : speed[1] - at.ramp;
        speed[steps + 1] = at.ramp;
        alignas(64) std::array<double, ContactBlock::max_told> told;
        const ContactBlock& block = at.contact ? by_->block_in_contact : by_->block_apart;
        block(in.data(), told.data());
        // What is told first, the force or the gap, says when they part or meet.
        const int last = std::min(at.contact ? points : until * pieces, most * pieces);
        int point = 0;
        while (point < last && !(at.contact ? told[std::size_t(point)] < -by_->grazing : told[std::size_t(point)] > 0))
            ++point;
        const int count = point < last ? point / pieces : most;
        if (count == 0) return 0;
        if (at.contact)
            note_peaks(at, in.data(), told.data(), count);
        else
            at.farthest = std::max(at.farthest, *std::max_element(told.begin(), told.begin() + count * pieces));
        at.force = at.contact ? told[std::size_t(count * pieces) - 1] : 0.0;
        const double duration = count * by_->step;
        if (at.contact) at.since += duration;
        if (at.touched) at.elapsed += duration;
        at.speed = speed[count];
        at.begun = true;
        block.advance(count, in.data(), place, offset);
        std::copy_n(in.begin(), states_, at.z.begin());
        return count;
    }

    /// What a detector sees at a tick of a path [Nm], by joint; the torques per newton of the path count where the arm is
    /// rigid.
    void residuals(const ContactState& at, const double* torque_per_N, int dof, double* residual) const {
        if (!by_->elastic()) {
            for (int j = 0; j < dof; ++j) residual[j] = at.force * torque_per_N[j];
            return;
        }
        alignas(64) std::array<double, max_joints> seen{};
        by_->residual.add(at.z.data(), seen.data());
        std::copy_n(seen.begin(), dof, residual);
    }
    /// The arm stands still for good, its reference `beyond` the body's place: a clamped body is pressed on.
    void rest(ContactState& at, double beyond) const {
        if (!at.contact || by_->gets_away) return;
        at.force = std::max(0.0, beyond) * by_->static_stiffness;
        at.peak = std::max(at.peak, at.force);
        at.lasting = std::max(at.lasting, at.force);
        at.since = HUGE_VAL;
    }

  private:
    static constexpr int max_cuts = 16;  ///< of a piece; an arm that chatters faster stays as it is until its end
    using Vector = std::array<double, Transitions::padded>;

    /// Force and gap, with their rates, as the rows of the propagator tell them.
    struct Told {
        double force, rate, bend, gap, opening;
        double padding[3];
    };
    static_assert(sizeof(Told) == detail::PaddedMatrix::padding * sizeof(double));

    Vector vector_of(const ContactState& at, double r, double speed) const {
        Vector x = at.z;
        x[states_] = r;
        x[states_ + 1] = speed;
        return x;
    }
    Told tell(const Vector& x) const {
        alignas(64) Told told{};
        by_->tells.add(x.data(), &told.force);
        return told;
    }
    Told tell(const ContactState& at, double r, double speed) const { return tell(vector_of(at, r, speed)); }

    /// Of the force over a time, from what is told at its begin and end.
    static HermiteCourse course(double value0, double rate0, double bend0, double value1, double rate1, double bend1,
                                double time) {
        const double square = time * time;
        return {value0, rate0 * time, bend0 * square, value1, rate1 * time, bend1 * square};
    }

    /// Notes the greatest forces of some steps of a block in contact; `in` and `told` as of the block.
    void note_peaks(ContactState& at, const double* in, const double* told, int steps) const {
        const ContactBlock& block = by_->block_in_contact;
        const double *force = told, *rate = force + ContactBlock::points, *speed = in + states_ + 1;
        const Told before = tell(at, in[states_], speed[0]);
        double value = before.force, slope = before.rate;
        int point = 0;
        for (int step = 0; step < steps; ++step) {
            const double change = speed[step + 1] - speed[step];
            value += by_->by_speed[0] * change + by_->by_ramp[0] * at.ramp;
            slope += by_->by_speed[1] * change + by_->by_ramp[1] * at.ramp;
            for (int piece = 0; piece < by_->pieces; ++piece, ++point) {
                double highest = std::max(value, force[point]);
                const double known = at.elapsed + (point + 1) * by_->piece >= transient_phase ? at.lasting : at.peak;
                // Between the points it rises by less than it would at the rate of the first.
                if (slope > 0 && rate[point] < 0 && highest + slope * by_->piece > known) {
                    double bend = point == 0 ? before.bend : block.seldom(in, point - 1);
                    if (piece == 0) bend += by_->by_speed[2] * change + by_->by_ramp[2] * at.ramp;
                    highest = std::max(highest, course(value, slope, bend, force[point], rate[point],
                                                       block.seldom(in, point), by_->piece)
                                                    .summit());
                }
                at.meet(highest, force[point], point * by_->piece, (point + 1) * by_->piece);
                value = force[point];
                slope = rate[point];
            }
        }
    }

    void advance(ContactState& at, double r, double speed, bool final) const {
        if (!by_->elastic() && !at.touched && !(r + speed * by_->piece > 0)) return;
        double left = 1;  // share of the piece
        for (int cut = 0; left > 0 && !at.separated && cut < max_cuts; ++cut) {
            const double time = left * by_->piece, end = r + speed * time;
            const Transitions& by = at.contact ? by_->in_contact : by_->apart;
            const Vector begin = vector_of(at, r, speed);
            Vector next = begin;
            cut == 0 ? by.add(begin.data(), next.data()) : by.advance(next.data(), left);
            next[states_] = end;
            next[states_ + 1] = speed;
            const Told before = tell(begin), after = tell(next);
            double share = 1;  // of what is left, when arm and body meet or part
            bool changes = false;
            if (at.contact) {
                changes = after.force < -by_->grazing;
                const bool turns = before.rate > 0 && after.rate < 0;
                double highest = std::max(before.force, after.force);
                if (turns || changes) {
                    const HermiteCourse force =
                        course(before.force, before.rate, before.bend, after.force, after.rate, after.bend, time);
                    if (turns) highest = std::max(highest, force.summit());
                    if (changes) share = force.root();
                }
                at.meet(highest, changes ? 0.0 : after.force, 0, share * time);
                at.since += share * time;
            } else {
                changes = after.gap > 0 && after.force > by_->grazing;
                at.farthest = std::max(at.farthest, after.gap);
                // A body with damping may be pressed still where its force ended: then the force tells.
                if (changes && before.gap < 0)
                    share = HermiteCourse(before.gap, before.opening * time, after.gap, after.opening * time).root();
                else if (changes)
                    share = before.force < 0 ? before.force / (before.force - after.force) : 0.0;
            }
            if (changes && !(at.contact && final)) {
                next = begin;
                by.advance(next.data(), left * share);
            }
            std::copy_n(next.begin(), states_, at.z.begin());
            at.force = at.contact && !changes ? after.force : 0.0;
            if (at.touched) at.elapsed += share * time;
            r = changes ? r + speed * time * share : end;
            left = changes ? left * (1 - share) : 0.0;
            if (!changes) continue;
            at.separated = at.contact && final;
            at.touched = true;
            at.contact = !at.contact;
        }
    }

    const ContactPropagator* by_;
    std::size_t states_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
