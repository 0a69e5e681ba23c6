/// @file
/// Reactions to simulate, and their progress side by side: their peaks so far, and when these are known to be final.
#pragma once

#include <vector>

#include "bumpstop/collision/motion/arm_integrator.hpp"
#include "bumpstop/collision/motion/line_path.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The reaction to `tick` on `path`. Result: distance[i] is the distance along the normal after step[i] simulation
/// steps of the reaction; step[0] = 0 is its beginning.
struct ReactionJob {
    const LinePath* path;
    int curve;                           ///< index of the curve that the path belongs to
    int tick;                            ///< may be negative, see LinePath::early_ticks
    std::vector<double> distance;        ///< result [m]
    std::vector<int> step;               ///< result
    double tolerance = exact_tolerance;  ///< as in ArmIntegrator::begin
    double return_to = 0;                ///< a point that reverses is followed until behind this distance [m]
    bool may_rebound = true;             ///< false: the first peak is accepted, even near a singularity
    bool rebounded = false;              ///< result: while retreating the point came near its peak again
    bool met_singularity = false;        ///< result: a singularity was near somewhere on the way
};

/// Which part of a reaction is needed.
///
/// `only_peak`: steps far from the peak may be missing, and a reaction that reverses ends once the point retreats, as
/// it comes forward again only if a singularity was near or the arm did not follow its line and swings on. Such an arm
/// is followed for 1.5 times the stopping time of its slowest joint plus 50 ms, the length of a run after detection in
/// Schroeder (2013), and at least to its first retreat.
///
/// `every_step`: all steps, for as long, and until the point is behind `return_to`. If after that time it exceeds its
/// peak instead, the reaction ends before: no force may count that `only_peak` does not find.
///
/// In both cases a reaction that stops is followed until the arm stands.
enum class ReactionDetail { every_step, only_peak };

/// Steps that are simulated past the peak, so that a cubic locates it between two steps.
inline constexpr int steps_past_peak = 3;

/// State of the reactions after an Adams step.
template <class T>
struct ReactionSample {
    T taken;                  ///< controller sub-steps since the last sample
    T distance, speed;        ///< along the normal [m, m/s]
    MaskOf<T> near_singular;  ///< a singularity is near
    MaskOf<T> reached;        ///< the arm has the wanted rates
};

/// Settings common to all reactions of a batch.
struct ReactionRules {
    bool only_peak, stopping;
    int substeps;    ///< per simulation step
    double substep;  ///< s
};

/// Reactions in progress, one in each lane.
template <class T>
class ReactionBatch {
  public:
    /// Factor of the tolerance once an arm retreats well behind its peak.
    static constexpr double retreat_tolerance_scale = 1e4;

    explicit ReactionBatch(const ReactionRules& rules) : rules_(rules) {}

    /// Starts a reaction in a lane. `here`: distance along the normal [m]; `stop_time`: that of the slowest joint [s].
    void begin(int lane, ReactionJob& job, double here, double stop_time) {
        const double step = rules_.substeps * rules_.substep;
        const int longest = max_reaction_steps(stop_time, job.path->s.size(), step, rules_.substeps);
        const int min_time = int(std::min((0.05 + 1.5 * stop_time) / step + 1e-9, longest - 1.0)) + 1;
        job_[lane] = &job;
        job.distance.reserve(32);
        job.step.reserve(32);
        job.distance.assign(1, here);
        job.step.assign(1, 0);
        job.met_singularity = false;
        set_lane(longest_, lane, double(longest) * rules_.substeps);
        set_lane(min_time_, lane, double(min_time) * rules_.substeps);
        set_lane(return_to_, lane, job.return_to);
        set_lane(approach_, lane, job.path->approach_speed);
        for (T* count : {&taken_, &retreating_, &steps_, &into_step_, &speed_, &lowest_}) set_lane(*count, lane, 0.0);
        for (T* distance : {&here_, &peak_}) set_lane(*distance, lane, here);
        set_lane(to_peak_, lane, std::numeric_limits<double>::infinity());
        for (MaskOf<T>* yet : {&started_, &off_path_, &reversed_, &over_, &relaxed_}) set_lane(*yet, lane, false);
        set_lane(full_accuracy_, lane, job.rebounded);
        set_lane(busy_, lane, true);
        set_lane(accept_first_peak_, lane, !job.may_rebound);
    }
    /// Leaves a lane idle.
    void stop(int lane) {
        job_[lane] = nullptr;
        set_lane(busy_, lane, false);
        set_lane(accept_first_peak_, lane, true);
    }

