/// @file
/// Free contact in the exact law: what becomes of bodies at the nodes of panels, and of those that false alarms still
/// reach.
#pragma once

#include "bumpstop/collision/free_collision.hpp"
#include "bumpstop/collision/offset_law.hpp"
#include "bumpstop/collision/outcomes.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Quantities at the Gauss nodes of panels, [slot][node][panel]: slot i is a detection at the i-th tick in contact, the
/// last one none.
struct FreeNodes {
    int panels = 0;
    std::vector<double> peak_force, duration, force_at_detection;  ///< N, s, N

    static constexpr auto all() {
        return std::array{&FreeNodes::peak_force, &FreeNodes::duration, &FreeNodes::force_at_detection};
    }
};

/// False alarms whose reaction still reaches the body, in pieces of one tick: cells of offset, and the nodes of a
/// quadrature over the same offsets.
struct FreeAlarms {
    static constexpr int cells = 16, nodes = 12;
    std::vector<int> tick;                          ///< [piece]
    std::vector<double> mass;                       ///< [piece][cell]: probability
    std::vector<double> edge_force, edge_duration;  ///< [piece][cell + 1] [N, s]
    std::vector<double> node_mass;                  ///< [piece][node]
    std::vector<double> node_force, node_duration;  ///< [piece][node] [N, s]
    double total = 0;                               ///< probability of all pieces

    std::size_t pieces() const { return tick.size(); }
};

/// The undetected collisions at all nodes of panels, as the outcomes' finder sees them.
template <class T>
class FreeContact {
  public:
    FreeContact(const FreeReactions<T>& reactions, const std::vector<Panel>& panels, int order)
        : order_(order), panels_(int(panels.size() + lanes - 1) / lanes * lanes) {
        const GaussRule& rule = gauss_rule(order);
        collision_.reserve(std::size_t(panels_ / lanes) * order);
        for (int first = 0; first < panels_; first += lanes) {
            int tick[lanes];
            T low, high;
            for (int lane = 0; lane < lanes; ++lane) {
                const Panel& panel = panels[std::min(std::size_t(first + lane), panels.size() - 1)];
                tick[lane] = panel.tick;
                set_lane(low, lane, panel.low);
                set_lane(high, lane, panel.high);
            }
            for (int g = 0; g < order; ++g)
                collision_.emplace_back(reactions, tick, 0.5 * (low + high) + 0.5 * (high - low) * rule.node[g]);
        }
    }

    /// A collision in the hands of the finder.
    struct Collision {
        const FreeCollision<T>* collision;

        T force(const T&, int i) const {
            return std::size_t(i) < collision->force.size() ? collision->force[std::size_t(i)] : T(0.0);
        }
        // A body that has got away cannot be felt.
        T felt(int i) const {
            return std::size_t(i) < collision->touched.size() ? collision->touched[std::size_t(i)] : T(0.0);
        }
    };
    Collision begin(int first, int node, const T&) const { return {&at(first, node)}; }

