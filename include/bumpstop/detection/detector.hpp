/// @file
/// The collision detector of a control loop: a sample in, a state out, at every tick.
///
/// Nothing is allocated, nothing throws. Signs: the residual is estimated minus predicted motor torque.
#pragma once

#include <optional>

#include "bumpstop/detection/alarm_logic.hpp"
#include "bumpstop/detection/event_span.hpp"
#include "bumpstop/detection/fitted_dynamics.hpp"
#include "bumpstop/detection/isolation.hpp"
#include "bumpstop/detection/payload.hpp"
#include "bumpstop/detection/sample_validator.hpp"
#include "bumpstop/joint/joint_torque_batch.hpp"
#include "bumpstop/signal/causal_derivative.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

enum class ResidualKind {
    direct,    // estimated torque minus Newton-Euler (eq 4.1)
    observer,  // minus the momentum observer's external torque
};
enum class TorqueSource {
    current,  // the joint model makes torque of motor current
    torque,   // the signal is joint torque
};

struct DetectorSettings {
    ResidualKind residual = ResidualKind::direct;
    TorqueSource source = TorqueSource::current;
    double observer_gain = 50;        ///< K [1/s]
    double window = 0.07;             ///< of the derivatives, from its oldest to its newest sample [s]
    int degree = 2;                   ///< of the derivatives, see CausalDerivative
    Vector3 gravity{0, 0, -9.80665};  ///< base frame [m/s2]
    SampleLimits samples;
    AlarmSettings alarm;
    double max_no_data_time = 0;                ///< without data for longer asks for a stop [s]; 0: at once
    std::uint32_t unknown = 0;                  ///< joint j as bit j: its torque is not known, and its residual is zero
    std::array<double, max_joints> noise_sd{};  ///< of the residual, to be given: above 0; infinite: not monitored
    std::array<double, max_joints> dead_zone{};  ///< torque that friction can hide at standstill [Nm or N]
    LinkPoint contact;                           ///< where the force of an event is given
    Vector3 direction{0, 0, -1};                 ///< unit vector the force is given along, base frame
    Payload payload;                             ///< declared
    PayloadMonitorSettings payload_monitor;
};

/// Of one tick. In a tick without data `residual` and `fast` are NaN; `threshold`, `qd` and `qdd` are those of a tick before.
struct DetectorOutput {
    DetectorState state = DetectorState::no_data;
    SampleFault fault = SampleFault::filling;
    bool stop = true;                  ///< the arm must stop: an alarm, or no data for longer than allowed
    bool late = false;                 ///< samples are missing before this one
    bool masked_while_arming = false;  ///< over a threshold, but the detector is arming
    bool payload_changed = false;
    double t = 0;                                ///< of the sample [s]
    std::uint32_t over = 0, over_fast = 0;       ///< joint j as bit j
    std::array<double, max_joints> residual{};   ///< Nm or N
    std::array<double, max_joints> fast{};       ///< of the band-pass channel; zero where no joint is monitored there
    std::array<double, max_joints> threshold{};  ///< of the residual in this tick
    std::array<double, max_joints> qd{}, qdd{};  ///< as the detector sees them
};

/// An event: the tick that raised the alarm, or that passed a threshold again, after a pause, while the alarm was on.
/// In the units of DetectorOutput.
struct DetectorEvent {
    double t = 0;  ///< s
    std::uint32_t over = 0, over_fast = 0;
    std::array<double, max_joints> residual{}, threshold{}, q{};
    EventSpan span;                           ///< up to the last tick
    std::array<double, max_joints> hidden{};  ///< torque that friction may have hidden, as the joint was slow [Nm or N]
    ContactEstimate contact;
    bool payload_changed = false;  ///< a changed payload explains the residuals up to here
    double payload_change = 0;     ///< kg
};

class Detector {
  public:
    /// `links`: inertia of every link. `joints` and `errors`: of the joint model, or empty where the signal is torque.
    /// `fitted`: dynamics that predict the torque in place of `links`; then there is no joint model.
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
          watch_(settings.payload_monitor, chain.dof),
          fitted_(fitted) {
        for (int j = 0; j < chain.dof; ++j) {
            links_[j] = links[j];
            ours_[j] = 1;
            known_[j] = settings.unknown >> j & 1 ? 0 : 1;
        }
        for (int j = 0; j < int(joints.size()); ++j) reflected_[j] = joints[j].inertia;
        set_payload(settings.payload);
    }

