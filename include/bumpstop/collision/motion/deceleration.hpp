/// @file
/// Deceleration laws: how drives and brakes stop an arm that reacts.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "bumpstop/math/mask.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

enum class DecelerationLaw {
    constant,       ///< the joints' acceleration limits hold from the first sub-step on
    constant_time,  ///< rates fall linearly to zero in a time that does not depend on them
    ramp,           ///< the limits grow linearly from zero, as of a brake that engages slowly
    table           ///< as constant_time, in a time by joint, rate and extension
};

/// Stopping times of the joints, with rates that fall linearly: from a table of stopping distances at one payload.
struct StoppingTimes {
    std::vector<double> extension;  ///< grid, increasing [1]
    std::vector<double> rate;       ///< grid, increasing [rad/s or m/s]
    std::vector<double> time;       ///< [joint][extension][rate], s
    double reach = 1;               ///< greatest distance of the tip from the axis of joint 1 [m]

    /// Stopping time of a joint with a rate >= 0 at an extension [s].
    double at(int joint, double extended, double speed) const {
        std::size_t e = 0;
        double share = 0;
        if (extension.size() > 1) {
            const double inside = std::clamp(extended, extension.front(), extension.back());
            while (e + 2 < extension.size() && extension[e + 1] <= inside) ++e;
            share = (inside - extension[e]) / (extension[e + 1] - extension[e]);
        }
        const double* row = &time[(std::size_t(joint) * extension.size() + e) * rate.size()];
        const double near = at_rate(row, speed);
        return share > 0 ? near + share * (at_rate(row + rate.size(), speed) - near) : near;
    }

  private:
    /// Linear interpolation over the rate: exact where the distance is a sum of a linear and a quadratic term. Below
    /// the grid the time continues with its first slope where it grows toward zero rate, else it stays; above the grid
    /// the deceleration is that of the fastest rate.
    double at_rate(const double* row, double speed) const {
        const std::size_t n = rate.size();
        if (n == 1 || speed >= rate.back()) return row[n - 1] * std::max(1.0, speed / rate.back());
        if (speed <= rate.front())
            return row[0] + std::max(0.0, (row[0] - row[1]) / (rate[1] - rate[0])) * (rate[0] - speed);
        const std::size_t i = std::size_t(std::upper_bound(rate.begin(), rate.end(), speed) - rate.begin()) - 1;
        return row[i] + (row[i + 1] - row[i]) * (speed - rate[i]) / (rate[i + 1] - rate[i]);
    }
};

/// How the arm slows down in its reactions.
struct Deceleration {
    DecelerationLaw law = DecelerationLaw::constant;
    double stopping_time = 0;  ///< for constant_time [s]
    double ramp_time = 0;      ///< for ramp: until the full limits hold [s]
    bool independent = false;  ///< every joint brakes by itself, so the arm leaves its path
    StoppingTimes times;       ///< for table

    bool constant() const { return law == DecelerationLaw::constant && !independent; }

    /// Stopping time of an arm whose slowest joint would need `limit_time` at its acceleration limit [s].
    double time_to_stop(double limit_time) const {
        switch (law) {
            case DecelerationLaw::constant_time:
                return stopping_time;
            case DecelerationLaw::ramp:
                return limit_time <= ramp_time / 2 ? std::sqrt(2 * limit_time * ramp_time) : limit_time + ramp_time / 2;
            default:
                return limit_time;
        }
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
