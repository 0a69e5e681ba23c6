/// @file
/// Cuts the offsets into panels inside which what happens is smooth.
#pragma once

#include "bumpstop/collision/free_cuts.hpp"
#include "bumpstop/collision/offset_law.hpp"
#include "bumpstop/collision/outcomes.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Outcomes are interpolated from no fewer panels than these.
inline constexpr int fewest_known_panels = 8;

struct LawSettings {
    double stiffness = 0;  ///< N/m
    OffsetLaw offset;
    int refinement = 1;               ///< multiplies the order of the quadrature; 2 shows that 1 is converged
    bool delays = true;               ///< detection delays are wanted: panels are then cut where the path bends in time
    const FreePaths* free = nullptr;  ///< of free contact; null: the body is clamped
    double body_mass = 0;             ///< of free contact [kg]
};

/// Panels, and the order of the quadrature in each.
class PanelCutter {
  public:
    PanelCutter(const StoppingCurve& curve, const Timing& timing, const MotionSettings& motion,
                const ThresholdDetector& detector, const LawSettings& settings, const QuietTicks& quiet)
        : curve_(curve), timing_(timing), motion_(motion), detector_(detector), settings_(settings), quiet_(quiet) {
        place_ticks();
        choose_order();
    }

    int order() const { return order_; }
    /// Panel of tick k: edge(k)..edge(k + 1).
    double edge(int k) const { return edge_[std::size_t(k)]; }
    double overrun_end() const { return overrun_end_; }  ///< the farthest any stopping path gets [m]
    int group() const { return group_; }                 ///< ticks in a panel
    /// Of the panels that `cut` gave: the first parts() * regular() are `regular` groups of ticks alike enough to
    /// interpolate, part by part.
    int parts() const { return parts_; }
    int regular() const { return regular_; }

    double s_tick(int k) const { return curve_.path.at_tick(k, timing_.period); }
    /// The step in which the undetected motion ends; a free body is followed until an arm that brakes has come to rest.
    std::size_t end_step() const {
        return settings_.free != nullptr ? std::size_t(settings_.free->end_step) : curve_.path.end_step(timing_);
    }
    double undisturbed(std::size_t i) const {
        return settings_.free != nullptr ? settings_.free->undisturbed(int(i)) : curve_.path.s[i];
    }

    std::vector<Panel> cut() {
        if (settings_.offset.kind == OffsetKind::fixed) return fixed_panel();
        return settings_.free != nullptr ? cut_free_panels() : cut_panels();
    }

    /// Every tick's panel by itself, as far as the offsets go.
    std::vector<Panel> plain() const {
        if (settings_.offset.kind == OffsetKind::fixed) return fixed_panel();
        const double largest = settings_.offset.largest();
        std::vector<Panel> panels;
        for (int k = 0; k < curve_.path.ticks && edge_[k] < largest; ++k) cut_one(k, k + 1, largest, false, panels);
        add_end_panels(panels);
        return panels;
    }

