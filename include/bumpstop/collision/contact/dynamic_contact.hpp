/// @file
/// Contact of an elastic arm, or with a body that moves: residuals at the nodes of panels, and false alarms.
#pragma once

#include "bumpstop/collision/contact/contact_outcomes.hpp"
#include "bumpstop/collision/distribution/interpolated_panels.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Collisions after a false alarm whose reaction still reaches the body, or with a body that an elastic arm reaches
/// only beyond the end of its motion. A piece is a range of offsets at one tick, with cells and quadrature nodes.
struct EarlyReactions {
    static constexpr int cells = 16, nodes = 12;
    std::vector<int> tick;                        ///< [piece]; the number of ticks where there is no alarm
    std::vector<double> mass, node_mass;          ///< [piece][cell], [piece][node]: probability
    std::vector<ContactReactions::Outcome> edge;  ///< [piece][cell + 1]
    std::vector<ContactReactions::Outcome> node;  ///< [piece][node]
    double total = 0;                             ///< probability of all pieces

    std::size_t pieces() const { return tick.size(); }
};

/// Collisions at a block of offsets, for `DetectionIntegrator`.
template <class T>
class DynamicContact {
  public:
    DynamicContact(const ContactReactions& reactions, CollisionCache& cache) : reactions_(reactions), cache_(cache) {}

    void begin(const OffsetPanel& panel, const T* offset) {
        same_ = panel.low == panel.high;
        collision_.clear();
        for (int node = 0; node < (same_ ? 1 : nodes); ++node)
            collision_.emplace_back(reactions_, panel.tick, lane_of(offset[node / lanes], node % lanes));
    }
    T force(double, int i, int r) {
        return by_lane(r, [&](ContactCollision& collision) { return collision.force(i); });
    }
    /// Residual of a joint at the i-th tick in contact, from the force or the oscillation of an elastic arm.
    T residual(T force, double torque_per_N, int joint, int i, int r) {
        if (!reactions_.elastic()) return torque_per_N * force;
        return by_lane(r, [&](ContactCollision& collision) { return collision.residual(i, joint); });
    }

    static constexpr bool may_separate = true;
    /// Allowed error of interpolated probabilities.
    double chance_tolerance() const { return reactions_.peak_only() ? reactions_.negligible_chance : 0.0; }
    /// 1 as long as the contact can be detected, 0 once the body has separated.
    T detectable(int i, int r) {
        return by_lane(r, [&](ContactCollision& collision) { return collision.separated(i) ? 0.0 : 1.0; });
    }
    void finish(std::size_t p, int slots) { cache_.add(p, std::size_t(slots), collision_); }

  private:
    static constexpr int lanes = Scalar<T>::lanes, nodes = lanes * block_registers<T>;

    template <class Value>
    T by_lane(int r, Value value) {
        if (same_) return value(collision_[0]);
        T out;
        for (int lane = 0; lane < lanes; ++lane) set_lane(out, lane, value(collision_[std::size_t(r * lanes + lane)]));
        return out;
    }

    const ContactReactions& reactions_;
    CollisionCache& cache_;
    std::vector<ContactCollision> collision_;  ///< by node; one where the panel is a point
    bool same_ = false;                        ///< the panel is a point
};

