// Which instruction sets this processor runs.
#pragma once

#include <string>
#include <vector>

namespace bumpstop {

// Names of those that kernels may exist for, widest first.
inline std::vector<std::string> supported_targets() {
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

}  // namespace bumpstop
