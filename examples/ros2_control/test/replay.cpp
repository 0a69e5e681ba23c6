// Runs the controller over a recording (CSV: a header; then time in whole nanoseconds, positions and efforts), as a
// controller manager would, and prints what it published: the residual of every tick, and a line for every event. Counts
// what the loop allocates. A third argument is the manager's update rate [Hz]; without it that is not told.
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <new>
#include <string>
#include <thread>
#include <vector>

#include "bumpstop_ros2_control/collision_controller.hpp"

static thread_local bool counted = false;
static std::atomic<long> allocations{0};
// Not inlined: gcc would see malloc and delete, or new and free, and call them mismatched.
[[gnu::noinline]] void* operator new(std::size_t size) {
    if (counted) ++allocations;
    if (void* found = std::malloc(size)) return found;
    throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* what) noexcept { std::free(what); }
[[gnu::noinline]] void operator delete(void* what, std::size_t) noexcept { std::free(what); }

using controller_interface::CallbackReturn;

template <class Message>
static std::vector<Message>& published(bumpstop_ros2_control::CollisionController& controller, const char* topic) {
    return std::any_cast<std::shared_ptr<rclcpp::Publisher<Message>>>(controller.get_node()->publishers.at(topic))
        ->published;
}

int main(int count, char** arguments) {
    if (count < 3) {
        std::fprintf(stderr, "error: wanted a detector and a recording\n");
        return 2;
    }
    std::ifstream file(arguments[2]);
    std::string line;
    std::getline(file, line);
    std::vector<std::string> joints;
    for (std::size_t at = 0; (at = line.find("/position", at)) != std::string::npos; ++at)
        joints.push_back(line.substr(line.rfind(',', at) + 1, at - line.rfind(',', at) - 1));
    if (joints.empty()) {
        std::fprintf(stderr, "error: %s: wanted the header time,JOINT/position,...,JOINT/effort,...\n", arguments[2]);
        return 2;
    }
    std::vector<std::int64_t> time;
    std::vector<std::vector<double>> rows;
    while (std::getline(file, line)) {
        char* at = nullptr;
        time.push_back(std::strtoll(line.c_str(), &at, 10));
        std::vector<double> row;
        while (*at == ',') row.push_back(std::strtod(at + 1, &at));
        if (*at != '\0' || row.size() != 2 * joints.size()) {
            std::fprintf(stderr, "error: %s: row %zu: wanted whole nanoseconds and %zu numbers\n", arguments[2],
                         rows.size() + 1, 2 * joints.size());
            return 2;
        }
        rows.push_back(row);
    }
    bumpstop_ros2_control::CollisionController controller;
    controller.get_node()->parameters = {{"detector", std::string(arguments[1])}, {"joints", joints}};
    if (count > 3) controller.update_rate = unsigned(std::atoi(arguments[3]));
    const rclcpp_lifecycle::State state;
    if (controller.on_init() != CallbackReturn::SUCCESS || controller.on_configure(state) != CallbackReturn::SUCCESS)
        return 2;
    std::vector<double> values(2 * joints.size());
    std::vector<hardware_interface::LoanedStateInterface> interfaces;
    for (const std::string& name : controller.state_interface_configuration().names)
        interfaces.emplace_back(name, &values[interfaces.size()]);
    controller.assign_interfaces(std::move(interfaces));
    if (controller.on_activate(state) != CallbackReturn::SUCCESS) return 2;
    for (std::size_t k = 0; k < rows.size(); ++k) {
        values = rows[k];
        const rclcpp::Time now(time[k]);
        const rclcpp::Duration period(0);
        counted = true;
        controller.update(now, period);
        counted = false;
        // The publishing thread must not be outrun by a loop without a clock.
        if (k % 256 == 255) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    controller.on_deactivate(state);
    for (const auto& message : published<sensor_msgs::msg::JointState>(controller, "~/residual")) {
        std::printf("%d.%09u", message.header.stamp.sec, message.header.stamp.nanosec);
        for (const double value : message.effort) std::printf(",%.17g", value);
        std::printf("\n");
    }
    for (const auto& message : published<geometry_msgs::msg::WrenchStamped>(controller, "~/wrench")) {
        const auto& force = message.wrench.force;
        std::printf("event %d.%09u %s %.17g %.17g %.17g\n", message.header.stamp.sec, message.header.stamp.nanosec,
                    message.header.frame_id.c_str(), force.x, force.y, force.z);
    }
    long alarmed = 0;
    for (const auto& message : published<std_msgs::msg::Bool>(controller, "~/alarm")) alarmed += message.data;
    long judged = 0;
    for (const auto& message : published<std_msgs::msg::String>(controller, "~/state"))
        judged += message.data == "monitoring" || message.data == "alarm";
    std::printf("%ld ticks in alarm, %ld left out, %ld allocations in updates\n", alarmed, controller.left_out(),
                allocations.load());
    if (judged == 0) {
        std::fprintf(stderr, "error: no tick was judged: are the times nanoseconds, at the detector's rate?\n");
        return 1;
    }
}
