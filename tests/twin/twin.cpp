// The slow twin: a literal, step-by-step simulation of a robot arm that runs into a spring.
//
// It exists to be compared with the fast library, so it shares nothing with it: no headers, no shortcuts, no
// vectors, nothing precomputed. Everything is worked out again at every controller sub-step, in the order in
// which the story is told: where are the joints, which way should they move, how fast may they change, where
// is the contact point now, how hard does the spring push, would the motor currents show it?
//
// Model of the simulator in the appendix of K. Schroeder, "Requirements for Effective Collision Detection on
// Industrial Serial Manipulators", The University of Texas at Austin, 2013.
//
// Time: simulation step i = 0, 1, 2, ... begins at i * step and ends at (i + 1) * step; positions and forces
// belong to its end. Feedback tick k happens at the end of step k * period_steps.
//
// Units: m, rad, s, N, Nm. For a prismatic joint read m for rad and N for Nm. All vectors are in the base
// frame unless a comment says otherwise.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>

namespace {

constexpr int kMaxJoints = 16;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

enum JointKind : std::int32_t { kRevolute = 0, kPrismatic = 1 };
enum Task : std::int32_t { kPose = 0, kPosition = 1 };
enum Reaction : std::int32_t { kReverse = 0, kStop = 1 };
enum Status : std::int32_t { kOk = 0, kContactPointDoesNotMove = 1 };

using Vec3 = std::array<double, 3>;
using Mat3 = std::array<double, 9>;  // row-major
using PerJoint = std::array<double, kMaxJoints>;

// ---------------------------------------------------------------------------------------------------------
// What the caller hands over and gets back. The Python wrapper repeats these two layouts field by field; the
// functions twin_problem_size and twin_run_size let it notice when they have drifted apart.
// ---------------------------------------------------------------------------------------------------------

struct Problem {
    // The arm. Each joint's origin stands in the frame of the link before it, as in a URDF.
    std::int32_t joint_count;
    std::int32_t kind[kMaxJoints];  // JointKind
    std::int32_t held[kMaxJoints];  // 1: this joint does not move
    double origin_xyz[kMaxJoints][3];
    double origin_rotation[kMaxJoints][9];
    double axis[kMaxJoints][3];  // unit vector in the joint's own frame
    double tip[3];               // in the last link's frame

    // The motion.
    std::int32_t task;           // Task: hold the tip's orientation, or let it go
    std::int32_t start_at_rest;  // 0: the joints already move as the motion asks
    double start_position[kMaxJoints];
    double velocity[3];            // of the tip
    double duration;               // a run without detection ends here
    double singular_tolerance;     // singular values below this share of the largest one are dropped
    double damping;                // lambda of the damped pseudo-inverse; 0 is exact
    double max_speed[kMaxJoints];  // infinity: no limit
    double max_acceleration[kMaxJoints];

    // The contact.
    std::int32_t contact_at_tip;  // 1: contact_link and contact_point are the tip
    std::int32_t contact_link;    // the link moved by this joint (0-based)
    double contact_point[3];      // in that link's frame
    std::int32_t normal_given;    // 0: the direction the contact point moves in at the start
    double normal[3];             // unit vector
    double stiffness;             // N/m
    std::int32_t per_axis_walls;  // 1: three walls across x, y, z instead of one plane (tip only)
    std::int32_t mirrored_walls;  // 1: each of them also stands, mirrored, behind the start

    // The detector.
    std::int32_t period_steps;  // simulation steps between two feedback ticks
    double threshold[kMaxJoints];
    double arming_delay;
    double noise_mean[kMaxJoints];  // only used when the noise is drawn here
    double noise_sd[kMaxJoints];

