/// @file
/// Divides the contact offsets into panels over which the integrands are smooth.
#pragma once

#include "bumpstop/collision/contact/contact.hpp"
#include "bumpstop/collision/contact/contact_cuts.hpp"
#include "bumpstop/collision/distribution/piecewise_density.hpp"
#include "bumpstop/collision/distribution/pre_contact_alarms.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct QuadratureSettings {
    Contact contact{};
    int refinement = 1;  ///< multiplies the order of the quadrature; 2 shows that 1 is converged
    /// One of many: only the peak force is needed, and not to the last digit. Else panels are cut where the path bends
    /// in time, for detection delays.
    bool batch = false;
    const ContactPaths* paths = nullptr;            ///< null: a rigid arm and a clamped spring
    const ContactPropagator* propagator = nullptr;  ///< of arm and body along these paths
};

/// Offsets low..high [m], whose first tick in contact is `tick`.
struct OffsetPanel {
    double low, high;
    int tick;
    int ticks = 0;  ///< it is of the offsets first touched at so many ticks; 0: nothing is interpolated from or to it
    int part = 0;   ///< number of the panel among those of the same ticks
};

/// Greatest width of a panel, in standard deviations of the noise by the growth of the residual, and of the offset,
/// with the order of the quadrature for it.
struct PanelWidth {
    int order;
    double residual, offset;
};

/// The object keeps its memory for the next path.
class OffsetMesh {
  public:
    OffsetMesh(const CollisionSetup& setup, const GaussianThresholds& detector, const PreContactAlarms& alarms)
        : timing_(setup.timing), detector_(detector), alarms_(alarms) {}

    const std::vector<OffsetPanel>& panels() const { return panels_; }
    int order() const { return width_.order; }
    /// Offsets from edge k to edge k + 1 are first touched at tick k; the last edge is the end of the motion.
    const std::vector<double>& edges() const { return edge_; }

    /// By tick and monitored joint: its torque per newton of contact force [Nm/N]; a tick has `max_joints` places.
    const std::vector<double>& torque_per_N() const { return torque_per_N_; }
    /// By monitored joint: the greatest of these, positive.
    const std::array<double, max_joints>& max_torque_per_N() const { return max_torque_per_N_; }

    double s_tick(int k) const { return path_->at_tick(k, timing_.period); }
    /// The step in which the undetected motion ends; in dynamic contact an arm that brakes has come to rest then.
    std::size_t end_step() const {
        return settings_->paths != nullptr ? std::size_t(settings_->paths->end_step) : path_->end_step(timing_);
    }

    /// Panels of a given width, for alarm probabilities from a table. False where the noise is too narrow for that.
    bool build(const LinePath& path, const QuadratureSettings& settings, const PanelWidth& width) {
        begin(path, settings);
        width_ = width;
        transitions_ = false;
        groups_ = settings.batch && rare_alarms();
        return place_panels(max_parts);
    }
    /// Panels and order that suit the noise. `every_tick`: no panel holds several ticks.
    void build(const LinePath& path, const QuadratureSettings& settings, bool every_tick = false) {
        begin(path, settings);
        groups_ = settings.batch && (settings.paths == nullptr || elastic()) && !every_tick &&
                  settings.refinement == 1 && !detector_.correlated_noise() && rare_alarms();
        choose_width();
        place_panels(std::numeric_limits<int>::max());
    }

    /// Adds panels of offsets that are first touched after the last tick; `tick`: their number of it.
    void add_end_panels(double low, double high, int tick, std::vector<OffsetPanel>& to) const {
        if (settings_->contact.offset.kind == OffsetKind::fixed) {
            const double o = settings_->contact.offset.size;
            if (o >= low && o < high) to.push_back({o, o, tick});
            return;
        }
        high = std::min(high, settings_->contact.offset.largest());
        if (!(high > low)) return;
        split(low, high, int(std::ceil((high - low) / max_offset_width())), tick, 0, to);
    }

  private:
    void begin(const LinePath& path, const QuadratureSettings& settings) {
        path_ = &path;
        settings_ = &settings;
        panels_.clear();
        place_edges();
        find_gain();
    }

    /// A path counts as straight if it bends less than this over a step, as a share of its distance. Panels across
    /// larger bends would be off by more than the tolerance, which is greater in a batch.
    static constexpr double max_bend = 1e-6, max_bend_of_batch = 0.03;

    double undisturbed(std::size_t i) const {
        return settings_->paths != nullptr ? settings_->paths->undisturbed(int(i)) : path_->s[i];
    }
    bool peaks_of_elastic_arm() const { return settings_->batch && elastic(); }
    bool elastic() const { return settings_->paths != nullptr && settings_->propagator->elastic(); }
    bool rare_alarms() const {
        return path_->ticks == 0 || !alarms_.armed(path_->ticks - 1) ||
               alarms_.no_contact(path_->ticks - 1).alarm < rare_alarm;
    }

