// Not rclcpp: what the controller uses of it. See ../README.md.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <variant>
#include <vector>

namespace rclcpp {

class Duration {
  public:
    explicit Duration(std::int64_t nanoseconds) : nanoseconds_(nanoseconds) {}
    std::int64_t nanoseconds() const { return nanoseconds_; }

  private:
    std::int64_t nanoseconds_;
};

class Time {
  public:
    explicit Time(std::int64_t nanoseconds) : nanoseconds_(nanoseconds) {}
    std::int64_t nanoseconds() const { return nanoseconds_; }

  private:
    std::int64_t nanoseconds_;
};

struct SystemDefaultsQoS {};

/// Keeps what was published, by topic, for tests.
template <class Message>
class Publisher {
  public:
    using SharedPtr = std::shared_ptr<Publisher>;
    void publish(const Message& message) {
        const std::lock_guard guard(mutex);
        published.push_back(message);
    }
    std::mutex mutex;
    std::vector<Message> published;
};

struct Logger {};

}  // namespace rclcpp

#define RCLCPP_ERROR(logger, ...) ((void)(logger), std::fprintf(stderr, __VA_ARGS__), std::fputc('\n', stderr))
