/// @file
/// State transition matrices of arm and body: their exact motion over a time.
#pragma once

#include <numeric>
#include <optional>
#include <span>

#include "bumpstop/collision/contact/contact_system.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// State transition matrices exp(A t) minus the unit matrix, for t = duration, duration / 2, duration / 4 and so on
/// until A t is small. Without the unit matrix a state that hardly changes keeps the digits of its change.
class Transitions {
  public:
    static constexpr int padded = detail::PaddedMatrix::padded(ContactSystem::max_size);

    Transitions() = default;
    Transitions(const detail::PaddedMatrix& a, double duration)
        : size_(a.columns()), coordinates_(a.columns() / 2 - 1), duration_(duration) {
        int halvings = 0;
        double t = duration;
        for (const double norm = a.norm(); norm * t > small; t /= 2) ++halvings;
        // The series by Horner's rule in powers of four: six products for fourteen terms.
        const detail::PaddedMatrix x = t * a, x2 = x * x, x3 = x2 * x, x4 = x2 * x2;
        detail::PaddedMatrix psi = (1.0 / 13) * x + (1.0 / (13 * 14)) * x2;
        for (int k = 8; k >= 0; k -= 4) {
            const double first = 1.0 / (k + 1), second = first / (k + 2), third = second / (k + 3);
            psi = first * x + second * x2 + third * x3 + (third / (k + 4)) * (x4 + x4 * psi);
        }
        by_halving_.resize(std::size_t(halvings) + 1);
        by_halving_.back() = psi;
        for (int h = halvings; h-- > 0;) {
            psi = doubled(psi);
            by_halving_[std::size_t(h)] = psi;
        }
        if (coordinates_ == 0) return;
        rate_unit_ = a(0, coordinates_);
        accelerations_ = detail::PaddedMatrix(coordinates_, size_);
        for (int j = 0; j < size_; ++j)
            for (int i = 0; i < coordinates_; ++i) accelerations_(i, j) = a(coordinates_ + i, j);
    }

    /// exp(A t) - 1 over twice the time.
    static detail::PaddedMatrix doubled(const detail::PaddedMatrix& change) { return 2.0 * change + change * change; }
    /// exp(A t) - 1 over the duration.
    const detail::PaddedMatrix& change() const { return by_halving_[0]; }
    /// Adds to y the change of the state x over the duration; both of length `padded`.
    void add(const double* x, double* y) const { by_halving_[0].add(x, y); }
    /// Advances the state x, of length `padded`, by a share of the duration; its entries beyond the size of A are 0.
    void advance(double* x, double share) const {
        const int halvings = int(by_halving_.size()) - 1;
        const auto parts = std::lround(std::ldexp(share, halvings));
        std::array<double, padded> y;
        for (int h = 0; h <= halvings; ++h) {
            if ((parts >> (halvings - h) & 1) == 0) continue;
            const detail::PaddedMatrix& change = by_halving_[std::size_t(h)];
            std::copy_n(x, change.rows(), y.begin());
            change.add(x, y.data());
            std::copy_n(y.begin(), change.rows(), x);
        }
        // The rest of the time, positive or negative, is short enough for a series.
        const double left = (share - std::ldexp(double(parts), -halvings)) * duration_;
        if (left == 0 || coordinates_ == 0) return;
        const std::size_t m = std::size_t(coordinates_), n = 2 * m;
        alignas(64) std::array<double, padded> term, rate;
        std::copy_n(x, size_, term.begin());
        for (int k = 1; k <= terms; ++k) {
            std::fill_n(rate.begin(), accelerations_.rows(), 0.0);
            accelerations_.add(term.data(), rate.data());
            const double factor = left / k;
            for (std::size_t i = 0; i < m; ++i) {
                x[i] += term[i] = term[m + i] * (rate_unit_ * factor);
                x[m + i] += term[m + i] = rate[i] * factor;
            }
            x[n] += term[n] = term[n + 1] * factor;
            term[n + 1] = 0;
        }
    }

