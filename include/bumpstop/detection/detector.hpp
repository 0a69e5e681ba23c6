/// @file
/// The collision detector of a control loop: takes a sample and gives a state at every tick.
///
/// Nothing is allocated, nothing throws. Signs: the residual is estimated minus predicted motor torque.
#pragma once

#include <optional>

#include "bumpstop/detection/alarm_logic.hpp"
#include "bumpstop/detection/fitted_dynamics.hpp"
#include "bumpstop/detection/isolation.hpp"
#include "bumpstop/detection/payload.hpp"
#include "bumpstop/detection/sample_validator.hpp"
#include "bumpstop/joint/joint_torque_batch.hpp"
#include "bumpstop/signal/causal_derivative.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

enum class ResidualKind {
    direct,    // estimated torque minus inverse dynamics (Schroeder 2013, eq 4.1)
    observer,  // minus the external torque of the momentum observer
};
enum class TorqueSource {
    current,  // the joint model gives torque from motor current
    torque,   // the signal is joint torque
};

struct DetectorSettings {
    ResidualKind residual = ResidualKind::direct;
    TorqueSource source = TorqueSource::current;
    double observer_gain = 50;        ///< K [1/s]
    double window = 0.07;             ///< window of the derivatives, from the oldest to the newest sample [s]
    int degree = 2;                   ///< degree of the fitted polynomial, see CausalDerivative
    Vector3 gravity{0, 0, -9.80665};  ///< base frame [m/s2]
    SampleLimits samples;
    AlarmSettings alarm;
    double max_no_data_time = 0;                ///< a longer time without data asks for a stop [s]
    std::uint32_t unknown = 0;                  ///< joint j as bit j: its torque is not known, and its residual is zero
    std::array<double, max_joints> noise_sd{};  ///< of the residual; required, above 0; infinite: not monitored
    std::array<double, max_joints> dead_zone{};  ///< torque that friction can hide at standstill [Nm or N]
    LinkPoint contact;                           ///< where the force of an event is given
    Vector3 direction{0, 0, -1};                 ///< unit vector the force is given along, base frame
    Payload payload;                             ///< declared payload
    PayloadMonitorSettings payload_monitor;
};

/// Output of one tick. Without data `residual` and `fast` are NaN; `threshold`, `qd` and `qdd` are the last ones.
struct DetectorOutput {
    DetectorState state = DetectorState::no_data;
    SampleFault fault = SampleFault::filling;
    bool stop = true;                  ///< the arm must stop: an alarm, or no data for longer than allowed
    bool late = false;                 ///< samples are missing before this one
    bool masked_while_arming = false;  ///< over a threshold, but the detector is arming
    bool payload_changed = false;
    double t = 0;                               ///< time of the sample [s]
    std::uint32_t over = 0, over_fast = 0;      ///< joints over their thresholds, joint j as bit j
    std::array<double, max_joints> residual{};  ///< Nm or N
    std::array<double, max_joints> fast{};      ///< band-pass channel; zero where no joint is monitored there [Nm or N]
    std::array<double, max_joints> threshold{};  ///< of the residual in this tick [Nm or N]
    std::array<double, max_joints> qd{}, qdd{};  ///< rates and accelerations that the residual is computed with
};

/// An event: the tick that raised the alarm, or that exceeded a threshold again after a pause, while the alarm was on.
/// Units are those of DetectorOutput.
struct DetectorEvent {
    double t = 0;  ///< s
    std::uint32_t over = 0, over_fast = 0;
    std::array<double, max_joints> residual{}, threshold{}, q{};
    EventSpan span;                           ///< up to the last tick
    std::array<double, max_joints> hidden{};  ///< torque that friction of slow joints may have hidden [Nm or N]
    ContactEstimate contact;
    bool payload_changed = false;  ///< a changed payload explains the residuals so far
    double payload_change = 0;     ///< kg
};

class Detector {
  public:
    /// `links`: inertia of every link. `joints` and `errors`: the joint model, empty where the signal is torque.
    /// `fitted`: dynamics that predict the torque in place of `links`; there is no joint model then.
    Detector(const Chain& chain, std::span<const LinkInertia> links, std::span<const JointTorqueParameters> joints,
             std::span<const JointTorqueErrors> errors, const DetectorSettings& settings,
             const std::optional<FittedDynamics>& fitted = std::nullopt) noexcept
        : chain_(chain),
          settings_(settings),
          bank_(joints, errors),
          derivative_(window_samples(settings.window, settings.samples.period, settings.degree), settings.degree,
                      chain.dof),
          validator_(settings.samples, chain.dof),
          observer_(settings.observer_gain, chain.dof),
          alarm_logic_(settings.alarm, chain.dof),
          payload_monitor_(settings.payload_monitor, chain.dof),
          fitted_(fitted) {
        for (int j = 0; j < chain.dof; ++j) {
            links_[j] = links[j];
            is_joint_[j] = 1;
            has_torque_[j] = settings.unknown >> j & 1 ? 0 : 1;
        }
        for (int j = 0; j < int(joints.size()); ++j) reflected_[j] = joints[j].inertia;
        set_payload(settings.payload);
    }

