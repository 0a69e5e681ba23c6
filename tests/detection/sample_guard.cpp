// What the detector believes of a sample, up to the limits and beyond them.
#include "bumpstop/detection/sample_guard.hpp"

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
        SampleGuard guard(limits, 3);
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

int main() {
    a_sample_is_believed_up_to_its_limits();
    return checks::result();
}
