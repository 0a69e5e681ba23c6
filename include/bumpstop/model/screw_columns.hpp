/// @file
/// Screws of an arm's joints, seen from the middle of the chain.
#pragma once

#include <algorithm>

#include "bumpstop/model/kinematics.hpp"
#include "bumpstop/model/min_norm.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The tool does not turn, so all its points have one velocity, and the rates x are those whose screws add up to a
/// translation with it: sum x (z, m) = (0, v), where z is a joint's axis and m = p x z its moment. This holds in any frame
/// and about any point. Seen from a link in the middle, about a point on its axis, the screws of two neighbouring joints
/// are constants; they take two rows away. What is left for six joints is four by four, and nothing is carried through
/// the whole chain: half the work of the Jacobian at the tip.
///
/// It serves chains of which six or seven joints may move, turning or sliding, with two neighbours among them that turn
/// about axes well apart. The screw of a joint that slides is a translation alone.
template <class T>
class ScrewColumns {
  public:
    static constexpr int most_others = 5;

    /// Of a screw, what is left once the two middle joints have taken away its rotation about y and z.
    struct Column {
        T row[4];  ///< rotation about x, then the translation [1, m]
        T y, z;    ///< rates of the joint after the middle and, but for the sign, of the middle one
    };

    /// `free_joint`: the `count` joints that may move, in the order of the chain. `tip`: of the tool. `travel`: by joint,
    /// how far from 0 one that slides can be [m]; those that turn need none.
    ScrewColumns(const Chain& chain, const int* free_joint, int count, const LinkPoint& tip, const double* travel)
        : chain_(chain), count_(count) {
        if (count != 6 && count != 7) return;
        for (int j = 0; j < chain.dof; ++j) {
            if (!chain.joint[j].prismatic) continue;
            if (!std::isfinite(travel[j])) return;
            slides_ = true;
        }
        for (int f = 0; f < count; ++f) {
            free_joint_[f] = free_joint[f];
            place_[free_joint[f]] = f;
        }
        last_ = free_joint[count - 1];
        int least = 0;
        for (int f = 1; f + 2 < count; ++f) {
            const int k = free_joint[f];
            const bool neighbours = free_joint[f + 1] == k + 1;
            if (!neighbours || std::fabs(chain.joint[k + 1].sin_alpha) < 0.5 || k > longest_side ||
                last_ - k - 1 > longest_side || chain.joint[k].prismatic || chain.joint[k + 1].prismatic)
                continue;
            // Turns on the way to the middle: those of the columns on either side, and those of the velocity.
            const int inner = k, outer = last_ - k - 1;
            const int work = inner * (inner - 1) + outer * outer + inner;
            if (least == 0 || work < least) {
                least = work;
                middle_ = k;
            }
        }
        if (!works()) return;
        int others = 0;
        for (int f = 0; f < count; ++f)
            if (const int j = free_joint[f]; j != middle_ && j != middle_ + 1) other_[others++] = j;
        set_links();
        set_least_determinant(tip, travel);
    }

    /// Whether it can do this chain at all.
    bool works() const { return middle_ >= 0; }
    /// The angles of this joint and of those after it are not needed.
    int angles_needed() const { return last_; }
    /// Six joints or seven may move.
    int count() const { return count_; }
    /// All of them but those in the middle.
    const std::array<int, most_others>& others() const { return other_; }
    /// From the joints to the tip, at most and in the quadratic mean [m].
    double reach() const { return reach_; }
    /// A row of the Jacobian at the tip may be within 1e-6 of those before it (see Conditioning) only where the determinant
    /// of four of the columns is below this [m3].
    double least_determinant() const { return least_determinant_; }

    /// By joint, all columns but those of the middle; returns the velocity in the middle frame. `velocity`: in the base frame
    /// [m/s]; `q`: joint positions, of which those of joints that slide are needed [m].
    Point3<T> find(const JointAngles<T>& angle, const T* q, const Point3<T>& velocity, Column* column) const {
        return slides_ ? find_columns<true>(angle, q, velocity, column)
                       : find_columns<false>(angle, q, velocity, column);
    }

    /// Rates of the two middle joints that go with those of the others.
    template <int Others>
    [[gnu::always_inline]] static void middle_rates(const Column* const (&column)[Others], const T* x, T& own,
                                                    T& next) {
        T y = column[0]->y * x[0], z = column[0]->z * x[0];
        BUMPSTOP_UNROLL
        for (int c = 1; c < Others; ++c) {
            y += column[c]->y * x[c];
            z += column[c]->z * x[c];
        }
        next = y;
        own = -z;
    }

    /// Writes rates by free joint: those of `joint`, and of the two in the middle.
    template <int Others>
    [[gnu::always_inline]] void write(const int* joint, const T* rate, const T& own, const T& next, T* x) const {
        x[place_[middle_]] = own;
        x[place_[middle_ + 1]] = next;
        for (int c = 0; c < Others; ++c) x[place_[joint[c]]] = rate[c];
    }