    /// Contact begins at the first tick whose distance exceeds the offset: edges are the greatest distances so far.
    void place_edges() {
        const int ticks = path_->ticks;
        edge_.resize(std::size_t(ticks) + 2);
        edge_[0] = 0;
        for (int k = 0; k < ticks; ++k) edge_[std::size_t(k) + 1] = std::max(edge_[std::size_t(k)], s_tick(k));
        // Contact between the last tick and the end of the motion counts, too.
        double& last = edge_.back();
        last = edge_[std::size_t(ticks)];
        for (std::size_t i = 0; i <= end_step(); ++i) last = std::max(last, undisturbed(i));
    }

    /// The greatest torque per newton of every joint, and how fast the residual grows with the offset at most, in
    /// standard deviations of the noise per metre.
    void find_gain() {
        using L = Lanes<native_lanes>;
        static_assert(max_joints % native_lanes == 0);
        max_torque_per_N_.fill(0.0);
        torque_per_N_.resize(std::size_t(path_->ticks) * max_joints);  // places beyond the monitored joints stay 0
        for (int k = 0; k < path_->ticks; ++k) {
            double* own = &torque_per_N_[std::size_t(k) * max_joints];
            for (int w = 0; w < detector_.monitored; ++w)
                own[w] = path_->torque_per_N[std::size_t(k * path_->dof + detector_.joint[std::size_t(w)])];
            for (int w = 0; w < detector_.monitored; w += native_lanes)
                store(max(load<L>(&max_torque_per_N_[std::size_t(w)]), abs(load<L>(own + w))),
                      &max_torque_per_N_[std::size_t(w)]);
        }
        gain_ = 0;
        for (std::size_t w = 0; w < std::size_t(detector_.monitored); ++w)
            gain_ = std::max(gain_, max_torque_per_N_[w] * detector_.scale[w] * std::numbers::sqrt2);
        // Residuals of one tick and the next grow alike with the offset. So the innovation, which is narrower than the
        // noise, sees less of that growth, unless the noise alternates.
        const double c = std::min(0.0, detector_.correlation);
        gain_ *= settings_->contact.body.stiffness / std::sqrt((1 - c) * (1 + c));
    }

    /// By the greatest growth of the residual from tick to tick: where it is four standard deviations an order of 16
    /// leaves relative errors of 1e-13 in the mean, 1e-11 in the quantiles and 1e-7 in the far tails, as `refinement`
    /// shows. Where an elastic arm bounces its forces have kinks of 1e-4 and more: half that order is enough.
    void choose_width() {
        width_ = {PiecewiseDensity::block, 1, 1};
        transitions_ = false;
        if (settings_->contact.offset.kind == OffsetKind::fixed) return;
        double travel = 0;
        for (int k = 0; k < path_->ticks; ++k)
            travel = std::max(travel, edge_[std::size_t(k) + 1] - edge_[std::size_t(k)]);
        double growth = gain_ * travel;
        // In a batch of elastic arms the transitions lie anywhere in the panels, and their errors average.
        transitions_ = growth > 4 * wide.residual && !peaks_of_elastic_arm();
        if (settings_->paths != nullptr) growth /= timing_.period;  // panels are cut at every step
        if (groups_) growth = std::max(growth, group_growth);
        if (elastic() && !transitions_)
            width_ = of_elastic_arm;
        else
            width_ = growth <= narrow.residual ? narrow : growth <= middle.residual || transitions_ ? middle : wide;
        width_.order = std::min(max_order, width_.order * settings_->refinement);
    }

    double widest() const {
        return std::min(transitions_ || gain_ == 0 ? HUGE_VAL : width_.residual / gain_, max_offset_width());
    }
    double max_offset_width() const {
        const OffsetDistribution& offset = settings_->contact.offset;
        return offset.kind == OffsetKind::half_normal ? width_.offset * offset.size : HUGE_VAL;
    }

