/// @file
/// Motions given as joint trajectories, along whose path a reaction slows down. Contact may begin at any time.
#pragma once

#include <utility>

#include "bumpstop/collision/contact/contact_paths.hpp"
#include "bumpstop/collision/contact/elastic_arm.hpp"
#include "bumpstop/collision/distribution/survival_criterion.hpp"
#include "bumpstop/collision/trajectory/path_reaction.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Everything about a trajectory that does not depend on when contact begins: points, levers and reactions.
class ArmTrajectory {
  public:
    /// The motion and its duration are those of the spline, not of the line in `setup`.
    ArmTrajectory(const CollisionSetup& setup, JointSpline spline) : setup_(setup), spline_(std::move(spline)) {
        steps_ = std::max(1, int(std::ceil(spline_.duration() / step() - 1e-9)));
        ticks_ = (steps_ - 1) / setup_.timing.period + 1;
        setup_.timing.steps = steps_;
        setup_.timing.from_rest = false;
        setup_.motion.free_count = dof();  // every joint follows the spline
        for (int j = 0; j < dof(); ++j) setup_.motion.free_joint[j] = j;
        ArmState<double> state;
        Posture<double> posture;
        double second[max_joints], stop_time = 0;
        for (int i = 0; i <= steps_; ++i) {
            allow_interruption();
            pose(i * step(), state, second, posture);
            for (int j = 0; j < dof(); ++j)
                stop_time = std::max(stop_time, std::fabs(state.qd[j]) / setup_.motion.acceleration_limit[j]);
            point_.push_back(posture.position(setup_.contact.point));
            if (i < 1 || (i - 1) % setup_.timing.period != 0) continue;
            for (int j = 0; j < setup_.chain.dof; ++j) {
                lever_.push_back(j > setup_.contact.point.link
                                     ? Point3<double>{0, 0, 0}
                                     : linear_column(setup_.chain, posture, point_.back(), j));
            }
        }
        const Deceleration& deceleration = setup_.motion.deceleration;
        stop_time = std::max(stop_time, deceleration.time_to_stop(stop_time));
        for (double time : deceleration.times.time) stop_time = std::max(stop_time, 2 * time);
        longest_ = max_reaction_steps(stop_time, point_.size(), step(), setup_.motion.substeps);
        for (int k = 0; k < ticks_; ++k) reaction_.push_back(react(k));
    }

    int dof() const { return setup_.chain.dof; }
    int steps() const { return steps_; }
    int ticks() const { return ticks_; }
    double step() const { return setup_.motion.step; }
    double acceleration_overload() const { return acceleration_overload_; }
    const CollisionSetup& setup() const { return setup_; }
    const PathReaction& reaction(int tick) const { return reaction_[std::size_t(tick)]; }
    int first_step(int tick) const { return tick * setup_.timing.period + 1; }

    /// Contact point at the place u of the path [s].
    Point3<double> point_at(double u) const {
        ArmState<double> state;
        Posture<double> posture;
        double second[max_joints];
        pose(u, state, second, posture);
        return posture.position(setup_.contact.point);
    }

    /// The same, interpolated between the steps by a cubic: within 1e-8 m where the acceleration does not jump.
    Point3<double> point_between(double u) const {
        const int i = int(std::floor(u / step()));
        if (i < 1 || i + 2 > steps_) return point_at(u);
        const double x = u / step() - i;
        const Point3<double>* at = &point_[std::size_t(i)];
        return (x * (1 - x) * (x - 2) / 6) * at[-1] + ((1 - x * x) * (2 - x) / 2) * at[0] +
               (x * (1 + x) * (2 - x) / 2) * at[1] + (x * (x * x - 1) / 6) * at[2];
    }

    /// Propagates arm and body in a contact from time `begin` on; none where only a clamped spring yields.
    std::optional<ContactPropagator> propagator(double begin, const Point3<double>& normal,
                                                const Contact& contact) const {
        if (!setup_.arm) return propagator_of(contact.system(), step());
        ArmState<double> state;
        Posture<double> posture;
        double second[max_joints], torque_per_N[max_joints] = {};
        pose(begin, state, second, posture);
        const Point3<double> point = posture.position(setup_.contact.point);
        for (int j = 0; j <= setup_.contact.point.link && j < setup_.chain.dof; ++j)
            torque_per_N[j] = dot(linear_column(setup_.chain, posture, point, j), normal);
        const std::array<double, max_joints> rate =
            rate_per_speed(setup_.chain, posture, setup_.contact.point, normal, state.qd);
        return ContactPropagator(
            ContactSystem(elastic_arm(setup_.chain, *setup_.arm, state.q, torque_per_N, rate.data()), contact.body),
            step());
    }

