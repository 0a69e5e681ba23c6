// Rates from screws in the middle of the chain against those from the Jacobian at the tip.
#include "bumpstop/model/screw_rates.hpp"

#include <numeric>

#include "bumpstop/model/min_norm.hpp"
#include "bumpstop/model/pivoted_rates.hpp"
#include "model/random_chain.hpp"

namespace {

using namespace bumpstop;
using random_chain::pi;

struct Arm {
    Chain chain;
    LinkPoint tip;
    std::vector<int> free;
};

enum class Shape { general, industrial };

// Turning joints, but for those that slide. Industrial arms have axes at right angles, parallel or, once calibrated,
// nearly so.
Arm random_arm(int dof, Shape shape, int held = -1, const std::vector<int>& sliding = {}) {
    std::vector<JointSpec> joints(static_cast<std::size_t>(dof));
    for (JointSpec& joint : joints) {
        for (double& d : joint.origin) d = checks::uniform(-0.5, 0.5);
        joint.axis = random_chain::random_unit();
        if (shape == Shape::general) continue;
        joint.origin[0] = 0;
        joint.axis = {0, 0, 1};
        const double draw = checks::uniform(0, 1), tilt = draw < 0.6   ? pi / 2
                                                          : draw < 0.8 ? 0
                                                                       : 1e-3 * checks::normal();
        joint.rotation = random_chain::rotation_about({1, 0, 0}, checks::uniform(0, 1) < 0.5 ? tilt : -tilt);
    }
    for (int j : sliding) joints[std::size_t(j)].prismatic = true;
    Arm arm;
    arm.chain = Chain(joints);
    arm.tip = link_point(arm.chain, dof - 1, {0.05, -0.02, 0.1});
    for (int j = 0; j < dof; ++j)
        if (j != held) arm.free.push_back(j);
    return arm;
}

template <class T>
ScrewRates<T> screws_of(const Arm& arm) {
    const std::vector<double> travel(max_joints, pi);
    return ScrewRates<T>(arm.chain, arm.free.data(), int(arm.free.size()), arm.tip, travel.data());
}

template <class T>
PivotedRates<T> pivoted_of(const Arm& arm) {
    const std::vector<double> travel(max_joints, pi);
    return PivotedRates<T>(arm.chain, arm.free.data(), int(arm.free.size()), arm.tip, travel.data());
}

struct Pose {
    double q[max_joints];
    Point3<double> velocity;
};

Pose random_pose() {
    Pose pose;
    for (double& q : pose.q) q = checks::uniform(-pi, pi);
    pose.velocity = {checks::normal(), checks::normal(), checks::normal()};
    return pose;
}

struct Reference {
    double column[max_joints][6];
    double x[max_columns];
    bool singular;
    bool far_from_singular;  // for arms as large as these
    double least_square;     // of Conditioning
    double manipulability;
};

Reference reference(const Arm& arm, const Pose& pose) {
    JointAngles<double> angle;
    angle.set(arm.chain, pose.q);
    Posture<double> posture;
    forward_kinematics(arm.chain, pose.q, angle, posture);
    const Point3<double> tip = posture.position(arm.tip);
    Reference made;
    double row[6][max_columns], target[6] = {0, 0, 0, pose.velocity.x, pose.velocity.y, pose.velocity.z};
    for (std::size_t f = 0; f < arm.free.size(); ++f) {
        const int j = arm.free[f];
        const Point3<double> z = posture.axis[j], linear = linear_column(arm.chain, posture, tip, j);
        const double turns = arm.chain.joint[j].turns;
        const double column[6] = {turns * z.x, turns * z.y, turns * z.z, linear.x, linear.y, linear.z};
        for (int c = 0; c < 6; ++c) row[c][f] = made.column[f][c] = column[c];
    }
    // As of the controller: rows count as no shorter than those of their kind are in the quadratic mean.
    double least_length[6];
    for (int kind = 0; kind < 6; kind += 3) {
        double squares = 0;
        for (std::size_t f = 0; f < arm.free.size(); ++f)
            for (int c = kind; c < kind + 3; ++c) squares += made.column[f][c] * made.column[f][c];
        for (int c = kind; c < kind + 3; ++c) least_length[c] = squares / 3;
    }
    const Conditioning<double> conditioning = min_norm<6, 0>(row, int(arm.free.size()), target, made.x, least_length);
    made.singular = conditioning.singular;
    made.least_square = conditioning.least_square;
    // The solve leaves the rows orthogonal.
    made.manipulability = 1;
    double least = 1;
    for (int c = 0; c < 6; ++c) {
        const double square = std::inner_product(row[c], row[c] + arm.free.size(), row[c], 0.0);
        double before = 0;
        for (std::size_t f = 0; f < arm.free.size(); ++f) before += made.column[f][c] * made.column[f][c];
        made.manipulability *= std::sqrt(square);
        least = std::min(least, square / std::max(before, least_length[c]));
    }
    CHECK_NEAR(made.least_square, made.singular ? 0 : least, 1e-12 * least);
    made.far_from_singular = made.manipulability > 0.02;
    return made;
}

double largest(const double* x, std::size_t n) {
    double most = 0;
    for (std::size_t f = 0; f < n; ++f) most = std::max(most, std::fabs(x[f]));
    return most;
}

// The tool moves as asked, and does so with the rates of least norm.
void check_rates(const Arm& arm, const Pose& pose, const double* x, double slack = 1) {
    const std::size_t n = arm.free.size();
    const Reference wanted = reference(arm, pose);
    CHECK(!wanted.singular);
    const double most = largest(wanted.x, n);
    const double target[6] = {0, 0, 0, pose.velocity.x, pose.velocity.y, pose.velocity.z};
    for (int c = 0; c < 6; ++c) {
        long double moves = 0;
        for (std::size_t f = 0; f < n; ++f) moves += (long double)wanted.column[f][c] * x[f];
        CHECK_NEAR(moves, target[c], slack * 2e-11 * most);
    }
    // Both routes lose what a Jacobian within 1e-6 of singular loses.
    for (std::size_t f = 0; f < n; ++f) CHECK_NEAR(x[f], wanted.x[f], slack * 1e-9 * most);
}

void one_by_one(int dof, Shape shape, int held = -1, const std::vector<int>& sliding = {}) {
    int solved = 0, due = 0, served = 0, served_due = 0;
    for (int i = 0; i < 40; ++i) {
        const Arm arm = random_arm(dof, shape, held, sliding);
        ScrewRates<double> screws = screws_of<double>(arm);
        const PivotedRates<double> pivoted = pivoted_of<double>(arm);
        CHECK(pivoted.works() == screws.works());
        if (!screws.works()) continue;
        double factor = 0;  // of the manipulability, the same at all poses
        for (int k = 0; k < 50; ++k) {
            const Pose pose = random_pose();
            JointAngles<double> angle;
            angle.set(arm.chain, pose.q);
            double x[max_columns];
            screws.begin();
            const Reference wanted = reference(arm, pose);
            const bool found = screws.solve(angle, pose.q, pose.velocity, x), far = wanted.far_from_singular;
            if (found) check_rates(arm, pose, x);
            double square;
            const bool right = pivoted.solve(angle, pose.q, pose.velocity, x, square), singular = wanted.singular;
            CHECK(!(singular && square >= pivoted.never_singular_from()));
            if (far) {
                const double own = square / (wanted.manipulability * wanted.manipulability);
                if (factor == 0) factor = own;
                CHECK_NEAR(own, factor, 1e-9 * factor);
            }
            if (right && !singular) check_rates(arm, pose, x, 10);
            served += right;
            served_due += !singular;
            due += far;
            solved += far && found;
        }
    }
    CHECK(due > 100);
    CHECK(solved > 0.99 * due);
    CHECK(served > 0.99 * served_due);
}

template <class T>
void in_lanes(int dof, Shape shape, const std::vector<int>& sliding = {}) {
    int solved = 0, due = 0;
    for (int i = 0; i < 100; ++i) {
        const Arm arm = random_arm(dof, shape, -1, sliding);
        ScrewRates<T> screws = screws_of<T>(arm);
        const PivotedRates<T> pivoted = pivoted_of<T>(arm);
        if (!screws.works()) continue;
        for (int k = 0; k < 20; ++k) {
            Pose pose[Scalar<T>::lanes];
            T q[max_joints], x[max_columns];
            bool far = true;
            Point3<T> velocity;
            for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
                pose[lane] = random_pose();
                far = far && reference(arm, pose[lane]).far_from_singular;
                for (int j = 0; j < max_joints; ++j) set_lane(q[j], lane, pose[lane].q[j]);
                set_lane(velocity.x, lane, pose[lane].velocity.x);
                set_lane(velocity.y, lane, pose[lane].velocity.y);
                set_lane(velocity.z, lane, pose[lane].velocity.z);
            }
            JointAngles<T> angle;
            angle.set(arm.chain, q);
            screws.begin();
            due += far;
            const auto check_lanes = [&](double slack) {
                for (int lane = 0; lane < Scalar<T>::lanes; ++lane) {
                    double own[max_columns];
                    for (std::size_t f = 0; f < arm.free.size(); ++f) own[f] = lane_of(x[f], lane);
                    check_rates(arm, pose[lane], own, slack);
                }
            };
            T square, square_again;
            const MaskOf<T> right = pivoted.solve(angle, q, velocity, x, square);
            bool singular = false;
            for (const Pose& one : pose) singular = singular || reference(arm, one).singular;
            if (singular) continue;
            CHECK(all(right) || !far);
            if (all(right)) check_lanes(10);
            // Whatever the others are, the first lane's rates stay the same to the last bit.
            T others[max_joints], again[max_columns];
            for (int j = 0; j < max_joints; ++j) {
                others[j] = checks::uniform(-pi, pi);
                set_lane(others[j], 0, lane_of(q[j], 0));
            }
            JointAngles<T> other_angle;
            other_angle.set(arm.chain, others);
            pivoted.solve(other_angle, others, velocity, again, square_again);
            for (std::size_t f = 0; f < arm.free.size(); ++f) CHECK(lane_of(again[f], 0) == lane_of(x[f], 0));
            CHECK(lane_of(square_again, 0) == lane_of(square, 0));
            if (!screws.solve(angle, q, velocity, x)) continue;
            solved += far;
            check_lanes(1);
        }
    }
    CHECK(due > 5);
    CHECK(solved > 0.95 * due);
}

