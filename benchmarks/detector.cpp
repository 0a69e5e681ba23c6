// Time of a full tick of the detector for seven joints of a general chain: guard, derivatives, friction map,
// Newton-Euler, fast channel, thresholds. Every tick is timed by itself; the clock's own time is in it.
//
// What is rare at one tick in a thousand is mostly the machine's: interrupts, other programs on the core, caches that
// they empty. Told apart from the tick by two means: a million ticks are measured five times, and between the ticks an
// arithmetic of about their length that touches no memory is timed in the same way. It shows what interrupts and lost
// cores cost, not emptied caches. Prints, of the direct residual, of the observer, and of the direct residual at uneven
// times, whose derivatives want new weights at every tick [ns]: least median of the five, then least, middle and largest
// 99.9 %, the worst of all, the mean without the clock, and median and middle 99.9 % of the arithmetic.
#include "bumpstop/detection/detector.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <vector>

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

constexpr long ticks = 1'000'000;
constexpr int repeats = 5;
constexpr int figures = 8;

struct Spread {
    double middle, rare, worst;
};

static Spread spread_of(std::vector<double>& took) {
    std::sort(took.begin(), took.end());
    return {took[ticks / 2], took[ticks - ticks / 1000], took[ticks - 1]};
}

// Some 290 ns of additions and multiplications that wait for each other.
static double arithmetic(double x) {
    for (int i = 0; i < 190; ++i) x = x * 0.999 + 1e-3;
    return x;
}

static double since(Clock::time_point begin) { return double(std::chrono::nanoseconds(Clock::now() - begin).count()); }

static void measure(ResidualKind residual, bool uneven, double* out) {
    std::vector<double> tick(ticks), plain(ticks);
    std::array<double, repeats> middle, rare, plain_middle, plain_rare;
    double worst = 0, sink = 0, x = 0.5;
    volatile double kept = 0;
    const auto detector = std::make_unique<Detector>(seven_joints(residual));
    DetectorSample sample;
    for (int repeat = 0; repeat < repeats; ++repeat) {
        detector->reset();
        for (long i = -1000; i < ticks; ++i) {
            fill(sample, i, uneven);
            auto begin = Clock::now();
            const DetectorOutput& state = detector->update(sample);
            const double of_tick = since(begin);
            sink += state.residual[0];
            begin = Clock::now();
            x = arithmetic(x);
            kept = x;
            const double of_plain = since(begin);
            if (i < 0) continue;
            tick[std::size_t(i)] = of_tick;
            plain[std::size_t(i)] = of_plain;
        }
        const Spread ours = spread_of(tick), theirs = spread_of(plain);
        const auto at = std::size_t(repeat);
        middle[at] = ours.middle;
        rare[at] = ours.rare;
        worst = std::max(worst, ours.worst);
        plain_middle[at] = theirs.middle;
        plain_rare[at] = theirs.rare;
    }
    for (auto* one : {&middle, &rare, &plain_middle, &plain_rare}) std::sort(one->begin(), one->end());
    std::array<DetectorSample, 64> samples;
    double best = 1e300;
    for (int repeat = 0; repeat < 2000; ++repeat) {
        for (int k = 0; k < 64; ++k) fill(samples[std::size_t(k)], ticks + 64 * repeat + k, uneven);
        const auto begin = Clock::now();
        for (const DetectorSample& one : samples) sink += detector->update(one).residual[0];
        best = std::min(best, since(begin) / 64);
    }
    kept = sink;
    (void)kept;
    const double all[figures] = {middle[0], rare[0], rare[repeats / 2], rare[repeats - 1],
                                 worst,     best,    plain_middle[0],   plain_rare[repeats / 2]};
    std::copy(all, all + figures, out);
}

int main() {
    double out[3][figures];
    measure(ResidualKind::direct, false, out[0]);
    measure(ResidualKind::observer, false, out[1]);
    measure(ResidualKind::direct, true, out[2]);
    for (const auto& row : out)
        for (const double time : row) std::printf("%.1f ", time);
    std::printf("\n");
}
