// Not std_msgs: the fields of the published message. See ../../README.md.
#pragma once

#include <string>

namespace std_msgs::msg {
struct String {
    std::string data;
};
}  // namespace std_msgs::msg
