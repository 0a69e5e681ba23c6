/// @file
/// Cooperative interruption of long computations, and threads that respect it.
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

/// Thrown by an interrupted computation, whose partial results are discarded.
struct Interrupted {};

namespace detail {

/// The stop function of this thread; null: its work is not interrupted.
struct StopQuery {
    const std::function<bool()>* stop = nullptr;
    int until_next = 0;  ///< calls of `allow_interruption` until the next query
};
inline thread_local StopQuery stop_query;

/// The work between two calls takes microseconds, at most milliseconds.
inline constexpr int calls_between_queries = 16;

inline void query_stop() {
    stop_query.until_next = calls_between_queries;
    if ((*stop_query.stop)()) throw Interrupted{};
}

}  // namespace detail

/// To be called repeatedly in long computations, where an exception is safe. It costs almost nothing.
inline void allow_interruption() {
    if (detail::stop_query.stop != nullptr && --detail::stop_query.until_next <= 0) detail::query_stop();
}

/// During its lifetime the work of this thread is interrupted once `stop()` is true.
class MayBeInterrupted {
  public:
    explicit MayBeInterrupted(std::function<bool()> stop) : stop_(std::move(stop)), before_(detail::stop_query) {
        detail::stop_query = {&stop_, 0};
    }
    ~MayBeInterrupted() { detail::stop_query = before_; }
    MayBeInterrupted(const MayBeInterrupted&) = delete;
    MayBeInterrupted& operator=(const MayBeInterrupted&) = delete;

  private:
    const std::function<bool()> stop_;
    const detail::StopQuery before_;
};

/// Runs `work()` in `threads` threads, this one among them, and returns when all have finished. An interruption of this
/// thread, or an exception in any, stops all of them and is thrown here. Where not all threads can be started, those
/// that were do all the work.
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
        // This thread keeps its own stop function, and stops where another has thrown.
        const std::function<bool()>* const own = detail::stop_query.stop;
        const auto stop = [&] { return stopped.load() || (own != nullptr && (*own)()); };
        const MayBeInterrupted here(stop);
        guarded(work);
        // The other threads cannot query this thread's stop function, so it does until they have finished.
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
