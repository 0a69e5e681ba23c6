// Which instruction sets this processor runs. A module of its own, built for the baseline, so that asking is
// safe.
#include "cpu.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

namespace nb = nanobind;

NB_MODULE(_cpu, module) {
    module.doc() = "Instruction sets of this processor.";
    module.def("supported_targets", &bumpstop::supported_targets,
               "Names of the instruction sets this processor runs that kernels may exist for, widest first.");
}
