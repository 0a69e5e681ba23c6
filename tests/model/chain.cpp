// Kinematics for a double and for lanes against products of matrices. The Python tests go through the kernels,
// which use the widest lanes only.
#include <vector>

#include "bumpstop/model/kinematics.hpp"
#include "model/random_chain.hpp"

namespace {

using namespace bumpstop;
using namespace random_chain;

void frames_from_an_axis() {
    std::vector<Vector3> axes{{1, 0, 0},  {-1, 0, 0},    {0, 1, 0},      {0, -1, 0},          {0, 0, 1},
                              {0, 0, -1}, {1e-9, 0, -1}, {0, -1e-12, 1}, {1e-160, 1e-160, -1}};
    for (int i = 0; i < 200; ++i) axes.push_back(random_unit());
    for (const Vector3& axis : axes) {
        const Matrix3 r = rotation_from_z(axis), square = r * transposed(r);
        for (int i = 0; i < 3; ++i) CHECK(r[3 * i + 2] == axis[i]);
        for (int i = 0; i < 9; ++i) CHECK_NEAR(square[i], i % 4 == 0, 1e-15);
        const Vector3 x{r[0], r[3], r[6]}, y{r[1], r[4], r[7]};
        CHECK_NEAR(x[0] * y[1] - x[1] * y[0], axis[2], 1e-15);  // right-handed
    }
}

// Position of a point of a link by products of matrices.
Vector3 naive_position(const Case& made, const std::vector<double>& q, int link, const Vector3& point) {
    Matrix3 r{1, 0, 0, 0, 1, 0, 0, 0, 1};
    Vector3 p{};
    auto advance = [&](const Vector3& step) {
        const Vector3 moved = r * step;
        for (int i = 0; i < 3; ++i) p[i] += moved[i];
    };
    for (int j = 0; j <= link; ++j) {
        const JointSpec& joint = made.joints[std::size_t(j)];
        advance(joint.origin);
        r = r * joint.rotation;
        if (joint.prismatic) {
            advance({joint.axis[0] * q[j], joint.axis[1] * q[j], joint.axis[2] * q[j]});
        } else {
            r = r * rotation_about(joint.axis, q[j]);
        }
    }
    advance(point);
    return p;
}

template <class T>
void kinematics() {
    constexpr int lanes = Scalar<T>::lanes;
    for (int dof = 1; dof <= max_joints; ++dof) {
        for (int trial = 0; trial < 10; ++trial) {
            const Case made = random_case(dof);
            std::vector<double> q[lanes];
            T position[max_joints], rate[max_joints];
            JointAngles<T> angle;
            for (int j = 0; j < dof; ++j) {
                for (int lane = 0; lane < lanes; ++lane) {
                    q[lane].push_back(checks::uniform(-pi, pi));
                    set_lane(position[j], lane, q[lane][j]);
                    set_lane(rate[j], lane, checks::normal());
                }
                angle.set(made.chain, j, position[j]);
            }
            Posture<T> posture;
            forward_kinematics(made.chain, position, angle, posture);
            for (int link = -1; link < dof; ++link) {
                const Vector3 point{checks::uniform(-1, 1), checks::uniform(-1, 1), checks::uniform(-1, 1)};
                const LinkPoint on_link = link_point(made.chain, link, point);
                const Point3<T> p = posture.position(on_link);
                const Point3<T> velocity = point_velocity(made.chain, posture, link, p, rate);
                for (int lane = 0; lane < lanes; ++lane) {
                    const Vector3 exact = naive_position(made, q[lane], link, point);
                    // Each joint adds a rotation and a step of at most 2 + pi m, with some roundings of each.
                    const double bound = 100 * (link + 2) * 0x1p-52 * (2 + 5 * (link + 1));
                    CHECK_NEAR(lane_of(p.x, lane), exact[0], bound);
                    CHECK_NEAR(lane_of(p.y, lane), exact[1], bound);
                    CHECK_NEAR(lane_of(p.z, lane), exact[2], bound);
                    if (trial > 0) continue;
                    // Columns of the Jacobian by central differences, whose error is some 1e-10.
                    for (int j = 0; j <= link; ++j) {
                        const double h = 1e-5;
                        std::vector<double> ahead = q[lane], behind = q[lane];
                        ahead[j] += h;
                        behind[j] -= h;
                        const Vector3 a = naive_position(made, ahead, link, point);
                        const Vector3 b = naive_position(made, behind, link, point);
                        const Point3<T> column = linear_column(made.chain, posture, p, j);
                        CHECK_NEAR(lane_of(column.x, lane), (a[0] - b[0]) / (2 * h), 1e-7);
                        CHECK_NEAR(lane_of(column.y, lane), (a[1] - b[1]) / (2 * h), 1e-7);
                        CHECK_NEAR(lane_of(column.z, lane), (a[2] - b[2]) / (2 * h), 1e-7);
                    }
                    const double h = 1e-5;
                    std::vector<double> ahead = q[lane], behind = q[lane];
                    for (int j = 0; j < dof; ++j) {
                        ahead[j] += h * lane_of(rate[j], lane);
                        behind[j] -= h * lane_of(rate[j], lane);
                    }
                    const Vector3 a = naive_position(made, ahead, link, point);
                    const Vector3 b = naive_position(made, behind, link, point);
                    const Vector3 v = lane_of(velocity, lane);
                    for (int k = 0; k < 3; ++k) CHECK_NEAR(v[k], (a[k] - b[k]) / (2 * h), 1e-5 * (1 + std::fabs(v[k])));
                }
            }
        }
    }
}

}  // namespace

int main() {
    frames_from_an_axis();
    kinematics<double>();
    kinematics<Lanes<2>>();
    kinematics<Lanes<4>>();
    kinematics<Lanes<8>>();
    return checks::result();
}
