/// @file
/// Arm and body in contact as one linear system.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "bumpstop/collision/contact/padded_matrix.hpp"
#include "bumpstop/model/chain.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The body that the arm hits: a damped spring against the ground or against a mass, which may stand on a spring.
///
/// | body | stiffness | mass | ground_stiffness |
/// |---|---|---|---|
/// | clamped | of the body | 0 | |
/// | free to move | of the body | of the body | 0 |
/// | gauge | of its pad | of what moves | of its spring |
struct ContactBody {
    double stiffness = 0;         ///< K [N/m]
    double damping = 0;           ///< c [Ns/m]
    double mass = 0;              ///< behind the spring [kg]; 0: the body is clamped
    double ground_stiffness = 0;  ///< that holds the mass [N/m]; 0: it is free

    bool clamped() const { return !(mass > 0); }
    /// Nothing holds the body: once it has separated from the arm it does not come back.
    bool gets_away() const { return mass > 0 && !(ground_stiffness > 0); }
};

/// Links and rotors joined by gears that are springs, held to the reference path by a position servo, linear about the
/// pose of contact. With dq and dth the deviations of links and rotors from the reference q_r:
///
///     M dq''  = Kg (dth - dq) + Dg (dth' - dq') - a F - (1 - f) M q_r''
///     B dth'' = -Kg (dth - dq) - Dg (dth' - dq') - P dth - D dth' - (1 - f) B q_r''
///
/// where F is the contact force, a = J' n its torque per newton, and q_r'' = g s'' with s the path along the normal. In
/// these equations the gears already carry the torque of the acceleration q_r''. In a reaction, which begins suddenly,
/// they do not: the feedforward torque acts on the rotors and reaches the links through the gears,
///
///     M dq''  = ... - M q_r''
///     B dth'' = ... - B q_r'' + f (M + B) q_r''
struct ElasticArm {
    int dof = 0;                                         ///< 0: the arm is rigid and follows its reference
    std::array<double, max_joints * max_joints> mass{};  ///< M of the links, [row][column] with dof columns [kg m2]
    std::array<double, max_joints> rotor_inertia{};      ///< B, seen at the joint [kg m2]
    std::array<double, max_joints> gear_stiffness{};     ///< Kg [Nm/rad]
    std::array<double, max_joints> gear_damping{};       ///< Dg [Nms/rad]
    std::array<double, max_joints> position_gain{};      ///< P [Nm/rad]
    std::array<double, max_joints> velocity_gain{};      ///< D [Nms/rad]
    std::array<double, max_joints> feedforward{};        ///< f, share of the acceleration fed forward [1]
    std::array<double, max_joints> torque_per_N{};       ///< a [Nm/N]
    std::array<double, max_joints> rate_per_speed{};     ///< g, joint rates per unit of s' [rad/m]
};

namespace detail {

/// Inverse of a symmetric, positive definite matrix [row][column] of n columns; by Gauss and Jordan without pivots,
/// which such a matrix does not need.
inline std::vector<double> inverse(const double* matrix, int n) {
    std::vector<double> a(matrix, matrix + n * n), inv(std::size_t(n * n), 0.0);
    for (int i = 0; i < n; ++i) inv[std::size_t(i * n + i)] = 1;
    for (int k = 0; k < n; ++k) {
        const double pivot = 1 / a[std::size_t(k * n + k)];
        for (int j = 0; j < n; ++j) {
            a[std::size_t(k * n + j)] *= pivot;
            inv[std::size_t(k * n + j)] *= pivot;
        }
        for (int i = 0; i < n; ++i) {
            if (i == k) continue;
            const double factor = a[std::size_t(i * n + k)];
            for (int j = 0; j < n; ++j) {
                a[std::size_t(i * n + j)] -= factor * a[std::size_t(k * n + j)];
                inv[std::size_t(i * n + j)] -= factor * inv[std::size_t(k * n + j)];
            }
        }
    }
    return inv;
}

}  // namespace detail

/// Arm and body as a first-order system z' = A z, in contact and apart. z holds, in this order, the deviations of the
/// links, of the rotors and of the body [rad, m], their rates over `rate_unit`, the distance r of the reference beyond
/// the body's place at rest [m], and its speed [m/s].
class ContactSystem {
  public:
    static constexpr int max_states = 4 * max_joints + 2, max_size = max_states + 2;
    using Row = std::array<double, max_size>;

    ContactSystem(const ElasticArm& arm, const ContactBody& body) : arm_(arm), body_(body) {
        const int n = arm.dof, m = coordinates();
        if (n > 0) inverse_ = detail::inverse(arm.mass.data(), n);
        double inverse_mass = body.mass > 0 ? 1 / body.mass : 0;  // of links and body together, along the normal
        for (int i = 0; i < n; ++i)
            for (int j = 0; j < n; ++j)
                inverse_mass += arm.torque_per_N[std::size_t(i)] * inverse_[std::size_t(i * n + j)] *
                                arm.torque_per_N[std::size_t(j)];
        frequency_ = std::sqrt(body.stiffness * inverse_mass);
        rate_unit_ = 1;
        if (m > 0) {
            double most = 0;
            for (int i = 0; i < m; ++i) {
                double sum = 0;
                for (const double value : accelerations(i, true)) sum += std::fabs(value);
                most = std::max(most, sum);
            }
            rate_unit_ = std::sqrt(std::max(most, 1.0));
        }
    }

