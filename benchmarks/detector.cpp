// Time of a full tick of the detector for seven joints of a general chain: guard, derivatives, friction map,
// Newton-Euler, fast channel, thresholds. Every tick is timed by itself; the clock's own time is in it.
//
// What is rare at one tick in a thousand is the machine's: interrupts, other programs on the core and beside it, caches
// that they empty. Four means tell it from the tick. A million ticks are measured five times. Times are counted in a
// histogram of a few cache lines, as a list of a million would empty caches itself. Between the ticks an arithmetic of
// about their length that touches no memory, and nothing at all, are timed in the same way: they show what interrupts
// and lost cores cost, but not emptied caches, and what the clock costs. And the first ticks are repeated: of every
// tick the least of five is its own time, whatever the machine did meanwhile.
//
// Prints, of the direct residual, of the observer, and of the direct residual at uneven times, whose derivatives want
// new weights at every tick [ns]: least median of the five, then least, middle and largest 99.9 %, the worst of all, the
// mean without the clock, median and middle 99.9 % of the arithmetic and of nothing, and of the ticks' own times the
// 99.9 % and the largest.
#include "bumpstop/detection/detector.hpp"

#include <algorithm>
#include <chrono>
#include <cstdint>
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
        settings.alarm.thresholds.constant[i] = 1e6;
        settings.alarm.thresholds.fast[i] = 1e6;
        settings.alarm.thresholds.rest_speed[i] = 0.01;
        settings.alarm.thresholds.speed[i] = settings.alarm.thresholds.acceleration[i] = 0.1;
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

constexpr long ticks = 1'000'000, own_ticks = 100'000;
constexpr int repeats = 5;
constexpr int figures = 12;

// Counts of times, in nanoseconds.
class Histogram {
  public:
    void add(double time) noexcept {
        ++count_[std::size_t(std::min(time, double(last)))];
        worst_ = std::max(worst_, time);
    }
    // The time that a share of all is not below; beyond the last one counted, the worst.
    double upper(double share) const noexcept {
        long above = 0, all = 0;
        for (const std::uint32_t count : count_) all += count;
        for (int time = last; time >= 0; --time)
            if ((above += count_[std::size_t(time)]) > share * double(all)) return time == last ? worst_ : time;
        return 0;
    }
    double worst() const noexcept { return worst_; }

  private:
    static constexpr int last = 1 << 16;
    std::vector<std::uint32_t> count_ = std::vector<std::uint32_t>(last + 1);
    double worst_ = 0;
};

// Some 250 ns of additions and multiplications that wait for each other.
static double arithmetic(double x) {
    for (int i = 0; i < 190; ++i) x = x * 0.999 + 1e-3;
    return x;
}

static double since(Clock::time_point begin) { return double(std::chrono::nanoseconds(Clock::now() - begin).count()); }

// What all that is measured flows into, so that none of it is left out.
static volatile double kept = 0;

struct Times {
    Histogram tick, plain, clock;
};

static Times spread(Detector& detector, bool uneven) {
    Times times;
    DetectorSample sample;
    double sink = 0, x = 0.5;
    detector.reset();
    for (long i = -1000; i < ticks; ++i) {
        fill(sample, i, uneven);
        auto begin = Clock::now();
        sink += detector.update(sample).residual[0];
        const double of_tick = since(begin);
        begin = Clock::now();
        kept = x = arithmetic(x);
        const double of_plain = since(begin);
        begin = Clock::now();
        const double of_clock = since(begin);
        if (i < 0) continue;
        times.tick.add(of_tick);
        times.plain.add(of_plain);
        times.clock.add(of_clock);
    }
    kept = sink;
    return times;
}

// Of every tick the least time of several repetitions.
static Histogram own_times(Detector& detector, bool uneven) {
    std::vector<double> least(own_ticks, 1e300);
    DetectorSample sample;
    double sink = 0;
    for (int repeat = 0; repeat < repeats; ++repeat) {
        detector.reset();
        for (long i = -1000; i < own_ticks; ++i) {
            fill(sample, i, uneven);
            const auto begin = Clock::now();
            sink += detector.update(sample).residual[0];
            const double took = since(begin);
            if (i >= 0) least[std::size_t(i)] = std::min(least[std::size_t(i)], took);
        }
    }
    kept = sink;
    Histogram own;
    for (const double time : least) own.add(time);
    return own;
}

// The least mean of a few ticks without a look at the clock between them.
static double without_clock(Detector& detector, bool uneven) {
    std::array<DetectorSample, 64> samples;
    double best = 1e300, sink = 0;
    for (int repeat = 0; repeat < 2000; ++repeat) {
        for (int k = 0; k < 64; ++k) fill(samples[std::size_t(k)], ticks + 64 * repeat + k, uneven);
        const auto begin = Clock::now();
        for (const DetectorSample& one : samples) sink += detector.update(one).residual[0];
        const double mean = since(begin) / 64;
        // These samples come after a gap in time: at first they only fill the window, of 71.
        if (repeat > 1) best = std::min(best, mean);
    }
    kept = sink;
    return best;
}

static void measure(ResidualKind residual, bool uneven) {
    const auto detector = std::make_unique<Detector>(seven_joints(residual));
    constexpr double rare = 1e-3;
    std::array<std::array<double, repeats>, 6> found;
    double worst = 0;
    for (std::size_t repeat = 0; repeat < repeats; ++repeat) {
        const Times times = spread(*detector, uneven);
        std::size_t at = 0;
        for (const Histogram* one : {&times.tick, &times.plain, &times.clock}) {
            found[at++][repeat] = one->upper(0.5);
            found[at++][repeat] = one->upper(rare);
        }
        worst = std::max(worst, times.tick.worst());
    }
    for (auto& one : found) std::sort(one.begin(), one.end());
    const Histogram own = own_times(*detector, uneven);
    constexpr int middle = repeats / 2;
    const double all[figures] = {found[0][0],
                                 found[1][0],
                                 found[1][middle],
                                 found[1].back(),
                                 worst,
                                 without_clock(*detector, uneven),
                                 found[2][middle],
                                 found[3][middle],
                                 found[4][middle],
                                 found[5][middle],
                                 own.upper(rare),
                                 own.worst()};
    for (const double time : all) std::printf("%.1f ", time);
}

int main() {
    measure(ResidualKind::direct, false);
    measure(ResidualKind::observer, false);
    measure(ResidualKind::direct, true);
    std::printf("\n");
}
