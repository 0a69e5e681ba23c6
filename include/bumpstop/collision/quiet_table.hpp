/// @file
/// The ticks before contact, worked out once for all the laws of a batch.
#pragma once

#include "bumpstop/collision/quiet_ticks.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What `QuietTicks` says of white noise, of the first `ticks` ticks.
class QuietTable {
  public:
    QuietTable(const ThresholdDetector& detector, const Timing& timing, double step, int ticks) {
        const QuietTicks quiet(detector, timing, step, ticks);
        for (int k = 0; k <= ticks; ++k) {
            silence_before_.push_back(quiet.silence_before(k));
            alarm_before_.push_back(quiet.alarm_before(k));
            if (!quiet.armed(k)) ++unarmed_;
        }
        armed_ = quiet.idle(unarmed_);
    }

    /// The first so many ticks do not watch.
    int unarmed() const { return unarmed_; }
    bool armed(int k) const { return k >= unarmed_; }
    /// An armed tick, given no alarm before it.
    const IdleTick& idle() const { return armed_; }
    /// Probability of no alarm in all armed ticks before tick k, and of an alarm among them.
    double silence_before(int k) const { return silence_before_[std::size_t(k)]; }
    double alarm_before(int k) const { return alarm_before_[std::size_t(k)]; }

  private:
    int unarmed_ = 0;
    IdleTick armed_;
    std::vector<double> silence_before_, alarm_before_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
