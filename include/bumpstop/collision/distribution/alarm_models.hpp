/// @file
/// How probable it is that a joint alarms at a tick: by the error function, from a table, or with correlated noise.
#pragma once

#include "bumpstop/collision/distribution/pre_contact_alarms.hpp"
#include "bumpstop/detection/alarm_table.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Registers of a block of offsets.
template <class T>
inline constexpr int block_registers = 8 / Scalar<T>::lanes;

/// Contact at a tick, for a block of offsets.
template <class T>
struct TickContact {
    int tick = 0;
    const double* torque_per_N;                  ///< by monitored joint [Nm/N]
    T force[block_registers<T>];                 ///< N
    T residual[max_joints][block_registers<T>];  ///< of monitored joints, without noise; not for alarms from a table
};

// An alarm model serves one block of offsets after another, tick by tick:
//   begin()        a block
//   at(contact)    a tick; of what it returns, chance(w, r, contact) is the probability that monitored joint w alarms
//                  at the offsets of register r, given no alarm before
//   skip(contact)  a tick at which the detector is not armed

/// White noise, with all digits of far tails.
template <class T>
class ExactAlarms {
  public:
    static constexpr bool tabulated = false;
    /// Ticks of a panel end once its survival probability is below this: no printed digit depends on the rest.
    static constexpr double negligible_survival = 1e-18;
    /// Joints whose residual grows less than this [standard deviations] count as not loaded by the contact.
    static constexpr double negligible_residual = 1e-12;
    /// Allowed error of interpolated probabilities; rounding of the joint positions alone makes 1e-12.
    static constexpr double interpolation_tolerance = 1e-10;
    static constexpr double max_interpolated_survival = 1e-18;
    static constexpr std::array interpolation_nodes{8, 12, 20};

    explicit ExactAlarms(const GaussianThresholds& detector) : detector_(detector) {}

    void begin() {}
    const ExactAlarms& at(const TickContact<T>&) const { return *this; }
    void skip(const TickContact<T>&) {}
    AlarmProbability<T> chance(int w, int r, const TickContact<T>& contact) const {
        return joint_alarm(detector_, w, contact.residual[w][r]);
    }

  private:
    const GaussianThresholds& detector_;
};

/// White noise, from a table, within about 1e-8. For clamped contact.
template <class T>
class TabulatedAlarms {
  public:
    static constexpr bool tabulated = true;
    static constexpr double negligible_survival = 1e-9;
    /// Such a joint is a flange whose axis passes through the contact point.
    static constexpr double negligible_residual = 1e-6;
    static constexpr double interpolation_tolerance = 1e-6, max_interpolated_survival = 1e-6;
    static constexpr std::array interpolation_nodes{6};
    /// Width of a panel in standard deviations of the residual, where detections may be so improbable that the shares
    /// of the joints in them depend on far tails. Elsewhere panels are as wide as the table allows.
    static constexpr double max_uncertain_growth = 1.5;
    static constexpr double max_offset_growth = 0.5;  ///< the same in standard deviations of the offset

    TabulatedAlarms(const GaussianThresholds& detector, const AlarmTable& table) : detector_(detector), table_(table) {}

    struct Tick {
        AlarmTable::Near near;

        AlarmProbability<T> chance(int w, int r, const TickContact<T>& contact) const {
            const T alarm = near.template alarm<T>(w, contact.force[r]);
            return {alarm, 1.0 - alarm};
        }
    };
    void begin() {}
    Tick at(const TickContact<T>& contact) const {
        // From the first lane of a block to its last the offset grows, and the force falls.
        const double first = lane_of(contact.force[0], 0),
                     last = lane_of(contact.force[block_registers<T> - 1], Scalar<T>::lanes - 1);
        return {table_.near<T>(detector_.monitored, contact.torque_per_N, 0.5 * (first + last))};
    }
    void skip(const TickContact<T>&) {}

  private:
    const GaussianThresholds& detector_;
    const AlarmTable& table_;
};

/// Ticks that depend on those before them: noise that is correlated from tick to tick, or the residual of an observer.
template <class T>
class CorrelatedAlarms {
  public:
    static constexpr bool tabulated = false;
    static constexpr double negligible_survival = ExactAlarms<T>::negligible_survival;
    static constexpr double negligible_residual = -1;  ///< a joint without load alarms less often at later ticks, too
    static constexpr double interpolation_tolerance = ExactAlarms<T>::interpolation_tolerance;
    static constexpr double max_interpolated_survival = ExactAlarms<T>::max_interpolated_survival;
    static constexpr std::array interpolation_nodes = ExactAlarms<T>::interpolation_nodes;

    CorrelatedAlarms(const GaussianThresholds& detector, const PreContactAlarms& before)
        : detector_(detector), before_(before), joint_(std::size_t(detector.monitored * registers)) {}

    void begin() {
        for (Joint& joint : joint_) {
            joint.residual = {};
            joint.loaded = false;
        }
    }
    CorrelatedAlarms& at(const TickContact<T>&) {
        allow_interruption();  // a panel of thousands of ticks takes seconds
        return *this;
    }
    AlarmProbability<T> chance(int w, int r, const TickContact<T>& contact) {
        Joint& joint = joint_[place(w, r)];
        const T own = detector_.advance(joint.residual, contact.residual[w][r]);
        if (!before_.correlated(w)) return joint_alarm(detector_, w, own);
        if (!joint.loaded) {
            if (all(abs(own) * detector_.scale[w] <= T(ExactAlarms<T>::negligible_residual))) {
                const double alarm = before_.no_contact(contact.tick).single[std::size_t(w)];
                return {alarm, 1 - alarm};
            }
            joint.density.begin(before_.density_before(w, contact.tick));
            joint.loaded = true;
        }
        return propagate_tick(before_.noise(w), joint.density, own, work_);
    }
    /// A tick that is not armed says nothing about the noise.
    void skip(const TickContact<T>& contact) {
        for (int w = 0; w < detector_.monitored; ++w)
            for (int r = 0; r < registers; ++r) detector_.advance(joint_[place(w, r)].residual, contact.residual[w][r]);
    }

  private:
    static constexpr int registers = block_registers<T>;
    static std::size_t place(int w, int r) { return std::size_t(w * registers + r); }

    /// A joint at the offsets of a register. Until the contact loads it, its noise is that of ticks without contact.
    struct Joint {
        NoiselessResidual<T> residual;
        bool loaded = false;
        SurvivingNoiseDensity<T> density;
    };

    const GaussianThresholds& detector_;
    const PreContactAlarms& before_;
    std::vector<Joint> joint_;  ///< [joint][register]
    std::vector<T> work_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
