// Reads the text of a robot or of a detector as a loop in C++ does, and lets the detector take samples.
#include <algorithm>
#include <cstddef>
#include <sstream>
#include <string>

#include "bumpstop/detection/detector_description.hpp"

namespace {

void take_samples(bumpstop::Detector&& detector, double period) {
    bumpstop::DetectorSample sample;
    for (int k = 0; k < 12; ++k) {
        sample.t = k * period;
        for (int j = 0; j < detector.joints(); ++j) {
            sample.q[j] = 0.01 * k * j;
            sample.signal[j] = 10.0 * k;
        }
        detector.update(sample);
    }
}

}  // namespace

/// Whether the text is a robot's or a detector's; the message of the refusal is copied into `message`, with its end.
extern "C" bool read_text(const char* text, std::size_t size, bool is_detector, char* message, std::size_t room) {
    std::istringstream in(std::string(text, size));
    std::string error;
    bool read = false;
    if (is_detector) {
        if (const auto found = bumpstop::read_detector(in, error)) {
            take_samples(found->detector(), found->settings.samples.period);
            read = true;
        }
    } else if (const auto found = bumpstop::read_robot(in, error)) {
        read = found->chain().dof > 0;
    }
    error.copy(message, room - 1);
    message[std::min(error.size(), room - 1)] = 0;
    return read;
}
