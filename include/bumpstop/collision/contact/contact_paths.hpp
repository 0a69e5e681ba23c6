/// @file
/// All that contact in which something gives way needs of a motion: its path, and the path of every reaction.
#pragma once

#include "bumpstop/collision/contact/contact_dynamics.hpp"
#include "bumpstop/collision/motion/stopping_curve.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

struct ContactPaths {
    const LinePath* path = nullptr;
    int period = 0, latency = 0;                ///< as of Timing [simulation steps]
    int end_step = 0;                           ///< in which the undetected motion ends
    double step = 0;                            ///< simulation step [s]
    bool reverses = false;                      ///< reactions go back, and do not stand at last
    std::vector<std::vector<double>> reaction;  ///< by tick: distances [m] from the step it begins in on; may be empty
    std::vector<double> max_distance;           ///< by tick: the greatest distance from the tick on [m]
    std::vector<std::vector<double>>
        later;                    ///< by tick and step of its reaction: the greatest distance from there on [m]
    std::vector<double> reached;  ///< by step: the greatest distance of the undisturbed motion so far [m]

    ContactPaths() = default;
    /// Of the ticks of a path; their reactions are still empty.
    ContactPaths(const CollisionSetup& setup, const LinePath& of)
        : path(&of),
          period(setup.timing.period),
          latency(setup.timing.latency),
          end_step(int(of.brakes() ? of.s.size() + of.braking.size() - 1 : of.end_step(setup.timing))),
          step(setup.motion.step),
          reverses(setup.reaction == ReactionKind::reverse),
          reaction(std::size_t(of.ticks)),
          later(std::size_t(of.ticks)) {}

    /// The step after which nothing is known of the undisturbed motion: it goes on for a latency, for the reactions, or until
    /// an arm that cannot follow its line has come to rest.
    int last_step() const { return int(path->s.size() + path->braking.size()) - 1; }
    /// Distance after a step of the undisturbed motion. Before the start, and after its end, the arm stands.
    double undisturbed(int i) const {
        const std::size_t at = std::size_t(std::clamp(i, 0, last_step())), line = path->s.size();
        return at < line ? path->s[at] : path->braking[at - line];
    }
    /// By how much the undisturbed speed has changed from the step before to this one [m/s].
    double change(int i) const {
        return i < 2 ? 0.0 : (undisturbed(i) - 2 * undisturbed(i - 1) + undisturbed(i - 2)) / step;
    }
    /// Undisturbed speed in the step that ends with this one [m/s].
    double speed(int i) const { return i < 1 ? 0.0 : (undisturbed(i) - undisturbed(i - 1)) / step; }
    int tick_step(int k) const { return k * period + 1; }
    int reaction_step(int k) const { return tick_step(k) + latency; }

    /// The step after which a body at `offset` is touched; the last one where none is.
    int step_before(double offset) const {
        return int(std::upper_bound(reached.begin() + 1, reached.end(), offset) - reached.begin()) - 1;
    }

    void find_max_distance() {
        max_distance.clear();
        reached = path->s;
        reached.insert(reached.end(), path->braking.begin(), path->braking.end());
        for (std::size_t i = 1; i < reached.size(); ++i) reached[i] = std::max(reached[i], reached[i - 1]);
        for (std::size_t k = 0; k < reaction.size(); ++k) {
            double most = -HUGE_VAL;
            const int to = reaction[k].empty() ? std::max(last_step(), tick_step(int(k))) : reaction_step(int(k));
            for (int i = tick_step(int(k)); i <= to; ++i) most = std::max(most, undisturbed(i));
            for (double s : reaction[k]) most = std::max(most, s);
            max_distance.push_back(most);
        }
        later = reaction;
        for (std::vector<double>& own : later)
            for (std::size_t i = own.size(); i-- > 1;) own[i - 1] = std::max(own[i - 1], own[i]);
    }
};

