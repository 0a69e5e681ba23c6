/// @file
/// What detected and missed collisions come to where something gives way, at the nodes of panels.
#pragma once

#include "bumpstop/collision/contact/contact_collision.hpp"
#include "bumpstop/collision/distribution/detection_probabilities.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Quantities at the Gauss nodes of a density's panels: by slot of detection, and where nothing is detected.
struct ContactNodes {
    std::vector<double> peak_force, lasting_force, duration, force_at_detection;  ///< [slot][node] [N, N, s, N]
    /// [panel][node] [N, N, s]
    std::vector<double> undetected_peak_force, undetected_lasting_force, undetected_duration;
    bool gives_way = false;  ///< something does: these hold, and not the forces of a rigid arm on a spring
    bool pressed = false;    ///< there, what is never detected: a held body, by an arm that has not come to rest
    bool kinks = false;      ///< an arm that gives way: a later peak may outgrow an earlier one from some offset on

    static constexpr std::size_t quantities = 4, of_missed = 3;
    std::array<std::vector<double>*, quantities> by_slot() {
        return {&peak_force, &lasting_force, &duration, &force_at_detection};
    }
    std::array<std::vector<double>*, of_missed> by_panel() {
        return {&undetected_peak_force, &undetected_lasting_force, &undetected_duration};
    }
};

/// Collisions that have been simulated, by panel and node, as long as they are few.
struct KeptCollisions {
    std::vector<std::vector<ContactCollision>> of_panel;
    std::size_t room = 50'000;  ///< ticks, of a few hundred bytes each

    explicit KeptCollisions(std::size_t panels) : of_panel(panels) {}
    /// Takes some further nodes of panel p, each of so many ticks. A panel that lacks some of its nodes is simulated anew.
    void keep(std::size_t p, std::size_t ticks, std::vector<ContactCollision>& collisions) {
        const std::size_t size = ticks * collisions.size();
        room -= std::min(room, size);
        if (room > 0) std::move(collisions.begin(), collisions.end(), std::back_inserter(of_panel[p]));
    }
};

/// Finds these quantities. Panels are as narrow as the chance of a detection asks for; what reactions come to changes more slowly with
/// the offset. So they are followed at the nodes of all that the arm travels in a tick, and at those of a few ticks of many.
/// The rest is interpolated where the last terms of the polynomials are small and two ticks in between agree; else halves
/// are tried, down to the panels themselves.
template <class T>
class ContactOutcomes {
  public:
    ContactOutcomes(const ContactReactions& reactions, const std::vector<OffsetPanel>& panels, int order,
                    const DetectionProbabilities& found, KeptCollisions& kept, ContactNodes& out)
        : reactions_(reactions),
          panels_(panels),
          order_(std::size_t(order)),
          rule_(gauss_rule(order)),
          found_(found),
          kept_(kept),
          out_(out) {}