    /// False where a tick would have more than `limit` panels.
    bool place_panels(int limit) {
        if (settings_->contact.offset.kind == OffsetKind::fixed) {
            const double o = settings_->contact.offset.size;
            int k = 0;
            while (k <= path_->ticks && !(edge_[std::size_t(k) + 1] > o)) ++k;
            if (k <= path_->ticks) panels_.push_back({o, o, k});
            return true;
        }
        const int ticks = path_->ticks;
        const double largest = settings_->contact.offset.largest(), width = widest();
        const bool bent = !settings_->batch && settings_->paths == nullptr && bends();
        const int settled = std::max(1, alarms_.settled());
        find_retreats();
        std::vector<double> abrupt;
        if (settings_->paths != nullptr) abrupt = abrupt_offsets();
        int group = 1;
        for (int k = 0; k < ticks && edge_[std::size_t(k)] < largest; k += group) {
            group = groups_ && k > 0 ? group_at(k, group, std::min(width, group_growth / gain_)) : 1;
            const double low = edge_[std::size_t(k)], end = edge_[std::size_t(k + group)],
                         high = std::min(end, largest);
            if (!(high > low)) continue;
            // The last panel, which the end of the offsets cuts short, is not like the others.
            const int whole = end <= largest && k >= settled && !transitions_ ? group : 0;
            if (settings_->paths != nullptr) {
                place_dynamic_panels(k, low, high, width, abrupt, whole);
                continue;
            }
            allow_interruption();
            inner_.clear();
            if (bent && k > 0) {
                for (int i = 1; i < timing_.period; ++i)
                    inner_.push_back(path_->s[std::size_t(k - 1) * std::size_t(timing_.period) + 1 + std::size_t(i)]);
            }
            if (transitions_) add_transitions(k, low, high);
            for (auto at = std::upper_bound(retreat_.begin(), retreat_.end(), low); at != retreat_.end() && *at < high;
                 ++at)
                inner_.push_back(*at);
            std::erase_if(inner_, [&](double at) { return !(at > low && at < high); });
            if (inner_.empty()) {
                const double parts = std::ceil((high - low) / width);
                if (parts > limit) return false;
                split(low, high, int(parts), k, whole, panels_);
                continue;
            }
            inner_.push_back(high);
            std::sort(inner_.begin(), inner_.end());
            double from = low;
            for (double to : inner_) {
                if (to > from) split(from, to, int(std::ceil((to - from) / width)), k, 0, panels_);
                from = std::max(from, to);
            }
        }
        add_last_panels();
        return true;
    }

    static void split(double low, double high, int parts, int tick, int ticks, std::vector<OffsetPanel>& to) {
        parts = std::max(1, parts);
        for (int i = 0; i < parts; ++i)
            to.push_back({low + (high - low) * i / parts, low + (high - low) * (i + 1) / parts, tick, ticks, i});
    }

    /// Offsets that the motion reaches only after its last tick: their first tick would have the number `ticks`.
    void add_last_panels() {
        const int ticks = path_->ticks;
        double from = edge_[std::size_t(ticks)];
        const double end = std::min(edge_.back(), settings_->contact.offset.largest());
        // The penetration until the motion ends depends on where in a step the body is touched.
        const std::size_t first = ticks > 0 ? std::size_t(ticks - 1) * std::size_t(timing_.period) + 1 : 0;
        for (std::size_t i = first + 1; settings_->paths != nullptr && i < end_step(); ++i) {
            const double to = std::min(undisturbed(i), end);
            add_end_panels(from, to, ticks, panels_);
            from = std::max(from, to);
        }
        add_end_panels(from, end, ticks, panels_);
    }

    /// Number of ticks from k on that a panel may hold: that of the last panel, unless that is too wide now, or narrow.
    int group_at(int k, int last, double width) const {
        const int most = std::min(max_group, path_->ticks - k);
        auto fits = [&](int group) {
            return group <= most && edge_[std::size_t(k + group)] - edge_[std::size_t(k)] <= width;
        };
        if (fits(last) && !fits(last + last / 2 + 1)) return last;
        int group = 1;
        while (fits(group + 1)) ++group;
        return group;
    }

    /// Where the arm retreats, bodies beyond its distance at a tick are not touched any more. Unless alarms without
    /// contact are rare, the probability of detection has a kink there.
    void find_retreats() {
        retreat_.clear();
        if (rare_alarms() || settings_->paths != nullptr) return;
        for (int k = 0; k < path_->ticks; ++k)
            if (s_tick(k) < edge_[std::size_t(k) + 1]) retreat_.push_back(s_tick(k));
        std::sort(retreat_.begin(), retreat_.end());
    }

    /// Where in a step the body is touched, or after which tick it separates, matters at these offsets.
    std::vector<double> abrupt_offsets() const {
        const int ticks = path_->ticks;
        // An elastic arm still oscillates when the body separates.
        const bool detectable = settings_->propagator->elastic() || transitions_ ||
                                (ticks > 0 && alarms_.no_contact(ticks - 1).alarm > negligible_alarm);
        return ContactCuts(*settings_->paths, *settings_->propagator, detectable,
                           transitions_ ? &detector_ : nullptr)(settings_->contact.offset.largest());
    }

