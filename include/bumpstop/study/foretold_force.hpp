/// @file
/// Peak forces foretold from the pose: an expected value and an upper bound, without tracing a motion.
#pragma once

#include <vector>

#include "bumpstop/collision/offset_distribution.hpp"
#include "bumpstop/study/braking_ahead.hpp"
#include "bumpstop/study/noticing.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// All but pose and velocity.
struct ForetoldScenario {
    ArmOnLine arm;
    ThresholdDetector detector;  ///< its filter is an observer's
    bool reverse = true;
    double period = 0, latency = 0, duration = 0;  ///< s
    double stiffness = 0;                          ///< N/m
    OffsetKind offset_kind = OffsetKind::uniform;
    double offset_size = 0;   ///< fixed: m; half-normal: sd in seconds of travel
    double quantile = 0.999;  ///< of the bound

    /// What may be missed; where the body's place has a tail, half of it is left to that.
    double rarest() const { return (1 - quantile) * (offset_kind == OffsetKind::half_normal ? 0.5 : 1.0); }
};

/// What is foretold of a case. Forces of `unbounded_force` and more stand for infinite ones. `expected`, `bound` and
/// `stopping` are NaN where the start is singular or the contact point does not advance.
template <class T>
struct Foretold {
    T expected;   ///< peak force, its mean [N]
    T bound;      ///< peak force that a share `ForetoldScenario::quantile` of the cases stays below [N]
    T unnoticed;  ///< largest contact force that passes no threshold without noise [N]
    T trigger;    ///< the joint whose threshold that is, from 0
    T gain;       ///< greatest joint rate per speed of the tip [rad/m or 1]
    T stopping;   ///< travel of the contact point along the normal after the detection expected [m]
    T approach;   ///< speed of the contact point along the normal [m/s]
    T trusted;    ///< 1: the formula holds, and there is a bound; else 0
    T turned;     ///< greatest change of the joint rates on the way, in shares of themselves
};

/// Larger than any force.
inline constexpr double unbounded_force = 1e200;