    /// What the reactions of those outcomes come to that have any probability.
    FreeNodes values(const Outcomes& outcomes) const {
        FreeNodes out;
        out.panels = panels_;
        const std::size_t block = std::size_t(order_) * panels_, slots = outcomes.detected.size() + 1;
        for (auto quantity : FreeNodes::all()) (out.*quantity).assign(block * slots, 0.0);
        for (int first = 0; first < panels_; first += lanes) {
            for (int g = 0; g < order_; ++g) {
                const FreeCollision<T>& collision = at(first, g);
                const std::size_t place = std::size_t(g) * panels_ + first;
                for (std::size_t i = 0; i + 1 < slots; ++i) {
                    if (!any(load<T>(&outcomes.detected[i][place]) > T(0.0))) continue;
                    int since[lanes];
                    std::fill(since, since + lanes, int(i));
                    const auto outcome = collision.detected(since);
                    store(outcome.peak, &out.peak_force[i * block + place]);
                    store(outcome.duration, &out.duration[i * block + place]);
                    store(begin(first, g, T(0.0)).force(T(0.0), int(i)), &out.force_at_detection[i * block + place]);
                }
                store(collision.peak, &out.peak_force[(slots - 1) * block + place]);
                store(collision.duration, &out.duration[(slots - 1) * block + place]);
            }
        }
        return out;
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;

    const FreeCollision<T>& at(int first, int node) const {
        return collision_[std::size_t(first / lanes) * order_ + node];
    }

    int order_, panels_;
    std::vector<FreeCollision<T>> collision_;  // [register][node]
};

namespace detail {

/// Distances above `low` at which the path after tick k turns back and later goes on: bodies on this side are struck at
/// first, those beyond when the arm swings forward again.
inline std::vector<double> turns(const FreePaths& paths, int k, double low) {
    constexpr double back = 1e-8;  // [m]: as well as reactions are known
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

/// Some of the false alarms at tick k, against bodies from `low` to `top`.
template <class T>
void add_piece(const FreeReactions<T>& reactions, const OffsetLaw& offset, int k, double chance, double low, double top,
               FreeAlarms& out) {
    constexpr int lanes = Scalar<T>::lanes, cells = FreeAlarms::cells, nodes = FreeAlarms::nodes;
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
    std::array<double, place.size()> force, duration;
    for (std::size_t first = 0; first < place.size(); first += lanes) {
        T at;
        int tick[lanes], first_step[lanes];
        for (int lane = 0; lane < lanes; ++lane) {
            set_lane(at, lane, place[std::min(first + lane, place.size() - 1)]);
            tick[lane] = k;
            first_step[lane] = 0;
        }
        const auto outcome = reactions(ImpactState<T>(), tick, first_step, at);
        for (std::size_t i = first; i < std::min(first + lanes, place.size()); ++i) {
            force[i] = lane_of(outcome.peak, int(i - first));
            duration[i] = lane_of(outcome.duration, int(i - first));
        }
    }
    out.edge_force.insert(out.edge_force.end(), force.begin(), force.begin() + cells + 1);
    out.edge_duration.insert(out.edge_duration.end(), duration.begin(), duration.begin() + cells + 1);
    out.node_force.insert(out.node_force.end(), force.begin() + cells + 1, force.end());
    out.node_duration.insert(out.node_duration.end(), duration.begin() + cells + 1, duration.end());
}

}  // namespace detail

/// Adds the false alarms at tick k, of probability `chance`, against bodies from `low` on. Where a reaction barely
/// arrives, contact time grows from nothing like a square root: places crowd there. One that swings forward again and
/// reaches far has a piece for each swing, and the density of the offset bends little in any.
template <class T>
void add_alarms(const FreeReactions<T>& reactions, const OffsetLaw& offset, int k, double chance, double low,
                FreeAlarms& out) {
    constexpr double most_sd = 0.5;  // in a piece
    const double top = std::min(reactions.paths().farthest[std::size_t(k)], offset.largest());
    if (offset.kind == OffsetKind::fixed) {
        if (top >= offset.size && offset.size >= low) detail::add_piece(reactions, offset, k, chance, low, top, out);
        return;
    }
    if (!(top > low)) return;
    const double widest = offset.kind == OffsetKind::half_normal ? most_sd * offset.size : HUGE_VAL;
    std::vector<double> ends = detail::turns(reactions.paths(), k, low);
    std::erase_if(ends, [&](double end) { return !(end < top); });
    ends.push_back(top);
    double begin = low;
    for (double end : ends) {
        const int parts = std::max(1, int(std::ceil((end - begin) / widest)));
        for (int i = 0; i < parts; ++i)
            detail::add_piece(reactions, offset, k, chance, begin + (end - begin) * i / parts,
                              begin + (end - begin) * (i + 1) / parts, out);
        begin = end;
    }
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