    const ElasticArm& arm() const { return arm_; }
    const ContactBody& body() const { return body_; }
    int coordinates() const { return 2 * arm_.dof + (body_.mass > 0 ? 1 : 0); }
    int states() const { return 2 * coordinates(); }
    int size() const { return states() + 2; }
    /// Natural frequency of links and body on the contact spring, without gears and servo [rad/s]; 0: a rigid arm and a clamped body.
    double frequency() const { return frequency_; }
    /// Half the period of that oscillation, which is how long such a contact lasts [s]; 0 likewise.
    double half_oscillation() const { return frequency_ > 0 ? std::numbers::pi / frequency_ : 0; }

    detail::PaddedMatrix matrix(bool in_contact) const {
        const int m = coordinates(), n = states();
        detail::PaddedMatrix a(n + 2, n + 2);
        for (int i = 0; i < m; ++i) {
            a(i, m + i) = rate_unit_;
            const Row by_position = accelerations(i, in_contact), by_rate = dampings(i, in_contact);
            for (int j = 0; j < m; ++j) {
                a(m + i, j) = by_position[std::size_t(j)] / rate_unit_;
                a(m + i, m + j) = by_rate[std::size_t(j)];
            }
            a(m + i, n) = by_position[std::size_t(m)] / rate_unit_;
            a(m + i, n + 1) = by_rate[std::size_t(m)] / rate_unit_;
        }
        a(n, n + 1) = 1;
        return a;
    }

    /// Penetration of the arm into the body, r + a' dq - x, as a row that multiplies the state.
    Row penetration() const {
        Row row{};
        const int m = coordinates(), n = arm_.dof;
        for (int j = 0; j < n; ++j) row[std::size_t(j)] = arm_.torque_per_N[std::size_t(j)];
        if (body_.mass > 0) row[std::size_t(m - 1)] = -1;
        row[std::size_t(states())] = 1;
        return row;
    }
    /// K p + c p' of the penetration p: the contact force where it is positive.
    Row force() const {
        const int m = coordinates();
        const Row penetration = this->penetration();
        Row row{};
        for (int j = 0; j < m; ++j) {
            row[std::size_t(j)] = body_.stiffness * penetration[std::size_t(j)];
            row[std::size_t(m + j)] = body_.damping * rate_unit_ * penetration[std::size_t(j)];
        }
        row[std::size_t(states())] = body_.stiffness;
        row[std::size_t(states()) + 1] = body_.damping;
        return row;
    }
    /// The row of the rate of a row's value, for the matrix in contact or apart.
    Row rate(const Row& row, const detail::PaddedMatrix& a) const {
        Row out{};
        for (int i = 0; i < size(); ++i)
            for (int j = 0; j < size(); ++j) out[std::size_t(j)] += row[std::size_t(i)] * a(i, j);
        return out;
    }
    /// The residual of joint j in a detector that takes the rotors' rates for those of the links: the gear torque minus
    /// what it takes to accelerate the links, (f M q_r'' + tau_g - M (q_r'' + dth''))_j. Here is what the state makes of
    /// it.
    Row residual(int joint) const {
        const int n = arm_.dof, m = coordinates();
        Row row{};
        const auto gear = [&](int k, double factor) {
            const double stiffness = factor * arm_.gear_stiffness[std::size_t(k)];
            const double damping = factor * arm_.gear_damping[std::size_t(k)] * rate_unit_;
            row[std::size_t(n + k)] += stiffness;
            row[std::size_t(k)] -= stiffness;
            row[std::size_t(m + n + k)] += damping;
            row[std::size_t(m + k)] -= damping;
        };
        gear(joint, 1.0);
        for (int k = 0; k < n; ++k) {
            // -M dth'' = M (B^-1 (tau_g + P dth + D dth') + (1 - f) q_r'')
            const double share = arm_.mass[std::size_t(joint * n + k)] / arm_.rotor_inertia[std::size_t(k)];
            gear(k, share);
            row[std::size_t(n + k)] += share * arm_.position_gain[std::size_t(k)];
            row[std::size_t(m + n + k)] += share * arm_.velocity_gain[std::size_t(k)] * rate_unit_;
        }
        return row;
    }
    /// What s'' adds to it, (f M g - M f g)_j: nothing, where all joints are fed the same share [Nm s2/m].
    double residual_by_acceleration(int joint) const {
        double sum = 0;
        for (int k = 0; k < arm_.dof; ++k)
            sum += arm_.mass[std::size_t(joint * arm_.dof + k)] * arm_.rate_per_speed[std::size_t(k)] *
                   (arm_.feedforward[std::size_t(joint)] - arm_.feedforward[std::size_t(k)]);
        return sum;
    }
    /// Jump of the rates when the reference's speed changes by 1 m/s and the gears already carry the torque for it.
    Row jump() const {
        const int n = arm_.dof, m = coordinates();
        Row jump{};
        for (int i = 0; i < n; ++i) {
            double missing = 0;
            for (int j = 0; j < n; ++j) {
                double torque = 0;  // (M g)_j
                for (int k = 0; k < n; ++k)
                    torque += arm_.mass[std::size_t(j * n + k)] * arm_.rate_per_speed[std::size_t(k)];
                missing += inverse_[std::size_t(i * n + j)] * (1 - arm_.feedforward[std::size_t(j)]) * torque;
            }
            jump[std::size_t(m + i)] = -missing / rate_unit_;
            jump[std::size_t(m + n + i)] =
                -(1 - arm_.feedforward[std::size_t(i)]) * arm_.rate_per_speed[std::size_t(i)] / rate_unit_;
        }
        return jump;
    }
    /// The same in a reaction: the feedforward torque reaches the links only through the gears.
    Row reaction_jump() const {
        const int n = arm_.dof, m = coordinates();
        Row jump{};
        for (int i = 0; i < n; ++i) {
            const std::size_t j = std::size_t(i);
            double torque = 0;  // (M g)_i
            for (int k = 0; k < n; ++k)
                torque += arm_.mass[std::size_t(i * n + k)] * arm_.rate_per_speed[std::size_t(k)];
            const double rate = arm_.rate_per_speed[j],
                         fed = arm_.feedforward[j] * (rate + torque / arm_.rotor_inertia[j]);
            jump[std::size_t(m + i)] = -rate / rate_unit_;
            jump[std::size_t(m + n + i)] = (fed - rate) / rate_unit_;
        }
        return jump;
    }
    /// Force per metre of r once everything has come to rest [N/m]; 0 where nothing holds the body.
    double static_stiffness() const {
        if (body_.gets_away()) return 0;
        double compliance = 1 / body_.stiffness;
        if (body_.mass > 0) compliance += 1 / body_.ground_stiffness;
        for (int j = 0; j < arm_.dof; ++j) {
            const double a = arm_.torque_per_N[std::size_t(j)];
            if (a == 0) continue;
            compliance += a * a * (1 / arm_.gear_stiffness[std::size_t(j)] + 1 / arm_.position_gain[std::size_t(j)]);
        }
        return 1 / compliance;
    }

