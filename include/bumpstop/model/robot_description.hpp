/// @file
/// A robot as a file describes it: what `bumpstop robots export` writes and C++ programs read.
#pragma once

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <initializer_list>
#include <istream>
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

/// Built by appending: gcc 12 warns of overlapping copies where a literal comes first in a sum.
inline std::string quoted(const char* before, const std::string& word, const char* after) {
    std::string text = before;
    text += '\'';
    text += word;
    text += '\'';
    text += after;
    return text;
}

/// One line of the file: a keyword and numbers, or a keyword and a name that ends the line.
class DescriptionLine {
  public:
    explicit DescriptionLine(const std::string& line) : text_(line) { text_ >> keyword; }
    std::string keyword;

    /// It is blank, or a comment.
    bool says_nothing() const { return keyword.empty() || keyword[0] == '#'; }

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
    bool finite_numbers(double* values, int count) {
        if (!numbers(values, count)) return false;
        for (int i = 0; i < count; ++i)
            if (!std::isfinite(values[i])) return false;
        return true;
    }
    bool word(std::string& value) { return bool(text_ >> value); }
    /// A name may hold blanks, but neither begins nor ends with one.
    std::string rest() {
        std::string value;
        std::getline(text_ >> std::ws, value);
        while (!value.empty() && std::isspace(static_cast<unsigned char>(value.back()))) value.pop_back();
        return value;
    }
    /// Nothing is left of it.
    bool done() { return text_.eof() || (text_ >> std::ws).eof(); }

  private:
    std::istringstream text_;
};

/// Whether its rows are those of a rotation matrix, as Python asks it of a robot.
inline bool is_rotation(const Matrix3& m) {
    const Matrix3 square = m * transposed(m);
    const double determinant =
        m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
    for (int k = 0; k < 9; ++k)
        if (!(std::fabs(square[k] - (k % 4 == 0 ? 1 : 0)) <= 1e-9)) return false;
    return determinant > 0;
}
inline bool is_unit_vector(const Vector3& v) { return std::fabs(std::hypot(v[0], v[1], v[2]) - 1) <= 1e-9; }

/// Keywords that have been read of one thing: each may come once, and most must.
class Keywords {
  public:
    /// False where it has been there before.
    bool take(const std::string& key) {
        if (std::find(taken_.begin(), taken_.end(), key) != taken_.end()) return false;
        taken_.push_back(key);
        return true;
    }
    /// The first of these that is missing, or none.
    std::string missing(std::initializer_list<const char*> wanted) const {
        for (const char* key : wanted)
            if (std::find(taken_.begin(), taken_.end(), key) == taken_.end()) return key;
        return {};
    }
    void clear() { taken_.clear(); }

  private:
    std::vector<std::string> taken_;
};

/// What a line says of a joint; false where it is no such line. `wanted` is what it lacks, or empty.
inline bool read_joint_line(DescriptionLine& line, RobotDescription::Joint& joint, const char*& wanted) {
    const std::string& key = line.keyword;
    wanted = "";
    if (key == "link") {
        joint.link = line.rest();
        if (joint.link.empty()) wanted = "a name";
    } else if (key == "origin") {
        if (!line.finite_numbers(joint.spec.origin.data(), 3)) wanted = "three numbers";
    } else if (key == "rotation") {
        Matrix3& rotation = joint.spec.rotation;
        if (!line.finite_numbers(rotation.data(), 9) || !is_rotation(rotation)) wanted = "nine numbers of a rotation";
    } else if (key == "axis") {
        Vector3& axis = joint.spec.axis;
        if (!line.finite_numbers(axis.data(), 3) || !is_unit_vector(axis)) wanted = "a unit vector";
    } else if (key == "limits") {
        double values[3];
        if (!line.numbers(values, 3) || !(values[0] < values[1]) || !(values[2] > 0)) wanted = "lower, upper and speed";
        joint.lower = values[0];
        joint.upper = values[1];
        joint.velocity = values[2];
    } else if (key == "inertia") {
        LinkInertia inertia;
        if (!line.finite_numbers(&inertia.mass, 1) || !line.finite_numbers(inertia.center.data(), 3) ||
            !line.finite_numbers(inertia.tensor.data(), 9) || !line.finite_numbers(&inertia.rotor, 1) ||
            inertia.mass < 0 || inertia.rotor < 0)
            wanted = "fourteen numbers";
        joint.inertia = inertia;
    } else {
        return false;
    }
    return true;
}

