/// @file
/// Singular values of the Jacobian at a point of the arm, for a double or for lanes.
#pragma once

#include "bumpstop/model/kinematics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// One-sided Jacobi method: rotates pairs of `Rows` rows until all are orthogonal. All lanes iterate until the last has
/// converged. `carried` further columns are rotated as well but do not count: a unit matrix there becomes the rotation.
template <int Rows, int Width, class T>
void make_rows_orthogonal(T (*row)[Width], int columns, int carried = 0) noexcept {
    constexpr int sweeps = 20;  // six rows need about eight
    const auto product = [&](int a, int b) {
        T sum = 0.0;
        for (int j = 0; j < columns; ++j) sum += row[a][j] * row[b][j];
        return sum;
    };
    T total = 0.0;
    for (int a = 0; a < Rows; ++a) total += product(a, a);
    const T rounding = total * 1e-32;  // squares below this count as zero
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        MaskOf<T> turned = mask_of<T>(false);
        for (int a = 0; a < Rows; ++a) {
            for (int b = a + 1; b < Rows; ++b) {
                const T aa = product(a, a), bb = product(b, b), ab = product(a, b);
                const MaskOf<T> oblique = (ab * ab > aa * bb * 1e-30) & (min(aa, bb) > rounding);
                turned = turned | oblique;
                // The smaller of the two angles that make them orthogonal.
                const T cotangent = (bb - aa) / select(oblique, 2.0 * ab, T(1.0));
                const T sign = select(cotangent < T(0.0), T(-1.0), T(1.0));
                const T tangent = sign / (abs(cotangent) + sqrt(cotangent * cotangent + 1.0));
                const T c = select(oblique, 1.0 / sqrt(tangent * tangent + 1.0), T(1.0));
                const T s = select(oblique, c * tangent, T(0.0));
                for (int j = 0; j < columns + carried; ++j) {
                    const T x = row[a][j], y = row[b][j];
                    row[a][j] = x * c - y * s;
                    row[b][j] = x * s + y * c;
                }
            }
        }
        if (!any(turned)) break;
    }
}

/// Singular values of a matrix of `Rows` rows, largest first: the lengths of its orthogonalised rows. `row` is
/// overwritten.
template <int Rows, class T>
void singular_values_of(T (*row)[max_joints], int columns, T* values) noexcept {
    make_rows_orthogonal<Rows>(row, columns);
    for (int a = 0; a < Rows; ++a) {
        T square = 0.0;
        for (int j = 0; j < columns; ++j) square += row[a][j] * row[a][j];
        values[a] = sqrt(square);
        for (int b = a; b > 0; --b) {
            const T high = max(values[b - 1], values[b]), low = min(values[b - 1], values[b]);
            values[b - 1] = high;
            values[b] = low;
        }
    }
    for (int a = columns; a < Rows; ++a) values[a] = 0.0;
}

/// Singular values of the Jacobian's columns of some joints at a point of a link, largest first: of the linear rows
/// with `Rows` 3 [m/rad], of all six with 6, where m/rad and 1 are mixed. Joints beyond the link are skipped.
template <int Rows, class T>
void singular_values(const Chain& chain, const Posture<T>& posture, const LinkPoint& point, const int* joints,
                     int count, T* values) noexcept {
    static_assert(Rows == 3 || Rows == 6);
    const Point3<T> p = posture.position(point);
    T row[Rows][max_joints];
    int columns = 0;
    for (int i = 0; i < count; ++i) {
        const int j = joints[i];
        if (j > point.link) continue;
        const Point3<T> linear = linear_column(chain, posture, p, j);
        row[0][columns] = linear.x;
        row[1][columns] = linear.y;
        row[2][columns] = linear.z;
        if constexpr (Rows == 6) {
            const T turns = chain.joint[j].turns;
            row[3][columns] = posture.axis[j].x * turns;
            row[4][columns] = posture.axis[j].y * turns;
            row[5][columns] = posture.axis[j].z * turns;
        }
        ++columns;
    }
    singular_values_of<Rows>(row, columns, values);
}

/// Singular values of the whole Jacobian.
template <int Rows, class T>
void singular_values(const Chain& chain, const Posture<T>& posture, const LinkPoint& point, T* values) noexcept {
    int joints[max_joints];
    for (int j = 0; j <= point.link; ++j) joints[j] = j;
    singular_values<Rows>(chain, posture, point, joints, point.link + 1, values);
}

/// Yoshikawa's measure, sqrt(det(J J')): the product of the singular values.
template <int Rows, class T>
T manipulability(const Chain& chain, const Posture<T>& posture, const LinkPoint& point) noexcept {
    T values[Rows];
    singular_values<Rows>(chain, posture, point, values);
    T product = values[0];
    for (int a = 1; a < Rows; ++a) product *= values[a];
    return product;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
