/// @file
/// How probably a collision passes a force, where the arm cannot follow its line and reactions are dear: only those to
/// the ticks that decide are simulated.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "bumpstop/collision/exact_law.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// What is asked, and how well the answer must be known.
struct LimitQuestion {
    double stiffness = 0;  ///< N/m
    OffsetLaw offset;
    double force = 0;     ///< the limit [N]
    double accepted = 0;  ///< risk; far from it a rough answer will do
    /// More than the accepted risk at a singularity decides: then no reaction is simulated, and the bounds are wide.
    bool crossing_decides = false;
};

/// The answer: the probability of passing the limit lies between `low` and `high`. Never detected counts as passing it,
/// unless the arm comes to rest at a lower force.
struct LimitRisk {
    double low = 0, high = 1;
    double undetected = 0;   ///< the part of it that is never detected
    double false_alarm = 0;  ///< detection before contact
    /// Not noticed before the first singularity that the arm passes or stands at; `undetected` where there is none.
    double at_crossing = 0;
    bool follows = true;  ///< the tool has the same travel from tick to tick
    int reactions = 0;    ///< simulated
};

/// Travel in a tick that differs by more than this share is not that of a line at constant speed.
inline constexpr double off_line = 1e-3;
/// Near the accepted risk the answer is known to this share of itself.
inline constexpr double risk_resolution = 1e-3;
/// So many times the accepted risk or less, and so many times it or more, it need not be known better.
inline constexpr double clearly_met = 0.1, clearly_passed = 10;

/// A path, and how far the arm gets after a reaction at each of its ticks, kept for further questions about it.
struct KnownPath {
    struct Reach {
        double farthest = -1;  ///< [m]; negative: not known
        double enough = 0;     ///< the reaction was followed no farther than this [m]
    };
    std::vector<Reach> reach;  ///< by tick
    LinePath path;             ///< the longest traced; without ticks: none is

    /// The path as far as `finished` wants it. False where it is not known so far.
    template <class Finished>
    bool shortened(const Timing& timing, Finished& finished, LinePath& to) const {
        const std::size_t free = 2 * std::size_t(path.free_count);
        for (int k = 0; k < path.ticks; ++k) {
            finished.observe(path.at_tick(k, timing.period), &path.torque_per_N[std::size_t(k) * path.dof]);
            if (!finished.finished(0)) continue;
            to = path;
            to.ticks = k + 1;
            to.end = PathEnd::certain_detection;
            to.end_joint = -1;
            const std::size_t length = std::size_t(k) * timing.period + 2 + timing.latency;
            if (length <= path.s.size()) {  // the arm reacts before it would have to brake
                to.s.resize(length);
                to.cut_step = -1;
                to.braking.clear();
            }
            to.torque_per_N.resize(std::size_t(to.ticks) * path.dof);
            to.reaction_state.resize(std::min(path.reaction_state.size(), to.ticks * free));
            return true;
        }
        to = path;
        return path.ticks > 0 && path.end != PathEnd::certain_detection;
    }

    /// Is tick k known well enough for a question that ends at `enough`?
    bool knows(int k, double enough) const {
        if (std::size_t(k) >= reach.size()) return false;
        const Reach& here = reach[std::size_t(k)];
        return here.farthest >= 0 && (here.farthest <= here.enough || enough <= here.enough);
    }
    void keep(int k, double farthest, double enough) {
        if (std::size_t(k) >= reach.size()) reach.resize(std::size_t(k) + 1);
        reach[std::size_t(k)] = {std::max(0.0, farthest), enough};
    }
};

