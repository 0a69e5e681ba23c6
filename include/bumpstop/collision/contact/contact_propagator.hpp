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
        // The series by Horner's rule.
        const detail::PaddedMatrix step = t * a;
        detail::PaddedMatrix psi = step;
        for (int k = matrix_terms; k > 1; --k) psi = step + (1.0 / k) * (step * psi);
        by_halving_.resize(std::size_t(halvings) + 1);
        by_halving_.back() = psi;
        for (int h = halvings; h-- > 0;) {
            psi = 2.0 * psi + psi * psi;
            by_halving_[std::size_t(h)] = psi;
        }
        if (coordinates_ == 0) return;
        rate_unit_ = a(0, coordinates_);
        accelerations_ = detail::PaddedMatrix(coordinates_, size_);
        for (int j = 0; j < size_; ++j)
            for (int i = 0; i < coordinates_; ++i) accelerations_(i, j) = a(coordinates_ + i, j);
    }

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
    static constexpr int matrix_terms = 14, terms = 11;

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
    /// `on_demand`: the row of an output that is computed at single points only.
    ContactBlock(const Transitions& by, int pieces, const ContactSystem& system,
                 std::span<const ContactSystem::Row> outputs, const ContactSystem::Row& on_demand)
        : steps_(points / pieces),
          states_(system.states()),
          columns_(states_ + 3 + steps_),
          outputs_(int(outputs.size()) * points, columns_),
          on_demand_(std::size_t(points * columns_)) {
        const ContactSystem::Row reaction_jump = system.reaction_jump(), jump = system.jump();
        for (int steps = 1; steps <= steps_; steps *= 2) after_.emplace_back(states_, states_ + 3 + steps);
        detail::PaddedMatrix rows(int(outputs.size()) + 1, states_ + 2);
        for (int j = 0; j < states_ + 2; ++j) {
            for (std::size_t t = 0; t < outputs.size(); ++t) rows(int(t), j) = outputs[t][std::size_t(j)];
            rows(int(outputs.size()), j) = on_demand[std::size_t(j)];
        }
        std::array<double, Transitions::padded> z, next;
        std::array<double, detail::PaddedMatrix::padding> value;
        for (int column = 0; column < columns_; ++column) {
            z.fill(0.0);
            if (column <= states_) z[std::size_t(column)] = 1;
            // Column states + 1 + i is a unit speed in step i, 0 being that before the block; the last is a unit ramp.
            const bool of_ramp = column == columns_ - 1;
            const auto speed_in = [&](int i) { return column == states_ + 1 + i && !of_ramp ? 1.0 : 0.0; };
            // Before the step in which a speed begins there is nothing.
            const int from = of_ramp ? 0 : std::max(0, column - states_ - 2) * pieces;
            for (int point = from; point < points; ++point) {
                double& speed = z[std::size_t(states_) + 1];
                const int step = point / pieces + 1;
                if (point % pieces == 0) {
                    speed = speed_in(step);
                    const double change = speed - speed_in(step - 1), ramp = of_ramp ? 1.0 : 0.0;
                    for (int j = 0; j < states_; ++j)
                        z[std::size_t(j)] +=
                            reaction_jump[std::size_t(j)] * (change - ramp) + jump[std::size_t(j)] * ramp;
                }
                next = z;
                by.add(z.data(), next.data());
                z = next;
                value.fill(0.0);
                rows.add(z.data(), value.data());
                for (std::size_t t = 0; t < outputs.size(); ++t) outputs_(int(t) * points + point, column) = value[t];
                on_demand_[std::size_t(point * columns_ + column)] = value[outputs.size()];
                for (std::size_t n = 0; n < after_.size() && (point + 1) % pieces == 0; ++n) {
                    if (step != 1 << n || (column > states_ + 1 + step && !of_ramp)) continue;
                    const int own = of_ramp ? states_ + 2 + step : column;
                    for (int j = 0; j < states_; ++j) after_[n](j, own) = z[std::size_t(j)];
                }
            }
        }
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
            block_in_contact = ContactBlock(in_contact, pieces, system, {&rows[0], 2}, rows[2]);
            block_apart = ContactBlock(apart, pieces, system, {&rows[3], 1}, rows[4]);
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
