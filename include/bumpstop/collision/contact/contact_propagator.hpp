/// @file
/// How arm and body go on over a time, exactly.
#pragma once

#include <span>

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

/// The same for one vector of doubles, rows beside one another: `stride` rows, of which some may be padding.
inline void multiply_add(const double* column, int stride, int columns, const double* x, double* y) {
    using Native = Lanes<native_lanes>;
    constexpr int together = 4;  // sums of registers of rows, which hide how long each addition takes
    for (int i = 0; i < stride; i += together * native_lanes) {
        Native sum[together];
        const int count = std::min(together, (stride - i) / native_lanes);
        const auto add = [&](auto registers) {
            for (int r = 0; r < registers; ++r) sum[r] = Native::load(y + i + r * native_lanes);
            for (int j = 0; j < columns; ++j)
                for (int r = 0; r < registers; ++r)
                    sum[r] += Native::load(column + j * stride + i + r * native_lanes) * x[j];
            for (int r = 0; r < registers; ++r) sum[r].store(y + i + r * native_lanes);
        };
        count == together ? add(std::integral_constant<int, together>()) : add(count);
    }
}

}  // namespace detail

/// exp(A t) - 1 for t = duration, duration / 2, duration / 4 and so on, until A t is small. Kept without the 1: that keeps
/// the digits of what hardly changes.
class Transitions {
  public:
    Transitions() = default;
    Transitions(const detail::SquareMatrix& a, double duration)
        : size_(a.size()), stride_((a.size() + 7) / 8 * 8), duration_(duration) {
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

    /// Adds to the first `rows` of y what the duration changes of x.
    template <class T>
    void add(const T* x, T* y, int rows) const {
        detail::multiply_add(by_halving_[0].data(), stride_, rows, size_, x, y);
    }
    /// Takes x, of length `padded`, on by a share of the duration; the entries past A's are 0.
    void advance(double* x, double share) const {
        std::array<double, padded> y;
        double part = 1;
        for (const std::vector<double>& change : by_halving_) {
            if (share >= part) {
                std::copy_n(x, padded, y.begin());
                detail::multiply_add(change.data(), stride_, size_, x, y.data());
                std::copy_n(y.begin(), padded, x);
                share -= part;
            }
            part /= 2;
        }
        // What is left is short: its series.
        if (!(share > 0)) return;
        std::array<double, padded> term;
        std::copy_n(x, padded, term.begin());
        for (int k = 1; k <= 5; ++k) {
            y.fill(0.0);
            detail::multiply_add(generator_.data(), stride_, size_, term.data(), y.data());
            for (int i = 0; i < size_; ++i) x[i] += term[std::size_t(i)] = y[std::size_t(i)] * (share * duration_ / k);
        }
    }
    static constexpr int padded = (ContactSystem::max_size + 7) / 8 * 8;

  private:
    void keep(const detail::SquareMatrix& psi, std::vector<double>& out) const {
        out.assign(std::size_t(stride_ * size_), 0.0);
        for (int j = 0; j < size_; ++j)
            for (int i = 0; i < size_; ++i) out[std::size_t(j * stride_ + i)] = psi(i, j);
    }

    int size_ = 0, stride_ = 0;
    double duration_ = 0;
    std::vector<double> generator_;                ///< A, [column][row]
    std::vector<std::vector<double>> by_halving_;  ///< [halving][column][row]
};

/// Several steps at once, as long as arm and body neither meet nor part: what they make of the state, of the distance r at
/// their begin and of the reference's speed in each step, and what some rows tell after every piece of a step.
class ContactBlock {
  public:
    static constexpr int points = 8, max_tells = 3;
    /// State, r, the speed before and those of the steps, the ramp; state and what is told.
    static constexpr int max_columns = ContactSystem::max_states + 3 + points,
                         max_rows = ContactSystem::max_states + max_tells * points;