    void place_dynamic_panels(int k, double low, double high, double width, const std::vector<double>& abrupt,
                              int whole) {
        std::vector<double> steps{low, high};
        // The reference is straight within a step, so the step in which contact begins matters if the path bends there.
        // For narrow noise, which has no widths of panels, steps take their place.
        const std::size_t first = std::size_t(std::max(0, k - 1)) * std::size_t(timing_.period) + 1;
        for (int i = 1; k > 0 && i < timing_.period; ++i) {
            const double* s = &path_->s[first + std::size_t(i)];
            const double most = peaks_of_elastic_arm() ? max_bend_of_batch : max_bend;
            const bool bends = std::fabs(s[1] - 2 * s[0] + s[-1]) > most * std::fabs(s[1] - s[-1]);
            if (bends || transitions_) steps.push_back(s[0]);
        }
        std::sort(steps.begin(), steps.end());
        inner_.clear();
        const int most = 4 * timing_.period;
        for (std::size_t i = 1; i < steps.size(); ++i) {
            const int parts =
                std::clamp(int(std::ceil(std::min((steps[i] - steps[i - 1]) / width, double(most)))), 1, most);
            for (int part = 1; part <= parts; ++part)
                inner_.push_back(steps[i - 1] + (steps[i] - steps[i - 1]) * part / parts);
        }
        inner_.insert(inner_.end(), std::upper_bound(abrupt.begin(), abrupt.end(), low),
                      std::lower_bound(abrupt.begin(), abrupt.end(), high));
        std::sort(inner_.begin(), inner_.end());
        double from = low;
        // Panels that only rounding makes are left out.
        const double least = 1e-9 * (high - low);
        int part = 0;
        for (double cut : inner_) {
            const double to = high - cut < least ? high : cut;
            if (to - from < least) continue;
            panels_.push_back({from, to, k, whole, part++});
            from = to;
        }
    }

    /// Whether the distance between two ticks departs from a straight line in time.
    bool bends() const {
        for (int k = 0; k + 1 < path_->ticks; ++k) {
            const double a = s_tick(k), b = s_tick(k + 1);
            for (int i = 1; i < timing_.period; ++i) {
                const double here = path_->s[std::size_t(k) * std::size_t(timing_.period) + 1 + std::size_t(i)];
                if (std::fabs(here - a - (b - a) * i / timing_.period) > 1e-4 * std::fabs(b - a) + 1e-15) return true;
            }
        }
        return false;
    }

    /// Adds offsets about which the residual of a joint passes its threshold at a tick, for narrow noise.
    void add_transitions(int first, double low, double high) {
        for (int w = 0; w < detector_.monitored; ++w) {
            for (double side : {-1.0, 1.0}) {
                bool passed = false;
                const double limit = side * detector_.threshold[std::size_t(w)] - detector_.mean[std::size_t(w)];
                NoiselessResidual<double> without, per_metre;  // the residual is that without an offset minus slope o
                for (int k = first; k < path_->ticks && !passed; ++k) {
                    const double stiffness =
                        torque_per_N_[std::size_t(k * max_joints + w)] * settings_->contact.body.stiffness;
                    const double at_zero = detector_.advance(without, stiffness * s_tick(k)),
                                 slope = detector_.advance(per_metre, stiffness);
                    if (!(limit * slope > 0)) continue;
                    const double at = (at_zero - limit) / slope;
                    const double width = detector_.sd[std::size_t(w)] / std::fabs(slope);
                    // Once even the nearest offset is far past its transition, later ticks have none.
                    passed = at - 12 * width > high;
                    for (int n = -8; n <= 8; n += 2) {
                        const double cut = at + n * width;
                        if (cut > low && cut < high) inner_.push_back(cut);
                    }
                }
            }
        }
    }

    static constexpr PanelWidth narrow{8, 0.4, 1}, middle{16, 4, 1}, wide{24, 6, 1}, of_elastic_arm{8, 4, 1};
    static constexpr double group_growth = 1.75;      ///< of the residual over a panel of several ticks
    static constexpr double rare_alarm = 1e-5;        ///< without contact at a tick: panels may hold several ticks
    static constexpr double negligible_alarm = 1e-6;  ///< the same: separation changes no digit of a probability
    static constexpr int max_group = 64, max_parts = 16;

    const Timing& timing_;
    const GaussianThresholds& detector_;
    const PreContactAlarms& alarms_;
    const LinePath* path_ = nullptr;
    const QuadratureSettings* settings_ = nullptr;
    PanelWidth width_{PiecewiseDensity::block, 1, 1};
    bool transitions_ = false;  ///< the noise is so narrow that panels are cut where residuals pass thresholds
    bool groups_ = false;       ///< a panel may hold several ticks
    double gain_ = 0;           ///< greatest growth of a residual [standard deviations per metre of offset]
    alignas(64) std::array<double, max_joints> max_torque_per_N_{};
    std::vector<double> torque_per_N_;
    std::vector<OffsetPanel> panels_;
    std::vector<double> edge_, retreat_, inner_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
