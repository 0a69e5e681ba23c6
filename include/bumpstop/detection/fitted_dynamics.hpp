/// @file
/// Joint torques by identified dynamics, sample by sample: base parameters, friction, rotors and offsets.
///
/// Python identifies them (identification/dynamics); bumpstop/detection/loop/fitted_dynamics.py writes them to the
/// detector's file. Nothing is allocated, nothing throws.
#pragma once

#include <algorithm>
#include <cmath>
#include <span>

#include "bumpstop/detection/payload.hpp"
#include "bumpstop/model/dynamics.hpp"
#include "bumpstop/model/momentum.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Torque of a motor's friction, rotor and offset on the joint that it drives, or on the joints that share it.
///
/// With the motor's speed v = sum_j share_j qd_j and its smoothed sign s (FrictionSign), joint j gets share_j times
///   coulomb s + viscous v + rotor dv/dt + offset + bend s (sqrt(u) - 4/15 - 4 u / 5),  u = min(|v| / top_speed, 1)
/// and load s |torque of inverse dynamics at the joint|.
struct FittedMotor {
    std::array<double, max_joints> share{};
    double sign_speed = 1;  ///< above 0 [rad/s or m/s]
    double coulomb = 0, viscous = 0, rotor = 0, offset = 0, bend = 0;
    double top_speed = std::numeric_limits<double>::infinity();  ///< infinite: there is no bend term
    double load = 0;                                             ///< only of a motor of a single joint [1]
    double presliding = 0;  ///< travel over which the sign reverses [rad or m]; 0: the sign follows the speed at once
};

/// The smoothed sign of a motor's friction: tanh(v / sign_speed), or with presliding a state z that follows the travel
/// x (Dahl 1968, exponent 1):
///   dz/dx = (1 - sgn(v) z) / presliding
/// z starts at tanh(v / sign_speed). The integration is exact for speeds that are linear between samples.
class FrictionSign {
  public:
    /// Updates the sign with the speed of a sample `dt` after the last one.
    void advance(const FittedMotor& motor, double dt, double speed) noexcept {
        if (!(motor.presliding > 0) || !known_) {
            sign_ = std::tanh(speed / motor.sign_speed);
        } else if (last_ * speed < 0) {
            const double share = last_ / (last_ - speed);
            slide(0.5 * last_ * share * dt / motor.presliding);
            slide(0.5 * speed * (1 - share) * dt / motor.presliding);
        } else {
            slide(0.5 * (last_ + speed) * dt / motor.presliding);
        }
        last_ = speed;
        known_ = true;
    }
    void reset() noexcept { known_ = false; }
    double value() const noexcept { return sign_; }

  private:
    void slide(double travel) noexcept {
        const double limit = travel < 0 ? -1.0 : 1.0;
        sign_ = limit + (sign_ - limit) * std::exp(-std::fabs(travel));
    }
    bool known_ = false;
    double last_ = 0, sign_ = 0;
};

/// One set of parameters. The link inertias are one solution with the identified torques; they need not be physically
/// consistent.
struct FittedParameters {
    static constexpr int max_motors = 2 * max_joints;

    std::array<LinkInertia, max_joints> link{};
    std::array<FittedMotor, max_motors> motor{};
};

/// Both sets of a fit: all base parameters, and only the essential ones, which differ significantly from zero.
class FittedDynamics {
  public:
    FittedParameters all, essential;
    int motors = 0;
    std::uint32_t by_all = ~std::uint32_t(0);  ///< joint j as bit j: predicted by `all`, else by `essential`
    std::array<double, max_joints> gain{};     ///< torque per unit of the signal
    std::uint32_t loads = 0;                   ///< joints whose friction depends on the load, set by prepare()

    /// Computes the inertias with a payload; required before anything else.
    void prepare(const Chain& chain, const Payload& payload) noexcept {
        const std::uint32_t every = chain.dof < 32 ? (std::uint32_t(1) << chain.dof) - 1 : ~std::uint32_t(0);
        by_all &= every;
        needs_essential_ = by_all != every;
        loads = 0;
        for (int m = 0; m < chain.dof; ++m)
            if (all.motor[m].load != 0 || essential.motor[m].load != 0) loads |= std::uint32_t(1) << m;
        needs_all_ = by_all != 0 || loads != 0;
        inertias_all_ = inertias_with_payload(chain, all.link, payload);
        inertias_essential_ = inertias_with_payload(chain, essential.link, payload);
    }