// Roll, pitch and roll about one point lose a direction where the pitch is 0.
Arm arm_with_wrist() {
    const Matrix3 up = random_chain::rotation_about({1, 0, 0}, pi / 2), down = transposed(up);
    std::vector<JointSpec> joints(6);
    joints[1] = {.origin = {0.1, 0, 0.4}, .rotation = up};
    joints[2] = {.origin = {0, 0.5, 0}};
    joints[3] = {.origin = {0.05, 0.1, 0}, .rotation = down};
    joints[4] = {.origin = {0, 0, 0.5}, .rotation = up};
    joints[5] = {.rotation = down};
    Arm arm;
    arm.chain = Chain(joints);
    arm.tip = link_point(arm.chain, 5, {0, 0, 0.1});
    arm.free = {0, 1, 2, 3, 4, 5};
    return arm;
}

void near_a_singularity() {
    const Arm arm = arm_with_wrist();
    ScrewRates<double> screws = screws_of<double>(arm);
    CHECK(screws.works());
    Pose pose{{0.3, 0.7, -0.9, 0.4, 0, 0.2}, {0.1, -0.2, 0.3}};
    const PivotedRates<double> pivoted = pivoted_of<double>(arm);
    int solved = 0;
    double share = 0;
    for (double pitch = 1; pitch > 1e-12; pitch *= 0.8) {
        pose.q[4] = pitch;
        JointAngles<double> angle;
        angle.set(arm.chain, pose.q);
        double x[max_columns];
        screws.begin();
        if (screws.solve(angle, pose.q, pose.velocity, x)) {
            ++solved;
            check_rates(arm, pose, x);
        } else {
            CHECK(pitch < 0.01);
        }
        // With pivots the tool moves as asked all the way, if not with the same rates.
        double square;
        CHECK(pivoted.solve(angle, pose.q, pose.velocity, x, square) || pitch < 1e-9);
        const double most = largest(x, 6), target[6] = {0, 0, 0, pose.velocity.x, pose.velocity.y, pose.velocity.z};
        const Reference wanted = reference(arm, pose);
        for (int c = 0; c < 6; ++c) {
            long double moves = 0;
            for (std::size_t f = 0; f < 6; ++f) moves += (long double)wanted.column[f][c] * x[f];
            CHECK_NEAR(moves, target[c], 1e-14 * most);
        }
        CHECK(!wanted.singular || square < pivoted.never_singular_from());
        CHECK(square >= pivoted.never_singular_from() || pitch < 1e-3);
        // The nearer it is, the better the manipulability tells the least sine.
        if (pitch < 0.015 && pitch > 1e-5) {
            const double own = wanted.least_square / square;
            if (share > 0) CHECK_NEAR(own, share, 0.3 * pitch * share);
            share = own;
        }
    }
    CHECK(solved > 20);
    pose.q[4] = 0;
    JointAngles<double> angle;
    angle.set(arm.chain, pose.q);
    double x[max_columns];
    CHECK(!screws.solve(angle, pose.q, pose.velocity, x));
    double square;
    CHECK(!pivoted.solve(angle, pose.q, pose.velocity, x, square));
    // The pose after it needs no order of its own.
    pose.q[4] = 1;
    angle.set(arm.chain, pose.q);
    CHECK(screws.solve(angle, pose.q, pose.velocity, x));
}