/// Where the arm is after a tick `tick`, whose reaction begins a latency later. An arm whose reaction has no path of its
/// own goes on to the end of the motion and stands there; one that has let its path of return behind it goes on as fast as it last was.
class PathAfter {
  public:
    PathAfter() = default;
    /// `first`: steps from the tick to the step that is number 0 here.
    PathAfter(const ContactPaths& paths, int tick, int first)
        : paths_(&paths),
          own_(&paths.reaction[std::size_t(tick)]),
          later_(&paths.later[std::size_t(tick)]),
          from_(paths.tick_step(tick) + first),
          lead_(paths.latency - first) {
        const std::vector<double>& own = *own_;
        if (paths.reverses && own.size() > 1) retreat_ = std::min(0.0, own.back() - own[own.size() - 2]);
        if (own.empty()) own_ = nullptr;
    }
    /// Nothing reacts: the motion goes on from a step to its end.
    static PathAfter undisturbed(const ContactPaths& paths, int step) {
        PathAfter path;
        path.paths_ = &paths;
        path.from_ = step;
        path.lead_ = std::max(0, paths.end_step - step);
        path.stands_ = true;
        return path;
    }

    double at(int i) const {
        if (i < lead_) return paths_->undisturbed(from_ + i);
        if (own_ == nullptr) return paths_->undisturbed(from_ + (stands_ ? lead_ : i));
        const int last = int(own_->size()) - 1, here = i - lead_;
        return here <= last ? (*own_)[std::size_t(here)] : own_->back() + (here - last) * retreat_;
    }
    /// The same of `count` steps from the i-th on.
    void copy(int i, int count, double* to) const {
        const int first = i - lead_, known = own_ != nullptr && first >= 0 ? int(own_->size()) - first : 0;
        int n = std::clamp(known, 0, count);
        if (n > 0) std::copy_n(own_->begin() + first, n, to);
        for (; n < count; ++n) to[n] = at(i + n);
    }
    /// The greatest distance from step i on [m].
    double later(int i) const {
        if (own_ == nullptr) return HUGE_VAL;
        if (i < lead_) return std::max(paths_->undisturbed(from_ + lead_), later_->front());
        return i - lead_ < int(later_->size()) ? (*later_)[std::size_t(i - lead_)] : own_->back();
    }
    /// Steps until the path is a straight one: the arm stands, or goes back for good.
    int length() const {
        if (stands_) return lead_;
        return own_ == nullptr ? std::max(lead_ + 1, paths_->last_step() - from_)
                               : lead_ + std::max(1, int(own_->size()) - 1);
    }
    bool retreats() const { return retreat_ < 0; }

  private:
    const ContactPaths* paths_ = nullptr;
    const std::vector<double>*own_ = nullptr, *later_ = nullptr;
    int from_ = 0, lead_ = 0;
    bool stands_ = false;  // where the motion ends
    double retreat_ = 0;   // on the last known step [m]
};

namespace detail {

/// By tick: an offset below which no body is still touched when the reaction to the tick begins. A body struck at every
/// tick tells how long contact lasts; one that is held is touched until its detection is certain, after `certain` ticks.
inline std::vector<double> least_touched(const ContactPaths& paths, const ContactPropagator& by, int certain) {
    const int ticks = paths.path->ticks, last = paths.last_step();
    std::vector<double> least(std::size_t(ticks), HUGE_VAL);
    const ContactDynamics dynamics(by);
    double reached = -HUGE_VAL, before = 0;
    for (int j = 0; j < ticks; ++j) {
        const int first = paths.tick_step(j);
        const double offset = paths.undisturbed(first);
        if (!(offset > reached)) continue;  // whoever stands here has been struck before
        reached = offset;
        int i = std::min(last, paths.tick_step(std::min(j + certain, ticks)));
        if (by.gets_away) {
            ContactState state;
            for (i = first; i < last && !state.separated; ++i) {
                allow_interruption();
                dynamics.step(state, paths.undisturbed(i), paths.undisturbed(i + 1), offset);
            }
        }
        // Bodies nearer than this one were struck after the tick before.
        for (int k = std::max(0, j - 1 - paths.latency / paths.period); k < ticks && paths.reaction_step(k) <= i; ++k)
            least[std::size_t(k)] = std::min(least[std::size_t(k)], before);
        before = offset;
    }
    return least;
}

/// Reactions that begin at neighbouring ticks are alike, step by step: in every range without a switching point a few are
/// simulated and the others interpolated, where two more in between agree; else its halves are tried.
class ReactionFamily {
  public:
    static constexpr int nodes = 8, checks = 2;

