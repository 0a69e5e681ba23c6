/// @file
/// Contact isolation and identification: the links that may have been hit and the force, from the residual of an alarm.
#pragma once

#include <cstdint>

#include "bumpstop/model/singular_values.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Estimate of a contact from a residual. Residuals are minus the torques of the contact, so the forces are those of
/// the arm on the body: along +n where the arm pushes.
struct ContactEstimate {
    int link = -1;               ///< most likely link, from 0; -1: no joint is monitored
    std::uint32_t possible = 0;  ///< link i as bit i: a contact there could explain the residual
    double force_along = 0;      ///< least-squares force along the given direction [N]
    /// Standard deviation of force_along; infinite where the direction loads no joint with a usable residual [N].
    double force_along_sd = std::numeric_limits<double>::infinity();
    /// Least-squares force of minimum norm at the given point [N, base frame]; NaN where no joint with a usable residual
    /// feels a force there.
    Vector3 force{};
    /// Standard deviations of its components by the noise of the residual; they are zero along directions that load no
    /// joint, whatever acts there [N].
    Vector3 force_sd{};
    double leftover = 0;                      ///< largest |r_j - fit_j| / sd_j with that force, over monitored joints
    std::array<double, max_joints> misfit{};  ///< by link: sum ((r_j - fit_j) / sd_j)^2 of the best wrench there
};

namespace detail {

/// Minimum-norm least-squares solution x of row' x = right, and its standard deviation where each of `right` has one of
/// 1; NaN where all rows are zero. Behind its `columns` entries `row` has a unit matrix.
inline std::array<Vector3, 2> min_norm_solution(double (&row)[3][max_joints + 3], int columns,
                                                const double* right) noexcept {
    make_rows_orthogonal<3>(row, columns, 3);
    double square[3] = {}, share[3] = {};
    for (int e = 0; e < 3; ++e)
        for (int j = 0; j < columns; ++j) {
            square[e] += row[e][j] * row[e][j];
            share[e] += row[e][j] * right[j];
        }
    const double largest = std::max({square[0], square[1], square[2]});
    Vector3 x{}, sd{};
    if (!(largest > 0)) x.fill(std::numeric_limits<double>::quiet_NaN());
    for (int e = 0; e < 3; ++e)
        for (int k = 0; k < 3 && square[e] > 1e-9 * largest; ++k) {
            x[k] += share[e] / square[e] * row[e][columns + k];
            sd[k] = std::hypot(sd[k], row[e][columns + k] / std::sqrt(square[e]));
        }
    return {x, largest > 0 ? sd : x};
}

/// Subtracts from `right` its projection on the columns (modified Gram-Schmidt with pivoting); returns their rank.
inline int project_out(double (&column)[6][max_joints], int columns, int rows, double* right) noexcept {
    double first = 0;
    bool used[6] = {};
    for (int rank = 0;; ++rank) {
        int best = -1;
        double square = 0;
        for (int c = 0; c < columns; ++c) {
            if (used[c]) continue;
            double sum = 0;
            for (int r = 0; r < rows; ++r) sum += column[c][r] * column[c][r];
            if (sum > square) square = sum, best = c;
        }
        if (rank == 0) first = square;
        if (best < 0 || rank == rows || !(square > 1e-12 * first)) return rank;
        used[best] = true;
        const double inverse = 1 / square;
        const auto reduce = [&](double* x) {
            double share = 0;
            for (int r = 0; r < rows; ++r) share += column[best][r] * x[r];
            for (int r = 0; r < rows; ++r) x[r] -= share * inverse * column[best][r];
        };
        for (int c = 0; c < columns; ++c)
            if (!used[c]) reduce(column[c]);
        reduce(right);
    }
}

}  // namespace detail

/// Torque that friction can hide at a speed: all of the dead zone up to rest_speed, nothing from twice that on, linear
/// between them, as in ThresholdModel [Nm or N].
inline double hidden_torque(double dead_zone, double qd, double rest_speed) noexcept {
    return dead_zone * std::max(0.0, std::min(1.0, 2 - std::fabs(qd) / rest_speed));
}