// The first column of one order vanishes where that of another does not.
void changes_the_order() {
    int changed = 0;
    for (int i = 0; i < 200 && changed < 5; ++i) {
        const Arm arm = random_arm(6, Shape::industrial);
        ScrewRates<double> screws = screws_of<double>(arm);
        if (!screws.works()) continue;
        const Pose pose = random_pose();
        JointAngles<double> angle;
        angle.set(arm.chain, pose.q);
        double x[max_columns];
        if (!screws.solve(angle, pose.q, pose.velocity, x)) continue;
        // From now on the order is that of this pose, and others must not spoil it.
        const std::vector<double> alone(x, x + 6);
        for (int k = 0; k < 20; ++k) {
            const Pose other = random_pose();
            JointAngles<double> other_angle;
            other_angle.set(arm.chain, other.q);
            screws.begin();
            screws.solve(other_angle, other.q, other.velocity, x);
        }
        screws.begin();
        CHECK(screws.solve(angle, pose.q, pose.velocity, x));
        const double most = largest(x, 6);
        bool same = true;
        for (std::size_t f = 0; f < 6; ++f) {
            CHECK_NEAR(x[f], alone[f], 1e-9 * most);
            same = same && x[f] == alone[f];
        }
        changed += !same;
    }
    CHECK(changed == 5);
}

