/// @file
/// Forces that no threshold detects at a pose, and a monitor that warns of poses where they are large.
#pragma once

#include <algorithm>
#include <limits>

#include "bumpstop/model/singular_values.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Undetected residuals of one joint: from `low` to `high` [Nm or N], low < 0 < high, infinite for a joint without a
/// threshold. A force f that the arm exerts adds (J_v' f)_j to the residual, so low = -(threshold + z sd) - mean and
/// high = threshold + z sd - mean.
struct ResidualBand {
    double low = -std::numeric_limits<double>::infinity();
    double high = std::numeric_limits<double>::infinity();
    bool monitored() const noexcept { return high < std::numeric_limits<double>::infinity(); }
};

/// The forces { f : low_j <= (J_v' f)_j <= high_j for every j } at a pose.
struct UndetectableForce {
    /// Magnitude of the largest one [N]; infinite where some direction is undetectable; NaN where J_v is not finite.
    double largest = std::numeric_limits<double>::infinity();
    double largest_detectable = 0;  ///< the same among forces without a component in the null space [N]
    Vector3 largest_vector{};       ///< that force, B [N]
    Vector3 singular{};             ///< singular values of the monitored columns of J_v, largest first [m or 1]
    int rank = 0;                   ///< number of detectable directions, 0 to 3
    /// Orthogonal unit vectors, B. The first `rank` are detectable, best first; the others span the null space.
    Vector3 axis[3]{};
};

/// Singular values below this share of the largest count as zero: rounding errors of levers are about 1e-15.
inline constexpr double rank_tolerance = 1e-12;

namespace detail {

/// The polytope in coordinates in which the normals of the faces are the columns of a matrix with orthonormal rows:
/// this keeps the faces well-conditioned near a singular pose. For each coordinate that no joint detects, a face
/// through the origin fixes it at zero.
struct ForcePolytope {
    int faces = 0;
    Point3<double> normal[max_joints + 3];
    double low[max_joints + 3], high[max_joints + 3], length[max_joints + 3];
    Point3<double> scale{0, 0, 0};  ///< newtons per unit of each coordinate
    double best = -1;               ///< square of the largest force so far [N2]
    Point3<double> at{0, 0, 0};     ///< its coordinates

    void add(const Point3<double>& face, double from, double to) noexcept {
        normal[faces] = face;
        length[faces] = std::sqrt(dot(face, face));
        low[faces] = from;
        high[faces++] = to;
    }

    /// Compares both ends of an edge with the best vertex so far. The edge is the part of the line foot + t along
    /// within all faces; `along` is a unit vector, `foot` the point of the line nearest to the origin, and the line
    /// lies in faces `i` and `j`. Every vertex is the end of an edge, and the convex |f|^2 has its maximum at a vertex.
    /// Where three faces share a line, rounding could make the edge empty, so all bounds are 1e-12 wider.
    void try_edge(const Point3<double>& foot, const Point3<double>& along, int i, int j) noexcept {
        constexpr double slack = 1e-12;
        double begin = -std::numeric_limits<double>::infinity(), end = -begin;
        const double reach = std::sqrt(dot(foot, foot));
        for (int f = 0; f < faces; ++f) {
            if (f == i || f == j) continue;
            const double slope = dot(normal[f], along), value = dot(normal[f], foot);
            const double rounding = 4e-16 * length[f] * reach;
            const double lower = low[f] * (1 + slack) - rounding - value;
            const double upper = high[f] * (1 + slack) + rounding - value;
            if (slope == 0) {
                if (lower > 0 || upper < 0) return;
                continue;
            }
            const double inverse = 1 / slope;
            begin = std::max(begin, (slope > 0 ? lower : upper) * inverse);
            end = std::min(end, (slope > 0 ? upper : lower) * inverse);
            if (begin > end) return;
        }
        for (const double t : {begin, end}) {
            if (!(std::fabs(t) < std::numeric_limits<double>::infinity())) continue;
            const Point3<double> x = foot + t * along;
            const Point3<double> force{x.x * scale.x, x.y * scale.y, x.z * scale.z};
            const double square = dot(force, force);
            if (!(square > best)) continue;
            best = square;
            at = x;
        }
    }

    void search() noexcept {
        for (int i = 0; i < faces; ++i)
            for (int j = i + 1; j < faces; ++j) search_pair(i, j);
    }

    void search_pair(int i, int j) noexcept {
        const Point3<double>&a = normal[i], &b = normal[j];
        const Point3<double> d = cross(a, b);
        const double square = dot(d, d);
        // Parallel faces share no line; their vertices are ends of other edges.
        if (!(square > 1e-24 * dot(a, a) * dot(b, b))) return;
        const Point3<double> u = cross(b, d), v = cross(d, a);
        const double inverse = 1 / square;
        for (const double p : {low[i], high[i]})
            for (const double q : {low[j], high[j]})
                try_edge((p * inverse) * u + (q * inverse) * v, (1 / std::sqrt(square)) * d, i, j);
    }
};

}  // namespace detail