/// Standard deviations for the estimate of a contact. A joint at rest shows only the part of the contact torque that
/// its friction does not hold. Where its residual is within the noise and friction can hide more than that, the joint
/// is not used: infinite. Otherwise the hidden torque adds to its standard deviation.
///
/// `sd`: noise of the residual, `hidden`: torque that friction may hide; both by joint.
inline std::array<double, max_joints> contact_noise(int joints, const double* residual, const double* sd,
                                                    const double* hidden) noexcept {
    std::array<double, max_joints> out{};
    bool any_used = false;
    for (int j = 0; j < joints; ++j) {
        const bool hides = hidden[j] > sd[j] && std::fabs(residual[j]) <= 3 * sd[j];
        out[j] = hides ? std::numeric_limits<double>::infinity() : std::hypot(sd[j], hidden[j]);
        any_used = any_used || std::isfinite(out[j]);
    }
    // Where friction may hide the torque of every joint, all are used.
    if (!any_used)
        for (int j = 0; j < joints; ++j) out[j] = std::hypot(sd[j], hidden[j]);
    return out;
}

/// Estimates link and force of a contact. `sd`: noise of the residual by joint, above 0; infinite: the joint is not
/// used. The force is estimated at `point`, and along the unit vector `direction` (base frame).
///
/// A contact on link i does not load the joints beyond it, so their residuals must be noise. The torques of the joints
/// up to i are those of a wrench, fitted by least squares. Link i is possible where every joint is fitted within three
/// sd. The most likely link has the smallest misfit plus twice the rank of its fit (Akaike 1974), because an outer link
/// can always explain more.
inline ContactEstimate estimate_contact(const Chain& chain, const Posture<double>& posture, const double* residual,
                                        const double* sd, const LinkPoint& point, const Vector3& direction) noexcept {
    ContactEstimate out;
    const int n = chain.dof;
    double weight[max_joints];
    for (int j = 0; j < n; ++j) weight[j] = 1 / sd[j];  // 0: not used

    const Point3<double> p = posture.position(point);
    const int columns = point.link + 1;
    double lever[3][max_joints + 3] = {}, right[max_joints];
    for (int k = 0; k < 3; ++k) lever[k][columns + k] = 1;
    double along = 0, along_square = 0;
    for (int j = 0; j < columns; ++j) {
        const Point3<double> column = linear_column(chain, posture, p, j);
        const double a[3] = {column.x, column.y, column.z};
        const double least = negligible_square(chain, posture, p, j);
        right[j] = residual[j] * weight[j];
        for (int k = 0; k < 3; ++k) lever[k][j] = dot(column, column) > least ? a[k] * weight[j] : 0;
        double share = a[0] * direction[0] + a[1] * direction[1] + a[2] * direction[2];
        share = share * share > least ? share * weight[j] : 0;
        along += share * right[j];
        along_square += share * share;
    }
    out.force_along = along_square > 0 ? along / along_square : 0;
    if (along_square > 0) out.force_along_sd = 1 / std::sqrt(along_square);
    const auto [force, force_sd] = detail::min_norm_solution(lever, columns, right);
    out.force = force;
    out.force_sd = force_sd;
    for (int j = 0; j < n; ++j) {
        double fit = 0;
        if (j <= point.link && std::isfinite(out.force[0])) {
            const Point3<double> column = linear_column(chain, posture, p, j);
            fit = column.x * out.force[0] + column.y * out.force[1] + column.z * out.force[2];
        }
        out.leftover = std::max(out.leftover, std::fabs(residual[j] - fit) * weight[j]);
    }

    double best = std::numeric_limits<double>::infinity();
    for (int link = 0; link < n; ++link) {
        double column[6][max_joints], left[max_joints];
        const Point3<double> origin = posture.frame_position[link];
        for (int j = 0; j < n; ++j) left[j] = residual[j] * weight[j];
        for (int j = 0; j <= link; ++j) {
            const Point3<double> c = linear_column(chain, posture, origin, j);
            const Point3<double>& z = posture.axis[j];
            const double turn = chain.joint[j].prismatic ? 0 : weight[j];
            const double row[6] = {c.x * weight[j], c.y * weight[j], c.z * weight[j],
                                   z.x * turn,      z.y * turn,      z.z * turn};
            for (int k = 0; k < 6; ++k) column[k][j] = row[k];
        }
        const int rank = detail::project_out(column, 6, link + 1, left);
        double worst = 0, misfit = 0;
        for (int j = 0; j < n; ++j) {
            worst = std::max(worst, std::fabs(left[j]));
            misfit += left[j] * left[j];
        }
        out.misfit[link] = misfit;
        if (worst <= 3) out.possible |= std::uint32_t(1) << link;
        if (rank > 0 && misfit + 2 * rank < best) {
            best = misfit + 2 * rank;
            out.link = link;
        }
    }
    return out;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
