/// @file
/// Joint rates that move an arm along a line without turning its tool, worked out in the middle of the chain.
#pragma once

#include <algorithm>

#include "bumpstop/model/kinematics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The tool does not turn, so all its points have one velocity, and the rates x are those whose screws add up to a
/// translation with it: sum x (z, m) = (0, v), where z is a joint's axis and m = p x z its moment. This holds in any frame
/// and about any point. Seen from a link in the middle, about a point on its axis, the screws of two neighbouring joints
/// are constants; they take two rows away. What is left for six joints is four by four, and nothing is carried through
/// the whole chain: half the work of the Jacobian at the tip.
///
/// It serves chains of which six or seven joints may move, turning or sliding, with two neighbours among them that turn
/// about axes well apart. The screw of a joint that slides is a translation alone. All lanes eliminate the columns in the same order,
/// which is changed when it does not serve them; there is none for lanes near singularities, where `min_norm` is right.
template <class T>
class ScrewRates {
  public:
    /// `free_joint`: the `count` joints that may move, in the order of the chain. `tip`: of the tool. `travel`: by joint,
    /// how far from 0 one that slides can be [m]; those that turn need none.
    ScrewRates(const Chain& chain, const int* free_joint, int count, const LinkPoint& tip, const double* travel)
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
            if (const int j = free_joint[f]; j != middle_ && j != middle_ + 1) order_[others++] = j;
        set_links();
        set_least_determinant(tip, travel);
    }

    /// Whether it can do this chain at all.
    bool works() const { return middle_ >= 0; }
    /// The angles of this joint and of those after it are not needed.
    int angles_needed() const { return last_; }

    /// Poses far from those before come next.
    void begin() { gave_up_ = false; }

    /// Writes the rates by free joint [rad/s] of least norm that give `velocity` (base frame, m/s) and do not turn the tool.
    /// False, and `x` means nothing, unless in all lanes they do so to 2e-12 of the largest of them and no row of the
    /// Jacobian at the tip is within 1e-6 of those before it (see Conditioning).
    /// `q`: joint positions, of which those of joints that slide are needed [m].
    bool solve(const JointAngles<T>& angle, const T* q, const Point3<T>& velocity, T* x) {
        Column column[max_joints];
        const Point3<T> v =
            slides_ ? find_columns<true>(angle, q, velocity, column) : find_columns<false>(angle, q, velocity, column);
        return eliminate(column, v, x) || in_another_order(column, v, x);
    }

  private:
    static constexpr int longest_side = 4, most_others = 5;
    /// What is subtracted from a row may be so many times greater than it: two subtractions lose three digits at most.
    static constexpr double largest_growth = 30;
    static constexpr double singular_sine = 1e-6;  ///< as of Conditioning

    /// A frame stands on the joint's axis and turns with the link: it is reached from that before by a shift in x and y,
    /// a turn about x, then a shift along and a turn about z. y is needed where axes are nearly parallel alone.
    struct Link {
        double x = 0, y = 0, z = 0;  ///< m
        double cos_alpha = 1, sin_alpha = 0;
    };
    struct Screw {
        Point3<T> z, m;
    };
    /// Of a screw, what is left once the two middle joints have taken away its rotation about y and z.
    struct Column {
        T row[4];  ///< rotation about x, then the translation [1, m]
        T y, z;    ///< rates of the joint after the middle and, but for the sign, of the middle one
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
    /// square of how far the tip can be from the joint.
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
        least_determinant_ = singular_sine * longest_rows * std::fabs(inverse_sine_);
        reach_ = std::sqrt(squares / count_);
    }

    [[gnu::always_inline]] static void turn_x(const Link& link, Point3<T>& v) {
        v = {v.x, v.y * link.cos_alpha - v.z * link.sin_alpha, v.y * link.sin_alpha + v.z * link.cos_alpha};
    }
    [[gnu::always_inline]] static void turn_back_x(const Link& link, Point3<T>& v) {
        v = {v.x, v.y * link.cos_alpha + v.z * link.sin_alpha, v.z * link.cos_alpha - v.y * link.sin_alpha};
    }
    [[gnu::always_inline]] static void turn_z(const T& c, const T& s, Point3<T>& v) {
        v = {v.x * c - v.y * s, v.x * s + v.y * c, v.z};
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
            turn_x(before, w.z);
            turn_x(before, w.m);
            shift(1, before, w);
            BUMPSTOP_UNROLL
            for (int j = i - 2; j >= 0; --j) {
                const Link& link = next[j];
                turn_z(cosine[j], sine[j], w.z);
                turn_z(cosine[j], sine[j], w.m);
                const auto z = along<Slides>(middle_ + 1 + j, q);
                w.m.x -= w.z.y * z;
                w.m.y += w.z.x * z;
                turn_x(link, w.z);
                turn_x(link, w.m);
                shift(1, link, w);
            }
            reduce(w, column[middle_ + 1 + i]);
        }
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

    [[gnu::noinline]] bool in_another_order(const Column* column, const Point3<T>& v, T* x) {
        if (gave_up_) return false;
        const std::array<int, most_others> before = order_;
        const int others = count_ - 2;
        std::sort(order_.begin(), order_.begin() + others);
        do {
            // Those eliminated last may change places.
            if (order_[2] < order_[3] && eliminate(column, v, x)) return true;
        } while (std::next_permutation(order_.begin(), order_.begin() + others));
        order_ = before;
        gave_up_ = true;
        return false;
    }
    bool eliminate(const Column* column, const Point3<T>& v, T* x) const {
        return count_ == 6 ? eliminate_of<4>(column, v, x) : eliminate_of<5>(column, v, x);
    }
    /// Columns leave in the order of `order_`; of seven the last is free.
    template <int Others>
    bool eliminate_of(const Column* columns, const Point3<T>& v, T* x) const {
        const Column* column[Others];
        for (int c = 0; c < Others; ++c) column[c] = &columns[order_[c]];
        T row[3][Others - 1], b[3] = {v.x, v.y, v.z};  // once the first column is gone
        const T first = 1.0 / column[0]->row[0];
        T grown = 0.0;
        BUMPSTOP_UNROLL
        for (int i = 0; i < 3; ++i) {
            const T factor = column[0]->row[i + 1] * first;
            grown = maximum(grown, absolute(factor));
            BUMPSTOP_UNROLL
            for (int c = 1; c < Others; ++c) row[i][c - 1] = column[c]->row[i + 1] - factor * column[c]->row[0];
        }
        grown = grown * (1.0 / reach_);
        const T second = 1.0 / row[0][0];
        BUMPSTOP_UNROLL
        for (int i = 1; i < 3; ++i) {
            const T factor = row[i][0] * second;
            grown = maximum(grown, absolute(factor));
            BUMPSTOP_UNROLL
            for (int c = 1; c < Others - 1; ++c) row[i][c] -= factor * row[0][c];
            b[i] -= factor * b[0];
        }
        const T minor = row[1][1] * row[2][2] - row[1][2] * row[2][1], third = 1.0 / minor;
        const T determinant = minor * (row[0][0] * column[0]->row[0]);
        auto back = [&](const T& r0, const T& r1, const T& r2, const T& top, T* to) {
            to[2] = (r1 * row[2][2] - r2 * row[1][2]) * third;
            to[3] = (r2 * row[1][1] - r1 * row[2][1]) * third;
            to[1] = (r0 - row[0][1] * to[2] - row[0][2] * to[3]) * second;
            to[0] = (top - column[1]->row[0] * to[1] - column[2]->row[0] * to[2] - column[3]->row[0] * to[3]) * first;
        };
        T rate[Others], own, next;
        back(b[0], b[1], b[2], T(0.0), rate);
        if constexpr (Others == 5) rate[4] = 0.0;
        middle_rates<Others>(column, rate, own, next);
        if constexpr (Others == 5) {
            // What the rates may be moved along without moving the tool is taken off.
            T still[5], still_own, still_next;
            back(-row[0][3], -row[1][3], -row[2][3], -column[4]->row[0], still);
            still[4] = 1.0;
            middle_rates<Others>(column, still, still_own, still_next);
            T shared = own * still_own + next * still_next, square = still_own * still_own + still_next * still_next;
            T most = 1.0;
            BUMPSTOP_UNROLL
            for (int c = 0; c < 4; ++c) {
                shared += rate[c] * still[c];
                square += still[c] * still[c];
                most = maximum(most, absolute(still[c]));
            }
            grown = maximum(grown, most);
            const T back_by = shared / (square + 1.0);
            BUMPSTOP_UNROLL
            for (int c = 0; c < 4; ++c) rate[c] -= back_by * still[c];
            rate[4] = -back_by;
            own -= back_by * still_own;
            next -= back_by * still_next;
        }
        x[place_[middle_]] = own;
        x[place_[middle_ + 1]] = next;
        for (int c = 0; c < Others; ++c) x[place_[order_[c]]] = rate[c];
        return all((grown <= T(largest_growth)) & (absolute(determinant) >= T(least_determinant_)));
    }

    const Chain& chain_;
    const int count_;
    std::array<int, max_joints> free_joint_{};
    std::array<int, max_joints> place_{};  ///< of a joint among the free ones
    std::array<int, most_others> order_{};
    bool slides_ = false;   ///< a joint of the chain does
    bool gave_up_ = false;  ///< no order serves the poses since `begin`
    int middle_ = -1, last_ = 0;
    std::array<Link, max_joints> link_{};
    double next_y_ = 0, next_z_ = 0;  ///< moment of the joint after the middle by its rotation about y [m]
    double inverse_sine_ = 1;         ///< of the angle between the middle joint's axis and the next
    double reach_ = 1;                ///< from the joints to the tip, at most and in the quadratic mean [m]
    double least_determinant_ = 0;    ///< of what is left: below it a row of the Jacobian may be dependent [m3]
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
