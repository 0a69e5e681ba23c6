/// When bodies separate from a rigid arm that does not detect them: numbers in, numbers out.
///
/// In: K, c, m of the body; steps, step [s]; the path at the ends of steps, the start included.
/// Out: a line for every body that the library simulates, then one for every body at the distance of a step: offset,
/// first touch and end of contact in steps, 1 where contact ends smoothly up to the next body.
#include "bumpstop/collision/contact/separation.hpp"

#include <cstdio>
#include <iostream>

int main() {
    using namespace bumpstop;
    const auto read = [] {
        double value = 0;
        std::cin >> value;
        return value;
    };
    ContactBody body;
    for (double* value : {&body.stiffness, &body.damping, &body.mass}) *value = read();
    LinePath path;
    path.s.resize(std::size_t(read()) + 1);
    ContactPaths paths;
    paths.path = &path;
    paths.step = read();
    for (double& s : path.s) s = read();
    if (!std::cin) return 1;

    const ContactPropagator propagator(ContactSystem(ElasticArm{}, body), paths.step);
    const Separations separations(paths, propagator);
    const auto print = [](const Separation& each) {
        std::printf("%.17g %.17g %.17g %d\n", each.offset, each.touch, each.end, int(each.smooth));
    };
    for (const Separation& each : separations.up_to(HUGE_VAL)) print(each);
    for (double offset : separations.offsets(HUGE_VAL)) print(separations(offset));
}
