// The detector in the loop: its parts against the slow way, and how its events begin and end.
#include "bumpstop/detection/detector.hpp"

#include "detection/detector/random_detector.hpp"

using namespace bumpstop;

static_assert(noexcept(std::declval<Detector&>().update(DetectorSample{})));
static_assert(noexcept(std::declval<Detector&>().overdue(0.0)));
static_assert(noexcept(std::declval<Detector&>().set_payload(Payload{})));

namespace {

using namespace random_chain;
using namespace random_detector;

void momentum_against_the_mass_matrix() {
    for (int trial = 0; trial < 60; ++trial) {
        const int n = 1 + trial % max_joints;
        const Arm arm(n);
        const Chain& chain = arm.made.chain;
        const Inertias inertias(chain, arm.links);
        double q[max_joints] = {}, qd[max_joints] = {};
        for (int j = 0; j < n; ++j) {
            q[j] = checks::uniform(-2, 2);
            qd[j] = checks::uniform(-1, 1);
        }
        const auto matrix = [&](const double* at, double(*m)[max_joints]) {
            JointAngles<double> angle;
            angle.set(chain, at);
            mass_matrix(chain, inertias, at, angle, m);
        };
        const auto energy = [&](const double* at) {
            double m[max_joints][max_joints], sum = 0;
            matrix(at, m);
            for (int i = 0; i < n; ++i)
                for (int j = 0; j < n; ++j) sum += 0.5 * qd[i] * m[i][j] * qd[j];
            return sum;
        };
        JointAngles<double> angle;
        angle.set(chain, q);
        const Vector3 g{1, -2, -9};
        MomentumTerms<double> terms;
        momentum_terms(chain, inertias, q, angle, qd, g, terms);
        double m[max_joints][max_joints], weight[max_joints];
        matrix(q, m);
        gravity_torque(chain, inertias, q, angle, g, weight);
        const double scale = 1 + 2 * energy(q);
        for (int i = 0; i < n; ++i) {
            double p = 0;
            for (int j = 0; j < n; ++j) p += m[i][j] * qd[j];
            CHECK_NEAR(terms.momentum[i], p, 1e-11 * scale * n);
            CHECK_NEAR(terms.gravity[i], weight[i], 1e-10 * (1 + std::fabs(weight[i])) * n);
            double up[max_joints], down[max_joints];
            for (int j = 0; j < n; ++j) up[j] = down[j] = q[j];
            up[i] += 1e-5;
            down[i] -= 1e-5;
            CHECK_NEAR(terms.velocity_force[i], (energy(up) - energy(down)) / 2e-5, 1e-6 * scale * n);
        }
    }
}

// Torque is linear in mass, first and second moments: the payload's own torque is added.
void payload_adds_its_torque() {
    for (int trial = 0; trial < 20; ++trial) {
        const Arm arm(7);
        const Payload payload{checks::uniform(0.1, 5), {0.1, -0.2, 0.3}};
        std::vector<LinkInertia> loaded = arm.links, alone(7);
        loaded[6] = with_payload(loaded[6], payload);
        alone[6].mass = payload.mass;
        alone[6].center = payload.center;
        double q[max_joints], qd[max_joints], qdd[max_joints], tau[3][max_joints];
        for (int j = 0; j < 7; ++j) {
            q[j] = checks::uniform(-2, 2);
            qd[j] = checks::uniform(-1, 1);
            qdd[j] = checks::uniform(-1, 1);
        }
        JointAngles<double> angle;
        angle.set(arm.made.chain, q);
        const std::vector<LinkInertia>* all[3] = {&loaded, &arm.links, &alone};
        for (int k = 0; k < 3; ++k)
            inverse_dynamics(arm.made.chain, Inertias(arm.made.chain, *all[k]), {q, angle, qd, qdd}, {0, 0, -9.81},
                             tau[k]);
        for (int j = 0; j < 7; ++j)
            CHECK_NEAR(tau[0][j], tau[1][j] + tau[2][j], 1e-10 * (1 + std::fabs(tau[0][j])) * 100);
    }
}

// The links named possible hold the one that was hit, whatever the contact; the force at its point comes back.
void a_contact_is_where_it_was() {
    int likeliest = 0, cases = 0;
    for (int trial = 0; trial < 400; ++trial) {
        const Arm arm(7);
        double q[max_joints], sd[max_joints], residual[max_joints] = {};
        for (int j = 0; j < 7; ++j) {
            q[j] = checks::uniform(-2, 2);
            sd[j] = 1;
        }
        JointAngles<double> angle;
        angle.set(arm.made.chain, q);
        Posture<double> posture;
        forward_kinematics(arm.made.chain, q, angle, posture);
        const int link = 2 + trial % 5;
        const LinkPoint point = link_point(arm.made.chain, link, {0.1, 0.2, -0.1});
        const Vector3 n = random_unit();
        for (int j = 0; j <= link; ++j) {
            const Point3<double> c = linear_column(arm.made.chain, posture, posture.position(point), j);
            residual[j] = 1000 * (c.x * n[0] + c.y * n[1] + c.z * n[2]);
        }
        const ContactEstimate found = estimate_contact(arm.made.chain, posture, residual, sd, point, n);
        CHECK(found.possible >> link & 1);
        CHECK_NEAR(found.force_along, 1000, 1e-6);
        // Outer links cannot be told from it; inner ones can where its own joint is loaded.
        if (std::fabs(residual[link]) > 10) {
            CHECK((found.possible & ((std::uint32_t(1) << link) - 1)) == 0);
            ++cases;
            likeliest += found.link == link;
        }
        CHECK(found.leftover < 1e-3 || link < 2);
    }
    CHECK(cases > 200 && likeliest == cases);
    // What no joint says must not be named.
    const Arm arm(3);
    double q[max_joints] = {}, residual[max_joints] = {5, 5, 5}, sd[max_joints] = {inf, inf, inf};
    JointAngles<double> angle;
    angle.set(arm.made.chain, q);
    Posture<double> posture;
    forward_kinematics(arm.made.chain, q, angle, posture);
    const ContactEstimate none = estimate_contact(arm.made.chain, posture, residual, sd, {2, {}}, {0, 0, 1});
    CHECK(none.link == -1 && none.force_along == 0);
}

// A mass shows in every pose; a constant torque, as of a clamp, does not pass for one.
void a_changed_payload_is_recognised() {
    for (bool mass : {true, false}) {
        PayloadMonitorSettings settings;
        settings.min_mass = 0.5;
        PayloadMonitor watch(settings, 2);
        const double sd[2] = {1, 1};
        bool recognised = false;
        for (int i = 0; i < 500; ++i) {
            const double a[2] = {5 * std::cos(0.02 * i), 3 * std::sin(0.02 * i)};
            const double r[2] = {mass ? 2 * a[0] + 0.3 * checks::normal() : 6, mass ? 2 * a[1] : -4};
            CHECK(watch.due(0.025 * i));
            watch.update(0.025 * i, r, a, sd);
            CHECK(!watch.due(0.025 * i + 0.01));
            if (i < 3) CHECK(!watch.recognised());  // one pose says nothing
            recognised = recognised || watch.recognised();
        }
        CHECK(recognised == mass);
        if (mass) CHECK_NEAR(watch.change(), 2, 0.1);
    }
}

// A load that is declared as it is grasped is no torque from outside, and leaves no tick without data.
void a_declared_load_stops_nothing() {
    for (int k = 0; k < 20; ++k) {
        Arm arm(7);
        arm.settings.residual = k % 2 ? ResidualKind::observer : ResidualKind::direct;
        arm.settings.source = TorqueSource::torque;
        Detector detector = arm.detector();
        const Payload grasped{checks::uniform(0.5, 5), {0.01, -0.02, 0.1}};
        DetectorSample sample;
        for (int j = 0; j < 7; ++j) sample.q[j] = checks::uniform(-2, 2);
        const double rest[max_joints] = {};
        JointAngles<double> angle;
        angle.set(arm.made.chain, sample.q.data());
        double held[2][max_joints];
        std::vector<LinkInertia> links = arm.links;
        for (double(&torque)[max_joints] : held) {
            inverse_dynamics(arm.made.chain, Inertias(arm.made.chain, links), {sample.q.data(), angle, rest, rest},
                             arm.settings.gravity, torque);
            links[6] = with_payload(links[6], grasped);
        }
        for (int i = 0; i < 200; ++i) {
            sample.t = 0.001 * i;
            if (i == 100) detector.set_payload(grasped);
            // Feedback that never changes would be frozen.
            for (int j = 0; j < 7; ++j) sample.signal[j] = held[i >= 100][j] + 1e-9 * std::sin(i);
            const DetectorOutput& out = detector.update(sample);
            if (i < 90) continue;
            CHECK(out.state == DetectorState::monitoring && !out.stop);
            for (int j = 0; j < 7; ++j) CHECK_NEAR(out.residual[j], 0, 1e-6);
        }
    }
}

// A lost sample: no spike, and said.
void a_lost_sample_makes_no_spike() {
    Arm arm(7);
    for (double& limit : arm.settings.alarm.thresholds.constant) limit = inf;
    Detector detector = arm.detector(), undisturbed = arm.detector();
    double worst = 0;
    int late = 0;
    for (int i = 0; i < 200; ++i) {
        DetectorSample sample;
        sample.t = 0.001 * i;
        for (int j = 0; j < 7; ++j) sample.q[j] = std::sin(sample.t * (1 + 0.2 * j));
        const DetectorOutput& whole = undisturbed.update(sample);
        if (i == 100) continue;
        const DetectorOutput& out = detector.update(sample);
        late += out.late;
        CHECK(out.late == (i == 101));
        if (out.state == DetectorState::no_data) continue;
        for (int j = 0; j < 7; ++j) worst = std::max(worst, std::fabs(out.residual[j] - whole.residual[j]));
    }
    // Window and delay differ by a sample for eight ticks; naive second differences would be off by qd / dt = 1000.
    CHECK(late == 1 && worst < 0.5);
}

// What a rotor of 2 kg m2 adds to the residual of an arm in motion: minus 2 kg m2 times its acceleration, by either way.
void rotors_count_alike_in_observer_and_direct_residual() {
    for (int trial = 0; trial < 8; ++trial) {
        Arm arm(1 + trial / 2);
        DetectorSettings& s = arm.settings;
        const int n = arm.made.chain.dof;
        s.samples.measured_rates = true;
        s.samples.period = 2e-4;
        s.samples.longest_interval = 1e-3;
        s.samples.late_interval = 3e-4;
        s.window = 2e-3;
        s.observer_gain = 1000;
        std::vector<Detector> made;
        for (const double rotor : {0.0, 2.0}) {
            for (int j = 0; j < n; ++j) {
                arm.joints[std::size_t(j)].inertia = trial % 2 ? rotor : 0;
                arm.links[std::size_t(j)].rotor = trial % 2 ? 0 : rotor;
            }
            for (const ResidualKind kind : {ResidualKind::direct, ResidualKind::observer}) {
                s.residual = kind;
                made.push_back(arm.detector());
            }
        }
        long judged = 0;
        for (int i = 0; i < 3000; ++i) {
            DetectorSample sample;
            sample.t = 2e-4 * i;
            for (int j = 0; j < n; ++j) {
                sample.q[j] = 0.5 * std::sin(4 * sample.t + j);
                sample.qd[j] = 2 * std::cos(4 * sample.t + j);
                sample.signal[j] = 1;
            }
            for (Detector& detector : made) detector.update(sample);
            if (i < 500 || made[3].output().state == DetectorState::no_data) continue;
            ++judged;
            for (int j = 0; j < n; ++j) {
                const double torque = -2 * -8 * std::sin(4 * sample.t + j);
                const auto added = [&](int kind) {
                    return made[std::size_t(2 + kind)].output().residual[j] -
                           made[std::size_t(kind)].output().residual[j];
                };
                // 1 ms of delay at 4 rad/s, of up to 16 Nm, and half a window for the direct residual.
                CHECK_NEAR(added(0), torque, 0.2);
                CHECK_NEAR(added(1), torque, 0.2);
            }
        }
        CHECK(judged > 2000);
    }
}

// While an alarm stands, what passes its threshold after a pause is another event, whichever way it goes.
void an_event_ends_and_another_begins() {
    for (const double sign : {1.0, -1.0}) {
        Arm arm(3);
        DetectorSettings& s = arm.settings;
        s.source = TorqueSource::torque;
        s.alarm.event_pause = 0.05;
        for (int j = 0; j < 3; ++j) s.alarm.thresholds.fast[j] = inf;
        arm.errors.clear();
        arm.joints.clear();
        Detector detector = arm.detector();
        // The torque that holds the arm is what the residual lacks without any.
        DetectorSample sample;
        for (int j = 0; j < 3; ++j) s.alarm.thresholds.constant[j] = inf;
        Detector blank = arm.detector();
        for (int i = 0; i < 10; ++i) {
            sample.t = 0.001 * i;
            sample.signal[0] = 1e-9 * i;
            blank.update(sample);
        }
        const std::array<double, max_joints> held = blank.output().residual;
        for (int i = 0; i < 400; ++i) {
            sample.t = 0.001 * i;
            for (int j = 0; j < 3; ++j) sample.signal[j] = -held[j] + 1e-9 * (i % 2);
            if (i == 100 || (i >= 140 && i < 150) || i >= 250) sample.signal[1] += sign * (i == 300 ? 60 : 20);
            const DetectorOutput& out = detector.update(sample);
            CHECK(out.stop == (i < 7 || i >= 100));
            CHECK(detector.events() == (i < 100 ? 0 : i < 250 ? 1 : 2));
        }
        const DetectorEvent& event = detector.event();
        CHECK_NEAR(event.t, 0.25, 1e-12);
        CHECK_NEAR(event.span.end, 0.399, 1e-12);
        CHECK_NEAR(event.residual[1], sign * 20, 1e-6);
        CHECK_NEAR(event.span.largest[1], sign * 60, 1e-6);
        CHECK_NEAR(event.span.largest_time, 0.3, 1e-12);
        CHECK(event.span.largest_joint == 1 && event.over == 2);
    }
}

// Whatever came before, be it an alarm: nothing of it is left, not even its time.
void a_detector_that_is_reset_is_as_new() {
    const auto same = [](double a, double b) {
        return std::isnan(a) ? std::isnan(b) : a == b || std::fabs(a - b) <= 1e-7 * (1 + std::fabs(a));
    };
    for (int k = 0; k < 8; ++k) {
        Arm arm(1 + k % 7);
        DetectorSettings& s = arm.settings;
        s.residual = k % 2 ? ResidualKind::observer : ResidualKind::direct;
        s.source = k % 3 ? TorqueSource::current : TorqueSource::torque;
        s.alarm.arming_delay = 0.01;
        s.payload_monitor.min_mass = 0.1;
        s.payload_monitor.interval = 0;
        Detector used = arm.detector(), fresh = arm.detector();
        const int n = used.joints();
        const auto sample_at = [&](int i, double speed) {
            DetectorSample sample;
            sample.t = 0.001 * i;
            for (int j = 0; j < n; ++j) {
                sample.q[j] = 0.1 * j + speed * sample.t;
                sample.signal[j] = std::sin(0.3 * i + j) + (i > 40 ? 30 : 0);
            }
            return sample;
        };
        for (int i = 1000; i < 1060; ++i) used.update(sample_at(i, 0.5));
        CHECK(used.alarmed());
        used.reset();
        CHECK(!used.alarmed() && used.events() == 0 && used.event().over == 0 && used.event().over_fast == 0);
        for (int i = 0; i < 60; ++i) {
            // So slow that a last motion, had there been one, would count.
            const DetectorSample sample = sample_at(i, i < 30 ? 0.0 : 0.5);
            const DetectorOutput &a = used.update(sample), &b = fresh.update(sample);
            CHECK(a.state == b.state && a.fault == b.fault && a.stop == b.stop && a.late == b.late);
            CHECK(a.masked_while_arming == b.masked_while_arming && a.payload_changed == b.payload_changed);
            CHECK(a.over == b.over && a.over_fast == b.over_fast);
            for (int j = 0; j < n; ++j)
                CHECK(same(a.residual[j], b.residual[j]) && same(a.fast[j], b.fast[j]) &&
                      same(a.threshold[j], b.threshold[j]));
            CHECK(same(used.payload().change(), fresh.payload().change()));
        }
    }
}

}  // namespace

int main() {
    momentum_against_the_mass_matrix();
    payload_adds_its_torque();
    a_contact_is_where_it_was();
    a_changed_payload_is_recognised();
    a_declared_load_stops_nothing();
    a_lost_sample_makes_no_spike();
    rotors_count_alike_in_observer_and_direct_residual();
    an_event_ends_and_another_begins();
    a_detector_that_is_reset_is_as_new();
    return checks::result();
}
