// Asks the files compiled from instruction_set.cpp.
#include <cstdio>
#include <initializer_list>

const char* baseline();
const char* avx2();
const char* avx512();

int main() {
    for (const char* name : {baseline(), avx2(), avx512()}) std::puts(name);
}
