/// @file
/// Minimum-norm solution of a linear system: the least-norm joint rates for a velocity.
#pragma once

#include "bumpstop/model/chain.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

inline constexpr int max_task_rows = 6;
inline constexpr int max_columns = max_joints + max_task_rows;

/// Operations on rows of `n` entries; `Columns` is n where it is known at compile time, else 0.
template <int Columns, class T>
struct RowOf {
    /// Dot product with three partial sums: one chain of dependent additions would determine the speed of everything
    /// below.
    static T dot(const T* a, const T* b, int n) {
        T sum[3] = {a[0] * b[0], T(0.0), T(0.0)};
        if (n > 1) sum[1] = a[1] * b[1];
        if (n > 2) sum[2] = a[2] * b[2];
        if constexpr (Columns > 0) {
            BUMPSTOP_UNROLL
            for (int j = 3; j < Columns; ++j) sum[j % 3] += a[j] * b[j];
        } else {
            int j = 3;
            for (; j + 2 < n; j += 3) {
                sum[0] += a[j] * b[j];
                sum[1] += a[j + 1] * b[j + 1];
                sum[2] += a[j + 2] * b[j + 2];
            }
            if (j < n) sum[0] += a[j] * b[j];
            if (j + 1 < n) sum[1] += a[j + 1] * b[j + 1];
        }
        return (sum[0] + sum[1]) + sum[2];
    }
    /// to += factor * from.
    static void add(T* to, const T& factor, const T* from, int n) {
        if constexpr (Columns > 0) {
            BUMPSTOP_UNROLL
            for (int j = 0; j < Columns; ++j) to[j] += factor * from[j];
        } else {
            for (int j = 0; j < n; ++j) to[j] += factor * from[j];
        }
    }
};

/// Conditioning of the rows by the sine of the angle between each row and the span of those before it. The sine has no
/// unit, so rotations and translations need no common scale. The direction of a row that almost vanishes may be
/// rounding, so its length is compared with the usual one of rows of its kind (`min_length` of min_norm).
template <class T>
struct Conditioning {
    MaskOf<T> singular;  ///< some sine is below `singular_sine`
    T min_sine_squared;  ///< square of the smallest sine, 0 where singular
};
inline constexpr double singular_sine = 1e-6;

/// Solves row[c] . x = target[c], c < Rows, for the x of least norm; `Columns` is the number of columns, or 0
/// to take it from `columns` at run time.
///
/// The rows are orthogonalised (modified Gram-Schmidt without square roots), which needs no pivoting and serves square
/// and redundant chains alike. x is built from the last row backward, corrected by what it already contains: so the
/// method is backward stable (A. Bjorck, "Numerical methods for least squares problems", 1996, section 2.4.4).
///
/// `min_length`: squared length, by row, that a row counts as having at least in the sines, so that the sine of a row
/// that almost vanishes is almost zero. Null: the rows' own lengths. `row` and `target` are overwritten.
template <int Rows, int Columns, class T>
Conditioning<T> min_norm(T (*row)[max_columns], int columns, T* target, T* x, const T* min_length = nullptr) {
    using Row = RowOf<Columns, T>;
    T inverse[Rows], before[Rows], first;
    BUMPSTOP_UNROLL
    for (int c = 0; c < Rows; ++c) before[c] = Row::dot(row[c], row[c], columns);
    first = before[0];
    if (min_length != nullptr) {
        BUMPSTOP_UNROLL
        for (int c = 0; c < Rows; ++c) before[c] = max(before[c], min_length[c]);
    }
    T singular_margin = 1.0, least = 1.0, least_before = 1.0;
    BUMPSTOP_UNROLL
    for (int c = 0; c < Rows; ++c) {
        const T* u = row[c];
        // Avoids division by zero for a row that vanishes; the caller learns of it by the sine.
        const T square = c == 0 ? first : Row::dot(u, u, columns);
        inverse[c] = 1.0 / max(square, T(1e-200));
        singular_margin = min(singular_margin, square - singular_sine * singular_sine * before[c]);
        const MaskOf<T> lesser = square * least_before < least * before[c];
        least = select(lesser, square, least);
        least_before = select(lesser, before[c], least_before);
        BUMPSTOP_UNROLL
        for (int d = c + 1; d < Rows; ++d) {
            const T shared = Row::dot(u, row[d], columns) * inverse[c];
            Row::add(row[d], -shared, u, columns);
            target[d] -= shared * target[c];
        }
    }
    for (int j = 0; j < columns; ++j) x[j] = 0.0;
    BUMPSTOP_UNROLL
    for (int c = Rows - 1; c >= 0; --c)
        Row::add(x, (target[c] - Row::dot(row[c], x, columns)) * inverse[c], row[c], columns);
    const MaskOf<T> singular = singular_margin <= T(0.0);
    return {singular, select(singular, T(0.0), least / least_before)};
}

/// Damped least squares, x = R' (R R' + damping^2 I)^-1 target: the same problem with `damping` times the unit matrix
/// appended to the rows. `damping` 0 is exact. x must hold columns + Rows entries.
template <int Rows, class T>
Conditioning<T> damped_min_norm(T (*row)[max_columns], int columns, T* target, double damping, T* x,
                                const T* min_length = nullptr) {
    if (damping > 0) {
        BUMPSTOP_UNROLL
        for (int c = 0; c < Rows; ++c)
            for (int i = 0; i < Rows; ++i) row[c][columns + i] = i == c ? damping : 0.0;
        return min_norm<Rows, 0>(row, columns + Rows, target, x, min_length);
    }
    // For arms with six or seven joints the loops are unrolled.
    if (columns == 6) return min_norm<Rows, 6>(row, columns, target, x, min_length);
    if (columns == 7) return min_norm<Rows, 7>(row, columns, target, x, min_length);
    return min_norm<Rows, 0>(row, columns, target, x, min_length);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
