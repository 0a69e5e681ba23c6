// Laws of many poses at once, and what runs draw.
#include "bumpstop/collision/batch.hpp"

#include "bumpstop/collision/distribution/monte_carlo.hpp"
#include "interrupt.hpp"
#include "setup.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

nb::dict batch(const Setup& setup, Matrix q, Matrix velocity, const GaussianThresholds& detector, double stiffness,
               const std::string& offset_kind, double offset_size, Vector probability, Vector limit, int threads) {
    const std::size_t n = q.shape(0), dof = std::size_t(setup.chain.dof);
    const std::size_t probabilities = probability.shape(0), limits = limit.shape(0);
    NewArray<double> mean({n}), sd({n}), quantile({n, probabilities}), exceedance({n, limits}), trigger({n, dof});
    NewArray<double> false_alarm({n}), undetected({n}), no_contact({n});
    NewArray<std::uint8_t> end({n});
    {
        const Unlocked unlocked;
        const BatchProblem problem{&setup.chain,       &setup.motion,
                                   &setup.contact,     &setup.timing,
                                   setup.reaction,     &detector,
                                   stiffness,          offset_distribution(offset_kind, 0).kind,
                                   offset_size,        int(n),
                                   q.data(),           velocity.data(),
                                   int(probabilities), probability.data(),
                                   int(limits),        limit.data()};
        evaluate_batch<L>(
            problem, threads,
            {mean.data.get(), sd.data.get(), quantile.data.get(), exceedance.data.get(), trigger.data.get(),
             false_alarm.data.get(), undetected.data.get(), no_contact.data.get(), end.data.get()});
    }
    nb::dict out;
    out["mean"] = mean.release();
    out["sd"] = sd.release();
    out["quantile"] = quantile.release();
    out["exceedance"] = exceedance.release();
    out["trigger"] = trigger.release();
    out["false_alarm"] = false_alarm.release();
    out["undetected"] = undetected.release();
    out["no_contact"] = no_contact.release();
    out["end"] = end.release();
    return out;
}

}  // namespace

void bind_batch(nb::module_& module) {
    module.def("batch", &batch, nb::arg("setup"), nb::arg("q"), nb::arg("velocity"), nb::arg("detector"),
               nb::arg("stiffness"), nb::arg("offset_kind"), nb::arg("offset_size"), nb::arg("probability"),
               nb::arg("limit"), nb::arg("threads"));
    module.def(
        "residual_rows",
        [](std::uint64_t seed, std::int64_t run, std::int64_t ticks, std::int64_t rows, std::int64_t block_rows) {
            const ResidualRecord record{nullptr, rows, 0, block_rows};
            NewArray<std::int64_t> out({std::size_t(ticks)});
            for (std::int64_t k = 0; k < ticks; ++k) out.data[k] = record.row_of(seed, run, k);
            return out.release();
        },
        nb::arg("seed"), nb::arg("run"), nb::arg("ticks"), nb::arg("rows"), nb::arg("block_rows"),
        "The rows of a record of residuals that play the ticks of a run.");
    module.def(
        "offsets",
        [](std::uint64_t seed, std::int64_t first_run, std::size_t runs, const std::string& kind, double size) {
            NewArray<double> out({runs});
            for (std::size_t i = 0; i < runs; ++i)
                out.data[i] = draw_offset<double>(offset_distribution(kind, size), seed, first_run + std::int64_t(i));
            return out.release();
        },
        nb::arg("seed"), nb::arg("first_run"), nb::arg("runs"), nb::arg("kind"), nb::arg("size"));
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
