/// @file
/// When a growing contact force is noticed: ticks, thresholds and noise, without a path.
#pragma once

#include "bumpstop/detection/threshold.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Forces at which the hazard is known: some 9 standard deviations in 32 parts.
inline constexpr int noticing_points = 33;

/// How probably a force that grows by `per_tick` newtons a tick is still unnoticed.
///
/// `silence`, S(F), is the probability that no tick up to the one at force F has alarmed, where the tick at F is the last
/// of those at F, F - D, F - 2 D ... With ticks that fall evenly, P(F_detect > F) is the mean of S over [F - D, F], and
/// E[F_detect] = D / 2 + integral of S. Both are exact for ticks of that kind.
template <class T>
struct Noticing {
    T per_tick;                  ///< D [N]
    T low, width;                ///< the forces are low + i width [N]; infinite_force and 0 where none is noticed
    T silence[noticing_points];  ///< S at them

    /// Expected force at detection [N].
    T mean() const {
        T sum = 0.5 * (silence[0] + silence[noticing_points - 1]);
        for (int i = 1; i + 1 < noticing_points; ++i) sum += silence[i];
        return low + width * sum + 0.5 * per_tick;
    }
    /// Force [N] that a detection passes with probability at most `rare` however the ticks fall: the first point from
    /// which on S is no more than that, and one tick. Infinite where even the largest force is missed more often.
    T worst(double rare) const {
        T found = low + per_tick;
        for (int i = 0; i < noticing_points; ++i) {
            const T next = i + 1 < noticing_points ? low + width * double(i + 1) + per_tick : T(infinite_force);
            found = select(silence[i] <= T(rare), found, next);
        }
        return found;
    }
    static constexpr double infinite_force = 1e300;
};

namespace detail {

inline constexpr int direct_ticks = 8;
inline constexpr double least_hazard = 1e-300, most_hazard = 700.0;
/// A joint that far below its threshold does not alarm (5e-7 a tick).
inline constexpr double too_far_below = 5.0;
/// Beyond so many standard deviations an alarm is left out (3e-14): late detection then looks more probable.
inline constexpr double never_alarms = 7.5;
/// How often the force that reaches a threshold is put right for a torque per newton that changes on the way.
inline constexpr int corrections = 6;
/// How well it need be known: it is an end of the forces looked at, and no more.
inline constexpr double nearly = 1e-3;

/// e^x for x from -690 to 7.
template <class T>
T exponential(T x) {
    return 1096.6331584284585992637202382881 * exp_negative(7.0 - x, T(0.0));
}

/// P(alarm) of a joint that feels `felt` [Nm].
template <class T>
T alarm_probability(T felt, double threshold, double sd) {
    if (sd == 0) {
        const T room = threshold - absolute(felt);
        return select(room > T(1e-9 * threshold), T(0.0), T(1.0));
    }
    const double scale = 0.70710678118654752440 / sd;
    const T up = (threshold - felt) * scale, down = (threshold + felt) * scale;
    const T nothing(never_alarms * 0.70710678118654752440);
    T p = 0.0;
    if (!all(up > nothing)) p += select(up > nothing, T(0.0), 0.5 * erfc(up));
    if (!all(down > nothing)) p += select(down > nothing, T(0.0), 0.5 * erfc(down));
    return minimum(p, T(1.0));
}

/// The least force at which some joint's noiseless residual reaches its level [N]; not below 1e299 where none does.
template <class T, class Felt>
T reaches(const ThresholdDetector& detector, const Felt& felt, const T* torque, double deviations, double side) {
    T least = 1e300;
    for (int w = 0; w < detector.watched; ++w) {
        const double level =
            std::max(0.0, detector.threshold[w] + side * std::fabs(detector.mean[w]) + deviations * detector.sd[w]);
        const T a = absolute(torque[w]);
        T force = select(a > T(1e-290), level / maximum(a, T(1e-290)), T(1e300));
        if (level > 0) {
            // A lane that is done stays as it is, whatever the others still need.
            MaskOf<T> going = force < T(1e290);
            for (int round = 0; round < corrections && any(going); ++round) {
                const T size = absolute(felt(minimum(force, T(1e290)), w));
                const T better = select(size > T(0.0), level * force / maximum(size, T(1e-290)), T(1e300));
                const MaskOf<T> changes = absolute(better - force) > nearly * force, finite = better < T(1e290);
                force = select(going, better, force);
                going = going & (changes & finite);
            }
        }
        least = minimum(least, force);
    }
    return least;
}

/// Values of `table` at fractional places, by straight lines; places outside are those at its ends.
template <class T>
T between(const T* table, T place) {
    T found;
    for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
        const double x = std::min(std::max(lane_of(place, lane), 0.0), noticing_points - 1.000001);
        const int low = int(x);
        const double y = lane_of(table[low], lane);
        set_lane(found, lane, y + (x - low) * (lane_of(table[low + 1], lane) - y));
    }
    return found;
}
/// Values of `table` at the points below fractional places; 0 before the first.
template <class T>
T point_below(const T* table, T place) {
    T found;
    for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
        const double x = lane_of(place, lane);
        set_lane(found, lane, x >= 0 ? lane_of(table[int(x)], lane) : 0.0);
    }
    return found;
}

