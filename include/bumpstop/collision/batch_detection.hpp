/// @file
/// When a collision at an offset that varies is detected, for one pose among many.
#pragma once

#include "bumpstop/collision/batch_panels.hpp"
#include "bumpstop/collision/law_pieces.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What is needed only while a collision's detections are found. Laws that are worked out in turn share it: it stays in a
/// near cache.
struct DetectionScratch {
    std::vector<double> outcome, fired;
};

/// Clamped contact at an offset that varies, seen by a direct residual with white noise, before anything is known about
/// stopping paths. Every panel of offsets has eight nodes, which fill whole registers; alarm probabilities come from a
/// table, one polynomial for a panel; panels along a smooth stretch of the path are interpolated from a few. The object
/// keeps its memory for the next pose.
template <class T>
class BatchDetection : public BatchPanels {
  public:
    BatchDetection(const ThresholdDetector& detector, const Timing& timing, const AlarmTable& alarms,
                   const QuietTable& quiet, double stiffness, OffsetKind offset_kind, DetectionScratch& scratch)
        : BatchPanels(detector, timing, quiet, stiffness, offset_kind),
          alarms_(alarms),
          outcome_(scratch.outcome),
          fired_(scratch.fired) {
        const GaussRule& rule = gauss_rule(order);
        for (int g = 0; g < order; ++g) {
            node_[g] = rule.node[g];
            weight_[g] = rule.weight[g];
            for (int l = 0; l < order; ++l)
                half_legendre_[g][l] = rule.to_legendre[std::size_t(l) * order + g] / ((2 * l + 1) * rule.weight[g]);
        }
    }

    /// Whether laws of this kind can be had here at all.
    static bool suits(const ThresholdDetector& detector, const AlarmTable& alarms, OffsetKind offset_kind) {
        return !detector.remembers() && detector.watched > 0 && alarms.usable() && offset_kind != OffsetKind::fixed;
    }

    double false_alarm = 0, undetected = 0, no_contact = 0;  ///< as of ExactLaw
    double trigger[max_joints] = {};                         ///< joint over its threshold at the tick of detection

    /// Every offset's fate. False where the noise is too narrow for the panels; then nothing else may be asked for.
    bool collide(const LinePath& path, const OffsetLaw& offset) {
        begin();
        if (!cut_panels(path, offset)) return false;
        find_outcomes();
        weigh();
        return true;
    }

    /// Probability of a detection, before contact or after.
    double detected() const {
        double total = alarm_before_;
        for (const Panel& panel : panels_) total += panel.mass;
        return total;
    }

    /// By tick: how probable a detection there is, at most, that a stopping path matters to.
    const std::vector<double>& detection() const { return detection_; }

  protected:
    static constexpr int lanes = Scalar<T>::lanes;
    static constexpr int order = 8, registers = order / lanes;

    /// Probabilities of the offset by node, in a register row.
    void weigh_offsets(const Panel& panel, T (&row)[registers]) const {
        const double mid = 0.5 * (panel.low + panel.high), half = 0.5 * (panel.high - panel.low);
        for (int r = 0; r < registers; ++r) {
            const T o = mid + half * load<T>(node_ + r * lanes);
            row[r] = offset_.density(o) * half * load<T>(weight_ + r * lanes);
        }
    }
    static double sum(const T (&row)[registers]) {
        T all = row[0];
        for (int r = 1; r < registers; ++r) all += row[r];
        return sum_of_lanes(all);
    }

    /// What the values at the nodes of a panel are in Legendre's polynomials: the sums of their products with P_l / 2, by
    /// degree. With d from -1 to 1 on the panel, the polynomial through the densities is the sum of (2 l + 1) P_l(d) times
    /// these, and its integral from -1 on that of P_l+1(d) - P_l-1(d) times these.
    void find_series(const T (&row)[registers], double* series) const {
        alignas(64) double value[order];
        T sum[registers];
        for (int r = 0; r < registers; ++r) {
            store(row[r], value + r * lanes);
            sum[r] = 0.0;
        }
        BUMPSTOP_UNROLL
        for (int g = 0; g < order; ++g)
            for (int r = 0; r < registers; ++r) sum[r] += value[g] * load<T>(half_legendre_[g] + r * lanes);
        for (int r = 0; r < registers; ++r) store(sum[r], series + r * lanes);
    }

