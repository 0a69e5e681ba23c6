/// @file
/// Joint rates that move an arm along a line without turning its tool, each lane worked out in an order of its own.
#pragma once

#include "bumpstop/model/screw_columns.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The rates from the screws of the joints, about the middle of the chain, by elimination in which each lane takes the
/// largest entry of a row next. It serves poses near singularities as well, and a lane's rates do not depend on the others.
template <class T>
class PivotedRates {
  public:
    /// As of ScrewColumns.
    PivotedRates(const Chain& chain, const int* free_joint, int count, const LinkPoint& tip, const double* travel)
        : columns_(chain, free_joint, count, tip, travel) {}

    /// Whether it can do this chain at all.
    bool works() const { return columns_.works(); }

    /// Writes the rates by free joint [rad/s] of least norm that give `velocity` (base frame, m/s) and do not turn the tool.
    /// They are right, as far as that Jacobian allows, where the mask returned says so: in lanes in which no row of the
    /// Jacobian J at the tip is within 1e-12 of those before it (see Conditioning). `q`: joint positions, of which those of
    /// joints that slide are needed [m]. `squared_manipulability`: det(J J'), but for a factor that is the same at all poses
    /// of the chain (T. Yoshikawa, "Manipulability of robotic mechanisms", 1985).
    MaskOf<T> solve(const JointAngles<T>& angle, const T* q, const Point3<T>& velocity, T* x,
                    T& squared_manipulability) const {
        Column column[max_joints];
        const Point3<T> v = columns_.find(angle, q, velocity, column);
        return columns_.count() == 6 ? eliminate<4>(column, v, x, squared_manipulability)
                                     : eliminate<5>(column, v, x, squared_manipulability);
    }
    /// Where the squared manipulability is at least this much, no row is within 1e-6 of those before it.
    double never_singular_from() const { return columns_.least_determinant() * columns_.least_determinant(); }

  private:
    using Columns = ScrewColumns<T>;
    using Column = typename Columns::Column;
    /// Elimination that pivots serves poses so many times nearer to a singularity than those Conditioning calls singular.
    static constexpr double nearer_than_singular = 1e-6;

    /// The two change places where `mask` says so.
    [[gnu::always_inline]] static void exchange(const MaskOf<T>& mask, T& a, T& b) {
        const T before = a;
        a = select(mask, b, a);
        b = select(mask, before, b);
    }

    /// Four rows, and which columns changed places on the way to a triangle.
    template <int Others>
    struct Triangle {
        T row[4][Others], inverse[4];
        MaskOf<T> exchanged[4][Others];

        /// The largest entry of row k becomes its pivot.
        [[gnu::always_inline]] void choose(int k) {
            BUMPSTOP_UNROLL
            for (int c = k + 1; c < Others; ++c) {
                const MaskOf<T> larger = absolute(row[k][c]) > absolute(row[k][k]);
                exchanged[k][c] = larger;
                BUMPSTOP_UNROLL
                for (int i = 0; i < 4; ++i) exchange(larger, row[i][k], row[i][c]);
            }
            inverse[k] = 1.0 / row[k][k];
        }
        [[gnu::always_inline]] void take_off(int k, T* b) {
            BUMPSTOP_UNROLL
            for (int i = k + 1; i < 4; ++i) {
                const T factor = row[i][k] * inverse[k];
                BUMPSTOP_UNROLL
                for (int c = k + 1; c < Others; ++c) row[i][c] -= factor * row[k][c];
                b[i] -= factor * b[k];
            }
        }
        /// x[0 .. 3], of the columns as they were given, that the rows make `b` of.
        [[gnu::always_inline]] void solve(const T* b, T* x) const {
            BUMPSTOP_UNROLL
            for (int k = 3; k >= 0; --k) {
                T rest = b[k];
                BUMPSTOP_UNROLL
                for (int c = k + 1; c < 4; ++c) rest -= row[k][c] * x[c];
                x[k] = rest * inverse[k];
            }
        }
        [[gnu::always_inline]] void put_back(T* x) const {
            BUMPSTOP_UNROLL
            for (int k = 3; k >= 0; --k) {
                BUMPSTOP_UNROLL
                for (int c = Others - 1; c > k; --c) exchange(exchanged[k][c], x[k], x[c]);
            }
        }
    };

    template <int Others>
    MaskOf<T> eliminate(const Column* columns, const Point3<T>& v, T* x, T& squared_manipulability) const {
        const Column* column[Others];
        Triangle<Others> triangle;
        for (int c = 0; c < Others; ++c) {
            column[c] = &columns[columns_.others()[std::size_t(c)]];
            for (int i = 0; i < 4; ++i) triangle.row[i][c] = column[c]->row[i];
        }
        T b[4] = {T(0.0), v.x, v.y, v.z}, determinant = 1.0;
        BUMPSTOP_UNROLL
        for (int k = 0; k < 4; ++k) {
            triangle.choose(k);
            triangle.take_off(k, b);
            determinant = determinant * triangle.row[k][k];
        }
        T rate[Others], own, next;
        triangle.solve(b, rate);
        if constexpr (Others == 5) rate[4] = 0.0;
        triangle.put_back(rate);
        Columns::template middle_rates<Others>(column, rate, own, next);
        squared_manipulability = determinant * determinant;
        if constexpr (Others == 5) {
            // What the rates may be moved along without moving the tool is taken off.
            T still[5], still_own, still_next, opposite[4];
            for (int i = 0; i < 4; ++i) opposite[i] = -triangle.row[i][4];
            triangle.solve(opposite, still);
            still[4] = 1.0;
            triangle.put_back(still);
            Columns::template middle_rates<Others>(column, still, still_own, still_next);
            T shared = own * still_own + next * still_next, square = still_own * still_own + still_next * still_next;
            BUMPSTOP_UNROLL
            for (int c = 0; c < 5; ++c) {
                shared += rate[c] * still[c];
                square += still[c] * still[c];
            }
            const T back_by = shared / square;
            // The determinants of all six columns of seven are to each other as the rates that do not move the tool (Cauchy
            // and Binet).
            squared_manipulability = squared_manipulability * square;
            BUMPSTOP_UNROLL
            for (int c = 0; c < 5; ++c) rate[c] -= back_by * still[c];
            own -= back_by * still_own;
            next -= back_by * still_next;
        }
        columns_.template write<Others>(columns_.others().data(), rate, own, next, x);
        return absolute(determinant) >= T(nearer_than_singular * columns_.least_determinant());
    }

    const Columns columns_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
