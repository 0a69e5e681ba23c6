/// @file
/// Alarms before contact: survival probability by tick, and the density of the noise that has not alarmed.
#pragma once

#include "bumpstop/collision/motion/stopping_curve.hpp"
#include "bumpstop/detection/surviving_noise.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Alarm probabilities of an armed tick without contact, given no alarm before.
struct NoContactTick {
    double alarm = 0, no_alarm = 1, one = 0;  ///< any joint, none, exactly one over its threshold
    std::array<double, max_joints> single{};  ///< by monitored joint

    void add(int w, const AlarmProbability<double>& joint) {
        alarm += no_alarm * joint.alarm;
        one = one * joint.no_alarm + no_alarm * joint.alarm;
        no_alarm *= joint.no_alarm;
        single[std::size_t(w)] = joint.alarm;
    }
    /// From `no_alarm` where an alarm is so likely that rounding may make it greater than one.
    double log_no_alarm() const { return alarm < 0.5 ? std::log1p(-alarm) : std::log(no_alarm); }
};

class PreContactAlarms {
  public:
    PreContactAlarms(const CollisionSetup& setup, const GaussianThresholds& detector, int ticks) : detector_(detector) {
        while (unarmed_ <= ticks && !detector.armed(setup.tick_time(unarmed_))) ++unarmed_;
        for (int w = 0; w < detector.monitored; ++w) white_tick_.add(w, joint_alarm(detector, w, 0.0));
        std::vector<double> log_survival(std::size_t(ticks) + 1, 0.0);
        if (detector.correlation != 0) {
            propagate(log_survival);
        } else {
            const double log_no_alarm = white_tick_.log_no_alarm();
            for (int k = unarmed_; k < ticks; ++k)
                log_survival[std::size_t(k) + 1] = log_survival[std::size_t(k)] + log_no_alarm;
        }
        for (double log : log_survival) {
            survival_.push_back(std::exp(log));
            false_alarm_.push_back(0 - std::expm1(log));  // -expm1 of zero is -0
        }
    }

    /// Number of ticks before the first armed one.
    int unarmed() const { return unarmed_; }
    bool armed(int k) const { return k >= unarmed_; }

    /// Probability of no alarm in all armed ticks before tick k, and of an alarm among them.
    double survival_before(int k) const { return survival_[clamped(k)]; }
    double false_alarm_before(int k) const { return false_alarm_[clamped(k)]; }

    /// Tick k itself, given no alarm before it.
    const NoContactTick& no_contact(int k) const {
        static constexpr NoContactTick nothing{};
        if (!armed(k)) return nothing;
        return correlated_tick_.empty() ? white_tick_
                                        : correlated_tick_[std::min(std::size_t(k), correlated_tick_.size() - 1)];
    }

    /// The first tick from which on the noise no longer depends on when the detector was armed.
    int settled() const {
        if (correlated_tick_.empty()) return 0;
        int k = int(correlated_tick_.size()) - 1;
        const double last = correlated_tick_.back().alarm;
        while (k > 0 && std::fabs(correlated_tick_[std::size_t(k) - 1].alarm - last) <= 1e-5 * last) --k;
        return k;
    }

    bool correlated(int w) const { return !noise_.empty() && index_[w] >= 0; }
    /// The noise of a correlated joint.
    const CorrelatedNoise& noise(int w) const { return noise_[std::size_t(index_[w])]; }

    /// Its density after tick k - 1, given no alarm.
    const SurvivingNoiseDensity<double>& density_before(int w, int k) const {
        const std::vector<SurvivingNoiseDensity<double>>& row = density_[std::size_t(index_[w])];
        return row[std::min(std::size_t(k), row.size() - 1)];
    }

  private:
    std::size_t clamped(int k) const { return std::min(std::size_t(k), survival_.size() - 1); }

    void propagate(std::vector<double>& log_survival) {
        const int ticks = int(log_survival.size()) - 1;
        std::vector<double> work;
        for (int w = 0; w < detector_.monitored; ++w) {
            index_[w] = -1;
            if (!(detector_.sd[w] > 0)) continue;
            const auto alike = [&](const CorrelatedNoise& noise) {
                return noise.threshold == detector_.threshold[w] && noise.sd == detector_.sd[w] &&
                       noise.mean == detector_.mean[w];
            };
            index_[w] = int(std::find_if(noise_.begin(), noise_.end(), alike) - noise_.begin());
            if (index_[w] == int(noise_.size()))
                noise_.emplace_back(detector_.threshold[w], detector_.sd[w], detector_.mean[w], detector_.correlation);
        }
        density_.resize(noise_.size());
        std::vector<SurvivingNoiseDensity<double>> now(noise_.size());
        std::vector<AlarmProbability<double>> alarm(noise_.size());
        for (std::size_t m = 0; m < noise_.size(); ++m) {
            now[m].reset(noise_[m]);
            density_[m].push_back(now[m]);
        }
        correlated_tick_.resize(std::size_t(ticks) + 1);
        bool settled = false;
        for (int k = 0; k < ticks; ++k) {
            allow_interruption();
            NoContactTick& tick = correlated_tick_[std::size_t(k)];
            if (settled) {
                tick = correlated_tick_[std::size_t(k) - 1];
            } else if (armed(k)) {
                for (std::size_t m = 0; m < noise_.size(); ++m) alarm[m] = propagate_tick(noise_[m], now[m], 0.0, work);
                for (int w = 0; w < detector_.monitored; ++w)
                    tick.add(w, index_[w] < 0 ? joint_alarm(detector_, w, 0.0) : alarm[std::size_t(index_[w])]);
                settled = k > 0 && tick.alarm > 0 &&
                          std::fabs(tick.alarm - correlated_tick_[std::size_t(k) - 1].alarm) <= 1e-14 * tick.alarm;
            }
            // Later ticks share the last density.
            for (std::size_t m = 0; m < noise_.size() && !settled; ++m) density_[m].push_back(now[m]);
            log_survival[std::size_t(k) + 1] = log_survival[std::size_t(k)] + tick.log_no_alarm();
        }
        if (ticks > 0) correlated_tick_[std::size_t(ticks)] = correlated_tick_[std::size_t(ticks) - 1];
    }

    const GaussianThresholds& detector_;
    int unarmed_ = 0;
    NoContactTick white_tick_;
    std::vector<double> survival_, false_alarm_;                       ///< by tick: of those before it
    std::vector<NoContactTick> correlated_tick_;                       ///< by tick, where the noise is correlated
    std::array<int, max_joints> index_{};                              ///< of a joint in `noise_`; -1: not correlated
    std::vector<CorrelatedNoise> noise_;                               ///< joints may share one
    std::vector<std::vector<SurvivingNoiseDensity<double>>> density_;  ///< [noise][tick]
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
