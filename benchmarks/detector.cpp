// Time of a full tick of the detector for seven joints of a general chain: guard, derivatives, friction map,
// Newton-Euler, fast channel, thresholds. Every tick is timed by itself; the clock's own time is in it. Prints
// median, 99.9 % and the worst [ns] of a million ticks and the mean without the clock: of the direct residual, of the
// observer, and of the direct residual at uneven times, whose derivatives want new weights at every tick.
#include "bumpstop/detection/detector.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>

using namespace bumpstop;
using Clock = std::chrono::steady_clock;

static Detector seven_joints(ResidualKind residual) {
    constexpr int dof = 7;
    std::array<JointSpec, dof> specs{};
    std::array<LinkInertia, dof> links{};
    std::array<JointTorqueParameters, dof> joints{};
    std::array<JointTorqueErrors, dof> errors{};
    DetectorSettings settings;
    settings.residual = residual;
    settings.samples = {};
    settings.samples.period = 0.001;
    settings.samples.shortest_interval = 1e-4;
    settings.samples.late_interval = 0.0015;
    settings.samples.longest_interval = 0.005;
    for (int i = 0; i < dof; ++i) {
        // The arm of dynamics.cpp: no zero in it, so that nothing is spared by special geometry.
        const double a = 0.3 + 0.9 * i, b = 0.7 + 1.3 * i;
        specs[i].origin = {0.05 + 0.02 * i, 0.03 * (i % 3) - 0.02, 0.2 - 0.01 * i};
        specs[i].axis = {std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a)};
        links[i].mass = 5 - 0.6 * i;
        links[i].center = {0.01 + 0.01 * i, 0.02 - 0.015 * i, 0.1 - 0.01 * i};
        links[i].tensor = {0.05, 0.004, -0.003, 0.004, 0.06, 0.005, -0.003, 0.005, 0.03};
        joints[i].B = 10;
        joints[i].A = 0.1;
        joints[i].D = 1;
        joints[i].F = 0.3;
        joints[i].hysteresis = 1;
        joints[i].inertia = 0.1;
        settings.samples.lower[i] = -3;
        settings.samples.upper[i] = 3;
        settings.samples.velocity[i] = 3;
        settings.samples.signal[i] = 1e3;
        settings.noise_sd[i] = 1;
        settings.decision.thresholds.constant[i] = 1e6;
        settings.decision.thresholds.fast[i] = 1e6;
        settings.decision.thresholds.rest_speed[i] = 0.01;
        settings.decision.thresholds.speed[i] = settings.decision.thresholds.acceleration[i] = 0.1;
    }
    return Detector(Chain(specs), links, joints, errors, settings);
}

static void fill(DetectorSample& sample, long tick, bool uneven) {
    sample.t = 0.001 * double(tick) + (uneven ? 1e-4 * double(tick % 3) : 0.0);
    for (int j = 0; j < 7; ++j) {
        sample.q[j] = std::sin(sample.t * (0.5 + 0.1 * j) + j);
        sample.signal[j] = std::cos(3 * sample.t + j);
    }
}

static void measure(ResidualKind residual, bool uneven, double* out) {
    constexpr long ticks = 1'000'000;
    const auto detector = std::make_unique<Detector>(seven_joints(residual));
    std::vector<double> took(ticks);
    DetectorSample sample;
    double sink = 0;
    for (long i = -1000; i < ticks; ++i) {
        fill(sample, i, uneven);
        const auto begin = Clock::now();
        const DetectorOutput& state = detector->update(sample);
        const auto end = Clock::now();
        sink += state.residual[0];
        if (i >= 0) took[std::size_t(i)] = double(std::chrono::nanoseconds(end - begin).count());
    }
    std::sort(took.begin(), took.end());
    out[0] = took[ticks / 2];
    out[1] = took[ticks - ticks / 1000];
    out[2] = took[ticks - 1];
    std::array<DetectorSample, 64> samples;
    double best = 1e300;
    for (int repeat = 0; repeat < 2000; ++repeat) {
        for (int k = 0; k < 64; ++k) fill(samples[std::size_t(k)], ticks + 64 * repeat + k, uneven);
        const auto begin = Clock::now();
        for (const DetectorSample& one : samples) sink += detector->update(one).residual[0];
        best = std::min(best, std::chrono::duration<double>(Clock::now() - begin).count() / 64);
    }
    out[3] = best * 1e9;
    volatile double kept = sink;
    (void)kept;
}

int main() {
    double out[3][4];
    measure(ResidualKind::direct, false, out[0]);
    measure(ResidualKind::observer, false, out[1]);
    measure(ResidualKind::direct, true, out[2]);
    for (const auto& row : out)
        for (const double time : row) std::printf("%.1f ", time);
    std::printf("\n");
}
