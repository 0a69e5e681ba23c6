// Elementary functions and random numbers, for the tests of their errors and for those who repeat a sampled
// run.
#include "bumpstop/collision/distribution/monte_carlo.hpp"
#include "bumpstop/math/functions.hpp"
#include "bumpstop/math/philox.hpp"
#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

// Applies a function of a register to an array, the last register padded with a copy of the last element.
template <class Function>
NewArray<double>::Array map(Vector x, Function function) {
    NewArray<double> out({x.shape(0)});
    const std::size_t n = x.shape(0);
    {
        nb::gil_scoped_release unlocked;
        for (std::size_t i = 0; i < n; i += native_lanes) {
            double buffer[native_lanes];
            for (int lane = 0; lane < native_lanes; ++lane) buffer[lane] = x.data()[std::min(i + lane, n - 1)];
            function(L::load(buffer)).store(buffer);
            for (int lane = 0; lane < native_lanes && i + lane < n; ++lane) out.data[i + lane] = buffer[lane];
        }
    }
    return out.release();
}

}  // namespace

void bind_math(nb::module_& module) {
    module.def(
        "sin", [](Vector x) { return map(x, [](L v) { return sincos(v).sin; }); }, nb::arg("x"));
    module.def(
        "cos", [](Vector x) { return map(x, [](L v) { return sincos(v).cos; }); }, nb::arg("x"));
    module.def(
        "erfc", [](Vector x) { return map(x, [](L v) { return erfc(v); }); }, nb::arg("x"));
    module.def(
        "log", [](Vector x) { return map(x, [](L v) { return log(v); }); }, nb::arg("x"));
    module.def(
        "normal_upper_quantile", [](Vector p) { return map(p, [](L v) { return normal_upper_quantile(v); }); },
        nb::arg("p"));
    module.def(
        "philox",
        [](Counters counters, std::uint64_t seed) {
            NewArray<std::int64_t> out({counters.shape(0), 4});
            for (std::size_t i = 0; i < counters.shape(0); ++i) {
                const std::int64_t* c = counters.data() + 4 * i;
                const auto block = philox(PhiloxBlock<IntLanes<native_lanes>>{{c[0], c[1], c[2], c[3]}}, seed);
                for (int w = 0; w < 4; ++w) out.data[4 * i + w] = block.word[w].v[native_lanes - 1];
            }
            return out.release();
        },
        nb::arg("counters"), nb::arg("seed"), "Philox4x32-10 of rows of four 32-bit words.");
    module.def(
        "standard_noise",
        [](std::uint64_t seed, std::int64_t first_run, std::size_t runs, std::size_t ticks, std::size_t dof) {
            NewArray<double> out({runs, ticks, dof});
            {
                nb::gil_scoped_release unlocked;
                for (std::size_t r = 0; r < runs; ++r)
                    for (std::size_t k = 0; k < ticks; ++k)
                        for (std::size_t j = 0; j < dof; ++j) {
                            const auto block = noise_block<std::int64_t>(seed, first_run + std::int64_t(r),
                                                                         std::int64_t(k), int(j / 2));
                            out.data[(r * ticks + k) * dof + j] =
                                signed_probability<double>(block, int(j % 2)).normal();
                        }
            }
            return out.release();
        },
        nb::arg("seed"), nb::arg("first_run"), nb::arg("runs"), nb::arg("ticks"), nb::arg("dof"),
        "Standard normal noise (runs, ticks, dof) of the Monte Carlo streams.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