  private:
    static constexpr int longest_side = 4;

    /// A frame stands on the joint's axis and turns with the link: it is reached from that before by a shift in x and y,
    /// a turn about x, then a shift along and a turn about z. y is needed where axes are nearly parallel alone.
    struct Link {
        double x = 0, y = 0, z = 0;  ///< m
        double cos_alpha = 1, sin_alpha = 0;
    };
    struct Screw {
        Point3<T> z, m;
    };
    void set_links() {
        for (int j = 0; j <= last_; ++j) {
            const Chain::Joint& joint = chain_.joint[j];
            const Vector3& d = joint.displacement;
            Link& link = link_[j];
            link.cos_alpha = joint.cos_alpha;
            link.sin_alpha = joint.sin_alpha;
            link.x = d[0];
            if (j == 0) continue;  // where the base stands does not matter
            double along_before = d[2];
            if (std::fabs(joint.sin_alpha) < 0.1) {
                link.y = d[1];
            } else {
                link.z -= d[1] / joint.sin_alpha;
                along_before += d[1] * joint.cos_alpha / joint.sin_alpha;
            }
            link_[j - 1].z += along_before;
        }
        const Link& next = link_[middle_ + 1];
        inverse_sine_ = 1 / next.sin_alpha;
        next_y_ = -next.x * next.cos_alpha * inverse_sine_;
        next_z_ = -next.x;
    }

    /// |det J| of six columns is the product of the distances of each row from those before it, and each of these is at
    /// most as long as the row. Squares of rotations add up to one in a column, those of translations to no more than the
    /// square of how far the tip can be from the joint. The row that is near the others counts as long as three of its kind
    /// are in the quadratic mean, or longer: with two rows as long as may be beside it that makes 1.5 times the product of
    /// three alike.
    void set_least_determinant(const LinkPoint& tip, const double* travel) {
        const auto length = [](const Vector3& v) { return std::hypot(v[0], v[1], v[2]); };
        double squares = 0;
        for (int f = 0; f < count_; ++f) {
            double far = length(tip.offset);
            for (int j = free_joint_[f] + 1; j <= tip.link; ++j)
                far += length(chain_.joint[j].displacement) + (chain_.joint[j].prismatic ? travel[j] : 0.0);
            squares += chain_.joint[free_joint_[f]].prismatic ? 1.0 : far * far;
        }
        const double longest_rows = std::pow(count_ / 3.0 * squares / 3.0, 1.5);
        least_determinant_ = singular_sine * 1.5 * longest_rows * std::fabs(inverse_sine_);
        reach_ = std::sqrt(squares / count_);
    }

    [[gnu::always_inline]] static void turn_back_x(const Link& link, Point3<T>& v) {
        v = {v.x, v.y * link.cos_alpha + v.z * link.sin_alpha, v.z * link.cos_alpha - v.y * link.sin_alpha};
    }
    [[gnu::always_inline]] static void turn_back_z(const T& c, const T& s, Point3<T>& v) {
        v = {v.x * c + v.y * s, v.y * c - v.x * s, v.z};
    }
    /// m += (x, y, 0) x z, or -= with `sign` -1.
    [[gnu::always_inline]] static void shift(double sign, const Link& link, Screw& w) {
        w.m.y -= w.z.z * (sign * link.x);
        w.m.z += w.z.y * (sign * link.x);
        if (link.y != 0) {
            w.m.x += w.z.z * (sign * link.y);
            w.m.z -= w.z.x * (sign * link.y);
        }
    }

    [[gnu::always_inline]] void reduce(const Screw& w, Column& column) const {
        column.row[0] = w.z.x;
        column.row[1] = w.m.x;
        column.row[2] = w.m.y + w.z.y * next_y_;
        column.row[3] = w.m.z + w.z.y * next_z_;
        column.y = w.z.y * inverse_sine_;
        column.z = w.z.z + column.y * link_[middle_ + 1].cos_alpha;
    }

    /// How far a link's frame has been shifted along its axis [m].
    template <bool Slides>
    [[gnu::always_inline]] auto along(int j, const T* q) const {
        if constexpr (Slides) {
            return chain_.joint[j].prismatic ? q[j] + link_[j].z : T(link_[j].z);
        } else {
            return link_[j].z;
        }
    }
    template <bool Slides>
    [[gnu::always_inline]] bool is_slide(int j) const {
        return Slides && chain_.joint[j].prismatic;
    }