namespace detail {

/// Has the tool the same travel from tick to tick?
inline bool follows_its_line(const LinePath& path, const Timing& timing) {
    if (path.ticks < 2) return true;
    const double first = path.at_tick(1, timing.period) - path.at_tick(0, timing.period);
    double least = first, most = first;
    for (int k = 2; k < path.ticks; ++k) {
        const double step = path.at_tick(k, timing.period) - path.at_tick(k - 1, timing.period);
        least = std::min(least, step);
        most = std::max(most, step);
    }
    return most - least <= off_line * std::fabs(first);
}

/// The determinant of a square matrix, which is used up.
template <int N>
double determinant(double (&a)[N][N]) {
    double product = 1;
    for (int c = 0; c < N; ++c) {
        int pivot = c;
        for (int r = c + 1; r < N; ++r) {
            if (std::fabs(a[r][c]) > std::fabs(a[pivot][c])) pivot = r;
        }
        if (a[pivot][c] == 0) return 0;
        if (pivot != c) {
            std::swap(a[pivot], a[c]);
            product = -product;
        }
        product *= a[c][c];
        for (int r = c + 1; r < N; ++r) {
            const double factor = a[r][c] / a[c][c];
            for (int i = c + 1; i < N; ++i) a[r][i] -= factor * a[c][i];
        }
    }
    return product;
}

/// The determinant of the Jacobian that the motion inverts, where there are as many free joints as rows.
inline double jacobian_determinant(const Chain& chain, const MotionSettings& motion, const double* q) {
    ArmState<double> state;
    for (int j = 0; j < chain.dof; ++j) state.q[j] = q[j];
    state.refresh_angles(chain);
    Posture<double> posture;
    forward_kinematics(chain, state.q, state.angle, posture);
    const Point3<double> tip = posture.position(motion.tip);
    double linear[3][max_columns], angular[3][max_columns];
    for (int f = 0; f < motion.free_count; ++f) {
        const int j = motion.free_joint[f];
        const Point3<double> column = linear_column(chain, posture, tip, j);
        const bool turns = !chain.joint[j].prismatic;
        const double along[3] = {column.x, column.y, column.z};
        const double about[3] = {posture.axis[j].x, posture.axis[j].y, posture.axis[j].z};
        for (int r = 0; r < 3; ++r) {
            linear[r][f] = along[r];
            angular[r][f] = turns ? about[r] : 0.0;
        }
    }
    if (motion.task_rows == 3) {
        double a[3][3];
        for (int r = 0; r < 3; ++r) std::copy_n(linear[r], 3, a[r]);
        return determinant(a);
    }
    double a[6][6];
    for (int r = 0; r < 3; ++r) {
        std::copy_n(angular[r], 6, a[r]);
        std::copy_n(linear[r], 6, a[r + 3]);
    }
    return determinant(a);
}

/// The first tick whose reaction would begin beyond a singularity that the arm has passed; `path.ticks` where it passes
/// none. Only where joints and rows are equally many does a path cross singularities: elsewhere it goes round them.
inline int first_crossing(const Chain& chain, const MotionSettings& motion, const LinePath& path, const double* start) {
    if (motion.free_count != motion.task_rows) return path.ticks;
    const int known = std::min(path.ticks, int(path.reaction_state.size() / (2 * std::size_t(motion.free_count))));
    double q[max_joints];
    std::copy_n(start, chain.dof, q);
    const bool positive = jacobian_determinant(chain, motion, q) > 0;
    for (int k = 0; k < known; ++k) {
        for (int f = 0; f < motion.free_count; ++f)
            q[motion.free_joint[f]] = path.reaction_state[std::size_t(k) * 2 * motion.free_count + f];
        if ((jacobian_determinant(chain, motion, q) > 0) != positive) return k;
    }
    return path.ticks;
}

}  // namespace detail

/// The parts of the risk, tick by tick: what a detection there may come to, and what it does come to once its stopping
/// path is known.
template <class T>
class LimitRiskFinder {
  public:
    /// `q` are the joint positions that paths begin in. `known` belongs to one path: reactions are
    /// taken from there, and new ones put there.
    LimitRiskFinder(const Chain& chain, const MotionSettings& motion, const ContactGeometry& contact,
                    const Timing& timing, ReactionKind kind, const ThresholdDetector& detector, const double* q,
                    const LimitQuestion& question, KnownPath& known)
        : chain_(chain),
          motion_(motion),
          contact_(contact),
          timing_(timing),
          kind_(kind),
          detector_(detector),
          q_(q),
          question_(question),
          known_(known) {}

    /// `path` ends where even the farthest body would have been noticed.
    LimitRisk operator()(LinePath path) {
        LimitRisk found;
        StoppingCurve curve;
        curve.path = std::move(path);
        const int ticks = curve.path.ticks;
        found.follows = detail::follows_its_line(curve.path, timing_);
        // With a latency a reaction may begin sooner, and take the arm farther: all of them are looked at.
        if (found.follows || timing_.latency > 0) {
            // An arm that follows its line needs no more than a batch does. One that does not may hit hard and much the same
            // every time: a probability then shows what a batch's figures do not, and its reactions are a single law's.
            const std::vector<double> probability(std::size_t(ticks), 1.0);
            const FarthestTolerance tolerance{found.follows ? probability.data() : nullptr};
            complete_curves<T>(
                chain_, motion_, contact_, timing_, kind_, &curve, 1, [&](int) { return q_; },
                [&](int) { return tolerance; });
            const LawSettings settings{question_.stiffness, question_.offset, 1, false};
            const ExactLaw law = ExactLawBuilder<T>(curve, timing_, motion_, detector_, settings).build();
            found.undetected = undetected_over(law);
            found.false_alarm = law.false_alarm;
            found.low = found.high = peak_force_over<T>(law, question_.force);
            found.reactions = curve.reactions_simulated;
            if (!found.follows) find_crossing(curve.path, law, found);
            return found;
        }
        // Without reactions the law says who is noticed when.
        for (int k = 0; k < ticks; ++k) curve.farthest.push_back(curve.path.at_tick(k, timing_.period));
        const LawSettings settings{question_.stiffness, question_.offset, 1, false};
        const ExactLaw law = ExactLawBuilder<T>(curve, timing_, motion_, detector_, settings).build();
        found.undetected = undetected_over(law);
        found.false_alarm = law.false_alarm;
        find_crossing(curve.path, law, found);
        decide(curve.path, law, found);
        return found;
    }

