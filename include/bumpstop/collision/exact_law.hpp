/// @file
/// The exact law: the distribution over contact offset and sensor noise, integrated instead of sampled.
#pragma once

#include <optional>

#include "bumpstop/collision/known_outcomes.hpp"
#include "bumpstop/collision/law_pieces.hpp"
#include "bumpstop/collision/panel_cutter.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct ExactLaw {
    LawPieces pieces;
    LawQuantity peak_force;  ///< of detected collisions, and where the arm comes to rest of the others, too [N]
    LawQuantity force_at_detection, detection_delay;  ///< of detected collisions [N, s]
    LawQuantity end_force;                            ///< of collisions never detected, greatest by the end [N]
    bool rests = false;               ///< the arm comes to rest where its path ends, so that `end_force` has a bound
    double detected = 0;              ///< before contact or after, of clamped contact
    double false_alarm = 0;           ///< detection before contact
    double harmless = 0;              ///< of those, and of motions that end before contact: no force at all
    double undetected = 0;            ///< contact, and no detection by the end of the motion
    double no_contact = 0;            ///< the motion ends before contact, no alarm
    double several = 0;               ///< two or more joints over their threshold at the tick of detection
    double trigger[max_joints] = {};  ///< joint over its threshold at the tick of detection
    FreeNodes free;                   ///< of free contact, instead of the forces above
    FreeAlarms free_alarms;           ///< of free contact: detections before it
    bool interpolated = false;        ///< detection probabilities come from a few panels

    /// Probability of collisions never detected whose force has no bound: they count as over every limit.
    double unbounded() const { return rests ? 0 : undetected; }
};

/// P(peak force > force), collisions never detected and without a bound included.
template <class T>
double peak_force_over(const ExactLaw& law, double force) {
    return tail<T>(law.pieces, law.peak_force, force).probability + law.unbounded();
}

/// Mean and standard deviation of the peak force, counting the force by the end where nothing was detected.
template <class T>
Moments peak_force_moments(const ExactLaw& law) {
    const Moments detected = moments<T>(law.pieces, law.peak_force, law.harmless);
    if (law.rests) return detected;  // the others are among them
    const double weight = law.end_force.total / (law.end_force.total + law.peak_force.total + law.harmless);
    if (!(weight > 0)) return detected;
    const Moments end = moments<T>(law.pieces, law.end_force, 0);
    if (!(weight < 1)) return end;
    const double apart = end.mean - detected.mean;
    return {detected.mean + weight * apart,
            std::sqrt((1 - weight) * detected.sd * detected.sd + weight * end.sd * end.sd +
                      weight * (1 - weight) * apart * apart)};
}

template <class T>
class ExactLawBuilder {
  public:
    /// `quiet`: the ticks of a motion at least as long, where many laws share them.
    ExactLawBuilder(const StoppingCurve& curve, const Timing& timing, const MotionSettings& motion,
                    const ThresholdDetector& detector, const LawSettings& settings, const QuietTicks* quiet = nullptr)
        : curve_(curve),
          timing_(timing),
          motion_(motion),
          detector_(detector),
          settings_(settings),
          quiet_(quiet != nullptr ? *quiet : own_quiet_.emplace(detector, timing, motion.step, curve.path.ticks)),
          find_(curve.path, timing, detector, quiet_),
          cutter_(curve, timing, motion, detector, settings, quiet_),
          order_(cutter_.order()) {
        if (settings.free != nullptr)
            reactions_.emplace(*settings.free, FreeBody{settings.stiffness, settings.body_mass});
    }

    ExactLaw build() {
        const std::vector<Panel> panels = cutter_.cut();
        if (panels.empty()) {  // a motion that ends where it begins
            law_.detected = law_.false_alarm = alarm_before_ = quiet_.alarm_before(curve_.path.ticks);
            law_.no_contact = quiet_.silence_before(curve_.path.ticks);
            law_.harmless = 1;
            law_.pieces.order = order_;
            contact_from_.assign(std::size_t(curve_.path.ticks) + 1, 0.0);
            contact_from_.back() = 1;
            share_false_alarms();
            return std::move(law_);
        }
        const KnownOutcomes<T> known(panels, cutter_.parts(), cutter_.regular(), order_,
                                     [&](const std::vector<Panel>& list) { return find(list); });
        law_.interpolated = known.interpolated();
        assemble(panels, known);
        quantities();
        if (reactions_) {
            spread_free(known, int(panels.size()));
            free_alarms();
        }
        return std::move(law_);
    }

