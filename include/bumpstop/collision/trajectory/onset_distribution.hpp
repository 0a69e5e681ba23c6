/// @file
/// Distributions of contacts that begin at given times of a trajectory.
#pragma once

#include "bumpstop/collision/integrate.hpp"
#include "bumpstop/collision/trajectory/arm_trajectory.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Distance at tick k of a contact whose first tick is `first`: 0 where the point has fallen back, negative before contact.
inline double compression_at(const LinePath& path, int k, int period, int first) {
    return k < first ? -1 : std::max(0.0, path.at_tick(k, period));
}

/// What happens at which tick to one contact.
struct OnsetDistribution {
    struct Detection {
        int tick;
        double probability, max_distance,
            distance;  // distance at the tick, 0 behind the contact; negative: a false alarm
        // Where something gives way [N, N, s, N].
        double peak = 0, lasting = 0, duration = 0, force = 0;
    };
    std::vector<Detection> detection;
    double false_alarm, undetected, no_contact, multi_joint;
    double zero_force;           ///< false alarms whose stopping path does not arrive, and no contact
    double undetected_distance;  ///< distance of the undisturbed motion from contact to its end
    /// Where something gives way [N, N, s].
    double undetected_peak = 0, undetected_lasting = 0, undetected_duration = 0;
    std::array<double, max_joints> trigger;
};

/// When contacts begin, and against what.
struct Onsets {
    std::size_t count = 0;
    const double* time = nullptr;    ///< [onset], since the start of the trajectory [s]
    const double* normal = nullptr;  ///< [onset][3]: unit vector into the body, base frame

    Point3<double> normal_of(std::size_t i) const { return {normal[3 * i], normal[3 * i + 1], normal[3 * i + 2]}; }
};

/// The contact that begins at time `begin` on a plane across `normal`. `by`: what gives way, if
/// anything does. `before`: the trajectory's ticks without contact.
template <class T>
OnsetDistribution integrate_onset(const ArmTrajectory& trajectory, double begin, const Point3<double>& normal,
                                  const GaussianThresholds& detector, const Contact& contact,
                                  const ContactPropagator* by, const PreContactAlarms& before) {
    const CollisionSetup& setup = trajectory.setup();
    const StoppingCurve curve = trajectory.curve(begin, normal, &detector, contact, by);
    QuadratureSettings settings{contact.at_body()};
    ContactPaths paths;
    if (by != nullptr) {
        paths = trajectory.contact_paths(curve, begin, normal);
        settings.paths = &paths;
        settings.propagator = by;
    }
    const CollisionDistribution found = integrate<T>(setup, curve, detector, settings, &before);
    OnsetDistribution out;
    out.false_alarm = found.false_alarm;
    out.undetected = found.undetected;
    out.no_contact = found.no_contact;
    out.multi_joint = found.multi_joint;
    out.zero_force = found.zero_force;
    out.undetected_distance = std::max(0.0, *std::max_element(curve.path.s.begin(), curve.path.s.end()));
    std::copy(found.trigger, found.trigger + max_joints, out.trigger.begin());
    const PiecewiseDensity& density = found.density;
    const ContactNodes& nodes = found.nodes;
    const PiecewiseDensity::Panel panel =
        density.panel.empty() ? PiecewiseDensity::Panel{0, 0, curve.path.ticks} : density.panel[0];
    std::vector<PreContactAlarm> alarms(density.alarm.begin() + panel.first_alarm,
                                        density.alarm.begin() + panel.end_alarm);
    std::sort(alarms.begin(), alarms.end(), [](const auto& one, const auto& other) { return one.tick < other.tick; });
    for (const PreContactAlarm& alarm : alarms) {
        if (alarm.tick < curve.path.ticks && alarm.chance > 0)
            out.detection.push_back({alarm.tick, 2 * alarm.chance * density.offset_series[0], alarm.reach, -1});
    }
    for (int slot = 0; slot < panel.slots; ++slot) {
        const double probability = density.mass_of(panel, slot);
        const int k = panel.tick(slot);
        if (!(probability > 0)) continue;
        out.detection.push_back({k, probability, curve.max_distance[std::size_t(k)],
                                 compression_at(curve.path, k, setup.timing.period, panel.first_tick)});
        if (by != nullptr) {
            const std::size_t at = std::size_t(slot) * std::size_t(density.order);
            out.detection.back().peak = nodes.peak_force[at];
            out.detection.back().lasting = nodes.lasting_force[at];
            out.detection.back().duration = nodes.duration[at];
            out.detection.back().force = nodes.force_at_detection[at];
        }
    }
    if (by == nullptr) return out;
    if (!nodes.undetected_peak_force.empty()) {
        out.undetected_peak = nodes.undetected_peak_force[0];
        out.undetected_lasting = nodes.undetected_lasting_force[0];
        out.undetected_duration = nodes.undetected_duration[0];
    }
    const EarlyReactions& pieces = found.early_reactions;
    for (std::size_t i = 0; i < pieces.pieces(); ++i) {
        // All cells of a body at one place are alike.
        const ContactReactions::Outcome& edge = pieces.edge[i * (EarlyReactions::cells + 1)];
        out.detection.push_back({pieces.tick[i], pieces.mass[i * EarlyReactions::cells] * EarlyReactions::cells,
                                 curve.max_distance[std::size_t(pieces.tick[i])], -1, edge.peak, edge.lasting,
                                 edge.duration, 0});
    }
    return out;
}

/// All of them, one after another.
template <class T>
std::vector<OnsetDistribution> integrate_onsets(const ArmTrajectory& trajectory, const Onsets& onsets,
                                                const GaussianThresholds& detector, const Contact& contact) {
    const PreContactAlarms before(trajectory.setup(), detector, trajectory.ticks());
    std::vector<OnsetDistribution> out;
    for (std::size_t i = 0; i < onsets.count; ++i) {
        const auto by = trajectory.propagator(onsets.time[i], onsets.normal_of(i), contact);
        out.push_back(integrate_onset<T>(trajectory, onsets.time[i], onsets.normal_of(i), detector, contact,
                                         by ? &*by : nullptr, before));
    }
    return out;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
