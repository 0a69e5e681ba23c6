/// @file
/// One reaction while it is simulated: how far the point has got, and when it may be believed that it gets no farther.
#pragma once

#include <limits>
#include <vector>

#include "bumpstop/collision/braking_arm.hpp"
#include "bumpstop/collision/line_path.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

enum class ReactionKind { stop, reverse };

/// One reaction to simulate: that of `tick` on `path`. distance[i] is the distance along the normal step[i] simulation
/// steps into the reaction; step[0] is 0, where it begins.
struct ReactionJob {
    const LinePath* path;
    int curve;                                                ///< number of the curve that the path belongs to
    int tick;                                                 ///< that it reacts to
    std::vector<double> distance;                             ///< result [m]
    std::vector<int> step;                                    ///< result
    double leap_tolerance = braking_leap_tolerance;           ///< as of BrakingArm::begin
    double enough = std::numeric_limits<double>::infinity();  ///< nothing is asked beyond this distance [m]
    const double* q = nullptr;  ///< joint positions the path started in: held joints keep theirs
    double return_to = 0;       ///< distance [m] behind which a point that reverses is back
    bool comes_back = true;     ///< else the first retreat is believed, whatever is near
    bool came_back = false;     ///< result: on its way home the point came near its farthest again
};

/// What of a reaction is wanted. `only_peak`: steps far from a farthest point may be missing, and a reaction that reverses
/// ends once the point retreats for good: on the way back nothing brings it forward again unless a singularity was near, or
/// the arm did not follow its line and swings on. Such an arm is followed until half again the time has passed that the
/// slowest joint needs to stop, and 50 ms more: the source's own length of a run after detection; and to its first retreat,
/// if that is later. `every_step`: all steps; one that reverses is followed for as long, and until the point is back behind
/// `return_to`. If after that time it gets farther than ever before instead, it ends before that: no force counts that
/// `only_peak` does not know. A reaction that stops is followed until it has.
enum class ReactionDetail { every_step, only_peak };

/// Steps after which a reaction is left where it is: an arm that cannot reverse near a singularity must not run for ever.
/// Any other is done long before. Its slowest joint stands after `stop_time` [s] and has reversed after twice that; it then
/// goes back no farther than it came on its way of `path_steps`. `substeps` keeps controller sub-steps countable.
inline int longest_reaction(double stop_time, std::size_t path_steps, double step, int substeps) {
    const double needed = std::min(4 * stop_time / step, 2e6) + 2 * double(path_steps);
    return int(std::min(std::max(needed, 20000.0), 2e9 / substeps));
}
/// The steps about the farthest point tell where between two steps it lies.
inline constexpr int steps_past_peak = 3;

/// What becomes of a reaction after a look at it.
enum class ReactionFate {
    goes_on,
    homes,  ///< from here on it may be followed loosely
    anew,   ///< it must be followed once more from its beginning, with care
    done,
};

/// Where a look finds the arm, `gone` controller sub-steps after the last one.
struct ReactionLook {
    int gone;
    double distance, speed;  ///< along the normal [m, m/s]
    bool poor;               ///< a singularity is near
    bool reached;            ///< the arm has the rates asked for
};

/// What is the same for all reactions that are simulated together.
struct ReactionRules {
    bool only_peak, stopping;
    int substeps;    ///< in a simulation step
    double substep;  ///< s
};

/// One reaction on its way in a lane.
class RunningReaction {
  public:
    /// An arm on its way home is followed so many times less exactly.
    static constexpr double homing_slack = 1e3;

    RunningReaction() = default;
    /// `here`: distance along the normal [m]; `stop_time`: what the slowest joint needs to stop [s].
    RunningReaction(const ReactionRules& rules, ReactionJob& job, double here, double stop_time) : job_(&job) {
        const double step = rules.substeps * rules.substep;
        const int longest = longest_reaction(stop_time, job.path->s.size(), step, rules.substeps);
        longest_ = longest * rules.substeps;
        patience_ = (int(std::min((0.05 + 1.5 * stop_time) / step + 1e-9, longest - 1.0)) + 1) * rules.substeps;
        here_ = peak_ = here;
        job.distance.assign(1, here);
        job.step.assign(1, 0);
    }

    bool idle() const { return job_ == nullptr; }
    ReactionJob& job() const { return *job_; }
    /// It has come back once, and is followed well all the way now.
    void take_care() { careful_ = job_->came_back = true; }

    /// How far the next leap may go, in sub-steps. The steps about the farthest point are gone one by one.
    int longest_leap(const ReactionRules& rules) const {
        const int longest = longest_leap_by_speed(rules);
        // The time of an arm that has turned ends with a look.
        return turned_ && gone_ < patience_ ? std::min(longest, patience_ - gone_) : longest;
    }

    /// False where a leap over `count` sub-steps, after which the speed is `after`, went over the top: the speeds at its
    /// ends say where that was.
    bool accepts(const ReactionRules& rules, int count, double after) {
        if (!(speed_ > 0 && after <= 0) || !rules.only_peak || homing_ || count <= to_step(rules)) return true;
        top_ = count * speed_ / (speed_ - after);
        return false;
    }

