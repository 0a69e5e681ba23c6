// A detector on a controller of Universal Robots: reads its samples over RTDE, tells alarms, and answers them over the
// same connection. HOST PORT DETECTOR, and `stop` or `reverse` where it shall answer. It ends when the controller closes
// the connection. The program counts what is allocated, to show that the loop allocates nothing.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <new>
#include <string>

#include "bumpstop/detection/detector_description.hpp"
#include "rtde_client.hpp"

static std::atomic<long> allocations{0};
// Not inlined: gcc would see malloc and delete, or new and free, and call them mismatched.
[[gnu::noinline]] void* operator new(std::size_t size) {
    ++allocations;
    if (void* found = std::malloc(size)) return found;
    throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* what) noexcept { std::free(what); }
[[gnu::noinline]] void operator delete(void* what, std::size_t) noexcept { std::free(what); }

int main(int count, char** arguments) {
    if (count < 4) {
        std::fprintf(stderr, "error: wanted HOST PORT DETECTOR [stop|reverse]\n");
        return 2;
    }
    const std::string wanted = count > 4 ? arguments[4] : "";
    const int reaction = wanted == "stop" ? 1 : wanted == "reverse" ? 2 : 0;
    std::ifstream file(arguments[3]);
    std::string error;
    const auto description = bumpstop::read_detector(file, error);
    if (!description) {
        std::fprintf(stderr, "error: %s\n", error.c_str());
        return 2;
    }
    static bumpstop::Detector detector = description->detector();
    const bool torque = detector.settings().source == bumpstop::TorqueSource::torque;
    const double period = detector.settings().samples.period, frequency = std::min(500.0, 1 / period);
    if (1 / frequency > 1.1 * period) {
        std::fprintf(stderr, "error: a controller gives 500 samples a second, the detector takes %g\n", 1 / period);
        return 2;
    }
    if (detector.joints() < RtdeClient::controller_joints) {
        std::fprintf(stderr, "error: RTDE carries six joints, the detector has %d\n", detector.joints());
        return 2;
    }
    if (detector.settings().samples.measured_rates && detector.joints() > RtdeClient::controller_joints) {
        std::fprintf(stderr, "error: joints in registers have no speeds, and the detector takes measured ones\n");
        return 2;
    }
    // The controller's six are joints 1 to 6 here. Of a robot on a rail they are 2 to 7, and would be crossed.
    for (int j = 0; j < RtdeClient::controller_joints; ++j)
        if (description->robot.joints[j].spec.prismatic) {
            std::fprintf(stderr, "error: joint %d slides, and all six of a controller turn\n", j + 1);
            return 2;
        }
    static RtdeClient client;
    if (!client.open(arguments[1], arguments[2], detector.joints(), torque, frequency, error)) {
        std::fprintf(stderr, "error: %s\n", error.c_str());
        return 2;
    }
    std::array<double, bumpstop::max_joints> sum{};
    double largest = 0;
    long samples = 0, damaged = 0, judged = 0;
    bumpstop::DetectorSample sample;
    std::fflush(stdout);
    const long before = allocations;
    long told = 0, alarms = 0;
    for (;;) {
        const RtdeRead found = client.read(sample, 100);
        if (found == RtdeRead::lost) break;
        damaged += found == RtdeRead::damaged;
        if (found != RtdeRead::sample) continue;  // where nothing comes at all, `detector.overdue(now)` says so
        ++samples;
        const bumpstop::DetectorOutput& out = detector.update(sample);
        if (out.state != bumpstop::DetectorState::no_data) {
            ++judged;
            for (int j = 0; j < detector.joints(); ++j) {
                sum[j] += out.residual[j];
                largest = std::max(largest, std::fabs(out.residual[j]));
            }
        }
        if (detector.events() == told) continue;
        told = detector.events();
        ++alarms;
        if (reaction) client.answer(reaction, int(alarms));
        const bumpstop::DetectorEvent& event = detector.event();
        std::printf("alarm at %.6f s: %.17g N\n", event.t, event.contact.force_along);
    }
    const long in_loop = allocations - before;
    std::printf("%ld samples, %ld judged, %ld damaged, %ld alarms\n", samples, judged, damaged, alarms);
    std::printf("largest residual %.17g Nm, means", largest);
    for (int j = 0; j < detector.joints(); ++j) std::printf(" %.17g", sum[j] / double(std::max(judged, 1L)));
    std::printf("\n%ld allocations in the loop\n", in_loop);
}