  private:
    /// The series are cut below the last digit: small^15 / 15!, and (small / 2)^12 / 12!.
    static constexpr double small = 0.5;
    static constexpr int terms = 11;

    int size_ = 0, coordinates_ = 0;
    double duration_ = 0, rate_unit_ = 1;
    detail::PaddedMatrix accelerations_;  ///< those rows of A
    std::vector<detail::PaddedMatrix> by_halving_;
};

/// Several simulation steps at once, in which arm and body stay in contact, or apart. From the state, the distance r at
/// the begin and the reference's speed in each step it computes outputs, such as the force, after every piece of a
/// step, and the state after some of the steps.
class ContactBlock {
  public:
    static constexpr int points = 16, max_outputs = 2;
    /// Inputs: state, r, the speed before the block and in each of its steps, the ramp.
    static constexpr int max_columns = ContactSystem::max_states + 3 + points, max_values = max_outputs * points;

    ContactBlock() = default;
    /// `by`: transitions over one of the `pieces` of a step, of which there are a power of two and at most `points`.
    /// `outputs`: their rows. The last is that of an output on demand, which is computed at single points only.
    ContactBlock(const Transitions& by, int pieces, const ContactSystem& system,
                 std::span<const ContactSystem::Row> outputs)
        : steps_(points / pieces),
          states_(system.states()),
          columns_(states_ + 3 + steps_),
          outputs_((int(outputs.size()) - 1) * points, columns_),
          on_demand_(std::size_t(points * columns_)) {
        for (int steps = 1; steps <= steps_; steps *= 2) after_.emplace_back(states_, states_ + 3 + steps);
        add_state(by, pieces, outputs);
        add_reference(by, pieces, system.reaction_jump(), system.jump(), outputs);
    }

    /// in: state, r, speeds, ramp (states + 3 + steps); out: the outputs, each at every point.
    void operator()(const double* in, double* out) const {
        std::fill_n(out, outputs_.rows(), 0.0);
        outputs_.add(in, out);
    }
    /// The output on demand at a point.
    double on_demand(const double* in, int point) const {
        const double* row = &on_demand_[std::size_t(point * columns_)];
        return std::inner_product(in, in + columns_, row, 0.0);
    }

    /// Advances the state in `in` by `count` steps, whose begins and ends are `place`.
    void advance(int count, double* in, const double* place, double offset) const {
        std::array<double, max_columns> x;
        std::array<double, Transitions::padded> z;
        const double *speed = in + states_ + 1, ramp = speed[steps_ + 1];
        for (int done = 0, n = int(after_.size()) - 1; n >= 0; --n) {
            const int steps = 1 << n;
            if ((count & steps) == 0) continue;
            std::copy_n(in, states_, x.begin());
            double* rest = x.data() + states_;
            *rest++ = place[done] - offset;
            std::copy_n(speed + done, steps + 1, rest);
            rest[steps + 1] = ramp;
            std::fill_n(z.begin(), after_[std::size_t(n)].rows(), 0.0);
            after_[std::size_t(n)].add(x.data(), z.data());
            std::copy_n(z.begin(), states_, in);
            done += steps;
        }
    }

  private:
    using Vector = std::array<double, Transitions::padded>;

