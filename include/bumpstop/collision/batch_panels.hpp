/// @file
/// The panels of offsets that the law of one pose among many is integrated on.
#pragma once

#include <algorithm>
#include <limits>
#include <vector>

#include "bumpstop/collision/offset_law.hpp"
#include "bumpstop/collision/quiet_table.hpp"
#include "bumpstop/detection/alarm_table.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Panels end where a tick comes into contact, and are narrow enough for one polynomial of the alarm table. The object keeps
/// its memory for the next pose.
class BatchPanels {
  public:
    BatchPanels(const ThresholdDetector& detector, const Timing& timing, const QuietTable& quiet, double stiffness,
                OffsetKind offset_kind)
        : detector_(detector), timing_(timing), quiet_(quiet), stiffness_(stiffness), offset_kind_(offset_kind) {}

  protected:
    struct Panel {
        double low, high;
        int tick, ticks,
            part;       ///< first tick in contact; how many it holds, 0: unlike others; part of the tick's travel
        int slots = 0;  ///< ticks from the first on that may detect
        bool known = false;
        bool sorted = false;  ///< the later a stopping path of its slots begins, the farther it ends
        double mass = 0;      ///< probability of a detection
        std::size_t series_at = 0, mass_at = 0;
        double silence = 0, total = 0;  ///< before the panel; of the offset
    };

    /// False where the noise is too narrow for panels.
    bool cut_panels(const LinePath& path, const OffsetLaw& offset) {
        path_ = &path;
        offset_ = offset;
        panels_.clear();
        place_edges();
        return place_panels();
    }

    std::size_t end_step() const { return path_->end_step(timing_); }
    double s_tick(int k) const { return path_->at_tick(k, timing_.period); }
    /// By watched joint, readable up to max_joints.
    const double* torque_per_N(int k) const { return &torque_per_N_[std::size_t(k) * max_joints]; }

    void add_end_panels(double low, double high, int tick) {
        high = std::min(high, offset_.largest());
        if (!(high > low)) return;
        int pieces = 1;
        if (offset_kind_ == OffsetKind::half_normal)
            pieces = std::max(1, int(std::ceil((high - low) / (widest_density * offset_.size))));
        for (int i = 0; i < pieces; ++i)
            panels_.push_back({low + (high - low) * i / pieces, low + (high - low) * (i + 1) / pieces, tick, 0, 0});
    }

    const ThresholdDetector& detector_;
    const Timing& timing_;
    const QuietTable& quiet_;
    const double stiffness_;
    const OffsetKind offset_kind_;
    const LinePath* path_ = nullptr;
    OffsetLaw offset_;
    std::vector<double> edge_;  ///< panel of tick k: edge_[k]..edge_[k + 1]
    std::vector<Panel> panels_;
    int felt_[max_joints] = {}, felt_count_ = 0;  ///< watched joints that a force moves
    IdleTick untouched_;                          ///< of the others

  private:
    static constexpr int longest_group = 64, most_parts = 16;
    /// Panel, in standard deviations of the residual, where a detection may be so improbable that who triggered it hangs on
    /// far tails. Elsewhere they may be as wide as the table allows.
    static constexpr double widest_uncertain = 1.5;
    static constexpr double widest_density = 0.5;  ///< panel, in standard deviations of the offset
    static constexpr double rare_alarm = 1e-5;     ///< at an idle tick, for a panel to hold several
    /// A joint whose residual stays smaller than this, as that of a flange whose axis meets the contact point, is as good as
    /// untouched [standard deviations].
    static constexpr double unfelt_residual = 1e-6;

    void place_edges() {
        const int ticks = path_->ticks;
        edge_.resize(std::size_t(ticks) + 2);
        edge_[0] = 0;
        for (int k = 0; k < ticks; ++k) edge_[k + 1] = std::max(edge_[k], s_tick(k));
        const auto end = path_->s.begin() + std::ptrdiff_t(end_step()) + 1;
        edge_[ticks + 1] = std::max(edge_[ticks], *std::max_element(path_->s.begin(), end));
    }