    double node_[order], weight_[order];
    std::vector<double> survived_;  ///< [panel][node]: never detected; given contact, then weighed
    std::vector<double> series_;    ///< [slot][degree], panel by panel: of the probability of a detection then
    std::vector<double> mass_;      ///< [slot], panel by panel: that probability, all nodes together
    double alarm_before_ = 0;       ///< probability of an alarm before contact

  private:
    static constexpr double least_survival = 1e-9;
    static constexpr int interpolated_from = 6;    ///< panels
    static constexpr std::size_t more_slots = 16;  ///< room is made for so many at a time
    static constexpr double agreement = 1e-6;      ///< of probabilities interpolated and worked out

    void begin() {
        false_alarm = undetected = no_contact = 0;
        for (double& joint : trigger) joint = 0;
        series_.clear();
        mass_.clear();
    }

    void find_outcomes() {
        outcome_.clear();
        outcome_of_.assign(panels_.size(), 0);
        survived_.assign(panels_.size() * order, 1.0);
        fired_.assign(panels_.size() * order * std::size_t(detector_.watched), 0.0);
        // Panels of a kind, tick after tick, are interpolated together; parts of ticks each with their own.
        std::vector<int>& run = run_;
        for (std::size_t first = 0; first < panels_.size();) {
            const Panel& head = panels_[first];
            std::size_t parts = 1;
            while (first + parts < panels_.size() && panels_[first + parts].part == int(parts)) ++parts;
            std::size_t end = first + parts;
            while (end + parts <= panels_.size() && alike(head, panels_[end], parts, end)) end += parts;
            for (std::size_t part = 0; part < parts; ++part) {
                run.clear();
                for (std::size_t p = first + part; p < end; p += parts) run.push_back(int(p));
                find_run(0, int(run.size()));
            }
            first = end;
        }
    }

    /// Whether the `parts` panels from `at` on are a tick's, or a group of ticks', of the same kind as `head`.
    bool alike(const Panel& head, const Panel& next, std::size_t parts, std::size_t at) const {
        return next.ticks == head.ticks && next.part == 0 && head.tick > 0 && head.ticks > 0 &&
               next.tick == panels_[at - 1].tick + head.ticks && quiet_.armed(head.tick) &&
               (parts == 1 || panels_[at + parts - 1].part == int(parts) - 1) &&
               (at + parts == panels_.size() || panels_[at + parts].part == 0);
    }

    /// Fills the panels run_[first .. end - 1].
    void find_run(int first, int end) {
        const int count = end - first;
        if (count < 2 * interpolated_from) {
            for (int i = first; i < end; ++i) find(run_[std::size_t(i)]);
            return;
        }
        const Interpolation interpolation(interpolation_nodes(first, end - 1, interpolated_from));
        const std::vector<int>& node = interpolation.nodes();
        const int check[2] = {(node[0] + node[1]) / 2, (node[2] + node[3]) / 2};
        for (int i : node) find(run_[std::size_t(i)]);
        double weight[interpolated_from];
        for (int i : check) {
            find(run_[std::size_t(i)]);
            interpolation.weights(i, weight);
            if (finished(node) && agrees(node, weight, run_[std::size_t(i)])) continue;
            const int middle = first + count / 2;
            find_run(first, middle);
            find_run(middle, end);
            return;
        }
        for (int i = first; i < end; ++i) {
            if (panels_[std::size_t(run_[std::size_t(i)])].known) continue;
            interpolation.weights(i, weight);
            interpolate(node, weight, run_[std::size_t(i)]);
        }
    }

    int longest(const std::vector<int>& node) const {
        int slots = 0;
        for (int i : node) slots = std::max(slots, panels_[std::size_t(run_[std::size_t(i)])].slots);
        return slots;
    }