/// Largest force that no threshold detects, over all directions, from the columns of J_v at the point it acts on.
///
/// Exact up to rounding: the farthest point of a convex polytope is a vertex, and every vertex is the end of an edge,
/// where the faces of two joints meet. With n joints there are 2 n (n - 1) lines to clip. Poses are not computed in
/// lanes, because they differ in rank and in the faces that meet.
///
/// @param column of each joint, B [m or 1].
inline UndetectableForce undetectable_force(const Point3<double>* column, const ResidualBand* band,
                                            int joints) noexcept {
    UndetectableForce out;
    double row[3][max_joints + 3] = {};
    int joint[max_joints], n = 0;
    bool finite = true;
    for (int j = 0; j < joints; ++j) {
        if (!band[j].monitored()) continue;
        const double sum = column[j].x + column[j].y + column[j].z;
        finite = finite && std::fabs(sum) < std::numeric_limits<double>::infinity();
        row[0][n] = column[j].x;
        row[1][n] = column[j].y;
        row[2][n] = column[j].z;
        joint[n++] = j;
    }
    if (!finite) {
        out.largest = out.largest_detectable = std::numeric_limits<double>::quiet_NaN();
        return out;
    }
    for (int k = 0; k < 3; ++k) row[k][n + k] = 1;
    make_rows_orthogonal<3>(row, n, 3);
    double length[3], scale[3] = {};
    int order[3] = {0, 1, 2};
    for (int k = 0; k < 3; ++k) {
        double square = 0;
        for (int f = 0; f < n; ++f) square += row[k][f] * row[k][f];
        length[k] = std::sqrt(square);
    }
    std::sort(order, order + 3, [&](int a, int b) { return length[a] > length[b]; });
    for (int k = 0; k < 3; ++k) {
        const double* turned = row[order[k]] + n;
        out.singular[k] = length[order[k]];
        out.axis[k] = {turned[0], turned[1], turned[2]};
        if (out.singular[k] > 0 && out.singular[k] > rank_tolerance * out.singular[0]) {
            scale[k] = 1 / out.singular[k];
            out.rank = k + 1;
        }
    }
    if (out.rank == 0) return out;
    detail::ForcePolytope polytope;
    polytope.scale = point3<double>({scale[0], scale[1], scale[2]});
    for (int f = 0; f < n; ++f) {
        const double share[3] = {row[order[0]][f] * scale[0], row[order[1]][f] * scale[1], row[order[2]][f] * scale[2]};
        if (share[0] == 0 && share[1] == 0 && share[2] == 0) continue;  // a joint that no force here loads
        polytope.add({share[0], share[1], share[2]}, band[joint[f]].low, band[joint[f]].high);
    }
    for (int k = out.rank; k < 3; ++k) polytope.add({0.0, k == 1 ? 1.0 : 0.0, k == 2 ? 1.0 : 0.0}, 0, 0);
    polytope.search();
    out.largest_detectable = std::sqrt(std::max(0.0, polytope.best));
    if (out.rank == 3) out.largest = out.largest_detectable;
    const double force[3] = {polytope.at.x * scale[0], polytope.at.y * scale[1], polytope.at.z * scale[2]};
    for (int k = 0; k < 3; ++k)
        for (int c = 0; c < 3; ++c) out.largest_vector[c] += force[k] * out.axis[k][c];
    return out;
}

/// Largest force F >= 0 along the unit vector n that no threshold detects: the smallest of high_j / (J_v' n)_j, or of
/// low_j / (J_v' n)_j where the lever is negative [N]; infinite where it loads no monitored joint. Levers below 1e-12
/// of the longest count as zero.
inline double undetectable_force_along(const Point3<double>* column, const ResidualBand* band, int joints,
                                       const Point3<double>& n) noexcept {
    double force = std::numeric_limits<double>::infinity(), longest = 0;
    for (int j = 0; j < joints; ++j)
        if (band[j].monitored()) longest = std::max(longest, dot(column[j], column[j]));
    const double none = rank_tolerance * std::sqrt(longest);
    for (int j = 0; j < joints; ++j) {
        if (!band[j].monitored()) continue;
        const double torque = dot(column[j], n);
        if (torque != torque) return torque;  // NaN
        if (std::fabs(torque) > none) force = std::min(force, (torque < 0 ? band[j].low : band[j].high) / torque);
    }
    return force;
}

/// Result of a UndetectablePoseMonitor for a pose.
struct PoseWarning {
    double force =
        0;  ///< largest undetectable force [N]; infinite where a direction is undetectable; NaN where the pose is not finite
    bool warning = false;  ///< the force exceeds the limit
    bool entered = false;  ///< the warning begins with this pose
};

/// Warns, in a control loop, when the arm enters a pose where forces above a limit at a point are undetectable. Nothing
/// is allocated. A warning ends when the force is 5 % below the limit, so that it does not toggle. Joint positions that
/// are not finite give a warning.
class UndetectablePoseMonitor {
  public:
    UndetectablePoseMonitor(const Chain& chain, const LinkPoint& point, std::span<const ResidualBand> band,
                            double limit) noexcept
        : chain_(chain), point_(point), limit_(limit) {
        std::copy_n(band.begin(), std::min(band.size(), band_.size()), band_.begin());
    }

    /// @param q joint positions [rad or m], as many as the chain has joints.
    PoseWarning update(const double* q) noexcept {
        JointAngles<double> angle;
        angle.set(chain_, q);
        Posture<double> posture;
        forward_kinematics(chain_, q, angle, posture);
        const Point3<double> p = posture.position(point_);
        Point3<double> column[max_joints];
        for (int j = 0; j <= point_.link; ++j) column[j] = linear_column(chain_, posture, p, j);
        const double force = undetectable_force(column, band_.data(), point_.link + 1).largest;
        const bool before = warning_;
        warning_ = !(force <= (before ? 0.95 * limit_ : limit_));
        return {force, warning_, warning_ && !before};
    }

  private:
    Chain chain_;
    LinkPoint point_;
    std::array<ResidualBand, max_joints> band_{};
    double limit_;
    bool warning_ = false;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