/// Reads up to 'end' and leaves what follows it; `number` counts the lines.
inline std::optional<RobotDescription> read_robot_part(std::istream& in, int& number, std::string& error) {
    RobotDescription robot;
    Keywords of_robot, of_joint;
    std::string line;
    bool begun = false, ended = false;
    const auto wrong = [&](const std::string& what) {
        error = "line " + std::to_string(number) + ": " + what;
        return std::nullopt;
    };
    const auto wants = [&](const std::string& key, const char* what) {
        return wrong(quoted("", key, " wants ") + what);
    };
    while (!ended && std::getline(in, line)) {
        ++number;
        DescriptionLine here(line);
        if (here.says_nothing()) continue;
        const std::string& key = here.keyword;
        const char* wanted = "";
        if (!begun) {
            std::string version;
            if (key != "bumpstop-robot" || !here.word(version) || version != "1")
                return wrong("not a robot description of version 1");
            begun = true;
        } else if (key == "name" || key == "tip") {
            if (!of_robot.take(key)) return wrong(quoted("", key, " comes twice"));
            std::string& name = key == "name" ? robot.name : robot.tip_name;
            if (key == "tip" && !(here.finite_numbers(robot.tip_origin.data(), 3) &&
                                  here.finite_numbers(robot.tip_rotation.data(), 9) && is_rotation(robot.tip_rotation)))
                return wants(key, "twelve numbers and a name");
            name = here.rest();
            if (name.empty()) return wants(key, "a name");
        } else if (key == "joint" || key == "end") {
            if (!robot.joints.empty()) {
                const std::string missing = of_joint.missing({"link", "origin", "rotation", "axis", "limits"});
                if (!missing.empty()) return wrong(quoted("joint ", robot.joints.back().name, " has no ") + missing);
                of_joint.clear();
            }
            ended = key == "end";
            if (!ended) {
                RobotDescription::Joint& joint = robot.joints.emplace_back();
                if (robot.joints.size() > std::size_t(max_joints))
                    return wrong("more than " + std::to_string(max_joints) + " joints");
                std::string kind;
                joint.spec.prismatic = here.word(kind) && kind == "prismatic";
                joint.name = here.rest();
                if ((kind != "revolute" && kind != "prismatic") || joint.name.empty())
                    return wants(key, "revolute or prismatic, and a name");
            }
        } else if (robot.joints.empty()) {
            return wrong(quoted("", key, " before the first joint"));
        } else if (!read_joint_line(here, robot.joints.back(), wanted)) {
            return wrong(quoted("unknown keyword ", key, ""));
        } else if (*wanted != 0) {
            return wants(key, wanted);
        } else if (!of_joint.take(key)) {
            return wrong(quoted("", key, " comes twice"));
        }
        if (!here.done()) return wrong(quoted("", key, " is followed by too much"));
    }
    if (!begun || !ended) return wrong(begun ? "the description ends without 'end'" : "the description is empty");
    if (robot.joints.empty()) return wrong("no joints");
    const std::string missing = of_robot.missing({"name", "tip"});
    if (!missing.empty()) return wrong(quoted("", missing, " is missing"));
    return robot;
}

/// The next line that says something; false at the end of the text.
inline bool next_line(std::istream& in, std::string& line, int& number) {
    while (std::getline(in, line)) {
        ++number;
        if (!DescriptionLine(line).says_nothing()) return true;
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
