/// @file
/// The payload: declared, and estimated from residuals to recognise a change.
#pragma once

#include <cmath>

#include "bumpstop/model/dynamics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// A body held by the last link, as a point mass.
struct Payload {
    double mass = 0;   ///< kg
    Vector3 center{};  ///< in the frame of the last link [m]
};

/// The inertia of a link together with a point mass: the parallel axis theorem about the common centre.
inline LinkInertia with_payload(const LinkInertia& link, const Payload& payload) noexcept {
    LinkInertia sum = link;
    sum.mass = link.mass + payload.mass;
    if (!(sum.mass > 0)) return link;
    const double reduced = link.mass * payload.mass / sum.mass;
    Vector3 apart{};
    double square = 0;
    for (int k = 0; k < 3; ++k) {
        apart[k] = payload.center[k] - link.center[k];
        sum.center[k] = link.center[k] + payload.mass / sum.mass * apart[k];
        square += apart[k] * apart[k];
    }
    for (int k = 0; k < 3; ++k)
        for (int l = 0; l < 3; ++l) sum.tensor[3 * k + l] += reduced * ((k == l ? square : 0) - apart[k] * apart[l]);
    return sum;
}

/// Inertias of a chain that carries a payload.
inline Inertias inertias_with_payload(const Chain& chain, std::array<LinkInertia, max_joints> links,
                                      const Payload& payload) noexcept {
    LinkInertia& last = links[chain.dof - 1];
    last = with_payload(last, payload);
    return Inertias(chain, std::span<const LinkInertia>(links.data(), std::size_t(chain.dof)));
}

struct PayloadMonitorSettings {
    double window = 5;          ///< time constant with which past residuals lose weight [s]
    double interval = 0.02;     ///< between updates [s]
    double min_mass = 0;        ///< smallest change that is reported [kg]; 0: the payload is not monitored
    double min_share = 0.8;     ///< share of the squared residual that the mass must explain
    double min_change = 0.005;  ///< variance over mean square of the mass's torques, which a varying pose must reach
};

/// Weighted least-squares fit of r = g_m(q) m to the residuals of the last seconds, where g_m is the torque for one
/// more kilogram at the payload's point. The torque of a mass depends on the pose, that of a clamped arm does not: a
/// change is reported only after the pose has varied.
class PayloadMonitor {
  public:
    PayloadMonitor(const PayloadMonitorSettings& settings, int joints) noexcept
        : settings_(settings), joints_(joints) {}

    /// An update is due at time t [s].
    bool due(double t) const noexcept { return settings_.min_mass > 0 && !(t - updated_ < settings_.interval); }

    /// `per_kilogram`: g_m by joint [Nm/kg or N/kg]; `sd` as for estimate_contact.
    void update(double t, const double* residual, const double* per_kilogram, const double* sd) noexcept {
        const double keep = std::exp(-std::fmin(t - updated_, 1e6) / settings_.window);
        updated_ = t;
        double aa = 0, ar = 0, rr = 0;
        weight_ = keep * weight_ + 1;
        for (int j = 0; j < joints_; ++j) {
            const double a = per_kilogram[j] / sd[j], r = residual[j] / sd[j];
            aa += a * a;
            ar += a * r;
            rr += r * r;
            mean_[j] = keep * mean_[j] + a;
        }
        aa_ = keep * aa_ + aa;
        ar_ = keep * ar_ + ar;
        rr_ = keep * rr_ + rr;
    }
    /// Estimated mass minus the declared one [kg].
    double change() const noexcept { return aa_ > 0 ? ar_ / aa_ : 0; }
    /// Share of the squared residual that the change explains, 0 to 1.
    double share() const noexcept { return aa_ > 0 && rr_ > 0 ? ar_ * ar_ / (aa_ * rr_) : 0; }
    /// Residuals in different poses show that the payload has changed.
    bool recognised() const noexcept {
        if (!(settings_.min_mass > 0) || !(std::fabs(change()) >= settings_.min_mass)) return false;
        double squares = 0;
        for (int j = 0; j < joints_; ++j) squares += mean_[j] * mean_[j];
        const bool varied = aa_ - squares / weight_ >= settings_.min_change * aa_;
        return varied && share() >= settings_.min_share;
    }
    void reset() noexcept {
        aa_ = ar_ = rr_ = weight_ = 0;
        mean_.fill(0);
        updated_ = -std::numeric_limits<double>::infinity();
    }

  private:
    PayloadMonitorSettings settings_;
    int joints_;
    double updated_ = -std::numeric_limits<double>::infinity();
    double aa_ = 0, ar_ = 0, rr_ = 0, weight_ = 0;
    std::array<double, max_joints> mean_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