    /// Time constant of the slowest servo, D / P: a rotor is then back at its reference but for a third [s]; 0: rigid.
    double servo_lag() const {
        double lag = 0;
        for (int j = 0; j < arm_.dof; ++j)
            lag = std::max(lag, arm_.velocity_gain[std::size_t(j)] / arm_.position_gain[std::size_t(j)]);
        return lag;
    }

  private:
    /// Acceleration of coordinate i per unit of each coordinate, then of r.
    Row accelerations(int i, bool in_contact) const {
        return acceleration_row(i, in_contact ? body_.stiffness : 0.0, body_.ground_stiffness, arm_.gear_stiffness,
                                arm_.position_gain);
    }
    /// The same per unit of their rates, then of the speed of the reference.
    Row dampings(int i, bool in_contact) const {
        return acceleration_row(i, in_contact ? body_.damping : 0.0, 0.0, arm_.gear_damping, arm_.velocity_gain);
    }
    Row acceleration_row(int i, double contact, double ground, const std::array<double, max_joints>& gear,
                         const std::array<double, max_joints>& servo) const {
        const int n = arm_.dof, m = coordinates();
        const Row penetration = this->penetration();
        Row row{};
        if (i < n) {
            for (int k = 0; k < n; ++k) {
                const double by_torque = inverse_[std::size_t(i * n + k)];
                row[std::size_t(n + k)] += by_torque * gear[std::size_t(k)];
                row[std::size_t(k)] -= by_torque * gear[std::size_t(k)];
                const double push = by_torque * arm_.torque_per_N[std::size_t(k)] * contact;
                for (int j = 0; j < m; ++j) row[std::size_t(j)] -= push * penetration[std::size_t(j)];
                row[std::size_t(m)] -= push;
            }
        } else if (i < 2 * n) {
            const std::size_t k = std::size_t(i - n);
            const double by_torque = 1 / arm_.rotor_inertia[k];
            row[k] += by_torque * gear[k];
            row[std::size_t(i)] -= by_torque * (gear[k] + servo[k]);
        } else {
            for (int j = 0; j < m; ++j) row[std::size_t(j)] = contact / body_.mass * penetration[std::size_t(j)];
            row[std::size_t(i)] -= ground / body_.mass;
            row[std::size_t(m)] = contact / body_.mass;
        }
        return row;
    }

    ElasticArm arm_;
    ContactBody body_;
    std::vector<double> inverse_;  ///< of M
    double frequency_ = 0, rate_unit_ = 1;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
