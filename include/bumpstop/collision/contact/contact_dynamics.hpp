/// @file
/// Collisions of an arm with a body, simulated step by step.
#pragma once

#include "bumpstop/collision/contact/contact_propagator.hpp"
#include "bumpstop/collision/contact/hermite_interpolant.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// How long a collision is transient after the first touch: ISO/TS 15066, 5.5.5.3 [s].
inline constexpr double transient_phase = 0.5;

/// The state of one collision.
struct ContactState {
    bool touched = false;                ///< since the first touch
    bool contact = false;                ///< at present
    bool separated = false;              ///< for good: the state is not advanced any more
    bool begun = false;                  ///< after the first step; before it the reference had the same speed
    bool reacts = false;                 ///< the reference is that of a reaction
    double force = 0;                    ///< of the contact [N]
    double peak = 0;                     ///< greatest force so far [N]
    double lasting = 0;                  ///< greatest force after the transient phase [N]
    double max_penetration = -HUGE_VAL;  ///< greatest penetration while arm and body are apart [m]
    double elapsed = 0;                  ///< since the first touch [s]
    double duration = 0;                 ///< time in contact so far [s]
    double speed = 0;                    ///< of the reference in the step before [m/s]
    /// Change of its speed from step to step before the reaction, for which the gears already carry the torque [m/s].
    double ramp = 0;
    std::array<double, Transitions::padded> z{};  ///< as of ContactSystem, then zeros

    /// Records a force that is `highest` between two times, counted from `elapsed`; `force(t)` is that at one of them.
    template <class Force>
    void record_force(double highest, double from, double to, const Force& force) {
        peak = std::max(peak, highest);
        const double end = transient_phase - elapsed;  // of the transient phase
        if (to >= end) lasting = std::max(lasting, end > from ? std::max(force(end), force(to)) : highest);
    }
    /// Whether a step of the reference to `to` need be simulated: the body has been touched, or is touched in it.
    bool needs_step(double to, double offset) const {
        return !separated && (touched || to > offset - separation_tolerance);
    }
};

/// Advances collisions by simulation steps, within which the speed of the reference is constant. A step is cut where
/// arm and body touch or separate: on either side of the cut the system is linear, and its solution exact.
class ContactDynamics {
  public:
    explicit ContactDynamics(const ContactPropagator& by) : by_(&by), states_(std::size_t(by.states)) {}

    const ContactPropagator& propagator() const { return *by_; }

    /// Advances by one simulation step, in which the reference moves from `from` to `to`; `offset` is where the body
    /// stands at rest. `final`: once arm and body separate they do not touch again, and the simulation may end.
    void step(ContactState& at, double from, double to, double offset, bool final = false) const {
        if (at.separated) return;
        const double speed = (to - from) * (1 / by_->step);
        if (by_->elastic() && at.begun) {
            const double change = speed - at.speed;
            if (!at.reacts) at.ramp = change;
            const double sudden = change - at.ramp;
            for (std::size_t i = 0; i < states_; ++i)
                at.z[i] += by_->jump[i] * (change - sudden) + by_->reaction_jump[i] * sudden;
        }
        at.speed = speed;
        at.begun = true;
        for (int piece = 0; piece < by_->pieces && !at.separated; ++piece)
            step_piece(at, from - offset + speed * (by_->piece * piece), speed, final || by_->gets_away);
    }

    /// Advances by up to `most` steps of a reaction, no more than a block has, whose begins and ends are `place`: up to
    /// the step in which arm and body touch or separate. From step `until` on they cannot touch. Returns the steps.
    int step_block(ContactState& at, const double* place, double offset, int until, int most) const {
        constexpr int points = ContactBlock::points;
        const int steps = by_->block_steps, pieces = by_->pieces;
        alignas(64) std::array<double, ContactBlock::max_columns> in;
        std::copy_n(at.z.begin(), states_, in.begin());
        in[states_] = place[0] - offset;
        double* speed = &in[states_ + 1];
        for (int i = 0; i < steps; ++i) speed[i + 1] = (place[i + 1] - place[i]) * (1 / by_->step);
        speed[0] = at.begun ? at.speed : speed[1] - at.ramp;
        speed[steps + 1] = at.ramp;
        alignas(64) std::array<double, ContactBlock::max_values> values;
        const ContactBlock& block = at.contact ? by_->block_in_contact : by_->block_apart;
        block(in.data(), values.data());
        // The first output, force or penetration, shows when they separate or touch.
        const int last = std::min(at.contact ? points : until * pieces, most * pieces);
        int point = 0;
        while (point < last &&
               !(at.contact ? values[std::size_t(point)] < -by_->force_tolerance : values[std::size_t(point)] > 0))
            ++point;
        const int count = point < last ? point / pieces : most;
        if (count == 0) return 0;
        if (at.contact)
            record_peaks(at, in.data(), values.data(), count);
        else
            at.max_penetration =
                std::max(at.max_penetration, *std::max_element(values.begin(), values.begin() + count * pieces));
        at.force = at.contact ? values[std::size_t(count * pieces) - 1] : 0.0;
        const double duration = count * by_->step;
        if (at.contact) at.duration += duration;
        if (at.touched) at.elapsed += duration;
        at.speed = speed[count];
        at.begun = true;
        block.advance(count, in.data(), place, offset);
        std::copy_n(in.begin(), states_, at.z.begin());
        return count;
    }