    /// Everything at the nodes is detected before the path ends.
    bool finished(const std::vector<int>& node) const {
        for (int i : node) {
            const double* survived = &survived_[std::size_t(run_[std::size_t(i)]) * order];
            if (*std::max_element(survived, survived + order) > agreement) return false;
        }
        return true;
    }

    bool agrees(const std::vector<int>& node, const double* weight, int p) const {
        const Panel& panel = panels_[std::size_t(p)];
        for (int slot = 0; slot < panel.slots; ++slot) {
            for (int r = 0; r < registers; ++r) {
                T off = -load<T>(&outcome_[outcome_of_[p] + std::size_t(slot) * order + r * lanes]);
                for (int m = 0; m < interpolated_from; ++m) {
                    const int n = run_[std::size_t(node[m])];
                    if (slot < panels_[std::size_t(n)].slots)
                        off += weight[m] * load<T>(&outcome_[outcome_of_[n] + std::size_t(slot) * order + r * lanes]);
                }
                if (any(absolute(off) > T(agreement))) return false;
            }
        }
        return true;
    }

    void interpolate(const std::vector<int>& node, const double* weight, int p) {
        Panel& panel = panels_[std::size_t(p)];
        panel.known = true;
        panel.slots = std::min(longest(node), path_->ticks - panel.tick);
        outcome_of_[std::size_t(p)] = outcome_.size();
        outcome_.resize(outcome_.size() + std::size_t(panel.slots) * order);
        double* to = &outcome_[outcome_of_[std::size_t(p)]];
        const double* from[interpolated_from];
        int slots[interpolated_from], shortest = panel.slots;
        for (int m = 0; m < interpolated_from; ++m) {
            const std::size_t n = std::size_t(run_[std::size_t(node[m])]);
            from[m] = &outcome_[outcome_of_[n]];
            slots[m] = panels_[n].slots;
            shortest = std::min(shortest, slots[m]);
        }
        for (int i = 0; i < shortest * order; i += lanes) {
            T value = weight[0] * load<T>(from[0] + i);
            for (int m = 1; m < interpolated_from; ++m) value += weight[m] * load<T>(from[m] + i);
            store(value, to + i);
        }
        // What a panel knows nothing of any more adds nothing.
        for (int i = shortest * order; i < panel.slots * order; i += lanes) {
            T value = 0.0;
            for (int m = 0; m < interpolated_from; ++m)
                if (i < slots[m] * order) value += weight[m] * load<T>(from[m] + i);
            store(value, to + i);
        }
        const auto combine = [&](std::vector<double>& of_panels, int count) {
            for (int m = 0; m < interpolated_from; ++m)
                from[m] = &of_panels[std::size_t(run_[std::size_t(node[m])]) * std::size_t(count)];
            for (int i = 0; i < count; i += lanes) {
                T value = weight[0] * load<T>(from[0] + i);
                for (int m = 1; m < interpolated_from; ++m) value += weight[m] * load<T>(from[m] + i);
                store(value, &of_panels[std::size_t(p) * std::size_t(count) + std::size_t(i)]);
            }
        };
        combine(survived_, order);
        combine(fired_, order * detector_.watched);
    }

