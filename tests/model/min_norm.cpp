// The least-norm solve against solutions that are known because the problem was made from them.
#include "bumpstop/model/min_norm.hpp"

#include <algorithm>
#include <vector>

#include "math/check.hpp"
#include "model/planted_min_norm.hpp"

namespace {

using namespace planted_min_norm;

template <int Rows>
void planted_solutions() {
    for (int columns = Rows; columns <= 12; ++columns) {
        for (const double condition : {1.0, 10.0, 1e3, 1e5, 1e8, 1e10}) {
            for (int trial = 0; trial < 20; ++trial) {
                const Planted planted = plant(Rows, columns, condition);
                const Solution<double> solution = solve<Rows>(planted.problem);
                check_residual(planted.problem, solution.x, Rows);
                check_solution(solution.x, planted.x, Rows, condition);
                // A sine is at least the smallest singular value over the length of its row, at most 1.
                CHECK(!solution.conditioning.singular || condition > 1e5);
                CHECK(!near_singular(solution.conditioning) || condition > 10);
            }
        }
    }
}

void exact_arithmetic() {
    // Rows of ones and minus ones at right angles: every step is exact.
    Problem<double> problem{4, {{1, 1, 1, 1}, {1, -1, 1, -1}, {1, 1, -1, -1}}, {4, -8, 12}};
    const Solution<double> solution = solve<3>(problem);
    const double exact[] = {2, 6, -4, 0};
    for (int j = 0; j < 4; ++j) CHECK(solution.x[j] == exact[j]);
    CHECK(!solution.conditioning.singular && !near_singular(solution.conditioning));
    // A turned-about unit matrix, whose diagonal offers no pivot at all.
    Problem<double> turned{6, {}, {1, 2, 3, 4, 5, 6}};
    for (int c = 0; c < 6; ++c)
        for (int j = 0; j < 6; ++j) turned.row[c][j] = j == (c + 1) % 6;
    const Solution<double> shifted = solve<6>(turned);
    for (int c = 0; c < 6; ++c) CHECK(shifted.x[(c + 1) % 6] == c + 1);
    // Nothing wanted, nothing moves.
    Planted still = plant(6, 7, 10);
    for (double& target : still.problem.target) target = 0;
    const Solution<double> rest = solve<6>(still.problem);
    for (int j = 0; j < 7; ++j) CHECK(rest.x[j] == 0);
}

void every_order_of_the_rows() {
    for (const double condition : {100.0, 1e8}) {
        const Planted planted = plant(6, 6, condition);
        std::array<int, 6> order{0, 1, 2, 3, 4, 5};
        int orders = 0;
        do {
            Problem<double> shuffled = planted.problem;
            for (int c = 0; c < 6; ++c) {
                std::copy_n(planted.problem.row[order[c]], 6, shuffled.row[c]);
                shuffled.target[c] = planted.problem.target[order[c]];
            }
            const Solution<double> solution = solve<6>(shuffled);
            check_residual(shuffled, solution.x, 6);
            check_solution(solution.x, planted.x, 6, condition);
            ++orders;
        } while (std::next_permutation(order.begin(), order.end()));
        CHECK(orders == 720);
    }
}

template <int Rows>
void units_of_the_rows() {
    for (int columns = Rows; columns <= 8; ++columns) {
        const Planted planted = plant(Rows, columns, 100);
        const Solution<double> plain = solve<Rows>(planted.problem);
        // Powers of two change no rounding anywhere.
        Problem<double> scaled = planted.problem;
        for (int c = 0; c < Rows; ++c) {
            const int power = int(checks::uniform(-100, 100));
            for (int j = 0; j < columns; ++j) scaled.row[c][j] = std::ldexp(scaled.row[c][j], power);
            scaled.target[c] = std::ldexp(scaled.target[c], power);
        }
        const Solution<double> same = solve<Rows>(scaled);
        for (int j = 0; j < columns; ++j) CHECK(same.x[j] == plain.x[j]);
        CHECK(!same.conditioning.singular);
        // Other factors round the rows and targets, each entry once.
        for (int c = 0; c < Rows; ++c) {
            const double factor = std::pow(10, checks::uniform(-12, 12));
            for (int j = 0; j < columns; ++j) scaled.row[c][j] = planted.problem.row[c][j] * factor;
            scaled.target[c] = planted.problem.target[c] * factor;
        }
        const Solution<double> near = solve<Rows>(scaled);
        check_residual(scaled, near.x, Rows);
        // Row equilibration is within a factor of the root of the number of rows of the best scaling.
        check_solution(near.x, planted.x, Rows, 3 * 100);
    }
}

// R' (R R' + damping^2 I)^-1 target by elimination with pivots in long double, and then damping times the
// multipliers.
template <int Rows>
Vector damped_reference(const Problem<double>& problem, double damping) {
    const std::vector<Vector> row = rows_of(problem, Rows);
    Long matrix[Rows][Rows + 1];
    for (int c = 0; c < Rows; ++c) {
        for (int d = 0; d < Rows; ++d) matrix[c][d] = dot(row[c], row[d]) + (c == d ? Long(damping) * damping : 0);
        matrix[c][Rows] = problem.target[c];
    }
    for (int k = 0; k < Rows; ++k) {
        int pivot = k;
        for (int c = k; c < Rows; ++c)
            if (std::fabs(matrix[c][k]) > std::fabs(matrix[pivot][k])) pivot = c;
        std::swap(matrix[k], matrix[pivot]);
        for (int c = 0; c < Rows; ++c) {
            if (c == k) continue;
            const Long factor = matrix[c][k] / matrix[k][k];
            for (int d = k; d <= Rows; ++d) matrix[c][d] -= factor * matrix[k][d];
        }
    }
    Vector x(static_cast<std::size_t>(problem.columns + Rows), 0);
    for (int c = 0; c < Rows; ++c) {
        const Long multiplier = matrix[c][Rows] / matrix[c][c];
        for (int j = 0; j < problem.columns; ++j) x[std::size_t(j)] += multiplier * row[c][j];
        x[std::size_t(problem.columns + c)] = damping * multiplier;
    }
    return x;
}

template <int Rows>
void damped() {
    for (int columns = 1; columns <= 12; ++columns) {
        for (const double damping : {0.01, 0.1, 1.0}) {
            for (int trial = 0; trial < 10; ++trial) {
                Problem<double> problem{columns, {}, {}};
                for (int c = 0; c < Rows; ++c) {
                    for (int j = 0; j < columns; ++j) problem.row[c][j] = checks::uniform(-1, 1);
                    problem.target[c] = checks::normal();
                }
                // Dependent rows and contradictory targets are what damping is for.
                if (trial % 2 == 0) std::copy_n(problem.row[0], columns, problem.row[Rows - 1]);
                const Solution<double> solution = solve<Rows>(problem, damping);
                // Singular values lie between the damping and the root of |R|^2 + damping^2.
                const double condition = std::sqrt(Rows * columns + damping * damping) / damping;
                check_solution(solution.x, damped_reference<Rows>(problem, damping), Rows, condition);
                CHECK(!solution.conditioning.singular);
            }
        }
    }
    // Without damping, and with next to none, the same.
    const Planted planted = plant(Rows, 8, 10);
    const Solution<double> exact = solve<Rows>(planted.problem), nearly = solve<Rows>(planted.problem, 1e-9);
    for (int j = 0; j < 8; ++j) CHECK_NEAR(exact.x[j], nearly.x[j], 1e-13);
}

void signs_of_bad_conditioning() {
    // Two rows at an angle of known sine, a third at right angles to both.
    auto two_rows = [](double sine, double scale) {
        Problem<double> problem{4, {}, {0.3, -0.2, 0.1}};
        problem.row[0][0] = 1;
        problem.row[1][0] = scale * std::sqrt(1 - sine * sine);
        problem.row[1][1] = scale * sine;
        problem.row[2][2] = 1;
        return problem;
    };
    for (const double scale : {1.0, 1e-6, 1e6}) {
        CHECK(solve<3>(two_rows(0.99e-6, scale)).conditioning.singular);
        CHECK(near_singular(solve<3>(two_rows(0.99e-6, scale)).conditioning));
        CHECK(!solve<3>(two_rows(1.01e-6, scale)).conditioning.singular);
        CHECK(near_singular(solve<3>(two_rows(0.99e-2, scale)).conditioning));
        CHECK(!solve<3>(two_rows(0.99e-2, scale)).conditioning.singular);
        CHECK(!near_singular(solve<3>(two_rows(1.01e-2, scale)).conditioning));
        for (const double sine : {0.7, 1.01e-2, 1e-4, 1.01e-6}) {
            // The sine is a difference of rows of length one, of which rounding leaves that much.
            const double found = std::sqrt(solve<3>(two_rows(sine, scale)).conditioning.min_sine_squared);
            CHECK_NEAR(found, sine, 1e-15 / sine);
        }
        CHECK(solve<3>(two_rows(0.99e-6, scale)).conditioning.min_sine_squared == 0);
    }
    // Lanes have flags of their own.
    const double sines[] = {1, 0.99e-6, 0.99e-2, 1.01e-2};
    Problem<Lanes<4>> lanes;
    lanes.columns = 4;
    for (int lane = 0; lane < 4; ++lane) {
        const Problem<double> one = two_rows(sines[lane], 1);
        for (int c = 0; c < 3; ++c) {
            for (int j = 0; j < 4; ++j) set_lane(lanes.row[c][j], lane, one.row[c][j]);
            set_lane(lanes.target[c], lane, one.target[c]);
        }
    }
    const Conditioning<Lanes<4>> flags = solve<3>(lanes).conditioning;
    for (int lane = 0; lane < 4; ++lane) {
        CHECK(flags.singular[lane] == (lane == 1));
        CHECK(near_singular(flags)[lane] == (lane == 1 || lane == 2));
        CHECK_NEAR(std::sqrt(lane_of(flags.min_sine_squared, lane)), lane == 1 ? 0 : sines[lane], 1e-13);
    }
    // Rows that count as long: the sine of one that is short beside that is its length over it, and one that vanishes but
    // for rounding is flagged, whatever direction rounding gave it. The rates are the same.
    for (const double length : {1.0, 1e-3, 1.01e-6, 0.99e-6, 1e-17, 0.0}) {
        Problem<double> problem = two_rows(1, 1);
        for (int j = 0; j < 4; ++j) problem.row[1][j] = length * (j == 1 ? 0.6 : j == 3 ? 0.8 : 0.0);
        const Solution<double> plain = solve<3>(problem);
        Problem<double> work = problem;
        const double min_length[] = {1, 1, 1};
        double x[max_columns];
        const Conditioning<double> scaled = damped_min_norm<3>(work.row, 4, work.target, 0.0, x, min_length);
        CHECK(scaled.singular == (length < 1e-6) && near_singular(scaled) == (length < 1e-2));
        CHECK(plain.conditioning.singular == (length == 0));
        CHECK_NEAR(std::sqrt(scaled.min_sine_squared), length < 1e-6 ? 0 : length, 1e-15);
        for (int j = 0; j < 4; ++j) CHECK(x[j] == plain.x[j]);
    }
    // Rows that vanish or repeat, and fewer columns than rows: flagged, and the rates stay finite.
    for (const int kind : {0, 1, 2}) {
        Problem<double> problem = plant(6, 7, 10).problem;
        for (int j = 0; j < 7; ++j) {
            if (kind == 0) problem.row[3][j] = 0;
            if (kind == 1) problem.row[5][j] = problem.row[2][j];
        }
        if (kind == 2) problem.columns = 5;
        const Solution<double> solution = solve<6>(problem);
        CHECK(solution.conditioning.singular && near_singular(solution.conditioning));
        CHECK(solution.conditioning.min_sine_squared == 0);
        for (int j = 0; j < problem.columns; ++j) CHECK(std::isfinite(solution.x[j]));
    }
}

void flags_follow_the_sines() {
    int singular = 0, near = 0;
    for (int trial = 0; trial < 2000; ++trial) {
        // Every row leans on those before it, at a sine from 1 to 1e-8, and has a length of its own.
        const int columns = 6 + trial % 3;
        const std::vector<Vector> basis = random_basis(6, columns);
        Problem<double> problem{columns, {}, {}};
        for (int c = 0; c < 6; ++c) {
            const Long sine = std::pow(10.0L, trial % 4 == 0 ? checks::uniform(-8, 0) : checks::uniform(-3, 0));
            const Vector share = random_vector(c);
            const Long length = std::pow(10.0L, checks::uniform(-3, 3));
            for (int j = 0; j < columns; ++j) {
                Long lean = 0;
                for (int d = 0; d < c; ++d) lean += share[d] / norm(share) * basis[d][j];
                const Long entry = c == 0 ? basis[c][j] : sine * basis[c][j] + std::sqrt(1 - sine * sine) * lean;
                problem.row[c][j] = double(length * entry);
            }
        }
        Vector sines;
        orthonormal(rows_of(problem, 6), &sines);
        const Conditioning<double> flags = solve<6>(problem).conditioning;
        CHECK(!flags.singular || near_singular(flags));
        // Rows that are nearly dependent lose digits of the directions of those that follow.
        auto below = [&](Long threshold) {
            bool surely = false, perhaps = false;
            Long before = 1;
            for (const Long sine : sines) {
                const Long doubt = 0.01L * threshold + 100 * epsilon / before;
                surely |= sine < threshold - doubt;
                perhaps |= sine < threshold + doubt;
                before *= sine;
            }
            return std::pair(surely, perhaps);
        };
        CHECK(flags.singular ? below(1e-6L).second : !below(1e-6L).first);
        CHECK(near_singular(flags) ? below(1e-2L).second : !below(1e-2L).first);
        singular += flags.singular;
        near += near_singular(flags);
    }
    CHECK(singular > 100 && near - singular > 100 && near < 1900);
}

template <int Rows, int N>
void lanes() {
    const double condition = 1e3;
    for (int columns = Rows; columns <= 9; ++columns) {
        Planted planted[N];
        Problem<Lanes<N>> problem;
        problem.columns = columns;
        for (int lane = 0; lane < N; ++lane) {
            planted[lane] = plant(Rows, columns, condition);
            for (int c = 0; c < Rows; ++c) {
                for (int j = 0; j < columns; ++j) set_lane(problem.row[c][j], lane, planted[lane].problem.row[c][j]);
                set_lane(problem.target[c], lane, planted[lane].problem.target[c]);
            }
        }
        const Solution<Lanes<N>> solution = solve<Rows>(problem);
        for (int lane = 0; lane < N; ++lane) {
            double x[max_columns];
            for (int j = 0; j < columns; ++j) x[j] = solution.x[j][lane];
            check_residual(planted[lane].problem, x, Rows);
            check_solution(x, planted[lane].x, Rows, condition);
        }
    }
}

}  // namespace

int main() {
    exact_arithmetic();
    planted_solutions<3>();
    planted_solutions<6>();
    every_order_of_the_rows();
    units_of_the_rows<3>();
    units_of_the_rows<6>();
    damped<3>();
    damped<6>();
    signs_of_bad_conditioning();
    flags_follow_the_sines();
    lanes<3, 2>();
    lanes<6, 4>();
    lanes<6, 8>();
    return checks::result();
}
