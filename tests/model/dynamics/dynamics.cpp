// Dynamics for a double and for lanes against Newton-Euler in the base frame, and singular values against what they
// must make up. The Python tests go through the kernels, which use the widest lanes only.
#include "bumpstop/model/dynamics.hpp"

#include "bumpstop/model/singular_values.hpp"
#include "model/random_chain.hpp"

namespace {

using namespace bumpstop;
using namespace random_chain;

using P = Point3<double>;
P vector_of(const Vector3& v) { return {v[0], v[1], v[2]}; }
P times(const Matrix3& m, const P& v) { return vector_of(m * Vector3{v.x, v.y, v.z}); }
P scaled(const P& v, double s) { return {v.x * s, v.y * s, v.z * s}; }

LinkInertia random_inertia() {
    LinkInertia made;
    made.rotor = checks::uniform(0, 1);
    // Six masses in a body have a tensor that a body can have.
    std::array<Vector3, 6> r;
    for (Vector3& point : r) {
        for (int k = 0; k < 3; ++k) {
            point[k] = checks::uniform(-0.3, 0.3);
            made.center[k] += point[k] / 6;
        }
    }
    const double m = checks::uniform(0.1, 2);
    made.mass = 6 * m;
    for (const Vector3& point : r) {
        Vector3 d;
        for (int k = 0; k < 3; ++k) d[k] = point[k] - made.center[k];
        const double square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        for (int k = 0; k < 3; ++k)
            for (int l = 0; l < 3; ++l) made.tensor[3 * k + l] += m * ((k == l ? square : 0) - d[k] * d[l]);
    }
    return made;
}

struct Motion {
    std::vector<double> q, qd, qdd;
};

// Newton-Euler in the base frame, from products of matrices and the links as they were given.
std::vector<double> naive(const Case& made, const std::vector<LinkInertia>& links, const Motion& motion, P gravity,
                          int pushed, const Vector3& place, P push, P twist) {
    const int dof = int(links.size());
    std::vector<P> axis, origin, force, center, moment;
    Matrix3 r{1, 0, 0, 0, 1, 0, 0, 0, 1};
    P p{0, 0, 0}, w{0, 0, 0}, wd{0, 0, 0}, a = scaled(gravity, -1), at{0, 0, 0};
    for (int i = 0; i < dof; ++i) {
        const JointSpec& joint = made.joints[std::size_t(i)];
        const LinkInertia& link = links[std::size_t(i)];
        const auto move = [&](const P& d) {
            a = a + cross(wd, d) + cross(w, cross(w, d));
            p = p + d;
        };
        move(times(r, vector_of(joint.origin)));
        r = r * joint.rotation;
        const P z = times(r, vector_of(joint.axis));
        axis.push_back(z);
        origin.push_back(p);
        if (joint.prismatic) {
            move(scaled(z, motion.q[i]));
            a = a + scaled(z, motion.qdd[i]) + scaled(cross(w, z), 2 * motion.qd[i]);
        } else {
            r = r * rotation_about(joint.axis, motion.q[i]);
            wd = wd + scaled(z, motion.qdd[i]) + scaled(cross(w, z), motion.qd[i]);
            w = w + scaled(z, motion.qd[i]);
        }
        const P c = times(r, vector_of(link.center));
        const Matrix3 tensor = r * link.tensor * transposed(r);
        center.push_back(p + c);
        force.push_back(scaled(a + cross(wd, c) + cross(w, cross(w, c)), link.mass));
        moment.push_back(times(tensor, wd) + cross(w, times(tensor, w)));
        if (i == pushed) at = p + times(r, vector_of(place));
    }
    std::vector<double> tau;
    for (int j = 0; j < dof; ++j) {
        P f{0, 0, 0}, n{0, 0, 0};
        for (int i = j; i < dof; ++i) {
            f = f + force[i];
            n = n + moment[i] + cross(center[i] - origin[j], force[i]);
        }
        if (j <= pushed) {
            f = f - push;
            n = n - twist - cross(at - origin[j], push);
        }
        tau.push_back(dot(axis[j], made.joints[std::size_t(j)].prismatic ? f : n) + links[j].rotor * motion.qdd[j]);
    }
    return tau;
}

double largest(const std::vector<double>& values) {
    double most = 0;
    for (double value : values) most = std::max(most, std::fabs(value));
    return most;
}

template <class T>
void dynamics() {
    constexpr int lanes = Scalar<T>::lanes;
    for (int dof = 1; dof <= max_joints; ++dof) {
        for (int trial = 0; trial < 6; ++trial) {
            const Case made = random_case(dof);
            std::vector<LinkInertia> links;
            for (int j = 0; j < dof; ++j) links.push_back(random_inertia());
            const Inertias inertias(made.chain, links);
            Motion motion[lanes];
            T q[max_joints], qd[max_joints], qdd[max_joints], tau[max_joints];
            for (int j = 0; j < dof; ++j) {
                for (int lane = 0; lane < lanes; ++lane) {
                    Motion& one = motion[lane];
                    one.q.push_back(checks::uniform(-pi, pi));
                    one.qd.push_back(checks::uniform(-1, 1));
                    one.qdd.push_back(checks::uniform(-3, 3));
                    set_lane(q[j], lane, one.q[j]);
                    set_lane(qd[j], lane, one.qd[j]);
                    set_lane(qdd[j], lane, one.qdd[j]);
                }
            }
            JointAngles<T> angle;
            angle.set(made.chain, q);

            const Vector3 g{checks::uniform(-9, 9), checks::uniform(-9, 9), checks::uniform(-9, 9)};
            const Vector3 place{checks::uniform(-1, 1), checks::uniform(-1, 1), checks::uniform(-1, 1)};
            const int pushed = int(checks::uniform(0, dof));
            const Wrench<T> wrench{
                link_point(made.chain, pushed, place), {T(3.0), T(-20.0), T(7.0)}, {T(-1.0), T(2.0), T(0.5)}};
            inverse_dynamics(made.chain, inertias, {q, angle, qd, qdd}, g, wrench, tau);
            double scale[lanes];
            for (int lane = 0; lane < lanes; ++lane) {
                const std::vector<double> exact =
                    naive(made, links, motion[lane], vector_of(g), pushed, place, {3, -20, 7}, {-1, 2, 0.5});
                scale[lane] = 1 + largest(exact);
                for (int j = 0; j < dof; ++j) CHECK_NEAR(lane_of(tau[j], lane), exact[j], 1e-12 * scale[lane]);
            }

            // The parts make up the whole, the mass matrix by its columns.
            T held[max_joints], swung[max_joints], pushing[max_joints], m[max_joints][max_joints];
            gravity_torque(made.chain, inertias, q, angle, g, held);
            coriolis_torque(made.chain, inertias, q, angle, qd, swung);
            mass_matrix(made.chain, inertias, q, angle, m);
            Posture<T> posture;
            forward_kinematics(made.chain, q, angle, posture);
            external_torque(made.chain, posture, wrench, pushing);
            for (int j = 0; j < dof; ++j) {
                T sum = held[j] + swung[j] - pushing[j];
                for (int k = 0; k < dof; ++k) sum += m[j][k] * qdd[k];
                for (int lane = 0; lane < lanes; ++lane)
                    CHECK_NEAR(lane_of(sum, lane), lane_of(tau[j], lane), 1e-11 * scale[lane]);
            }

            // The factor multiplies back, and the effective mass is that of M y = J' n.
            const Point3<T> n{T(0.6), T(0.0), T(-0.8)};
            const T heavy = effective_mass(made.chain, inertias, q, angle, wrench.point, n);
            T factor[max_joints][max_joints], y[max_joints], x[max_joints];
            for (int j = 0; j < dof; ++j)
                for (int k = 0; k < dof; ++k) factor[j][k] = m[j][k];
            CHECK(all(cholesky(factor, dof)));
            for (int j = 0; j < dof; ++j) {
                for (int k = 0; k <= j; ++k) {
                    T sum = 0.0;
                    for (int l = 0; l <= k; ++l) sum += factor[j][l] * factor[k][l];
                    for (int lane = 0; lane < lanes; ++lane)
                        CHECK_NEAR(lane_of(sum, lane), lane_of(m[j][k], lane),
                                   1e-13 * lane_of(m[0][0] + m[j][j], lane));
                }
            }
            external_torque(made.chain, posture, Wrench<T>{wrench.point, n, {T(0.0), T(0.0), T(0.0)}}, x);
            for (int j = 0; j < dof; ++j) {
                y[j] = x[j];
                for (int k = 0; k < j; ++k) y[j] -= factor[j][k] * y[k];
                y[j] = y[j] / factor[j][j];
            }
            for (int j = dof - 1; j >= 0; --j) {
                for (int k = j + 1; k < dof; ++k) y[j] -= factor[k][j] * y[k];
                y[j] = y[j] / factor[j][j];
            }
            T inverse = 0.0;
            for (int j = 0; j < dof; ++j) inverse += x[j] * y[j];
            for (int lane = 0; lane < lanes; ++lane) CHECK_NEAR(lane_of(heavy * inverse, lane), 1, 1e-9);
        }
    }
}

// A motion that moves no mass is told from one that does, in its own lane.
void massless() {
    using L = Lanes<2>;
    L m[max_joints][max_joints];
    m[0][0] = 4.0;
    m[0][1] = m[1][0] = 2.0;
    m[1][1] = 1.0;
    set_lane(m[1][1], 1, 1.5);
    const auto definite = cholesky(m, 2);
    CHECK(!lane_of(definite, 0));
    CHECK(lane_of(definite, 1));
}

template <int Rows, class T>
void values_of(int columns, bool dependent) {
    constexpr int lanes = Scalar<T>::lanes;
    T row[Rows][max_joints], original[Rows][max_joints], values[Rows];
    for (int a = 0; a < Rows; ++a) {
        for (int j = 0; j < columns; ++j) {
            for (int lane = 0; lane < lanes; ++lane)
                set_lane(row[a][j], lane, dependent && a == 1 ? 2 * lane_of(row[0][j], lane) : checks::normal());
            original[a][j] = row[a][j];
        }
    }
    singular_values_of<Rows>(row, columns, values);
    for (int lane = 0; lane < lanes; ++lane) {
        // They are sorted, and their squares and fourth powers sum up to the traces of R R' and of its square.
        double two = 0, four = 0, square = 0, fourth = 0;
        for (int a = 0; a < Rows; ++a) {
            const double value = lane_of(values[a], lane);
            CHECK(value >= 0 && (a == 0 || value <= lane_of(values[a - 1], lane)));
            two += value * value;
            four += value * value * value * value;
            for (int b = 0; b < Rows; ++b) {
                double product = 0;
                for (int j = 0; j < columns; ++j)
                    product += lane_of(original[a][j], lane) * lane_of(original[b][j], lane);
                if (a == b) square += product;
                fourth += product * product;
            }
        }
        CHECK_NEAR(two, square, 1e-13 * square);
        CHECK_NEAR(four, fourth, 1e-13 * fourth);
        if (dependent) CHECK_NEAR(lane_of(values[Rows - 1], lane), 0, 1e-14 * std::sqrt(square));
        for (int a = columns; a < Rows; ++a) CHECK(lane_of(values[a], lane) == 0);
    }
}
template <class T>
void singular() {
    for (int trial = 0; trial < 20; ++trial) {
        for (int columns = 1; columns <= max_joints; ++columns) {
            values_of<3, T>(columns, trial % 2 == 0);
            values_of<6, T>(columns, trial % 2 == 0);
        }
    }
}

}  // namespace

int main() {
    dynamics<double>();
    dynamics<Lanes<2>>();
    dynamics<Lanes<4>>();
    dynamics<Lanes<8>>();
    massless();
    singular<double>();
    singular<Lanes<4>>();
    return checks::result();
}