    /// Follows the offsets of a panel from tick to tick.
    void find(int p) {
        Panel& panel = panels_[std::size_t(p)];
        if (panel.known) return;
        allow_interruption();
        panel.known = true;
        outcome_of_[std::size_t(p)] = outcome_.size();
        const double mid = 0.5 * (panel.low + panel.high), half = 0.5 * (panel.high - panel.low);
        const int watched = detector_.watched;
        T offset[registers], survival[registers], waited[registers], fired[max_joints][registers];
        for (int r = 0; r < registers; ++r) {
            offset[r] = mid + half * load<T>(node_ + r * lanes);
            survival[r] = 1.0;
            waited[r] = 0.0;
            for (int f = 0; f < felt_count_; ++f) fired[f][r] = 0.0;
        }
        for (int k = panel.tick; k < path_->ticks; ++k) {
            const std::size_t at = outcome_of_[std::size_t(p)] + std::size_t(panel.slots) * order;
            if (at == outcome_.size()) outcome_.resize(at + more_slots * order);
            ++panel.slots;
            if (!quiet_.armed(k)) {
                std::fill_n(&outcome_[at], order, 0.0);
                continue;
            }
            const double s = s_tick(k);
            T alarm[registers], silent[registers], force[registers], most = 0.0;
            for (int r = 0; r < registers; ++r) {
                alarm[r] = untouched_.alarm;
                silent[r] = untouched_.silent;
                waited[r] += survival[r];
                force[r] = maximum(s - offset[r], T(0.0)) * stiffness_;
            }
            const double nearest = std::max(s - panel.high, 0.0), farthest = std::max(s - panel.low, 0.0);
            const double central = 0.5 * (nearest + farthest) * stiffness_;
            const AlarmTable::Near near = alarms_.near<T>(watched, torque_per_N(k), central);
            for (int f = 0; f < felt_count_; ++f) {
                for (int r = 0; r < registers; ++r) {
                    const T q = near.alarm(felt_[f], force[r]);
                    fired[f][r] += survival[r] * q;
                    alarm[r] += silent[r] * q;
                    silent[r] = silent[r] * (1.0 - q);
                }
            }
            for (int r = 0; r < registers; ++r) {
                store(survival[r] * alarm[r], &outcome_[at + std::size_t(r) * lanes]);
                survival[r] = survival[r] * silent[r];
                most = maximum(most, survival[r]);
            }
            if (all(most < T(least_survival))) {
                // The next ticks detect what is left. Undetected it is not: that would let the arm press on without an end.
                for (int r = 0; r < registers; ++r) {
                    double* last = &outcome_[at + std::size_t(r) * lanes];
                    store(load<T>(last) + survival[r], last);
                    survival[r] = 0.0;
                }
                break;
            }
        }
        outcome_.resize(outcome_of_[std::size_t(p)] + std::size_t(panel.slots) * order);
        for (int r = 0; r < registers; ++r) {
            store(survival[r], &survived_[std::size_t(p) * order + std::size_t(r) * lanes]);
            const auto keep = [&](int w, const T& own) {
                store(own, &fired_[(std::size_t(p) * watched + w) * order + std::size_t(r) * lanes]);
            };
            for (int w = 0; w < watched; ++w) keep(w, waited[r] * untouched_.single[std::size_t(w)]);
            for (int f = 0; f < felt_count_; ++f) keep(felt_[f], fired[f][r]);
        }
    }

