// Which instruction sets this processor runs. A module of its own, built for the baseline, so that asking is
// safe.
#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

namespace nb = nanobind;

namespace {

std::vector<std::string> supported_targets() {
    std::vector<std::string> targets;
#if defined(__x86_64__) || defined(_M_X64)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
        targets.push_back("avx512");
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) targets.push_back("avx2");
    targets.push_back("baseline");
#elif defined(__aarch64__)
    targets.push_back("neon");
#else
    targets.push_back("baseline");
#endif
    return targets;
}

}  // namespace

NB_MODULE(_cpu, module) {
    module.doc() = "Instruction sets of this processor.";
    module.def("supported_targets", &supported_targets,
               "Names of the instruction sets this processor runs that kernels may exist for, widest first.");
}
