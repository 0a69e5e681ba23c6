/// @file
/// Self-collision of an arm whose links are capsules between its joints, for a double or for lanes.
#pragma once

#include "bumpstop/model/kinematics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// Squared distance of a point from the segment from `begin` to `begin` + `along`, which is not degenerate.
template <class T>
T point_to_segment(const Point3<T>& point, const Point3<T>& begin, const Point3<T>& along) {
    const Point3<T> w = point - begin;
    const T share = min(max(dot(w, along) / dot(along, along), T(0.0)), T(1.0));
    const Point3<T> apart = w - share * along;
    return dot(apart, apart);
}

}  // namespace detail

/// Shortest distance between two segments of positive length. Either the nearest points of their lines lie within both
/// segments, or one of the nearest points is an end of a segment.
template <class T>
T segment_distance(const Point3<T>& p, const Point3<T>& p_end, const Point3<T>& r, const Point3<T>& r_end) {
    const Point3<T> u = p_end - p, v = r_end - r, w = p - r;
    T least = min(min(detail::point_to_segment(p, r, v), detail::point_to_segment(p_end, r, v)),
                  min(detail::point_to_segment(r, p, u), detail::point_to_segment(r_end, p, u)));
    const T uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), uw = dot(u, w), vw = dot(v, w);
    const T determinant = uu * vv - uv * uv;
    const MaskOf<T> crossing = determinant > 1e-12 * uu * vv;
    const T inverse = 1.0 / select(crossing, determinant, T(1.0));
    const T s = (uv * vw - vv * uw) * inverse, t = (uu * vw - uv * uw) * inverse;
    const MaskOf<T> in_first = abs(s - 0.5) <= T(0.5), in_second = abs(t - 0.5) <= T(0.5);
    const Point3<T> apart = w + s * u - t * v;
    least = select(crossing & in_first & in_second, min(least, dot(apart, apart)), least);
    return sqrt(least);
}

/// Shorter distances between joints do not count as links [m].
inline constexpr double min_link_length = 1e-6;

/// Where two links touch at a posture, all as capsules of one radius. Links connect the base's origin, the joints in
/// order and `tip`. Links with less than two radii of arm length between them are neighbours and do not count.
template <class T>
MaskOf<T> self_collision(const Chain& chain, const Posture<T>& posture, const LinkPoint& tip, double radius) {
    Point3<T> place[max_joints + 2];
    place[0] = {T(0.0), T(0.0), T(0.0)};
    for (int j = 0; j < chain.dof; ++j) place[j + 1] = posture.position(link_point(chain, j, {0, 0, 0}));
    place[chain.dof + 1] = posture.position(tip);
    const int links = chain.dof + 1;
    T length[max_joints + 1];
    for (int i = 0; i < links; ++i) {
        const Point3<T> along = place[i + 1] - place[i];
        length[i] = sqrt(dot(along, along));
    }
    const T apart(2 * radius), shortest(min_link_length);
    MaskOf<T> hit = mask_of<T>(false);
    for (int i = 0; i < links; ++i) {
        T arm = 0.0;  // between the two links
        for (int j = i + 1; j < links; ++j) {
            const MaskOf<T> distant = arm >= apart, first = length[i] > shortest, second = length[j] > shortest;
            const MaskOf<T> counts = distant & first & second;
            if (any(counts)) {
                const MaskOf<T> near = segment_distance(place[i], place[i + 1], place[j], place[j + 1]) < apart;
                hit = hit | (counts & near);
            }
            arm += length[j];
        }
    }
    return hit;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
