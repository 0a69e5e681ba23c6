/// @file
/// Contact in which something gives way: what becomes of collisions at the nodes of panels, and of those that false alarms
/// still bring about.
#pragma once

#include "bumpstop/collision/contact/contact_collision.hpp"
#include "bumpstop/collision/distribution/interpolated_panels.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Quantities at the Gauss nodes of a density's panels: by slot of detection, and where nothing is detected.
struct ContactNodes {
    std::vector<double> peak_force, lasting_force, duration, force_at_detection;  ///< [slot][node] [N, N, s, N]
    /// [panel][node] [N, N, s]
    std::vector<double> undetected_peak_force, undetected_lasting_force, undetected_duration;
    bool kinks = false;  ///< an arm that gives way: a later peak may outgrow an earlier one from some offset on

    /// Keeps what was found or is interpolated, in the order of the panels, of `order` nodes each.
    template <class T>
    void keep(const DetectionProbabilities& found, std::size_t order, bool elastic) {
        std::vector<double> room;
        const auto keep = [&](const std::vector<double>& from, std::vector<double>& values) {
            values.clear();
            for (std::size_t p = 0; p < found.panel.size(); ++p) {
                const double* first = found.by_slot<T>(from, p, order, room);
                values.insert(values.end(), first, first + std::size_t(found.panel[p].slots) * order);
            }
        };
        const auto keep_one = [&](const std::vector<double>& from, std::vector<double>& values) {
            values.clear();
            for (std::size_t p = 0; p < found.panel.size(); ++p) {
                const double* first = found.by_panel<T>(from, p, order, room);
                values.insert(values.end(), first, first + order);
            }
        };
        kinks = elastic;
        keep(found.peak_force, peak_force);
        keep(found.lasting_force, lasting_force);
        keep(found.duration, duration);
        keep(found.force_at_detection, force_at_detection);
        keep_one(found.undetected_peak_force, undetected_peak_force);
        keep_one(found.undetected_lasting_force, undetected_lasting_force);
        keep_one(found.undetected_duration, undetected_duration);
    }
};

/// False alarms whose reaction still reaches the body, in pieces of one tick: cells of offset, and the nodes of a
/// quadrature over the same offsets.
struct EarlyReactions {
    static constexpr int cells = 16, nodes = 12;
    std::vector<int> tick;                                        ///< [piece]
    std::vector<double> mass;                                     ///< [piece][cell]: probability
    std::vector<double> edge_force, edge_lasting, edge_duration;  ///< [piece][cell + 1] [N, N, s]
    std::vector<double> node_mass;                                ///< [piece][node]
    std::vector<double> node_force, node_lasting, node_duration;  ///< [piece][node] [N, N, s]
    double total = 0;                                             ///< probability of all pieces

    std::size_t pieces() const { return tick.size(); }
};

/// Collisions in which something gives way, at a block of offsets.
template <class T>
class DynamicContact {
  public:
    explicit DynamicContact(const ContactReactions& reactions) : reactions_(reactions) {}

    void begin(const OffsetPanel& panel, const T* offset) {
        same_ = panel.low == panel.high;
        collision_.clear();
        for (int node = 0; node < (same_ ? 1 : nodes); ++node)
            collision_.emplace_back(reactions_, panel.tick, lane_of(offset[node / lanes], node % lanes));
    }
    T force(double, int i, int r) {
        return by_lane(r, [&](ContactCollision& collision) { return collision.force(i); });
    }
    /// What the force at the i-th tick in contact, or the arm's oscillation, is in a joint's residual.
    T residual(T force, double torque_per_N, int joint, int i, int r) {
        if (!reactions_.dynamics().propagator().elastic()) return torque_per_N * force;
        return by_lane(r, [&](ContactCollision& collision) { return collision.residual(i, joint); });
    }

    static constexpr bool parts = true;
    /// Probabilities of detection may be off by this.
    double chance_tolerance() const { return reactions_.peak_only() ? 1e-6 : 0.0; }
    /// 1 where a detection then is one of this contact: a body that has got away cannot be felt.
    T touched(int i, int r) {
        return by_lane(r, [&](ContactCollision& collision) { return collision.separated(i) ? 0.0 : 1.0; });
    }

