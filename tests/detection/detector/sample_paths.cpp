// The detector in the loop: no sequence of samples breaks it, and nothing is allocated.
#include <cstdlib>
#include <new>

#include "detection/detector/random_detector.hpp"

static long allocations = 0;
// Not inlined: gcc would pair one side of an allocation with the other's malloc.
[[gnu::noinline]] void* operator new(std::size_t size) {
    ++allocations;
    if (void* p = std::malloc(size)) return p;
    std::abort();
}
[[gnu::noinline]] void operator delete(void* p) noexcept { std::free(p); }
[[gnu::noinline]] void operator delete(void* p, std::size_t) noexcept { std::free(p); }

using namespace bumpstop;

namespace {

using namespace random_detector;

// Any order, gaps, repeats, infinities, jumps: a finite residual or no data, never neither; and memory stays.
void no_sequence_breaks_it(long sequences) {
    std::vector<Arm> arms;
    for (int k = 0; k < 14; ++k) {
        arms.emplace_back(1 + k % 8);
        DetectorSettings& s = arms.back().settings;
        s.residual = k % 2 ? ResidualKind::observer : ResidualKind::direct;
        s.source = k % 3 == 2 ? TorqueSource::torque : TorqueSource::current;
        s.samples.measured_rates = k % 4 == 3;
        s.alarm.arming_delay = k % 5 == 0 ? 0.003 : 0;
        s.alarm.thresholds.model_errors = k % 3;
        s.window = 0.001 * (2 + k % 6);
        s.samples.unmonitored = k % 3 == 1 ? 2 : 0;
        s.samples.endless = k % 4 == 2 ? 1 : 0;
        s.samples.frozen_time = k % 5 == 3 ? inf : 0.004;
        s.payload_monitor.min_mass = k % 2;
        s.payload_monitor.interval = 0;
        if (k >= 12) arms.back().fit();
        // Without limits everything finite is possible, and only the arithmetic is left to refuse.
        if (k >= 9)
            for (int j = 0; j < max_joints; ++j) {
                s.samples.lower[j] = -inf;
                s.samples.upper[j] = s.samples.velocity[j] = s.samples.signal[j] = inf;
            }
    }
    std::vector<Detector> detectors;
    for (const Arm& arm : arms) detectors.push_back(arm.detector());
    const double odd[] = {nan_, inf, -inf, 0, -0.0, 1e308, -1e308, 5e-324, 1e-300, 1e17};
    const auto spoil = [&](double x) {
        const double u = checks::uniform(0, 1);
        if (u < 0.94) return x;
        return u < 0.97 ? odd[int(checks::uniform(0, 10))] : x + checks::normal();
    };
    long alarms = 0, no_data = 0, seen = 0, frozen = 0;
    const long before = allocations;
    for (long sequence = 0; sequence < sequences; ++sequence) {
        const std::size_t k = std::size_t(sequence) % detectors.size();
        Detector& detector = detectors[k];
        const int n = detector.joints();
        detector.reset();
        double t = checks::uniform(-1, 1);
        const bool wild = sequence % 3 == 0, repeats = sequence % 5 == 0;
        DetectorSample last;
        for (int i = 0; i < 24; ++i) {
            DetectorSample sample;
            const double u = checks::uniform(0, 1);
            t += u < 0.9 ? 0.001 : u < 0.93 ? 0 : u < 0.96 ? -0.002 : checks::uniform(0, 0.02);
            sample.t = wild ? spoil(t) : t;
            for (int j = 0; j < n; ++j) {
                sample.q[j] = std::sin(t + j);
                sample.signal[j] = 3 * checks::normal();
                sample.qd[j] = std::cos(t + j);
                if (!wild) continue;
                sample.q[j] = spoil(sample.q[j]);
                sample.signal[j] = spoil(sample.signal[j]);
                sample.qd[j] = spoil(sample.qd[j]);
            }
            if (repeats && i > 0 && checks::uniform(0, 1) < 0.6) {
                sample = last;
                sample.t = t;
            }
            last = sample;
            const bool alarmed = detector.alarmed();
            const DetectorOutput& out = detector.update(sample);
            if (out.state == DetectorState::no_data) {
                ++no_data;
                CHECK(out.stop && out.fault != SampleFault::none);
                for (int j = 0; j < n; ++j) CHECK(std::isnan(out.residual[j]));
            } else {
                ++seen;
                CHECK(out.fault == SampleFault::none);
                for (int j = 0; j < n; ++j) CHECK(std::isfinite(out.residual[j]) && !std::isnan(out.threshold[j]));
            }
            CHECK(!alarmed || detector.alarmed());
            CHECK(!detector.alarmed() || out.stop);
            frozen += out.fault == SampleFault::frozen;
            const DetectorEvent& event = detector.event();
            if (detector.alarmed() && (out.over | out.over_fast) != 0)
                CHECK(event.span.begin == event.t && event.span.end >= event.t && event.span.largest_share >= 0);
            if (detector.alarmed() && !alarmed) {
                ++alarms;
                CHECK((detector.event().over | detector.event().over_fast) != 0);
            }
            if (i % 7 == 6) detector.acknowledge();
            if (i == 11) detector.set_payload({0.5, {0, 0, 0.1}});
        }
        CHECK(detector.overdue(nan_) && detector.overdue(inf));
    }
    CHECK(allocations == before);
    CHECK(alarms > sequences / 100 && no_data > 0 && seen > no_data / 10 && frozen > 0);
}

}  // namespace

int main(int count, char** arguments) {
    no_sequence_breaks_it(count > 1 ? std::atol(arguments[1]) : 600);
    return checks::result();
}