    void set(int output, int point, int column, double value) {
        if (output < outputs_.rows() / points)
            outputs_(output * points + point, column) = value;
        else
            on_demand_[std::size_t(point * columns_ + column)] = value;
    }
    /// Columns of the state and of r.
    void add_state(const Transitions& by, int pieces, std::span<const ContactSystem::Row> outputs) {
        const detail::PaddedMatrix transposed = by.change().transposed();
        for (int t = 0; t < int(outputs.size()); ++t) {
            Vector row{};
            std::copy_n(outputs[std::size_t(t)].begin(), states_ + 2, row.begin());
            for (int point = 0; point < points; ++point) {
                Vector next = row;
                transposed.add(row.data(), next.data());
                row = next;
                for (int j = 0; j <= states_; ++j) set(t, point, j, row[std::size_t(j)]);
            }
        }
        detail::PaddedMatrix change = by.change();
        for (int n = 1; n < pieces; n *= 2) change = Transitions::doubled(change);
        for (detail::PaddedMatrix& after : after_) {
            for (int j = 0; j <= states_; ++j)
                for (int i = 0; i < states_; ++i) after(i, j) = change(i, j) + (i == j ? 1.0 : 0.0);
            change = Transitions::doubled(change);
        }
    }
    /// Columns of the speed before the block, of those in its steps, each of which acts as that in the first but later,
    /// and of the ramp. `sudden` and `foreseen`: by what the state jumps as the speed changes, and if that is the ramp.
    void add_reference(const Transitions& by, int pieces, const ContactSystem::Row& sudden,
                       const ContactSystem::Row& foreseen, std::span<const ContactSystem::Row> outputs) {
        const int of_ramp = columns_ - 1, first = states_ + 2;
        Vector before{}, moved{}, ramped{};
        for (int point = 0; point < points; ++point) {
            const int step = point / pieces, done = step + 1;
            for (std::size_t j = 0; point % pieces == 0 && j < std::size_t(states_); ++j) {
                if (step == 0) before[j] = -sudden[j];
                moved[j] += step == 0 ? sudden[j] : step == 1 ? -sudden[j] : 0.0;
                ramped[j] += foreseen[j] - sudden[j];
            }
            moved[std::size_t(states_) + 1] = step == 0 ? 1.0 : 0.0;
            for (Vector* x : {&before, &moved, &ramped}) {
                Vector next = *x;
                by.add(x->data(), next.data());
                *x = next;
            }
            for (int t = 0; t < int(outputs.size()); ++t) {
                const auto value = [&](const Vector& x) {
                    return std::inner_product(&x[0], &x[0] + first, outputs[std::size_t(t)].begin(), 0.0);
                };
                set(t, point, first - 1, value(before));
                for (int later = 0; point + later * pieces < points; ++later)
                    set(t, point + later * pieces, first + later, value(moved));
                set(t, point, of_ramp, value(ramped));
            }
            if ((point + 1) % pieces != 0) continue;
            for (int n = 0, steps = 1; n < int(after_.size()); ++n, steps *= 2) {
                const auto set_after = [&](int column, const Vector& x) {
                    for (int j = 0; j < states_; ++j) after_[std::size_t(n)](j, column) = x[std::size_t(j)];
                };
                if (done <= steps) set_after(first + steps - done, moved);
                if (done != steps) continue;
                set_after(first - 1, before);
                set_after(first + steps, ramped);
            }
        }
    }

    int steps_ = 0, states_ = 0, columns_ = 0;
    detail::PaddedMatrix outputs_;
    std::vector<double> on_demand_;            ///< [point][column]
    std::vector<detail::PaddedMatrix> after_;  ///< the state after 1, 2, 4 and so on steps
};

/// An arm this far from a body does not touch it in spite of rounding [m].
inline constexpr double separation_tolerance = 1e-12;

/// All that it takes to advance collisions of one system by simulation steps.
struct ContactPropagator {
    static constexpr double max_phase = 0.4;  ///< of the oscillation in contact, in a piece of a step [rad]

