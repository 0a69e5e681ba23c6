// The monitor of poses with undetectable forces, as a control loop uses it.
#include "bumpstop/detection/undetectable_force.hpp"

#include <cstdlib>
#include <limits>
#include <new>
#include <vector>

#include "math/check.hpp"

namespace {
long allocations = 0;
}
void* operator new(std::size_t size) {
    ++allocations;
    if (void* memory = std::malloc(size)) return memory;
    throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace {

using namespace bumpstop;

// Turns about z, then twice about y, links of half a metre: stretched out at q[2] = 0 it feels nothing along the arm.
Chain elbow() {
    const std::vector<JointSpec> specs{
        {.axis = {0, 0, 1}}, {.axis = {0, 1, 0}}, {.origin = {0.5, 0, 0}, .axis = {0, 1, 0}}};
    return Chain(specs);
}

void warns_once_when_it_enters() {
    const Chain chain = elbow();
    const LinkPoint tip = link_point(chain, 2, {0.5, 0, 0});
    const ResidualBand band[3] = {{-10, 10}, {-10, 10}, {-10, 10}};
    UndetectablePoseMonitor watch(chain, tip, band, 200.0);
    static_assert(noexcept(watch.update(nullptr)));
    int entered = 0, warned = 0, ticks = 0;
    const long before = allocations;
    for (double bend = 1.2; bend >= -1.2; bend -= 0.001, ++ticks) {
        const double q[3] = {0.3, 0.2, bend};
        const PoseWarning state = watch.update(q);
        entered += state.entered;
        warned += state.warning;
        // A warning lasts until the force is 5 % below the limit.
        CHECK(state.warning == (state.force > 200.0) || (state.warning && state.force > 190.0));
        CHECK(!state.entered || state.warning);
    }
    CHECK(allocations == before);
    CHECK(entered == 1);
    CHECK(warned > 50 && warned < ticks / 2);
}

void what_is_not_known_warns() {
    const Chain chain = elbow();
    const LinkPoint tip = link_point(chain, 2, {0.5, 0, 0});
    const ResidualBand band[3] = {{-10, 10}, {-10, 10}, {-10, 10}};
    UndetectablePoseMonitor watch(chain, tip, band, 1e6);
    const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
    const double good[3] = {0.1, 0.4, 1.0};
    CHECK(!watch.update(good).warning);
    for (const double bad : {nan, infinity, -infinity}) {
        const double q[3] = {0.1, bad, 1.0};
        const PoseWarning state = watch.update(q);
        CHECK(state.warning);
        CHECK(!(state.force <= 1e6));
        CHECK(!watch.update(good).warning);
    }
    // Straight: a force along the arm is not detectable at all.
    const double straight[3] = {0, 0, 0};
    CHECK(watch.update(straight).force == infinity);
    // Nobody watches.
    const ResidualBand none[3];
    UndetectablePoseMonitor monitor(chain, tip, none, 1e6);
    CHECK(monitor.update(good).warning);
}

// The elbow's polytope worked out by hand: about z only joint 1 acts, in the plane of the arm joints 2 and 3.
void known_polytope() {
    const double bend = 0.9;
    const Chain chain = elbow();
    const LinkPoint tip = link_point(chain, 2, {0.5, 0, 0});
    const double q[3] = {0, 0, bend};
    const ResidualBand band[3] = {{-4, 4}, {-3, 3}, {-2, 2}};
    UndetectablePoseMonitor watch(chain, tip, band, 1e6);
    const double x = 0.5 + 0.5 * std::cos(bend), z = -0.5 * std::sin(bend);
    // Columns: joint 1 (0, x, 0); joint 2 (z, 0, -x); joint 3 (z, 0, -0.5 cos bend).
    const double c = 0.5 * std::cos(bend);
    double largest = 0;
    for (const double t2 : {-3.0, 3.0})
        for (const double t3 : {-2.0, 2.0}) {
            const double fz = (t3 - t2) / (x - c), fx = (t2 + x * fz) / z, fy = 4 / x;
            largest = std::fmax(largest, std::sqrt(fx * fx + fy * fy + fz * fz));
        }
    CHECK_NEAR(watch.update(q).force, largest, 1e-10 * largest);
}

}  // namespace

int main() {
    warns_once_when_it_enters();
    what_is_not_known_warns();
    known_polytope();
    return checks::result();
}
