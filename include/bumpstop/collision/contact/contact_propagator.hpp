/// @file
/// How arm and body go on over a time, exactly.
#pragma once

#include "bumpstop/collision/contact/contact_system.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// Adds some rows of M x to as many of y.
template <int rows, class T>
void multiply_add_rows(const double* column, int stride, int columns, const T* x, T* y) {
    std::array<T, rows> sum;
    std::copy_n(y, rows, sum.begin());
    for (int j = 0; j < columns; ++j, column += stride)
        for (std::size_t i = 0; i < rows; ++i) sum[i] += column[i] * x[j];
    std::copy_n(sum.begin(), rows, y);
}

/// Adds M x to y (rows), for a matrix of `columns` stored one after the other, each of `stride` values. Sums of eight rows
/// at once hide how long each addition takes.
template <class T>
void multiply_add(const double* column, int stride, int rows, int columns, const T* x, T* y) {
    int i = 0;
    for (; i + 8 <= rows; i += 8) multiply_add_rows<8>(column + i, stride, columns, x, y + i);
    for (; i + 2 <= rows; i += 2) multiply_add_rows<2>(column + i, stride, columns, x, y + i);
    if (i < rows) multiply_add_rows<1>(column + i, stride, columns, x, y + i);
}

}  // namespace detail

/// exp(A t) - 1 for t = duration, duration / 2, duration / 4 and so on, until A t is small. Kept without the 1: that keeps
/// the digits of what hardly changes.
class Transitions {
  public:
    Transitions() = default;
    Transitions(const detail::SquareMatrix& a, double duration) : size_(a.size()), stride_((a.size() + 3) / 4 * 4) {
        constexpr double small = 1.0 / 128;
        int halvings = 0;
        double t = duration;
        for (const double norm = a.norm(); norm * t > small; t /= 2) ++halvings;
        // The series by Horner's rule: small^7 / 5040 is beyond the last digit.
        const detail::SquareMatrix step = t * a;
        detail::SquareMatrix psi = step;
        for (int k = 6; k > 1; --k) psi = step + (1.0 / k) * (step * psi);
        by_halving_.resize(std::size_t(halvings) + 1);
        keep(a, generator_);
        keep(psi, by_halving_.back());
        for (int h = halvings; h-- > 0;) {
            psi = 2.0 * psi + psi * psi;
            keep(psi, by_halving_[std::size_t(h)]);
        }
    }

    int halvings() const { return int(by_halving_.size()) - 1; }
    /// Adds to the first `rows` of y what duration / 2^h changes of x.
    template <class T>
    void add(int h, const T* x, T* y, int rows) const {
        detail::multiply_add(by_halving_[std::size_t(h)].data(), stride_, rows, size_, x, y);
    }
    /// Adds A x to the first `rows` of y.
    template <class T>
    void add_rate(const T* x, T* y, int rows) const {
        detail::multiply_add(generator_.data(), stride_, rows, size_, x, y);
    }

  private:
    void keep(const detail::SquareMatrix& psi, std::vector<double>& out) const {
        out.assign(std::size_t(stride_ * size_), 0.0);
        for (int j = 0; j < size_; ++j)
            for (int i = 0; i < size_; ++i) out[std::size_t(j * stride_ + i)] = psi(i, j);
    }

    int size_ = 0, stride_ = 0;
    std::vector<double> generator_;                ///< A, [column][row]
    std::vector<std::vector<double>> by_halving_;  ///< [halving][column][row]
};

/// Several steps in contact at once, as long as nothing parts: what they make of the state, of the distance r at their begin
/// and of the reference's speed in each, and the force and its rate after each.
class ContactBlock {
  public:
    static constexpr int steps = 8;
    static constexpr int max_rows = ContactSystem::max_states + 2 * steps, max_columns = max_rows;

