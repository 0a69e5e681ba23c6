/// @file
/// Joint density of contact offset and tick of detection, as Legendre series by panel and detection slot.
#pragma once

#include <vector>

#include "bumpstop/math/mask.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// A detection before contact whose stopping path still reaches bodies of a panel, or the braking at the end of a line.
/// Its probability is the same at every offset of the panel.
struct PreContactAlarm {
    int tick;
    double reach;   ///< greatest distance of the arm then [m]
    double chance;  ///< probability, given the offset
    double before;  ///< sum of the chances of those of its panel that come before it
};

/// Over a panel the offset is mid + half x, -1 <= x <= 1. The probability that the offset is there and the collision is
/// detected at a tick has the density sum_l (2 l + 1) c_l P_l(x) in x; c_l is a series, and 2 c_0 its probability.
struct PiecewiseDensity {
    struct Panel {
        double low, high;                    ///< offsets [m]
        int first_tick;                      ///< in contact
        int slots = 0;                       ///< ticks from the first one on that may detect
        std::size_t first_slot = 0;          ///< the slots of all panels are contiguous
        double mass = 0;                     ///< probability of a detection after contact
        int first_alarm = 0, end_alarm = 0;  ///< of `alarm`

        int tick(int slot) const { return first_tick + slot; }
    };

    int order = 0;  ///< of the series; a multiple of `block`
    std::vector<Panel> panel;
    std::vector<double> series;          ///< [slot][degree]
    std::vector<double> mass;            ///< [slot]
    std::vector<double> later_mass;      ///< [slot]: of a slot and all later ones of its panel
    std::vector<double> end_series;      ///< [panel][degree]: undetected; empty: nothing is
    std::vector<double> offset_series;   ///< [panel][degree]: of the offset alone, where there are alarms
    std::vector<PreContactAlarm> alarm;  ///< contiguous by panel, the farthest first

    /// Nodes and degrees come in whole blocks, which fill the registers of every instruction set.
    static constexpr int block = 8;

    const double* series_of(const Panel& own, int slot) const {
        return &series[(own.first_slot + std::size_t(slot)) * std::size_t(order)];
    }
    double mass_of(const Panel& own, int slot) const { return mass[own.first_slot + std::size_t(slot)]; }
    const double* end_series_of(std::size_t p) const { return &end_series[p * std::size_t(order)]; }
    const double* offset_series_of(std::size_t p) const { return &offset_series[p * std::size_t(order)]; }

    /// Keeps its memory, and `series` and `mass` until they are written.
    void clear(int new_order) {
        order = new_order;
        panel.clear();
        end_series.clear();
        offset_series.clear();
        alarm.clear();
    }
    void sum_later_masses() {
        later_mass = mass;
        for (const Panel& own : panel)
            for (std::size_t slot = std::size_t(own.slots); slot-- > 1;)
                later_mass[own.first_slot + slot - 1] += later_mass[own.first_slot + slot];
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
