// Not std_msgs: the fields of the published message. See ../../README.md.
#pragma once

namespace std_msgs::msg {
struct Bool {
    bool data = false;
};
}  // namespace std_msgs::msg
