// Not controller_interface: what the controller uses of it. See ../README.md.
#pragma once

#include <any>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "hardware_interface/loaned_state_interface.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace controller_interface {

enum class return_type { OK, ERROR };
enum class CallbackReturn { SUCCESS, FAILURE, ERROR };
enum class interface_configuration_type { ALL, INDIVIDUAL, NONE };

struct InterfaceConfiguration {
    interface_configuration_type type;
    std::vector<std::string> names = {};
};

/// Parameters and publishers by name; a test sets the first and looks into the second.
class Node {
  public:
    std::map<std::string, std::any> parameters;
    std::map<std::string, std::any> publishers;

    struct Parameter {
        std::any value;
        std::string as_string() const { return std::any_cast<std::string>(value); }
        std::vector<std::string> as_string_array() const { return std::any_cast<std::vector<std::string>>(value); }
    };
    Parameter get_parameter(const std::string& name) const { return {parameters.at(name)}; }
    rclcpp::Logger get_logger() const { return {}; }

    template <class Message>
    std::shared_ptr<rclcpp::Publisher<Message>> create_publisher(const std::string& topic, rclcpp::SystemDefaultsQoS) {
        auto made = std::make_shared<rclcpp::Publisher<Message>>();
        publishers[topic] = made;
        return made;
    }
};

class ControllerInterface {
  public:
    virtual ~ControllerInterface() = default;
    virtual CallbackReturn on_init() = 0;
    virtual InterfaceConfiguration command_interface_configuration() const = 0;
    virtual InterfaceConfiguration state_interface_configuration() const = 0;
    virtual CallbackReturn on_configure(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
    virtual CallbackReturn on_activate(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
    virtual CallbackReturn on_deactivate(const rclcpp_lifecycle::State&) { return CallbackReturn::SUCCESS; }
    virtual return_type update(const rclcpp::Time& time, const rclcpp::Duration& period) = 0;

    std::shared_ptr<Node> get_node() const { return node_; }
    unsigned int get_update_rate() const { return update_rate; }
    unsigned int update_rate = 0;  ///< [Hz]; a test sets it
    void assign_interfaces(std::vector<hardware_interface::LoanedStateInterface> states) {
        state_interfaces_ = std::move(states);
    }

  protected:
    template <class Value>
    void auto_declare(const std::string& name, const Value& value) {
        node_->parameters.try_emplace(name, value);
    }
    std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;

  private:
    std::shared_ptr<Node> node_ = std::make_shared<Node>();
};

}  // namespace controller_interface
