/// @file
/// Detection probabilities of many panels, computed for a few and interpolated for the others.
#pragma once

#include <numeric>

#include "bumpstop/collision/distribution/detection_probabilities.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// While the arm moves steadily the panels differ only by the slow change of the Jacobian, so probabilities at a given
/// node and slot are smooth from tick to tick: a few panels are computed and the others interpolated, if two more in
/// between agree; else the range is halved.
template <class T, class Alarms, class Contact>
class InterpolatedPanels {
  public:
    InterpolatedPanels(DetectionIntegrator<T, Alarms>& integrator, Contact& contact, const OffsetMesh& mesh,
                       const PreContactAlarms& before, DetectionProbabilities& out)
        : integrator_(integrator),
          contact_(contact),
          panels_(mesh.panels()),
          order_(std::size_t(mesh.order())),
          before_(before),
          out_(out),
          tolerance_(std::max(Alarms::interpolation_tolerance, contact.chance_tolerance())),
          negligible_(std::max(Alarms::max_interpolated_survival, contact.chance_tolerance())) {}

    void operator()() {
        out_.begin(panels_.size());
        for (std::size_t first = 0; first < panels_.size();) {
            // Successive ticks with the same number of panels are interpolated together, each part with its like.
            std::size_t parts = 1;
            while (first + parts < panels_.size() && panels_[first + parts].part == int(parts)) ++parts;
            std::size_t end = first + parts;
            while (end + parts <= panels_.size() && alike(panels_[first], panels_[end], parts, end)) end += parts;
            for (std::size_t part = 0; part < parts; ++part) {
                run_.clear();
                for (std::size_t p = first + part; p < end; p += parts) run_.push_back(p);
                find_run(0, int(run_.size()));
            }
            first = end;
        }
    }

    bool interpolated() const { return interpolated_; }

  private:
    static_assert(Alarms::interpolation_nodes.back() <= DetectionProbabilities::max_nodes);
    static constexpr int lanes = Scalar<T>::lanes;

    /// Whether the `parts` panels from `at` on are those of the next tick, or group of ticks, and as many as at `head`.
    bool alike(const OffsetPanel& head, const OffsetPanel& next, std::size_t parts, std::size_t at) const {
        return next.ticks == head.ticks && next.part == 0 && head.tick > 0 && head.ticks > 0 &&
               next.tick == panels_[at - 1].tick + head.ticks && before_.armed(head.tick) &&
               (parts == 1 || panels_[at + parts - 1].part == int(parts) - 1) &&
               (at + parts == panels_.size() || panels_[at + parts].part == 0);
    }

    void compute(std::size_t p) {
        if (!out_.panel[p].computed) integrator_.find(contact_, panels_[p], int(order_), p, out_);
    }

    /// Fills the panels run_[first .. end - 1].
    void find_run(int first, int end) {
        const int count = end - first;
        if (count < 2 * Alarms::interpolation_nodes.front()) {
            for (int i = first; i < end; ++i) compute(run_[std::size_t(i)]);
            return;
        }
        for (int nodes : Alarms::interpolation_nodes) {
            if (count < 2 * nodes) break;
            const Interpolation interpolation(interpolation_nodes(first, end - 1, nodes));
            if (!agree(interpolation)) continue;
            interpolated_ = true;
            for (int i = first; i < end; ++i) {
                const std::size_t p = run_[std::size_t(i)];
                if (!out_.panel[p].computed) interpolate(p, i, interpolation);
            }
            out_.run.push_back(from_);
            return;
        }
        find_run(first, first + count / 2);
        find_run(first + count / 2, end);
    }

    /// Whether probabilities interpolated from the panels at the nodes agree with those of two panels between them.
    bool agree(const Interpolation& interpolation) {
        const std::vector<int>& node = interpolation.nodes();
        const std::size_t half = node.size() / 2;
        from_ = {interpolation.size(), std::numeric_limits<int>::max(), 0, {}};
        for (int m = 0; m < from_.nodes; ++m) {
            from_.panel[m] = run_[std::size_t(node[std::size_t(m)])];
            compute(from_.panel[m]);
            from_.shortest = std::min(from_.shortest, out_.panel[from_.panel[m]].slots);
            from_.longest = std::max(from_.longest, out_.panel[from_.panel[m]].slots);
        }
        for (int i : {(node[0] + node[1]) / 2, (node[half] + node[half - 1]) / 2}) {
            const std::size_t p = run_[std::size_t(i)];
            compute(p);
            interpolation.weights(i, weight_);
            if (!agrees(p)) return false;
        }
        return true;
    }

    /// Whether interpolated and computed probabilities of a panel agree.
    bool agrees(std::size_t p) const {
        if (!Contact::may_separate || integrator_.path().end != PathEnd::all_detected) {
            // Where the end of the motion decides what stays undetected, nothing is smooth.
            for (int m = 0; m < from_.nodes; ++m) {
                const double* survived = &out_.survived[out_.panel[from_.panel[m]].row * order_];
                if (*std::max_element(survived, survived + order_) > negligible_) return false;
            }
        } else if (!values_agree(p, order_, tolerance_,
                                 [&](const auto& of) { return &out_.survived[of.row * order_]; })) {
            return false;
        }
        for (int slot = 0; slot < out_.panel[p].slots; ++slot) {
            const auto detected = [&](const DetectionProbabilities::Panel& of) {
                return slot < of.slots ? &out_.detected[(of.first_slot + std::size_t(slot)) * order_] : nullptr;
            };
            if (!values_agree(p, order_, tolerance_, detected)) return false;
        }
        // These are sums over ticks, whose errors add up.
        const std::size_t count = order_ * (out_.trigger.size() / out_.survived.size());
        return values_agree(p, count, 10 * tolerance_, [&](const auto& of) { return &out_.trigger[of.row * count]; });
    }
    /// The same for `count` values; `at(panel)` points to those of a panel, and is null where they are 0.
    template <class At>
    bool values_agree(std::size_t p, std::size_t count, double tolerance, const At& at) const {
        const double* direct = at(out_.panel[p]);
        for (std::size_t i = 0; i < count; i += std::size_t(lanes)) {
            T off = -load<T>(direct + i);
            for (int m = 0; m < from_.nodes; ++m)
                if (const double* from = at(out_.panel[from_.panel[m]])) off += weight_[m] * load<T>(from + i);
            if (any(abs(off) > T(tolerance))) return false;
        }
        return true;
    }

    void interpolate(std::size_t p, int place, const Interpolation& interpolation) {
        DetectionProbabilities::Panel& panel = out_.panel[p];
        panel.slots = std::min(from_.longest, integrator_.path().ticks - panels_[p].tick);
        panel.run = out_.run.size();
        panel.weight = out_.weight.size();
        interpolation.weights(place, weight_);
        out_.weight.insert(out_.weight.end(), weight_, weight_ + from_.nodes);
    }

    DetectionIntegrator<T, Alarms>& integrator_;
    Contact& contact_;
    const std::vector<OffsetPanel>& panels_;
    const std::size_t order_;
    const PreContactAlarms& before_;
    DetectionProbabilities& out_;
    double tolerance_, negligible_;  ///< error of probabilities; survival of the motion
    std::vector<std::size_t> run_;
    DetectionProbabilities::Run from_;                       ///< panels to interpolate from,
    double weight_[DetectionProbabilities::max_nodes] = {};  ///< and their weights
    bool interpolated_ = false;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