    /// The stopping curve of a contact that begins at time `begin` on a plane across `normal`, from the start of the
    /// trajectory to a latency beyond its end. Distances are along the normal from the place of contact, and not
    /// positive before contact. With a detector the curve ends where contact has been detected with certainty, or one
    /// tick after a free body has separated.
    StoppingCurve curve(double begin, const Point3<double>& normal, const GaussianThresholds* detector,
                        const Contact& contact, const ContactPropagator* by = nullptr) const {
        StoppingCurve curve;
        LinePath& path = curve.path;
        path.dof = setup_.chain.dof;
        path.normal = {normal.x, normal.y, normal.z};
        const Point3<double> origin = point_at(begin);
        path.start = {origin.x, origin.y, origin.z};
        path.s.reserve(std::size_t(steps_) + 1);
        GaussianThresholds nobody;
        SurvivalCriterion<double> criterion(setup_, detector ? *detector : nobody, contact.at_body());
        // Where arm or body yields, the collision is simulated for the detection, or the separation.
        std::optional<ContactDynamics> dynamics;
        ContactState body;
        if (by != nullptr) dynamics.emplace(*by);
        bool separated = false;  // at the tick before
        const std::size_t n = std::size_t(setup_.chain.dof);
        double greatest = 0;  // distance since contact began
        std::vector<double> torque(n);
        const auto append_step = [&](int i, bool touched) {
            const double s = dot(point_[std::size_t(std::min(i, steps_))] - origin, normal);
            path.s.push_back(touched ? s : std::min(s, not_yet));
        };
        for (int i = 0; i <= steps_; ++i) {
            const bool touched = i * step() > begin;
            append_step(i, touched);
            if (touched) greatest = std::max(greatest, path.s.back());
            if (dynamics && i > 0 && (touched || by->leaves_reference))
                dynamics->step(body, path.s[std::size_t(i) - 1], path.s.back(), 0.0);
            if (i < 1 || (i - 1) % setup_.timing.period != 0) continue;
            allow_interruption();
            const int k = path.ticks++;
            for (std::size_t j = 0; j < n; ++j) torque[j] = touched ? dot(lever_[std::size_t(k) * n + j], normal) : 0.0;
            path.torque_per_N.insert(path.torque_per_N.end(), torque.begin(), torque.end());
            curve.max_distance.push_back(max_distance(k, begin, origin, normal, greatest));
            if (dynamics) {
                dynamics->residuals(body, &path.torque_per_N[std::size_t(k) * n], path.dof, torque.data());
                criterion.observe_contact(body.touched, torque.data());
            } else {
                criterion.observe(path.s.back(), torque.data());
            }
            const bool decided = criterion.finished(0);
            if (detector && (by != nullptr && by->gets_away ? separated : decided)) {
                path.end = PathEnd::all_detected;
                break;
            }
            separated = body.separated > 0.5;
        }
        // Reactions begin up to a latency after the end.
        for (int n = 0; n < setup_.timing.latency; ++n) append_step(int(path.s.size()), true);
        return curve;
    }

    /// Distances after every simulation step of the reaction to a tick, until the arm stands or is back before the
    /// contact.
    std::vector<double> reaction_distances(int tick, double begin, const Point3<double>& normal) const {
        const Point3<double> origin = point_at(begin);
        std::vector<double> distance;
        auto visit = [&](double u, const Point3<double>& point) {
            const double s = dot(point - origin, normal);
            distance.push_back(u > begin ? s : std::min(s, not_yet));
        };
        const PathReaction& reaction = reaction_[std::size_t(tick)];
        for (std::size_t i = 0; i < reaction.u.size(); ++i)
            visit(reaction.u[i], i < reaction.point.size() ? reaction.point[i] : point_between(reaction.u[i]));
        allow_interruption();
        for (double u = reaction.u.back(); setup_.reaction == ReactionKind::reverse && u > begin;) {
            u -= step();
            visit(u, point_between(u));
        }
        return distance;
    }

