// Not rclcpp_lifecycle: what the controller uses of it. See ../README.md.
#pragma once

namespace rclcpp_lifecycle {
class State {};
}  // namespace rclcpp_lifecycle
