// The reference simulator: a literal, step-by-step simulation of a robot arm that runs into a spring.
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
#include <cmath>
#include <cstdint>
#include <random>

#include "contact.hpp"
#include "controller.hpp"

namespace reference {
namespace {

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
    double stops_in = fastest / acceleration_of_it;
    if (problem.deceleration != kLimits) stops_in = std::max(stops_in, time_of_stop(problem, velocity));
    return 0.05 + 1.5 * stops_in + problem.latency_steps * problem.step;
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

bool outside(const Problem& problem, const State& state) {
    constexpr double rounding = 1e-9;  // a joint that stands on its limit stays within its range
    for (int j = 0; j < problem.joint_count; ++j) {
        if (state.position[j] < problem.min_position[j] - rounding) return true;
        if (state.position[j] > problem.max_position[j] + rounding) return true;
    }
    return false;
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

    bool given_up = false;  // the line, at the limit of a joint
    Stop stop;
    const bool own_law = problem.deceleration != kLimits || problem.uncoordinated;
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
        const bool reacting = run.detected && i > detection_step + problem.latency_steps && !given_up;
        const State before = state;
        for (int sub = 0; sub < problem.substeps; ++sub) {
            const Vec3 asked = given_up ? Vec3{0, 0, 0} : reacting ? after_reaction : motion;
            if (own_law && (given_up || reacting)) {
                braking_substep(problem, asked, h, !given_up && problem.reaction == kReverse, stop, state);
            } else {
                controller_substep(problem, asked, h, state);
            }
        }
        if (!reacting && !given_up && outside(problem, state)) {
            // This step is not made. The arm brakes instead, and a reaction that has not begun never will.
            given_up = true;
            state = before;
            for (int sub = 0; sub < problem.substeps; ++sub) {
                if (own_law) {
                    braking_substep(problem, {0, 0, 0}, h, false, stop, state);
                } else {
                    controller_substep(problem, {0, 0, 0}, h, state);
                }
            }
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
}  // namespace reference

using namespace reference;

// ---------------------------------------------------------------------------------------------------------
// What Python calls. Arrays are C-contiguous; sizes were checked there.
// ---------------------------------------------------------------------------------------------------------

extern "C" {

std::int64_t reference_problem_size() { return sizeof(Problem); }
std::int64_t reference_run_size() { return sizeof(Run); }

// Number of feedback ticks of a run without detection.
std::int64_t reference_tick_count(const Problem* problem) {
    const std::int64_t steps = steps_without_detection(*problem);
    return (steps + problem->period_steps - 1) / problem->period_steps;
}

// offsets: (runs, 3), of which a plane uses the first. noise: (runs, ticks, joints).
std::int32_t reference_simulate(const Problem* problem, std::int64_t runs, const double* offsets, const double* noise,
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
std::int32_t reference_simulate_seeded(const Problem* problem, std::int64_t runs, const double* offsets,
                                       std::uint64_t seed, Run* out) {
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
std::int32_t reference_trace(const Problem* problem, const double* offset, const double* noise, std::int64_t ticks,
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
void reference_forward_kinematics(const Problem* problem, const double* position, std::int32_t link,
                                  const double* point, double* rotation, double* where) {
    PerJoint q{};
    std::copy_n(position, problem->joint_count, q.begin());
    Frames frames;
    forward_kinematics(*problem, q, frames);
    std::copy_n(frames.link_rotation[link].begin(), 9, rotation);
    std::copy_n(point_on_link(frames, link, point).begin(), 3, where);
}

// Geometric Jacobian (6, joints) of a point given in a link's frame: linear rows above angular ones.
void reference_jacobian(const Problem* problem, const double* position, std::int32_t link, const double* point,
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
void reference_pseudo_inverse(const double* matrix, std::int32_t rows, std::int32_t columns, double tolerance,
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