    /// Where the arm moves slowly a panel holds several ticks, where it moves fast a tick's travel is cut into as many.
    bool place_panels() {
        const int ticks = path_->ticks;
        using L = Lanes<native_lanes>;
        static_assert(max_joints % native_lanes == 0);
        alignas(64) double most_torque[max_joints] = {};  // by watched joint
        torque_per_N_.resize(std::size_t(ticks) * max_joints);
        for (int k = 0; k < ticks; ++k) {
            double* own = &torque_per_N_[std::size_t(k) * max_joints];
            for (int w = 0; w < detector_.watched; ++w)
                own[w] = path_->torque_per_N[std::size_t(k) * path_->dof + detector_.joint[w]];
            for (int w = 0; w < detector_.watched; w += native_lanes)
                store(maximum(load<L>(most_torque + w), absolute(load<L>(own + w))), most_torque + w);
        }
        double gain = 0;
        felt_count_ = 0;
        untouched_ = {};
        for (int w = 0; w < detector_.watched; ++w) {
            // Of the residual, in standard deviations per metre.
            const double own = most_torque[w] * stiffness_ / detector_.sd[w];
            gain = std::max(gain, own);
            const double idle = quiet_.idle().single[std::size_t(w)];
            if (own * edge_.back() > unfelt_residual) {
                felt_[felt_count_++] = w;
            } else {
                untouched_.add(w, {idle, 1 - idle});
            }
        }
        const double widest = path_->end == PathEnd::certain_detection ? AlarmTable::widest : widest_uncertain;
        double width = gain > 0 ? widest / gain : std::numeric_limits<double>::infinity();
        if (offset_kind_ == OffsetKind::half_normal) width = std::min(width, widest_density * offset_.size);
        const double largest = offset_.largest();
        const bool rare = !quiet_.armed(ticks - 1) || quiet_.idle().alarm < rare_alarm;
        left_.clear();
        for (int k = 0; k < ticks && !rare; ++k)
            if (s_tick(k) < edge_[k + 1]) left_.push_back(s_tick(k));
        std::sort(left_.begin(), left_.end());
        int group = 1;
        for (int k = 0; k < ticks && edge_[k] < largest; k += group) {
            int parts = 1;
            group = rare && k > 0 ? group_at(k, group, width) : 1;
            const double low = edge_[k], high = std::min(edge_[k + group], largest);
            while (parts <= most_parts && (high - low) > parts * width) parts *= 2;
            if (parts > most_parts) return false;
            if (cut_where_left(k, low, high, width)) continue;
            // One that the end of the offsets cuts short is like no other.
            const int whole = edge_[k + group] <= largest ? group : 0;
            for (int part = 0; part < parts && high > low; ++part)
                panels_.push_back(
                    {low + (high - low) * part / parts, low + (high - low) * (part + 1) / parts, k, whole, part});
        }
        add_end_panels(edge_[ticks], edge_[ticks + 1], ticks);
        return true;
    }

    /// Bodies beyond where an arm that falls back stands at a tick are not touched any more. Where idle alarms are not
    /// rare, theirs have a kink there, and the panel of tick k is cut. False where there is no such place.
    bool cut_where_left(int k, double low, double high, double width) {
        const auto first = std::upper_bound(left_.begin(), left_.end(), low);
        const auto last = std::lower_bound(first, left_.end(), high);
        if (first == last) return false;
        for (auto at = first;; ++at) {
            const double end = at == last ? high : *at;
            const int parts = std::max(1, int(std::ceil((end - low) / width)));
            for (int part = 0; part < parts && end > low; ++part)
                panels_.push_back({low + (end - low) * part / parts, low + (end - low) * (part + 1) / parts, k, 0, 0});
            if (at == last) return true;
            low = end;
        }
    }

    /// How many ticks from k on a panel may hold: as many as the last one, unless they have become too wide, or much narrower.
    int group_at(int k, int last, double width) const {
        const int most = std::min(longest_group, path_->ticks - k);
        auto fits = [&](int group) { return group <= most && edge_[k + group] - edge_[k] <= width; };
        if (fits(last) && !fits(last + last / 2 + 1)) return last;
        int group = 1;
        while (fits(group + 1)) ++group;
        return group;
    }

    std::vector<double> torque_per_N_;  ///< [tick][watched joint, max_joints places]
    std::vector<double> left_;          ///< where an arm that falls back stands at a tick [m]
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
