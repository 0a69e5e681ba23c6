/// @file
/// How far a path must be traced: until no body that may be there can have gone unnoticed.
#pragma once

#include "bumpstop/collision/outcomes.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Tells the tracer when even the farthest body would have been noticed for certain.
template <class T>
class CertainDetection {
  public:
    CertainDetection(const ThresholdDetector& detector, const Timing& timing, double step, double stiffness,
                     T largest_offset)
        : detector_(detector), stiffness_(stiffness), largest_(largest_offset) {
        while (blind_ticks_ <= timing.steps && !detector.armed((double(blind_ticks_) * timing.period + 1) * step))
            ++blind_ticks_;
        for (int w = 0; w < detector.watched; ++w) residual_[w] = 0.0;
    }
    /// Called at every tick in turn.
    MaskOf<T> operator()(const T& s, const T* torque_per_N) {
        const T force = maximum(s - largest_, T(0.0)) * stiffness_;
        for (int w = 0; detector_.filter != 0 && w < detector_.watched; ++w)
            residual_[w] = detector_.filtered(residual_[w], T(torque_per_N[detector_.joint[w]] * force));
        if (tick_++ >= blind_ticks_ && any(force > T(0.0))) {
            const auto chance = any_alarm<T>(detector_, [&](int w) {
                return detector_.filter != 0 ? residual_[w] : T(torque_per_N[detector_.joint[w]] * force);
            });
            const T silent = select(force > T(0.0), chance.silent, T(1.0));
            // Ticks with common noise do not multiply, but no silence is more probable than that of its loudest tick.
            survival_ = detector_.correlation != 0 ? minimum(survival_, silent) : survival_ * silent;
        }
        return survival_ < T(certain_survival);
    }

  private:
    const ThresholdDetector& detector_;
    double stiffness_;
    T largest_;
    T residual_[max_joints];          ///< noiseless
    int tick_ = 0, blind_ticks_ = 0;  ///< ticks before the detector is armed see nothing
    T survival_ = 1.0;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
