// Not hardware_interface: what the controller uses of it. See ../README.md.
#pragma once

#include <string>

namespace hardware_interface {

class LoanedStateInterface {
  public:
    LoanedStateInterface(std::string name, const double* value) : name_(std::move(name)), value_(value) {}
    const std::string& get_name() const { return name_; }
    double get_value() const { return *value_; }

  private:
    std::string name_;
    const double* value_;
};

}  // namespace hardware_interface