    /// Evaluates a sample. The result is valid until the next call.
    [[gnu::flatten]] const DetectorOutput& update(const DetectorSample& sample) noexcept {
        out_.t = sample.t;
        out_.masked_while_arming = false;
        out_.over = out_.over_fast = 0;
        const bool moves = derivative_.full();
        const SampleFault fault =
            validator_.check(sample, {moves ? out_.qd.data() : nullptr, moves ? derivative_.span() : 0.0});
        out_.late = validator_.late();
        if (fault == SampleFault::gap) reset_history();
        if (fault != SampleFault::none && fault != SampleFault::gap) return no_data(fault, sample.t);
        const bool full = settings_.samples.measured_rates ? derivative_.update(sample.t, sample.qd.data())
                                                           : derivative_.update(sample.t, validator_.position());
        // A gap is reported once, with the sample after it.
        if (!full) return no_data(fault == SampleFault::gap && ready_ ? fault : SampleFault::filling, sample.t);
        if (settings_.samples.measured_rates) out_.qd = sample.qd;
        const double* qd = settings_.samples.measured_rates ? out_.qd.data() : derivative_.rate();
        const double* qdd = settings_.samples.measured_rates ? derivative_.rate() : derivative_.acceleration();
        JointAngles<double>& angle = angle_;
        angle.set_padded(chain_, validator_.position());
        if (fitted_) fitted_->advance(chain_.dof, validator_.interval(), qd);
        bool finite = false;
        if (settings_.residual == ResidualKind::direct) {
            alignas(64) double tau[max_joints], predicted[max_joints];
            estimate(qd, qdd, tau);
            predict(angle, qd, qdd, predicted);
            finite = store_residual(tau, predicted, qdd);
        } else if (observe(angle, qd, qdd)) {
            finite = store_residual(zeros, observer_.estimate(), qdd);
        } else {
            return no_data(SampleFault::filling, sample.t);
        }
        if (!finite) {
            reset_history();
            return no_data(SampleFault::not_finite, sample.t);
        }
        ready_ = true;
        return evaluate(sample, angle, qd, qdd);
    }

    /// The last valid sample is older than the longest interval: `update` was not called, or samples were invalid.
    bool overdue(double now) const noexcept {
        return !(now - validator_.last_time() <= settings_.samples.longest_interval);
    }
    /// Ends the alarm; the next tick may raise another.
    void acknowledge() noexcept { alarm_logic_.acknowledge(); }
    /// Restores the state after construction, except for the payload.
    void reset() noexcept {
        validator_.reset();
        bank_.reset();
        alarm_logic_.reset();
        payload_monitor_.reset();
        derivative_.reset();
        observer_.reset();
        if (fitted_) fitted_->reset();
        ready_ = false;
        no_data_ticks_ = events_ = 0;
        last_tick_ = -std::numeric_limits<double>::infinity();
        out_ = {};
        event_ = {};
    }
    /// Declares the payload from now on. An observer keeps its residual in the next tick, as nothing is known of that.
    void set_payload(const Payload& payload) noexcept {
        inertias_ = inertias_with_payload(chain_, links_, payload);
        payload_point_ = link_point(chain_, chain_.dof - 1, payload.center);
        if (fitted_) fitted_->prepare(chain_, payload);
        payload_monitor_.reset();
        observer_.rebase();
    }

    const DetectorOutput& output() const noexcept { return out_; }
    /// Events so far; in a tick that begins one it grows.
    long events() const noexcept { return events_; }
    /// The last event.
    const DetectorEvent& event() const noexcept { return event_; }
    /// Estimate of the payload from the residuals of the last seconds.
    const PayloadMonitor& payload() const noexcept { return payload_monitor_; }
    /// An alarm has been raised and not acknowledged.
    bool alarmed() const noexcept { return alarm_logic_.state() == DetectorState::alarm; }
    const DetectorSettings& settings() const noexcept { return settings_; }
    int joints() const noexcept { return chain_.dof; }

