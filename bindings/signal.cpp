// Derivatives of sampled positions.
#include "bumpstop/signal/causal_derivative.hpp"
#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

nb::tuple causal_derivatives(Vector t, Matrix q, int window, int degree) {
    const std::size_t rows = q.shape(0), columns = q.shape(1);
    NewArray<double> rate({rows, columns}), acceleration({rows, columns});
    {
        nb::gil_scoped_release unlocked;
        for (std::size_t first = 0; first < columns; first += native_lanes) {
            const int count = int(std::min(columns - first, std::size_t(native_lanes)));
            CausalDerivative<L> derivative(window, degree);
            for (std::size_t i = 0; i < rows; ++i) {
                L position = 0.0;
                for (int lane = 0; lane < count; ++lane) set_lane(position, lane, q(i, first + lane));
                const CausalEstimate<L> estimate = derivative.update(t(i), position);
                for (int lane = 0; lane < count; ++lane) {
                    rate.data[i * columns + first + lane] = estimate.rate[lane];
                    acceleration.data[i * columns + first + lane] = estimate.acceleration[lane];
                }
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

}  // namespace

void bind_signal(nb::module_& module) {
    module.attr("max_fit_degree") = max_fit_degree;
    module.attr("max_causal_window") = CausalDerivative<double>::max_window;
    module.def("causal_derivatives", &causal_derivatives, nb::arg("t"), nb::arg("q"), nb::arg("window"),
               nb::arg("degree"), "Rates and accelerations (N, n) from the samples up to each row.");
    module.def("local_polynomial", &local_polynomial, nb::arg("t"), nb::arg("q"), nb::arg("window"), nb::arg("degree"),
               "Smoothed positions, rates and accelerations (N, n) from the samples on both sides of each row.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
