// Paths along lines against the controller's sub-steps as docs/reference/collision.md writes them down.
#include "bumpstop/collision/motion/line_tracer.hpp"

#include "collision/random_arm.hpp"

namespace {

using namespace bumpstop;
using random_arm::Arm;
using L = Lanes<native_lanes>;

constexpr int steps = 150, period = 4;

struct State {
    double q[max_joints], qd[max_joints] = {};
};

Rates<double> wanted_rates(const Arm& arm, const Point3<double>& velocity, const double* q, Posture<double>& posture) {
    JointAngles<double> angle;
    angle.set(arm.chain, q);
    forward_kinematics(arm.chain, q, angle, posture);
    return resolved_rates(arm.chain, arm.motion, posture, velocity);
}

// One simulation step; false where a singularity is near.
bool plain_step(const Arm& arm, const Point3<double>& velocity, State& state) {
    const double h = arm.motion.substep();
    bool regular = true;
    for (int sub = 0; sub < arm.motion.substeps; ++sub) {
        Posture<double> posture;
        const Rates<double> wanted = wanted_rates(arm, velocity, state.q, posture);
        regular = regular && wanted.conditioning.min_sine_squared > 1e-4;
        double ratio = 1;
        for (int f = 0; f < arm.motion.free_count; ++f) {
            const int j = arm.motion.free_joint[std::size_t(f)];
            ratio = std::min(
                ratio, arm.motion.acceleration_limit[std::size_t(j)] * h / std::fabs(wanted.free[f] - state.qd[j]));
        }
        for (int f = 0; f < arm.motion.free_count; ++f) {
            const int j = arm.motion.free_joint[std::size_t(f)];
            state.qd[j] += ratio * (wanted.free[f] - state.qd[j]);
            state.q[j] += h * state.qd[j];
        }
    }
    return regular;
}

// The distances after every step, as far as no singularity is near, and the state after the last of them.
std::vector<double> plain_path(const Arm& arm, const LinkPoint& point, const LineRequest& request, bool from_rest,
                               State& state) {
    const Point3<double> velocity{request.velocity[0], request.velocity[1], request.velocity[2]};
    std::copy_n(request.q, arm.chain.dof, state.q);
    Posture<double> posture;
    const Rates<double> rates = wanted_rates(arm, velocity, state.q, posture);
    const Point3<double> start = posture.position(point);
    const double speed = std::sqrt(dot(velocity, velocity));
    if (!from_rest) {
        for (int f = 0; f < arm.motion.free_count; ++f) state.qd[arm.motion.free_joint[std::size_t(f)]] = rates.free[f];
    }
    std::vector<double> s{0.0};
    while (int(s.size()) <= steps && plain_step(arm, velocity, state)) {
        wanted_rates(arm, velocity, state.q, posture);
        s.push_back(dot(posture.position(point) - start, velocity) / speed);
    }
    return s;
}

std::vector<LinePath> traced(const Arm& arm, const std::vector<LineRequest>& requests, LineTolerance tolerance) {
    std::vector<LinePath> paths(requests.size());
    std::vector<NoCriterion<L>> criteria(requests.size());
    LineTracer<L, NoCriterion<L>>(arm, tolerance)
        .trace(requests.data(), criteria.data(), paths.data(), int(requests.size()));
    return paths;
}

#if defined(__OPTIMIZE__)
constexpr int arms = 6;
#else
constexpr int arms = 1;
#endif

// Lines from rest or under way, more than there are lanes; a line's path does not depend on the others.
void paths_agree(int dof, const std::vector<int>& sliding, int held, bool from_rest) {
    int whole = 0;
    for (int i = 0; i < arms; ++i) {
        Arm arm = random_arm::make(dof, sliding, held);
        arm.contact.point = arm.motion.tip;
        arm.timing = {steps, period, 0, from_rest};
        constexpr int count = native_lanes + 3;
        double q[count][max_joints];
        std::vector<LineRequest> requests;
        for (int line = 0; line < count; ++line) {
            for (int j = 0; j < dof; ++j) q[line][j] = checks::uniform(-2.5, 2.5);
            const Vector3 velocity{0.1 * checks::normal(), 0.1 * checks::normal(), 0.1 * checks::normal()};
            requests.push_back({q[line], velocity});
        }
        const std::vector<LinePath> exact = traced(arm, requests, exact_line);
        const std::vector<LinePath> fast = traced(arm, requests, batch_line);
        for (int line = 0; line < count; ++line) {
            State state;
            const LineRequest& request = requests[std::size_t(line)];
            const std::vector<double> plain = plain_path(arm, arm.contact.point, request, from_rest, state);
            const LinePath& path = exact[std::size_t(line)];
            const LinePath alone = traced(arm, {request}, exact_line)[0];
            CHECK(alone.s == path.s && alone.reaction_state == path.reaction_state && alone.end == path.end);
            const std::size_t known = std::min(plain.size(), path.s.size());
            for (std::size_t step = 0; step < known; ++step) {
                CHECK_NEAR(path.s[step], plain[step], 1e-11);
                if (step < fast[std::size_t(line)].s.size())
                    CHECK_NEAR(fast[std::size_t(line)].s[step], plain[step], 1e-5);
            }
            if (known <= std::size_t(steps)) continue;
            ++whole;
            CHECK(path.end == PathEnd::motion_end && path.ticks == (steps - 1) / period + 1);
        }
    }
    CHECK(whole >= arms);
}

}  // namespace

int main() {
    for (bool from_rest : {false, true}) {
        paths_agree(6, {}, -1, from_rest);
        paths_agree(7, {}, -1, from_rest);
        paths_agree(7, {}, 6, from_rest);
        paths_agree(7, {0}, -1, from_rest);
        paths_agree(8, {0}, -1, from_rest);
    }
    return checks::result();
}