    ContactPropagator(const ContactSystem& system, double step)
        : states(system.states()),
          dof(system.arm().dof),
          gets_away(system.body().gets_away()),
          step(step),
          pieces(pieces_of(system.frequency() * step / max_phase)),
          piece(step / pieces),
          force_tolerance(system.body().stiffness * separation_tolerance),
          static_stiffness(system.static_stiffness()),
          half_oscillation(system.half_oscillation()),
          servo_lag(system.servo_lag()) {
        const detail::PaddedMatrix pressed = system.matrix(true), alone = system.matrix(false);
        in_contact = Transitions(pressed, piece);
        apart = Transitions(alone, piece);
        std::array<Row, 5> rows;  // force, its rate and second rate in contact; penetration and its rate apart
        rows[0] = system.force();
        rows[1] = system.rate(rows[0], pressed);
        rows[2] = system.rate(rows[1], pressed);
        rows[3] = system.penetration();
        rows[4] = system.rate(rows[3], alone);
        jump = system.jump();
        leaves_reference = std::any_of(jump.begin(), jump.end(), [](double each) { return each != 0; });
        reaction_jump = system.reaction_jump();
        for (std::size_t m = 0; m < force_by_speed.size(); ++m) {
            force_by_speed[m] = rows[m][std::size_t(states) + 1];
            for (int j = 0; j < states; ++j) {
                force_by_speed[m] += rows[m][std::size_t(j)] * reaction_jump[std::size_t(j)];
                force_by_ramp[m] += rows[m][std::size_t(j)] * (jump[std::size_t(j)] - reaction_jump[std::size_t(j)]);
            }
        }
        block_steps = pieces > ContactBlock::points ? 0 : ContactBlock::points / pieces;
        if (block_steps > 0) {
            block_in_contact = ContactBlock(in_contact, pieces, system, {&rows[0], 3});
            block_apart = ContactBlock(apart, pieces, system, {&rows[3], 2});
        }
        outputs = detail::PaddedMatrix(int(rows.size()), states + 2);
        for (std::size_t i = 0; i < rows.size(); ++i)
            for (int j = 0; j < states + 2; ++j) outputs(int(i), j) = rows[i][std::size_t(j)];
        residual = detail::PaddedMatrix(dof, states);
        for (int i = 0; i < dof; ++i) {
            const Row row = system.residual(i);
            for (int j = 0; j < states; ++j) residual(i, j) = row[std::size_t(j)];
            // The speed changes in jumps, one at the begin of each step: midway through a jump the rates are those of an
            // acceleration that is even.
            residual_by_ramp[std::size_t(i)] =
                system.residual_by_acceleration(i) / step +
                0.5 * std::inner_product(row.begin(), row.begin() + states, jump.begin(), 0.0);
        }
    }

    using Row = ContactSystem::Row;

    /// The arm has elastic gears; else it is rigid.
    bool elastic() const { return dof > 0; }

    int states;
    int dof;         ///< of an elastic arm; 0: the arm is rigid
    bool gets_away;  ///< nothing holds the body
    /// The controller of an elastic arm does not feed all of the acceleration forward: it lags while the motion speeds up.
    bool leaves_reference = false;
    double step;              ///< simulation step [s]
    int pieces;               ///< of a step, each a small part of an oscillation
    double piece;             ///< [s]
    double force_tolerance;   ///< of a penetration within the separation tolerance, which counts as no force [N]
    double static_stiffness;  ///< ContactSystem::static_stiffness [N/m]
    double half_oscillation;  ///< of contact [s]
    double servo_lag;         ///< ContactSystem::servo_lag [s]
    Transitions in_contact, apart;
    /// Change of force, rate and second rate by a change of the reference's speed in a reaction, and the difference
    /// that it makes where the gears already carry the torque for it [N s/m, N/m, N/(m s)].
    std::array<double, 3> force_by_speed{}, force_by_ramp{};
    Row jump, reaction_jump;        ///< as of ContactSystem
    int block_steps;                ///< of a block; 0: oscillations are too fast for blocks
    ContactBlock block_in_contact;  ///< outputs: force and rate, on demand the second rate
    ContactBlock block_apart;       ///< output: penetration
    detail::PaddedMatrix outputs;   ///< rows of force and penetration with their rates, by state, r and speed
    detail::PaddedMatrix residual;  ///< [joint][state], of an elastic arm
    /// Residual at the end of a step by the change of the reference's speed from step to step [Nm s/m].
    std::array<double, max_joints> residual_by_ramp{};

  private:
    /// Blocks need a power of two.
    static int pieces_of(double phases) {
        int pieces = 1;
        while (pieces < phases && pieces < ContactBlock::points) pieces *= 2;
        return pieces < phases ? int(std::ceil(phases)) : pieces;
    }
};

/// The propagator of a system, if there is one.
inline std::optional<ContactPropagator> propagator_of(const std::optional<ContactSystem>& system, double step) {
    if (!system) return std::nullopt;
    return ContactPropagator(*system, step);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