  private:
    /// Contact begins at the first tick whose distance passes the offset, so edges follow the running greatest
    /// distance.
    void place_ticks() {
        const int ticks = curve_.path.ticks;
        edge_.resize(ticks + 2);
        edge_[0] = 0;
        for (int k = 0; k < ticks; ++k) edge_[k + 1] = std::max(edge_[k], s_tick(k));
        // Contact between the last tick and the end of the motion is contact all the same.
        edge_[ticks + 1] = edge_[ticks];
        for (std::size_t i = 0; i <= end_step(); ++i) edge_[ticks + 1] = std::max(edge_[ticks + 1], undisturbed(i));
        overrun_end_ = edge_.back();
        for (double farthest : curve_.farthest) overrun_end_ = std::max(overrun_end_, farthest);
        overrun_end_ = std::max(overrun_end_, curve_.path.farthest_braking());
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
            if (growth > 0) group_ = int(std::clamp(1 / growth, 1.0, double(std::max(1, curve_.path.ticks))));
        }
        most *= group_;
        if (settings_.free != nullptr) most /= timing_.period;  // panels are cut at every step
        // Eight nodes and two for every standard deviation of sharpness leave errors of 1e-13 in the mean,
        // 1e-11 in the quantiles and a part in 1e7 in the far tails, as `refinement` shows.
        parts_ = std::max(1, int(std::ceil(std::min(most, 1e6) / 6)));
        split_by_transitions_ = parts_ > 4;
        if (settings_.free != nullptr) parts_ = std::min(parts_, 4);
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
        // How far a free body is pressed until the motion ends depends on where in a step it is touched.
        double from = edge_[std::size_t(ticks)];
        const double end = std::min(edge_.back(), largest);
        const std::size_t first = ticks > 0 ? std::size_t(ticks - 1) * timing_.period + 1 : 0;
        for (std::size_t i = first + 1; settings_.free != nullptr && i < end_step(); ++i) {
            const double to = std::min(undisturbed(i), end);
            add(from, to, ticks);
            from = std::max(from, to);
        }
        add(from, end, ticks);
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
        const bool bent = settings_.delays && bends();
        if (!split_by_transitions_ && !bent && advances(first_regular, last - 1) &&
            detector_.arming_delay <= motion_.step && groups >= 2 * fewest_known_panels) {
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

    /// At every tick; near a singularity an arm may fall back.
    bool advances(int first, int end) const {
        for (int k = first; k < end; ++k) {
            if (!(edge_[k + 1] > edge_[k])) return false;
        }
        return true;
    }

    /// How a free body gets away depends on where in a step it is touched, and on the tick at which it is felt no more.
    std::vector<Panel> cut_free_panels() {
        const double largest = settings_.offset.largest();
        const int ticks = curve_.path.ticks;
        const FreeBody body{settings_.stiffness, settings_.body_mass};
        const bool felt = ticks > 0 && quiet_.idle(ticks - 1).alarm > unnoticeable_alarm;
        const std::vector<double> abrupt = FreeCuts(*settings_.free, body, felt || split_by_transitions_,
                                                    split_by_transitions_ ? &detector_ : nullptr)(largest);
        std::vector<std::vector<Panel>> by_tick;
        for (int k = 0; k < ticks && edge_[k] < largest; ++k) {
            by_tick.emplace_back();
            cut_free_tick(k, abrupt, by_tick.back());
        }
        const int last = int(by_tick.size()), first_regular = std::max(1, quiet_.settled());
        bool alike = !split_by_transitions_ && detector_.arming_delay <= motion_.step &&
                     curve_.path.end == PathEnd::certain_detection &&
                     last - 1 - first_regular >= 2 * fewest_known_panels && advances(first_regular, last - 1);
        for (int k = first_regular; k < last - 1; ++k)
            alike = alike && by_tick[std::size_t(k)].size() == by_tick[std::size_t(first_regular)].size();
        std::vector<Panel> panels;
        if (alike) {
            regular_ = last - 1 - first_regular;
            parts_ = int(by_tick[std::size_t(first_regular)].size());
            for (int part = 0; part < parts_; ++part)
                for (int k = first_regular; k < last - 1; ++k)
                    panels.push_back(by_tick[std::size_t(k)][std::size_t(part)]);
        }
        for (int k = 0; k < last; ++k) {
            if (alike && k >= first_regular && k < last - 1) continue;
            const std::vector<Panel>& own = by_tick[std::size_t(k)];
            panels.insert(panels.end(), own.begin(), own.end());
        }
        add_end_panels(panels);
        return panels;
    }

    void cut_free_tick(int k, const std::vector<double>& abrupt, std::vector<Panel>& panels) const {
        const double low = edge_[k], high = std::min(edge_[k + 1], settings_.offset.largest());
        if (!(high > low)) return;
        std::vector<double> steps{low, high}, cuts;
        for (int i = 1; k > 0 && i < timing_.period; ++i)
            steps.push_back(curve_.path.s[std::size_t(k - 1) * timing_.period + 1 + std::size_t(i)]);
        std::sort(steps.begin(), steps.end());
        for (std::size_t i = 1; i < steps.size(); ++i)
            for (int part = 1; part <= parts_; ++part)
                cuts.push_back(steps[i - 1] + (steps[i] - steps[i - 1]) * part / parts_);
        cuts.insert(cuts.end(), std::upper_bound(abrupt.begin(), abrupt.end(), low),
                    std::lower_bound(abrupt.begin(), abrupt.end(), high));
        std::sort(cuts.begin(), cuts.end());
        double from = low;
        // Rounding leaves no slivers.
        const double least = 1e-9 * (high - low);
        for (double cut : cuts) {
            const double to = high - cut < least ? high : cut;
            if (to - from < least) continue;
            panels.push_back({from, to, k});
            from = to;
        }
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
        allow_interruption();
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
                const double limit = side * detector_.threshold[w] - detector_.mean[w];
                double at_zero = 0, slope = 0;  // the noiseless residual is at_zero - slope o
                for (int k = first; k < path.ticks && !passed; ++k) {
                    const double stiffness =
                        path.torque_per_N[std::size_t(k) * path.dof + detector_.joint[w]] * settings_.stiffness;
                    at_zero = detector_.filtered(at_zero, stiffness * s_tick(k));
                    slope = detector_.filtered(slope, stiffness);
                    if (!(limit * slope > 0)) continue;
                    const double at = (at_zero - limit) / slope;
                    const double width = detector_.sd[w] / std::fabs(slope);
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

    static constexpr double slow_growth = 1.2;          ///< sharpness of a panel of several ticks
    static constexpr double rare_alarm = 1e-5;          ///< probability of an idle alarm at a tick
    static constexpr double unnoticeable_alarm = 1e-6;  ///< the same: a body's parting changes no digit

    const StoppingCurve& curve_;
    const Timing& timing_;
    const MotionSettings& motion_;
    const ThresholdDetector& detector_;
    const LawSettings& settings_;
    const QuietTicks& quiet_;
    int group_ = 1;
    double overrun_end_ = 0;
    std::vector<double> edge_;
    int order_ = 1, parts_ = 1, regular_ = 0;
    bool split_by_transitions_ = false;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
