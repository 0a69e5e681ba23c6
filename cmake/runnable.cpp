// Prints which instruction sets the building machine runs, for cmake.
#include <cstdio>

#include "../bindings/cpu.hpp"

int main() {
    for (const std::string& target : bumpstop::supported_targets()) std::printf("%s;", target.c_str());
}
