/// A controller of ros2_control that commands nothing: it reads positions and efforts of an arm in the control loop,
/// and publishes residuals, alarms and the force of a collision.
#pragma once

#include <atomic>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "bumpstop/detection/detector_description.hpp"
#include "bumpstop_ros2_control/tick_queue.hpp"
#include "controller_interface/controller_interface.hpp"
#include "geometry_msgs/msg/wrench_stamped.hpp"
#include "rclcpp/rclcpp.hpp"
#include "sensor_msgs/msg/joint_state.hpp"
#include "std_msgs/msg/bool.hpp"
#include "std_msgs/msg/string.hpp"

namespace bumpstop_ros2_control {

/// One tick, as the publishing thread gets it.
struct Tick {
    std::int64_t nanoseconds = 0;  ///< time of the update
    bumpstop::DetectorState state = bumpstop::DetectorState::no_data;
    bool stop = true;
    bool alarm = false;                                   ///< an alarm stands, also while there are no data
    bool event = false;                                   ///< an event began in this tick: `force` is its force
    std::array<double, bumpstop::max_joints> residual{};  ///< NaN without data [Nm or N]
    std::array<double, 3> force{};                        ///< base frame [N]
};

/// Parameters: `detector`, the file that `bumpstop detector` wrote; `joints`, their names in the order of the detector's
/// robot; `effort_interface`, the state interface that has currents or torques, as the detector takes them (`effort`);
/// `position_interface` (`position`); `frame`, the name of the base frame (`base_link`).
///
/// Topics: `~/residual` (sensor_msgs/JointState, effort is the residual), `~/state` (std_msgs/String) and `~/alarm`
/// (std_msgs/Bool) of every tick, `~/wrench` (geometry_msgs/WrenchStamped) of every event.
///
/// `update` allocates nothing, takes no lock and throws nothing: a thread of its own publishes what it hands over. Where
/// that thread comes late, ticks are left out of the topics and counted, never out of the detector.
class CollisionController : public controller_interface::ControllerInterface {
  public:
    ~CollisionController() override { end(); }

    controller_interface::CallbackReturn on_init() override;
    controller_interface::InterfaceConfiguration command_interface_configuration() const override;
    controller_interface::InterfaceConfiguration state_interface_configuration() const override;
    controller_interface::CallbackReturn on_configure(const rclcpp_lifecycle::State& previous) override;
    controller_interface::CallbackReturn on_activate(const rclcpp_lifecycle::State& previous) override;
    controller_interface::CallbackReturn on_deactivate(const rclcpp_lifecycle::State& previous) override;
    controller_interface::return_type update(const rclcpp::Time& time,
                                             const rclcpp::Duration& period) noexcept override;

    /// Ticks that the publishing thread could not take.
    long left_out() const noexcept { return left_out_.load(std::memory_order_relaxed); }

  private:
    void publish_until_ended();
    void publish(const Tick& tick);
    void end();

    std::vector<std::string> joints_;
    std::string position_interface_, effort_interface_, frame_;
    std::optional<bumpstop::Detector> detector_;
    bumpstop::DetectorSample sample_;
    std::int64_t begin_ = -1;  // time of the first update after the activation [ns]
    long events_ = 0;
    Tick tick_;
    TickQueue<Tick, 1024> queue_;
    std::atomic<long> left_out_{0};
    std::atomic<bool> ended_{true};
    std::thread thread_;

    sensor_msgs::msg::JointState residual_;
    geometry_msgs::msg::WrenchStamped wrench_;
    rclcpp::Publisher<sensor_msgs::msg::JointState>::SharedPtr residuals_;
    rclcpp::Publisher<std_msgs::msg::String>::SharedPtr states_;
    rclcpp::Publisher<std_msgs::msg::Bool>::SharedPtr alarms_;
    rclcpp::Publisher<geometry_msgs::msg::WrenchStamped>::SharedPtr wrenches_;
};

}  // namespace bumpstop_ros2_control
