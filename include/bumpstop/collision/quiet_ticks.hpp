/// @file
/// The ticks before contact: how long nothing alarms, and what the noise has become by then.
#pragma once

#include "bumpstop/collision/stopping_curve.hpp"
#include "bumpstop/detection/truncated_noise.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What may happen at an armed tick without contact, given no alarm before.
struct IdleTick {
    double alarm = 0, silent = 1, one = 0;    ///< any joint, none, exactly one over its threshold
    std::array<double, max_joints> single{};  ///< by watched joint

    void add(int w, const AlarmProbability<double>& joint) {
        alarm += silent * joint.alarm;
        one = one * joint.silent + silent * joint.alarm;
        silent *= joint.silent;
        single[w] = joint.alarm;
    }
    /// Never from one minus what rounding may have put above one.
    double log_silent() const { return alarm < 0.5 ? std::log1p(-alarm) : std::log(silent); }
};

class QuietTicks {
  public:
    QuietTicks(const ThresholdDetector& detector, const Timing& timing, double step, int ticks)
        : detector_(detector), period_(timing.period), step_(step), log_silence_(std::size_t(ticks) + 1, 0.0) {
        for (int w = 0; w < detector.watched; ++w) white_.add(w, joint_alarm(detector, w, 0.0));
        if (detector.correlation != 0) {
            remember(ticks);
        } else {
            const double log_silent = white_.log_silent();
            for (int k = 0; k < ticks; ++k) log_silence_[k + 1] = log_silence_[k] + (armed(k) ? log_silent : 0.0);
        }
    }

    double time(int k) const { return (double(k) * period_ + 1) * step_; }
    bool armed(int k) const { return detector_.armed(time(k)); }

    /// Probability of no alarm in all armed ticks before tick k, and of an alarm among them.
    double silence_before(int k) const { return std::exp(log_silence_[clamped(k)]); }
    double alarm_before(int k) const { return -std::expm1(log_silence_[clamped(k)]); }

    /// Tick k itself, given no alarm before it.
    const IdleTick& idle(int k) const {
        static constexpr IdleTick nothing{};
        if (!armed(k)) return nothing;
        return idle_.empty() ? white_ : idle_[clamped(k)];
    }

    /// The first tick at which the noise has all but forgotten that it was not watched before it was armed.
    int settled() const {
        if (idle_.empty()) return 0;
        int k = int(idle_.size()) - 1;
        const double last = idle_.back().alarm;
        while (k > 0 && std::fabs(idle_[std::size_t(k) - 1].alarm - last) <= 1e-5 * last) --k;
        return k;
    }

    /// Joints whose noise remembers; `memory(w)` is null for the others.
    const NoiseMemory* memory(int w) const { return has_memory(w) ? &memory_[std::size_t(place_[w])] : nullptr; }
    bool has_memory(int w) const { return !memory_.empty() && place_[w] >= 0; }

    /// The noise of a remembering joint after tick k - 1, nothing having alarmed.
    const TruncatedDensity<double>& density_before(int w, int k) const {
        const std::vector<TruncatedDensity<double>>& row = density_[std::size_t(place_[w])];
        return row[std::min(std::size_t(k), row.size() - 1)];
    }

  private:
    std::size_t clamped(int k) const { return std::min(std::size_t(k), log_silence_.size() - 1); }

    void remember(int ticks) {
        std::vector<double> work;
        for (int w = 0; w < detector_.watched; ++w) {
            place_[w] = -1;
            if (!(detector_.sd[w] > 0)) continue;
            place_[w] = int(memory_.size());
            memory_.emplace_back(detector_.threshold[w], detector_.sd[w], detector_.mean[w], detector_.correlation);
        }
        density_.resize(memory_.size());
        std::vector<TruncatedDensity<double>> now(memory_.size());
        for (std::size_t m = 0; m < memory_.size(); ++m) {
            now[m].forget(memory_[m]);
            density_[m].push_back(now[m]);
        }
        idle_.resize(std::size_t(ticks) + 1);
        bool settled = false;
        for (int k = 0; k < ticks; ++k) {
            allow_interruption();
            IdleTick& idle = idle_[std::size_t(k)];
            if (settled) {
                idle = idle_[std::size_t(k) - 1];
            } else if (armed(k)) {
                for (int w = 0; w < detector_.watched; ++w) {
                    const int m = place_[w];
                    idle.add(w, m < 0 ? joint_alarm(detector_, w, 0.0) : watch_tick(memory_[m], now[m], 0.0, work));
                }
                settled = k > 0 && idle.alarm > 0 &&
                          std::fabs(idle.alarm - idle_[std::size_t(k) - 1].alarm) <= 1e-14 * idle.alarm;
            }
            // Later ticks share the last density there is.
            for (std::size_t m = 0; m < memory_.size() && !settled; ++m) density_[m].push_back(now[m]);
            log_silence_[k + 1] = log_silence_[k] + idle.log_silent();
        }
        if (ticks > 0) idle_[std::size_t(ticks)] = idle_[std::size_t(ticks) - 1];
    }

    const ThresholdDetector& detector_;
    int period_;
    double step_;
    IdleTick white_;
    std::vector<double> log_silence_;  ///< of all ticks before this one
    std::vector<IdleTick> idle_;       ///< by tick, where the noise remembers
    std::array<int, max_joints> place_{};
    std::vector<NoiseMemory> memory_;
    std::vector<std::vector<TruncatedDensity<double>>> density_;  ///< [remembering joint][tick]
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
