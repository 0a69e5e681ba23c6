// Random chains for the C++ test programs.
#pragma once

#include <vector>

#include "bumpstop/model/chain.hpp"
#include "math/check.hpp"

namespace random_chain {

using namespace bumpstop;

inline constexpr double pi = 3.14159265358979323846;

inline Vector3 random_unit() {
    Vector3 v{checks::normal(), checks::normal(), checks::normal()};
    const double length = std::hypot(v[0], v[1], v[2]);
    return {v[0] / length, v[1] / length, v[2] / length};
}

// Rotation by `angle` about a unit vector (Rodrigues).
inline Matrix3 rotation_about(const Vector3& u, double angle) {
    const double c = std::cos(angle), s = std::sin(angle), t = 1 - c;
    return {t * u[0] * u[0] + c,        t * u[0] * u[1] - s * u[2], t * u[0] * u[2] + s * u[1],
            t * u[1] * u[0] + s * u[2], t * u[1] * u[1] + c,        t * u[1] * u[2] - s * u[0],
            t * u[2] * u[0] - s * u[1], t * u[2] * u[1] + s * u[0], t * u[2] * u[2] + c};
}

struct Case {
    std::vector<JointSpec> joints;
    Chain chain;
};
inline Case random_case(int dof) {
    Case made;
    for (int j = 0; j < dof; ++j) {
        JointSpec joint;
        joint.prismatic = checks::uniform(0, 1) < 0.3;
        joint.axis = random_unit();
        for (double& d : joint.origin) d = checks::uniform(0, 1) < 0.3 ? 0 : checks::uniform(-1, 1);
        if (checks::uniform(0, 1) < 0.7) joint.rotation = rotation_about(random_unit(), checks::uniform(-pi, pi));
        // Every third joint is parallel or antiparallel to the one before.
        if (j % 3 == 2) {
            joint.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
            joint.axis = made.joints.back().axis;
            if (j % 2 == 0)
                for (double& a : joint.axis) a = -a;
        }
        made.joints.push_back(joint);
    }
    made.chain = Chain(made.joints);
    return made;
}

}  // namespace random_chain
