/// @file
/// A robot as a file describes it: what `bumpstop robots export` writes and C++ programs read.
#pragma once

#include <charconv>
#include <istream>
#include <limits>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "bumpstop/model/dynamics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Names, limits and inertia of a chain, joint by joint from the base.
struct RobotDescription {
    struct Joint {
        std::string name, link;
        JointSpec spec;
        double lower = 0, upper = 0;  // rad or m; may be infinite
        double velocity = 0;          // rad/s or m/s; may be infinite
        std::optional<LinkInertia> inertia;
    };
    std::string name, tip_name;
    std::vector<Joint> joints;
    Vector3 tip_origin{};                             ///< in the frame of the last link [m]
    Matrix3 tip_rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};  ///< row-major

    Chain chain() const {
        std::vector<JointSpec> specs;
        for (const Joint& joint : joints) specs.push_back(joint.spec);
        return Chain(specs);
    }
    LinkPoint tip(const Chain& chain) const { return link_point(chain, chain.dof - 1, tip_origin); }
    /// None where some link's inertia is not known.
    std::optional<Inertias> inertias(const Chain& chain) const {
        std::vector<LinkInertia> links;
        for (const Joint& joint : joints) {
            if (!joint.inertia) return std::nullopt;
            links.push_back(*joint.inertia);
        }
        return Inertias(chain, links);
    }
};

namespace detail {

/// One line of the file: a keyword and numbers, or a keyword and a name that ends the line.
class DescriptionLine {
  public:
    explicit DescriptionLine(const std::string& line) : text_(line) { text_ >> keyword; }
    std::string keyword;

    bool numbers(double* values, int count) {
        for (int i = 0; i < count; ++i) {
            std::string token;
            if (!(text_ >> token)) return false;
            const char *begin = token.data(), *end = begin + token.size();
            const auto read = std::from_chars(begin, end, values[i]);
            if (read.ec != std::errc() || read.ptr != end || values[i] != values[i]) return false;
        }
        return true;
    }
    bool word(std::string& value) { return bool(text_ >> value); }
    std::string rest() {
        std::string value;
        std::getline(text_ >> std::ws, value);
        return value;
    }

  private:
    std::istringstream text_;
};

/// Reads up to 'end' and leaves what follows it; `number` counts the lines.
inline std::optional<RobotDescription> read_robot_part(std::istream& in, int& number, std::string& error) {
    RobotDescription robot;
    std::string line;
    bool begun = false, ended = false;
    auto wrong = [&](const std::string& what) {
        error = "line " + std::to_string(number) + ": " + what;
        return std::nullopt;
    };
    while (!ended && std::getline(in, line)) {
        ++number;
        if (line.empty() || line[0] == '#') continue;
        DescriptionLine here(line);
        const std::string& key = here.keyword;
        if (!begun) {
            std::string version;
            if (key != "bumpstop-robot" || !here.word(version) || version != "1")
                return wrong("not a robot description of version 1");
            begun = true;
        } else if (key == "name") {
            robot.name = here.rest();
        } else if (key == "tip") {
            if (!here.numbers(robot.tip_origin.data(), 3) || !here.numbers(robot.tip_rotation.data(), 9))
                return wrong("'tip' wants twelve numbers and a name");
            robot.tip_name = here.rest();
        } else if (key == "joint") {
            RobotDescription::Joint joint;
            std::string kind;
            if (!here.word(kind) || (kind != "revolute" && kind != "prismatic"))
                return wrong("'joint' wants revolute or prismatic, and a name");
            if (int(robot.joints.size()) == max_joints)
                return wrong("more than " + std::to_string(max_joints) + " joints");
            joint.spec.prismatic = kind == "prismatic";
            joint.name = here.rest();
            robot.joints.push_back(joint);
        } else if (key == "end") {
            ended = true;
        } else if (robot.joints.empty()) {
            return wrong("'" + key + "' before the first joint");
        } else if (RobotDescription::Joint& joint = robot.joints.back(); key == "link") {
            joint.link = here.rest();
        } else if (key == "origin") {
            if (!here.numbers(joint.spec.origin.data(), 3)) return wrong("'origin' wants three numbers");
        } else if (key == "rotation") {
            if (!here.numbers(joint.spec.rotation.data(), 9)) return wrong("'rotation' wants nine numbers");
        } else if (key == "axis") {
            Vector3& axis = joint.spec.axis;
            if (!here.numbers(axis.data(), 3) || std::fabs(std::hypot(axis[0], axis[1], axis[2]) - 1) > 1e-9)
                return wrong("'axis' wants a unit vector");
        } else if (key == "limits") {
            double values[3];
            if (!here.numbers(values, 3)) return wrong("'limits' wants lower, upper and speed");
            joint.lower = values[0];
            joint.upper = values[1];
            joint.velocity = values[2];
        } else if (key == "inertia") {
            LinkInertia inertia;
            if (!here.numbers(&inertia.mass, 1) || !here.numbers(inertia.center.data(), 3) ||
                !here.numbers(inertia.tensor.data(), 9) || !here.numbers(&inertia.rotor, 1))
                return wrong("'inertia' wants fourteen numbers");
            joint.inertia = inertia;
        } else {
            return wrong("unknown keyword '" + key + "'");
        }
    }
    if (!begun || !ended) return wrong(begun ? "the description ends without 'end'" : "the description is empty");
    if (robot.joints.empty()) return wrong("no joints");
    return robot;
}

/// The next line that says something; false at the end of the text.
inline bool next_line(std::istream& in, std::string& line, int& number) {
    while (std::getline(in, line)) {
        ++number;
        if (!line.empty() && line[0] != '#') return true;
    }
    return false;
}

}  // namespace detail

/// Reads a description. Nothing and a message in `error` where the text is none: the message names the line.
inline std::optional<RobotDescription> read_robot(std::istream& in, std::string& error) {
    int number = 0;
    std::optional<RobotDescription> robot = detail::read_robot_part(in, number, error);
    std::string line;
    if (!robot || !detail::next_line(in, line, number)) return robot;
    error = "line " + std::to_string(number) + ": text after 'end'";
    return std::nullopt;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