  private:
    using L = Lanes<native_lanes>;

    static constexpr double zeros[max_joints] = {};

    /// The values of joints whose `mask` is 1; zero for the others.
    static L masked(const std::array<double, max_joints>& mask, const double* value, int first) noexcept {
        return select(load<L>(&mask[first]) > L(0.5), load<L>(value + first), L(0.0));
    }
    /// Stores the residual, zero where the torque is not known. False where it or an acceleration is not finite.
    bool store_residual(const double* estimated, const double* predicted, const double* qdd) noexcept {
        MaskOf<L> finite = mask_of<L>(true);
        for (int first = 0; first < chain_.dof; first += native_lanes) {
            const L difference = load<L>(estimated + first) - load<L>(predicted + first);
            const L residual = select(load<L>(&has_torque_[first]) > L(0.5), difference, L(0.0));
            store(residual, &out_.residual[first]);
            const L size = abs(residual) + abs(masked(is_joint_, qdd, first));
            finite = finite & (size <= L(std::numeric_limits<double>::max()));
        }
        return all(finite);
    }
    [[gnu::noinline, gnu::cold]] void reset_history() noexcept {
        derivative_.reset();
        observer_.reset();
        if (fitted_) fitted_->reset();
        alarm_logic_.interrupt();
    }

    /// Torque of the drives from the signal. With `qdd` zero it includes the torque that accelerates the reflected
    /// inertia, as the observer needs it.
    void estimate(const double* qd, const double* qdd, double* tau) noexcept {
        const bool mapped = settings_.source == TorqueSource::current && !fitted_;
        errors_ = settings_.alarm.thresholds.model_errors > 0 && mapped;
        if (fitted_) {
            for (int j = 0; j < chain_.dof; ++j) tau[j] = fitted_->gain[j] * validator_.signal()[j];
        } else if (mapped) {
            bank_.torque(validator_.signal(), qd, qdd, tau, errors_ ? sd_.data() : nullptr);
        } else {
            for (int first = 0; first < chain_.dof; first += native_lanes)
                store(load<L>(validator_.signal() + first), tau + first);
        }
    }
    void predict(const JointAngles<double>& angle, const double* qd, const double* qdd, double* predicted) noexcept {
        store(L(0.0), predicted + (chain_.dof - 1) / native_lanes * native_lanes);
        const JointMotion<double> motion{validator_.position(), angle, qd, qdd};
        if (fitted_) {
            fitted_->predict(chain_, motion, settings_.gravity, predicted);
        } else {
            inverse_dynamics(chain_, inertias_, motion, settings_.gravity, predicted);
        }
    }
    /// Updates the momentum observer; false at its first sample. `qdd` is only used for the load of the motors.
    [[gnu::noinline, gnu::flatten]] bool observe(const JointAngles<double>& angle, const double* qd,
                                                 const double* qdd) noexcept {
        const int n = chain_.dof;
        alignas(64) double tau[max_joints];
        estimate(qd, zeros, tau);
        MomentumTerms<double> terms;
        if (fitted_) {
            double friction[max_joints];
            fitted_->momentum(chain_, {validator_.position(), angle, qd, qdd}, settings_.gravity, terms, friction);
            for (int j = 0; j < n; ++j) tau[j] -= friction[j];
        } else {
            momentum_terms(chain_, inertias_, validator_.position(), angle, qd, settings_.gravity, terms);
        }
        for (int j = 0; j < n; ++j) {
            terms.momentum[j] += reflected_[j] * qd[j];
            tau[j] += terms.velocity_force[j] - terms.gravity[j];
        }
        return observer_.update(validator_.interval(), terms.momentum, tau);
    }

    const DetectorOutput& evaluate(const DetectorSample& sample, const JointAngles<double>& angle, const double* qd,
                                   const double* qdd) noexcept {
        const bool begins = alarm_logic_.update(sample.t, validator_.interval(), out_.residual.data(), qd, qdd,
                                                errors_ ? sd_.data() : nullptr);
        out_.state = alarm_logic_.state();
        out_.fault = SampleFault::none;
        out_.over = alarm_logic_.over();
        out_.over_fast = alarm_logic_.over_fast();
        out_.masked_while_arming = alarm_logic_.masked_while_arming();
        last_tick_ = sample.t;
        no_data_ticks_ = 0;
        for (int first = 0; first < chain_.dof; first += native_lanes) {
            store(masked(is_joint_, alarm_logic_.threshold(), first), &out_.threshold[first]);
            store(masked(is_joint_, alarm_logic_.fast(), first), &out_.fast[first]);
            store(masked(is_joint_, qd, first), &out_.qd[first]);
            store(masked(is_joint_, qdd, first), &out_.qdd[first]);
        }
        if (payload_monitor_.due(sample.t)) update_payload_monitor(sample, angle);
        out_.payload_changed = payload_monitor_.recognised();
        if (begins) {
            record(sample, angle);
        } else if (alarm_logic_.over_armed()) {
            event_.span.extend(sample.t, out_.residual.data(), out_.threshold.data(), chain_.dof);
        }
        out_.stop = out_.state == DetectorState::alarm;
        return out_;
    }