  private:
    /// Weighs the ticks, and tells what hangs on whether the arm gets across a singularity.
    void find_crossing(const LinePath& path, const ExactLaw& law, LimitRisk& found) {
        weigh(path, law);
        const int crossing = detail::first_crossing(chain_, motion_, path, q_);
        // Whether the arm stands there or gets across, and hits harder, is chance: neither is to be relied on.
        const bool may_cross = crossing < path.ticks || path.end == PathEnd::singularity;
        found.at_crossing = may_cross ? std::max(0.0, law.undetected) : found.undetected;
        for (int k = crossing; k < path.ticks; ++k) found.at_crossing += felt_[std::size_t(k)];
        found.at_crossing += braking_;
    }
    /// Probability of passing the force without being noticed.
    double undetected_over(const ExactLaw& law) const {
        if (!law.rests) return std::max(0.0, law.undetected);
        return tail<T>(law.pieces, law.end_force, question_.force).probability;
    }
    /// Probability of a detection at every tick: after contact, and before it.
    void weigh(const LinePath& path, const ExactLaw& law) {
        const QuietTicks quiet(detector_, timing_, motion_.step, path.ticks);
        felt_.assign(std::size_t(path.ticks), 0.0);
        early_.assign(std::size_t(path.ticks), 0.0);
        edge_.assign(std::size_t(path.ticks), 0.0);
        const LawPieces& pieces = law.pieces;
        for (int slot = pieces.slots_before; slot + 1 < pieces.slots; ++slot) {
            for (int p = 0; p < pieces.panels; ++p) {
                const int k = pieces.first_tick[std::size_t(p)] + slot - pieces.slots_before;
                if (k < path.ticks) felt_[std::size_t(k)] += std::max(0.0, 2 * *pieces.series(slot, p));
            }
        }
        double edge = 0;
        for (int k = 0; k < path.ticks; ++k) {
            edge = std::max(edge, path.at_tick(k, timing_.period));
            edge_[std::size_t(k)] = edge;
            if (quiet.armed(k)) early_[std::size_t(k)] = quiet.silence_before(k) * quiet.idle(k).alarm;
        }
        // Bodies beyond the line that the arm still reaches while it brakes, where nothing has alarmed before.
        braking_ = 0;
        if (!path.brakes() || path.ticks == 0) return;
        const auto end = path.s.begin() + std::ptrdiff_t(path.end_step(timing_)) + 1;
        const double line = std::max(edge, *std::max_element(path.s.begin(), end));
        const double deepest = path.farthest_braking() - question_.force / question_.stiffness;
        braking_ = quiet.silence_before(path.ticks) * std::max(0.0, beyond(line) - beyond(deepest));
    }

    double beyond(double offset) const {
        if (question_.offset.kind == OffsetKind::fixed) return question_.offset.size > offset ? 1 : 0;
        return question_.offset.probability_beyond(offset);
    }
    /// What a detection at tick k comes to at most.
    double most(int k) const { return felt_[std::size_t(k)] + early_[std::size_t(k)] * beyond(edge_[std::size_t(k)]); }
    /// What it comes to if the arm gets as far as `farthest`.
    double passing(const ExactLaw& law, int k, double farthest) const {
        const LawPieces& pieces = law.pieces;
        const double depth = question_.force / question_.stiffness, deepest = farthest - depth;
        const double before = beyond(edge_[std::size_t(k)]) - beyond(deepest);
        double total = early_[std::size_t(k)] * std::max(0.0, before);
        for (int p = 0; p < pieces.panels; ++p) {
            const int slot = k - pieces.first_tick[std::size_t(p)] + pieces.slots_before;
            if (slot < pieces.slots_before || slot + 1 >= pieces.slots) continue;
            const double half = std::max(pieces.half[std::size_t(p)], 1e-300);
            const double x = std::clamp((deepest - pieces.mid[std::size_t(p)]) / half, -1.0, 1.0);
            if (!(x > -1)) continue;
            const double* c = pieces.series(slot, p);
            total += legendre_series(pieces.order, x, [&](int l) {
                         return c[std::size_t(l) * std::size_t(pieces.panels)];
                     }).integral;
        }
        return std::clamp(total, 0.0, most(k));
    }