void what_it_does_not_serve() {
    Arm arm = random_arm(7, Shape::general);
    CHECK(screws_of<double>(arm).works());
    arm.free = {0, 1, 2, 3, 4};
    CHECK(!screws_of<double>(arm).works());
    CHECK(!screws_of<double>(random_arm(8, Shape::general)).works());
    CHECK(!screws_of<double>(random_arm(6, Shape::general, -1, {0, 2, 4})).works());
    const std::vector<int> all{0, 1, 2, 3, 4, 5};
    // How far the tip of an arm on an endless rail is from a joint cannot be told.
    const Arm rail = random_arm(6, Shape::general, -1, {0});
    std::vector<double> travel(max_joints, 1.0);
    CHECK(ScrewRates<double>(rail.chain, all.data(), 6, rail.tip, travel.data()).works());
    travel[0] = std::numeric_limits<double>::infinity();
    CHECK(!ScrewRates<double>(rail.chain, all.data(), 6, rail.tip, travel.data()).works());
    const std::vector<JointSpec> parallel(6, JointSpec{.origin = {0.1, 0, 0}});
    CHECK(!ScrewRates<double>(Chain(parallel), all.data(), 6, {5, {}}, travel.data()).works());
}

void small_turns() {
    const std::vector<JointSpec> joints(1);
    const Chain chain(joints);
    JointAngles<double> angle;
    for (int i = 0; i < 1000; ++i) {
        const double q = checks::uniform(-pi, pi), by = checks::uniform(-1, 1) * largest_small_turn;
        angle.set(chain, 0, q);
        angle.turn(0, by);
        CHECK_NEAR(angle.sin[0], std::sin((long double)q + by), 3e-16);
        CHECK_NEAR(angle.cos[0], std::cos((long double)q + by), 3e-16);
    }
}

}  // namespace

int main() {
    for (const Shape shape : {Shape::general, Shape::industrial}) {
        one_by_one(6, shape);
        one_by_one(7, shape);
        one_by_one(7, shape, 2);
        one_by_one(7, shape, 6);
        one_by_one(8, shape, 4);
        // On a rail, with a telescope, both, and with a lift that stands still.
        one_by_one(6, shape, -1, {0});
        one_by_one(7, shape, -1, {0});
        one_by_one(7, shape, -1, {6});
        one_by_one(7, shape, -1, {3});
        one_by_one(7, shape, -1, {0, 4});
        one_by_one(7, shape, 1, {1});
        in_lanes<Lanes<8>>(7, shape, {0});
        in_lanes<Lanes<4>>(6, shape, {2});
        in_lanes<Lanes<2>>(6, shape);
        in_lanes<Lanes<4>>(6, shape);
        in_lanes<Lanes<8>>(7, shape);
    }
    near_a_singularity();
    changes_the_order();
    what_it_does_not_serve();
    small_turns();
    return checks::result();
}
