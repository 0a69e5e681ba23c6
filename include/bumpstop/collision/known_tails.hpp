/// @file
/// What is known of the tail of a law, and what that foretells of its quantiles.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "bumpstop/math/functions.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// z with P(Z > z) = p for a standard normal Z.
inline double normal_score(double p) {
    p = std::clamp(p, 1e-300, 1 - 1e-16);
    return p <= 0.5 ? normal_upper_quantile(p) : -normal_upper_quantile(1 - p);
}

/// The tail at the forces it was asked for. Peak forces are nearly normal, so over the score of the tail the force is nearly
/// a straight line, which a cubic follows well.
class KnownTails {
  public:
    struct At {
        double force, probability;  ///< of more than that
        double score, slope;        ///< force over the score; 0 where the density tells nothing
    };

    void clear() { known_.clear(); }

    At add(double force, double probability, double density) {
        const double score = normal_score(probability);
        const bool tells = density > 0 && std::fabs(score) < farthest_score;
        const double slope = tells ? std::exp(-0.5 * score * score) * root_of_half_turn / density : 0.0;
        const auto after = std::upper_bound(known_.begin(), known_.end(), force,
                                            [](double value, const At& known) { return value < known.force; });
        return *known_.insert(after, {force, probability, score, slope});
    }

    bool knows_none() const { return known_.empty() || known_.front().force > 0; }
    double at_none() const { return known_.front().probability; }

    /// Narrows a bracket of the force that `allowed` is passed at.
    void narrow(double allowed, double& low, double& high) const {
        for (const At& known : known_) {
            if (known.probability > allowed) {
                low = std::max(low, known.force);
            } else {
                high = std::min(high, known.force);
            }
        }
    }

    /// The force at a score, from what is known near it; NaN where nothing is.
    double foretell(double score) const {
        const At *nearest = nullptr, *next = nullptr;
        for (const At& known : known_) {
            if (known.slope <= 0 || std::fabs(known.score - score) > reach) continue;
            if (nearest == nullptr || std::fabs(known.score - score) < std::fabs(nearest->score - score)) {
                next = nearest;
                nearest = &known;
            } else if (next == nullptr || std::fabs(known.score - score) < std::fabs(next->score - score)) {
                next = &known;
            }
        }
        if (nearest == nullptr) return std::numeric_limits<double>::quiet_NaN();
        const double away = score - nearest->score;
        if (next != nullptr) {
            const double h = next->score - nearest->score, t = away / h, u = 1 - t;
            // Hermite's cubic, and not far beyond its ends.
            if (std::fabs(t) <= 1)
                return u * u * (1 + 2 * t) * nearest->force + t * t * (1 + 2 * u) * next->force +
                       h * t * u * (u * nearest->slope - t * next->slope);
        }
        return nearest->force + away * nearest->slope;
    }

  private:
    static constexpr double farthest_score = 7, reach = 2.5;
    static constexpr double root_of_half_turn =
        0.5 * std::numbers::inv_sqrtpi * std::numbers::sqrt2;  ///< 1 / sqrt(2 pi)

    std::vector<At> known_;  ///< by force
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
