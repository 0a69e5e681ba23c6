/// @file
/// Single collisions that begin at given times of a trajectory.
#pragma once

#include "bumpstop/collision/distribution/monte_carlo.hpp"
#include "bumpstop/collision/trajectory/onset_distribution.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Monte Carlo runs, one for each onset; distances are along the normal from the place of contact [m].
struct OnsetRuns : MonteCarloRuns {
    std::vector<double> max_distance;         ///< greatest distance once the arm reacts; zero without a detection
    std::vector<double> distance;             ///< compression at detection; negative: never, or before contact
    std::vector<double> undetected_distance;  ///< greatest compression by the undisturbed motion

    OnsetRuns(const MonteCarloSettings& settings, int dof, bool gives_way)
        : MonteCarloRuns(settings, dof, gives_way),
          max_distance(offset.size()),
          distance(offset.size()),
          undetected_distance(offset.size()) {}
};

/// Samples single collisions of a trajectory: in run i contact begins at onset i. `record`: measured residuals, null
/// for Gaussian noise.
struct OnsetSampler {
    const ArmTrajectory& trajectory;
    const Onsets& onsets;
    const GaussianThresholds& detector;
    const Contact& contact;
    const MonteCarloSettings& settings;
    const ResidualRecord* record = nullptr;

    void run(std::size_t i, OnsetRuns& out) const {
        const double begin = onsets.time[i];
        const Point3<double> normal = onsets.normal_of(i);
        const CollisionSetup& setup = trajectory.setup();
        const auto propagator = trajectory.propagator(begin, normal, contact);
        const ContactPropagator* by = propagator ? &*propagator : nullptr;
        // That an alarm is certain with Gaussian noise does not make it so with measured residuals.
        const GaussianThresholds* certain = record != nullptr && by == nullptr ? nullptr : &detector;
        const StoppingCurve curve = trajectory.curve(begin, normal, certain, contact, by);
        // The tick of detection does not depend on the reactions; afterwards only the reaction to it is needed.
        ContactPaths paths;
        if (by != nullptr) paths = trajectory.contact_paths(curve, begin, normal, *by, trajectory.ticks());
        MonteCarlo<double>(setup, curve, detector, contact.at_body(), settings, record,
                           by != nullptr ? &paths : nullptr, by)
            .run(std::int64_t(i), std::int64_t(i) + 1, out);
        const int k = out.tick[i], period = setup.timing.period;
        out.max_distance[i] = k < 0 ? 0 : curve.max_distance[std::size_t(k)];
        int first = 0;
        while (first < curve.path.ticks && !(curve.path.at_tick(first, period) > 0)) ++first;
        out.distance[i] = k < 0 ? -1 : compression_at(curve.path, k, period, first);
        out.undetected_distance[i] = std::max(0.0, *std::max_element(curve.path.s.begin(), curve.path.s.end()));
        if (by == nullptr || k < 0) return;
        paths = trajectory.contact_paths(curve, begin, normal, *by, k);
        const ContactReactions reactions(paths, *by);
        const auto outcome = ContactCollision(reactions, first, 0.0).detected(k - first);
        out.peak_force[i] = outcome.peak;
        out.lasting_force[i] = outcome.lasting;
        out.duration[i] = outcome.duration;
    }
};

/// One collision for each onset, of which there are as many as runs.
inline OnsetRuns monte_carlo_onsets(const OnsetSampler& sampler) {
    OnsetRuns out(sampler.settings, sampler.trajectory.dof(),
                  sampler.trajectory.setup().arm || sampler.contact.system());
    constexpr std::size_t block = 256;
    std::atomic<std::size_t> next{0};
    const std::size_t count = sampler.onsets.count;
    work_in_threads(sampler.settings.threads, [&] {
        for (std::size_t first = block * next++; first < count; first = block * next++)
            for (std::size_t i = first; i < std::min(count, first + block); ++i) sampler.run(i, out);
    });
    return out;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
