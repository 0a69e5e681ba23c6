// The zero-phase filter: lines pass, a sine keeps its phase and the gain of the formula, lanes equal doubles.
#include "bumpstop/signal/zero_phase.hpp"

#include "math/check.hpp"

using namespace bumpstop;

static constexpr double pi = std::numbers::pi;
static constexpr std::size_t padding = 15;

static std::vector<double> filtered(const std::vector<double>& x, std::size_t columns, int order, double cutoff,
                                    double rate) {
    std::vector<double> out(x.size());
    filter_zero_phase(butterworth(order, cutoff, rate), x.data(), x.size() / columns, columns, padding, out.data());
    return out;
}

// A straight line is reflected into itself, and the filter's state begins as if its first value had stood for ever: only
// what a steady slope adds to that dies away within the record. A constant passes at once.
static void constants_and_lines_pass() {
    for (int order = 1; order <= max_filter_order; ++order) {
        const std::vector<double> still = filtered(std::vector<double>(200, 3.0), 1, order, 30, 1000);
        for (double y : still) CHECK_NEAR(y, 3, 1e-9);
        std::vector<double> line(2000);
        for (std::size_t i = 0; i < line.size(); ++i) line[i] = 1e-3 * double(i);
        const std::vector<double> passed = filtered(line, 1, order, 30, 1000);
        for (std::size_t i = 500; i < 1500; ++i) CHECK_NEAR(passed[i], line[i], 1e-9);
    }
}

// Away from the ends: 1 / (1 + (tan(pi f / rate) / tan(pi cutoff / rate))^(2 order)) of the sine, not later.
static void sines_keep_their_phase() {
    for (int order = 1; order <= max_filter_order; ++order)
        for (double hertz : {5.0, 30.0, 45.0}) {
            std::vector<double> x(4000);
            for (std::size_t i = 0; i < x.size(); ++i) x[i] = std::sin(2 * pi * hertz * double(i) / 1000);
            const std::vector<double> y = filtered(x, 1, order, 30, 1000);
            const double gain = 1 / (1 + std::pow(std::tan(pi * hertz / 1000) / std::tan(pi * 30 / 1000), 2 * order));
            for (std::size_t i = 1500; i < 2500; ++i) CHECK_NEAR(y[i], gain * x[i], 1e-9);
        }
}

// A full register, a part of one, and a series alone: the same arithmetic.
static void lanes_equal_doubles() {
    for (std::size_t columns : {std::size_t(native_lanes), std::size_t(native_lanes) + 1}) {
        std::vector<double> x(columns * 60);
        for (double& v : x) v = checks::uniform(-1, 1);
        const std::vector<double> y = filtered(x, columns, 4, 20, 250);
        for (std::size_t j = 0; j < columns; ++j) {
            std::vector<double> alone(60);
            for (std::size_t i = 0; i < 60; ++i) alone[i] = x[i * columns + j];
            const std::vector<double> own = filtered(alone, 1, 4, 20, 250);
            for (std::size_t i = 0; i < 60; ++i) CHECK_NEAR(y[i * columns + j], own[i], 0);
        }
    }
}

int main() {
    constants_and_lines_pass();
    sines_keep_their_phase();
    lanes_equal_doubles();
    return checks::result();
}