    [[gnu::noinline, gnu::cold]] void update_payload_monitor(const DetectorSample& sample,
                                                             const JointAngles<double>& angle) noexcept {
        Posture<double> posture;
        forward_kinematics(chain_, sample.q.data(), angle, posture);
        const Point3<double> p = posture.position(payload_point_);
        double per_kilogram[max_joints];
        for (int j = 0; j < chain_.dof; ++j) {
            const Point3<double> column = linear_column(chain_, posture, p, j);
            const Vector3& g = settings_.gravity;
            per_kilogram[j] = -(column.x * g[0] + column.y * g[1] + column.z * g[2]);
        }
        payload_monitor_.update(sample.t, out_.residual.data(), per_kilogram, settings_.noise_sd.data());
    }

    [[gnu::noinline, gnu::cold]] void record(const DetectorSample& sample, const JointAngles<double>& angle) noexcept {
        Posture<double> posture;
        forward_kinematics(chain_, sample.q.data(), angle, posture);
        event_.t = sample.t;
        event_.over = out_.over;
        event_.over_fast = out_.over_fast;
        event_.residual = out_.residual;
        event_.threshold = out_.threshold;
        event_.q = sample.q;
        for (int j = 0; j < chain_.dof; ++j)
            event_.hidden[j] =
                hidden_torque(settings_.dead_zone[j], out_.qd[j], settings_.alarm.thresholds.rest_speed[j]);
        const auto noise =
            contact_noise(chain_.dof, out_.residual.data(), settings_.noise_sd.data(), event_.hidden.data());
        event_.contact = estimate_contact(chain_, posture, out_.residual.data(), noise.data(), settings_.contact,
                                          settings_.direction);
        event_.payload_changed = out_.payload_changed;
        event_.payload_change = payload_monitor_.change();
        event_.span.start(sample.t, out_.residual.data(), out_.threshold.data(), chain_.dof);
        ++events_;
    }

    [[gnu::noinline, gnu::cold]] const DetectorOutput& no_data(SampleFault fault, double t) noexcept {
        // The state reports the invalid sample; an alarm that has been raised still asks for a stop.
        out_.state = DetectorState::no_data;
        out_.fault = fault;
        alarm_logic_.skip();
        // Ticks are counted as well, because invalid time stamps may stand still or run backwards.
        ++no_data_ticks_;
        const bool tolerated = t - last_tick_ <= settings_.max_no_data_time &&
                               no_data_ticks_ * settings_.samples.period <= settings_.max_no_data_time;
        out_.stop = alarm_logic_.state() == DetectorState::alarm || !tolerated;
        for (int j = 0; j < chain_.dof; ++j) out_.residual[j] = std::numeric_limits<double>::quiet_NaN();
        out_.fast = out_.residual;
        return out_;
    }

    Chain chain_;
    DetectorSettings settings_;
    std::array<LinkInertia, max_joints> links_{};
    // Masks, 1 or 0: joints of the chain, as arrays may hold anything beyond the last; joints whose torque is known.
    std::array<double, max_joints> is_joint_{}, has_torque_{};
    std::array<double, max_joints> reflected_{};  // inertia of the joint model, added to the momentum
    Inertias inertias_;
    JointTorqueBank bank_;
    CausalDerivative<max_joints> derivative_;
    SampleValidator validator_;
    MomentumObserver observer_;
    AlarmLogic alarm_logic_;
    PayloadMonitor payload_monitor_;
    std::optional<FittedDynamics> fitted_;
    LinkPoint payload_point_;
    JointAngles<double> angle_{};
    bool ready_ = false, errors_ = false;
    long no_data_ticks_ = 0, events_ = 0;
    double last_tick_ = -std::numeric_limits<double>::infinity();  // time of the last tick with data
    std::array<double, max_joints> sd_{};
    DetectorOutput out_;
    DetectorEvent event_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
