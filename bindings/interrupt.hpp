// Ctrl-C in work that takes minutes.
#pragma once

#include <nanobind/nanobind.h>

namespace bumpstop::inline BUMPSTOP_TARGET {

// Whether somebody wants to stop. To be asked in the thread that Python called, which has released the lock; the answer is
// an error in it, to be thrown as nanobind's python_error once all threads have joined.
inline bool interrupted() {
    const nanobind::gil_scoped_acquire locked;
    return PyErr_CheckSignals() != 0;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
