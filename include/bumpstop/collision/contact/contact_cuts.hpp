/// @file
/// Offsets at which the course of a collision changes abruptly.
#pragma once

#include <limits>

#include "bumpstop/collision/contact/separation.hpp"
#include "bumpstop/detection/gaussian_thresholds.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Panels of the offset are cut where a body separates from the arm while one a little farther away is pushed on,
/// because the arm speeds up meanwhile. Where a contact changes the probability of an alarm, `detectable`, they are
/// also cut where the body separates just at a tick, because from then on it is not detected. With thresholds, for
/// narrow noise, they are cut about offsets at which a joint's residual passes its threshold at a tick.
class ContactCuts {
  public:
    ContactCuts(const ContactPaths& paths, const ContactPropagator& by, bool detectable,
                const GaussianThresholds* narrow)
        : paths_(paths), dynamics_(by), separation_(paths, by), detectable_(detectable), narrow_(narrow) {}

    /// In ascending order, up to `largest` [m].
    std::vector<double> operator()(double largest) const {
        std::vector<double> cuts;
        // A body that is held is touched again, or stays pressed: only narrow alarms change abruptly.
        if (!dynamics_.propagator().gets_away && narrow_ == nullptr) return cuts;
        std::optional<Probe> before;
        const auto add = [&](Probe here) {
            if (before) add_cuts(*before, here, cuts);
            before = std::move(here);
        };
        if (narrow_ == nullptr)
            for (const Separation& each : separation_.up_to(largest)) add({each});
        else
            for (double offset : separation_.offsets(largest)) add(probe(offset));
        std::sort(cuts.begin(), cuts.end());
        return cuts;
    }

  private:
    static constexpr double certain = 9;  // standard deviations, beyond which noise is with a probability of 1e-19

    /// The undetected collision with one body, for narrow noise with its residuals at ticks.
    struct Probe : Separation {
        int first = 0;                                  // tick
        int decided = std::numeric_limits<int>::max();  // first tick at which noise can hardly hide an alarm
        std::vector<double> residual{};                 // [tick from the first on][monitored joint], without noise
        std::array<NoiselessResidual<double>, max_joints> latest{};  // by monitored joint

        double at_tick(int k, int w, int monitored) const {
            const std::size_t i = std::size_t(k - first) * std::size_t(monitored) + std::size_t(w);
            return k >= first && i < residual.size() ? residual[i] : 0.0;
        }
    };

    Probe probe(double offset) const {
        Probe made;
        const auto at_step = [&](int i, const ContactState& state) {
            if (narrow_ == nullptr || i % paths_.period != 0) return;
            if (made.residual.empty()) made.first = i / paths_.period;
            record_residuals(made, i / paths_.period, state);
        };
        static_cast<Separation&>(made) = separation_(offset, at_step);
        return made;
    }

    void record_residuals(Probe& made, int k, const ContactState& state) const {
        const LinePath& path = *paths_.path;
        if (k >= path.ticks) return;
        std::array<double, max_joints> torque;
        dynamics_.residuals(state, &path.torque_per_N[std::size_t(k * path.dof)], path.dof, torque.data());
        for (std::size_t w = 0; w < std::size_t(narrow_->monitored); ++w) {
            const double value = narrow_->advance(made.latest[w], torque[std::size_t(narrow_->joint[w])]);
            made.residual.push_back(value);
            const double excess = std::fabs(value + narrow_->mean[w]) - narrow_->threshold[w];
            if (excess > certain * narrow_->sd[w] && narrow_->armed(paths_.tick_step(k) * paths_.step))
                made.decided = std::min(made.decided, k);
        }
    }

    /// Adds the cuts between two neighbours: where one is pushed much longer than the other, and on either side.
    void add_cuts(const Probe& low, const Probe& high, std::vector<double>& cuts) const {
        // Neighbours separate within a step or so of each other, or half an oscillation and more apart.
        const double least = 2 + dynamics_.propagator().half_oscillation / paths_.step;
        if (low.smooth || std::fabs(high.end - low.end) < least) return add_tick_cuts(low, high, cuts);
        Probe a = low, b = high;
        for (int i = 0; i < 30; ++i) {
            Probe middle = probe(0.5 * (a.offset + b.offset));
            const bool like_low = std::fabs(middle.end - a.end) < std::fabs(middle.end - b.end);
            (like_low ? a : b) = std::move(middle);
        }
        cuts.push_back(0.5 * (a.offset + b.offset));
        add_tick_cuts(low, a, cuts);
        add_tick_cuts(b, high, cuts);
    }

    /// Adds cuts at which the body separates just at a tick, or a residual passes its threshold there, as long as the
    /// collision may not have been detected.
    void add_tick_cuts(const Probe& low, const Probe& high, std::vector<double>& cuts) const {
        if (!detectable_ || !(high.offset > low.offset)) return;
        const int last = std::min(paths_.path->ticks - 1, std::max(low.decided, high.decided));
        for (int k = low.first; k <= last && paths_.tick_step(k) <= high.separated; ++k) {
            const double tick = paths_.tick_step(k);
            if (low.separated < tick && high.separated >= tick && std::isfinite(high.separated))
                cuts.push_back(root(low, high, [&](const Probe& at) { return at.separated - tick; }));
            if (narrow_ == nullptr) continue;
            for (int w = 0; w < narrow_->monitored; ++w) add_threshold_cuts(w, k, low, high, cuts);
        }
    }

    /// Adds offsets where a residual passes its threshold at tick k, and those two to eight standard deviations off.
    void add_threshold_cuts(int w, int k, const Probe& low, const Probe& high, std::vector<double>& cuts) const {
        auto residual = [&](const Probe& at) { return at.at_tick(k, w, narrow_->monitored); };
        const double slope = (residual(high) - residual(low)) / (high.offset - low.offset);
        const double width = narrow_->sd[w] / std::fabs(slope);
        for (double side : {-1.0, 1.0}) {
            const double limit = side * narrow_->threshold[w] - narrow_->mean[w];
            if ((residual(low) > limit) == (residual(high) > limit)) continue;
            const double at = root(low, high, [&](const Probe& body) { return residual(body) - limit; });
            cuts.push_back(at);
            for (int n = 2; n <= 8 && width > 0 && std::isfinite(width); n += 2) {
                cuts.push_back(at - n * width);
                cuts.push_back(at + n * width);
            }
        }
    }

    /// The offset where a function of the collision, whose signs differ at two bodies, is zero.
    template <class Function>
    double root(const Probe& low, const Probe& high, Function function) const {
        double a = low.offset, b = high.offset, fa = function(low), fb = function(high);
        for (int i = 0; i < 30; ++i) {
            double middle = a - fa * (b - a) / (fb - fa);
            // Every third step bisects: a secant may converge slowly.
            if (!(middle > a && middle < b) || i % 3 == 2) middle = 0.5 * (a + b);
            const double f = function(probe(middle));
            if (f == 0) return middle;
            ((f > 0) == (fa > 0) ? a : b) = middle;
            ((f > 0) == (fa > 0) ? fa : fb) = f;
            if (b - a < 1e-9 * (high.offset - low.offset) || std::fabs(f) < 1e-9) return middle;
        }
        return 0.5 * (a + b);
    }

    const ContactPaths& paths_;
    ContactDynamics dynamics_;
    Separations separation_;
    bool detectable_;
    const GaussianThresholds* narrow_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