    /// Simulates reactions, those to the most probable ticks first, until the answer is known well enough.
    void decide(const LinePath& path, const ExactLaw& law, LimitRisk& found) {
        const int ticks = path.ticks;
        const int known = std::min(ticks, int(path.reaction_state.size() / (2 * std::size_t(motion_.free_count))));
        std::vector<double> least(std::size_t(ticks), 0.0), greatest(std::size_t(ticks), 0.0);
        const double largest = question_.offset.largest() + question_.force / question_.stiffness;
        std::vector<int> open;
        for (int k = 0; k < ticks; ++k) {
            // The arm goes on for the latency, or brakes where it cannot follow its line as far.
            const auto from = path.s.begin() + std::ptrdiff_t(k) * timing_.period + 1;
            least[std::size_t(k)] = passing(
                law, k,
                k < known ? *std::max_element(from, from + timing_.latency + 1) : detail::farthest_on_line(path, from));
            greatest[std::size_t(k)] = k < known ? most(k) : least[std::size_t(k)];
            if (known_.knows(k, largest))
                least[std::size_t(k)] = greatest[std::size_t(k)] =
                    passing(law, k, known_.reach[std::size_t(k)].farthest);
            if (greatest[std::size_t(k)] > least[std::size_t(k)]) open.push_back(k);
        }
        std::sort(open.begin(), open.end(), [&](int a, int b) {
            return greatest[std::size_t(a)] - least[std::size_t(a)] > greatest[std::size_t(b)] - least[std::size_t(b)];
        });
        const std::vector<double> probability = greatest;
        const FarthestTolerance tolerance{probability.data()};
        std::size_t done = 0;
        std::vector<ReactionJob> jobs;
        // Few at first, for a rough answer may do; then more, for registers that are full.
        for (std::size_t at_once = 2 * std::size_t(Scalar<T>::lanes);; at_once *= 2) {
            found.low = found.high = found.undetected + braking_;
            for (int k = 0; k < ticks; ++k) {
                found.low += least[std::size_t(k)];
                found.high += greatest[std::size_t(k)];
            }
            const bool decided = question_.crossing_decides && found.at_crossing > question_.accepted;
            if (decided || done == open.size() || found.high <= clearly_met * question_.accepted ||
                found.low >= clearly_passed * question_.accepted ||
                found.high - found.low <= risk_resolution * found.high)
                return;
            jobs.clear();
            for (; done < open.size() && jobs.size() < at_once; ++done) {
                // Here a probability is all that is told: of an arm that hits hard, and much the same every time, it shows
                // what a batch's figures do not.
                const double leaps = 0.01 * tolerance.of_leaps(open[done]);
                jobs.push_back({&path, 0, open[done], {}, {}, leaps, largest});
            }
            simulate_reactions<T>(
                chain_, motion_, contact_, timing_, kind_, jobs.data(), int(jobs.size()), ReactionDetail::only_peak,
                [&](const ReactionJob&) { return q_; },
                [&](const ReactionJob& job) { return path.at_tick(job.tick, timing_.period); });
            found.reactions += int(jobs.size());
            for (const ReactionJob& job : jobs) {
                const auto from = path.s.begin() + std::ptrdiff_t(job.tick) * timing_.period + 1;
                const double before = *std::max_element(from, from + timing_.latency + 1);
                const double farthest =
                    std::max(before, from[timing_.latency] + std::max(0.0, detail::overrun(job.distance)));
                known_.keep(job.tick, farthest, largest);
                least[std::size_t(job.tick)] = greatest[std::size_t(job.tick)] = passing(law, job.tick, farthest);
            }
        }
    }

    const Chain& chain_;
    const MotionSettings& motion_;
    const ContactGeometry& contact_;
    const Timing& timing_;
    const ReactionKind kind_;
    const ThresholdDetector& detector_;
    const double* q_;
    const LimitQuestion question_;
    KnownPath& known_;
    std::vector<double> felt_, early_;  ///< by tick: probability of a detection after contact; of an alarm before it
    std::vector<double> edge_;          ///< by tick: bodies nearer than this have been touched [m]
    double braking_ = 0;  ///< probability of a body that only the braking arm reaches, and presses too hard
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
