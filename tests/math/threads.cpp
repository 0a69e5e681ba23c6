// Work in threads ends with all of it done, whether or not there is memory for so many.
#include <sys/resource.h>

#include <atomic>
#include <stdexcept>

#include "bumpstop/math/interruption.hpp"
#include "math/check.hpp"

namespace {

// Blocks of work that were done, each once.
int done_in_threads(int threads) {
    std::atomic<int> next{0}, done{0};
    bumpstop::work_in_threads(threads, [&] {
        while (next++ < 1000) ++done;
    });
    return done;
}

}  // namespace

int main() {
    CHECK(done_in_threads(1) == 1000);  // one thread does all work
    CHECK(done_in_threads(4) == 1000);  // four threads do all work
    bool thrown = false;
    try {
        bumpstop::work_in_threads(4, [] { throw std::runtime_error("no"); });
    } catch (const std::runtime_error&) {
        thrown = true;
    }
    CHECK(thrown);                               // what a thread throws is thrown here
#ifdef __OPTIMIZE__                              // sanitizers want terabytes of addresses
    const rlimit few{600'000'000, 600'000'000};  // bytes: the stacks of some sixty threads
    setrlimit(RLIMIT_AS, &few);
    CHECK(done_in_threads(256) == 1000);  // without memory for 256 threads those there are do all work
#endif
    return checks::result();
}
