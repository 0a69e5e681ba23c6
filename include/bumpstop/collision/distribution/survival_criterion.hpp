/// @file
/// Criteria that end a line: once every body up to the largest offset has been detected, or touched.
#pragma once

#include "bumpstop/collision/collision_setup.hpp"
#include "bumpstop/collision/contact/contact.hpp"
#include "bumpstop/detection/gaussian_thresholds.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Ends a line once even the farthest body is detected with certainty: once its survival probability, that of no alarm
/// so far, is below `negligible_survival`.
template <class T>
class SurvivalCriterion {
  public:
    static constexpr double negligible_survival = 1e-20;

    SurvivalCriterion(const CollisionSetup& setup, const GaussianThresholds& detector, const Contact& contact)
        : detector_(&detector), stiffness_(contact.body.stiffness), largest_offset_(contact.offset.largest()) {
        while (unarmed_ticks_ <= setup.timing.steps && !detector.armed(setup.tick_time(unarmed_ticks_)))
            ++unarmed_ticks_;
    }

    /// Times of the line, one in each lane: distances [m] and torques per newton by joint [Nm/N or 1].
    void observe(const T& s, const T* torque_per_N) {
        const T force = max(s - largest_offset_, T(0.0)) * stiffness_;
        T torque[max_joints];
        for (int w = 0; w < detector_->monitored; ++w)
            torque[detector_->joint[std::size_t(w)]] = torque_per_N[detector_->joint[std::size_t(w)]] * force;
        observe_contact(force, torque);
    }
    /// The same from residuals by joint, without noise [Nm]; `touched` is above zero once contact has begun.
    void observe_contact(const T& touched, const T* residual) {
        touched_ = touched;
        for (int w = 0; w < detector_->monitored; ++w) residual_[w] = residual[detector_->joint[std::size_t(w)]];
        no_alarm_ = 1.0;
        if (detector_->filter == 0 && any(touched > T(0.0)))
            no_alarm_ = any_alarm<T>(*detector_, [&](int w) { return residual_[w]; }).no_alarm;
    }
    /// Called once for each of these times that is a tick, in order: whether no further tick is needed.
    bool finished(int moment) {
        const bool touched = lane_of(touched_, moment) > 0;
        double no_alarm = lane_of(no_alarm_, moment);
        if (detector_->filter != 0) {
            for (int w = 0; w < detector_->monitored; ++w)
                detector_->advance(filtered_[w], lane_of(residual_[w], moment));
            if (touched) no_alarm = any_alarm<double>(*detector_, [&](int w) { return filtered_[w].value; }).no_alarm;
        }
        if (tick_++ >= unarmed_ticks_ && touched) {
            // With correlated noise the probabilities do not multiply; survival is at most that of the likeliest alarm.
            survival_ = detector_->correlation != 0 ? min(survival_, no_alarm) : survival_ * no_alarm;
        }
        return survival_ < negligible_survival;
    }

  private:
    const GaussianThresholds* detector_;
    double stiffness_, largest_offset_;
    T touched_, no_alarm_, residual_[max_joints];     ///< at the times observed; residuals without noise [Nm]
    NoiselessResidual<double> filtered_[max_joints];  ///< after the detector's filter
    int tick_ = 0, unarmed_ticks_ = 0;
    double survival_ = 1;
};

/// Ends a line once even the farthest body is touched.
template <class T>
struct ContactCriterion {
    double largest_offset;  ///< [m]
    T distance{};           ///< at the times observed [m]

    void observe(const T& s, const T*) { distance = s; }
    bool finished(int moment) const { return lane_of(distance, moment) > largest_offset; }
};

/// Ends a line some ticks after another criterion would, because an elastic arm lags behind its reference, or because a
/// free body takes a while to separate.
template <class Criterion>
class LingeringCriterion {
  public:
    LingeringCriterion(const Criterion& criterion, int ticks) : criterion_(criterion), ticks_(ticks) {}

    template <class T>
    void observe(const T& s, const T* torque_per_N) {
        criterion_.observe(s, torque_per_N);
    }
    bool finished(int moment) {
        over_ = criterion_.finished(moment) || over_;
        return over_ && ticks_-- <= 0;
    }

  private:
    Criterion criterion_;
    int ticks_;
    bool over_ = false;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