    /// The first look tells whether the arm follows its line; any other one is written into the job.
    ReactionFate take(const ReactionRules& rules, const ReactionLook& look) {
        if (!started_) {
            started_ = true;
            speed_ = look.speed;
            const double wanted = job_->path->approach_speed;
            astray_ = look.poor || std::fabs(speed_ - wanted) > following_share * wanted;
            return ReactionFate::goes_on;
        }
        if (look.gone == 0) return ReactionFate::goes_on;
        const double before = speed_;
        move(rules, look);
        if (homing_ && nears_peak(before * look.gone * rules.substep)) return ReactionFate::anew;
        const bool whole = into_step_ == 0;
        const bool leaves =
            whole && !rules.only_peak && !rules.stopping && turned_ && here_ > peak_ && (!astray_ || gone_ > patience_);
        peak_ = std::max(peak_, here_);
        if (whole && !homing_ && !leaves) {
            job_->distance.push_back(here_);
            job_->step.push_back(steps_);
        }
        astray_ = job_->comes_back && (astray_ || look.poor);
        const bool in_time = astray_ && gone_ < patience_;
        const bool back = !in_time && (rules.only_peak || here_ <= job_->return_to);
        const bool retreats = retreating_ >= steps_past_peak * rules.substeps;
        turned_ = turned_ || retreats;
        over_ = over_ || (rules.stopping ? look.reached : (rules.only_peak ? turned_ : retreats) && back);
        const bool ends = whole && (over_ || here_ > job_->enough);
        if (ends || leaves || gone_ >= longest_) return ReactionFate::done;
        if (!rules.only_peak || rules.stopping || !retreats || over_ || careful_ || homing_ ||
            peak_ - here_ <= homing_distance)
            return ReactionFate::goes_on;
        homing_ = true;
        lowest_ = here_;
        return ReactionFate::homes;
    }

  private:
    /// An arm follows its line where the point's speed is off by no more than this share of it.
    static constexpr double following_share = 0.1;
    /// An arm on its way home comes back where it is within this share of its retreat, or this distance, of its peak.
    static constexpr double homing_share = 0.1, homing_distance = 1e-5;

    int to_step(const ReactionRules& rules) const { return rules.substeps - into_step_; }

    int longest_leap_by_speed(const ReactionRules& rules) const {
        if (!rules.only_peak || speed_ == 0 || over_) return to_step(rules);
        if (homing_ || (speed_ < 0 && retreating_ >= steps_past_peak * rules.substeps)) return longest_braking_leap;
        if (speed_ < 0) return to_step(rules);
        if (!(top_ < 2 * longest_braking_leap)) return longest_braking_leap;
        // The last step that ends a whole step before the top.
        const int landing = (int(gone_ + top_) / rules.substeps - 1) * rules.substeps - gone_;
        return std::max(landing, to_step(rules));
    }

    void move(const ReactionRules& rules, const ReactionLook& look) {
        gone_ += look.gone;
        into_step_ += look.gone;
        steps_ += into_step_ / rules.substeps;
        into_step_ %= rules.substeps;
        const double before = speed_;
        speed_ = look.speed;
        top_ = speed_ < before ? look.gone * speed_ / (before - speed_) : std::numeric_limits<double>::infinity();
        retreating_ = look.distance < here_ ? retreating_ + look.gone : 0;
        here_ = look.distance;
    }

    /// Between two looks the point may have been farther than at either, by what it went at its speed before.
    bool nears_peak(double went) {
        lowest_ = std::min(lowest_, here_);
        return here_ + std::max(0.0, went) > peak_ - std::max(homing_share * (peak_ - lowest_), homing_distance);
    }

    ReactionJob* job_ = nullptr;     ///< null: the lane is idle
    int patience_ = 0;               ///< controller sub-steps after which the retreat of an arm astray is believed
    int longest_ = 0;                ///< controller sub-steps after which it is left where it is
    int gone_ = 0, retreating_ = 0;  ///< controller sub-steps since the beginning, and since the point began to retreat
    int steps_ = 0, into_step_ = 0;  ///< the same in whole simulation steps, and controller sub-steps since the last
    double here_ = 0;                ///< distance along the normal [m]
    double speed_ = 0;               ///< along the normal [m/s]
    double top_ = std::numeric_limits<double>::infinity();  ///< sub-steps to the farthest point, as far as one can tell
    double peak_ = 0, lowest_ = 0;                          ///< the farthest so far, and the nearest since [m]
    bool started_ = false;                                  ///< the first look has been taken
    bool astray_ = false;   ///< a singularity was near, or the arm did not follow its line when it began
    bool turned_ = false;   ///< it has retreated
    bool over_ = false;     ///< it ends with this step
    bool homing_ = false;   ///< well behind its peak: followed loosely, only to see that it does not come back to it
    bool careful_ = false;  ///< it may, and is followed well all the way
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