    ContactBlock() = default;
    /// `by`: transitions of which level `level` is one step, of `step` seconds.
    ContactBlock(const Transitions& by, int level, double step, int states, const ContactSystem::Row& force,
                 const ContactSystem::Row& rate)
        : rows_(states + 2 * steps), columns_(states + 1 + steps), stride_((rows_ + 3) / 4 * 4) {
        column_.assign(std::size_t(stride_ * columns_), 0.0);
        using Native = Lanes<native_lanes>;  // a column each
        std::array<Native, ContactSystem::max_size> z, next;
        for (int first = 0; first < columns_; first += native_lanes) {
            std::fill_n(z.begin(), states + 2, Native(0.0));
            const int count = std::min(native_lanes, columns_ - first);
            for (int lane = 0; lane < count && first + lane <= states; ++lane)
                z[std::size_t(first + lane)].set(lane, 1);
            const auto keep = [&](int row, Native value) {
                for (int lane = 0; lane < count; ++lane)
                    column_[std::size_t((first + lane) * stride_ + row)] = value[lane];
            };
            for (int i = 0; i < steps; ++i) {
                // A speed is a pulse as long as its step.
                Native& speed = z[std::size_t(states) + 1];
                for (int lane = 0; lane < count; ++lane) speed.set(lane, first + lane == states + 1 + i ? 1 : 0);
                next = z;
                by.add(level, z.data(), next.data(), states);
                next[std::size_t(states)] += speed * step;
                z = next;
                Native f = 0.0, d = 0.0;
                for (int j = 0; j < states + 2; ++j) {
                    f += force[std::size_t(j)] * z[std::size_t(j)];
                    d += rate[std::size_t(j)] * z[std::size_t(j)];
                }
                keep(states + i, f);
                keep(states + steps + i, d);
            }
            for (int j = 0; j < states; ++j) keep(j, z[std::size_t(j)]);
        }
    }

    /// in: state, r, speeds (states + 1 + steps); out: state, forces, rates of force (states + 2 steps), zero before.
    template <class T>
    void operator()(const T* in, T* out) const {
        detail::multiply_add(column_.data(), stride_, rows_, columns_, in, out);
    }

  private:
    int rows_ = 0, columns_ = 0, stride_ = 0;
    std::vector<double> column_;
};

/// An arm this far from a body does not touch it, whatever rounding does [m].
inline constexpr double separation_tolerance = 1e-12;

/// All that carrying collisions on in time needs of a system, for one simulation step.
struct ContactPropagator {
    static constexpr double max_turn = 0.4;  ///< of the oscillation in contact, in a piece of a step [rad]

    ContactPropagator(const ContactSystem& system, double step)
        : states(system.states()),
          elastic(system.arm().dof > 0),
          gets_away(system.body().gets_away()),
          step(step),
          pieces(std::max(1, int(std::ceil(system.frequency() * step / max_turn)))),
          piece(step / pieces),
          grazing(system.body().stiffness * separation_tolerance),
          static_stiffness(system.static_stiffness()),
          half_oscillation(system.frequency() > 0 ? std::numbers::pi / system.frequency() : 0) {
        const detail::SquareMatrix in_contact = system.matrix(true), alone = system.matrix(false);
        together = Transitions(in_contact, piece);
        apart = Transitions(alone, piece);
        force[0] = system.force();
        force[1] = system.rate(force[0], in_contact);
        force[2] = system.rate(force[1], in_contact);
        gap[0] = system.gap();
        gap[1] = system.rate(gap[0], alone);
        jerks = elastic && !system.arm().feeds_all_forward();
        if (jerks) jump = system.jump();
        leaps = pieces == 1 && !jerks;
        if (leaps) block = ContactBlock(together, 0, step, states, force[0], force[1]);
        for (int j = 0; j < system.arm().dof; ++j) residual.push_back(system.residual(j));
    }

    using Row = ContactSystem::Row;

    int states;
    bool elastic;             ///< the arm gives way
    bool gets_away;           ///< nothing holds the body
    double step;              ///< simulation step [s]
    int pieces;               ///< of a step, each a small part of an oscillation
    double piece;             ///< [s]
    double grazing;           ///< a force that is none: of a gap within the separation tolerance [N]
    double static_stiffness;  ///< ContactSystem::static_stiffness [N/m]
    double half_oscillation;  ///< of contact [s]
    Transitions together, apart;
    std::array<Row, 3> force;  ///< and its rates in contact
    std::array<Row, 2> gap;    ///< and its rate apart
    bool jerks;                ///< some acceleration of the reference is not fed forward:
    Row jump{};                ///< what a change of its speed does
    bool leaps;                ///< blocks of steps are known:
    ContactBlock block;
    std::vector<Row> residual;  ///< by joint, of an elastic arm
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