/// Sum of the hazard over the ticks at F, F - D, F - 2 D ..., for every F. The last ticks one by one; those before as an
/// integral (midpoint rule), which is good because they are many only where they lie close together.
template <class T>
void sum_hazards(const T* hazard, T width, T per_tick, T* total) {
    T logarithms[noticing_points], integral[noticing_points];
    for (int i = 0; i < noticing_points; ++i) logarithms[i] = logarithm(maximum(hazard[i], T(least_hazard)));
    T sum = least_hazard;
    integral[0] = logarithm(sum);
    for (int i = 1; i < noticing_points; ++i) {
        // Between two points the hazard is taken for an exponential, which never overstates it.
        const T rise = logarithms[i] - logarithms[i - 1];
        const auto rises = absolute(rise) > T(1e-6);
        sum += width * select(rises, (hazard[i] - hazard[i - 1]) / select(rises, rise, T(1.0)), hazard[i]);
        integral[i] = logarithm(sum);
    }
    const T shift = per_tick / maximum(width, T(1e-300)), inverse = 1.0 / per_tick;
    for (int i = 0; i < noticing_points; ++i) {
        T found = hazard[i];
        for (int number = 1; number < direct_ticks; ++number) {
            const T place = double(i) - double(number) * shift;
            if (all(place < T(0.0))) break;
            found += select(place >= T(0.0), exponential(between(logarithms, place)), T(0.0));
        }
        const T place = double(i) - (direct_ticks - 0.5) * shift;
        // An integral may be larger than any hazard: its logarithm is taken relative to a tick.
        if (!all(place <= T(0.0)))
            found += select(place > T(0.0), exponential(minimum(between(integral, place) + logarithm(inverse), T(6.9))),
                            T(0.0));
        total[i] = found;
    }
}

/// The same where the hazard does not fall with the force, and never more than it is. Every tick has the hazard of the
/// next point below it. The ticks before those taken one by one have at least the integral over the ticks before each of
/// them.
template <class T>
void sum_hazards_at_least(const T* hazard, T width, T per_tick, T* total) {
    T integral[noticing_points];
    integral[0] = 0.0;
    for (int i = 1; i < noticing_points; ++i) integral[i] = integral[i - 1] + width * hazard[i - 1];
    const T shift = per_tick / maximum(width, T(1e-300)), inverse = 1.0 / per_tick;
    for (int i = 0; i < noticing_points; ++i) {
        T found = hazard[i];
        for (int number = 1; number < direct_ticks; ++number) {
            const T place = double(i) - double(number) * shift;
            if (all(place < T(0.0))) break;
            found += point_below(hazard, place);
        }
        total[i] = found + point_below(integral, double(i) - double(direct_ticks) * shift) * inverse;
    }
}

}  // namespace detail

/// Works out S.
///
/// `felt(force, w)` is the noiseless residual of watched joint w [Nm], and `feel(force, residual)` that of all; `torque` is
/// what a newton raises it by at the start, to know which forces matter. `rarest` is the smallest S wanted, and
/// `deviations` the standard deviations that go with it. `cautious`: no rounding and no mean of the noise may make S
/// smaller than it is, for `worst`; residuals are then taken for positive.
template <class T, class Felt, class Feel>
Noticing<T> notice(const ThresholdDetector& detector, const Felt& felt, const Feel& feel, const T* torque, T per_tick,
                   double deviations, bool cautious) {
    Noticing<T> found;
    found.per_tick = per_tick;
    found.low = detail::reaches(detector, felt, torque, -detail::too_far_below, -1.0);
    const T high = detail::reaches(detector, felt, torque, std::max(4.0, deviations + 0.5), 1.0);
    found.width = (high - found.low) * (1.0 / (noticing_points - 1));
    T hazard[noticing_points], total[noticing_points], residual[max_joints];
    for (int i = 0; i < noticing_points; ++i) {
        feel(found.low + found.width * double(i), residual);
        T alarm = 0.0;
        for (int w = 0; w < detector.watched; ++w) {
            const T seen =
                cautious ? maximum(residual[w] - std::fabs(detector.mean[w]), T(0.0)) : residual[w] + detector.mean[w];
            const T p = detail::alarm_probability(seen, detector.threshold[w], detector.sd[w]);
            alarm += p * (1.0 - alarm);
        }
        // -log1p(-p), right for small p too.
        const T silent = maximum(1.0 - alarm, T(1e-304)), lost = 1.0 - silent;
        const auto some = lost > T(0.0);
        hazard[i] = minimum(select(some, -logarithm(silent) * (alarm / select(some, lost, T(1.0))), alarm),
                            T(detail::most_hazard));
    }
    if (cautious) {
        // Where it falls with the force the least still to come counts.
        for (int i = noticing_points - 2; i >= 0; --i) hazard[i] = minimum(hazard[i], hazard[i + 1]);
    }
    if (detector.correlation != 0) {
        std::copy(hazard, hazard + noticing_points, total);
    } else if (cautious) {
        detail::sum_hazards_at_least(hazard, found.width, per_tick, total);
    } else {
        detail::sum_hazards(hazard, found.width, per_tick, total);
    }
    for (int i = 0; i < noticing_points; ++i) found.silence[i] = exp_negative(minimum(total[i], T(700.0)), T(0.0));
    return found;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
