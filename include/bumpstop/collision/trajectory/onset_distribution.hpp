/// @file
/// Distributions of contacts that begin at given times of a trajectory.
#pragma once

#include <atomic>

#include "bumpstop/collision/collision.hpp"
#include "bumpstop/collision/trajectory/arm_trajectory.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Compression of the body at tick k, where `first` is the first tick in contact: 0 where the point has moved back out,
/// negative before contact [m].
inline double compression_at(const LinePath& path, int k, int period, int first) {
    return k < first ? -1 : std::max(0.0, path.at_tick(k, period));
}

/// Outcomes of one contact by the tick of their detection.
struct OnsetDistribution {
    struct Detection {
        int tick;
        double probability, max_distance;
        double distance;  ///< compression at the tick; negative: a false alarm [m]
        double peak = 0, lasting = 0, duration = 0, force = 0;  ///< where arm or body yields [N, N, s, N]
    };
    std::vector<Detection> detection;
    double false_alarm, undetected, no_contact, multi_joint;
    double zero_force;           ///< false alarms whose stopping path does not reach the body, and no contact
    double undetected_distance;  ///< greatest compression by the undisturbed motion [m]
    /// Where arm or body yields [N, N, s].
    double undetected_peak = 0, undetected_lasting = 0, undetected_duration = 0;
    std::array<double, max_joints> trigger;
};

/// When contacts begin, and the normals of the surfaces hit.
struct Onsets {
    std::size_t count = 0;
    const double* time = nullptr;    ///< [onset], since the start of the trajectory [s]
    const double* normal = nullptr;  ///< [onset][3]: unit vector into the body, base frame

    Point3<double> normal_of(std::size_t i) const { return {normal[3 * i], normal[3 * i + 1], normal[3 * i + 2]}; }
};

/// The outcomes of a contact that begins at time `begin` on a plane across `normal`. `by`: propagator of arm and body,
/// null where only a clamped spring yields. `before`: false alarms of the trajectory without contact.
template <class T>
OnsetDistribution integrate_onset(const ArmTrajectory& trajectory, double begin, const Point3<double>& normal,
                                  const GaussianThresholds& detector, const Contact& contact,
                                  const ContactPropagator* by, const PreContactAlarms& before) {
    const CollisionSetup& setup = trajectory.setup();
    const StoppingCurve curve = trajectory.curve(begin, normal, &detector, contact, by);
    QuadratureSettings settings{contact.at_body()};
    ContactPaths paths;
    if (by != nullptr) {
        paths = trajectory.contact_paths(curve, begin, normal, *by);
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
        // The body is at one offset, so all cells are equal.
        const ContactReactions::Outcome& edge = pieces.edge[i * (EarlyReactions::cells + 1)];
        out.detection.push_back({pieces.tick[i], pieces.mass[i * EarlyReactions::cells] * EarlyReactions::cells,
                                 curve.max_distance[std::size_t(pieces.tick[i])], -1, edge.peak, edge.lasting,
                                 edge.duration, 0});
    }
    return out;
}

/// The same of all onsets, which threads share.
template <class T>
std::vector<OnsetDistribution> integrate_onsets(const ArmTrajectory& trajectory, const Onsets& onsets,
                                                const GaussianThresholds& detector, const Contact& contact,
                                                int threads) {
    const PreContactAlarms before(trajectory.setup(), detector, trajectory.ticks());
    std::vector<OnsetDistribution> out(onsets.count);
    std::atomic<std::size_t> next{0};
    work_in_threads(std::clamp(threads, 1, std::max(1, int(onsets.count))), [&] {
        for (std::size_t i = next++; i < onsets.count; i = next++) {
            const auto by = trajectory.propagator(onsets.time[i], onsets.normal_of(i), contact);
            out[i] = integrate_onset<T>(trajectory, onsets.time[i], onsets.normal_of(i), detector, contact,
                                        by ? &*by : nullptr, before);
        }
    });
    return out;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
