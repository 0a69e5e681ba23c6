#include "bumpstop_ros2_control/collision_controller.hpp"

#include <chrono>
#include <cmath>
#include <fstream>
#include <limits>

#include "pluginlib/class_list_macros.hpp"

namespace bumpstop_ros2_control {

using controller_interface::CallbackReturn;
using controller_interface::interface_configuration_type;
using controller_interface::InterfaceConfiguration;
using controller_interface::return_type;

static const char* name_of(bumpstop::DetectorState state) {
    switch (state) {
        case bumpstop::DetectorState::no_data:
            return "no_data";
        case bumpstop::DetectorState::arming:
            return "arming";
        case bumpstop::DetectorState::monitoring:
            return "monitoring";
        case bumpstop::DetectorState::alarm:
            return "alarm";
    }
    return "no_data";
}

/// Whether a joint of the robot is the detector's: by the same name, or with a prefix before it.
static bool same_joint(const std::string& name, const std::string& own) {
    return name.size() >= own.size() && name.compare(name.size() - own.size(), own.size(), own) == 0;
}

CallbackReturn CollisionController::on_init() {
    auto_declare("detector", std::string());
    auto_declare("joints", std::vector<std::string>());
    auto_declare("position_interface", std::string("position"));
    auto_declare("effort_interface", std::string("effort"));
    auto_declare("frame", std::string("base_link"));
    return CallbackReturn::SUCCESS;
}

InterfaceConfiguration CollisionController::command_interface_configuration() const {
    return {interface_configuration_type::NONE, {}};
}

InterfaceConfiguration CollisionController::state_interface_configuration() const {
    InterfaceConfiguration wanted{interface_configuration_type::INDIVIDUAL, {}};
    for (const std::string& interface : {position_interface_, effort_interface_})
        for (const std::string& joint : joints_) wanted.names.push_back(joint + "/" + interface);
    return wanted;
}

CallbackReturn CollisionController::on_configure(const rclcpp_lifecycle::State&) {
    const auto node = get_node();
    joints_ = node->get_parameter("joints").as_string_array();
    position_interface_ = node->get_parameter("position_interface").as_string();
    effort_interface_ = node->get_parameter("effort_interface").as_string();
    frame_ = node->get_parameter("frame").as_string();
    const std::string path = node->get_parameter("detector").as_string();
    std::ifstream file(path);
    std::string error = "the file cannot be read";
    const auto description = file ? bumpstop::read_detector(file, error) : std::nullopt;
    if (!description) {
        RCLCPP_ERROR(node->get_logger(), "detector '%s': %s", path.c_str(), error.c_str());
        return CallbackReturn::ERROR;
    }
    detector_.emplace(description->detector());
    if (int(joints_.size()) != detector_->joints()) {
        RCLCPP_ERROR(node->get_logger(), "joints: %d names, the detector's %s has %d joints", int(joints_.size()),
                     description->robot.name.c_str(), detector_->joints());
        return CallbackReturn::ERROR;
    }
    for (std::size_t j = 0; j < joints_.size(); ++j) {
        const std::string& own = description->robot.joints[j].name;
        if (same_joint(joints_[j], own)) continue;
        RCLCPP_ERROR(node->get_logger(), "joints: number %d is '%s', the detector's is '%s': give them in its order",
                     int(j + 1), joints_[j].c_str(), own.c_str());
        return CallbackReturn::ERROR;
    }
    // 0 in Humble, which does not tell a controller the rate of its manager.
    const double rate = get_update_rate(), period = detector_->settings().samples.period;
    if (rate > 0 && std::fabs(rate * period - 1) > 0.01) {
        RCLCPP_ERROR(node->get_logger(), "update_rate: is %g Hz, the detector '%s' is for %g Hz", rate, path.c_str(),
                     1 / period);
        return CallbackReturn::ERROR;
    }
    if (detector_->settings().samples.measured_rates) {
        RCLCPP_ERROR(node->get_logger(), "detector '%s' takes measured rates, which are not read here", path.c_str());
        return CallbackReturn::ERROR;
    }
    const rclcpp::SystemDefaultsQoS qos;
    residuals_ = node->create_publisher<sensor_msgs::msg::JointState>("~/residual", qos);
    states_ = node->create_publisher<std_msgs::msg::String>("~/state", qos);
    alarms_ = node->create_publisher<std_msgs::msg::Bool>("~/alarm", qos);
    wrenches_ = node->create_publisher<geometry_msgs::msg::WrenchStamped>("~/wrench", qos);
    residual_.name = joints_;
    residual_.effort.assign(joints_.size(), 0.0);
    residual_.header.frame_id = wrench_.header.frame_id = frame_;
    const double unknown = std::numeric_limits<double>::quiet_NaN();
    wrench_.wrench.torque.x = wrench_.wrench.torque.y = wrench_.wrench.torque.z = unknown;
    return CallbackReturn::SUCCESS;
}

CallbackReturn CollisionController::on_activate(const rclcpp_lifecycle::State&) {
    if (state_interfaces_.size() != 2 * joints_.size()) {
        RCLCPP_ERROR(get_node()->get_logger(), "%d state interfaces, wanted %d", int(state_interfaces_.size()),
                     int(2 * joints_.size()));
        return CallbackReturn::ERROR;
    }
    detector_->reset();
    begin_ = -1;
    events_ = 0;
    end();
    ended_ = false;
    thread_ = std::thread([this] { publish_until_ended(); });
    return CallbackReturn::SUCCESS;
}

CallbackReturn CollisionController::on_deactivate(const rclcpp_lifecycle::State&) {
    end();
    return CallbackReturn::SUCCESS;
}

return_type CollisionController::update(const rclcpp::Time& time, const rclcpp::Duration&) noexcept {
    const std::size_t n = joints_.size();
    const std::int64_t now = time.nanoseconds();
    if (begin_ < 0) begin_ = now;
    // Since the activation: seconds since 1970 would leave a double no more than a quarter of a microsecond.
    sample_.t = 1e-9 * double(now - begin_);
    for (std::size_t j = 0; j < n; ++j) {
        sample_.q[j] = state_interfaces_[j].get_value();
        sample_.signal[j] = state_interfaces_[n + j].get_value();
    }
    const bumpstop::DetectorOutput& out = detector_->update(sample_);
    tick_.nanoseconds = now;
    tick_.state = out.state;
    tick_.stop = out.stop;
    tick_.alarm = detector_->alarmed();
    tick_.residual = out.residual;
    tick_.event = detector_->events() != events_;
    if (tick_.event) {
        events_ = detector_->events();
        const auto& force = detector_->event().contact.force;
        tick_.force = {force[0], force[1], force[2]};
    }
    if (!queue_.push(tick_)) left_out_.fetch_add(1, std::memory_order_relaxed);
    return return_type::OK;
}

void CollisionController::publish_until_ended() {
    Tick tick;
    for (;;) {
        // Asked before the queue is emptied, so that the last ticks are published, too.
        const bool last = ended_;
        while (queue_.pop(tick)) publish(tick);
        if (last) return;
        std::this_thread::sleep_for(std::chrono::microseconds(500));
    }
}

void CollisionController::publish(const Tick& tick) {
    constexpr std::int64_t second = 1'000'000'000;
    residual_.header.stamp.sec = std::int32_t(tick.nanoseconds / second);
    residual_.header.stamp.nanosec = std::uint32_t(tick.nanoseconds % second);
    for (std::size_t j = 0; j < joints_.size(); ++j) residual_.effort[j] = tick.residual[j];
    residuals_->publish(residual_);
    std_msgs::msg::String state;
    state.data = name_of(tick.state);
    states_->publish(state);
    std_msgs::msg::Bool alarm;
    alarm.data = tick.alarm;
    alarms_->publish(alarm);
    if (!tick.event) return;
    wrench_.header.stamp = residual_.header.stamp;
    wrench_.wrench.force.x = tick.force[0];
    wrench_.wrench.force.y = tick.force[1];
    wrench_.wrench.force.z = tick.force[2];
    wrenches_->publish(wrench_);
}

void CollisionController::end() {
    ended_ = true;
    if (thread_.joinable()) thread_.join();
}

}  // namespace bumpstop_ros2_control

PLUGINLIB_EXPORT_CLASS(bumpstop_ros2_control::CollisionController, controller_interface::ControllerInterface)