    // The reaction and the simulation.
    std::int32_t reaction;  // Reaction
    std::int32_t latency_steps;
    std::int32_t run_length_slip;
    std::int32_t run_until_free;
    double release_limit;  // how much longer run_until_free may wait
    double step;
    std::int32_t substeps;
};

struct Run {
    std::int32_t detected;
    std::int32_t false_alarm;  // detected while the contact force was zero
    std::int32_t detection_tick;
    std::uint32_t trigger_mask;  // bit j: joint j was over its threshold at the tick of detection
    double detection_time;
    double end_time;
    double force_at_detection;
    double force_at_end;
    double max_force;
    double max_force_axis[3];
    double max_compression;  // of the spring
    double max_deflection;   // distance to the undeformed surface, on whichever side of it
    double max_deflection_axis[3];
    double max_travel;  // farthest s
    double contact_start_time;
    double contact_end_time;
    double residual_at_detection[kMaxJoints];
    double noise_at_detection[kMaxJoints];
};

// One row per simulation step; null pointers are not filled.
struct TraceArrays {
    double* time;
    double* position;        // joint_count values a row
    double* velocity;        // joint_count values a row
    double* point;           // 3 values a row
    double* travel;          // s
    double* force;           // magnitude
    double* contact_torque;  // joint_count values a row: the residual without noise
    double* residual;        // joint_count values a row; NaN between ticks and where the noise has ended
};

// ---------------------------------------------------------------------------------------------------------
// Vectors and rotations.
// ---------------------------------------------------------------------------------------------------------

Vec3 vec3(const double* p) { return {p[0], p[1], p[2]}; }
Vec3 operator+(const Vec3& a, const Vec3& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
Vec3 operator-(const Vec3& a, const Vec3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Vec3 operator*(double k, const Vec3& a) { return {k * a[0], k * a[1], k * a[2]}; }
double dot(const Vec3& a, const Vec3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
double norm(const Vec3& a) { return std::sqrt(dot(a, a)); }

Vec3 cross(const Vec3& a, const Vec3& b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

Vec3 multiply(const Mat3& m, const Vec3& v) {
    return {m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
            m[6] * v[0] + m[7] * v[1] + m[8] * v[2]};
}

Mat3 multiply(const Mat3& a, const Mat3& b) {
    Mat3 product{};
    for (int row = 0; row < 3; ++row) {
        for (int column = 0; column < 3; ++column) {
            double sum = 0;
            for (int k = 0; k < 3; ++k) sum += a[3 * row + k] * b[3 * k + column];
            product[3 * row + column] = sum;
        }
    }
    return product;
}

// Rodrigues' formula: turn by `angle` about the unit vector `u`.
Mat3 rotation_about(const Vec3& u, double angle) {
    const double c = std::cos(angle);
    const double s = std::sin(angle);
    const double k = 1 - c;
    return {c + k * u[0] * u[0],        k * u[0] * u[1] - s * u[2], k * u[0] * u[2] + s * u[1],
            k * u[1] * u[0] + s * u[2], c + k * u[1] * u[1],        k * u[1] * u[2] - s * u[0],
            k * u[2] * u[0] - s * u[1], k * u[2] * u[1] + s * u[0], c + k * u[2] * u[2]};
}

// ---------------------------------------------------------------------------------------------------------
// Kinematics.
// ---------------------------------------------------------------------------------------------------------

struct Frames {
    std::array<Vec3, kMaxJoints> joint_origin;  // a point on each joint's axis
    std::array<Vec3, kMaxJoints> joint_axis;
    std::array<Mat3, kMaxJoints> link_rotation;  // the link that each joint moves
    std::array<Vec3, kMaxJoints> link_origin;
};

void forward_kinematics(const Problem& problem, const PerJoint& position, Frames& frames) {
    Mat3 rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    Vec3 origin = {0, 0, 0};
    for (int j = 0; j < problem.joint_count; ++j) {
        Mat3 fixed;
        std::copy_n(problem.origin_rotation[j], 9, fixed.begin());
        const Vec3 axis = vec3(problem.axis[j]);
        origin = origin + multiply(rotation, vec3(problem.origin_xyz[j]));
        rotation = multiply(rotation, fixed);
        frames.joint_origin[j] = origin;
        frames.joint_axis[j] = multiply(rotation, axis);
        if (problem.kind[j] == kRevolute) {
            rotation = multiply(rotation, rotation_about(axis, position[j]));
        } else {
            origin = origin + position[j] * frames.joint_axis[j];
        }
        frames.link_rotation[j] = rotation;
        frames.link_origin[j] = origin;
    }
}

Vec3 point_on_link(const Frames& frames, int link, const double* point) {
    return frames.link_origin[link] + multiply(frames.link_rotation[link], vec3(point));
}

// Column of the geometric Jacobian: what joint j moving at unit speed does to a point of a link.
struct JacobianColumn {
    Vec3 linear;
    Vec3 angular;
};

JacobianColumn jacobian_column(const Problem& problem, const Frames& frames, int joint, int link, const Vec3& point) {
    if (joint > link) return {{0, 0, 0}, {0, 0, 0}};  // a joint beyond the link does not move it
    const Vec3& axis = frames.joint_axis[joint];
    if (problem.kind[joint] == kPrismatic) return {axis, {0, 0, 0}};
    return {cross(axis, point - frames.joint_origin[joint]), axis};
}

// ---------------------------------------------------------------------------------------------------------
// Pseudo-inverse by singular value decomposition.
// ---------------------------------------------------------------------------------------------------------

struct Matrix {
    int rows = 0;
    int columns = 0;
    double at[kMaxJoints][kMaxJoints];  // [row][column]
};

// One-sided Jacobi: turn pairs of columns of W = A V against each other until all are orthogonal. Then the
// lengths of W's columns are the singular values, W = U S, and the pseudo-inverse is
//     V diag(g) U^T   with g = 1 / s (exact), 0 (dropped), or s / (s^2 + damping^2) (damped).
// The damped form equals A^T (A A^T + damping^2 I)^-1.
void pseudo_inverse(const Matrix& matrix, double relative_tolerance, double damping, Matrix& inverse) {
    const bool wide = matrix.rows < matrix.columns;  // work on the transpose: as few columns as possible
    const int rows = wide ? matrix.columns : matrix.rows;
    const int columns = wide ? matrix.rows : matrix.columns;

    double w[kMaxJoints][kMaxJoints];  // [column][row]
    double v[kMaxJoints][kMaxJoints];  // [column][row]
    for (int c = 0; c < columns; ++c) {
        for (int r = 0; r < rows; ++r) w[c][r] = wide ? matrix.at[c][r] : matrix.at[r][c];
        for (int r = 0; r < columns; ++r) v[c][r] = r == c ? 1 : 0;
    }

    constexpr int kMaxSweeps = 60;         // six or seven are usual
    constexpr double kOrthogonal = 1e-15;  // cosine between two columns that counts as a right angle
    bool turned = true;
    for (int sweep = 0; sweep < kMaxSweeps && turned; ++sweep) {
        turned = false;
        for (int p = 0; p + 1 < columns; ++p) {
            for (int q = p + 1; q < columns; ++q) {
                double pp = 0;
                double qq = 0;
                double pq = 0;
                for (int r = 0; r < rows; ++r) {
                    pp += w[p][r] * w[p][r];
                    qq += w[q][r] * w[q][r];
                    pq += w[p][r] * w[q][r];
                }
                if (!(std::fabs(pq) > kOrthogonal * std::sqrt(pp * qq))) continue;
                turned = true;
                const double zeta = (qq - pp) / (2 * pq);
                const double tangent = std::copysign(1.0, zeta) / (std::fabs(zeta) + std::hypot(1.0, zeta));
                const double cosine = 1 / std::sqrt(1 + tangent * tangent);
                const double sine = cosine * tangent;
                for (int r = 0; r < rows; ++r) {
                    const double old = w[p][r];
                    w[p][r] = cosine * old - sine * w[q][r];
                    w[q][r] = sine * old + cosine * w[q][r];
                }
                for (int r = 0; r < columns; ++r) {
                    const double old = v[p][r];
                    v[p][r] = cosine * old - sine * v[q][r];
                    v[q][r] = sine * old + cosine * v[q][r];
                }
            }
        }
    }

    double singular[kMaxJoints];
    double largest = 0;
    for (int c = 0; c < columns; ++c) {
        double sum = 0;
        for (int r = 0; r < rows; ++r) sum += w[c][r] * w[c][r];
        singular[c] = std::sqrt(sum);
        largest = std::max(largest, singular[c]);
    }

    inverse.rows = matrix.columns;
    inverse.columns = matrix.rows;
    for (int r = 0; r < inverse.rows; ++r) {
        for (int c = 0; c < inverse.columns; ++c) inverse.at[r][c] = 0;
    }
    for (int k = 0; k < columns; ++k) {
        const double s = singular[k];
        if (s == 0) continue;
        double gain = 0;
        if (damping > 0) {
            gain = s / (s * s + damping * damping);
        } else if (s > relative_tolerance * largest) {
            gain = 1 / s;
        }
        if (gain == 0) continue;
        for (int a = 0; a < columns; ++a) {
            for (int b = 0; b < rows; ++b) {
                const double term = v[k][a] * gain * (w[k][b] / s);
                (wide ? inverse.at[b][a] : inverse.at[a][b]) += term;
            }
        }
    }
}

// ---------------------------------------------------------------------------------------------------------
// The position controller.
// ---------------------------------------------------------------------------------------------------------

struct State {
    PerJoint position{};
    PerJoint velocity{};
};

// The joint velocities that give the tip the velocity `tip_velocity`: of all that do, the smallest ones. The
// tip's angular velocity is zero (pose) or free (position). Held joints get zero.
PerJoint desired_joint_velocity(const Problem& problem, const PerJoint& position, const Vec3& tip_velocity) {
    Frames frames;
    forward_kinematics(problem, position, frames);
    const int last = problem.joint_count - 1;
    const Vec3 tip = point_on_link(frames, last, problem.tip);

    Matrix jacobian;
    jacobian.rows = problem.task == kPose ? 6 : 3;
    int joint_of_column[kMaxJoints];
    for (int j = 0; j < problem.joint_count; ++j) {
        if (problem.held[j]) continue;
        const JacobianColumn column = jacobian_column(problem, frames, j, last, tip);
        for (int r = 0; r < 3; ++r) jacobian.at[r][jacobian.columns] = column.linear[r];
        if (problem.task == kPose) {
            for (int r = 0; r < 3; ++r) jacobian.at[3 + r][jacobian.columns] = column.angular[r];
        }
        joint_of_column[jacobian.columns++] = j;
    }

    Matrix inverse;
    pseudo_inverse(jacobian, problem.singular_tolerance, problem.damping, inverse);
    PerJoint desired{};
    for (int c = 0; c < jacobian.columns; ++c) {
        double sum = 0;
        for (int r = 0; r < 3; ++r) sum += inverse.at[c][r] * tip_velocity[r];
        desired[joint_of_column[c]] = sum;
    }

    // A joint too fast slows all of them by the same ratio, so the tip keeps its direction.
    double ratio = 1;
    for (int j = 0; j < problem.joint_count; ++j) {
        const double speed = std::fabs(desired[j]);
        if (speed > problem.max_speed[j]) ratio = std::min(ratio, problem.max_speed[j] / speed);
    }
    if (ratio < 1) {
        for (int j = 0; j < problem.joint_count; ++j) desired[j] *= ratio;
    }
    return desired;
}

// One controller sub-step of length h. The joint that would have to accelerate hardest gets its limit, the
// others are scaled with it.
void controller_substep(const Problem& problem, const Vec3& tip_velocity, double h, State& state) {
    const PerJoint desired = desired_joint_velocity(problem, state.position, tip_velocity);
    PerJoint acceleration{};
    double ratio = 1;
    for (int j = 0; j < problem.joint_count; ++j) {
        acceleration[j] = (desired[j] - state.velocity[j]) / h;
        if (acceleration[j] != 0) {
            ratio = std::min(ratio, problem.max_acceleration[j] / std::fabs(acceleration[j]));
        }
    }
    for (int j = 0; j < problem.joint_count; ++j) {
        // With nothing to scale the desired velocity is taken as it is, free of rounding.
        state.velocity[j] = ratio < 1 ? state.velocity[j] + ratio * acceleration[j] * h : desired[j];
        state.position[j] += state.velocity[j] * h;
    }
}

// ---------------------------------------------------------------------------------------------------------
// The contact.
// ---------------------------------------------------------------------------------------------------------

struct Contact {
    Vec3 force{};          // that the arm exerts on the spring
    double magnitude = 0;  // of that force
    double travel = 0;     // s: how far the point has moved along the normal
    double depth = 0;      // how far it is past the surface; negative before it
    double deflection = 0;
    Vec3 deflection_axis{};
};

// A single plane across the normal, at `offset` from where the contact point started.
Contact plane_contact(const Problem& problem, const Vec3& normal, const Vec3& moved, double offset) {
    Contact contact;
    contact.travel = dot(normal, moved);
    contact.depth = contact.travel - offset;
    contact.magnitude = problem.stiffness * std::max(0.0, contact.depth);
    contact.force = contact.magnitude * normal;
    contact.deflection = std::fabs(contact.depth);
    for (int d = 0; d < 3; ++d) contact.deflection_axis[d] = std::fabs(contact.depth * normal[d]);
    return contact;
}

// The appendix's version: a wall across each axis along which the tip is to move. Each pushes for itself, and
// its force component is positive whichever way the arm moves.
//
// The appendix asks how far the tip is from its start, not on which side. So each wall is also felt,
// mirrored, behind the start, and there its spring is measured from the true wall on the far side: an arm
// that reverses past its start by more than the offset meets a force of K (distance + offset) out of nowhere.
Contact walls_contact(const Problem& problem, const Vec3& normal, const Vec3& moved, const double* offsets) {
    Contact contact;
    contact.travel = dot(normal, moved);
    contact.depth = -kInfinity;
    for (int d = 0; d < 3; ++d) {
        if (problem.velocity[d] == 0) continue;
        const double direction = std::copysign(1.0, problem.velocity[d]);
        const double wall_distance = std::fabs(offsets[d]);
        const double distance = problem.mirrored_walls ? std::fabs(moved[d]) : direction * moved[d];
        const double deflection = std::fabs(moved[d] - direction * wall_distance);
        contact.depth = std::max(contact.depth, distance - wall_distance);
        contact.deflection_axis[d] = deflection;
        if (distance > wall_distance) contact.force[d] = problem.stiffness * deflection;
    }
    contact.magnitude = norm(contact.force);
    contact.deflection = norm(contact.deflection_axis);
    return contact;
}

// ---------------------------------------------------------------------------------------------------------
// One run.
// ---------------------------------------------------------------------------------------------------------

// How much longer the appendix simulates after a detection: 50 ms and one and a half times what the fastest
// joint needs to stop.
double time_after_detection(const Problem& problem, const PerJoint& velocity) {
    double fastest = 0;
    double acceleration_of_it = kInfinity;
    for (int j = 0; j < problem.joint_count; ++j) {
        if (std::fabs(velocity[j]) > fastest) {
            // The slip: the appendix keeps the signed velocity. After a negative one every later joint that
            // moves counts as faster, and if the last one kept is negative, the time shrinks instead of
            // growing.
            fastest = problem.run_length_slip ? velocity[j] : std::fabs(velocity[j]);
            acceleration_of_it = problem.max_acceleration[j];
        }
    }
    return 0.05 + 1.5 * fastest / acceleration_of_it + problem.latency_steps * problem.step;
}

// Contact geometry that does not change during a run.
struct Start {
    Vec3 point;
    Vec3 normal;
    PerJoint velocity;  // of the joints, when the arm is already moving
};

Status prepare(const Problem& problem, Start& start) {
    PerJoint position{};
    std::copy_n(problem.start_position, problem.joint_count, position.begin());
    Frames frames;
    forward_kinematics(problem, position, frames);
    start.point = point_on_link(frames, problem.contact_link, problem.contact_point);
    start.velocity = desired_joint_velocity(problem, position, vec3(problem.velocity));
    if (problem.normal_given) {
        start.normal = vec3(problem.normal);
        return kOk;
    }
    Vec3 direction = vec3(problem.velocity);
    if (!problem.contact_at_tip) {
        direction = {0, 0, 0};
        for (int j = 0; j < problem.joint_count; ++j) {
            const JacobianColumn column = jacobian_column(problem, frames, j, problem.contact_link, start.point);
            direction = direction + start.velocity[j] * column.linear;
        }
    }
    const double speed = norm(direction);
    if (!(speed > 1e-12)) return kContactPointDoesNotMove;
    start.normal = (1 / speed) * direction;
    return kOk;
}

std::int64_t steps_without_detection(const Problem& problem) { return std::llround(problem.duration / problem.step); }

// `noise_at(tick, out)` fills in the noise of every joint at a tick and says whether there is any; it is
// asked once per tick, in order. The run is recorded into `trace` as far as `capacity` rows. Returns its
// steps.
template <class NoiseAt>
std::int64_t simulate_run(const Problem& problem, const Start& start, const double* offsets, NoiseAt&& noise_at,
                          Run& run, const TraceArrays* trace, std::int64_t capacity) {
    const int joints = problem.joint_count;
    const double h = problem.step / problem.substeps;
    const Vec3 motion = vec3(problem.velocity);
    const Vec3 after_reaction = problem.reaction == kReverse ? -1.0 * motion : Vec3{0, 0, 0};

    run = Run{};
    run.detection_tick = -1;
    run.detection_time = run.force_at_detection = kNaN;
    run.contact_start_time = run.contact_end_time = kNaN;
    run.max_travel = -kInfinity;
    std::fill_n(run.residual_at_detection, kMaxJoints, kNaN);
    std::fill_n(run.noise_at_detection, kMaxJoints, kNaN);

    State state;
    std::copy_n(problem.start_position, joints, state.position.begin());
    if (!problem.start_at_rest) state.velocity = start.velocity;

    auto touch = [&](const Vec3& point) {
        const Vec3 moved = point - start.point;
        return problem.per_axis_walls ? walls_contact(problem, start.normal, moved, offsets)
                                      : plane_contact(problem, start.normal, moved, offsets[0]);
    };
    double depth_before = touch(start.point).depth;
    if (depth_before > 0) run.contact_start_time = 0;

    std::int64_t detection_step = -1;
    std::int64_t last_step = steps_without_detection(problem) - 1;
    std::int64_t last_release_step = last_step;
    std::int64_t i = 0;
    for (;; ++i) {
        if (i > last_step) {
            // The run itself is over. Only the end of the contact may still be waited for.
            const bool waiting =
                problem.run_until_free && run.detected && problem.reaction == kReverse && depth_before >= 0;
            if (!waiting || i > last_release_step) break;
        }

        // Move. The step in which a collision is noticed is over by then, so the reaction can begin in the
        // next.
        const bool reacting = run.detected && i > detection_step + problem.latency_steps;
        for (int sub = 0; sub < problem.substeps; ++sub) {
            controller_substep(problem, reacting ? after_reaction : motion, h, state);
        }
        const double time = (i + 1) * problem.step;

        // Push.
        Frames frames;
        forward_kinematics(problem, state.position, frames);
        const Vec3 point = point_on_link(frames, problem.contact_link, problem.contact_point);
        const Contact contact = touch(point);
        if (std::isnan(run.contact_start_time)) {
            if (contact.depth > 0) {
                run.contact_start_time = time - problem.step * contact.depth / (contact.depth - depth_before);
            }
        } else if (std::isnan(run.contact_end_time) && contact.depth < 0) {
            run.contact_end_time = time - problem.step * contact.depth / (contact.depth - depth_before);
        }
        depth_before = contact.depth;

        // Feel: what the motors have to do beyond what the motion alone would need.
        PerJoint contact_torque{};
        for (int j = 0; j < joints; ++j) {
            const JacobianColumn column = jacobian_column(problem, frames, j, problem.contact_link, point);
            contact_torque[j] = dot(column.linear, contact.force);
        }
        PerJoint residual;
        residual.fill(kNaN);
        if (i % problem.period_steps == 0) {
            const std::int64_t tick = i / problem.period_steps;
            PerJoint noise{};
            if ((!run.detected || trace) && noise_at(tick, noise.data())) {
                for (int j = 0; j < joints; ++j) residual[j] = contact_torque[j] + noise[j];
            }
            // A thousandth of a step keeps rounding from deciding whether a tick exactly at the delay counts.
            const bool armed = time >= problem.arming_delay - 1e-3 * problem.step;
            if (!run.detected && armed) {
                for (int j = 0; j < joints; ++j) {
                    if (std::fabs(residual[j]) > problem.threshold[j]) run.trigger_mask |= 1u << j;
                }
            }
            if (!run.detected && run.trigger_mask != 0) {
                run.detected = 1;
                run.false_alarm = contact.magnitude == 0;
                run.detection_tick = static_cast<std::int32_t>(tick);
                run.detection_time = time;
                run.force_at_detection = contact.magnitude;
                std::copy_n(residual.begin(), joints, run.residual_at_detection);
                std::copy_n(noise.begin(), joints, run.noise_at_detection);
                detection_step = i;
                // As in the appendix a step is still simulated if it begins no later than the end.
                const double more = time_after_detection(problem, state.velocity) / problem.step;
                last_step = i + std::max(0, 1 + static_cast<int>(std::floor(more + 1e-9)));
                last_release_step = last_step + std::llround(problem.release_limit / problem.step);
            }
        }

        // Keep the worst, from the step of detection on.
        if (i <= last_step) {
            run.force_at_end = contact.magnitude;
            run.end_time = time;
        }
        if (run.detected && i <= last_step) {
            run.max_force = std::max(run.max_force, contact.magnitude);
            run.max_compression = run.max_force / problem.stiffness;
            run.max_deflection = std::max(run.max_deflection, contact.deflection);
            run.max_travel = std::max(run.max_travel, contact.travel);
            for (int d = 0; d < 3; ++d) {
                run.max_force_axis[d] = std::max(run.max_force_axis[d], std::fabs(contact.force[d]));
                run.max_deflection_axis[d] = std::max(run.max_deflection_axis[d], contact.deflection_axis[d]);
            }
        }

        if (trace && i < capacity) {
            trace->time[i] = time;
            trace->travel[i] = contact.travel;
            trace->force[i] = contact.magnitude;
            std::copy_n(point.begin(), 3, trace->point + 3 * i);
            std::copy_n(state.position.begin(), joints, trace->position + joints * i);
            std::copy_n(state.velocity.begin(), joints, trace->velocity + joints * i);
            std::copy_n(contact_torque.begin(), joints, trace->contact_torque + joints * i);
            std::copy_n(residual.begin(), joints, trace->residual + joints * i);
        }
    }
    if (!run.detected) run.max_travel = kNaN;
    return i;
}

// Noise from the caller's array of (ticks, joints); none left is no detection.
auto given_noise(const Problem& problem, const double* noise, std::int64_t ticks) {
    return [&problem, noise, ticks](std::int64_t tick, double* out) {
        if (tick >= ticks) return false;
        std::copy_n(noise + tick * problem.joint_count, problem.joint_count, out);
        return true;
    };
}

}  // namespace

// ---------------------------------------------------------------------------------------------------------
// What Python calls. Arrays are C-contiguous; sizes were checked there.
// ---------------------------------------------------------------------------------------------------------

extern "C" {

std::int64_t twin_problem_size() { return sizeof(Problem); }
std::int64_t twin_run_size() { return sizeof(Run); }

// Number of feedback ticks of a run without detection.
std::int64_t twin_tick_count(const Problem* problem) {
    const std::int64_t steps = steps_without_detection(*problem);
    return (steps + problem->period_steps - 1) / problem->period_steps;
}

// offsets: (runs, 3), of which a plane uses the first. noise: (runs, ticks, joints).
std::int32_t twin_simulate(const Problem* problem, std::int64_t runs, const double* offsets, const double* noise,
                           std::int64_t ticks, Run* out) {
    Start start;
    if (const Status status = prepare(*problem, start); status != kOk) return status;
    for (std::int64_t r = 0; r < runs; ++r) {
        const double* own = noise + r * ticks * problem->joint_count;
        simulate_run(*problem, start, offsets + 3 * r, given_noise(*problem, own, ticks), out[r], nullptr, 0);
    }
    return kOk;
}

// The same with Gaussian noise from a generator of each run's own, so that a run does not depend on the
// others.
std::int32_t twin_simulate_seeded(const Problem* problem, std::int64_t runs, const double* offsets, std::uint64_t seed,
                                  Run* out) {
    Start start;
    if (const Status status = prepare(*problem, start); status != kOk) return status;
    for (std::int64_t r = 0; r < runs; ++r) {
        const auto run_number = static_cast<std::uint64_t>(r);
        std::seed_seq words{seed & 0xffffffffu, seed >> 32, run_number & 0xffffffffu, run_number >> 32};
        std::mt19937_64 generator(words);
        std::normal_distribution<double> gauss;
        auto drawn_noise = [&](std::int64_t, double* noise) {
            for (int j = 0; j < problem->joint_count; ++j) {
                noise[j] = problem->noise_mean[j] + problem->noise_sd[j] * gauss(generator);
            }
            return true;
        };
        simulate_run(*problem, start, offsets + 3 * r, drawn_noise, out[r], nullptr, 0);
    }
    return kOk;
}

// One run, recorded. offset: 3 values; noise: (ticks, joints). `steps` receives the length of the run, of
// which the first `capacity` rows are filled; start_point and normal: 3 values each.
std::int32_t twin_trace(const Problem* problem, const double* offset, const double* noise, std::int64_t ticks,
                        std::int64_t capacity, const TraceArrays* arrays, Run* run, std::int64_t* steps,
                        double* start_point, double* normal) {
    Start start;
    if (const Status status = prepare(*problem, start); status != kOk) return status;
    std::copy_n(start.point.begin(), 3, start_point);
    std::copy_n(start.normal.begin(), 3, normal);
    *steps = simulate_run(*problem, start, offset, given_noise(*problem, noise, ticks), *run, arrays, capacity);
    return kOk;
}

// Rotation (9 values) of a link and the position (3 values) of a point given in its frame.
void twin_forward_kinematics(const Problem* problem, const double* position, std::int32_t link, const double* point,
                             double* rotation, double* where) {
    PerJoint q{};
    std::copy_n(position, problem->joint_count, q.begin());
    Frames frames;
    forward_kinematics(*problem, q, frames);
    std::copy_n(frames.link_rotation[link].begin(), 9, rotation);
    std::copy_n(point_on_link(frames, link, point).begin(), 3, where);
}

// Geometric Jacobian (6, joints) of a point given in a link's frame: linear rows above angular ones.
void twin_jacobian(const Problem* problem, const double* position, std::int32_t link, const double* point,
                   double* jacobian) {
    PerJoint q{};
    std::copy_n(position, problem->joint_count, q.begin());
    Frames frames;
    forward_kinematics(*problem, q, frames);
    const Vec3 where = point_on_link(frames, link, point);
    for (int j = 0; j < problem->joint_count; ++j) {
        const JacobianColumn column = jacobian_column(*problem, frames, j, link, where);
        for (int r = 0; r < 3; ++r) {
            jacobian[r * problem->joint_count + j] = column.linear[r];
            jacobian[(3 + r) * problem->joint_count + j] = column.angular[r];
        }
    }
}

// matrix: (rows, columns), neither above 16. inverse: (columns, rows).
void twin_pseudo_inverse(const double* matrix, std::int32_t rows, std::int32_t columns, double tolerance,
                         double damping, double* inverse) {
    Matrix a;
    a.rows = rows;
    a.columns = columns;
    for (int r = 0; r < rows; ++r) std::copy_n(matrix + r * columns, columns, a.at[r]);
    Matrix result;
    pseudo_inverse(a, tolerance, damping, result);
    for (int r = 0; r < columns; ++r) std::copy_n(result.at[r], rows, inverse + r * rows);
}

}  // extern "C"