    /// P(peak force > force) of collisions whose force has a bound, by itself: nothing is interpolated and only positive
    /// terms are added, so a probability of 1e-30 has as many digits as one of 0.3.
    double tail_directly(double force) {
        const int ticks = curve_.path.ticks;
        const bool rests = curve_.path.rests();
        const double end = curve_.path.greatest(cutter_.end_step());
        const bool fixed = settings_.offset.kind == OffsetKind::fixed;
        const double depth = force / settings_.stiffness;
        // Detection at tick k passes the force where the offset is below farthest - depth: cut every panel
        // there.
        std::vector<Panel> panels;
        for (const Panel& panel : cutter_.plain()) {
            allow_interruption();
            std::vector<double> cuts{panel.high};
            for (int k = 0; k < end_of_ways(panel.tick); ++k) {
                const double cut = farthest(k) - depth;
                if (cut > panel.low && cut < panel.high) cuts.push_back(cut);
            }
            if (rests && end - depth > panel.low && end - depth < panel.high) cuts.push_back(end - depth);
            std::sort(cuts.begin(), cuts.end());
            double low = panel.low;
            for (double high : cuts) {
                if (high > low || fixed) panels.push_back({low, high, panel.tick});
                low = high;
            }
        }
        if (panels.empty()) return 0;
        const GaussRule& rule = gauss_rule(order_);
        const Outcomes outcomes = find(panels).outcomes;
        double total = 0;
        for (std::size_t p = 0; p < panels.size(); ++p) {
            allow_interruption();
            const Panel& panel = panels[p];
            const double mid = 0.5 * (panel.low + panel.high), half = 0.5 * (panel.high - panel.low);
            const double place = fixed ? mid * (1 + 1e-15) : panel.high;
            if (rests && panel.tick <= ticks && end - depth >= place) {
                for (int g = 0; g < order_; ++g) {
                    const double density = fixed ? 0.5 : settings_.offset.density(mid + half * rule.node[g]) * half;
                    total += rule.weight[g] * density * quiet_.silence_before(panel.tick) *
                             outcomes.survived[std::size_t(g) * outcomes.panels + p];
                }
            }
            for (int k = 0; k < end_of_ways(panel.tick); ++k) {
                if (!(farthest(k) - depth >= place)) continue;
                const int slot = k - panel.tick;
                const bool braking = k == ticks;
                if (slot >= int(outcomes.detected.size()) || (slot < 0 && !braking && !quiet_.armed(k))) continue;
                for (int g = 0; g < order_; ++g) {
                    const double density = fixed ? 0.5 : settings_.offset.density(mid + half * rule.node[g]) * half;
                    const double chance =
                        slot < 0 ? quiet_.silence_before(k) * (braking ? 1 : quiet_.idle(k).alarm)
                                 : quiet_.silence_before(panel.tick) *
                                       outcomes.detected[std::size_t(slot)][std::size_t(g) * outcomes.panels + p];
                    total += rule.weight[g] * density * chance;
                }
            }
        }
        return total;
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;

    typename KnownOutcomes<T>::Found find(const std::vector<Panel>& panels) const {
        if (!reactions_) return {find_(ClampedContact<T>{settings_.stiffness}, panels, order_), {}};
        const FreeContact<T> contact(*reactions_, panels, order_);
        Outcomes outcomes = find_(contact, panels, order_);
        FreeNodes nodes = contact.values(outcomes);
        return {std::move(outcomes), std::move(nodes)};
    }

    /// Whether the arm brakes into clamped bodies at the end of its line. One that it reaches only then, which nothing before
    /// has alarmed of, counts one tick after the last: with the force that is left when the arm stands.
    bool brakes() const { return curve_.path.brakes() && !reactions_; }
    /// The farthest that the arm gets after tick k, the one after the last included.
    double farthest(int k) const {
        return k < curve_.path.ticks ? curve_.farthest[std::size_t(k)] : curve_.path.farthest_braking();
    }
    /// One past the last tick that there is a way from to bodies first touched at `tick`.
    int end_of_ways(int tick) const { return curve_.path.ticks + (brakes() && tick > curve_.path.ticks ? 1 : 0); }

    static int padded(int n) { return (n + lanes - 1) / lanes * lanes; }

    /// Probability of an alarm before contact where panels hold several ticks.
    double false_alarm_by_tick() const {
        double total = 0;
        for (int k = 0; k < curve_.path.ticks; ++k) {
            const double here = settings_.offset.probability_beyond(cutter_.edge(k)) -
                                settings_.offset.probability_beyond(cutter_.edge(k + 1));
            total += here * quiet_.alarm_before(k);
        }
        return total + settings_.offset.probability_beyond(cutter_.edge(curve_.path.ticks)) *
                           quiet_.alarm_before(curve_.path.ticks);
    }

    /// Joins outcomes, offsets and the silence before contact into the pieces and the probabilities without a
    /// force.
    void assemble(const std::vector<Panel>& panels, const KnownOutcomes<T>& known) {
        const Outcomes& outcomes = known.outcomes();
        const LinePath& path = curve_.path;
        const GaussRule& rule = gauss_rule(order_);
        const bool fixed = settings_.offset.kind == OffsetKind::fixed;
        const int real = int(panels.size()), n = padded(real);
        LawPieces& pieces = law_.pieces;
        pieces.panels = n;
        pieces.order = order_;
        pieces.mid.assign(n, 0.0);
        pieces.half.assign(n, 0.0);
        pieces.first_tick.assign(n, 0);
        // weight[g][p] dx: probability of the offset and of silence before contact.
        std::vector<double> weight(std::size_t(order_) * n, 0.0), offset(std::size_t(order_) * n, 0.0);
        for (int p = 0; p < real; ++p) {
            pieces.mid[p] = 0.5 * (panels[p].low + panels[p].high);
            pieces.half[p] = 0.5 * (panels[p].high - panels[p].low);
        }
        for (int p = 0; p < n; p += lanes) {
            const T mid = load<T>(&pieces.mid[p]), half = load<T>(&pieces.half[p]);
            for (int g = 0; g < order_; ++g) {
                const T density = fixed ? T(0.5) : settings_.offset.density(mid + half * rule.node[g]) * half;
                store(density, &offset[std::size_t(g) * n + p]);
            }
        }
        int before = 0;
        // By tick: the farthest any stopping path gets that begins there or earlier.
        std::vector<double> farthest_yet = curve_.farthest;
        for (std::size_t k = 1; k < farthest_yet.size(); ++k)
            farthest_yet[k] = std::max(farthest_yet[k], farthest_yet[k - 1]);
        contact_from_.assign(std::size_t(path.ticks) + 1, 0.0);
        for (int p = 0; p < real; ++p) {
            allow_interruption();
            const Panel& panel = panels[p];
            pieces.first_tick[p] = panel.tick;
            const double silence = quiet_.silence_before(panel.tick);
            double total = 0;
            for (int g = 0; g < order_; ++g) {
                const std::size_t at = std::size_t(g) * n + p;
                weight[at] = offset[at] * silence;
                total += rule.weight[g] * offset[at];
            }
            alarm_before_ += total * quiet_.alarm_before(panel.tick);
            contact_from_[std::size_t(std::min(panel.tick, path.ticks))] += total;
            if (panel.tick > path.ticks) {
                law_.no_contact += total * silence;
                for (int g = 0; g < order_; ++g) weight[std::size_t(g) * n + p] = 0;
            }
            int reach = 0;  // ticks before contact whose stopping path still arrives
            for (int k = std::min(panel.tick, path.ticks) - 1; k >= 0 && farthest_yet[std::size_t(k)] > panel.low; --k)
                reach = panel.tick - k;
            before = std::max(before, reach);
        }
        // What false alarms do to a free body is worked out tick by tick.
        if (!(quiet_.alarm_before(path.ticks) > 0) || reactions_) before = 0;
        if (brakes()) before = std::max(before, 1);
        const double beyond = fixed ? 0 : settings_.offset.probability_beyond(cutter_.overrun_end());
        alarm_before_ += beyond * quiet_.alarm_before(path.ticks);
        contact_from_.back() += beyond;
        law_.false_alarm = cutter_.group() == 1 ? alarm_before_ : false_alarm_by_tick();
        law_.no_contact += beyond * quiet_.silence_before(path.ticks);

        pieces.slots_before = before;
        pieces.slots = before + int(outcomes.detected.size()) + 1;
        // Gigabytes, where ticks are fine: clearing them is interrupted as well.
        const std::size_t coefficients = std::size_t(pieces.slots) * order_ * n, portion = 1 << 18;
        pieces.coefficient.clear();
        pieces.coefficient.reserve(coefficients);
        while (pieces.coefficient.size() < coefficients) {
            allow_interruption();
            pieces.coefficient.resize(std::min(coefficients, pieces.coefficient.size() + portion));
        }
        std::vector<double> value(std::size_t(order_) * n, 0.0);
        auto transform_slot = [&](const std::vector<double>& outcome, int slot) {
            allow_interruption();
            for (int g = 0; g < order_; ++g)
                known.spread(&outcome[std::size_t(g) * outcomes.panels], real, &value[std::size_t(g) * n]);
            legendre_coefficients<T>(rule, value.data(), weight.data(), n, pieces.series(slot, 0));
        };
        for (std::size_t i = 0; i < outcomes.detected.size(); ++i)
            transform_slot(outcomes.detected[i], before + int(i));
        transform_slot(outcomes.survived, pieces.slots - 1);
        // False alarms whose stopping path may arrive are as probable at every place of a panel.
        double touching = 0;
        std::vector<double> place;
        if (before > 0) {
            std::fill(value.begin(), value.end(), 1.0);
            place.resize(std::size_t(order_) * n);
            legendre_coefficients<T>(rule, value.data(), offset.data(), n, place.data());
        }
        for (int slot = 0; slot < before; ++slot) {
            allow_interruption();
            std::vector<double> chance(std::size_t(n), 0.0);
            for (int p = 0; p < real; ++p) {
                const int k = panels[p].tick + slot - before;
                if (k < 0 || k >= end_of_ways(panels[p].tick)) continue;
                const bool braking = k == path.ticks;
                if (!braking && !quiet_.armed(k)) continue;
                chance[std::size_t(p)] = quiet_.silence_before(k) * (braking ? 1 : quiet_.idle(k).alarm);
                touching += 2 * place[std::size_t(p)] * chance[std::size_t(p)];
            }
            double* series = pieces.series(slot, 0);
            for (int l = 0; l < order_; ++l) {
                for (int p = 0; p < n; p += lanes) {
                    const std::size_t at = std::size_t(l) * n + p;
                    store(load<T>(&place[at]) * load<T>(&chance[std::size_t(p)]), series + at);
                }
            }
        }
        law_.harmless = std::max(0.0, alarm_before_ + law_.no_contact - touching);
        for (int p = 0; p < real; ++p) law_.undetected += 2 * *pieces.series(pieces.slots - 1, p);
        triggers(rule, known, weight, real, n);
    }

    void triggers(const GaussRule& rule, const KnownOutcomes<T>& known, const std::vector<double>& weight, int real,
                  int n) {
        const Outcomes& outcomes = known.outcomes();
        std::vector<double> run(n, 0.0);
        auto integral = [&](const double* value) {
            double total = 0;
            for (int g = 0; g < order_; ++g) {
                known.spread(value + std::size_t(g) * outcomes.panels, real, run.data());
                T row = 0.0;
                for (int p = 0; p < n; p += lanes) row += load<T>(&run[p]) * load<T>(&weight[std::size_t(g) * n + p]);
                for (int lane = 0; lane < lanes; ++lane) total += rule.weight[g] * lane_of(row, lane);
            }
            return total;
        };
        law_.several = integral(outcomes.several.data());
        const std::size_t block = std::size_t(order_) * outcomes.panels;
        for (int w = 0; w < detector_.watched; ++w)
            law_.trigger[detector_.joint[w]] = integral(&outcomes.trigger[w * block]);
        share_false_alarms();
    }

    /// Alarms before contact that no outcome holds are split over the joints as those of idle ticks are.
    void share_false_alarms() {
        double waiting = 0;  // probability of contact after tick k
        for (int k = curve_.path.ticks - 1; k >= 0; --k) {
            waiting += contact_from_[std::size_t(k) + 1];
            if (!quiet_.armed(k)) continue;
            const IdleTick& idle = quiet_.idle(k);
            const double here = waiting * quiet_.silence_before(k);
            for (int w = 0; w < detector_.watched; ++w) law_.trigger[detector_.joint[w]] += here * idle.single[w];
            law_.several += here * std::max(0.0, idle.alarm - idle.one);
        }
    }

    void quantities() {
        const LawPieces& pieces = law_.pieces;
        const LinePath& path = curve_.path;
        const double K = settings_.stiffness;
        const int n = pieces.panels, before = pieces.slots_before, last = pieces.slots - 1;
        auto prepare = [&](LawQuantity& quantity, int first_slot, int end_slot) {
            quantity.first_slot = first_slot;
            quantity.end_slot = end_slot;
            quantity.centre.assign(std::size_t(end_slot - first_slot) * n, 0.0);
            quantity.spread.assign(n, 0.0);
        };
        law_.rests = path.rests();
        prepare(law_.peak_force, 0, law_.rests ? pieces.slots : last);
        prepare(law_.end_force, last, pieces.slots);
        prepare(law_.force_at_detection, before, last);
        prepare(law_.detection_delay, before, last);
        const double end = path.greatest(cutter_.end_step());
        for (int p = 0; p < n; ++p) {
            allow_interruption();
            const int tick = pieces.first_tick[p];
            law_.peak_force.spread[p] = law_.force_at_detection.spread[p] = K * pieces.half[p];
            law_.end_force.spread[p] = K * pieces.half[p];
            law_.end_force.centre[p] = K * (end - pieces.mid[p]);
            if (law_.rests) law_.peak_force.centre[std::size_t(last) * n + p] = law_.end_force.centre[p];
            // False alarms whose stopping path arrives are possible even where contact comes after the last
            // tick. Time of contact at the panel's ends; between them the path is straight in time.
            const double early = contact_time(pieces.mid[p] - pieces.half[p], tick);
            const double late = contact_time(pieces.mid[p] + pieces.half[p], tick);
            law_.detection_delay.spread[p] = 0.5 * (late - early);
            for (int slot = 0; slot < last; ++slot) {
                const int k = tick + slot - before;
                if (k < 0 || k >= end_of_ways(tick)) continue;
                law_.peak_force.centre[std::size_t(slot) * n + p] = K * (farthest(k) - pieces.mid[p]);
                if (slot < before) continue;
                const std::size_t at = std::size_t(slot - before) * n + p;
                law_.force_at_detection.centre[at] = K * (cutter_.s_tick(k) - pieces.mid[p]);
                law_.detection_delay.centre[at] = quiet_.time(k) - 0.5 * (early + late);
            }
        }
        summarise(pieces, law_.peak_force);
        summarise(pieces, law_.end_force);
        summarise(pieces, law_.force_at_detection);
        summarise(pieces, law_.detection_delay);
        law_.detected = alarm_before_ + law_.force_at_detection.total;
    }

    /// What a free body suffers, in all panels.
    void spread_free(const KnownOutcomes<T>& known, int real) {
        const LawPieces& pieces = law_.pieces;
        const FreeNodes& from = known.free();
        FreeNodes& to = law_.free;
        to.panels = pieces.panels;
        for (auto quantity : FreeNodes::all()) {
            std::vector<double>& values = to.*quantity;
            values.assign(std::size_t(pieces.slots) * order_ * pieces.panels, 0.0);
            for (int row = 0; row < pieces.slots * order_; ++row)
                known.spread(&(from.*quantity)[std::size_t(row) * from.panels], real,
                             &values[std::size_t(row) * pieces.panels]);
        }
    }

    /// False alarms whose reaction still reaches the body.
    void free_alarms() {
        for (int k = 0; k < curve_.path.ticks; ++k) {
            const double chance = quiet_.armed(k) ? quiet_.silence_before(k) * quiet_.idle(k).alarm : 0;
            if (chance > 0)
                add_alarms<T>(*reactions_, settings_.offset, k, chance, cutter_.edge(k + 1), law_.free_alarms);
        }
        law_.harmless = std::max(0.0, law_.harmless - law_.free_alarms.total);
    }

    /// When the point passes offset o, first in contact at tick k: linear between simulation steps.
    double contact_time(double o, int k) const {
        const LinePath& path = curve_.path;
        const std::size_t last = std::min(std::size_t(k) * timing_.period + 1, path.s.size() - 1);
        std::size_t i = k == 0 ? 0 : std::size_t(k - 1) * timing_.period + 1;
        while (i + 1 < last && path.s[i + 1] <= o) ++i;
        if (i >= last) return double(i) * motion_.step;
        const double step = path.s[i + 1] - path.s[i];
        const double part = step > 0 ? std::clamp((o - path.s[i]) / step, 0.0, 1.0) : 0.0;
        return (double(i) + part) * motion_.step;
    }

    const StoppingCurve& curve_;
    const Timing& timing_;
    const MotionSettings& motion_;
    const ThresholdDetector& detector_;
    const LawSettings& settings_;
    std::optional<QuietTicks> own_quiet_;
    const QuietTicks& quiet_;
    const OutcomeFinder<T> find_;
    PanelCutter cutter_;
    std::optional<FreeReactions<T>> reactions_;  ///< of free contact
    double alarm_before_ = 0;                    ///< probability of an alarm before the first tick of the panel
    std::vector<double> contact_from_;           ///< by first tick in contact: probability; the last is all later ones
    int order_;
    ExactLaw law_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
