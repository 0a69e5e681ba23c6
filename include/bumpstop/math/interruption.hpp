/// @file
/// Work that takes long, and somebody who no longer wants it.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "bumpstop/math/mask.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Thrown by work that is not wanted any more. What it had begun is thrown away.
struct Interrupted {};

namespace detail {

/// Who is asked by the work of this thread whether to stop; null: nobody, and work goes on to its end.
struct Asking {
    const std::function<bool()>* stop = nullptr;
    int until_next = 0;  ///< calls of `allow_interruption`
};
inline thread_local Asking asking;

/// Calls from one question to the next: microseconds of work each, at most milliseconds.
inline constexpr int calls_between_questions = 16;

inline void ask() {
    asking.until_next = calls_between_questions;
    if ((*asking.stop)()) throw Interrupted{};
}

}  // namespace detail

/// To be called again and again by whatever may take long, where an exception does no harm: it costs next to nothing.
inline void allow_interruption() {
    if (detail::asking.stop != nullptr && --detail::asking.until_next <= 0) detail::ask();
}

/// As long as it lives, work of this thread may be interrupted: `stop()` says when.
class MayBeInterrupted {
  public:
    explicit MayBeInterrupted(std::function<bool()> stop) : stop_(std::move(stop)), before_(detail::asking) {
        detail::asking = {&stop_, 0};
    }
    ~MayBeInterrupted() { detail::asking = before_; }
    MayBeInterrupted(const MayBeInterrupted&) = delete;
    MayBeInterrupted& operator=(const MayBeInterrupted&) = delete;

  private:
    const std::function<bool()> stop_;
    const detail::Asking before_;
};

/// Does `work()` in so many threads, this one among them, and returns when all are done. Where this one may be interrupted
/// the others stop with it. What one of them throws ends all of them, and is thrown here. Where the system has no memory
/// for so many threads, those it has room for do all the work.
template <class Work>
void work_in_threads(int threads, Work work) {
    std::mutex mutex;
    std::condition_variable done;
    std::exception_ptr thrown;
    std::atomic<bool> stopped{false};
    int busy = threads - 1;
    const auto guarded = [&](const auto& what) {
        try {
            what();
        } catch (...) {
            const std::lock_guard lock(mutex);
            if (!thrown) thrown = std::current_exception();
            stopped = true;
        }
    };
    std::vector<std::thread> workers;
    workers.reserve(static_cast<std::size_t>(threads));
    try {
        for (int i = 1; i < threads; ++i) {
            workers.emplace_back([&] {
                guarded([&] {
                    const MayBeInterrupted here([&] { return stopped.load(); });
                    work();
                });
                const std::lock_guard lock(mutex);
                --busy;
                done.notify_one();
            });
        }
    } catch (const std::exception&) {  // std::system_error, or std::bad_alloc
        const std::lock_guard lock(mutex);
        busy -= threads - 1 - static_cast<int>(workers.size());
    }
    {
        // This thread is asked in its own way, and stops where another has thrown.
        const std::function<bool()>* const own = detail::asking.stop;
        const auto stop = [&] { return stopped.load() || (own != nullptr && (*own)()); };
        const MayBeInterrupted here(stop);
        guarded(work);
        // Only here can it be heard that nobody wants the rest.
        std::unique_lock lock(mutex);
        while (busy > 0) {
            done.wait_for(lock, std::chrono::milliseconds(20));
            lock.unlock();
            if (!stopped && stop()) {
                const std::lock_guard relock(mutex);
                if (!thrown) thrown = std::make_exception_ptr(Interrupted{});
                stopped = true;
            }
            lock.lock();
        }
    }
    for (std::thread& worker : workers) worker.join();
    if (thrown) std::rethrow_exception(thrown);
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
