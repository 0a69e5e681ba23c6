/// @file
/// Reactions while they are simulated: how far the points have got, and when it may be believed that they get no farther.
#pragma once

#include "bumpstop/collision/reaction_job.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The steps about the farthest point tell where between two steps it lies.
inline constexpr int steps_past_peak = 3;

/// Where a look finds the arms, `gone` controller sub-steps after the last one.
template <class T>
struct ReactionLook {
    T gone;
    T distance, speed;        ///< along the normal [m, m/s]
    MaskOf<T> near_singular;  ///< a singularity is near
    MaskOf<T> reached;        ///< the arm has the rates asked for
};

/// What becomes of reactions after a look at them; the others go on.
template <class T>
struct ReactionFates {
    MaskOf<T> home;   ///< from here on they may be followed loosely
    MaskOf<T> again;  ///< they must be followed once more from where they turned home, with care
    MaskOf<T> done;
};

/// What is the same for all reactions that are simulated together.
struct ReactionRules {
    bool only_peak, stopping;
    int substeps;    ///< in a simulation step
    double substep;  ///< s
};

/// Reactions on their way, one in each lane.
template <class T>
class RunningReactions {
  public:
    /// An arm on its way home is followed so many times less exactly.
    static constexpr double homing_slack = 1e4;

    explicit RunningReactions(const ReactionRules& rules) : rules_(rules) {}

    /// A lane takes a reaction. `here`: distance along the normal [m]; `stop_time`: what the slowest joint needs to stop [s].
    void begin(int lane, ReactionJob& job, double here, double stop_time) {
        const double step = rules_.substeps * rules_.substep;
        const int longest = longest_reaction(stop_time, job.path->s.size(), step, rules_.substeps);
        const int patience = int(std::min((0.05 + 1.5 * stop_time) / step + 1e-9, longest - 1.0)) + 1;
        job_[lane] = &job;
        job.distance.assign(1, here);
        job.step.assign(1, 0);
        job.came_back = job.met_singularity = false;
        set_lane(longest_, lane, double(longest) * rules_.substeps);
        set_lane(patience_, lane, double(patience) * rules_.substeps);
        set_lane(enough_, lane, job.enough);
        set_lane(return_to_, lane, job.return_to);
        set_lane(approach_, lane, job.path->approach_speed);
        for (T* count : {&gone_, &retreating_, &steps_, &into_step_, &speed_, &lowest_}) set_lane(*count, lane, 0.0);
        for (T* distance : {&here_, &peak_}) set_lane(*distance, lane, here);
        set_lane(top_, lane, std::numeric_limits<double>::infinity());
        for (MaskOf<T>* yet : {&started_, &astray_, &turned_, &over_, &homing_, &careful_}) set_lane(*yet, lane, false);
        set_lane(busy_, lane, true);
        set_lane(believed_, lane, !job.comes_back);
    }
    /// A lane has no reaction any more.
    void stop(int lane) {
        job_[lane] = nullptr;
        set_lane(busy_, lane, false);
        set_lane(believed_, lane, true);
    }

    /// These lanes become what they are in another object, which has the same jobs there.
    void take(const MaskOf<T>& lanes, const RunningReactions& other) {
        for (T RunningReactions::*value :
             {&RunningReactions::gone_, &RunningReactions::retreating_, &RunningReactions::steps_,
              &RunningReactions::into_step_, &RunningReactions::here_, &RunningReactions::speed_,
              &RunningReactions::top_, &RunningReactions::peak_, &RunningReactions::lowest_})
            this->*value = select(lanes, other.*value, this->*value);
        for (MaskOf<T> RunningReactions::*value : {&RunningReactions::astray_, &RunningReactions::turned_,
                                                   &RunningReactions::over_, &RunningReactions::homing_})
            this->*value = select(lanes, other.*value, this->*value);
    }
    /// These lanes are followed well all the way now.
    void take_care(const MaskOf<T>& again) {
        careful_ = careful_ | again;
        homing_ = homing_ & !again;
        for (int lane = 0; lane < lanes; ++lane)
            if (lane_of(again, lane)) job_[lane]->came_back = true;
    }

    bool all_done() const { return !any(busy_); }

    /// How far next leaps may go, in sub-steps. The steps about the farthest point are gone one by one.
    T longest_leaps() const {
        const T to_step = substeps() - into_step_;
        T longest = to_step;
        if (rules_.only_peak) {
            const T far = double(longest_braking_leap);
            // The last step that ends a whole step before the top.
            const T landing = (whole_steps(whole_part(gone_ + minimum(top_, 2.0 * far))) - 1.0) * substeps() - gone_;
            const T forward = select(top_ < 2.0 * far, maximum(landing, to_step), far);
            const T backward = select(retreating_ >= steps_past_peak * substeps(), far, to_step);
            longest = select(speed_ > T(0.0), forward, select(speed_ < T(0.0), backward, to_step));
            longest = select(homing_, T(double(longest_homing_leap)), longest);
            longest = select(over_ | (speed_ == T(0.0)), to_step, longest);
        }
        // One that never turns back is where its last step ends.
        longest = minimum(longest, longest_ - gone_);
        // The time of an arm that has turned ends with a look.
        longest = select(turned_ & (gone_ < patience_), minimum(longest, patience_ - gone_), longest);
        return select(busy_, longest, T(0.0));
    }

    /// Where leaps over `count` sub-steps, after which the speeds are `after`, went over the top: the speeds at their ends say
    /// where that was.
    MaskOf<T> refused(const MaskOf<T>& leaps, const T& count, const T& after) {
        if (!rules_.only_peak) return none();
        const MaskOf<T> over_top =
            leaps & (speed_ > T(0.0)) & (after <= T(0.0)) & (!homing_) & (count > substeps() - into_step_);
        top_ = select(over_top, count * speed_ / (speed_ - after), top_);
        return over_top;
    }

