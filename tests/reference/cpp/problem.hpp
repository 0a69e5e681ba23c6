// What the caller hands over and gets back. The Python wrapper repeats these two layouts field by field; the
// functions reference_problem_size and reference_run_size let it notice when they have drifted apart.
#pragma once

#include <array>
#include <cstdint>
#include <limits>

namespace reference {

constexpr int kMaxJoints = 16;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

enum JointKind : std::int32_t { kRevolute = 0, kPrismatic = 1 };
enum Task : std::int32_t { kPose = 0, kPosition = 1 };
enum Reaction : std::int32_t { kReverse = 0, kStop = 1 };
enum Deceleration : std::int32_t { kLimits = 0, kFixedTime = 1, kLateBrake = 2 };
enum Status : std::int32_t { kOk = 0, kContactPointDoesNotMove = 1 };

using Vec3 = std::array<double, 3>;
using Mat3 = std::array<double, 9>;  // row-major
using PerJoint = std::array<double, kMaxJoints>;

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
    double min_position[kMaxJoints];  // a line that would leave this range is given up: the arm brakes
    double max_position[kMaxJoints];

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
    std::int32_t deceleration;   // Deceleration: how a reacting arm, or one that gave up its line, slows down
    std::int32_t uncoordinated;  // 1: every joint brakes at its own limit, whatever the others do
    double stopping_time;        // kFixedTime: all joints stand after it
    double brake_time;           // kLateBrake: until the brakes hold with full force
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

}  // namespace reference