    /// Updates the friction signs with the rates of a tick `dt` after the last one; to be called before its torques.
    void advance(int dof, double dt, const double* qd) noexcept {
        for (int m = 0; m < motors; ++m) sign_[m].advance(all.motor[m], dt, of_motor(all.motor[m], qd, dof));
    }
    /// Forgets the friction signs.
    void reset() noexcept {
        for (FrictionSign& sign : sign_) sign.reset();
    }

    /// Joint torques of a motion whose rates were given to `advance`.
    void predict(const Chain& chain, const JointMotion<double>& motion, const Vector3& gravity,
                 double* torque) const noexcept {
        double inertial[2][max_joints] = {};
        if (needs_all_) inverse_dynamics(chain, inertias_all_, motion, gravity, inertial[0]);
        if (needs_essential_) inverse_dynamics(chain, inertias_essential_, motion, gravity, inertial[1]);
        for (int j = 0; j < chain.dof; ++j) torque[j] = by_all >> j & 1 ? inertial[0][j] : inertial[1][j];
        add_motors(chain.dof, motion.qd, motion.qdd, inertial[0], torque);
    }

    /// Momentum terms with the rotors; `friction`: torque of the motors without that of their rotors.
    void momentum(const Chain& chain, const JointMotion<double>& motion, const Vector3& gravity,
                  MomentumTerms<double>& terms, double* friction) const noexcept {
        const double *q = motion.q, *qd = motion.qd;
        MomentumTerms<double> of_all{}, of_essential{};
        if (by_all != 0) momentum_terms(chain, inertias_all_, q, motion.angle, qd, gravity, of_all);
        if (needs_essential_) momentum_terms(chain, inertias_essential_, q, motion.angle, qd, gravity, of_essential);
        double inertial[max_joints] = {};
        if (loads != 0) inverse_dynamics(chain, inertias_all_, motion, gravity, inertial);
        static constexpr double nothing[max_joints] = {};
        for (int j = 0; j < chain.dof; ++j) {
            const MomentumTerms<double>& own = by_all >> j & 1 ? of_all : of_essential;
            terms.momentum[j] = own.momentum[j];
            terms.velocity_force[j] = own.velocity_force[j];
            terms.gravity[j] = own.gravity[j];
            friction[j] = 0;
        }
        add_motors(chain.dof, qd, nothing, inertial, friction);
        for (int m = 0; m < motors; ++m) {
            const double v = of_motor(all.motor[m], qd, chain.dof);
            for (int j = 0; j < chain.dof; ++j) {
                const FittedMotor& own = (by_all >> j & 1 ? all : essential).motor[m];
                terms.momentum[j] += own.share[j] * own.rotor * v;
            }
        }
    }

  private:
    /// Rate or acceleration of a motor from those of the joints.
    static double of_motor(const FittedMotor& motor, const double* values, int dof) noexcept {
        double sum = 0;
        for (int j = 0; j < dof; ++j) sum += motor.share[j] * values[j];
        return sum;
    }
    void add_motors(int dof, const double* qd, const double* qdd, const double* load, double* torque) const noexcept {
        for (int m = 0; m < motors; ++m) {
            const FittedMotor& first = all.motor[m];
            const double v = of_motor(first, qd, dof), a = of_motor(first, qdd, dof), s = sign_[m].value();
            const bool bends = first.top_speed < std::numeric_limits<double>::infinity();
            const double u = bends ? std::min(std::fabs(v) / first.top_speed, 1.0) : 0;
            const double bent = bends ? s * (std::sqrt(u) - 4.0 / 15 - 0.8 * u) : 0;
            for (int j = 0; j < dof; ++j) {
                if (first.share[j] == 0) continue;
                const FittedMotor& own = (by_all >> j & 1 ? all : essential).motor[m];
                torque[j] += own.share[j] * (own.coulomb * s + own.viscous * v + own.rotor * a + own.offset +
                                             own.bend * bent + own.load * s * std::fabs(load[j]));
            }
        }
    }

    std::array<FrictionSign, FittedParameters::max_motors> sign_{};
    bool needs_all_ = true, needs_essential_ = false;
    Inertias inertias_all_, inertias_essential_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
