/// @file
/// The exact law: the distribution over contact offset and white sensor noise, integrated instead of sampled.
#pragma once

#include "bumpstop/collision/certain_detection.hpp"
#include "bumpstop/collision/free_impact.hpp"
#include "bumpstop/collision/law_pieces.hpp"
#include "bumpstop/collision/offset_law.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Interpolated detection probabilities may be wrong by this much; rounding of the joint positions alone gives
/// 1e-12.
inline constexpr double outcome_tolerance = 1e-10;

struct LawSettings {
    double stiffness = 0;  ///< N/m
    OffsetLaw offset;
    int refinement = 1;               ///< multiplies the order of the quadrature; 2 shows that 1 is converged
    bool delays = true;               ///< detection delays are wanted: panels are then cut where the path bends in time
    const FreePaths* free = nullptr;  ///< of free contact; null: the body is clamped
    double body_mass = 0;             ///< of free contact [kg]
};

/// Free contact: quantities at the Gauss nodes, [slot][node][panel]. They bend with the offset.
struct FreeNodes {
    std::vector<double> peak_force, duration, force_at_detection;  ///< N, s, N
};

struct ExactLaw {
    LawPieces pieces;
    LawQuantity peak_force, force_at_detection, detection_delay;  ///< of detected collisions [N, N, s]
    LawQuantity end_force;                                        ///< of collisions never detected, at the end [N]
    double false_alarm = 0;                                       ///< detection before contact
    double harmless = 0;              ///< of those, and of motions that end before contact: no force at all
    double undetected = 0;            ///< contact, and no detection by the end of the motion
    double no_contact = 0;            ///< the motion ends before contact, no alarm
    double several = 0;               ///< two or more joints over their threshold at the tick of detection
    double trigger[max_joints] = {};  ///< joint over its threshold at the tick of detection
    FreeNodes free;                   ///< of free contact, instead of the forces above
    bool interpolated = false;        ///< detection probabilities come from a few panels (see D below)
};

