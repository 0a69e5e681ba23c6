// One extension module per instruction set: the same functions and classes under another name.
#include "common.hpp"
#include "interrupt.hpp"

NB_MODULE(BUMPSTOP_MODULE, module) {
    // Robots are kept until Python ends, and their chains with them: that is meant, and no leak.
    nanobind::set_leak_warnings(false);
    module.doc() = "Kernels of bumpstop for one instruction set. Use them through the bumpstop package.";
    module.attr("lanes") = bumpstop::native_lanes;
    bumpstop::translate_interruptions();
    bumpstop::bind_questions(module);
    bumpstop::bind_math(module);
    bumpstop::bind_model(module);
    bumpstop::bind_dynamics(module);
    bumpstop::bind_signal(module);
    bumpstop::bind_joint(module);
    bumpstop::bind_detection(module);
    bumpstop::bind_sensitivity(module);
    bumpstop::bind_workspace(module);
    bumpstop::bind_contact(module);
    bumpstop::bind_deceleration(module);
    bumpstop::bind_setup(module);
    bumpstop::bind_distribution(module);
    bumpstop::bind_collision(module);
    bumpstop::bind_batch(module);
    bumpstop::bind_trajectory(module);
}