    /// First looks tell whether arms follow their lines; any other one is written into its job.
    ReactionFates<T> take(const ReactionLook<T>& look) {
        const MaskOf<T> moves = busy_ & started_ & (look.gone > T(0.0)), first = busy_ & !started_;
        const MaskOf<T> off = absolute(look.speed - approach_) > following_share * approach_;
        astray_ = astray_ | (first & (look.near_singular | off) & !believed_);
        started_ = started_ | first;
        const T went = speed_ * look.gone * rules_.substep;
        move(moves, look);
        speed_ = select(first, look.speed, speed_);

        lowest_ = minimum(lowest_, here_);
        // Between two looks the point may have been farther than at either, by what it went at its speed before.
        const MaskOf<T> nears_peak =
            here_ + maximum(went, T(0.0)) > peak_ - maximum(homing_share * (peak_ - lowest_), T(homing_distance));
        ReactionFates<T> fates;
        fates.again = moves & homing_ & nears_peak;
        const MaskOf<T> goes = moves & !fates.again, whole = goes & (into_step_ == T(0.0));
        MaskOf<T> leaves = none();
        if (!rules_.only_peak && !rules_.stopping)
            leaves = whole & turned_ & (here_ > peak_) & ((!astray_) | (gone_ > patience_));
        peak_ = maximum(peak_, here_);
        write(whole & !(homing_ | leaves));
        astray_ = astray_ | (goes & look.near_singular & !believed_);
        note_singularities(busy_ & look.near_singular & !believed_);
        const MaskOf<T> retreats = retreating_ >= steps_past_peak * substeps();
        turned_ = turned_ | (goes & retreats);
        if (rules_.stopping) {
            over_ = over_ | (goes & look.reached);
        } else {
            const MaskOf<T> out_of_time = !(astray_ & (gone_ < patience_));
            over_ = over_ | (goes & out_of_time & (rules_.only_peak ? turned_ : retreats & (here_ <= return_to_)));
        }
        fates.done = (whole & (over_ | (here_ > enough_))) | leaves | (goes & (gone_ >= longest_));
        fates.home = none();
        if (rules_.only_peak && !rules_.stopping) {
            const MaskOf<T> far = peak_ - here_ > T(homing_distance);
            fates.home = goes & retreats & far & !(fates.done | over_ | careful_ | homing_);
            homing_ = homing_ | fates.home;
            lowest_ = select(fates.home, here_, lowest_);
        }
        return fates;
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;
    static constexpr int longest_homing_leap = 1024;  ///< sub-steps
    /// An arm follows its line where the point's speed is off by no more than this share of it.
    static constexpr double following_share = 0.1;
    /// An arm on its way home comes back where it is within this share of its retreat, or this distance, of its peak.
    static constexpr double homing_share = 0.1, homing_distance = 1e-5;

    static MaskOf<T> none() { return T(0.0) > T(1.0); }
    T substeps() const { return double(rules_.substeps); }
    /// In so many sub-steps, a whole number.
    T whole_steps(const T& count) const { return whole_part((count + 0.5) * (1.0 / rules_.substeps)); }

    void move(const MaskOf<T>& moves, const ReactionLook<T>& look) {
        const T gone = select(moves, look.gone, T(0.0)), into = into_step_ + gone, whole = whole_steps(into);
        gone_ += gone;
        steps_ += whole;
        into_step_ = into - whole * substeps();
        const T slowed = speed_ - look.speed;
        const T top = select(slowed > T(0.0), gone * look.speed / slowed, T(std::numeric_limits<double>::infinity()));
        top_ = select(moves, top, top_);
        speed_ = select(moves, look.speed, speed_);
        retreating_ = select(moves, select(look.distance < here_, retreating_ + gone, T(0.0)), retreating_);
        here_ = select(moves, look.distance, here_);
    }

    void note_singularities(const MaskOf<T>& where) {
        if (!any(where)) return;
        for (int lane = 0; lane < lanes; ++lane)
            if (lane_of(where, lane)) job_[lane]->met_singularity = true;
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
    ReactionJob* job_[lanes] = {};      ///< null: the lane is idle
    T patience_ = 0.0;                  ///< controller sub-steps after which the retreat of an arm astray is believed
    T longest_ = 0.0;                   ///< controller sub-steps after which it is left where it is
    T enough_ = 0.0, return_to_ = 0.0;  ///< as of the job [m]
    T approach_ = 0.0;                  ///< speed of the line [m/s]
    T gone_ = 0.0;                      ///< controller sub-steps since the beginning
    T retreating_ = 0.0;                ///< and since the point began to retreat
    T steps_ = 0.0, into_step_ = 0.0;   ///< the former in whole steps, and sub-steps since the last
    T here_ = 0.0;                      ///< distance along the normal [m]
    T speed_ = 0.0;                     ///< along the normal [m/s]
    T top_ = 0.0;                       ///< sub-steps to the farthest point, as far as one can tell
    T peak_ = 0.0, lowest_ = 0.0;       ///< the farthest so far, and the nearest since it goes home [m]
    MaskOf<T> busy_ = none();
    MaskOf<T> started_ = none();   ///< the first look has been taken
    MaskOf<T> astray_ = none();    ///< a singularity was near, or the arm did not follow its line when it began
    MaskOf<T> believed_ = none();  ///< its first retreat is, whatever is near
    MaskOf<T> turned_ = none();    ///< it has retreated
    MaskOf<T> over_ = none();      ///< it ends with this step
    MaskOf<T> homing_ = none();    ///< well behind its peak: followed loosely, to see that it does not come back
    MaskOf<T> careful_ = none();   ///< it may, and is followed well all the way
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
