// Derivatives of sampled positions, and the zero-phase filter.
#include "bumpstop/model/chain.hpp"
#include "bumpstop/signal/causal_derivative.hpp"
#include "bumpstop/signal/zero_phase.hpp"
#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

nb::tuple causal_derivatives(Vector t, Matrix q, int window, int degree) {
    const std::size_t rows = q.shape(0), columns = q.shape(1);
    NewArray<double> rate({rows, columns}), acceleration({rows, columns});
    {
        nb::gil_scoped_release unlocked;
        for (std::size_t first = 0; first < columns; first += max_joints) {
            const std::size_t count = std::min(columns - first, std::size_t(max_joints));
            CausalDerivative<max_joints> derivative(window, degree, int(count));
            double position[max_joints] = {};
            for (std::size_t i = 0; i < rows; ++i) {
                const std::size_t at = i * columns + first;
                std::copy_n(q.data() + at, count, position);
                derivative.update(t(i), position);
                std::copy_n(derivative.rate(), count, &rate.data[at]);
                std::copy_n(derivative.acceleration(), count, &acceleration.data[at]);
            }
        }
    }
    return nb::make_tuple(rate.release(), acceleration.release());
}

nb::tuple local_polynomial(Vector t, Matrix q, double window, int degree) {
    const std::size_t rows = q.shape(0), columns = q.shape(1);
    NewArray<double> position({rows, columns}), rate({rows, columns}), acceleration({rows, columns});
    {
        nb::gil_scoped_release unlocked;
        local_derivatives(t.data(), q.data(), rows, columns, window, degree,
                          {position.data.get(), rate.data.get(), acceleration.data.get()});
    }
    return nb::make_tuple(position.release(), rate.release(), acceleration.release());
}

// Passes what lies below the cut-off of columns (N, k), evenly sampled at `rate`.
NewArray<double>::Array zero_phase_lowpass(Matrix x, int order, double cutoff, double rate, std::size_t padding) {
    NewArray<double> filtered({x.shape(0), x.shape(1)});
    {
        nb::gil_scoped_release unlocked;
        filter_zero_phase(butterworth(order, cutoff, rate), x.data(), x.shape(0), x.shape(1), padding,
                          filtered.data.get());
    }
    return filtered.release();
}

}  // namespace

void bind_signal(nb::module_& module) {
    module.attr("max_fit_degree") = max_fit_degree;
    module.attr("max_causal_window") = max_window_samples;
    module.def("window_samples", &window_samples, nb::arg("time"), nb::arg("period"), nb::arg("degree"),
               "Samples of a window in a control loop.");
    module.def("causal_derivatives", &causal_derivatives, nb::arg("t"), nb::arg("q"), nb::arg("window"),
               nb::arg("degree"), "Rates and accelerations (N, n) from the samples up to each row.");
    module.def("local_polynomial", &local_polynomial, nb::arg("t"), nb::arg("q"), nb::arg("window"), nb::arg("degree"),
               "Smoothed positions, rates and accelerations (N, n) from the samples on both sides of each row.");
    module.attr("max_filter_order") = max_filter_order;
    module.def("zero_phase_lowpass", &zero_phase_lowpass, nb::arg("x"), nb::arg("order"), nb::arg("cutoff"),
               nb::arg("rate"), nb::arg("padding"),
               "Columns (N, k) after Butterworth's low-pass, forward and backward, reflected beyond the ends.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