    /// All columns but those of the middle; returns the velocity in the middle frame.
    template <bool Slides>
    Point3<T> find_columns(const JointAngles<T>& angle, const T* q, const Point3<T>& velocity, Column* column) const {
        switch (last_ - middle_ - 1) {
            case 1:
                outer_columns<1, Slides>(angle, q, column);
                break;
            case 2:
                outer_columns<2, Slides>(angle, q, column);
                break;
            case 3:
                outer_columns<3, Slides>(angle, q, column);
                break;
            default:
                outer_columns<4, Slides>(angle, q, column);
        }
        switch (middle_) {
            case 1:
                return inner_columns<1, Slides>(angle, q, velocity, column);
            case 2:
                return inner_columns<2, Slides>(angle, q, velocity, column);
            case 3:
                return inner_columns<3, Slides>(angle, q, velocity, column);
            default:
                return inner_columns<4, Slides>(angle, q, velocity, column);
        }
    }
    template <int Count, bool Slides>
    Point3<T> inner_columns(const JointAngles<T>& angle, const T* q, const Point3<T>& velocity, Column* column) const {
        const double c0 = chain_.base_turn[0], s0 = chain_.base_turn[1];
        Point3<T> v{velocity.x * c0 + velocity.y * s0, velocity.y * c0 - velocity.x * s0, velocity.z};
        BUMPSTOP_UNROLL
        for (int j = 0; j <= Count; ++j) {
            turn_back_x(link_[j], v);
            turn_back_z(angle.cos[j], angle.sin[j], v);
        }
        BUMPSTOP_UNROLL
        for (int i = 0; i < Count; ++i) {
            const Link& first = link_[i + 1];
            const Point3<T> axis{T(0.0), T(first.sin_alpha), T(first.cos_alpha)};
            Screw w{axis,
                    {T(first.sin_alpha * along<Slides>(i + 1, q) - first.y), T(first.x * first.cos_alpha),
                     T(-first.x * first.sin_alpha)}};
            if (is_slide<Slides>(i)) w = {{T(0.0), T(0.0), T(0.0)}, axis};
            turn_back_z(angle.cos[i + 1], angle.sin[i + 1], w.z);
            turn_back_z(angle.cos[i + 1], angle.sin[i + 1], w.m);
            BUMPSTOP_UNROLL
            for (int j = i + 2; j <= Count; ++j) {
                const Link& link = link_[j];
                shift(-1, link, w);
                turn_back_x(link, w.z);
                turn_back_x(link, w.m);
                const auto z = along<Slides>(j, q);
                w.m.x += w.z.y * z;
                w.m.y -= w.z.x * z;
                turn_back_z(angle.cos[j], angle.sin[j], w.z);
                turn_back_z(angle.cos[j], angle.sin[j], w.m);
            }
            reduce(w, column[i]);
        }
        return v;
    }

    template <int Count, bool Slides>
    void outer_columns(const JointAngles<T>& angle, const T* q, Column* column) const {
        const Link* const next = &link_[middle_ + 1];
        const T *const cosine = &angle.cos[middle_ + 1], *const sine = &angle.sin[middle_ + 1];
        BUMPSTOP_UNROLL
        for (int i = 1; i <= Count; ++i) {
            const Link &own = next[i], &before = next[i - 1];
            const Point3<T> axis{T(0.0), T(-own.sin_alpha), T(own.cos_alpha)};
            Screw w{axis,
                    {T(own.y * own.cos_alpha + along<Slides>(middle_ + i, q) * own.sin_alpha),
                     T(-own.x * own.cos_alpha), T(-own.x * own.sin_alpha)}};
            if (is_slide<Slides>(middle_ + 1 + i)) w = {{T(0.0), T(0.0), T(0.0)}, axis};
            turn_z(cosine[i - 1], sine[i - 1], w.z);
            turn_z(cosine[i - 1], sine[i - 1], w.m);
            turn_x(before.cos_alpha, before.sin_alpha, w.z);
            turn_x(before.cos_alpha, before.sin_alpha, w.m);
            shift(1, before, w);
            BUMPSTOP_UNROLL
            for (int j = i - 2; j >= 0; --j) {
                const Link& link = next[j];
                turn_z(cosine[j], sine[j], w.z);
                turn_z(cosine[j], sine[j], w.m);
                const auto z = along<Slides>(middle_ + 1 + j, q);
                w.m.x -= w.z.y * z;
                w.m.y += w.z.x * z;
                turn_x(link.cos_alpha, link.sin_alpha, w.z);
                turn_x(link.cos_alpha, link.sin_alpha, w.m);
                shift(1, link, w);
            }
            reduce(w, column[middle_ + 1 + i]);
        }
    }

    const Chain& chain_;
    const int count_;
    std::array<int, max_joints> free_joint_{};
    std::array<int, max_joints> place_{};  ///< of a joint among the free ones
    std::array<int, most_others> other_{};
    bool slides_ = false;  ///< a joint of the chain does
    int middle_ = -1, last_ = 0;
    std::array<Link, max_joints> link_{};
    double next_y_ = 0, next_z_ = 0;  ///< moment of the joint after the middle by its rotation about y [m]
    double inverse_sine_ = 1;         ///< of the angle between the middle joint's axis and the next
    double reach_ = 1;
    double least_determinant_ = 0;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