    /// Paths of such a curve for the collision with arm and body that yield: with the reactions to all ticks whose path
    /// reaches the body, or to one tick.
    ContactPaths contact_paths(const StoppingCurve& curve, double begin, const Point3<double>& normal,
                               const ContactPropagator& by, int only_tick = -1) const {
        ContactPaths paths(setup_, curve.path);
        paths.follow_approach(by);
        for (int k = 0; k < curve.path.ticks; ++k) {
            if (only_tick < 0 ? curve.max_distance[std::size_t(k)] > 0 : k == only_tick)
                paths.reaction[std::size_t(k)] = reaction_distances(k, begin, normal);
        }
        paths.find_max_distance();
        // Reactions that do not reach the body are left out.
        for (int k = 0; k < curve.path.ticks; ++k) {
            if (!(curve.max_distance[std::size_t(k)] > 0)) paths.max_distance[std::size_t(k)] = -HUGE_VAL;
        }
        return paths;
    }

    /// Greatest distances in the first `first` seconds of contact and after them, in a collision detected at a tick.
    std::array<double, 2> phases(int tick, double begin, const Point3<double>& normal, double first) const {
        const Point3<double> origin = point_at(begin);
        std::array<double, 2> phase_max{0, 0};
        if (!(reaction_[std::size_t(tick)].reach > begin)) return phase_max;
        const double end = (touch_time(tick, begin) + first) / step();  // of the first phase, within a step
        const int turn = int(std::ceil(end - 1e-9));
        const int reacts = first_step(tick) + setup_.timing.latency;
        double before = 0;  // distance a step earlier
        auto meet = [&](int i, double distance) {
            double& most = phase_max[i < turn ? 0 : 1];
            most = std::max(most, distance);
            const double between = before + (distance - before) * (end - (turn - 1));
            if (i == turn)
                for (double& each : phase_max) each = std::max(each, between);
            before = distance;
        };
        for (int i = 0; i < std::min(reacts, steps_ + 1); ++i)
            if (i * step() > begin) meet(i, dot(point_[std::size_t(i)] - origin, normal));
        const std::vector<double> distance = reaction_distances(tick, begin, normal);
        for (std::size_t i = 0; i < distance.size(); ++i) meet(reacts + int(i), distance[i]);
        // An arm that has stopped in contact stays there.
        if (setup_.reaction == ReactionKind::stop) meet(std::numeric_limits<int>::max(), distance.back());
        return phase_max;
    }

    /// Time from touch until the reversing arm is back where contact began [s]; NaN where it never arrives there.
    double contact_duration(int tick, double begin) const {
        const PathReaction& reaction = reaction_[std::size_t(tick)];
        const std::vector<double>& u = reaction.u;
        const double from = reaction_time(tick);
        if (!(reaction.reach > begin)) return std::numeric_limits<double>::quiet_NaN();
        const double touch = touch_time(tick, begin);
        const std::size_t last = u.size() - 1;
        if (u[last] >= begin) return from + double(last) * step() + (u[last] - begin) - touch;
        std::size_t i = last;
        while (u[i - 1] <= begin) --i;
        return from + (double(i) - (begin - u[i]) / (u[i - 1] - u[i])) * step() - touch;
    }

  private:
    /// Upper bound of the distances before contact begins [m]: a path that passes the place of contact earlier does not
    /// touch, not even by rounding.
    static constexpr double not_yet = -2 * separation_tolerance;

    double reaction_time(int tick) const { return (first_step(tick) + setup_.timing.latency) * step(); }

    /// When contact begins in a collision detected at a tick whose path reaches the body [s]: an arm that has slowed
    /// down before, after a false alarm, arrives later than `begin`.
    double touch_time(int tick, double begin) const {
        const std::vector<double>& u = reaction_[std::size_t(tick)].u;
        for (std::size_t i = 1; begin > u[0] && i < u.size(); ++i) {
            if (u[i] > begin)
                return reaction_time(tick) + (double(i) - 1 + (begin - u[i - 1]) / (u[i] - u[i - 1])) * step();
        }
        return begin;
    }

    /// Joint positions, their first two derivatives by u, and the posture at the place u of the path.
    void pose(double u, ArmState<double>& state, double* second, Posture<double>& posture) const {
        spline_.at(u, state.q, state.qd, second);
        state.refresh_angles(setup_.chain);
        forward_kinematics(setup_.chain, state.q, state.angle, posture);
    }