    /// What the reactions come to that have any probability.
    void finish(const DetectionProbabilities::Panel& panel, std::size_t first, std::size_t order,
                DetectionProbabilities& out) {
        for (auto values : by_slot()) (out.*values).resize(out.detected.size(), 0.0);
        for (auto values : by_panel()) (out.*values).resize(out.survived.size(), 0.0);
        // Where all nodes hold one offset, what becomes of the first is told of all.
        for (std::size_t node = 0; node < collision_.size(); ++node) {
            ContactCollision& collision = collision_[node];
            const auto put = [&](std::vector<double>& values, std::size_t row, double value) {
                std::fill_n(values.begin() + std::ptrdiff_t(row * order + first + node), same_ ? nodes : 1, value);
            };
            follow_reactions(
                collision, panel.slots,
                [&](int i) { return out.detected[(panel.first_slot + std::size_t(i)) * order + first + node]; },
                [&](int i, const ContactCollision::Outcome& outcome) {
                    const std::size_t slot = panel.first_slot + std::size_t(i);
                    put(out.peak_force, slot, outcome.peak);
                    put(out.lasting_force, slot, outcome.lasting);
                    put(out.duration, slot, outcome.duration);
                    put(out.force_at_detection, slot, collision.force(i));
                });
            if (!(out.survived[panel.row * order + first + node] > 0)) continue;
            const ContactCollision::Outcome outcome = collision.undetected();
            put(out.undetected_peak_force, panel.row, outcome.peak);
            put(out.undetected_lasting_force, panel.row, outcome.lasting);
            put(out.undetected_duration, panel.row, outcome.duration);
        }
    }

    static constexpr auto by_slot() {
        return std::array{&DetectionProbabilities::peak_force, &DetectionProbabilities::lasting_force,
                          &DetectionProbabilities::duration, &DetectionProbabilities::force_at_detection};
    }
    static constexpr auto by_panel() {
        return std::array{&DetectionProbabilities::undetected_peak_force,
                          &DetectionProbabilities::undetected_lasting_force,
                          &DetectionProbabilities::undetected_duration};
    }