/// Mean and standard deviation of the peak force, counting the force at the end where nothing was detected.
template <class T>
Moments peak_force_moments(const ExactLaw& law) {
    const Moments detected = moments<T>(law.pieces, law.peak_force, law.harmless);
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
    ExactLawBuilder(const StoppingCurve& curve, const Timing& timing, const MotionSettings& motion,
                    const ThresholdDetector& detector, const LawSettings& settings)
        : curve_(curve),
          timing_(timing),
          motion_(motion),
          detector_(detector),
          settings_(settings),
          quiet_(detector, timing, motion.step, curve.path.ticks),
          find_(curve.path, timing, detector, quiet_),
          body_{settings.stiffness, settings.body_mass} {}

    ExactLaw build() {
        place_ticks();
        choose_order();
        const std::vector<Panel> panels = settings_.offset.kind == OffsetKind::fixed ? fixed_panel() : cut_panels();
        if (panels.empty()) {  // a motion that ends where it begins
            law_.false_alarm = alarm_before_ = quiet_.alarm_before(curve_.path.ticks);
            law_.no_contact = quiet_.silence_before(curve_.path.ticks);
            law_.harmless = 1;
            contact_from_.assign(std::size_t(curve_.path.ticks) + 1, 0.0);
            contact_from_.back() = 1;
            share_false_alarms();
            return std::move(law_);
        }
        assemble(panels, know(panels));
        quantities();
        if (settings_.free != nullptr) free_quantities();
        return std::move(law_);
    }

    /// P(peak force > force) of detected collisions by itself: nothing is interpolated and only positive terms
    /// are added, so a probability of 1e-30 has as many digits as one of 0.3.
    double tail_directly(double force) {
        place_ticks();
        choose_order();
        const int ticks = curve_.path.ticks;
        const bool fixed = settings_.offset.kind == OffsetKind::fixed;
        const double depth = force / settings_.stiffness;
        // Detection at tick k passes the force where the offset is below farthest - depth: cut every panel
        // there.
        std::vector<Panel> panels;
        if (fixed) {
            panels = fixed_panel();
        } else {
            for (const Panel& panel : plain_panels()) {
                std::vector<double> cuts{panel.high};
                for (int k = 0; k < ticks; ++k) {
                    const double cut = curve_.farthest[k] - depth;
                    if (cut > panel.low && cut < panel.high) cuts.push_back(cut);
                }
                std::sort(cuts.begin(), cuts.end());
                double low = panel.low;
                for (double high : cuts) {
                    if (high > low) panels.push_back({low, high, panel.tick});
                    low = high;
                }
            }
        }
        if (panels.empty()) return 0;
        const GaussRule& rule = gauss_rule(order_);
        const Outcomes outcomes = find(panels);
        double total = 0;
        for (std::size_t p = 0; p < panels.size(); ++p) {
            const Panel& panel = panels[p];
            const double mid = 0.5 * (panel.low + panel.high), half = 0.5 * (panel.high - panel.low);
            for (int k = 0; k < ticks; ++k) {
                if (!(curve_.farthest[k] - depth >= (fixed ? mid * (1 + 1e-15) : panel.high))) continue;
                const int slot = k - panel.tick;
                if (slot >= int(outcomes.detected.size()) || (slot < 0 && !quiet_.armed(k))) continue;
                for (int g = 0; g < order_; ++g) {
                    const double density = fixed ? 0.5 : settings_.offset.density(mid + half * rule.node[g]) * half;
                    const double chance =
                        slot < 0 ? quiet_.silence_before(k) * quiet_.idle(k).alarm
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

    Outcomes find(const std::vector<Panel>& panels) const {
        if (settings_.free != nullptr) return find_(FreeContact{*settings_.free, body_}, panels, order_);
        return find_(ClampedContact{settings_.stiffness}, panels, order_);
    }

    static int padded(int n) { return (n + lanes - 1) / lanes * lanes; }

    double s_tick(int k) const { return curve_.path.at_tick(k, timing_.period); }
    /// Contact begins at the first tick whose distance passes the offset, so edges follow the running greatest
    /// distance.
    void place_ticks() {
        const int ticks = curve_.path.ticks;
        edge_.resize(ticks + 2);
        edge_[0] = 0;
        for (int k = 0; k < ticks; ++k) edge_[k + 1] = std::max(edge_[k], s_tick(k));
        // Contact between the last tick and the end of the motion is contact all the same.
        const auto& s = curve_.path.s;
        const auto end = s.begin() + std::ptrdiff_t(end_step()) + 1;
        edge_[ticks + 1] = std::max(edge_[ticks], *std::max_element(s.begin(), end));
        overrun_end_ = edge_.back();
        for (double farthest : curve_.farthest) overrun_end_ = std::max(overrun_end_, farthest);
    }

    /// Sensor noise sets the scale on which probabilities change: sharpness is the residual's growth over one
    /// tick of travel in standard deviations of the noise.
    double sharpness(int k) const {
        const double* a = &curve_.path.torque_per_N[std::size_t(k) * curve_.path.dof];
        double most = 0;
        for (int w = 0; w < detector_.watched; ++w) {
            most = std::max(most, std::fabs(a[detector_.joint[w]]) * detector_.scale[w] * std::numbers::sqrt2);
        }
        // What remembered noise adds from tick to tick is narrower than the noise.
        const double narrower = std::sqrt((1 - detector_.correlation) * (1 + detector_.correlation));
        return most * settings_.stiffness * (edge_[k + 1] - edge_[k]) / narrower;
    }

    void choose_order() {
        double most = 0;
        for (int k = 0; k < curve_.path.ticks; ++k) most = std::max(most, sharpness(k));
        if (settings_.offset.kind == OffsetKind::fixed) {
            order_ = 1;
            return;
        }
        // While the residual grows slowly a panel may hold several ticks. The kink where contact begins is as weak as
        // what a little force adds to the idle alarms, which must be rare for that.
        if (!settings_.delays && settings_.refinement == 1 && !detector_.remembers() && curve_.path.ticks > 0 &&
            quiet_.idle(curve_.path.ticks - 1).alarm < rare_alarm) {
            double growth = most / slow_growth;  // in a tick, of what a panel may span: noise and offset density
            if (settings_.offset.kind == OffsetKind::half_normal) {
                for (int k = 0; k < curve_.path.ticks; ++k)
                    growth = std::max(growth, (edge_[k + 1] - edge_[k]) / settings_.offset.size);
            }
            if (growth > 0) group_ = std::clamp(int(1 / growth), 1, std::max(1, curve_.path.ticks));
        }
        most *= group_;
        // Eight nodes and two for every standard deviation of sharpness leave errors of 1e-13 in the mean,
        // 1e-11 in the quantiles and a part in 1e7 in the far tails, as `refinement` shows.
        parts_ = std::max(1, int(std::ceil(std::min(most, 1e6) / 6)));
        split_by_transitions_ = parts_ > 4;
        const double largest = settings_.offset.largest();
        for (int k = 0; k < curve_.path.ticks && edge_[k] < largest; ++k)
            parts_ = std::max(parts_, pieces_of_density(std::min(edge_[k + 1], largest) - edge_[k]));
        const double per_part = split_by_transitions_ ? 4 : most / parts_;
        order_ = std::min(max_order, int(std::ceil((8 + 2 * per_part) * settings_.refinement)));
    }

    std::vector<Panel> fixed_panel() const {
        const double o = settings_.offset.size;
        const int ticks = curve_.path.ticks;
        for (int k = 0; k <= ticks; ++k) {
            if (edge_[k + 1] > o) return {{o, o, k}};
        }
        return {{o, o, ticks + 1}};
    }

    /// Offsets the motion reaches only after its last tick, and those beyond its end that a stopping path still may: the
    /// former's first tick in contact is numbered `ticks`, the latter's `ticks` + 1, and neither exists.
    void add_end_panels(std::vector<Panel>& panels) const {
        const int ticks = curve_.path.ticks;
        const double largest = settings_.offset.largest();
        auto add = [&](double low, double high, int tick) {
            if (!(high > low)) return;
            const int pieces = pieces_of_density(high - low);
            for (int i = 0; i < pieces; ++i)
                panels.push_back({low + (high - low) * i / pieces, low + (high - low) * (i + 1) / pieces, tick});
        };
        add(edge_[ticks], std::min(edge_.back(), largest), ticks);
        add(edge_.back(), std::min(overrun_end_, largest), ticks + 1);
    }

    /// Into how many pieces a panel must be cut for the offset's density to be smooth in each.
    int pieces_of_density(double width) const {
        if (settings_.offset.kind != OffsetKind::half_normal) return 1;
        return std::max(1, int(std::ceil(width / settings_.offset.size)));
    }

    /// Panels by part, then by tick. The first `regular_` ticks-in-a-row of every part are alike enough to
    /// interpolate.
    std::vector<Panel> cut_panels() {
        const double largest = settings_.offset.largest();
        const int ticks = curve_.path.ticks;
        int last = 0;  // contact ticks are 0..last-1
        while (last < ticks && edge_[last] < largest) ++last;
        std::vector<Panel> panels;
        auto add_part = [&](int k, int end, int part) {
            const double low = edge_[k], high = std::min(edge_[end], largest);
            if (!(high > low)) return;
            const double a = low + (high - low) * part / parts_, b = low + (high - low) * (part + 1) / parts_;
            panels.push_back({a, b, k});
        };
        // Tick 0 comes one step after the start, not a whole period: its panel is of another size. The last
        // panel may be cut short.
        const int first_regular = std::max(1, quiet_.settled()), groups = (last - 1 - first_regular) / group_;
        // How a free body gets away depends on where in a step it is touched.
        const bool bent = settings_.free != nullptr || (settings_.delays && bends());
        bool advances = true;  // at every tick; near a singularity an arm may fall back
        for (int k = first_regular; k < last - 1; ++k) advances = advances && edge_[k + 1] > edge_[k];
        if (!split_by_transitions_ && !bent && advances && detector_.arming_delay <= motion_.step &&
            groups >= 2 * fewest_nodes) {
            regular_ = groups;
            const int end_regular = first_regular + groups * group_;
            for (int part = 0; part < parts_; ++part)
                for (int k = first_regular; k < end_regular; k += group_) add_part(k, k + group_, part);
            for (int k = 0; k < first_regular; ++k)
                for (int part = 0; part < parts_; ++part) add_part(k, k + 1, part);
            for (int part = 0; part < parts_; ++part) add_part(end_regular, last, part);
            add_end_panels(panels);
            return panels;
        }
        for (int k = 0; k < last; k += group_) cut_one(k, std::min(k + group_, last), largest, bent, panels);
        add_end_panels(panels);
        return panels;
    }

    /// Probability of an alarm before contact where panels hold several ticks.
    double false_alarm_by_tick() const {
        double total = 0;
        for (int k = 0; k < curve_.path.ticks; ++k) {
            const double here =
                settings_.offset.probability_beyond(edge_[k]) - settings_.offset.probability_beyond(edge_[k + 1]);
            total += here * quiet_.alarm_before(k);
        }
        return total +
               settings_.offset.probability_beyond(edge_[curve_.path.ticks]) * quiet_.alarm_before(curve_.path.ticks);
    }

    /// Every tick's panel by itself, as far as the offsets go.
    std::vector<Panel> plain_panels() const {
        const double largest = settings_.offset.largest();
        std::vector<Panel> panels;
        for (int k = 0; k < curve_.path.ticks && edge_[k] < largest; ++k) cut_one(k, k + 1, largest, false, panels);
        add_end_panels(panels);
        return panels;
    }

    /// Does the distance between two ticks depart from a straight line in time?
    bool bends() const {
        const LinePath& path = curve_.path;
        for (int k = 0; k + 1 < path.ticks; ++k) {
            const double a = s_tick(k), b = s_tick(k + 1);
            for (int i = 1; i < timing_.period; ++i) {
                const double here = path.s[std::size_t(k) * timing_.period + 1 + i];
                if (std::fabs(here - a - (b - a) * i / timing_.period) > 1e-4 * std::fabs(b - a) + 1e-15) return true;
            }
        }
        return false;
    }

    /// The panel of the ticks k .. end - 1 on its own: cut at simulation steps where the path bends, and around every offset
    /// at which some joint's residual passes its threshold at some tick, where the noise is narrow.
    void cut_one(int k, int end, double largest, bool bent, std::vector<Panel>& panels) const {
        const double low = edge_[k], high = std::min(edge_[end], largest);
        if (!(high > low)) return;
        std::vector<double> cuts{low, high};
        if (bent) {
            for (int i = 1; i < timing_.period; ++i) {
                const std::size_t step = std::size_t(k) * timing_.period + 1 - timing_.period + i;
                if (k > 0) cuts.push_back(curve_.path.s[step]);
            }
        }
        if (split_by_transitions_) {
            add_transitions(k, low, high, cuts);
        }
        const int parts = split_by_transitions_ ? pieces_of_density(high - low) : parts_;
        for (int part = 1; part < parts; ++part) cuts.push_back(low + (high - low) * part / parts);
        std::sort(cuts.begin(), cuts.end());
        double from = low;
        for (double cut : cuts) {
            if (cut <= from || cut > high) continue;
            panels.push_back({from, cut, k});
            from = cut;
        }
    }

    void add_transitions(int first, double low, double high, std::vector<double>& cuts) const {
        const LinePath& path = curve_.path;
        for (int w = 0; w < detector_.watched; ++w) {
            for (double side : {-1.0, 1.0}) {
                bool passed = false;
                for (int k = first; k < path.ticks && !passed; ++k) {
                    const double a = path.torque_per_N[std::size_t(k) * path.dof + detector_.joint[w]];
                    const double force = (side * detector_.threshold[w] - detector_.mean[w]) / a;
                    if (!(force > 0) || !std::isfinite(force)) continue;
                    const double at = s_tick(k) - force / settings_.stiffness;
                    const double width = detector_.sd[w] / (std::fabs(a) * settings_.stiffness);
                    // Once even the nearest offset is far past its transition, later ticks see none.
                    passed = at - 12 * width > high;
                    for (int n = -8; n <= 8; n += 2) {
                        const double cut = at + n * width;
                        if (cut > low && cut < high) cuts.push_back(cut);
                    }
                }
            }
        }
    }

    /// Outcomes known at some panels, and how those of every panel follow from them. While the arm moves
    /// steadily the panels differ only by the slow change of the Jacobian, so what happens at a given node and
    /// slot is smooth in the tick: a few panels of every part are worked out and the others interpolated.
    struct KnownOutcomes {
        Outcomes outcomes;
        int nodes = 0;               // of the interpolation; 0: every panel is known
        int stride = 0;              // known panels of a part: the nodes and the checks
        std::vector<double> weight;  // [node][regular panel]
        int irregular = 0;           // the first known panel that stands for itself
    };

    KnownOutcomes know(const std::vector<Panel>& panels) {
        if (regular_ == 0) return {find(panels), 0, 0, {}, 0};
        const int count = regular_;
        constexpr int check_count = 2;
        for (int nodes : {fewest_nodes, 12, most_nodes}) {
            if (count < 2 * nodes) break;
            const Interpolation interpolation(interpolation_nodes(0, count - 1, nodes));
            const std::vector<int>& node = interpolation.nodes();
            const int check[check_count] = {(node[0] + node[1]) / 2, (node[nodes / 2] + node[nodes / 2 - 1]) / 2};
            std::vector<Panel> sample;
            for (int part = 0; part < parts_; ++part) {
                for (int k : node) sample.push_back(panels[part * count + k]);
                for (int k : check) sample.push_back(panels[part * count + k]);
            }
            const int irregular = int(sample.size());
            sample.insert(sample.end(), panels.begin() + std::ptrdiff_t(parts_) * count, panels.end());
            KnownOutcomes known{find(sample), nodes, nodes + check_count, {}, irregular};
            if (!agrees(known.outcomes, interpolation, check, known.stride)) continue;
            law_.interpolated = true;
            known.weight.resize(std::size_t(nodes) * count);
            double at[most_nodes];
            for (int k = 0; k < count; ++k) {
                interpolation.weights(k, at);
                for (int m = 0; m < nodes; ++m) known.weight[std::size_t(m) * count + k] = at[m];
            }
            return known;
        }
        return {find(panels), 0, 0, {}, 0};
    }

    /// Do interpolated and direct outcomes agree at the check panels?
    bool agrees(const Outcomes& known, const Interpolation& interpolation, const int* check, int stride) const {
        double weight[most_nodes];
        const int nodes = interpolation.size();
        for (int c = 0; c < stride - nodes; ++c) {
            interpolation.weights(check[c], weight);
            for (int part = 0; part < parts_; ++part) {
                for (int g = 0; g < order_; ++g) {
                    const std::size_t row = std::size_t(g) * known.panels + std::size_t(part) * stride;
                    for (int m = 0; m < nodes; ++m) {
                        if (known.survived[row + m] > negligible_survival) return false;
                    }
                    for (const std::vector<double>& slot : known.detected) {
                        double value = 0;
                        for (int m = 0; m < nodes; ++m) value += weight[m] * slot[row + m];
                        if (std::fabs(value - slot[row + nodes + c]) > outcome_tolerance) return false;
                    }
                }
            }
        }
        return true;
    }

    /// Writes the values [node][panel] of one row of panels from the known ones [node][known panel].
    void spread(const KnownOutcomes& known, const double* from, int total, double* to) const {
        if (known.nodes == 0) {
            std::copy(from, from + total, to);
            return;
        }
        const int count = regular_;
        for (int part = 0; part < parts_; ++part) {
            T value[most_nodes];
            for (int m = 0; m < known.nodes; ++m) value[m] = from[part * known.stride + m];
            double* run = to + std::size_t(part) * count;
            int k = 0;
            for (; k + lanes <= count; k += lanes) {
                T sum = load<T>(&known.weight[k]) * value[0];
                for (int m = 1; m < known.nodes; ++m)
                    sum += load<T>(&known.weight[std::size_t(m) * count + k]) * value[m];
                store(sum, run + k);
            }
            for (; k < count; ++k) {
                run[k] = 0;
                for (int m = 0; m < known.nodes; ++m)
                    run[k] += known.weight[std::size_t(m) * count + k] * from[part * known.stride + m];
            }
        }
        std::copy(from + known.irregular, from + known.irregular + (total - parts_ * count), to + parts_ * count);
    }

    /// Joins outcomes, offsets and the silence before contact into the pieces and the probabilities without a
    /// force.
    void assemble(const std::vector<Panel>& panels, const KnownOutcomes& known) {
        const Outcomes& outcomes = known.outcomes;
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
        if (!(quiet_.alarm_before(path.ticks) > 0)) before = 0;
        const double beyond = fixed ? 0 : settings_.offset.probability_beyond(overrun_end_);
        alarm_before_ += beyond * quiet_.alarm_before(path.ticks);
        contact_from_.back() += beyond;
        law_.false_alarm = group_ == 1 ? alarm_before_ : false_alarm_by_tick();
        law_.no_contact += beyond * quiet_.silence_before(path.ticks);

        pieces.slots_before = before;
        pieces.slots = before + int(outcomes.detected.size()) + 1;
        pieces.coefficient.assign(std::size_t(pieces.slots) * order_ * n, 0.0);
        std::vector<double> value(std::size_t(order_) * n, 0.0);
        auto transform_slot = [&](const std::vector<double>& outcome, int slot) {
            for (int g = 0; g < order_; ++g)
                spread(known, &outcome[std::size_t(g) * outcomes.panels], real, &value[std::size_t(g) * n]);
            transform(rule, value, weight, pieces.series(slot, 0), n);
        };
        for (std::size_t i = 0; i < outcomes.detected.size(); ++i)
            transform_slot(outcomes.detected[i], before + int(i));
        transform_slot(outcomes.survived, pieces.slots - 1);
        double touching = 0;  // false alarms whose stopping path may arrive
        for (int slot = 0; slot < before; ++slot) {
            for (int p = 0; p < real; ++p) {
                const int k = panels[p].tick + slot - before;
                if (k < 0 || k >= path.ticks || !quiet_.armed(k)) continue;
                const double chance = quiet_.silence_before(k) * quiet_.idle(k).alarm;
                double* series = pieces.series(slot, p);
                for (int l = 0; l < order_; ++l) {
                    double c = 0;
                    for (int g = 0; g < order_; ++g)
                        c += rule.to_legendre[std::size_t(l) * order_ + g] * offset[std::size_t(g) * n + p];
                    series[std::size_t(l) * n] = c * chance;
                }
                touching += 2 * series[0] * 1.0;
            }
        }
        law_.harmless = std::max(0.0, alarm_before_ - touching) + law_.no_contact;
        for (int p = 0; p < real; ++p) law_.undetected += 2 * *pieces.series(pieces.slots - 1, p);
        triggers(rule, known, weight, real, n);
    }

    /// c_l = sum_g to_legendre[l][g] weight[g] value[g], for all panels. Four l at a time keep the adders
    /// busy.
    void transform(const GaussRule& rule, const std::vector<double>& value, const std::vector<double>& weight,
                   double* series, int n) const {
        for (int p = 0; p < n; p += lanes) {
            T product[max_order];
            for (int g = 0; g < order_; ++g) {
                const std::size_t at = std::size_t(g) * n + p;
                product[g] = load<T>(&value[at]) * load<T>(&weight[at]);
            }
            int l = 0;
            for (; l + 4 <= order_; l += 4) {
                const double* row = &rule.to_legendre[std::size_t(l) * order_];
                T sum[4] = {T(0.0), T(0.0), T(0.0), T(0.0)};
                for (int g = 0; g < order_; ++g) {
                    BUMPSTOP_UNROLL
                    for (int i = 0; i < 4; ++i) sum[i] += product[g] * row[i * order_ + g];
                }
                for (int i = 0; i < 4; ++i) store(sum[i], series + std::size_t(l + i) * n + p);
            }
            for (; l < order_; ++l) {
                T sum = 0.0;
                for (int g = 0; g < order_; ++g) sum += product[g] * rule.to_legendre[std::size_t(l) * order_ + g];
                store(sum, series + std::size_t(l) * n + p);
            }
        }
    }

    void triggers(const GaussRule& rule, const KnownOutcomes& known, const std::vector<double>& weight, int real,
                  int n) {
        const Outcomes& outcomes = known.outcomes;
        std::vector<double> run(n, 0.0);
        auto integral = [&](const double* value) {
            double total = 0;
            for (int g = 0; g < order_; ++g) {
                spread(known, value + std::size_t(g) * outcomes.panels, real, run.data());
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
        prepare(law_.peak_force, 0, last);
        prepare(law_.end_force, last, pieces.slots);
        prepare(law_.force_at_detection, before, last);
        prepare(law_.detection_delay, before, last);
        const double end = path.ticks > 0 ? path.s[end_step()] : 0;
        for (int p = 0; p < n; ++p) {
            const int tick = pieces.first_tick[p];
            law_.peak_force.spread[p] = law_.force_at_detection.spread[p] = K * pieces.half[p];
            law_.end_force.spread[p] = K * pieces.half[p];
            law_.end_force.centre[p] = K * (end - pieces.mid[p]);
            // False alarms whose stopping path arrives are possible even where contact comes after the last
            // tick. Time of contact at the panel's ends; between them the path is straight in time.
            const double early = contact_time(pieces.mid[p] - pieces.half[p], tick);
            const double late = contact_time(pieces.mid[p] + pieces.half[p], tick);
            law_.detection_delay.spread[p] = 0.5 * (late - early);
            for (int slot = 0; slot < last; ++slot) {
                const int k = tick + slot - before;
                if (k < 0 || k >= path.ticks) continue;
                law_.peak_force.centre[std::size_t(slot) * n + p] = K * (curve_.farthest[k] - pieces.mid[p]);
                if (slot < before) continue;
                const std::size_t at = std::size_t(slot - before) * n + p;
                law_.force_at_detection.centre[at] = K * (s_tick(k) - pieces.mid[p]);
                law_.detection_delay.centre[at] = quiet_.time(k) - 0.5 * (early + late);
            }
        }
        summarise(pieces, law_.peak_force);
        summarise(pieces, law_.end_force);
        summarise(pieces, law_.force_at_detection);
        summarise(pieces, law_.detection_delay);
    }

    /// What a free body suffers, offset by offset and tick by tick.
    void free_quantities() {
        const LawPieces& pieces = law_.pieces;
        const GaussRule& rule = gauss_rule(order_);
        const int n = pieces.panels, before = pieces.slots_before, last = pieces.slots - 1;
        const std::size_t block = std::size_t(order_) * n;
        FreeNodes& free = law_.free;
        for (std::vector<double>* values : {&free.peak_force, &free.duration, &free.force_at_detection})
            values->assign(block * pieces.slots, 0.0);
        for (int p = 0; p < n; p += lanes) {
            int tick[lanes];
            for (int lane = 0; lane < lanes; ++lane) tick[lane] = pieces.first_tick[p + lane];
            for (int g = 0; g < order_; ++g) {
                const T offset = load<T>(&pieces.mid[p]) + load<T>(&pieces.half[p]) * rule.node[g];
                const FreeCollision<T> collision(*settings_.free, body_, tick, offset);
                for (int slot = 0; slot < pieces.slots; ++slot) {
                    const std::size_t at = block * slot + std::size_t(g) * n + p;
                    bool matters = false;
                    int since[lanes];
                    for (int lane = 0; lane < lanes; ++lane) {
                        since[lane] = slot - before;
                        matters = matters || *pieces.series(slot, p + lane) != 0;
                    }
                    if (!matters) continue;
                    T peak = collision.peak, duration = collision.duration;
                    if (slot < last) {
                        const auto outcome = collision.detected(since);
                        peak = outcome.peak;
                        duration = outcome.duration;
                    }
                    store(peak, &free.peak_force[at]);
                    store(duration, &free.duration[at]);
                    if (slot >= before && slot < last && std::size_t(slot - before) < collision.force.size())
                        store(collision.force[std::size_t(slot - before)], &free.force_at_detection[at]);
                }
            }
        }
    }

    /// The step in which the undetected motion ends.
    std::size_t end_step() const { return std::min(curve_.path.s.size() - 1, std::size_t(timing_.steps)); }

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

    static constexpr int fewest_nodes = 8, most_nodes = 20;
    static constexpr double slow_growth = 1.2;  ///< sharpness of a panel of several ticks
    static constexpr double rare_alarm = 1e-5;  ///< probability of an idle alarm at a tick

    const StoppingCurve& curve_;
    const Timing& timing_;
    const MotionSettings& motion_;
    const ThresholdDetector& detector_;
    const LawSettings& settings_;
    const QuietTicks quiet_;
    const OutcomeFinder<T> find_;
    const FreeBody body_;
    double alarm_before_ = 0;           ///< probability of an alarm before the first tick of the panel
    int group_ = 1;                     ///< ticks in a panel
    double overrun_end_ = 0;            ///< the farthest any stopping path gets [m]
    std::vector<double> edge_;          ///< panel of tick k: edge_[k]..edge_[k + 1]
    std::vector<double> contact_from_;  ///< by first tick in contact: probability; the last is all later ones
    int order_ = 1, parts_ = 1, regular_ = 0;
    bool split_by_transitions_ = false;
    ExactLaw law_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
