/// @file
/// The law of one pose among many: the exact law's integrals to some 1e-8, at a fraction of its price.
#pragma once

#include <optional>

#include "bumpstop/collision/law_pieces.hpp"
#include "bumpstop/collision/offset_law.hpp"
#include "bumpstop/collision/quiet_ticks.hpp"
#include "bumpstop/detection/alarm_table.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Clamped contact at an offset that varies, seen by a direct residual with white noise. Every panel of offsets has eight
/// nodes, which fill whole registers; alarm probabilities come from a table; panels along a smooth stretch of the path are
/// interpolated from a few. First `collide`, which needs no stopping path, says how probable a detection at each tick is;
/// then `stop` takes the stopping paths, and the figures may be asked for. The object keeps its memory for the next pose.
template <class T>
class BatchLaw {
  public:
    BatchLaw(const ThresholdDetector& detector, const Timing& timing, const MotionSettings& motion,
             const AlarmTable& alarms, double stiffness, OffsetKind offset_kind)
        : detector_(detector),
          timing_(timing),
          motion_(motion),
          alarms_(alarms),
          stiffness_(stiffness),
          offset_kind_(offset_kind) {
        const GaussRule& rule = gauss_rule(order);
        for (int g = 0; g < order; ++g) {
            node_[g] = rule.node[g];
            weight_[g] = rule.weight[g];
            for (int l = 0; l < order; ++l)
                half_legendre_[l][g] = rule.to_legendre[std::size_t(l) * order + g] / ((2 * l + 1) * rule.weight[g]);
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
        path_ = &path;
        offset_ = offset;
        quiet_.emplace(detector_, timing_, motion_.step, path.ticks);
        begin();
        if (!cut_panels()) return false;
        find_outcomes();
        weigh();
        return true;
    }

    /// By tick: how probable a detection there is, at most, that a stopping path matters to.
    const std::vector<double>& detection() const { return detection_; }

    /// Takes the farthest points of the stopping paths, by tick.
    void stop(const std::vector<double>& farthest) {
        farthest_ = farthest;
        // Registers may be read beyond the last tick.
        farthest_.resize(farthest.size() + std::size_t(lanes), 0.0);
        find_early_alarms();
        find_moments();
    }

    /// Mean and standard deviation of the peak force, counting the force at the end where nothing was detected.
    Moments peak_force() const { return moments_; }

    /// P(peak force > force) of detected collisions.
    TailAt tail(double force) const {
        const double depth = force / stiffness_;
        T whole = 0.0;
        TailAt sum{0, 0};
        for (const Panel& panel : panels_) {
            if (panel.mass == 0) continue;
            const T high = panel.high + depth, low = panel.low + depth;
            const double* farthest = farthest_.data() + panel.tick;
            const double* mass = &mass_[panel.mass_at];
            for (int slot = 0; slot < panel.slots; slot += lanes) {
                const T reach = load<T>(farthest + slot), here = load<T>(mass + slot);
                const auto over = reach >= high;
                whole += select(over, here, T(0.0));
                const auto cut = (reach < high) & (reach > low) & (here > T(0.0));
                if (!any(cut)) continue;
                for (int lane = 0; lane < lanes; ++lane) {
                    if (lane_of(cut, lane))
                        add_cut(&value_[panel.value_at + std::size_t(slot + lane) * order],
                                farthest[slot + lane] - depth, panel.low, panel.high, sum);
                }
            }
        }
        for (int lane = 0; lane < lanes; ++lane) sum.probability += lane_of(whole, lane);
        for (const EarlyAlarm& early : early_) {
            const double cut = early.farthest - depth;
            if (cut >= early.high) {
                sum.probability += early.mass;
            } else if (cut > early.low) {
                add_cut(early.value, cut, early.low, early.high, sum);
            }
        }
        sum.probability = std::max(0.0, sum.probability);
        sum.density = std::max(0.0, sum.density) / stiffness_;
        return sum;
    }

    /// The smallest force with P(peak force > force) + undetected <= allowed; infinite where there is none.
    double upper_quantile(double allowed) const {
        if (undetected > allowed) return std::numeric_limits<double>::infinity();
        if (tail(0.0).probability + undetected <= allowed) return 0;
        double low = 0, high = most_force_;
        const double resolution = 1e-11 * high;
        double force = std::clamp(moments_.mean, 0.0, high);
        for (int iteration = 0; iteration < 200 && high - low > resolution; ++iteration) {
            const TailAt at = tail(force);
            const double excess = at.probability + undetected - allowed;
            (excess > 0 ? low : high) = force;
            double next = 0.5 * (low + high);
            if (at.density > 0) {
                // Tails fall like a normal distribution's: their logarithm is nearer to a straight line than they are.
                const double ratio = (at.probability + undetected) / allowed;
                const double slope = at.density / (at.probability + undetected);
                const double newton =
                    force + (ratio > 2 || ratio < 0.5 ? std::log(ratio) / slope : excess / at.density);
                if (std::fabs(newton - force) <= resolution) return newton;
                if (newton > low && newton < high) next = newton;
            }
            force = next;
        }
        return force;
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;
    static constexpr int order = 8, registers = order / lanes;
    static constexpr int longest_group = 64, most_parts = 16;
    static constexpr double widest = 0.8;          ///< panel, in standard deviations of the noise
    static constexpr double widest_density = 0.5;  ///< panel, in standard deviations of the offset
    static constexpr double rare_alarm = 1e-5;     ///< at an idle tick, for a panel to hold several
    static constexpr double least_survival = 1e-13;
    static constexpr int interpolated_from = 8;  ///< panels
    static constexpr double agreement = 1e-9;    ///< of probabilities interpolated and worked out

    struct Panel {
        double low, high;
        int tick, ticks,
            part;       ///< first tick in contact; how many it holds, 0: unlike others; part of the tick's travel
        int slots = 0;  ///< ticks from the first on that may detect
        bool known = false;
        double mass = 0;  ///< probability of a detection
        std::size_t value_at = 0, mass_at = 0;
        double silence = 0, total = 0;  ///< before the panel; of the offset
    };
    /// A detection before contact whose stopping path still arrives.
    struct EarlyAlarm {
        double low, high, farthest, mass;
        double value[order];
    };

    double s_tick(int k) const { return path_->at_tick(k, timing_.period); }
    std::size_t end_step() const { return std::min(path_->s.size() - 1, std::size_t(timing_.steps)); }

    void begin() {
        const int ticks = path_->ticks;
        false_alarm = undetected = no_contact = 0;
        for (double& joint : trigger) joint = 0;
        edge_.resize(std::size_t(ticks) + 2);
        edge_[0] = 0;
        for (int k = 0; k < ticks; ++k) edge_[k + 1] = std::max(edge_[k], s_tick(k));
        const auto end = path_->s.begin() + std::ptrdiff_t(end_step()) + 1;
        edge_[ticks + 1] = std::max(edge_[ticks], *std::max_element(path_->s.begin(), end));
        panels_.clear();
        value_.clear();
        mass_.clear();
        early_.clear();
    }

    /// Panels end where a tick comes into contact. Where the arm moves slowly one holds 2, 4, 8 ... ticks, where it moves
    /// fast a tick's travel is cut into as many.
    bool cut_panels() {
        const int ticks = path_->ticks;
        double gain = 0;  // of the residual in standard deviations, per metre
        for (int k = 0; k < ticks; ++k) {
            for (int w = 0; w < detector_.watched; ++w)
                gain = std::max(gain, std::fabs(path_->torque_per_N[std::size_t(k) * path_->dof + detector_.joint[w]]) *
                                          stiffness_ / detector_.sd[w]);
        }
        double width = gain > 0 ? widest / gain : std::numeric_limits<double>::infinity();
        if (offset_kind_ == OffsetKind::half_normal) width = std::min(width, widest_density * offset_.size);
        const double largest = offset_.largest();
        const bool rare = ticks > 0 && quiet_->idle(ticks - 1).alarm < rare_alarm;
        for (int k = 0; k < ticks && edge_[k] < largest;) {
            int group = 1, parts = 1;
            while (rare && k > 0 && group < longest_group && k + 2 * group <= ticks &&
                   edge_[k + 2 * group] - edge_[k] <= width)
                group *= 2;
            const double low = edge_[k], high = std::min(edge_[k + group], largest);
            while ((high - low) > parts * width) parts *= 2;
            if (parts > most_parts) return false;
            // One that the end of the offsets cuts short is like no other.
            const int whole = edge_[k + group] <= largest ? group : 0;
            for (int part = 0; part < parts && high > low; ++part)
                panels_.push_back(
                    {low + (high - low) * part / parts, low + (high - low) * (part + 1) / parts, k, whole, part});
            k += group;
        }
        add_end_panels(edge_[ticks], edge_[ticks + 1], ticks);
        return true;
    }

    void add_end_panels(double low, double high, int tick) {
        high = std::min(high, offset_.largest());
        if (!(high > low)) return;
        int pieces = 1;
        if (offset_kind_ == OffsetKind::half_normal)
            pieces = std::max(1, int(std::ceil((high - low) / (widest_density * offset_.size))));
        for (int i = 0; i < pieces; ++i)
            panels_.push_back({low + (high - low) * i / pieces, low + (high - low) * (i + 1) / pieces, tick, 0, 0});
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
               next.tick == panels_[at - 1].tick + head.ticks && quiet_->armed(head.tick) &&
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
        const int check[2] = {(node[0] + node[1]) / 2, (node[3] + node[4]) / 2};
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
        outcome_.resize(outcome_.size() + std::size_t(panel.slots) * order, 0.0);
        double* to = &outcome_[outcome_of_[std::size_t(p)]];
        for (int m = 0; m < interpolated_from; ++m) {
            const int n = run_[std::size_t(node[m])];
            const double* from = &outcome_[outcome_of_[n]];
            const int size = std::min(panel.slots, panels_[std::size_t(n)].slots) * order;
            for (int i = 0; i < size; i += lanes) store(load<T>(to + i) + weight[m] * load<T>(from + i), to + i);
        }
        const std::size_t watched = std::size_t(detector_.watched);
        for (int i = 0; i < order; ++i) survived_[std::size_t(p) * order + i] = 0;
        for (int m = 0; m < interpolated_from; ++m) {
            const std::size_t n = std::size_t(run_[std::size_t(node[m])]);
            for (std::size_t i = 0; i < order; ++i)
                survived_[std::size_t(p) * order + i] += weight[m] * survived_[n * order + i];
            for (std::size_t i = 0; i < order * watched; ++i)
                fired_[std::size_t(p) * order * watched + i] += weight[m] * fired_[n * order * watched + i];
        }
    }

    /// Follows the offsets of a panel from tick to tick.
    void find(int p) {
        Panel& panel = panels_[std::size_t(p)];
        if (panel.known) return;
        panel.known = true;
        outcome_of_[std::size_t(p)] = outcome_.size();
        const double mid = 0.5 * (panel.low + panel.high), half = 0.5 * (panel.high - panel.low);
        const int watched = detector_.watched;
        T offset[registers], survival[registers], fired[max_joints][registers];
        for (int r = 0; r < registers; ++r) {
            offset[r] = mid + half * load<T>(node_ + r * lanes);
            survival[r] = 1.0;
            for (int w = 0; w < watched; ++w) fired[w][r] = 0.0;
        }
        for (int k = panel.tick; k < path_->ticks; ++k) {
            const std::size_t at = outcome_.size();
            outcome_.resize(at + order);
            ++panel.slots;
            if (!quiet_->armed(k)) {
                std::fill_n(&outcome_[at], order, 0.0);
                continue;
            }
            const double s = s_tick(k);
            const double* torque = &path_->torque_per_N[std::size_t(k) * path_->dof];
            T alarm[registers], silent[registers], force[registers], most = 0.0;
            for (int r = 0; r < registers; ++r) {
                alarm[r] = 0.0;
                silent[r] = 1.0;
                force[r] = maximum(s - offset[r], T(0.0)) * stiffness_;
            }
            for (int w = 0; w < watched; ++w) {
                const double a = torque[detector_.joint[w]];
                for (int r = 0; r < registers; ++r) {
                    const T q = alarms_.alarm(w, a * force[r]);
                    fired[w][r] += survival[r] * q;
                    alarm[r] += silent[r] * q;
                    silent[r] = silent[r] * (1.0 - q);
                }
            }
            for (int r = 0; r < registers; ++r) {
                store(survival[r] * alarm[r], &outcome_[at + std::size_t(r) * lanes]);
                survival[r] = survival[r] * silent[r];
                most = maximum(most, survival[r]);
            }
            if (all(most < T(least_survival))) break;
        }
        for (int r = 0; r < registers; ++r) {
            store(survival[r], &survived_[std::size_t(p) * order + std::size_t(r) * lanes]);
            for (int w = 0; w < watched; ++w)
                store(fired[w][r], &fired_[(std::size_t(p) * watched + w) * order + std::size_t(r) * lanes]);
        }
    }

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
        double total = 0;
        for (int lane = 0; lane < lanes; ++lane) total += lane_of(all, lane);
        return total;
    }

    /// Joins outcomes, offsets and the silence before contact.
    void weigh() {
        const std::size_t watched = std::size_t(detector_.watched);
        const int ticks = path_->ticks;
        alarm_before_ = 0;
        contact_from_.assign(std::size_t(ticks) + 1, 0.0);
        // An alarm before contact matters if its stopping path arrives, and all of them may.
        detection_.resize(std::size_t(ticks));
        for (int k = 0; k < ticks; ++k)
            detection_[std::size_t(k)] = quiet_->silence_before(k) * quiet_->idle(k).alarm *
                                         offset_.probability_beyond(edge_[std::size_t(k) + 1]);
        std::size_t values = 0, masses = 0;
        for (Panel& panel : panels_) {
            panel.value_at = values;
            panel.mass_at = masses;
            values += std::size_t(panel.slots) * order;
            masses += std::size_t(panel.slots + lanes);  // registers may be read beyond the last
        }
        value_.resize(values);
        mass_.assign(masses, 0.0);
        for (std::size_t p = 0; p < panels_.size(); ++p) {
            Panel& panel = panels_[p];
            T offset[registers], weight[registers], row[registers];
            weigh_offsets(panel, offset);
            panel.total = sum(offset);
            panel.silence = quiet_->silence_before(panel.tick);
            alarm_before_ += panel.total * quiet_->alarm_before(panel.tick);
            contact_from_[std::size_t(std::min(panel.tick, ticks))] += panel.total;
            for (int r = 0; r < registers; ++r) weight[r] = offset[r] * panel.silence;
            const double* from = outcome_.data() + outcome_of_[p];
            for (int slot = 0; slot < panel.slots; ++slot) {
                const std::size_t at = std::size_t(slot) * order;
                for (int r = 0; r < registers; ++r) {
                    // Interpolation leaves a little of either sign where there is nothing.
                    row[r] = weight[r] * maximum(load<T>(from + at + std::size_t(r) * lanes), T(0.0));
                    store(row[r], &value_[panel.value_at + at + std::size_t(r) * lanes]);
                }
                const double mass = sum(row);
                mass_[panel.mass_at + std::size_t(slot)] = mass;
                detection_[std::size_t(panel.tick + slot)] += mass;
                panel.mass += mass;
            }
            for (int r = 0; r < registers; ++r)
                row[r] = weight[r] * load<T>(&survived_[p * order + std::size_t(r) * lanes]);
            for (int r = 0; r < registers; ++r) store(row[r], &survived_[p * order + std::size_t(r) * lanes]);
            undetected += sum(row);
            for (std::size_t w = 0; w < watched; ++w) {
                for (int r = 0; r < registers; ++r)
                    row[r] = weight[r] * load<T>(&fired_[(p * watched + w) * order + std::size_t(r) * lanes]);
                trigger[detector_.joint[w]] += sum(row);
            }
        }
        const double beyond = offset_.probability_beyond(edge_.back());
        alarm_before_ += beyond * quiet_->alarm_before(ticks);
        contact_from_.back() += beyond;
        no_contact = beyond * quiet_->silence_before(ticks);
        for (int k = 0; k < ticks; ++k)
            false_alarm += (offset_.probability_beyond(edge_[k]) - offset_.probability_beyond(edge_[k + 1])) *
                           quiet_->alarm_before(k);
        false_alarm += offset_.probability_beyond(edge_[ticks]) * quiet_->alarm_before(ticks);
        share_false_alarms();
    }

    /// Alarms before contact that no panel holds are split over the joints as those of idle ticks are.
    void share_false_alarms() {
        double waiting = 0;  // probability of contact after tick k
        for (int k = path_->ticks - 1; k >= 0; --k) {
            waiting += contact_from_[std::size_t(k) + 1];
            if (!quiet_->armed(k)) continue;
            const double here = waiting * quiet_->silence_before(k);
            for (int w = 0; w < detector_.watched; ++w) trigger[detector_.joint[w]] += here * quiet_->idle(k).single[w];
        }
    }

    /// Alarms before contact whose stopping path reaches the body.
    void find_early_alarms() {
        const int ticks = path_->ticks;
        double touching = 0;
        if (quiet_->alarm_before(ticks) > 0) {
            // By tick: the farthest any stopping path gets that begins there or earlier.
            farthest_yet_.assign(farthest_.begin(), farthest_.begin() + ticks);
            for (int k = 1; k < ticks; ++k)
                farthest_yet_[std::size_t(k)] =
                    std::max(farthest_yet_[std::size_t(k)], farthest_yet_[std::size_t(k) - 1]);
            const std::size_t reached = panels_.size();
            add_end_panels(edge_.back(), farthest_yet_.back(), ticks + 1);
            for (const Panel& panel : panels_) {
                T offset[registers];
                weigh_offsets(panel, offset);
                for (int k = std::min(panel.tick, ticks) - 1; k >= 0 && farthest_yet_[std::size_t(k)] > panel.low;
                     --k) {
                    if (!quiet_->armed(k) || !(farthest_[std::size_t(k)] > panel.low)) continue;
                    const double chance = quiet_->silence_before(k) * quiet_->idle(k).alarm;
                    EarlyAlarm early{panel.low, panel.high, farthest_[std::size_t(k)], sum(offset) * chance, {}};
                    for (int r = 0; r < registers; ++r) store(offset[r] * chance, early.value + r * lanes);
                    touching += early.mass;
                    early_.push_back(early);
                }
            }
            panels_.resize(reached);
        }
        harmless_ = std::max(0.0, alarm_before_ - touching) + no_contact;
    }

    void find_moments() {
        // About a value near the mean, so that a narrow law far from zero keeps its digits.
        double about = 0, mass = 0;
        most_force_ = 0;
        auto each = [&](auto use) {
            for (const Panel& panel : panels_) {
                if (panel.mass == 0) continue;
                for (int slot = 0; slot < panel.slots; ++slot)
                    use(panel, &value_[panel.value_at + std::size_t(slot) * order],
                        mass_[panel.mass_at + std::size_t(slot)], farthest_[std::size_t(panel.tick + slot)]);
            }
        };
        each([&](const Panel& panel, const double*, double here, double farthest) {
            if (here == 0) return;
            about += here * std::max(0.0, farthest - 0.5 * (panel.low + panel.high));
            mass += here;
            most_force_ = std::max(most_force_, stiffness_ * (farthest - panel.low));
        });
        for (const EarlyAlarm& early : early_) {
            mass += early.mass;
            most_force_ = std::max(most_force_, stiffness_ * (early.farthest - early.low));
        }
        about = mass > 0 ? stiffness_ * about / mass : 0;
        T first = 0.0, second = 0.0;
        auto add = [&](const double* value, double low, double high, double farthest) {
            const double mid = 0.5 * (low + high), half = 0.5 * (high - low);
            for (int r = 0; r < registers; ++r) {
                const T offset = mid + half * load<T>(node_ + r * lanes);
                const T force = maximum(stiffness_ * (farthest - offset), T(0.0)) - about;
                const T weighted = load<T>(value + r * lanes) * force;
                first += weighted;
                second += weighted * force;
            }
        };
        each([&](const Panel& panel, const double* value, double here, double farthest) {
            if (here != 0) add(value, panel.low, panel.high, farthest);
        });
        for (const EarlyAlarm& early : early_) add(early.value, early.low, early.high, early.farthest);
        if (undetected > 0) {
            const double end = path_->ticks > 0 ? path_->s[end_step()] : 0;
            for (std::size_t p = 0; p < panels_.size(); ++p)
                add(&survived_[p * order], panels_[p].low, panels_[p].high, end);
        }
        double sum1 = -harmless_ * about, sum2 = harmless_ * about * about, total = mass + harmless_ + undetected;
        for (int lane = 0; lane < lanes; ++lane) {
            sum1 += lane_of(first, lane);
            sum2 += lane_of(second, lane);
        }
        const double offset = sum1 / total;
        moments_ = {about + offset, std::sqrt(std::max(0.0, sum2 / total - offset * offset))};
    }

    /// Adds what lies below `cut` of a panel's values at the nodes.
    void add_cut(const double* value, double cut, double low, double high, TailAt& to) const {
        const double half = 0.5 * (high - low), x = (cut - 0.5 * (low + high)) / half;
        // The interpolating polynomial is a Legendre series; P_l integrates to (P_l+1 - P_l-1) / (2l + 1).
        T integral[registers], density[registers];
        for (int r = 0; r < registers; ++r) {
            integral[r] = T(0.5 * (x + 1));
            density[r] = 0.5;
        }
        double below = 1, here = x;
        for (int l = 1; l < order; ++l) {
            const double above = legendre_factors.rise[l] * x * here - legendre_factors.fall[l] * below;
            for (int r = 0; r < registers; ++r) {
                const T p = load<T>(half_legendre_[l] + r * lanes);
                integral[r] += (above - below) * p;
                density[r] += ((2 * l + 1) * here) * p;
            }
            below = here;
            here = above;
        }
        for (int r = 0; r < registers; ++r) {
            const T v = load<T>(value + r * lanes);
            integral[r] = integral[r] * v;
            density[r] = density[r] * v;
        }
        to.probability += std::max(0.0, sum(integral));
        to.density += sum(density) / half;
    }

    const ThresholdDetector& detector_;
    const Timing& timing_;
    const MotionSettings& motion_;
    const AlarmTable& alarms_;
    const double stiffness_;
    const OffsetKind offset_kind_;
    double node_[order], weight_[order], half_legendre_[order][order];  ///< half_legendre_[l]: P_l / 2 at the nodes

    const LinePath* path_ = nullptr;
    OffsetLaw offset_;
    std::optional<QuietTicks> quiet_;
    std::vector<double> edge_;  ///< panel of tick k: edge_[k]..edge_[k + 1]
    std::vector<Panel> panels_;
    std::vector<int> run_;
    std::vector<std::size_t> outcome_of_;  ///< by panel: where its outcomes begin
    std::vector<double> outcome_;          ///< [slot][node], panel by panel: detected then, given contact
    std::vector<double> survived_;         ///< [panel][node]: never detected; given contact, then weighed
    std::vector<double> fired_;            ///< [panel][watched joint][node]: over its threshold when detected
    std::vector<double> value_;            ///< [slot][node], panel by panel: probability
    std::vector<double> mass_;             ///< [slot], panel by panel: the same, all nodes together
    std::vector<double> contact_from_, detection_, farthest_, farthest_yet_;
    std::vector<EarlyAlarm> early_;
    double alarm_before_ = 0, harmless_ = 0, most_force_ = 0;
    Moments moments_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