    ReactionFamily(int first, int last, bool contains_switch) : first_(first), last_(last) {
        if (contains_switch || last - first + 1 < 2 * (nodes + checks)) return;
        node_ = interpolation_nodes(first, last, nodes);
        check_ = {(node_[0] + node_[1]) / 2, (node_[nodes / 2] + node_[nodes / 2 - 1]) / 2};
    }

    /// Ticks to simulate before `fill`.
    std::vector<int> wanted() const {
        std::vector<int> ticks = node_;
        ticks.insert(ticks.end(), check_.begin(), check_.end());
        for (int k = first_; node_.empty() && k <= last_; ++k) ticks.push_back(k);
        return ticks;
    }
    std::array<ReactionFamily, 2> halves() const {
        const int middle = (first_ + last_) / 2;
        return {ReactionFamily(first_, middle, false), ReactionFamily(middle + 1, last_, false)};
    }

    /// False, and nothing done, where the reactions are not smooth: interpolated distances are off by more than `tolerance` [m].
    bool fill(ContactPaths& paths, double tolerance) const {
        if (node_.empty()) return true;
        std::size_t longest = 0;
        for (int k : node_) longest = std::max(longest, paths.reaction[std::size_t(k)].size());
        const Interpolation interpolation(node_);
        // By step, the nodes' distances from where their reactions begin.
        std::vector<double> at_node(longest * nodes);
        for (std::size_t m = 0; m < nodes; ++m) {
            const PathAfter known(paths, node_[m], paths.latency);
            for (std::size_t i = 0; i < longest; ++i) at_node[i * nodes + m] = known.at(int(i)) - known.at(0);
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
            const PathAfter known(paths, k, paths.latency);
            for (std::size_t i = 0; i < longest; ++i) {
                if (!(std::fabs(path[i] - known.at(int(i))) <= tolerance)) return false;
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

}  // namespace detail

/// The paths of a line motion. Reactions that reverse are followed until every body that they find in contact has been
/// left behind. One that is held up to `largest_offset` [m] has been detected by the end of a path that ends with certainty.
template <class T>
ContactPaths contact_paths(const CollisionSetup& setup, const StoppingCurve& curve, const ContactPropagator& by,
                           double largest_offset) {
    const LinePath& path = curve.path;
    const Timing& timing = setup.timing;
    int certain = path.ticks;  // ticks of contact after which a detection is
    for (int k = 0; path.end == PathEnd::all_detected && k < path.ticks; ++k)
        certain -= path.at_tick(k, timing.period) <= largest_offset;
    ContactPaths paths(setup, path);
    const std::vector<double> least =
        setup.reaction == ReactionKind::reverse ? detail::least_touched(paths, by, certain) : std::vector<double>();
    auto simulate = [&](const std::vector<int>& ticks) {
        std::vector<ReactionJob> jobs;
        for (int k : ticks) {
            const double at_tick = path.at_tick(k, timing.period);
            jobs.push_back({&path, 0, k, {}, {}});
            jobs.back().return_to = least.empty() ? at_tick : std::min(at_tick, least[std::size_t(k)]);
        }
        simulate_reactions<T>(setup, jobs.data(), int(jobs.size()), ReactionDetail::every_step);
        for (ReactionJob& job : jobs) paths.reaction[std::size_t(job.tick)] = std::move(job.distance);
    };
    std::vector<detail::TickRange> ranges;
    detail::split_at_switches(setup, path, 0, OvertravelTolerance{}, ranges);
    std::vector<detail::ReactionFamily> families;
    for (const detail::TickRange& range : ranges) families.emplace_back(range.first, range.last, range.contains_switch);
    // Some millinewtons of the stiffest body; an arm that gives way presses it less.
    const double tolerance = by.elastic() ? 1e-7 : 1e-8;
    while (!families.empty()) {
        std::vector<int> wanted;
        for (const detail::ReactionFamily& family : families) {
            for (int k : family.wanted()) {
                if (paths.reaction[std::size_t(k)].empty()) wanted.push_back(k);
            }
        }
        simulate(wanted);
        std::vector<detail::ReactionFamily> rough;
        for (const detail::ReactionFamily& family : families) {
            if (family.fill(paths, tolerance)) continue;
            const auto halves = family.halves();
            rough.insert(rough.end(), halves.begin(), halves.end());
        }
        families = std::move(rough);
    }
    paths.find_max_distance();
    return paths;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