    ContactBlock() = default;
    /// `by`: transitions, the first of which is one piece of `piece` seconds; `pieces` of a step, at most `points` and a power
    /// of two.
    ContactBlock(const Transitions& by, int pieces, double piece, const ContactSystem& system,
                 std::span<const ContactSystem::Row> tells)
        : rows_(system.states() + int(tells.size()) * points),
          columns_(system.states() + 3 + points / pieces),
          stride_((rows_ + 3) / 4 * 4),
          column_(std::size_t(stride_ * columns_), 0.0) {
        using Native = Lanes<native_lanes>;  // a column each
        const int states = system.states();
        const ContactSystem::Row jump = system.reaction_jump(), wound = system.jump();
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
            // Column states + 1 + i is a speed that lasts for step i: before the first step, or a step of the block. The last
            // one is the ramp.
            const auto speed_in = [&](int i) {
                Native speed = 0.0;
                for (int lane = 0; lane < count; ++lane)
                    if (first + lane == states + 1 + i) speed.set(lane, 1);
                return speed;
            };
            for (int point = 0; point < points; ++point) {
                Native& speed = z[std::size_t(states) + 1];
                if (point % pieces == 0) {
                    const int step = point / pieces + 1;
                    speed = speed_in(step);
                    const Native change = speed - speed_in(step - 1);
                    const Native ramp = speed_in(points / pieces + 1);
                    for (int j = 0; j < states; ++j)
                        z[std::size_t(j)] += jump[std::size_t(j)] * (change - ramp) + wound[std::size_t(j)] * ramp;
                }
                next = z;
                by.add(z.data(), next.data(), states);
                next[std::size_t(states)] += speed * piece;
                z = next;
                for (std::size_t t = 0; t < tells.size(); ++t) {
                    Native told = 0.0;
                    for (int j = 0; j < states + 2; ++j) told += tells[t][std::size_t(j)] * z[std::size_t(j)];
                    keep(states + int(t) * points + point, told);
                }
            }
            for (int j = 0; j < states; ++j) keep(j, z[std::size_t(j)]);
        }
    }

    /// in: state, r, speeds, ramp (states + 3 + steps); out: state and what the rows tell at every point, zero before.
    template <class T>
    void operator()(const T* in, T* out) const {
        detail::multiply_add(column_.data(), stride_, rows_, columns_, in, out);
    }
    int rows() const { return rows_; }

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
          pieces(pieces_of(system.frequency() * step / max_turn)),
          piece(step / pieces),
          grazing(system.body().stiffness * separation_tolerance),
          static_stiffness(system.static_stiffness()),
          half_oscillation(system.frequency() > 0 ? std::numbers::pi / system.frequency() : 0) {
        const detail::SquareMatrix pressed = system.matrix(true), alone = system.matrix(false);
        in_contact = Transitions(pressed, piece);
        apart = Transitions(alone, piece);
        force[0] = system.force();
        force[1] = system.rate(force[0], pressed);
        force[2] = system.rate(force[1], pressed);
        gap[0] = system.gap();
        gap[1] = system.rate(gap[0], alone);
        jump = system.jump();
        reaction_jump = system.reaction_jump();
        for (std::size_t m = 0; m < force.size(); ++m) {
            by_speed[m] = force[m][std::size_t(states) + 1];
            for (int j = 0; j < states; ++j) {
                by_speed[m] += force[m][std::size_t(j)] * reaction_jump[std::size_t(j)];
                by_ramp[m] += force[m][std::size_t(j)] * (jump[std::size_t(j)] - reaction_jump[std::size_t(j)]);
            }
        }
        block_steps = pieces > ContactBlock::points ? 0 : ContactBlock::points / pieces;
        if (block_steps > 0) {
            block_in_contact = ContactBlock(in_contact, pieces, piece, system, force);
            block_apart = ContactBlock(apart, pieces, piece, system, {gap.data(), 1});
        }
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
    Transitions in_contact, apart;
    std::array<Row, 3> force;  ///< and its rates in contact
    /// What a change of the reference's speed in a reaction does to them, and how much less it is where gears have wound up
    /// for the change [N s/m, N/m, N/(m s)].
    std::array<double, 3> by_speed{}, by_ramp{};
    std::array<Row, 2> gap;                      ///< and its rate apart
    Row jump, reaction_jump;                     ///< as of ContactSystem
    int block_steps;                             ///< of a block; 0: oscillations are too quick for blocks
    ContactBlock block_in_contact, block_apart;  ///< the force, its rate and bend are told; the gap
    std::vector<Row> residual;                   ///< by joint, of an elastic arm

  private:
    /// Blocks want a power of two.
    static int pieces_of(double turns) {
        int pieces = 1;
        while (pieces < turns && pieces < ContactBlock::points) pieces *= 2;
        return pieces < turns ? int(std::ceil(turns)) : pieces;
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
