/// @file
/// Arm, motion and reaction of a collision.
#pragma once

#include <optional>

#include "bumpstop/collision/contact/arm_compliance.hpp"
#include "bumpstop/collision/motion/deceleration.hpp"
#include "bumpstop/model/kinematics.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The straight motion of the tool and the limits of the joints.
struct MotionSettings {
    LinkPoint tip;      ///< the point that follows the line
    int task_rows = 6;  ///< 6 holds the orientation, 3 is position only
    int free_count = 0;
    std::array<int, max_joints> free_joint{};             ///< joints that may move
    double damping = 0;                                   ///< of the least squares; 0 is exact
    double step = 1e-3;                                   ///< simulation step [s]
    int substeps = 5;                                     ///< controller sub-steps in it
    std::array<double, max_joints> acceleration_limit{};  ///< rad/s^2 or m/s^2, by joint
    std::array<double, max_joints> velocity_limit{};      ///< rad/s or m/s, by joint; infinite: none
    std::array<double, max_joints> lower{}, upper{};      ///< joint limits [rad or m]
    Deceleration deceleration;                            ///< of reactions; the limits above hold everywhere else

    double substep() const { return step / substeps; }
};

/// Where and in which direction the arm hits.
struct ContactGeometry {
    LinkPoint point;
    bool along_motion = true;  ///< the normal is the direction in which the point moves at the start
    Vector3 normal{};          ///< else this unit vector, base frame
};

/// Duration of the motion, and times of detection and reaction.
struct Timing {
    int steps = 5000;  ///< the motion ends after so many simulation steps
    int period = 4;    ///< steps between two feedback ticks
    int latency = 0;   ///< steps from a tick to the beginning of the reaction
    bool from_rest = false;
};

enum class ReactionKind { stop, reverse };

/// Arm, motion, contact point and reaction: all that a stopping curve depends on but the pose and the velocity.
struct CollisionSetup {
    Chain chain;
    MotionSettings motion;
    ContactGeometry contact;
    Timing timing;
    ReactionKind reaction = ReactionKind::reverse;
    std::optional<ArmCompliance> arm{};  ///< of an elastic arm; none: the arm is rigid and follows its path

    /// Time of tick k after the start of the motion [s].
    double tick_time(int k) const { return (double(k) * timing.period + 1) * motion.step; }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
