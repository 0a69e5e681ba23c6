/// @file
/// A piecewise density as arrays that have the same slots for all panels.
#pragma once

#include "bumpstop/collision/distribution/collision_distribution.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Slots of a panel: alarms before its first tick in contact, that tick and later ones, and at last no detection.
class DensityArrays {
  public:
    explicit DensityArrays(const PiecewiseDensity& density) : density_(density), order_(std::size_t(density.order)) {
        int after = 0;
        for (const PiecewiseDensity::Panel& panel : density.panel) {
            for (int i = panel.first_alarm; i < panel.end_alarm; ++i)
                before_ = std::max(before_, panel.first_tick - density.alarm[std::size_t(i)].tick);
            after = std::max(after, panel.slots);
        }
        slots_ = before_ + after + 1;
    }

    int slots() const { return slots_; }
    int slots_before() const { return before_; }
    std::size_t order() const { return order_; }
    std::size_t panels() const { return density_.panel.size(); }

    /// Coefficients of Legendre's polynomials, [slot][degree][panel].
    std::vector<double> coefficients() const {
        std::vector<double> out(std::size_t(slots_) * order_ * panels(), 0.0);
        const auto add = [&](int slot, std::size_t p, const double* series, double factor) {
            for (std::size_t l = 0; l < order_; ++l) at(out, slot, l, p) += factor * double(2 * l + 1) * series[l];
        };
        for (std::size_t p = 0; p < panels(); ++p) {
            const PiecewiseDensity::Panel& panel = density_.panel[p];
            for (int slot = 0; slot < panel.slots; ++slot) add(before_ + slot, p, density_.series_of(panel, slot), 1);
            if (!density_.end_series.empty()) add(slots_ - 1, p, density_.end_series_of(p), 1);
            for (int i = panel.first_alarm; i < panel.end_alarm; ++i) {
                const PreContactAlarm& alarm = density_.alarm[std::size_t(i)];
                add(before_ + alarm.tick - panel.first_tick, p, density_.offset_series_of(p), alarm.chance);
            }
        }
        return out;
    }

  private:
    double& at(std::vector<double>& values, int slot, std::size_t row, std::size_t p) const {
        return values[(std::size_t(slot) * order_ + row) * panels() + p];
    }

    const PiecewiseDensity& density_;
    std::size_t order_;
    int before_ = 0, slots_ = 0;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