namespace detail {

/// Distances above `low` at which the path after tick k turns back and later comes farther: bodies before them are hit
/// at the first approach, those beyond at a later one.
inline std::vector<double> turning_distances(const ContactPaths& paths, int k, double low) {
    constexpr double back = 1e-8;  // accuracy of the reactions [m]
    std::vector<double> found;
    const PathAfter path(paths, k, 0);
    double farthest = low;
    bool turned = true;
    for (int i = 0; i <= path.length(); ++i) {
        const double here = path.at(i);
        if (here > farthest) {
            if (turned && farthest > low) found.push_back(farthest);
            farthest = here;
            turned = false;
        }
        turned = turned || here < farthest - back;
    }
    return found;
}

/// Between two outcomes; infinite ones stay infinite.
inline ContactReactions::Outcome mixed(const ContactReactions::Outcome& a, const ContactReactions::Outcome& b,
                                       double share) {
    const auto mix = [&](double low, double high) {
        return low == high || share == 0 ? low : share == 1 ? high : (1 - share) * low + share * high;
    };
    return {mix(a.peak, b.peak), mix(a.lasting, b.lasting), mix(a.duration, b.duration)};
}

/// Adds a piece: collisions of probability `chance` after a false alarm at tick k with bodies from `low` to `top`.
/// `outcome(offset)` simulates one. Near `top` force and duration grow from zero like a square root: cells are denser
/// there. If the piece may be `rough`, every fourth edge of cells is simulated and the rest interpolated.
template <class Simulate>
void add_piece(const Simulate& outcome, const OffsetDistribution& offset, int k, double chance, double low, double top,
               bool rough, EarlyReactions& out) {
    using Outcome = ContactReactions::Outcome;
    constexpr int cells = EarlyReactions::cells, nodes = EarlyReactions::nodes;
    const bool fixed = offset.kind == OffsetKind::fixed;
    out.tick.push_back(k);
    std::array<double, cells + 1 + nodes> place;
    const GaussRule& rule = gauss_rule(nodes);
    for (int i = 0; i <= cells; ++i) {
        const double z = 1 - double(i) / cells;
        place[i] = fixed ? offset.size : top - (top - low) * z * z;
    }
    for (int g = 0; g < nodes; ++g) {
        const double z = 0.5 * (1 - rule.node[g]);
        place[cells + 1 + g] = fixed ? offset.size : top - (top - low) * z * z;
        const double density = fixed ? 0.5 : offset.density(place[cells + 1 + g]) * z * (top - low);
        out.node_mass.push_back(chance * density * rule.weight[g]);
    }
    for (int i = 0; i < cells; ++i) {
        const double share =
            fixed ? 1.0 / cells : offset.probability_beyond(place[i]) - offset.probability_beyond(place[i + 1]);
        out.mass.push_back(chance * share);
        out.total += chance * share;
    }
    // All offsets of a fixed body are the same.
    const int stride = fixed ? cells : rough ? 4 : 1;
    std::array<Outcome, cells + 1> edge;
    for (int i = 0; i <= cells; i += stride) edge[std::size_t(i)] = i > 0 && fixed ? edge[0] : outcome(place[i]);
    const auto interpolated = [&](double at) {
        const int i = std::min(int(at / stride), cells / stride - 1) * stride;
        return mixed(edge[std::size_t(i)], edge[std::size_t(i + stride)], (at - i) / stride);
    };
    for (int i = 0; i <= cells; ++i) out.edge.push_back(interpolated(i));
    for (int g = 0; g < nodes; ++g)
        out.node.push_back(stride == 1 ? outcome(place[cells + 1 + g])
                                       : interpolated(0.5 * (1 + rule.node[g]) * cells));
}

/// Adds the same range in several pieces, over each of which the density of the offset is smooth; larger ones if they
/// may be `rough`. `ends`: further offsets at which pieces end.
template <class Simulate>
void add_pieces(const Simulate& outcome, const OffsetDistribution& offset, int k, double chance, double low, double top,
                bool rough, std::vector<double> ends, EarlyReactions& out) {
    const double most_sd = rough ? 2 : 0.5;  // in a piece
    top = std::min(top, offset.largest());
    if (offset.kind == OffsetKind::fixed) {
        if (top >= offset.size && offset.size >= low) add_piece(outcome, offset, k, chance, low, top, rough, out);
        return;
    }
    if (!(top > low)) return;
    const double widest = offset.kind == OffsetKind::half_normal ? most_sd * offset.size : HUGE_VAL;
    std::erase_if(ends, [&](double end) { return !(end < top); });
    ends.push_back(top);
    double begin = low;
    for (double end : ends) {
        const int parts = std::max(1, int(std::ceil((end - begin) / widest)));
        for (int i = 0; i < parts; ++i)
            add_piece(outcome, offset, k, chance, begin + (end - begin) * i / parts,
                      begin + (end - begin) * (i + 1) / parts, rough, out);
        begin = end;
    }
}

}  // namespace detail

/// Adds the false alarms of all ticks whose reaction still reaches the body. `edges`: as of OffsetMesh [m].
inline void add_early_reactions(const ContactReactions& reactions, const OffsetDistribution& offset,
                                const PreContactAlarms& before, const std::vector<double>& edges, EarlyReactions& out) {
    constexpr double rare_alarms = 1e-4, negligible_chance = 1e-18;  // before contact: of all, of one
    constexpr int group = 16;
    const ContactPaths& paths = reactions.paths();
    const int ticks = paths.path->ticks;
    // Where alarms before contact are rare and offsets extend over many ticks, one tick represents a group of them.
    const bool rare = before.false_alarm_before(ticks) < rare_alarms, of_batch = rare && reactions.peak_only();
    const bool groups = rare && offset.kind == OffsetKind::half_normal;
    const double of_group = reactions.peak_only() ? reactions.negligible_chance : 0.0;
    for (int first = before.unarmed(), end = first; first < ticks; first = end) {
        double chance = 0;
        do {
            chance += before.survival_before(end) * before.no_contact(end).alarm;
            ++end;
        } while (end < ticks && groups && (end - first < group || chance <= of_group));
        const int k = (first + end - 1) / 2;
        if (!(chance > negligible_chance)) continue;
        const double low = edges[std::size_t(k) + 1], top = reactions.max_distance(k),
                     contact = chance * (offset.probability_beyond(low) - offset.probability_beyond(top));
        // A reaction that approaches several times has a piece for each approach.
        std::vector<double> ends;
        if (!of_batch && offset.kind != OffsetKind::fixed) ends = detail::turning_distances(paths, k, low);
        detail::add_pieces([&](double o) { return reactions.without_contact(k, o); }, offset, k, chance, low, top,
                           of_batch || (rare && contact < ContactReactions::negligible_chance), std::move(ends), out);
    }
    // Without an alarm an elastic arm still oscillates beyond the end of its motion.
    const double survival = before.survival_before(ticks);
    if (!reactions.elastic() || paths.path->end == PathEnd::all_detected || !(survival > negligible_chance)) return;
    const ContactState end = paths.approaching(paths.motion_end());
    detail::add_pieces([&](double place) { return reactions.undetected(end, place); }, offset, ticks, survival,
                       edges.back(), reactions.max_distance_undetected(), false, {}, out);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
