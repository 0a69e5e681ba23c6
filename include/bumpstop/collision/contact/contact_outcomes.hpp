/// @file
/// Outcomes of detected and undetected collisions of an elastic arm, or with a body that moves, at the nodes of panels.
#pragma once

#include "bumpstop/collision/contact/detection_outcomes.hpp"
#include "bumpstop/collision/distribution/detection_probabilities.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Quantities at the Gauss nodes of a density's panels: by detection slot, and of undetected collisions.
struct ContactNodes {
    std::vector<double> peak_force, lasting_force, duration, force_at_detection;  ///< [slot][node] [N, N, s, N]
    /// [panel][node] [N, N, s]
    std::vector<double> undetected_peak_force, undetected_lasting_force, undetected_duration;
    bool gives_way = false;  ///< dynamic contact: these hold, not the forces of a rigid arm on a spring
    bool pressed = false;    ///< undetected, a held body is pressed on by an arm that has not come to rest
    bool kinks = false;      ///< of an elastic arm: from some offset on a later peak is the greatest

    static constexpr std::size_t quantities = 4, undetected_quantities = 3;
    std::array<std::vector<double>*, quantities> by_slot() {
        return {&peak_force, &lasting_force, &duration, &force_at_detection};
    }
    std::array<std::vector<double>*, undetected_quantities> by_panel() {
        return {&undetected_peak_force, &undetected_lasting_force, &undetected_duration};
    }
};

/// Collisions that detection has simulated, by panel and node, for their outcomes; as many as the memory allows.
struct CollisionCache {
    std::vector<std::vector<ContactCollision>> of_panel;
    std::size_t room = 50'000;  ///< ticks, of a few hundred bytes each

    explicit CollisionCache(std::size_t panels) : of_panel(panels) {}
    /// Adds further nodes of panel p, each of so many ticks. A panel that lacks some of its nodes is simulated anew.
    void add(std::size_t p, std::size_t ticks, std::vector<ContactCollision>& collisions) {
        const std::size_t size = ticks * collisions.size();
        room -= std::min(room, size);
        if (room > 0) std::move(collisions.begin(), collisions.end(), std::back_inserter(of_panel[p]));
    }
};

/// Finds these quantities. Panels are narrow because the probability of detection varies fast with the offset; outcomes
/// vary more slowly. So reactions are simulated at the nodes of all offsets first touched at one tick, as if they were
/// a single panel, and at a few of many such ticks. The rest is interpolated, where the last terms of the Legendre
/// series are small and two ticks in between agree; else halves are tried, down to the panels themselves.
template <class T>
class ContactOutcomes {
  public:
    ContactOutcomes(const ContactReactions& reactions, const std::vector<OffsetPanel>& panels, int order,
                    const DetectionProbabilities& found, CollisionCache& cache, ContactNodes& out)
        : reactions_(reactions),
          panels_(panels),
          order_(std::size_t(order)),
          rule_(gauss_rule(order)),
          found_(found),
          cache_(cache),
          out_(out) {}

