/// @file
/// Reads a robot from the file that `bumpstop robots export` writes.
#pragma once

#include <optional>

#include "bumpstop/model/description_text.hpp"
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

/// Whether m is a rotation matrix, by the same tolerance as in Python.
inline bool is_rotation(const Matrix3& m) {
    const Matrix3 square = m * transposed(m);
    const double determinant =
        m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
    for (int k = 0; k < 9; ++k)
        if (!(std::fabs(square[k] - (k % 4 == 0 ? 1 : 0)) <= 1e-9)) return false;
    return determinant > 0;
}
inline bool is_unit_vector(const Vector3& v) { return std::fabs(std::hypot(v[0], v[1], v[2]) - 1) <= 1e-9; }

/// Reads a robot up to its line 'end'.
inline std::optional<RobotDescription> read_robot_part(DescriptionText& text) {
    RobotDescription robot;
    RobotDescription::Joint joint;  // the last one begun
    std::array<double, 12> tip{};
    std::array<double, 14> inertia{};
    double limits[3] = {};
    const auto rotation_of_tip = [&] {
        std::copy_n(tip.begin() + 3, 9, robot.tip_rotation.begin());
        return is_rotation(robot.tip_rotation);
    };
    constexpr double inf = std::numeric_limits<double>::infinity(), most = DescriptionField::largest;
    std::vector<DescriptionField> of_robot{
        {"name", nullptr, 0, 0, 0, "a name", {}, &robot.name},
        {"tip", tip.data(), 12, -most, most, "twelve numbers and a name", rotation_of_tip, &robot.tip_name}};
    std::vector<DescriptionField> of_joint{
        {"link", nullptr, 0, 0, 0, "a name", {}, &joint.link},
        {"origin", joint.spec.origin.data(), 3, -most, most},
        {"rotation", joint.spec.rotation.data(), 9, -most, most, "nine numbers of a rotation",
         [&] { return is_rotation(joint.spec.rotation); }},
        {"axis", joint.spec.axis.data(), 3, -most, most, "a unit vector",
         [&] { return is_unit_vector(joint.spec.axis); }},
        {"limits", limits, 3, -inf, inf, "lower, upper and speed",
         [&] { return limits[0] < limits[1] && limits[2] > 0; }},
        {"inertia", inertia.data(), 14, -most, most, "fourteen numbers",
         [&] { return inertia[0] >= 0 && inertia[13] >= 0; }, nullptr, true}};
    const auto wrong = [&](const std::string& what) {
        text.fail(what);
        return std::nullopt;
    };
    std::string word;
    if (!text.next()) return wrong("the description is empty");
    if (text.keyword != "bumpstop-robot" || !text.word(word) || word != "1")
        return wrong("not a robot description of version 1");
    for (bool begun = false, ended = false; !ended;) {
        if (!text.done()) return std::nullopt;
        if (!text.next()) return wrong("the description ends without 'end'");
        if (text.keyword == "name" || text.keyword == "tip") {
            if (!text.read(of_robot)) return std::nullopt;
        } else if (text.keyword == "joint" || text.keyword == "end") {
            if (begun) {
                if (const char* lacks = missing(of_joint))
                    return wrong(quoted("joint ", joint.name, " has no ") + lacks);
                joint.lower = limits[0];
                joint.upper = limits[1];
                joint.velocity = limits[2];
                joint.inertia.reset();
                if (of_joint.back().seen) {
                    LinkInertia& link = joint.inertia.emplace(LinkInertia{inertia[0], {}, {}, inertia[13]});
                    std::copy_n(&inertia[1], 3, link.center.begin());
                    std::copy_n(&inertia[4], 9, link.tensor.begin());
                }
                robot.joints.push_back(joint);
                for (DescriptionField& field : of_joint) field.seen = false;
            }
            ended = text.keyword == "end";
            if (ended) continue;
            begun = true;
            if (robot.joints.size() == std::size_t(max_joints))
                return wrong("more than " + std::to_string(max_joints) + " joints");
            const bool known = text.word(word) && (word == "revolute" || word == "prismatic");
            if (!known || !text.name(joint.name)) return wrong("'joint' wants revolute or prismatic, and a name");
            joint.spec.prismatic = word == "prismatic";
        } else if (!begun) {
            return wrong(quoted("", text.keyword, " before the first joint"));
        } else if (!text.read(of_joint)) {
            return std::nullopt;
        }
    }
    if (!text.done()) return std::nullopt;
    if (robot.joints.empty()) return wrong("no joints");
    if (const char* lacks = missing(of_robot)) return wrong(quoted("", lacks, " is missing"));
    std::copy_n(tip.begin(), 3, robot.tip_origin.begin());
    return robot;
}

}  // namespace detail

/// Reads a description. Where the text is not valid the result is empty, and `error` says why and in which line.
inline std::optional<RobotDescription> read_robot(std::istream& in, std::string& error) {
    detail::DescriptionText text(in, error);
    std::optional<RobotDescription> robot = detail::read_robot_part(text);
    if (!robot || !text.next()) return robot;
    text.fail("text after 'end'");
    return std::nullopt;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