    void operator()() {
        const bool elastic = out_.kinks = reactions_.swings();
        // An arm's path is straight within a simulation step, which leaves kinks of this size in what it does. One that gives
        // way bounces: how long it touches in all is no smooth function of the offset.
        const double of_force = !elastic ? 2e-5 : reactions_.peak_only() ? 3e-4 : 1e-4;
        share_ = {of_force, of_force, elastic ? 0.1 : 5e-5, of_force};
        if (reactions_.peak_only()) share_ = {of_force, HUGE_VAL, HUGE_VAL, HUGE_VAL};
        std::size_t slots = 0;
        for (const DetectionProbabilities::Panel& panel : found_.panel) {
            first_slot_.push_back(slots);
            slots += std::size_t(panel.slots);
        }
        for (std::vector<double>* values : out_.by_slot()) values->assign(slots * order_, 0.0);
        for (std::vector<double>* values : out_.by_panel()) values->assign(panels_.size() * order_, 0.0);
        // What becomes of a body that gets away changes abruptly at some ends of panels: like parts of travels make a run.
        const bool in_parts = reactions_.dynamics().propagator().gets_away;
        for (std::size_t first = 0; first < panels_.size();) {
            const std::size_t panels = travel_end(first) - first, width = in_parts ? 1 : panels;
            std::size_t end = first + panels;
            while (end < panels_.size() && goes_on(end - 1, end) && (!in_parts || travel_end(end) - end == panels))
                end = travel_end(end);
            for (std::size_t part = 0; part < panels; part += width) {
                run_.clear();
                slots_ = 0;
                for (std::size_t p = first; p < end; p = travel_end(p))
                    add_travel(p + part, in_parts ? p + part + 1 : travel_end(p));
                find_run(0, run_.size());
            }
            first = end;
        }
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;
    static constexpr double negligible_survival = 1e-18;  ///< what interpolation leaves of it, and less
    static constexpr std::size_t quantities = ContactNodes::quantities, of_missed = ContactNodes::of_missed;
    using Outcome = ContactCollision::Outcome;
    using Values = std::vector<double>;  ///< [row][node]: rows by quantity and slot, then those of missed collisions

    /// The greatest probabilities among some bodies.
    struct Likely {
        std::vector<double> chance;  ///< by slot: of a detection
        double missed = 0;           ///< of none

        void join(const Likely& other) {
            chance.resize(std::max(chance.size(), other.chance.size()), 0.0);
            for (std::size_t i = 0; i < other.chance.size(); ++i) chance[i] = std::max(chance[i], other.chance[i]);
            missed = std::max(missed, other.missed);
        }
    };
    /// Panels of bodies that are first touched at one tick, or group of ticks.
    struct Travel {
        std::size_t first, end;
        Likely likely;
        Values known;  ///< at the nodes of the whole travel, once it has been followed
    };

    void add_travel(std::size_t first, std::size_t end) {
        Travel travel{first, end, {}, {}};
        for (std::size_t p = first; p < end; ++p) {
            Likely own{std::vector<double>(std::size_t(found_.panel[p].slots), 0.0)};
            const double* detected = found_.by_slot<T>(found_.detected, p, order_, room_);
            for (double& chance : own.chance) {
                chance = *std::max_element(detected, detected + order_);
                detected += order_;
            }
            const double* survived = found_.by_panel<T>(found_.survived, p, order_, room_);
            own.missed = *std::max_element(survived, survived + order_);
            travel.likely.join(own);
        }
        slots_ = std::max(slots_, travel.likely.chance.size());
        run_.push_back(std::move(travel));
    }
    /// Behind the last panel of the same tick.
    std::size_t travel_end(std::size_t first) const {
        std::size_t end = first;
        while (end < panels_.size() && panels_[end].tick == panels_[first].tick) ++end;
        return end;
    }
    /// Whether the travel of a panel is of as many ticks as that of the one before, and follows it.
    bool goes_on(std::size_t before, std::size_t p) const {
        const OffsetPanel &last = panels_[before], &next = panels_[p];
        return last.tick > 0 && last.ticks > 0 && next.ticks == last.ticks && next.tick == last.tick + last.ticks;
    }

    /// The travels run_[first .. end - 1].
    void find_run(std::size_t first, std::size_t end) {
        constexpr std::size_t fewest = 6;
        if (end - first < fewest) {
            for (std::size_t i = first; i < end; ++i) find_travel(run_[i]);
            return;
        }
        Likely likely;
        for (std::size_t i = first; i < end; ++i) likely.join(run_[i].likely);
        const int low = int(first), high = int(end) - 1, middle = (low + high) / 2;
        const Interpolation interpolation(std::vector{low, middle, high});
        if (!agree(interpolation, likely)) {
            // Halves that share the travel in the middle use again what is known.
            find_run(first, std::size_t(middle) + 1);
            find_run(std::size_t(middle), end);
            return;
        }
        for (std::size_t i = first; i < end; ++i) spread(mixed(interpolation, int(i)), run_[i].first, run_[i].end);
    }
    /// Do the travels at the nodes tell two between them?
    bool agree(const Interpolation& interpolation, const Likely& likely) {
        // Where the motion's end decides what is missed, nothing is smooth from tick to tick.
        const double negligible = reactions_.peak_only() ? ContactReactions::negligible_chance : negligible_survival;
        if (reactions_.paths().path->end != PathEnd::all_detected && likely.missed > negligible) return false;
        const std::vector<int>& node = interpolation.nodes();
        for (int i : node)
            if (!tells_all(run_[std::size_t(i)], likely) ||
                !parts_alike(run_[std::size_t(node[0])], run_[std::size_t(i)]))
                return false;
        for (int i : {(node[0] + node[1]) / 2, (node[1] + node[2]) / 2}) {
            const Values& direct = whole(run_[std::size_t(i)], likely);
            const Values told = mixed(interpolation, i), allowed = tolerances(direct, run_[std::size_t(i)].likely);
            // Nor may all slots together be off to one side by more.
            Values off(quantities * order_, 0.0);
            for (std::size_t row = 0; row < allowed.size(); ++row) {
                if (std::isinf(allowed[row])) continue;
                const std::size_t q = row < quantities * slots_ ? row / slots_ : row - quantities * slots_;
                for (std::size_t g = 0; g < order_; ++g) {
                    const double a = told[row * order_ + g], b = direct[row * order_ + g],
                                 share = a == b ? 0.0 : (a - b) / allowed[row];
                    if (!(std::fabs(share) <= 1)) return false;
                    off[q * order_ + g] += share;
                }
            }
            if (std::any_of(off.begin(), off.end(), [](double share) { return std::fabs(share) > 1; })) return false;
        }
        return true;
    }
    /// A body that gets away is felt no more: from some travel on at a slot, and nothing between tells from which.
    bool parts_alike(const Travel& one, const Travel& other) const {
        if (!reactions_.dynamics().propagator().gets_away) return true;
        const auto force = [&](const Travel& travel) {  // at detection, the last of the quantities
            return travel.known.begin() + std::ptrdiff_t((quantities - 1) * slots_ * order_);
        };
        return std::equal(force(one), force(one) + std::ptrdiff_t(slots_ * order_), force(other),
                          [](double a, double b) { return (a > 0) == (b > 0); });
    }
    Values mixed(const Interpolation& interpolation, int place) const {
        double weight[DetectionProbabilities::max_nodes];
        interpolation.weights(double(place), weight);
        Values sum((quantities * slots_ + of_missed) * order_, 0.0);
        for (int m = 0; m < interpolation.size(); ++m) {
            const Values& known = run_[std::size_t(interpolation.nodes()[std::size_t(m)])].known;
            for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += weight[m] * known[i];
        }
        for (double& value : sum)
            if (!std::isfinite(value)) value = HUGE_VAL;
        return sum;
    }

    void find_travel(Travel& travel) {
        if (tells_all(travel, travel.likely))
            spread(travel.known, travel.first, travel.end);
        else
            find_halves(travel.first, travel.end, travel.likely);
    }
    void find_halves(std::size_t first, std::size_t end, const Likely& likely) {
        const std::size_t middle = (first + end) / 2;
        for (const auto& [a, b] : {std::pair(first, middle), std::pair(middle, end)}) {
            const Values values = follow(a, b, likely);
            if (b - a == 1 || smooth(values, likely))
                spread(values, a, b);
            else
                find_halves(a, b, likely);
        }
    }
    /// Whether the nodes of a whole travel, which are those of a single panel, tell its panels.
    bool tells_all(Travel& travel, const Likely& likely) {
        const Values& values = whole(travel, likely);
        return travel.end - travel.first == 1 || smooth(values, travel.likely);
    }
    const Values& whole(Travel& travel, const Likely& likely) {
        if (travel.known.empty()) travel.known = follow(travel.first, travel.end, likely);
        return travel.known;
    }

    /// At the nodes of panels taken as one, what is likely at all.
    Values follow(std::size_t first, std::size_t end, const Likely& likely) {
        Values values((quantities * slots_ + of_missed) * order_, 0.0);
        const double low = panels_[first].low, high = panels_[end - 1].high;
        // Where all nodes hold one offset, what becomes of the first is told of all.
        const std::size_t nodes = low == high ? 1 : order_;
        std::vector<ContactCollision> known;
        if (end - first == 1) known = std::move(kept_.of_panel[first]);
        for (std::size_t g = 0; g < nodes; ++g) {
            const auto put = [&](std::size_t row, double value) {
                std::fill_n(values.begin() + std::ptrdiff_t(row * order_ + g), nodes == 1 ? order_ : 1, value);
            };
            ContactCollision collision =
                known.size() == nodes ? std::move(known[g])
                                      : ContactCollision(reactions_, panels_[first].tick,
                                                         0.5 * (low + high) + 0.5 * (high - low) * rule_.node[g]);
            follow_reactions(collision, likely.chance, [&](std::size_t slot, const Outcome& outcome) {
                const double told[] = {outcome.peak, outcome.lasting, outcome.duration, collision.force(int(slot))};
                for (std::size_t q = 0; q < quantities; ++q) put(q * slots_ + slot, told[q]);
            });
            if (!(likely.missed > 0)) continue;
            const Outcome outcome = collision.undetected();
            const double told[] = {outcome.peak, outcome.lasting, outcome.duration};
            for (std::size_t q = 0; q < of_missed; ++q) put(quantities * slots_ + q, told[q]);
        }
        return values;
    }
    /// Puts what detections come to, from the first to the last that have a chance. Some in a row that have hardly any
    /// together are interpolated between the two beside them.
    template <class Put>
    static void follow_reactions(ContactCollision& collision, const std::vector<double>& chance, Put put) {
        std::size_t first = 0, end = chance.size();
        while (first < end && !(chance[first] > 0)) ++first;
        while (end > first && !(chance[end - 1] > 0)) --end;
        Outcome from{};
        double passed = 0;  // probability of those since the last one that was followed
        for (std::size_t i = first, before = first; i < end; ++i) {
            passed += chance[i];
            if (i > first && i + 1 < end && passed <= ContactReactions::negligible_chance) continue;
            const Outcome to = collision.detected(int(i));
            for (std::size_t k = before + 1; k < i; ++k) {
                const double share = double(k - before) / double(i - before);
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

    /// By row, how far off a value may be: times the probability of meeting it, by a share of the greatest.
    Values tolerances(const Values& values, const Likely& likely) const {
        Values allowed(quantities * slots_ + of_missed, HUGE_VAL);
        for (std::size_t q = 0; q < quantities; ++q) {
            double greatest = 0;
            const auto look = [&](std::size_t row, std::size_t rows) {
                for (std::size_t i = row * order_; i < (row + rows) * order_; ++i)
                    if (std::isfinite(values[i])) greatest = std::max(greatest, values[i]);
            };
            look(q * slots_, slots_);
            if (q < of_missed) look(quantities * slots_ + q, 1);
            if (!std::isfinite(share_[q])) continue;
            for (std::size_t i = 0; i < likely.chance.size(); ++i)
                if (likely.chance[i] > 0) allowed[q * slots_ + i] = share_[q] * greatest / likely.chance[i];
            if (q < of_missed && likely.missed > 0)
                allowed[quantities * slots_ + q] = share_[q] * greatest / likely.missed;
        }
        return allowed;
    }
    /// Are the last terms of the Legendre series small in all rows? A kink leaves more than one of them.
    bool smooth(const Values& values, const Likely& likely) const {
        const Values allowed = tolerances(values, likely);
        for (std::size_t row = 0; row < allowed.size(); ++row) {
            const double* value = &values[row * order_];
            if (!std::isfinite(allowed[row]) ||
                std::all_of(value, value + order_, [](double x) { return std::isinf(x); }))
                continue;
            double last = 0;
            for (std::size_t l = order_ - 2; l < order_; ++l) {
                double term = 0;
                for (std::size_t g = 0; g < order_; ++g) term += rule_.to_legendre(int(l), int(g)) * value[g];
                last += std::fabs(term);
            }
            if (!(2 * last <= allowed[row])) return false;
        }
        return true;
    }

    /// Tells panels what is known at the nodes of all of them as one.
    void spread(const Values& values, std::size_t first, std::size_t end) {
        const double low = panels_[first].low, width = panels_[end - 1].high - low;
        for (std::size_t p = first; p < end; ++p) {
            if (end - first > 1) {
                const OffsetPanel& panel = panels_[p];
                weigh_nodes((panel.low + panel.high - 2 * low) / width - 1, (panel.high - panel.low) / width);
            }
            const auto tell = [&](std::size_t row, double* to) {
                const double* value = &values[row * order_];
                if (end - first == 1 || std::isinf(value[0])) return void(std::copy_n(value, order_, to));
                for (std::size_t g = 0; g < order_; g += std::size_t(lanes)) {
                    T sum = 0.0;
                    for (std::size_t m = 0; m < order_; ++m) sum += value[m] * load<T>(&weight_[m * order_ + g]);
                    store(max(sum, T(0.0)), to + g);
                }
            };
            const auto by_slot = out_.by_slot();
            for (std::size_t q = 0; q < quantities; ++q)
                for (std::size_t i = 0; i < std::size_t(found_.panel[p].slots); ++i)
                    tell(q * slots_ + i, &(*by_slot[q])[(first_slot_[p] + i) * order_]);
            const auto by_panel = out_.by_panel();
            for (std::size_t q = 0; q < of_missed; ++q) tell(quantities * slots_ + q, &(*by_panel[q])[p * order_]);
        }
    }
    /// What the nodes from -1 to 1 count for at those of a part, `half` as wide, about `middle`.
    void weigh_nodes(double middle, double half) {
        weight_.resize(order_ * order_);
        for (std::size_t g = 0; g < order_; g += std::size_t(lanes)) {
            const T x = middle + half * load<T>(&rule_.node[g]);
            for (std::size_t m = 0; m < order_; ++m)
                store(legendre_series(int(order_), x, [&](int l) { return T(rule_.to_legendre(l, int(m))); }),
                      &weight_[m * order_ + g]);
        }
    }

    const ContactReactions& reactions_;
    const std::vector<OffsetPanel>& panels_;
    std::size_t order_;
    const GaussRule& rule_;
    const DetectionProbabilities& found_;
    KeptCollisions& kept_;
    ContactNodes& out_;
    std::array<double, quantities> share_{};  ///< of the greatest value, that a probable one may be off by
    std::vector<std::size_t> first_slot_;     ///< by panel
    std::vector<Travel> run_;
    std::size_t slots_ = 0;              ///< of the run
    std::vector<double> room_, weight_;  ///< weight: [node of the whole][node of the panel]
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