    void operator()() {
        const bool elastic = out_.kinks = reactions_.elastic();
        // The reference is straight within a simulation step, which leaves kinks of this size in the outcomes. An
        // elastic arm bounces: its time in contact is no smooth function of the offset.
        const double of_force = elastic ? 1e-4 : 2e-5;
        share_ = {of_force, of_force, elastic ? 0.1 : 5e-5, of_force};
        if (reactions_.peak_only()) share_ = {of_force, HUGE_VAL, HUGE_VAL, HUGE_VAL};
        std::size_t slots = 0;
        for (const DetectionProbabilities::Panel& panel : found_.panel) {
            first_slot_.push_back(slots);
            slots += std::size_t(panel.slots);
        }
        for (std::vector<double>* values : out_.by_slot()) values->assign(slots * order_, 0.0);
        for (std::vector<double>* values : out_.by_panel()) values->assign(panels_.size() * order_, 0.0);
        // Outcomes of a free body change abruptly at some ends of panels: only like parts of ticks make a run then.
        const bool in_parts = reactions_.dynamics().propagator().gets_away;
        for (std::size_t first = 0; first < panels_.size();) {
            const std::size_t panels = tick_end(first) - first, width = in_parts ? 1 : panels;
            std::size_t end = first + panels;
            while (end < panels_.size() && continues(end - 1, end) && (!in_parts || tick_end(end) - end == panels))
                end = tick_end(end);
            for (std::size_t part = 0; part < panels; part += width) {
                run_.clear();
                slots_ = 0;
                for (std::size_t p = first; p < end; p = tick_end(p))
                    add_tick(p + part, in_parts ? p + part + 1 : tick_end(p));
                find_run(0, run_.size());
            }
            first = end;
        }
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;
    static constexpr double negligible_survival = 1e-18;  ///< less may be an error of interpolation
    static constexpr std::size_t quantities = ContactNodes::quantities,
                                 undetected_quantities = ContactNodes::undetected_quantities;
    using Outcome = ContactCollision::Outcome;
    /// [row][node]: rows by quantity and slot, then those of undetected collisions.
    using Values = std::vector<double>;

    /// The greatest probabilities among some offsets.
    struct MaxProbability {
        std::vector<double> detected;  ///< by slot
        double undetected = 0;

        void include(const MaxProbability& other) {
            detected.resize(std::max(detected.size(), other.detected.size()), 0.0);
            for (std::size_t i = 0; i < other.detected.size(); ++i)
                detected[i] = std::max(detected[i], other.detected[i]);
            undetected = std::max(undetected, other.undetected);
        }
    };
    /// Panels of the offsets that are first touched at one tick, or at a group of ticks.
    struct TickPanels {
        std::size_t first, end;
        MaxProbability probability;
        Values values;  ///< at the nodes of all of them as a single panel, once simulated
    };

    void add_tick(std::size_t first, std::size_t end) {
        TickPanels tick{first, end, {}, {}};
        for (std::size_t p = first; p < end; ++p) {
            MaxProbability own{std::vector<double>(std::size_t(found_.panel[p].slots), 0.0)};
            const double* detected = found_.by_slot<T>(found_.detected, p, order_, room_);
            for (double& chance : own.detected) {
                chance = *std::max_element(detected, detected + order_);
                detected += order_;
            }
            const double* survived = found_.by_panel<T>(found_.survived, p, order_, room_);
            own.undetected = *std::max_element(survived, survived + order_);
            tick.probability.include(own);
        }
        slots_ = std::max(slots_, tick.probability.detected.size());
        run_.push_back(std::move(tick));
    }
    /// Behind the last panel of the same tick.
    std::size_t tick_end(std::size_t first) const {
        std::size_t end = first;
        while (end < panels_.size() && panels_[end].tick == panels_[first].tick) ++end;
        return end;
    }
    /// Whether panel p begins the group of ticks after that of panel `before`, and has as many ticks.
    bool continues(std::size_t before, std::size_t p) const {
        const OffsetPanel &last = panels_[before], &next = panels_[p];
        return last.tick > 0 && last.ticks > 0 && next.ticks == last.ticks && next.tick == last.tick + last.ticks;
    }

    /// The ticks run_[first .. end - 1].
    void find_run(std::size_t first, std::size_t end) {
        constexpr std::size_t fewest = 6;
        if (end - first < fewest) {
            for (std::size_t i = first; i < end; ++i) find_tick(run_[i]);
            return;
        }
        MaxProbability probability;
        for (std::size_t i = first; i < end; ++i) probability.include(run_[i].probability);
        const int low = int(first), high = int(end) - 1, middle = (low + high) / 2;
        const Interpolation interpolation(std::vector{low, middle, high});
        if (agree(interpolation, probability)) {
            for (std::size_t i = first; i < end; ++i)
                interpolate_to_panels(interpolated(interpolation, int(i)), run_[i].first, run_[i].end);
            return;
        }
        // The halves share the tick in the middle, which is not simulated again.
        find_run(first, std::size_t(middle) + 1);
        find_run(std::size_t(middle), end);
    }
    /// Whether values interpolated from the ticks at the nodes agree with those of two ticks between them.
    bool agree(const Interpolation& interpolation, const MaxProbability& probability) {
        // Where the end of the motion decides what stays undetected, nothing is smooth from tick to tick.
        const double negligible = reactions_.peak_only() ? ContactReactions::negligible_chance : negligible_survival;
        if (reactions_.paths().path->end != PathEnd::all_detected && probability.undetected > negligible) return false;
        const std::vector<int>& node = interpolation.nodes();
        for (int i : node)
            if (!represents_panels(run_[std::size_t(i)], probability) ||
                !separate_alike(run_[std::size_t(node[0])], run_[std::size_t(i)]))
                return false;
        for (int i : {(node[0] + node[1]) / 2, (node[1] + node[2]) / 2}) {
            const Values& direct = values_of(run_[std::size_t(i)], probability);
            const Values mixed = interpolated(interpolation, i),
                         allowed = tolerances(direct, run_[std::size_t(i)].probability);
            // The errors of all slots together may not exceed the tolerance either.
            Values off(quantities * order_, 0.0);
            for (std::size_t row = 0; row < allowed.size(); ++row) {
                if (std::isinf(allowed[row])) continue;
                const std::size_t q = row < quantities * slots_ ? row / slots_ : row - quantities * slots_;
                for (std::size_t g = 0; g < order_; ++g) {
                    const double a = mixed[row * order_ + g], b = direct[row * order_ + g],
                                 share = a == b ? 0.0 : (a - b) / allowed[row];
                    if (!(std::fabs(share) <= 1)) return false;
                    off[q * order_ + g] += share;
                }
            }
            if (std::any_of(off.begin(), off.end(), [](double share) { return std::fabs(share) > 1; })) return false;
        }
        return true;
    }
    /// Whether a free body has separated at the same slots of two ticks: it is not detected from then on, and
    /// interpolation cannot show at which of the ticks between them that begins.
    bool separate_alike(const TickPanels& one, const TickPanels& other) const {
        if (!reactions_.dynamics().propagator().gets_away) return true;
        const auto force = [&](const TickPanels& tick) {  // at detection, the last of the quantities
            return tick.values.begin() + std::ptrdiff_t((quantities - 1) * slots_ * order_);
        };
        return std::equal(force(one), force(one) + std::ptrdiff_t(slots_ * order_), force(other),
                          [](double a, double b) { return (a > 0) == (b > 0); });
    }
    Values interpolated(const Interpolation& interpolation, int place) const {
        double weight[DetectionProbabilities::max_nodes];
        interpolation.weights(double(place), weight);
        Values sum((quantities * slots_ + undetected_quantities) * order_, 0.0);
        for (int m = 0; m < interpolation.size(); ++m) {
            const Values& node = run_[std::size_t(interpolation.nodes()[std::size_t(m)])].values;
            for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += weight[m] * node[i];
        }
        for (double& value : sum)
            if (!std::isfinite(value)) value = HUGE_VAL;
        return sum;
    }

    void find_tick(TickPanels& tick) {
        if (represents_panels(tick, tick.probability))
            interpolate_to_panels(tick.values, tick.first, tick.end);
        else
            find_halves(tick.first, tick.end, tick.probability);
    }
    void find_halves(std::size_t first, std::size_t end, const MaxProbability& probability) {
        const std::size_t middle = (first + end) / 2;
        for (const auto& [a, b] : {std::pair(first, middle), std::pair(middle, end)}) {
            const Values values = simulate(a, b, probability);
            if (b - a == 1 || smooth(values, probability))
                interpolate_to_panels(values, a, b);
            else
                find_halves(a, b, probability);
        }
    }
    /// Whether values at the nodes of all panels of a tick as one are smooth enough to interpolate those of each.
    bool represents_panels(TickPanels& tick, const MaxProbability& probability) {
        const Values& values = values_of(tick, probability);
        return tick.end - tick.first == 1 || smooth(values, tick.probability);
    }
    const Values& values_of(TickPanels& tick, const MaxProbability& probability) {
        if (tick.values.empty()) tick.values = simulate(tick.first, tick.end, probability);
        return tick.values;
    }

    /// Values at the nodes of panels taken as one, of outcomes that have a probability.
    Values simulate(std::size_t first, std::size_t end, const MaxProbability& probability) {
        Values values((quantities * slots_ + undetected_quantities) * order_, 0.0);
        const double low = panels_[first].low, high = panels_[end - 1].high;
        // Where all nodes have the same offset, one is simulated for all.
        const std::size_t nodes = low == high ? 1 : order_;
        const auto set = [&](std::size_t row, std::size_t g, double value) {
            std::fill_n(values.begin() + std::ptrdiff_t(row * order_ + g), nodes == 1 ? order_ : 1, value);
        };
        std::vector<ContactCollision> collisions;
        if (end - first == 1 && cache_.of_panel[first].size() == nodes) collisions = std::move(cache_.of_panel[first]);
        const LinePath& path = *reactions_.paths().path;
        const int tick = panels_[first].tick, period = reactions_.paths().period,
                  known = std::min(tick, path.ticks - 1);
        const double at_tick = path.at_tick(known, period),
                     advance = known > 0 ? at_tick - path.at_tick(known - 1, period) : at_tick * period;
        std::vector<double> touch;
        for (std::size_t g = 0; g < nodes; ++g) {
            const double offset = 0.5 * (low + high) + 0.5 * (high - low) * rule_.node[g];
            touch.push_back(advance > 0 ? (offset - at_tick) / advance : 0.0);
            if (collisions.size() == g) collisions.emplace_back(reactions_, tick, offset);
        }
        // The swing of an arm takes longer than this [s].
        constexpr double swing = 0.02;
        // Bodies that are touched in other ticks may be met at other speeds.
        const bool alike = advance > 0 && high - low <= (1 + 1e-9) * advance;
        // Outcomes of a rigid arm are smoother: a smaller error costs next to nothing.
        std::array<double, quantities> share = share_;
        if (!reactions_.elastic())
            for (double& each : share) each *= 0.1;
        DetectionOutcomes detections(probability.detected, share.data(),
                                     reactions_.peak_only() ? ContactReactions::negligible_chance : 0.0,
                                     alike ? swing / (reactions_.paths().step * period) : 0.0);
        detections(collisions, touch, [&](const DetectionOutcomes::Detection& at, const auto& outcome) {
            for (std::size_t q = 0; q < DetectionOutcomes::quantities; ++q)
                set(q * slots_ + at.slot, at.node, outcome[q]);
            set(DetectionOutcomes::quantities * slots_ + at.slot, at.node, collisions[at.node].force(int(at.slot)));
        });
        if (!(probability.undetected > 0)) return values;
        for (std::size_t g = 0; g < nodes; ++g) {
            const Outcome outcome = collisions[g].undetected();
            const double value[] = {outcome.peak, outcome.lasting, outcome.duration};
            for (std::size_t q = 0; q < undetected_quantities; ++q) set(quantities * slots_ + q, g, value[q]);
        }
        return values;
    }

    /// By row, the allowed error of a value: times its probability it is a share of the greatest value.
    Values tolerances(const Values& values, const MaxProbability& probability) const {
        Values allowed(quantities * slots_ + undetected_quantities, HUGE_VAL);
        for (std::size_t q = 0; q < quantities; ++q) {
            double greatest = 0;
            const auto include = [&](std::size_t row, std::size_t rows) {
                for (std::size_t i = row * order_; i < (row + rows) * order_; ++i)
                    if (std::isfinite(values[i])) greatest = std::max(greatest, values[i]);
            };
            include(q * slots_, slots_);
            if (q < undetected_quantities) include(quantities * slots_ + q, 1);
            if (!std::isfinite(share_[q])) continue;
            for (std::size_t i = 0; i < probability.detected.size(); ++i)
                if (probability.detected[i] > 0)
                    allowed[q * slots_ + i] = share_[q] * greatest / probability.detected[i];
            if (q < undetected_quantities && probability.undetected > 0)
                allowed[quantities * slots_ + q] = share_[q] * greatest / probability.undetected;
        }
        return allowed;
    }
    /// Whether the last two terms of the Legendre series are small in all rows; a kink makes one of them large.
    bool smooth(const Values& values, const MaxProbability& probability) const {
        const Values allowed = tolerances(values, probability);
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

    /// Writes values at the nodes of panels as one to the nodes of each.
    void interpolate_to_panels(const Values& values, std::size_t first, std::size_t end) {
        const double low = panels_[first].low, width = panels_[end - 1].high - low;
        for (std::size_t p = first; p < end; ++p) {
            if (end - first > 1) {
                const OffsetPanel& panel = panels_[p];
                set_weights((panel.low + panel.high - 2 * low) / width - 1, (panel.high - panel.low) / width);
            }
            const auto write = [&](std::size_t row, double* to) {
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
                    write(q * slots_ + i, &(*by_slot[q])[(first_slot_[p] + i) * order_]);
            const auto by_panel = out_.by_panel();
            for (std::size_t q = 0; q < undetected_quantities; ++q)
                write(quantities * slots_ + q, &(*by_panel[q])[p * order_]);
        }
    }
    /// Interpolation weights from the nodes on [-1, 1] to those on [middle - half, middle + half].
    void set_weights(double middle, double half) {
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
    CollisionCache& cache_;
    ContactNodes& out_;
    std::array<double, quantities> share_{};  ///< allowed error of a certain value, as a share of the greatest
    std::vector<std::size_t> first_slot_;     ///< by panel
    std::vector<TickPanels> run_;
    std::size_t slots_ = 0;              ///< of the run
    std::vector<double> room_, weight_;  ///< weight: [node of the whole][node of the panel]
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