    bool all_done() const { return !any(busy_); }
    /// Lanes well behind their peaks, for which a wider tolerance is enough.
    MaskOf<T> relaxed() const { return relaxed_; }
    /// The job of a finished lane if it rebounded and must be simulated again at full accuracy; else null.
    ReactionJob* rebounded(int lane) const {
        return job_[lane]->rebounded && !lane_of(full_accuracy_, lane) ? job_[lane] : nullptr;
    }

    /// Longest next Adams steps, in sub-steps. The simulation steps around the peak are taken one by one.
    T max_steps() const {
        const T to_step = substeps() - into_step_;
        T longest = to_step;
        if (rules_.only_peak) {
            const T far = double(max_reaction_adams_step);
            // Up to the end of the last simulation step that lies a whole step before the peak.
            const T before_peak = (whole_steps(floor(taken_ + min(to_peak_, 2.0 * far))) - 1.0) * substeps() - taken_;
            const T forward = select(to_peak_ < 2.0 * far, max(before_peak, to_step), far);
            const T backward = select(retreating_ >= steps_past_peak * substeps(), far, to_step);
            longest = select(speed_ > T(0.0), forward, select(speed_ < T(0.0), backward, to_step));
            longest = select(relaxed_, T(double(max_retreat_adams_step)), longest);
            longest = select(over_ | (speed_ == T(0.0)), to_step, longest);
        }
        // A reaction that never reverses ends after `longest_` exactly.
        longest = min(longest, longest_ - taken_);
        // An arm that has reversed is sampled exactly when its minimum time is over.
        longest = select(reversed_ & (taken_ < min_time_), min(longest, min_time_ - taken_), longest);
        return select(busy_, longest, T(0.0));
    }

    /// Adams steps over `count` sub-steps that went past the peak: `after` is the speed at their ends. The change of
    /// speed tells where the peak is.
    MaskOf<T> rejected(const MaskOf<T>& long_steps, const T& count, const T& after) {
        if (!rules_.only_peak) return mask_of<T>(false);
        const MaskOf<T> past_peak =
            long_steps & (speed_ > T(0.0)) & (after <= T(0.0)) & (!relaxed_) & (count > substeps() - into_step_);
        to_peak_ = select(past_peak, count * speed_ / (speed_ - after), to_peak_);
        return past_peak;
    }