    /// Joins outcomes, offsets and the silence before contact.
    void weigh() {
        const std::size_t watched = std::size_t(detector_.watched);
        const int ticks = path_->ticks;
        alarm_before_ = 0;
        contact_from_.assign(std::size_t(ticks) + 1, 0.0);
        // An alarm before contact matters if its stopping path arrives, and all of them may.
        find_beyond();
        detection_.assign(std::size_t(ticks), 0.0);
        for (int k = quiet_.unarmed(); k < ticks; ++k)
            detection_[std::size_t(k)] = quiet_.silence_before(k) * quiet_.idle().alarm * beyond_[std::size_t(k) + 1];
        std::size_t series = 0, masses = 0;
        for (Panel& panel : panels_) {
            panel.series_at = series;
            panel.mass_at = masses;
            series += std::size_t(panel.slots) * order;
            masses += std::size_t(panel.slots);
        }
        T fired_sum[max_joints][registers], undetected_sum[registers];
        for (int r = 0; r < registers; ++r) {
            undetected_sum[r] = 0.0;
            for (std::size_t w = 0; w < watched; ++w) fired_sum[w][r] = 0.0;
        }
        series_.resize(series);
        mass_.assign(masses, 0.0);
        for (std::size_t p = 0; p < panels_.size(); ++p) {
            Panel& panel = panels_[p];
            T offset[registers], weight[registers], row[registers];
            weigh_offsets(panel, offset);
            panel.total = sum(offset);
            panel.silence = quiet_.silence_before(panel.tick);
            alarm_before_ += panel.total * quiet_.alarm_before(panel.tick);
            contact_from_[std::size_t(std::min(panel.tick, ticks))] += panel.total;
            for (int r = 0; r < registers; ++r) weight[r] = offset[r] * panel.silence;
            const double* from = outcome_.data() + outcome_of_[p];
            for (int slot = 0; slot < panel.slots; ++slot) {
                const std::size_t at = std::size_t(slot) * order;
                for (int r = 0; r < registers; ++r) {
                    // Interpolation leaves a little of either sign where there is nothing.
                    row[r] = weight[r] * maximum(load<T>(from + at + std::size_t(r) * lanes), T(0.0));
                }
                double* to = &series_[panel.series_at + at];
                find_series(row, to);
                const double mass = 2 * to[0];
                mass_[panel.mass_at + std::size_t(slot)] = mass;
                detection_[std::size_t(panel.tick + slot)] += mass;
                panel.mass += mass;
            }
            for (int r = 0; r < registers; ++r) {
                double* survived = &survived_[p * order + std::size_t(r) * lanes];
                row[r] = weight[r] * load<T>(survived);
                store(row[r], survived);
                undetected_sum[r] += row[r];
                for (std::size_t w = 0; w < watched; ++w)
                    fired_sum[w][r] += weight[r] * load<T>(&fired_[(p * watched + w) * order + std::size_t(r) * lanes]);
            }
        }
        undetected = sum(undetected_sum);
        for (std::size_t w = 0; w < watched; ++w) trigger[detector_.joint[w]] = sum(fired_sum[w]);
        const double beyond = beyond_[std::size_t(ticks) + 1];
        alarm_before_ += beyond * quiet_.alarm_before(ticks);
        contact_from_.back() += beyond;
        no_contact = beyond * quiet_.silence_before(ticks);
        for (int k = 0; k < ticks; ++k)
            false_alarm += (beyond_[std::size_t(k)] - beyond_[std::size_t(k) + 1]) * quiet_.alarm_before(k);
        false_alarm += beyond_[std::size_t(ticks)] * quiet_.alarm_before(ticks);
        share_false_alarms();
    }

    /// Alarms before contact that no panel holds are split over the joints as those of idle ticks are.
    void share_false_alarms() {
        double waiting = 0;  // probability of contact after tick k
        double silent = 0;   // probability of a tick that may give one
        for (int k = path_->ticks - 1; k >= quiet_.unarmed(); --k) {
            waiting += contact_from_[std::size_t(k) + 1];
            silent += waiting * quiet_.silence_before(k);
        }
        for (int w = 0; w < detector_.watched; ++w) trigger[detector_.joint[w]] += silent * quiet_.idle().single[w];
    }

    /// The probability of an offset beyond every edge.
    void find_beyond() {
        const std::size_t edges = edge_.size();
        beyond_.resize((edges + lanes - 1) / lanes * lanes);
        std::copy(edge_.begin(), edge_.end(), beyond_.begin());
        std::fill(beyond_.begin() + std::ptrdiff_t(edges), beyond_.end(), edge_.back());
        for (std::size_t k = 0; k < edges; k += lanes)
            store(offset_.probability_beyond(load<T>(&beyond_[k])), &beyond_[k]);
    }

    const AlarmTable& alarms_;
    double half_legendre_[order][order];  ///< half_legendre_[g]: P_l / 2 at node g, by degree
    std::vector<int> run_;
    std::vector<std::size_t> outcome_of_;  ///< by panel: where its outcomes begin
    std::vector<double>& outcome_;         ///< [slot][node], panel by panel: detected then, given contact
    std::vector<double>& fired_;           ///< [panel][watched joint][node]: over its threshold when detected
    std::vector<double> contact_from_, detection_, beyond_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