    /// Residuals at a tick without noise, by joint [Nm]; zero until the first touch, however an elastic arm lags behind
    /// its reference. `torque_per_N`: of the path at that tick, for a rigid arm.
    void residuals(const ContactState& at, const double* torque_per_N, int dof, double* residual) const {
        if (!by_->elastic()) {
            for (int j = 0; j < dof; ++j) residual[j] = at.force * torque_per_N[j];
            return;
        }
        alignas(64) std::array<double, max_joints> seen{};
        if (at.touched) by_->residual.add(at.z.data(), seen.data());
        const double ramp = at.touched && !at.reacts ? at.ramp : 0.0;
        for (int j = 0; j < dof; ++j) residual[j] = seen[std::size_t(j)] + ramp * by_->residual_by_ramp[std::size_t(j)];
    }
    /// The arm stands still for good, its reference `beyond` the place of the body. A body that is held stays pressed.
    void rest(ContactState& at, double beyond) const {
        if (!at.contact || by_->gets_away) return;
        at.force = std::max(0.0, beyond) * by_->static_stiffness;
        at.peak = std::max(at.peak, at.force);
        at.lasting = std::max(at.lasting, at.force);
        at.duration = HUGE_VAL;
    }

  private:
    static constexpr int max_cuts = 16;  ///< of a piece; an arm that chatters faster stays as it is until its end
    using Vector = std::array<double, Transitions::padded>;

    /// Force and penetration with their rates, in the order of the propagator's rows.
    struct Outputs {
        double force, force_rate, force_second_rate, penetration, penetration_rate;
        double padding[3];
    };
    static_assert(sizeof(Outputs) == detail::PaddedMatrix::padding * sizeof(double));

    Vector vector_of(const ContactState& at, double r, double speed) const {
        Vector x = at.z;
        x[states_] = r;
        x[states_ + 1] = speed;
        return x;
    }
    Outputs outputs(const Vector& x) const {
        alignas(64) Outputs out{};
        by_->outputs.add(x.data(), &out.force);
        return out;
    }

    /// The force over a time, from its value, rate and second rate at the begin and the end.
    static HermiteInterpolant force_interpolant(double value0, double rate0, double second0, double value1,
                                                double rate1, double second1, double time) {
        const double square = time * time;
        return {value0, rate0 * time, second0 * square, value1, rate1 * time, second1 * square};
    }

    /// Records the greatest forces of some steps of a block in contact; `in` and `values` as of the block.
    void record_peaks(ContactState& at, const double* in, const double* values, int steps) const {
        const ContactBlock& block = by_->block_in_contact;
        const double *force = values, *rate = force + ContactBlock::points, *speed = in + states_ + 1;
        const Outputs before = outputs(vector_of(at, in[states_], speed[0]));
        double value = before.force, slope = before.force_rate;
        int point = 0;
        for (int step = 0; step < steps; ++step) {
            const double change = speed[step + 1] - speed[step];
            value += by_->force_by_speed[0] * change + by_->force_by_ramp[0] * at.ramp;
            slope += by_->force_by_speed[1] * change + by_->force_by_ramp[1] * at.ramp;
            for (int piece = 0; piece < by_->pieces; ++piece, ++point) {
                double highest = std::max(value, force[point]);
                const double known = at.elapsed + (point + 1) * by_->piece >= transient_phase ? at.lasting : at.peak;
                // Between two points the force rises by less than it would at the rate of the first.
                if (slope > 0 && rate[point] < 0 && highest + slope * by_->piece > known) {
                    double second = point == 0 ? before.force_second_rate : block.on_demand(in, point - 1);
                    if (piece == 0) second += by_->force_by_speed[2] * change + by_->force_by_ramp[2] * at.ramp;
                    highest = std::max(highest, force_interpolant(value, slope, second, force[point], rate[point],
                                                                  block.on_demand(in, point), by_->piece)
                                                    .maximum());
                }
                const double from = point * by_->piece;
                at.record_force(highest, from, from + by_->piece, [&](double t) {
                    return HermiteInterpolant(value, slope * by_->piece, force[point], rate[point] * by_->piece)
                        .at((t - from) / by_->piece);
                });
                value = force[point];
                slope = rate[point];
            }
        }
    }

    /// One piece of a step, from `r` on; it is cut where arm and body touch or separate.
    void step_piece(ContactState& at, double r, double speed, bool final) const {
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
            const Outputs before = outputs(begin), after = outputs(next);
            double share = 1;  // of the time left, after which arm and body touch or separate
            bool changes = false;
            if (at.contact) {
                changes = after.force < -by_->force_tolerance;
                const bool turns = before.force_rate > 0 && after.force_rate < 0;
                double highest = std::max(before.force, after.force);
                if (turns || changes) {
                    const HermiteInterpolant force =
                        force_interpolant(before.force, before.force_rate, before.force_second_rate, after.force,
                                          after.force_rate, after.force_second_rate, time);
                    if (turns) highest = std::max(highest, force.maximum());
                    if (changes) share = force.root();
                }
                at.record_force(highest, 0, share * time, [&](double t) {
                    return HermiteInterpolant(before.force, before.force_rate * time, after.force,
                                              after.force_rate * time)
                        .at(t / time);
                });
                at.duration += share * time;
            } else {
                changes = after.penetration > 0 && after.force > by_->force_tolerance;
                at.max_penetration = std::max(at.max_penetration, after.penetration);
                // The force of a body with damping ends while it is still compressed: then the force shows the touch.
                if (changes && before.penetration < 0)
                    share = HermiteInterpolant(before.penetration, before.penetration_rate * time, after.penetration,
                                               after.penetration_rate * time)
                                .root();
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
