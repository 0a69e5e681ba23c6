/// @file
/// The reactions of contact paths.
#pragma once

#include <stdexcept>

#include "bumpstop/collision/contact/separation.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// By tick: an offset below which no body is still in contact when the reaction to the tick begins, so that a retreat
/// need not be followed further back. Bodies at the distances of all ticks count, those that no collision has too, so
/// that retreats are alike from tick to tick. One that is held stays in contact until its detection is certain, after
/// `certain` ticks.
inline std::vector<double> min_offset_in_contact(const ContactPaths& paths, const ContactPropagator& by, int certain) {
    const int ticks = paths.path->ticks;
    std::vector<double> min_offset(std::size_t(ticks), HUGE_VAL);
    std::vector<Separation> separations;
    if (by.gets_away) separations = Separations(paths, by).up_to(HUGE_VAL);
    auto separation = separations.begin();
    double reached = -HUGE_VAL, before = 0;
    for (int j = 0; j < ticks; ++j) {
        const int first = paths.tick_step(j);
        const double offset = paths.undisturbed(first);
        if (!(offset > reached)) continue;  // an earlier tick has touched a body at this offset
        reached = offset;
        int i = std::min(paths.last_step(), paths.tick_step(std::min(j + certain, ticks)));
        if (by.gets_away) {
            while (separation + 1 != separations.end() && separation[1].offset <= offset) ++separation;
            i = int(std::ceil(separation->smooth ? end_between(separation[0], separation[1], first) : separation->end));
        }
        // Bodies nearer than this one were first touched after the tick before.
        for (int k = std::max(0, j - 1 - paths.latency / paths.period); k < ticks && paths.reaction_step(k) <= i; ++k)
            min_offset[std::size_t(k)] = std::min(min_offset[std::size_t(k)], before);
        before = offset;
    }
    return min_offset;
}

/// Reactions of a range of ticks. From tick to tick they change smoothly, step by step, unless a switching point lies
/// between: a few are simulated and the others interpolated if two more in between agree. Else the range is halved.
class ReactionRange {
  public:
    static constexpr int nodes = 8, checks = 2;

    ReactionRange(int first, int last, bool contains_switch) : first_(first), last_(last) {
        if (contains_switch || last - first + 1 < 2 * (nodes + checks)) return;
        node_ = interpolation_nodes(first, last, nodes);
        check_ = {(node_[0] + node_[1]) / 2, (node_[nodes / 2] + node_[nodes / 2 - 1]) / 2};
    }

    /// Ticks to simulate before `interpolate`.
    std::vector<int> requested() const {
        std::vector<int> ticks = node_;
        ticks.insert(ticks.end(), check_.begin(), check_.end());
        for (int k = first_; node_.empty() && k <= last_; ++k) ticks.push_back(k);
        return ticks;
    }
    std::array<ReactionRange, 2> halves() const {
        const int middle = (first_ + last_) / 2;
        return {ReactionRange(first_, middle, false), ReactionRange(middle + 1, last_, false)};
    }

    /// False, with nothing changed, where interpolated distances are off by more than `tolerance` [m].
    bool interpolate(ContactPaths& paths, double tolerance) const {
        if (node_.empty()) return true;
        std::size_t longest = 0;
        for (int k : node_) longest = std::max(longest, paths.reaction[std::size_t(k)].size());
        const Interpolation interpolation(node_);
        // By step, the nodes' distances from where their reactions begin.
        std::vector<double> at_node(longest * nodes);
        for (std::size_t m = 0; m < nodes; ++m) {
            const PathAfter node(paths, node_[m], paths.latency);
            for (std::size_t i = 0; i < longest; ++i) at_node[i * nodes + m] = node.at(int(i)) - node.at(0);
        }
        auto path_of = [&](int k) {
            double weight[nodes];
            interpolation.weights(k, weight);
            const double begin = paths.undisturbed(paths.reaction_step(k));
            allow_interruption();
            std::vector<double> path(longest);
            for (std::size_t i = 0; i < longest; ++i) {
                double sum = begin;
                for (std::size_t m = 0; m < nodes; ++m) sum += weight[m] * at_node[i * nodes + m];
                path[i] = sum;
            }
            return path;
        };
        for (int k : check_) {
            const std::vector<double> path = path_of(k);
            const PathAfter simulated(paths, k, paths.latency);
            for (std::size_t i = 0; i < longest; ++i) {
                if (!(std::fabs(path[i] - simulated.at(int(i))) <= tolerance)) return false;
            }
        }
        for (int k = first_; k <= last_; ++k) {
            if (paths.reaction[std::size_t(k)].empty()) paths.reaction[std::size_t(k)] = path_of(k);
        }
        return true;
    }

