// A control loop: a detector from the file that `bumpstop detector` wrote, fed with a recording as CSV (t, then q and the
// signal of every joint, then the speed of every joint where the detector takes measured ones). With `paced` behind them it waits for the time of every sample, as a loop at 1 kHz does, and
// tells its longest update; without, it takes one after the other.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "bumpstop/detection/detector_description.hpp"

/// Samples of a recording; those of a detector that takes measured speeds end before the first row without them.
static std::vector<bumpstop::DetectorSample> read_samples(const char* path, int joints, bool speeds, bool& complete) {
    std::vector<bumpstop::DetectorSample> samples;
    std::ifstream file(path);
    std::string line;
    std::getline(file, line);  // the header
    complete = true;
    while (std::getline(file, line)) {
        bumpstop::DetectorSample sample;
        const char* at = line.c_str();
        bool found = true;
        const auto number = [&] {
            char* end = nullptr;
            const double value = std::strtod(at, &end);
            found = end != at;
            at = *end == ',' ? end + 1 : end;
            return found ? value : std::nan("");  // an empty cell is no zero
        };
        sample.t = number();
        for (int j = 0; j < joints; ++j) sample.q[j] = number();
        for (int j = 0; j < joints; ++j) sample.signal[j] = number();
        for (int j = 0; j < joints && speeds; ++j) sample.qd[j] = number();
        complete = found || !speeds;
        if (!complete) break;
        samples.push_back(sample);
    }
    return samples;
}

int main(int count, char** arguments) {
    if (count < 3) {
        std::fprintf(stderr, "error: wanted a detector and a recording\n");
        return 2;
    }
    std::ifstream file(arguments[1]);
    std::string error;
    const auto description = bumpstop::read_detector(file, error);
    if (!description) {
        std::fprintf(stderr, "error: %s\n", error.c_str());
        return 2;
    }
    using Clock = std::chrono::steady_clock;
    using Seconds = std::chrono::duration<double>;
    const bool paced = count > 3 && std::string(arguments[3]) == "paced";
    bumpstop::Detector detector = description->detector();
    const bool speeds = detector.settings().samples.measured_rates;
    bool complete = false;
    const auto samples = read_samples(arguments[2], detector.joints(), speeds, complete);
    if (!complete) {
        std::fprintf(stderr, "error: row %zu has no speeds of the joints, and the detector takes measured ones\n",
                     samples.size() + 1);
        return 2;
    }
    double largest = 0, longest = 0;
    const Clock::time_point begin = Clock::now();
    // From here on nothing allocates.
    for (const bumpstop::DetectorSample& sample : samples) {
        if (paced && std::isfinite(sample.t))
            std::this_thread::sleep_until(
                begin + std::chrono::duration_cast<Clock::duration>(Seconds(sample.t - samples.front().t)));
        const bool before = detector.alarmed();
        const Clock::time_point sampled = Clock::now();
        const bumpstop::DetectorOutput& out = detector.update(sample);
        longest = std::max(longest, Seconds(Clock::now() - sampled).count());
        if (out.state != bumpstop::DetectorState::no_data)
            for (int j = 0; j < detector.joints(); ++j) largest = std::max(largest, std::fabs(out.residual[j]));
        if (before || !detector.alarmed()) continue;
        // Here the loop would stop the arm.
        const bumpstop::DetectorEvent& event = detector.event();
        std::printf("alarm at %.6f s: joints", event.t);
        for (int j = 0; j < detector.joints(); ++j)
            if ((event.over | event.over_fast) >> j & 1) std::printf(" %d", j + 1);
        std::printf(", %.6f N, likeliest on %s\n", event.contact.force_along,
                    event.contact.link < 0 ? "no link" : description->robot.joints[event.contact.link].link.c_str());
    }
    if (paced) std::printf("longest update %.1f us\n", 1e6 * longest);
    std::printf("largest residual %.12f Nm\n", largest);
}