namespace detail {

/// The stretch foreseen is longer than the shortest that is noticed, for noise and falling sensitivity.
inline constexpr double longer = 1.25;
/// The same, of the longest that the noise lets pass but for the share of cases the bound leaves out.
inline constexpr double rarely_longer = 1.1;
/// Moments at which the path is known: of most motions, and of those that turn on the way.
inline constexpr int few_steps = 2, many_steps = 16;
/// How much joint rates may change on the way, in shares of themselves.
inline constexpr double turning = 0.4;
/// With few moments on the way: nothing can hold there.
inline constexpr double too_far_turned = 0.6;
/// Where they change by more than this, both numbers of moments must agree so well.
inline constexpr double doubted = 0.1, agree = 0.02;
/// How far the speed of the tip may be from the speed asked for.
inline constexpr double most_off_speed = 0.02;
/// Where it does not hold, the formula is kept within this factor of that of one line.
inline constexpr double astray = 3.0;
/// How often the force that an observer lags behind is put right.
inline constexpr int lag_rounds = 6;
/// Places of the body, out of all it may have, at which the least torque per newton is looked for.
inline constexpr int body_places = 3;

/// One register of cases at the start of their motions.
template <class T>
struct Start {
    Moment<T> at;
    Point3<T> normal, velocity;
    T torque[max_joints];  ///< J_v' n, by joint [Nm/N or 1]
    T approach, stop;      ///< speed along the normal [m/s], time the slowest joint needs to stop [s]
    MaskOf<T> singular;
};

template <class T>
Start<T> start_of_case(const ForetoldScenario& scenario, const T* q, const Point3<T>& velocity) {
    const ArmOnLine& arm = scenario.arm;
    Start<T> start;
    for (int j = 0; j < arm.chain.dof; ++j) start.at.q[j] = q[j];
    start.at.look(arm.chain);
    start.velocity = velocity;
    start.singular = line_rates(arm, start.at.posture, velocity, start.at.qd);
    const Point3<T> p = start.at.posture.position(arm.contact.point);
    start.normal = {T(arm.contact.normal[0]), T(arm.contact.normal[1]), T(arm.contact.normal[2])};
    if (arm.contact.along_motion) {
        Point3<T> drift{T(0.0), T(0.0), T(0.0)};
        for (int f = 0; f < arm.motion.free_count; ++f) {
            const int j = arm.motion.free_joint[f];
            if (j > arm.contact.point.link) continue;
            const Point3<T> column = linear_column(arm.chain, start.at.posture, p, j);
            drift = {drift.x + column.x * start.at.qd[j], drift.y + column.y * start.at.qd[j],
                     drift.z + column.z * start.at.qd[j]};
        }
        const T inverse = 1.0 / maximum(square_root(dot(drift, drift)), T(1e-200));
        start.normal = {drift.x * inverse, drift.y * inverse, drift.z * inverse};
    }
    contact_torque(arm, start.at.posture, start.normal, start.torque);
    start.approach = dot_joints(arm, start.torque, start.at.qd);
    start.stop = time_for(arm, start.at.qd);
    return start;
}

template <class T>
struct Forces {
    T expected, bound, stopping, turned;  ///< as of Foretold
    MaskOf<T> trusted;
};

/// Expected force, bound, stopping travel, and where they hold; without a bound nothing holds.
template <class T, int steps, bool with_bound>
Forces<T> forces_ahead(const ForetoldScenario& scenario, const Start<T>& start) {
    const ArmOnLine& arm = scenario.arm;
    const ThresholdDetector& detector = scenario.detector;
    const double K = scenario.stiffness, compliance = 1 / K, period = scenario.period, latency = scenario.latency;
    const T approach = maximum(start.approach, T(1e-9));
    T offset, farthest;
    if (scenario.offset_kind == OffsetKind::fixed) {
        offset = farthest = scenario.offset_size;
    } else if (scenario.offset_kind == OffsetKind::uniform) {
        farthest = period * approach;
        offset = 0.5 * farthest;
    } else {
        const T spread = scenario.offset_size * approach;
        offset = spread * 0.79788456080286535588;
        farthest = spread * normal_upper_quantile((1 - scenario.quantile) / 4);
    }
    T own[max_joints];
    for (int w = 0; w < detector.watched; ++w) own[w] = start.torque[detector.joint[w]];
    const double rarest = scenario.rarest();
    const double deviations = rarest < 0.5 ? normal_upper_quantile(rarest) : 0.0;
    const auto missed = [&](double sigmas) {
        T least = unbounded_force;
        for (int w = 0; w < detector.watched; ++w) {
            const double level = detector.threshold[w] + std::fabs(detector.mean[w]) + sigmas * detector.sd[w];
            least = minimum(least, level / maximum(absolute(own[w]), T(1e-100)));
        }
        return least;
    };
    const double keep = scenario.detector.filter;
    const auto unfelt = [&](T force, T per_tick) {  // how far an observer is behind a force that grows evenly
        if (keep == 0) return T(0.0);
        const T rate = -std::log(keep) / per_tick;
        return per_tick * (keep / (1 - keep)) * (1.0 - exp_negative(minimum(rate * force, T(700.0)), T(0.0)));
    };
    const T noisy = missed(2.0);
    T far = maximum(longer * noisy, rarely_longer * missed(deviations));
    if (keep > 0) {
        // The force at which an observer has felt so much, from above: every round is nearer and none below it.
        const T even = maximum(K * period * approach, T(1e-12)), whole = far;
        far += even * (keep / (1 - keep));
        for (int round = 0; round < lag_rounds; ++round) far = whole + unfelt(far, even);
    }
    T length = (farthest + far * compliance) / approach + 2 * period + latency;
    length = minimum(length, T(scenario.duration + latency));
    ArmAhead<T, steps> path;
    path.follow(arm, start.at, start.normal, start.velocity, length);

    const T tick = maximum(K * period * path.speed_at(offset + noisy * compliance), T(1e-12));
    const auto felt = [&](T force, int w) {
        const T share = path.share_at(offset + force * compliance);
        return (force - unfelt(force, tick)) * path.torque_of(share, detector.joint[w]);
    };
    const auto feel = [&](T force, T* residual) {
        path.torque_at(path.share_at(offset + force * compliance), detector.joint.data(), detector.watched, residual);
        const T counts = force - unfelt(force, tick);
        for (int w = 0; w < detector.watched; ++w) residual[w] *= counts;
    };
    const T found = notice(detector, felt, feel, own, tick, deviations, false).mean();

    if constexpr (!with_bound) {
        const BrakingAhead<T> braking = braking_ahead(
            path, path.time_of(offset + minimum(found, T(unbounded_force)) * compliance), latency, scenario.reverse);
        return {found + K * braking.travel, T(unbounded_force), braking.travel, maximum(braking.bent, path.turned),
                T(1.0) < T(0.0)};
    }
    // What is felt at least, wherever the body is. An observer's residual is a mean over all of the way since contact.
    const int since = keep > 0 ? body_places : 1;
    const T fast_tick = maximum(K * period * path.fastest(), T(1e-12));
    const auto share_of = [&](T force, int body, int part) {
        const double weight = since > 1 ? double(part) / (since - 1) : 1.0;
        return path.share_at(farthest * (double(body) / (body_places - 1)) + weight * force * compliance);
    };
    const auto take_least = [](T value, T first, T& least) {
        least = select(value * first > T(0.0), minimum(least, absolute(value)), T(0.0));
    };
    const auto felt_at_least = [&](T force, int w) {
        T first = 0.0, least = 1e300;
        for (int body = 0; body < body_places; ++body) {
            for (int part = 0; part < since; ++part) {
                const T value = path.torque_of(share_of(force, body, part), detector.joint[w]);
                if (body == 0 && part == 0) first = value;
                take_least(value, first, least);
            }
        }
        return least * (force - unfelt(force, fast_tick));
    };
    const auto feel_at_least = [&](T force, T* residual) {
        T first[max_joints], value[max_joints];
        for (int body = 0; body < body_places; ++body) {
            for (int part = 0; part < since; ++part) {
                path.torque_at(share_of(force, body, part), detector.joint.data(), detector.watched, value);
                for (int w = 0; w < detector.watched; ++w) {
                    if (body == 0 && part == 0) first[w] = value[w], residual[w] = 1e300;
                    take_least(value[w], first[w], residual[w]);
                }
            }
        }
        const T counts = force - unfelt(force, fast_tick);
        for (int w = 0; w < detector.watched; ++w) residual[w] *= counts;
    };
    const T worst = notice(detector, felt_at_least, feel_at_least, own, fast_tick, deviations, true).worst(rarest);

    const T last = farthest + minimum(worst, T(unbounded_force)) * compliance;
    const auto braking = [&](T time) { return braking_ahead(path, time, latency, scenario.reverse); };
    const BrakingAhead<T> expected = braking(path.time_of(offset + minimum(found, T(unbounded_force)) * compliance));
    const T last_time = path.time_of(last);
    const BrakingAhead<T> first_tick = braking(T(0.0)), last_tick = braking(last_time);
    const T most = maximum(expected.most, maximum(first_tick.most, last_tick.most));
    const T bent = maximum(expected.bent, maximum(first_tick.bent, last_tick.bent));
    // Beyond a joint limit the motion is over, and what was not noticed never is.
    T q[max_joints];
    path.position_at(last_time, q);
    T within = 1.0;  // the joint limits
    for (int j = 0; j < arm.chain.dof; ++j)
        within = minimum(within, minimum(q[j] - arm.motion.lower[j], arm.motion.upper[j] - q[j]));
    const MaskOf<T> reached = last <= path.distance[steps], allowed = within >= T(0.0);
    // Nor is anything known of a reaction that begins after the stretch.
    const MaskOf<T> begun = last_time + latency <= path.length;
    const MaskOf<T> seen = reached & allowed & begun;
    Forces<T> forces;
    forces.expected = found + K * expected.travel;
    forces.bound = select(seen, worst + K * most, T(unbounded_force));
    forces.stopping = expected.travel;
    forces.turned = maximum(bent, path.turned);
    const MaskOf<T> straight = forces.turned < T(turning), follows = path.off_speed < T(most_off_speed);
    const MaskOf<T> known = absolute(forces.expected) < T(unbounded_force);
    const MaskOf<T> bounded = forces.bound < T(unbounded_force);
    forces.trusted = (straight & follows) & (known & bounded);
    return forces;
}

/// One register of cases from a start with few moments of the way, or many. `before` is what few moments gave.
template <class T, int steps, bool with_bound>
Foretold<T> foretell(const ForetoldScenario& scenario, const Start<T>& start, const Foretold<T>* before) {
    const ArmOnLine& arm = scenario.arm;
    Foretold<T> found;
    found.unnoticed = unbounded_force;
    found.trigger = 0.0;
    for (int w = 0; w < scenario.detector.watched; ++w) {
        const int j = scenario.detector.joint[w];
        const T force = scenario.detector.threshold[w] / maximum(absolute(start.torque[j]), T(1e-220));
        found.trigger = select(force < found.unnoticed, T(double(j)), found.trigger);
        found.unnoticed = minimum(found.unnoticed, force);
    }
    T fastest = 0.0;
    for (int j = 0; j < arm.chain.dof; ++j) fastest = maximum(fastest, absolute(start.at.qd[j]));
    found.gain = fastest / square_root(dot(start.velocity, start.velocity));
    found.approach = start.approach;
    const MaskOf<T> regular = !start.singular, advances = start.approach > T(0.0);
    const MaskOf<T> usable = regular & advances;
    const auto feels = found.unnoticed < T(unbounded_force);
    const Forces<T> forces = forces_ahead<T, steps, with_bound>(scenario, start);
    MaskOf<T> trusted = forces.trusted & usable & feels;
    T bound = forces.bound;
    if (before != nullptr) {
        const MaskOf<T> checked = before->trusted > T(0.5);
        const MaskOf<T> agrees = absolute(bound - before->bound) <= agree * before->bound;
        const MaskOf<T> first_look = !checked;
        trusted = trusted & (agrees | first_look);
        bound = select(checked, maximum(bound, before->bound), bound);
    }
    const T late = scenario.period / 2 + scenario.latency;
    const T rough = found.unnoticed + scenario.stiffness * start.approach * (late + 0.5 * start.stop);
    // Where it does not hold, the formula of one line keeps the guess from going far astray.
    const auto sound = absolute(forces.expected) < T(unbounded_force);  // not where it is NaN
    const T guess = minimum(maximum(select(sound, forces.expected, rough), rough * (1 / astray)), rough * astray);
    const T nothing(std::numeric_limits<double>::quiet_NaN());
    found.expected =
        select(usable, select(feels, select(trusted, forces.expected, guess), T(unbounded_force)), nothing);
    found.bound = select(usable, select(trusted, bound, T(unbounded_force)), nothing);
    found.stopping = select(usable & feels, forces.stopping, nothing);
    found.trusted = select(trusted, T(1.0), T(0.0));
    found.turned = forces.turned;
    return found;
}

}  // namespace detail

