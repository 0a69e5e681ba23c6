// What the detector believes of a sample, up to the limits and beyond them.
#include "bumpstop/detection/sample_validator.hpp"

#include "math/check.hpp"

using namespace bumpstop;

// As far as a joint gets in the interval and the period before it, in which the sample may have been taken; no farther.
static void a_sample_is_believed_up_to_its_limits() {
    SampleLimits limits;
    limits.period = 0.01;
    limits.shortest_interval = 0.001;
    limits.late_interval = 0.015;
    limits.longest_interval = 0.05;
    limits.resolution = 0.002;
    limits.measured_rates = true;
    for (int j = 0; j < 3; ++j) {
        limits.lower[j] = -1;
        limits.upper[j] = 1;
        limits.velocity[j] = 2 + j;
        limits.signal[j] = 10;
    }
    const auto told = [&](double after, const auto& spoil) {
        SampleValidator guard(limits, 3);
        DetectorSample sample;
        CHECK(guard.check(sample) == SampleFault::gap);
        sample.t = after;
        spoil(sample);
        return guard.check(sample);
    };
    for (double after : {0.01, 0.03, 0.049})
        for (int j = 0; j < 3; ++j)
            for (double way : {-1.0, 1.0}) {
                const double reach = way * ((2 + j) * (after + 0.01) + 0.002);
                CHECK(told(after, [&](DetectorSample& s) { s.q[j] = 0.999 * reach; }) == SampleFault::none);
                CHECK(told(after, [&](DetectorSample& s) { s.q[j] = 1.001 * reach; }) == SampleFault::impossible_jump);
            }
    // Behind a gap nobody knows how far it went, but its limits and its rate are what they were.
    CHECK(told(0.051, [](DetectorSample& s) { s.q[0] = 0.999; }) == SampleFault::gap);
    CHECK(told(0.051, [](DetectorSample& s) { s.q[0] = 1.001; }) == SampleFault::outside_limits);
    CHECK(told(0.051, [](DetectorSample& s) { s.qd[0] = 2.001; }) == SampleFault::impossible_jump);
    CHECK(told(0.01, [](DetectorSample& s) { s.qd[2] = -4.001; }) == SampleFault::impossible_jump);
    CHECK(told(0.01, [](DetectorSample& s) { s.qd[2] = -3.999; }) == SampleFault::none);
    CHECK(told(0.01, [](DetectorSample& s) { s.signal[1] = -10.01; }) == SampleFault::impossible_signal);
    CHECK(told(0.0009, [](DetectorSample&) {}) == SampleFault::repeated);
    CHECK(told(-0.0009, [](DetectorSample&) {}) == SampleFault::out_of_order);
}

// Rows that repeat: at rest for a time and for five rows, in motion not at all, on coarse encoders as long as they may.
static void feedback_that_stands_still_is_frozen() {
    SampleLimits limits;
    limits.period = 0.01;
    limits.shortest_interval = 0.001;
    limits.late_interval = 0.015;
    limits.longest_interval = 0.05;
    limits.frozen_time = 0.1;
    for (int j = 0; j < 2; ++j) {
        limits.lower[j] = -9;
        limits.upper[j] = 9;
        limits.velocity[j] = 100;
        limits.signal[j] = 100;
    }
    const double rest[max_joints] = {};
    SampleValidator guard(limits, 2);
    DetectorSample sample;
    CHECK(guard.check(sample) == SampleFault::gap);
    for (int i = 1; i < 30; ++i) {
        sample.t = 0.01 * i;
        CHECK(guard.check(sample, {rest, 0.07}) == (i <= 10 ? SampleFault::none : SampleFault::frozen));
    }
    sample.t = 0.3;
    sample.signal[1] = 1;
    CHECK(guard.check(sample, {rest, 0.07}) == SampleFault::gap);
    // A pause in which nothing came is no repeat.
    sample.t = 1;
    CHECK(guard.check(sample, {rest, 0.07}) == SampleFault::gap);
    sample.t = 1.01;
    CHECK(guard.check(sample, {rest, 0.07}) == SampleFault::none);
    // Steps of 0.002 a row, then a row without one.
    for (double rate : {0.2, -0.2}) {
        const double moves[max_joints] = {0, rate};
        for (const bool known : {true, false}) {
            guard.reset();
            sample = {};
            for (int i = 0; i < 30; ++i) {
                sample.t = 0.01 * i;
                sample.q[1] += 0.01 * rate;
                CHECK(guard.check(sample, {moves, 0.07}) == (i ? SampleFault::none : SampleFault::gap));
            }
            sample.t += 0.01;
            const RecentMotion motion = known ? RecentMotion{moves, 0.07} : RecentMotion{};
            CHECK(guard.check(sample, motion) == (known ? SampleFault::frozen : SampleFault::none));
            // It is frozen until something changes, be it a signal.
            sample.t += 0.01;
            CHECK(guard.check(sample, {rest, 0.07}) == (known ? SampleFault::frozen : SampleFault::none));
            sample.t += 0.01;
            sample.signal[0] += 1;
            CHECK(guard.check(sample, {rest, 0.07}) == SampleFault::none);
        }
    }
}

// The signal of a joint that is not monitored may be anything; an endless one may jump by whole turns, but no farther.
static void joints_that_do_not_matter_take_no_data_away() {
    SampleLimits limits;
    limits.period = 0.01;
    limits.longest_interval = 0.05;
    limits.unmonitored = 2;
    limits.endless = 1;
    for (int j = 0; j < 2; ++j) {
        limits.lower[j] = -3;
        limits.upper[j] = 3;
        limits.velocity[j] = 2;
        limits.signal[j] = 10;
    }
    const double turn = 6.283185307179586, nan = std::nan("");
    const auto told = [&](double q0, double signal0, double signal1) {
        SampleValidator guard(limits, 2);
        DetectorSample sample;
        sample.q[0] = 3.1;
        CHECK(guard.check(sample) == SampleFault::gap);
        sample.t = 0.01;
        sample.q[0] = q0;
        sample.signal[0] = signal0;
        sample.signal[1] = signal1;
        const SampleFault fault = guard.check(sample);
        if (fault == SampleFault::none) {
            CHECK_NEAR(guard.position()[0], 3.1, 0.05);
            CHECK(std::isfinite(guard.signal()[1]));
        }
        return fault;
    };
    CHECK(told(3.11, 0, nan) == SampleFault::none);
    CHECK(told(3.11, 0, 1e9) == SampleFault::none);
    CHECK(told(3.11, nan, 0) == SampleFault::not_finite);
    CHECK(told(3.11, 11, 0) == SampleFault::impossible_signal);
    for (double k : {-3.0, -1.0, 1.0, 100.0}) CHECK(told(3.12 + k * turn, 0, 0) == SampleFault::none);
    CHECK(told(3.2 - turn, 0, 0) == SampleFault::impossible_jump);
    CHECK(told(1e7, 0, 0) == SampleFault::outside_limits);
}

int main() {
    feedback_that_stands_still_is_frozen();
    joints_that_do_not_matter_take_no_data_away();
    a_sample_is_believed_up_to_its_limits();
    return checks::result();
}
