/// @file
/// Joint rates that move an arm along a line without turning its tool, all lanes worked out in one order.
#pragma once

#include "bumpstop/model/screw_columns.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The rates from the screws of the joints, about the middle of the chain. All lanes eliminate the columns in the same
/// order, which is changed when it does not serve them; there is none for lanes near singularities, where `min_norm` is
/// right.
template <class T>
class ScrewRates {
  public:
    /// As of ScrewColumns.
    ScrewRates(const Chain& chain, const int* free_joint, int count, const LinkPoint& tip, const double* travel)
        : columns_(chain, free_joint, count, tip, travel), order_(columns_.others()) {}

    /// Whether it can do this chain at all.
    bool works() const { return columns_.works(); }
    /// The angles of this joint and of those after it are not needed.
    int angles_needed() const { return columns_.angles_needed(); }

    /// Poses far from those before come next.
    void begin() { gave_up_ = false; }

    /// Writes the rates by free joint [rad/s] of least norm that give `velocity` (base frame, m/s) and do not turn the tool.
    /// False, and `x` means nothing, unless in all lanes they do so to 2e-11 of the largest of them and no row of the
    /// Jacobian at the tip is within 1e-6 of those before it (see Conditioning).
    /// `q`: joint positions, of which those of joints that slide are needed [m].
    bool solve(const JointAngles<T>& angle, const T* q, const Point3<T>& velocity, T* x) {
        Column column[max_joints];
        const Point3<T> v = columns_.find(angle, q, velocity, column);
        return eliminate(column, v, x) || in_another_order(column, v, x);
    }

  private:
    using Columns = ScrewColumns<T>;
    using Column = typename Columns::Column;
    /// What is subtracted from a row may be so many times greater than it: two subtractions lose three digits at most.
    static constexpr double largest_growth = 30;

    [[gnu::noinline]] bool in_another_order(const Column* column, const Point3<T>& v, T* x) {
        if (gave_up_) return false;
        const auto before = order_;
        const int others = columns_.count() - 2;
        std::sort(order_.begin(), order_.begin() + others);
        do {
            // Those eliminated last may change places.
            if (order_[2] < order_[3] && eliminate(column, v, x)) return true;
        } while (std::next_permutation(order_.begin(), order_.begin() + others));
        order_ = before;
        gave_up_ = true;
        return false;
    }
    bool eliminate(const Column* column, const Point3<T>& v, T* x) const {
        return columns_.count() == 6 ? eliminate_of<4>(column, v, x) : eliminate_of<5>(column, v, x);
    }
    /// Columns leave in the order of `order_`; of seven the last is free.
    template <int Others>
    bool eliminate_of(const Column* columns, const Point3<T>& v, T* x) const {
        const Column* column[Others];
        for (int c = 0; c < Others; ++c) column[c] = &columns[order_[c]];
        T row[3][Others - 1], b[3] = {v.x, v.y, v.z};  // once the first column is gone
        const T first = 1.0 / column[0]->row[0];
        T grown = 0.0;
        BUMPSTOP_UNROLL
        for (int i = 0; i < 3; ++i) {
            const T factor = column[0]->row[i + 1] * first;
            grown = maximum(grown, absolute(factor));
            BUMPSTOP_UNROLL
            for (int c = 1; c < Others; ++c) row[i][c - 1] = column[c]->row[i + 1] - factor * column[c]->row[0];
        }
        grown = grown * (1.0 / columns_.reach());
        const T second = 1.0 / row[0][0];
        BUMPSTOP_UNROLL
        for (int i = 1; i < 3; ++i) {
            const T factor = row[i][0] * second;
            grown = maximum(grown, absolute(factor));
            BUMPSTOP_UNROLL
            for (int c = 1; c < Others - 1; ++c) row[i][c] -= factor * row[0][c];
            b[i] -= factor * b[0];
        }
        const T minor = row[1][1] * row[2][2] - row[1][2] * row[2][1], third = 1.0 / minor;
        const T determinant = minor * (row[0][0] * column[0]->row[0]);
        auto back = [&](const T& r0, const T& r1, const T& r2, const T& top, T* to) {
            to[2] = (r1 * row[2][2] - r2 * row[1][2]) * third;
            to[3] = (r2 * row[1][1] - r1 * row[2][1]) * third;
            to[1] = (r0 - row[0][1] * to[2] - row[0][2] * to[3]) * second;
            to[0] = (top - column[1]->row[0] * to[1] - column[2]->row[0] * to[2] - column[3]->row[0] * to[3]) * first;
        };
        T rate[Others], own, next;
        back(b[0], b[1], b[2], T(0.0), rate);
        if constexpr (Others == 5) rate[4] = 0.0;
        Columns::template middle_rates<Others>(column, rate, own, next);
        if constexpr (Others == 5) {
            // What the rates may be moved along without moving the tool is taken off.
            T still[5], still_own, still_next;
            back(-row[0][3], -row[1][3], -row[2][3], -column[4]->row[0], still);
            still[4] = 1.0;
            Columns::template middle_rates<Others>(column, still, still_own, still_next);
            T shared = own * still_own + next * still_next, square = still_own * still_own + still_next * still_next;
            T most = 1.0;
            BUMPSTOP_UNROLL
            for (int c = 0; c < 4; ++c) {
                shared += rate[c] * still[c];
                square += still[c] * still[c];
                most = maximum(most, absolute(still[c]));
            }
            grown = maximum(grown, most);
            const T back_by = shared / (square + 1.0);
            BUMPSTOP_UNROLL
            for (int c = 0; c < 4; ++c) rate[c] -= back_by * still[c];
            rate[4] = -back_by;
            own -= back_by * still_own;
            next -= back_by * still_next;
        }
        columns_.template write<Others>(order_.data(), rate, own, next, x);
        return all((grown <= T(largest_growth)) & (absolute(determinant) >= T(columns_.least_determinant())));
    }

    const Columns columns_;
    std::array<int, Columns::most_others> order_;
    bool gave_up_ = false;  ///< no order serves the poses since `begin`
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