/// Foretells n cases. q is (n, dof), velocity of the tip (n, 3) [m/s]; `put(i, case)` takes the answers in any order.
template <class T, class Put>
void foretell_forces(const ForetoldScenario& scenario, int n, const double* q, const double* velocity, Put put) {
    constexpr int lanes = Scalar<T>::lanes;
    const int dof = scenario.arm.chain.dof;
    // Cases to be looked at again: for a bound too, or for what is expected alone.
    std::vector<int> doubted, hopeless;
    std::vector<Foretold<double>> first;
    const auto load_start = [&](const int* row) {
        T pose[max_joints];
        Point3<T> v;
        for (int lane = 0; lane < lanes; ++lane) {
            for (int j = 0; j < dof; ++j) set_lane(pose[j], lane, q[std::size_t(row[lane]) * dof + j]);
            set_lane(v.x, lane, velocity[std::size_t(row[lane]) * 3]);
            set_lane(v.y, lane, velocity[std::size_t(row[lane]) * 3 + 1]);
            set_lane(v.z, lane, velocity[std::size_t(row[lane]) * 3 + 2]);
        }
        return detail::start_of_case(scenario, pose, v);
    };
    const auto one_lane = [](const Foretold<T>& all, int lane) {
        return Foretold<double>{lane_of(all.expected, lane), lane_of(all.bound, lane),   lane_of(all.unnoticed, lane),
                                lane_of(all.trigger, lane),  lane_of(all.gain, lane),    lane_of(all.stopping, lane),
                                lane_of(all.approach, lane), lane_of(all.trusted, lane), lane_of(all.turned, lane)};
    };
    for (int i = 0; i < n; i += lanes) {
        allow_interruption();
        int row[lanes];
        for (int lane = 0; lane < lanes; ++lane) row[lane] = std::min(i + lane, n - 1);
        const Foretold<T> found = detail::foretell<T, detail::few_steps, true>(scenario, load_start(row), nullptr);
        for (int lane = 0; lane < std::min(lanes, n - i); ++lane) {
            const Foretold<double> one = one_lane(found, lane);
            const bool needless = !(one.expected < unbounded_force);  // singular, or nothing is felt
            if (needless || (one.trusted > 0.5 && one.turned <= detail::doubted)) {
                put(row[lane], one);
            } else if (one.turned > detail::too_far_turned) {
                hopeless.push_back(row[lane]);
            } else {
                doubted.push_back(row[lane]);
                first.push_back(one);
            }
        }
    }
    const auto again = [&](const std::vector<int>& rows, const auto& look) {
        for (int i = 0; i < int(rows.size()); i += lanes) {
            int row[lanes];
            for (int lane = 0; lane < lanes; ++lane) row[lane] = rows[std::min(i + lane, int(rows.size()) - 1)];
            const Foretold<T> found = look(i, load_start(row));
            for (int lane = 0; lane < std::min(lanes, int(rows.size()) - i); ++lane)
                put(row[lane], one_lane(found, lane));
        }
    };
    again(doubted, [&](int i, const detail::Start<T>& start) {
        Foretold<T> before{};
        for (int lane = 0; lane < lanes; ++lane) {
            const Foretold<double>& own = first[std::min(i + lane, int(first.size()) - 1)];
            set_lane(before.bound, lane, own.bound);
            set_lane(before.trusted, lane, own.trusted);
        }
        return detail::foretell<T, detail::many_steps, true>(scenario, start, &before);
    });
    again(hopeless, [&](int, const detail::Start<T>& start) {
        return detail::foretell<T, detail::many_steps, false>(scenario, start, nullptr);
    });
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
