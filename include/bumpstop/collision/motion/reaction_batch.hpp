/// @file
/// Reactions while they are simulated: how far the points have got, and when it may be taken as certain that they get no
/// farther.
#pragma once

#include "bumpstop/collision/motion/reaction_job.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The steps about the farthest point tell where between two steps it lies.
inline constexpr int steps_past_peak = 3;

/// Where a look finds the arms, `taken` controller sub-steps after the last one.
template <class T>
struct ReactionSample {
    T taken;
    T distance, speed;        ///< along the normal [m, m/s]
    MaskOf<T> near_singular;  ///< a singularity is near
    MaskOf<T> reached;        ///< the arm has the rates asked for
};

/// What is the same for all reactions that are simulated together.
struct ReactionRules {
    bool only_peak, stopping;
    int substeps;    ///< in a simulation step
    double substep;  ///< s
};

/// Reactions on their way, one in each lane.
template <class T>
class ReactionBatch {
  public:
    /// The tolerance of a retreat is this many times wider.
    static constexpr double retreat_tolerance_scale = 1e4;

    explicit ReactionBatch(const ReactionRules& rules) : rules_(rules) {}

    /// A lane takes a reaction. `here`: distance along the normal [m]; `stop_time`: what the slowest joint needs to
    /// stop [s].
    void begin(int lane, ReactionJob& job, double here, double stop_time) {
        const double step = rules_.substeps * rules_.substep;
        const int longest = max_reaction_steps(stop_time, job.path->s.size(), step, rules_.substeps);
        const int min_time = int(std::min((0.05 + 1.5 * stop_time) / step + 1e-9, longest - 1.0)) + 1;
        job_[lane] = &job;
        job.distance.assign(1, here);
        job.step.assign(1, 0);
        job.met_singularity = false;
        set_lane(longest_, lane, double(longest) * rules_.substeps);
        set_lane(min_time_, lane, double(min_time) * rules_.substeps);
        set_lane(max_distance_, lane, job.enough);
        set_lane(return_to_, lane, job.return_to);
        set_lane(approach_, lane, job.path->approach_speed);
        for (T* count : {&taken_, &retreating_, &steps_, &into_step_, &speed_, &lowest_}) set_lane(*count, lane, 0.0);
        for (T* distance : {&here_, &peak_}) set_lane(*distance, lane, here);
        set_lane(top_, lane, std::numeric_limits<double>::infinity());
        for (MaskOf<T>* yet : {&started_, &off_path_, &reversed_, &over_, &relaxed_}) set_lane(*yet, lane, false);
        set_lane(full_accuracy_, lane, job.rebounded);
        set_lane(busy_, lane, true);
        set_lane(accept_first_peak_, lane, !job.may_rebound);
    }
    /// A lane has no reaction any more.
    void stop(int lane) {
        job_[lane] = nullptr;
        set_lane(busy_, lane, false);
        set_lane(accept_first_peak_, lane, true);
    }

    bool all_done() const { return !any(busy_); }
    /// Well behind their peaks: these may be followed loosely.
    MaskOf<T> relaxed() const { return relaxed_; }
    /// The job of a lane that is done if it is to be followed once more, well all the way: its point came back. Else null.
    ReactionJob* rebounded(int lane) const {
        return job_[lane]->rebounded && !lane_of(full_accuracy_, lane) ? job_[lane] : nullptr;
    }

    /// How far the next Adams steps may go, in sub-steps. The steps about the farthest point are gone one by one.
    T max_steps() const {
        const T to_step = substeps() - into_step_;
        T longest = to_step;
        if (rules_.only_peak) {
            const T far = double(max_reaction_adams_step);
            // The last step that ends a whole step before the top.
            const T landing = (whole_steps(floor(taken_ + min(top_, 2.0 * far))) - 1.0) * substeps() - taken_;
            const T forward = select(top_ < 2.0 * far, max(landing, to_step), far);
            const T backward = select(retreating_ >= steps_past_peak * substeps(), far, to_step);
            longest = select(speed_ > T(0.0), forward, select(speed_ < T(0.0), backward, to_step));
            longest = select(relaxed_, T(double(max_retreat_leap)), longest);
            longest = select(over_ | (speed_ == T(0.0)), to_step, longest);
        }
        // One that never turns back is where its last step ends.
        longest = min(longest, longest_ - taken_);
        // The time of an arm that has turned ends with a sample.
        longest = select(reversed_ & (taken_ < min_time_), min(longest, min_time_ - taken_), longest);
        return select(busy_, longest, T(0.0));
    }

    /// Where Adams steps over `count` sub-steps, after which the speeds are `after`, went over the top: the speeds at
    /// their ends say where that was.
    MaskOf<T> rejected(const MaskOf<T>& long_steps, const T& count, const T& after) {
        if (!rules_.only_peak) return none();
        const MaskOf<T> over_top =
            long_steps & (speed_ > T(0.0)) & (after <= T(0.0)) & (!relaxed_) & (count > substeps() - into_step_);
        top_ = select(over_top, count * speed_ / (speed_ - after), top_);
        return over_top;
    }