    /// Judges a sample. The result stays until the next call.
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
        // A gap is told once, by the sample after it.
        if (!full) return no_data(fault == SampleFault::gap && begun_ ? fault : SampleFault::filling, sample.t);
        if (settings_.samples.measured_rates) out_.qd = sample.qd;
        const double* qd = settings_.samples.measured_rates ? out_.qd.data() : derivative_.rate();
        const double* qdd = settings_.samples.measured_rates ? derivative_.rate() : derivative_.acceleration();
        JointAngles<double>& angle = angle_;
        // In an order that lets what waits for itself wait beside others.
        bank_.take_logarithms(qd);
        angle.set_padded(chain_, validator_.position());
        bank_.take_powers(qd);
        if (fitted_) fitted_->advance(chain_.dof, validator_.interval(), qd);
        bool finite = false;
        if (settings_.residual == ResidualKind::direct) {
            finite = direct_residual(angle, qd, qdd);
        } else if (observe(angle, qd, qdd)) {
            finite = observed_residual(qdd);
        } else {
            return no_data(SampleFault::filling, sample.t);
        }
        if (!finite) {
            reset_history();
            return no_data(SampleFault::not_finite, sample.t);
        }
        begun_ = true;
        return judged(sample, angle, qd, qdd);
    }

    /// No sample has been valid for longer than the longest interval: `update` was not called, or called in vain.
    bool overdue(double now) const noexcept {
        return !(now - validator_.last_time() <= settings_.samples.longest_interval);
    }
    /// The alarm has been dealt with; the next tick is judged anew.
    void acknowledge() noexcept { alarm_logic_.acknowledge(); }
    /// As after construction, but for the payload.
    void reset() noexcept {
        validator_.reset();
        bank_.reset();
        alarm_logic_.reset();
        watch_.reset();
        derivative_.reset();
        observer_.reset();
        if (fitted_) fitted_->reset();
        begun_ = false;
        no_data_ticks_ = events_ = 0;
        seen_ = -std::numeric_limits<double>::infinity();
        out_ = {};
    }
    /// Declares what the arm carries from now on.
    void set_payload(const Payload& payload) noexcept {
        const int last = chain_.dof - 1;
        std::array<LinkInertia, max_joints> links = links_;
        links[last] = with_payload(links_[last], payload);
        inertias_ = Inertias(chain_, std::span<const LinkInertia>(links.data(), std::size_t(chain_.dof)));
        payload_point_ = link_point(chain_, last, payload.center);
        if (fitted_) fitted_->prepare(chain_, payload);
        watch_.reset();
        // The momentum was that of another body.
        observer_.reset();
    }

    const DetectorOutput& output() const noexcept { return out_; }
    /// Events so far; in a tick that begins one it grows.
    long events() const noexcept { return events_; }
    /// The last event.
    const DetectorEvent& event() const noexcept { return event_; }
    /// What the residuals of the last seconds say of the payload.
    const PayloadMonitor& payload() const noexcept { return watch_; }
    /// The alarm stands.
    bool alarmed() const noexcept { return alarm_logic_.state() == DetectorState::alarm; }
    const DetectorSettings& settings() const noexcept { return settings_; }
    int joints() const noexcept { return chain_.dof; }

  private:
    using L = Lanes<native_lanes>;

    /// Of the array, what belongs to joints that `mask` has a 1 for; zero else.
    static L only(const std::array<double, max_joints>& mask, const double* value, int first) noexcept {
        return select(load<L>(&mask[first]) > L(0.5), load<L>(value + first), L(0.0));
    }
    /// Takes the residual of the joints from `first` on, but zero where it is not known. Where that and the acceleration
    /// are finite.
    MaskOf<L> taken(int first, L residual, const double* qdd) noexcept {
        const L known = select(load<L>(&known_[first]) > L(0.5), residual, L(0.0));
        store(known, &out_.residual[first]);
        const L size = abs(known) + abs(only(ours_, qdd, first));
        return size <= L(std::numeric_limits<double>::max());
    }
    [[gnu::noinline, gnu::cold]] void reset_history() noexcept {
        derivative_.reset();
        observer_.reset();
        if (fitted_) fitted_->reset();
        alarm_logic_.interrupt();
    }

    /// Torque that the drives give, or, for the observer, give but for reflected inertia.
    void estimate(const double* qd, const double* qdd, double* tau) noexcept {
        const bool mapped = settings_.source == TorqueSource::current && !fitted_;
        errors_ = settings_.alarm.thresholds.model_errors > 0 && mapped;
        if (fitted_) {
            for (int j = 0; j < chain_.dof; ++j) tau[j] = fitted_->gain[j] * validator_.signal()[j];
        } else if (mapped) {
            bank_.map(validator_.signal(), qd, qdd, tau, errors_ ? sd_.data() : nullptr);
        } else {
            for (int first = 0; first < chain_.dof; first += native_lanes)
                store(load<L>(validator_.signal() + first), tau + first);
        }
    }
    /// Fills out_.residual; false where it is not finite, or an acceleration is not.
    bool direct_residual(const JointAngles<double>& angle, const double* qd, const double* qdd) noexcept {
        alignas(64) double tau[max_joints], predicted[max_joints];
        estimate(qd, qdd, tau);
        predict(angle, qd, qdd, predicted);
        MaskOf<L> finite = L(0.0) <= L(0.0);
        for (int first = 0; first < chain_.dof; first += native_lanes)
            finite = finite & taken(first, load<L>(tau + first) - load<L>(predicted + first), qdd);
        return all(finite);
    }
    bool observed_residual(const double* qdd) noexcept {
        MaskOf<L> finite = L(0.0) <= L(0.0);
        for (int first = 0; first < chain_.dof; first += native_lanes)
            finite = finite & taken(first, -load<L>(observer_.estimate() + first), qdd);
        return all(finite);
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
    /// The observer's next estimate; false while it begins. The acceleration only tells how motors are loaded.
    [[gnu::noinline, gnu::flatten]] bool observe(const JointAngles<double>& angle, const double* qd,
                                                 const double* qdd) noexcept {
        const int n = chain_.dof;
        static constexpr double nothing[max_joints] = {};
        alignas(64) double tau[max_joints];
        estimate(qd, nothing, tau);
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

    const DetectorOutput& judged(const DetectorSample& sample, const JointAngles<double>& angle, const double* qd,
                                 const double* qdd) noexcept {
        const bool begins = alarm_logic_.update(sample.t, validator_.interval(), out_.residual.data(), qd, qdd,
                                                errors_ ? sd_.data() : nullptr);
        out_.state = alarm_logic_.state();
        out_.fault = SampleFault::none;
        out_.over = alarm_logic_.over();
        out_.over_fast = alarm_logic_.over_fast();
        out_.masked_while_arming = alarm_logic_.masked_while_arming();
        seen_ = sample.t;
        no_data_ticks_ = 0;
        for (int first = 0; first < chain_.dof; first += native_lanes) {
            store(only(ours_, alarm_logic_.threshold(), first), &out_.threshold[first]);
            store(only(ours_, alarm_logic_.fast(), first), &out_.fast[first]);
            store(only(ours_, qd, first), &out_.qd[first]);
            store(only(ours_, qdd, first), &out_.qdd[first]);
        }
        if (watch_.due(sample.t)) weigh(sample, angle);
        out_.payload_changed = watch_.recognised();
        if (begins) {
            record(sample, angle);
        } else if (alarm_logic_.over_armed()) {
            event_.span.extend(sample.t, out_.residual.data(), out_.threshold.data(), chain_.dof);
        }
        out_.stop = out_.state == DetectorState::alarm;
        return out_;
    }

    [[gnu::noinline, gnu::cold]] void weigh(const DetectorSample& sample, const JointAngles<double>& angle) noexcept {
        Posture<double> posture;
        forward_kinematics(chain_, sample.q.data(), angle, posture);
        const Point3<double> p = posture.position(payload_point_);
        double per_kilogram[max_joints];
        for (int j = 0; j < chain_.dof; ++j) {
            const Point3<double> column = linear_column(chain_, posture, p, j);
            const Vector3& g = settings_.gravity;
            per_kilogram[j] = -(column.x * g[0] + column.y * g[1] + column.z * g[2]);
        }
        watch_.look(sample.t, out_.residual.data(), per_kilogram, settings_.noise_sd.data());
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
        event_.payload_change = watch_.change();
        event_.span.start(sample.t, out_.residual.data(), out_.threshold.data(), chain_.dof);
        ++events_;
    }

    [[gnu::noinline, gnu::cold]] const DetectorOutput& no_data(SampleFault fault, double t) noexcept {
        // An alarm that stands is not hidden by a bad sample, but the bad sample is told.
        out_.state = DetectorState::no_data;
        out_.fault = fault;
        alarm_logic_.skip();
        // Times may stand still or run backwards; ticks do not.
        ++no_data_ticks_;
        const bool patient = t - seen_ <= settings_.max_no_data_time &&
                             no_data_ticks_ * settings_.samples.period <= settings_.max_no_data_time;
        out_.stop = alarm_logic_.state() == DetectorState::alarm || !patient;
        for (int j = 0; j < chain_.dof; ++j) out_.residual[j] = std::numeric_limits<double>::quiet_NaN();
        out_.fast = out_.residual;
        return out_;
    }

    Chain chain_;
    DetectorSettings settings_;
    std::array<LinkInertia, max_joints> links_{};
    // 1 for a joint of the chain, and for one whose torque is known; 0 else: arrays may hold anything beyond the last joint.
    std::array<double, max_joints> ours_{}, known_{};
    std::array<double, max_joints> reflected_{};  // inertia of the joint model, which the observer's momentum lacks
    Inertias inertias_;
    JointTorqueBank bank_;
    CausalDerivative<max_joints> derivative_;
    SampleValidator validator_;
    MomentumObserver observer_;
    AlarmLogic alarm_logic_;
    PayloadMonitor watch_;
    std::optional<FittedDynamics> fitted_;
    LinkPoint payload_point_;
    JointAngles<double> angle_{};
    bool begun_ = false, errors_ = false;
    long no_data_ticks_ = 0, events_ = 0;
    double seen_ = -std::numeric_limits<double>::infinity();  // when a tick was last judged
    std::array<double, max_joints> sd_{};
    DetectorOutput out_;
    DetectorEvent event_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