    /// Interpolated quantities, times the probability of meeting them, may be off by a share of the greatest: the arm's path
    /// is straight within a simulation step, which leaves kinks of this size.
    template <class Interpolated>
    bool agrees(const Interpolated& panels, std::size_t p, const DetectionProbabilities& known) const {
        // Of both forces, of the time in contact. An arm that gives way bounces: how long it touches in all is no smooth
        // function of the offset.
        const bool bounces = reactions_.dynamics().propagator().elastic();
        const bool peak_only = reactions_.peak_only();
        const double of_arm = peak_only ? 1e-3 : 1e-4, of_force = bounces ? of_arm : 1e-5,
                     tolerance[] = {of_force, of_force, bounces ? 0.1 : 5e-5};
        for (std::size_t q = 0; q < (peak_only ? 1 : std::size(tolerance)); ++q) {
            const std::vector<double>& values = known.*by_slot()[q];
            const std::vector<double>& never = known.*by_panel()[q];
            const double allowed =
                tolerance[q] * std::max(panels.greatest(values), *std::max_element(never.begin(), never.end()));
            for (int slot = 0; slot < known.panel[p].slots; ++slot) {
                if (!panels.slot_agrees(values, p, slot, [&](std::size_t at) {
                        return allowed / max(load<T>(&known.detected[at]), T(1e-300));
                    }))
                    return false;
            }
            const double* survived = &known.survived[known.panel[p].row * panels.order()];
            const double most = *std::max_element(survived, survived + panels.order());
            if (most > 0 && !panels.row_agrees(never, p, T(allowed / most))) return false;
        }
        return true;
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes, nodes = lanes * block_registers<T>;

    template <class Value>
    T by_lane(int r, Value value) {
        if (same_) return value(collision_[0]);
        T out;
        for (int lane = 0; lane < lanes; ++lane) set_lane(out, lane, value(collision_[std::size_t(r * lanes + lane)]));
        return out;
    }

    /// Puts what detections come to, from the first to the last that have a `chance`. Some in a row that have hardly any
    /// together are interpolated between the two beside them.
    template <class Chance, class Put>
    static void follow_reactions(ContactCollision& collision, int slots, Chance chance, Put put) {
        constexpr double negligible_chance = 1e-6;
        using Outcome = ContactCollision::Outcome;
        int first = 0, last = slots - 1;
        while (first < slots && !(chance(first) > 0)) ++first;
        while (last > first && !(chance(last) > 0)) --last;
        Outcome from{};
        double passed = 0;  // probability of those since the last one that was followed
        for (int i = first, before = first; i <= last; ++i) {
            passed += chance(i);
            if (i > first && i < last && passed <= negligible_chance) continue;
            const Outcome to = collision.detected(i);
            for (int k = before + 1; k < i; ++k) {
                const double share = double(k - before) / (i - before);
                // Of infinite ones, too.
                const auto mix = [&](double a, double b) { return (1 - share) * a + share * b; };
                put(k,
                    Outcome{mix(from.peak, to.peak), mix(from.lasting, to.lasting), mix(from.duration, to.duration)});
            }
            put(i, to);
            from = to;
            before = i;
            passed = 0;
        }
    }

    const ContactReactions& reactions_;
    std::vector<ContactCollision> collision_;  ///< by node; one where the panel is a point
    bool same_ = false;                        ///< the panel is a point
};

namespace detail {

/// Distances above `low` at which the path after tick k turns back and later goes on: bodies on this side are struck at
/// first, those beyond when the arm swings forward again.
inline std::vector<double> turns(const ContactPaths& paths, int k, double low) {
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
inline void add_piece(const ContactReactions& reactions, const OffsetDistribution& offset, int k, double chance,
                      double low, double top, EarlyReactions& out) {
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
    std::array<double, place.size()> force, lasting, duration;
    // A body that stands at one place is struck once.
    const std::size_t places = fixed ? 1 : place.size();
    for (std::size_t i = 0; i < places; ++i) {
        const ContactReactions::Outcome outcome = reactions(ContactState(), k, 0, place[i]);
        force[i] = outcome.peak;
        lasting[i] = outcome.lasting;
        duration[i] = outcome.duration;
    }
    const auto keep = [&](auto& values, std::vector<double>& at_edge, std::vector<double>& at_node) {
        if (fixed) std::fill(values.begin() + 1, values.end(), values[0]);
        at_edge.insert(at_edge.end(), values.begin(), values.begin() + cells + 1);
        at_node.insert(at_node.end(), values.begin() + cells + 1, values.end());
    };
    keep(force, out.edge_force, out.node_force);
    keep(lasting, out.edge_lasting, out.node_lasting);
    keep(duration, out.edge_duration, out.node_duration);
}

/// Adds the false alarms at tick k, of probability `chance`, against bodies from `low` on. Where a reaction barely
/// arrives, contact time grows from nothing like a square root: places crowd there. One that swings forward again and
/// reaches far has a piece for each swing, and the density of the offset bends little in any.
inline void add_alarms(const ContactReactions& reactions, const OffsetDistribution& offset, int k, double chance,
                       double low, EarlyReactions& out) {
    constexpr double most_sd = 0.5;  // in a piece
    const double top = std::min(reactions.paths().max_distance[std::size_t(k)], offset.largest());
    if (offset.kind == OffsetKind::fixed) {
        if (top >= offset.size && offset.size >= low) add_piece(reactions, offset, k, chance, low, top, out);
        return;
    }
    if (!(top > low)) return;
    const double widest = offset.kind == OffsetKind::half_normal ? most_sd * offset.size : HUGE_VAL;
    std::vector<double> ends = turns(reactions.paths(), k, low);
    std::erase_if(ends, [&](double end) { return !(end < top); });
    ends.push_back(top);
    double begin = low;
    for (double end : ends) {
        const int parts = std::max(1, int(std::ceil((end - begin) / widest)));
        for (int i = 0; i < parts; ++i)
            add_piece(reactions, offset, k, chance, begin + (end - begin) * i / parts,
                      begin + (end - begin) * (i + 1) / parts, out);
        begin = end;
    }
}

}  // namespace detail

/// Adds false alarms whose reaction still reaches the body; `edges`: of the ticks, where the point is then [m].
inline void add_early_reactions(const ContactReactions& reactions, const OffsetDistribution& offset,
                                const PreContactAlarms& before, const std::vector<double>& edges, EarlyReactions& out) {
    constexpr double rare_alarms = 1e-4, negligible_chance = 1e-18;  // before contact: of all, of one
    constexpr int max_group = 16;
    const int ticks = reactions.paths().path->ticks;
    // Where alarms before contact are rare and bodies stand many ticks apart, what one comes to stands for some ticks'.
    const bool rare = before.false_alarm_before(ticks) < rare_alarms;
    const int group = rare && offset.kind == OffsetKind::half_normal ? max_group : 1;
    for (int first = before.unarmed(); first < ticks; first += group) {
        const int end = std::min(first + group, ticks), k = (first + end - 1) / 2;
        double chance = 0;
        for (int i = first; i < end; ++i) chance += before.survival_before(i) * before.no_contact(i).alarm;
        if (chance > negligible_chance)
            detail::add_alarms(reactions, offset, k, chance, edges[std::size_t(k) + 1], out);
    }
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