  private:
    int first_, last_;
    std::vector<int> node_, check_;  // ticks; empty: all are simulated
};

/// All retreats are kept, and go back as far as bodies are in contact: distances, at most, of 16 bytes each.
inline constexpr double max_retreat_points = 1e8;

}  // namespace detail

/// The paths of a line motion. A retreat is followed until it has left every body behind that may be in contact then:
/// one held at up to `largest_offset` [m] has been detected by the end of a path whose end is `all_detected`.
/// Throws std::length_error where bodies stay in contact for so long that the retreats would take gigabytes.
template <class T>
ContactPaths contact_paths(const CollisionSetup& setup, const StoppingCurve& curve, const ContactPropagator& by,
                           double largest_offset) {
    const LinePath& path = curve.path;
    const Timing& timing = setup.timing;
    int certain = path.ticks;  // ticks of contact after which a detection is certain
    for (int k = 0; path.end == PathEnd::all_detected && k < path.ticks; ++k)
        certain -= path.at_tick(k, timing.period) <= largest_offset;
    // A retreat takes as long as the motion since the touch; of bodies that are never detected, half of that in the mean.
    const double share = certain < path.ticks ? 1.0 : 0.5;
    if (setup.reaction == ReactionKind::reverse && !by.gets_away &&
        share * path.ticks * certain * timing.period > detail::max_retreat_points)
        throw std::length_error("retreats from all ticks need more memory than they may take");
    ContactPaths paths(setup, path);
    paths.follow_approach(by);
    const std::vector<double> min_offset = setup.reaction == ReactionKind::reverse
                                               ? detail::min_offset_in_contact(paths, by, certain)
                                               : std::vector<double>();
    auto simulate = [&](const std::vector<int>& ticks) {
        std::vector<ReactionJob> jobs;
        for (int k : ticks) {
            const double at_tick = path.at_tick(k, timing.period);
            jobs.push_back({&path, 0, k, {}, {}});
            jobs.back().return_to = min_offset.empty() ? at_tick : std::min(at_tick, min_offset[std::size_t(k)]);
        }
        simulate_reactions<T>(setup, jobs.data(), int(jobs.size()), ReactionDetail::every_step);
        for (ReactionJob& job : jobs) paths.reaction[std::size_t(job.tick)] = std::move(job.distance);
    };
    std::vector<detail::TickRange> ranges;
    detail::split_at_switches(setup, path, 0, OvertravelTolerance{}, ranges);
    std::vector<detail::ReactionRange> reactions;
    for (const detail::TickRange& range : ranges)
        reactions.emplace_back(range.first, range.last, range.contains_switch);
    // Some millinewtons of the stiffest body; an elastic arm presses it less.
    const double tolerance = by.elastic() ? 1e-7 : 1e-8;
    while (!reactions.empty()) {
        std::vector<int> requested;
        for (const detail::ReactionRange& range : reactions)
            for (int k : range.requested())
                if (paths.reaction[std::size_t(k)].empty()) requested.push_back(k);
        simulate(requested);
        std::vector<detail::ReactionRange> rough;
        for (const detail::ReactionRange& range : reactions) {
            if (range.interpolate(paths, tolerance)) continue;
            const auto halves = range.halves();
            rough.insert(rough.end(), halves.begin(), halves.end());
        }
        reactions = std::move(rough);
    }
    paths.find_max_distance();
    return paths;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
