// Pseudo-inverse by singular value decomposition.
#pragma once

#include <algorithm>
#include <cmath>

#include "problem.hpp"

namespace reference {

struct Matrix {
    int rows = 0;
    int columns = 0;
    double at[kMaxJoints][kMaxJoints];  // [row][column]
};

// One-sided Jacobi: turn pairs of columns of W = A V against each other until all are orthogonal. Then the
// lengths of W's columns are the singular values, W = U S, and the pseudo-inverse is
//     V diag(g) U^T   with g = 1 / s (exact), 0 (dropped), or s / (s^2 + damping^2) (damped).
// The damped form equals A^T (A A^T + damping^2 I)^-1.
inline void pseudo_inverse(const Matrix& matrix, double relative_tolerance, double damping, Matrix& inverse) {
    const bool wide = matrix.rows < matrix.columns;  // work on the transpose: as few columns as possible
    const int rows = wide ? matrix.columns : matrix.rows;
    const int columns = wide ? matrix.rows : matrix.columns;

    double w[kMaxJoints][kMaxJoints];  // [column][row]
    double v[kMaxJoints][kMaxJoints];  // [column][row]
    for (int c = 0; c < columns; ++c) {
        for (int r = 0; r < rows; ++r) w[c][r] = wide ? matrix.at[c][r] : matrix.at[r][c];
        for (int r = 0; r < columns; ++r) v[c][r] = r == c ? 1 : 0;
    }

    constexpr int kMaxSweeps = 60;         // six or seven are usual
    constexpr double kOrthogonal = 1e-15;  // cosine between two columns that counts as a right angle
    bool turned = true;
    for (int sweep = 0; sweep < kMaxSweeps && turned; ++sweep) {
        turned = false;
        for (int p = 0; p + 1 < columns; ++p) {
            for (int q = p + 1; q < columns; ++q) {
                double pp = 0;
                double qq = 0;
                double pq = 0;
                for (int r = 0; r < rows; ++r) {
                    pp += w[p][r] * w[p][r];
                    qq += w[q][r] * w[q][r];
                    pq += w[p][r] * w[q][r];
                }
                if (!(std::fabs(pq) > kOrthogonal * std::sqrt(pp * qq))) continue;
                turned = true;
                const double zeta = (qq - pp) / (2 * pq);
                const double tangent = std::copysign(1.0, zeta) / (std::fabs(zeta) + std::hypot(1.0, zeta));
                const double cosine = 1 / std::sqrt(1 + tangent * tangent);
                const double sine = cosine * tangent;
                for (int r = 0; r < rows; ++r) {
                    const double old = w[p][r];
                    w[p][r] = cosine * old - sine * w[q][r];
                    w[q][r] = sine * old + cosine * w[q][r];
                }
                for (int r = 0; r < columns; ++r) {
                    const double old = v[p][r];
                    v[p][r] = cosine * old - sine * v[q][r];
                    v[q][r] = sine * old + cosine * v[q][r];
                }
            }
        }
    }

    double singular[kMaxJoints];
    double largest = 0;
    for (int c = 0; c < columns; ++c) {
        double sum = 0;
        for (int r = 0; r < rows; ++r) sum += w[c][r] * w[c][r];
        singular[c] = std::sqrt(sum);
        largest = std::max(largest, singular[c]);
    }

    inverse.rows = matrix.columns;
    inverse.columns = matrix.rows;
    for (int r = 0; r < inverse.rows; ++r) {
        for (int c = 0; c < inverse.columns; ++c) inverse.at[r][c] = 0;
    }
    for (int k = 0; k < columns; ++k) {
        const double s = singular[k];
        if (s == 0) continue;
        double gain = 0;
        if (damping > 0) {
            gain = s / (s * s + damping * damping);
        } else if (s > relative_tolerance * largest) {
            gain = 1 / s;
        }
        if (gain == 0) continue;
        for (int a = 0; a < columns; ++a) {
            for (int b = 0; b < rows; ++b) {
                const double term = v[k][a] * gain * (w[k][b] / s);
                (wide ? inverse.at[b][a] : inverse.at[a][b]) += term;
            }
        }
    }
}

}  // namespace reference