    /// Simulates a reaction along the path, where v = du/dt: one deceleration per simulation step, integrated in the
    /// controller's sub-steps.
    PathReaction react(int tick) {
        const MotionSettings& motion = setup_.motion;
        const Deceleration& deceleration = motion.deceleration;
        const double end = spline_.duration();
        const bool reverses = setup_.reaction == ReactionKind::reverse;
        const double target = reverses ? -1 : 0;
        PathReaction reaction;
        ArmState<double> state;
        Posture<double> posture;
        double second[max_joints];
        double u = std::min((first_step(tick) + setup_.timing.latency) * step(), end), v = 1;
        bool forward = true;
        spline_.at(u, state.q, state.qd, second);
        const BrakeProfile profile = brake_profile(setup_.chain, motion, state.q, state.qd, reverses);
        const bool timed =
            deceleration.law == DecelerationLaw::constant_time || deceleration.law == DecelerationLaw::table;
        const double slowing = timed ? profile.stop_time / motion.substep() : 0.0;  // sub-steps
        // The hardest deceleration of v within the limits of a sub-step.
        auto hardest = [&](double substep) {
            double limit[max_joints], acceleration_overload = 1;
            for (int j = 0; j < dof(); ++j) limit[j] = motion.acceleration_limit[j] * profile.of(j, substep);
            const double w = max_deceleration(dof(), state.qd, second, limit, v, acceleration_overload);
            if (profile.of(0, substep) >= 1)
                acceleration_overload_ = std::max(acceleration_overload_, acceleration_overload);
            return w;
        };
        // Time that the slowest joint needs to stop at its limit, from the rates of the motion a time `ahead` of u.
        auto limit_time = [&](double ahead) {
            double most = 0;
            for (int j = 0; j < dof(); ++j)
                most = std::max(most, std::fabs(state.qd[j] + second[j] * ahead) / motion.acceleration_limit[j]);
            return most;
        };
        const double at_begin = limit_time(0);
        for (int i = 0;; ++i) {
            allow_interruption();
            reaction.u.push_back(u);
            reaction.reach = std::max(reaction.reach, u);
            spline_.at(u, state.q, state.qd, second);
            if (forward) {
                state.refresh_angles(setup_.chain);
                forward_kinematics(setup_.chain, state.q, state.angle, posture);
                reaction.point.push_back(posture.position(setup_.contact.point));
            }
            if (v == target || i >= longest_) return reaction;
            forward = v > 0;
            // In the time given v falls linearly to zero. Where the motion brakes by itself v is the greater by as much, so
            // that it is the rates that fall linearly.
            const double here = timed ? limit_time(0.5 * v * step()) : 0.0,
                         braked = here > 0 ? std::max(1.0, at_begin / here) : 1.0;
            double w = 0, share = -1;
            for (int sub = 0; sub < motion.substeps; ++sub) {
                const double done = double(i) * motion.substeps + sub;
                if (done < slowing) {
                    v = std::min(v, braked * (1 - (done + 1) / slowing));
                } else {
                    const double share_before = std::exchange(share, profile.of(0, done));
                    if (share != share_before) w = hardest(done);
                    v += motion.substep() * w;
                }
                v = std::max(target, v);
                u = std::clamp(u + motion.substep() * v, 0.0, end);
            }
        }
    }

    /// The greatest distance at a step from tick k on. An arm that reverses passes all places since contact once more.
    double max_distance(int k, double begin, const Point3<double>& origin, const Point3<double>& normal,
                        double greatest) const {
        const PathReaction& reaction = reaction_[std::size_t(k)];
        if (!(reaction.reach > begin)) return 0;
        const int first = first_step(k);
        double most = setup_.reaction == ReactionKind::reverse ? greatest : 0;
        for (int i = first; i <= std::min(first + setup_.timing.latency, steps_); ++i)
            if (i * step() > begin) most = std::max(most, dot(point_[std::size_t(i)] - origin, normal));
        for (std::size_t i = 0; i < reaction.point.size(); ++i)
            if (reaction.u[i] > begin) most = std::max(most, dot(reaction.point[i] - origin, normal));
        return most;
    }

    CollisionSetup setup_;
    JointSpline spline_;
    int steps_ = 0, ticks_ = 0;
    int longest_ = 0;                    ///< steps after which a reaction is ended in any case
    double acceleration_overload_ = 1;   ///< largest of max_deceleration in the reactions
    std::vector<Point3<double>> point_;  ///< by step
    std::vector<Point3<double>> lever_;  ///< [tick][joint]: linear column of the Jacobian at the contact point
    std::vector<PathReaction> reaction_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
