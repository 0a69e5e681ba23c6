// Least-norm problems whose solution is known because they were made from it, and what a solution must fulfil.
#pragma once

#include <limits>
#include <numeric>
#include <vector>

#include "bumpstop/model/min_norm.hpp"
#include "math/check.hpp"

namespace planted_min_norm {

using namespace bumpstop;
using Long = long double;
using Vector = std::vector<Long>;

constexpr double epsilon = std::numeric_limits<double>::epsilon();
// Backward errors of the solve, in roundings: each row is touched by every row before it, in sums as long as the
// row. The largest seen is a tenth of this.
inline double roundings(int rows, int columns) { return 2.0 * rows + columns; }

inline Long dot(const Vector& a, const Vector& b) { return std::inner_product(a.begin(), a.end(), b.begin(), Long(0)); }
inline Long norm(const Vector& a) { return std::sqrt(dot(a, a)); }
inline Vector random_vector(int n) {
    Vector v(static_cast<std::size_t>(n));
    for (Long& x : v) x = checks::normal();
    return v;
}

// An orthonormal basis of the rows, each made orthogonal twice. sine[c] is that of row c to those before it.
inline std::vector<Vector> orthonormal(std::vector<Vector> rows, Vector* sine = nullptr) {
    for (std::size_t c = 0; c < rows.size(); ++c) {
        const Long before = norm(rows[c]);
        for (int pass = 0; pass < 2; ++pass) {
            for (std::size_t d = 0; d < c; ++d) {
                const Long shared = dot(rows[d], rows[c]);
                for (std::size_t j = 0; j < rows[c].size(); ++j) rows[c][j] -= shared * rows[d][j];
            }
        }
        const Long after = norm(rows[c]);
        if (sine) sine->push_back(after / before);
        for (Long& x : rows[c]) x /= after;
    }
    return rows;
}
inline std::vector<Vector> random_basis(int count, int n) {
    std::vector<Vector> rows;
    for (int c = 0; c < count; ++c) rows.push_back(random_vector(n));
    return orthonormal(rows);
}

template <class T>
struct Problem {
    int columns = 0;
    T row[max_task_rows][max_columns], target[max_task_rows];
};
template <class T>
struct Solution {
    T x[max_columns];
    Conditioning<T> conditioning;
};

// Some sine is at most 1e-2.
template <class T>
MaskOf<T> near_singular(const Conditioning<T>& found) {
    return found.min_sine_squared <= T(1e-4);
}

template <int Rows, class T>
[[gnu::noinline]] Solution<T> solve(Problem<T> problem, double damping = 0) {
    Solution<T> solution;
    solution.conditioning = damped_min_norm<Rows>(problem.row, problem.columns, problem.target, damping, solution.x);
    return solution;
}

inline std::vector<Vector> rows_of(const Problem<double>& problem, int rows) {
    std::vector<Vector> result;
    for (int c = 0; c < rows; ++c) result.emplace_back(problem.row[c], problem.row[c] + problem.columns);
    return result;
}
inline Vector vector_of(const double* x, int n) { return Vector(x, x + n); }

// A problem whose rows have singular values from 1 down to 1 / condition, and its solution: a random one among
// the combinations of its rows.
struct Planted {
    Problem<double> problem;
    Vector x;
};
inline Planted plant(int rows, int columns, double condition) {
    Planted planted;
    Problem<double>& problem = planted.problem;
    problem.columns = columns;
    const std::vector<Vector> u = random_basis(rows, rows), v = random_basis(rows, columns);
    for (int c = 0; c < rows; ++c) {
        for (int j = 0; j < columns; ++j) {
            Long sum = 0;
            for (int k = 0; k < rows; ++k) sum += u[c][k] * std::pow(Long(condition), -Long(k) / (rows - 1)) * v[k][j];
            problem.row[c][j] = double(sum);
        }
    }
    // The rounded rows have their own span; it is what the solution must lie in.
    planted.x.assign(static_cast<std::size_t>(columns), 0);
    for (const Vector& direction : orthonormal(rows_of(problem, rows))) {
        const Long share = checks::normal();
        for (int j = 0; j < columns; ++j) planted.x[j] += share * direction[j];
    }
    const std::vector<Vector> row = rows_of(problem, rows);
    for (int c = 0; c < rows; ++c) problem.target[c] = double(dot(row[c], planted.x));
    return planted;
}

// |row . x - target| within some roundings of |row| |x|, whatever the condition.
inline void check_residual(const Problem<double>& problem, const double* x, int rows) {
    const Vector solution = vector_of(x, problem.columns);
    for (int c = 0; c < rows; ++c) {
        const Vector row = vector_of(problem.row[c], problem.columns);
        const Long bound = roundings(rows, problem.columns) * epsilon * norm(row) * norm(solution);
        CHECK_NEAR(dot(row, solution), problem.target[c], bound);
    }
}

// |x - exact| within condition times as many roundings of |exact|.
inline void check_solution(const double* x, const Vector& exact, int rows, double condition) {
    Vector error = vector_of(x, int(exact.size()));
    for (std::size_t j = 0; j < error.size(); ++j) error[j] -= exact[j];
    CHECK_NEAR(norm(error), 0, roundings(rows, int(exact.size())) * condition * epsilon * norm(exact));
}

}  // namespace planted_min_norm