    /// Takes a sample: the first of a reaction shows whether the arm follows its line. Returns the finished lanes.
    MaskOf<T> update(const ReactionSample<T>& sample) {
        const MaskOf<T> moves = busy_ & started_ & (sample.taken > T(0.0)), first = busy_ & !started_;
        const MaskOf<T> off = abs(sample.speed - approach_) > following_share * approach_;
        off_path_ = off_path_ | (first & (sample.near_singular | off) & !accept_first_peak_);
        started_ = started_ | first;
        const T went = speed_ * sample.taken * rules_.substep;
        move(moves, sample);
        speed_ = select(first, sample.speed, speed_);

        MaskOf<T> restart = mask_of<T>(false);
        const MaskOf<T> whole = moves & (into_step_ == T(0.0)), retreats = retreating_ >= steps_past_peak * substeps();
        if (rules_.only_peak && !rules_.stopping) {
            // Between two samples the point may have been farther than at either, at most by what its last speed gives.
            lowest_ = select(relaxed_, min(lowest_, here_), here_);
            const MaskOf<T> nears_peak =
                here_ + max(went, T(0.0)) > peak_ - max(rebound_share * (peak_ - lowest_), T(rebound_distance));
            restart = moves & relaxed_ & nears_peak;
            note(restart, &ReactionJob::rebounded);
            const MaskOf<T> far = peak_ - here_ > T(rebound_distance);
            relaxed_ = relaxed_ | (moves & retreats & far & !full_accuracy_);
        }
        MaskOf<T> exceeds_peak = mask_of<T>(false);
        if (!rules_.only_peak && !rules_.stopping)
            exceeds_peak = whole & reversed_ & (here_ > peak_) & ((!off_path_) | (taken_ > min_time_));
        peak_ = max(peak_, here_);
        write(whole & !(relaxed_ | exceeds_peak));
        off_path_ = off_path_ | (moves & sample.near_singular & !accept_first_peak_);
        note(busy_ & sample.near_singular & !accept_first_peak_, &ReactionJob::met_singularity);
        reversed_ = reversed_ | (moves & retreats);
        if (rules_.stopping) {
            over_ = over_ | (moves & sample.reached);
        } else {
            const MaskOf<T> long_enough = !(off_path_ & (taken_ < min_time_));
            over_ = over_ | (moves & long_enough & (rules_.only_peak ? reversed_ : retreats & (here_ <= return_to_)));
        }
        return restart | (whole & over_) | exceeds_peak | (moves & (taken_ >= longest_));
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;
    static constexpr int max_retreat_adams_step = 1024;  ///< sub-steps
    /// An arm follows its line where the speed of its point differs by no more than this share.
    static constexpr double following_share = 0.1;
    /// A retreating point rebounds where it is within this share of its retreat, or this distance [m], of its peak.
    static constexpr double rebound_share = 0.1, rebound_distance = 1e-5;

    T substeps() const { return double(rules_.substeps); }
    /// Whole simulation steps in `count` sub-steps.
    T whole_steps(const T& count) const { return floor((count + 0.5) * (1.0 / rules_.substeps)); }

    void move(const MaskOf<T>& moves, const ReactionSample<T>& sample) {
        const T taken = select(moves, sample.taken, T(0.0)), into = into_step_ + taken, whole = whole_steps(into);
        taken_ += taken;
        steps_ += whole;
        into_step_ = into - whole * substeps();
        const T slowed = speed_ - sample.speed;
        const T to_peak =
            select(slowed > T(0.0), taken * sample.speed / slowed, T(std::numeric_limits<double>::infinity()));
        to_peak_ = select(moves, to_peak, to_peak_);
        speed_ = select(moves, sample.speed, speed_);
        retreating_ = select(moves, select(sample.distance < here_, retreating_ + taken, T(0.0)), retreating_);
        here_ = select(moves, sample.distance, here_);
    }

    void note(const MaskOf<T>& where, bool ReactionJob::*what) {
        if (!any(where)) return;
        for (int lane = 0; lane < lanes; ++lane)
            if (lane_of(where, lane)) job_[lane]->*what = true;
    }

    void write(const MaskOf<T>& where) {
        if (!any(where)) return;
        for (int lane = 0; lane < lanes; ++lane) {
            if (!lane_of(where, lane)) continue;
            job_[lane]->distance.push_back(lane_of(here_, lane));
            job_[lane]->step.push_back(int(lane_of(steps_, lane)));
        }
    }

    const ReactionRules rules_;
    ReactionJob* job_[lanes] = {};     ///< null: the lane is idle
    T min_time_ = 0.0;                 ///< sub-steps after which the retreat of an arm off its path is accepted
    T longest_ = 0.0;                  ///< sub-steps after which the reaction is ended in any case
    T return_to_ = 0.0;                ///< as in the job [m]
    T approach_ = 0.0;                 ///< approach speed of the line [m/s]
    T taken_ = 0.0;                    ///< sub-steps since the beginning
    T retreating_ = 0.0;               ///< sub-steps since the point began to retreat
    T steps_ = 0.0, into_step_ = 0.0;  ///< whole simulation steps so far, and sub-steps since the last
    T here_ = 0.0;                     ///< distance along the normal [m]
    T speed_ = 0.0;                    ///< along the normal [m/s]
    T to_peak_ = 0.0;                  ///< sub-steps to the peak, estimated from the deceleration
    T peak_ = 0.0, lowest_ = 0.0;      ///< greatest distance so far, and smallest since it [m]
    MaskOf<T> busy_ = mask_of<T>(false);
    MaskOf<T> started_ = mask_of<T>(false);   ///< the first sample has been taken
    MaskOf<T> off_path_ = mask_of<T>(false);  ///< a singularity was near, or the arm did not follow its line at first
    MaskOf<T> accept_first_peak_ = mask_of<T>(false);  ///< the reaction ends with the first retreat, whatever is near
    MaskOf<T> reversed_ = mask_of<T>(false);           ///< the point has retreated
    MaskOf<T> over_ = mask_of<T>(false);               ///< the reaction ends with this step
    MaskOf<T> relaxed_ = mask_of<T>(false);        ///< well behind the peak: integrated loosely to rule out a rebound
    MaskOf<T> full_accuracy_ = mask_of<T>(false);  ///< a rebound was possible: integrated accurately throughout
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
