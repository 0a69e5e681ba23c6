/// What the control loop hands to the thread that publishes: a ring with one writer and one reader, without locks.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>

namespace bumpstop_ros2_control {

/// A queue of at most `size - 1` values. Neither side ever waits for the other.
template <class Value, std::size_t size>
class TickQueue {
  public:
    /// Puts a value in; false where the queue is full, and the value is left out.
    bool push(const Value& value) noexcept {
        const std::size_t at = written_.load(std::memory_order_relaxed), next = (at + 1) % size;
        if (next == read_.load(std::memory_order_acquire)) return false;
        values_[at] = value;
        written_.store(next, std::memory_order_release);
        return true;
    }
    /// Takes the oldest value out; false where there is none.
    bool pop(Value& value) noexcept {
        const std::size_t at = read_.load(std::memory_order_relaxed);
        if (at == written_.load(std::memory_order_acquire)) return false;
        value = values_[at];
        read_.store((at + 1) % size, std::memory_order_release);
        return true;
    }

  private:
    std::array<Value, size> values_{};
    alignas(64) std::atomic<std::size_t> written_{0};
    alignas(64) std::atomic<std::size_t> read_{0};
};

}  // namespace bumpstop_ros2_control