    /// First looks tell whether arms follow their lines; any other one is written into its job. Returns which are done.
    MaskOf<T> update(const ReactionSample<T>& sample) {
        const MaskOf<T> moves = busy_ & started_ & (sample.taken > T(0.0)), first = busy_ & !started_;
        const MaskOf<T> off = abs(sample.speed - approach_) > following_share * approach_;
        off_path_ = off_path_ | (first & (sample.near_singular | off) & !accept_first_peak_);
        started_ = started_ | first;
        const T went = speed_ * sample.taken * rules_.substep;
        move(moves, sample);
        speed_ = select(first, sample.speed, speed_);

        MaskOf<T> restart = none();
        const MaskOf<T> whole = moves & (into_step_ == T(0.0)), retreats = retreating_ >= steps_past_peak * substeps();
        if (rules_.only_peak && !rules_.stopping) {
            // Between two looks the point may have been farther than at either, by what it went at its speed before.
            lowest_ = select(relaxed_, min(lowest_, here_), here_);
            const MaskOf<T> nears_peak =
                here_ + max(went, T(0.0)) > peak_ - max(rebound_share * (peak_ - lowest_), T(rebound_distance));
            restart = moves & relaxed_ & nears_peak;
            note(restart, &ReactionJob::rebounded);
            const MaskOf<T> far = peak_ - here_ > T(rebound_distance);
            relaxed_ = relaxed_ | (moves & retreats & far & !full_accuracy_);
        }
        MaskOf<T> leaves = none();
        if (!rules_.only_peak && !rules_.stopping)
            leaves = whole & reversed_ & (here_ > peak_) & ((!off_path_) | (taken_ > min_time_));
        peak_ = max(peak_, here_);
        write(whole & !(relaxed_ | leaves));
        off_path_ = off_path_ | (moves & sample.near_singular & !accept_first_peak_);
        note(busy_ & sample.near_singular & !accept_first_peak_, &ReactionJob::met_singularity);
        reversed_ = reversed_ | (moves & retreats);
        if (rules_.stopping) {
            over_ = over_ | (moves & sample.reached);
        } else {
            const MaskOf<T> out_of_time = !(off_path_ & (taken_ < min_time_));
            over_ = over_ | (moves & out_of_time & (rules_.only_peak ? reversed_ : retreats & (here_ <= return_to_)));
        }
        return restart | (whole & (over_ | (here_ > max_distance_))) | leaves | (moves & (taken_ >= longest_));
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;
    static constexpr int max_retreat_leap = 1024;  ///< sub-steps
    /// An arm follows its line where the point's speed is off by no more than this share of it.
    static constexpr double following_share = 0.1;
    /// A retreating arm comes back where it is within this share of its retreat, or this distance, of its peak.
    static constexpr double rebound_share = 0.1, rebound_distance = 1e-5;

    static MaskOf<T> none() { return T(0.0) > T(1.0); }
    T substeps() const { return double(rules_.substeps); }
    /// In so many sub-steps, a whole number.
    T whole_steps(const T& count) const { return floor((count + 0.5) * (1.0 / rules_.substeps)); }

    void move(const MaskOf<T>& moves, const ReactionSample<T>& sample) {
        const T taken = select(moves, sample.taken, T(0.0)), into = into_step_ + taken, whole = whole_steps(into);
        taken_ += taken;
        steps_ += whole;
        into_step_ = into - whole * substeps();
        const T slowed = speed_ - sample.speed;
        const T top =
            select(slowed > T(0.0), taken * sample.speed / slowed, T(std::numeric_limits<double>::infinity()));
        top_ = select(moves, top, top_);
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
    ReactionJob* job_[lanes] = {};  ///< null: the lane is idle
    T min_time_ = 0.0;              ///< controller sub-steps after which the retreat of an arm off its path is accepted
    T longest_ = 0.0;               ///< controller sub-steps after which it is left where it is
    T max_distance_ = 0.0, return_to_ = 0.0;  ///< as of the job [m]
    T approach_ = 0.0;                        ///< speed of the line [m/s]
    T taken_ = 0.0;                           ///< controller sub-steps since the beginning
    T retreating_ = 0.0;                      ///< and since the point began to retreat
    T steps_ = 0.0, into_step_ = 0.0;         ///< the former in whole steps, and sub-steps since the last
    T here_ = 0.0;                            ///< distance along the normal [m]
    T speed_ = 0.0;                           ///< along the normal [m/s]
    T top_ = 0.0;                             ///< sub-steps to the farthest point, as far as one can tell
    T peak_ = 0.0, lowest_ = 0.0;             ///< the farthest so far, and the nearest of its retreat [m]
    MaskOf<T> busy_ = none();
    MaskOf<T> started_ = none();   ///< the first look has been taken
    MaskOf<T> off_path_ = none();  ///< a singularity was near, or the arm did not follow its line when it began
    MaskOf<T> accept_first_peak_ = none();  ///< its first retreat is, whatever is near
    MaskOf<T> reversed_ = none();           ///< it has retreated
    MaskOf<T> over_ = none();               ///< it ends with this step
    MaskOf<T> relaxed_ = none();        ///< well behind its peak: followed loosely, to see that it does not come back
    MaskOf<T> full_accuracy_ = none();  ///< it may, and is followed well all the way
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
