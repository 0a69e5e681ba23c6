// Ctrl-C in work that takes minutes, and questions of those who may not want it any more.
#pragma once

#include <nanobind/nanobind.h>

#include <chrono>

#include "bumpstop/math/interruption.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

// A Python function that work of this thread asks; null: none. Who sets it keeps it alive.
inline thread_local PyObject* question = nullptr;

// Work that has released the lock, and stops when somebody wants it to: it throws Interrupted then, which becomes the error
// that Python has set: by a signal, in the thread in which signals are heard, or by the question of this thread.
class Unlocked {
  public:
    Unlocked() : interruption_([last = Clock::now()]() mutable { return interrupted(last); }) {}

  private:
    using Clock = std::chrono::steady_clock;
    // The lock may have to be waited for, so it is not asked for more often than a person would feel.
    static constexpr std::chrono::milliseconds check_interval{50};

    static bool interrupted(Clock::time_point& last) {
        if (Clock::now() - last < check_interval) return false;
        bool wanted = false;
        {
            const nanobind::gil_scoped_acquire locked;
            wanted = PyErr_CheckSignals() != 0;
            if (!wanted && question != nullptr) {
                PyObject* const answer = PyObject_CallNoArgs(question);
                wanted = answer == nullptr;
                Py_XDECREF(answer);
            }
        }
        last = Clock::now();
        return wanted;
    }

    nanobind::gil_scoped_release unlocked_;
    MayBeInterrupted interruption_;
};

// Does work without the lock.
template <class Work>
auto unlocked(Work work) {
    const Unlocked here;
    return work();
}

inline void bind_questions(nanobind::module_& module) {
    module.def(
        "ask_while_working", [](nanobind::handle what) { question = what.is_none() ? nullptr : what.ptr(); },
        nanobind::arg("question").none(),
        "Work of this thread calls `question()`, which the caller keeps alive, and ends with what it raises.");
}

// Python has set its error where the interruption was heard.
inline void translate_interruptions() {
    nanobind::register_exception_translator([](const std::exception_ptr& thrown, void*) {
        try {
            std::rethrow_exception(thrown);
        } catch (const Interrupted&) {
            if (!PyErr_Occurred()) PyErr_SetNone(PyExc_KeyboardInterrupt);
        }
    });
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
