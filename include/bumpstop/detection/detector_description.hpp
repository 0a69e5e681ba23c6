/// @file
/// Reads a detector from the file that `bumpstop detector` writes: robot, joint model, thresholds and settings.
#pragma once

#include "bumpstop/detection/detector.hpp"
#include "bumpstop/model/robot_description.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Everything that a detector is built from. The description allocates; the detector does not.
struct DetectorDescription {
    RobotDescription robot;
    std::vector<JointTorqueParameters> joints;  ///< empty where the signal is torque
    std::vector<JointTorqueErrors> errors;
    DetectorSettings settings;
    std::optional<FittedDynamics> fitted;  ///< dynamics that predict the torque; there is no joint model then

    /// `latched`: no event follows the first until its alarm is acknowledged.
    Detector detector(bool latched = false) const {
        std::vector<LinkInertia> links;
        for (const RobotDescription::Joint& joint : robot.joints) links.push_back(*joint.inertia);
        DetectorSettings given = settings;
        if (latched) given.alarm.event_pause = std::numeric_limits<double>::infinity();
        return Detector(robot.chain(), links, joints, errors, given, fitted);
    }
    /// Where the force of an event is given, in the frame of the link `settings.contact.link` [m].
    Vector3 contact_point() const {
        return transposed(robot.chain().joint[settings.contact.link].to_link) * settings.contact.offset;
    }
};

namespace detail {

/// Reads the lines 'fitted_...': the gains, the joints that `all` predicts, links and motors of each set in order, and
/// after the motors their presliding travels, which are optional.
class FittedReader {
  public:
    explicit FittedReader(int joints)
        : joints_(joints),
          once_{{"fitted_gain", fitted_.gain.data(), joints},
                {"fitted_by_all", &by_all_, 1, 0, std::ldexp(1.0, joints) - 1, "a whole number",
                 [this] { return by_all_ == std::floor(by_all_); }},
                {"fitted_presliding", travel_, 0, 0, DescriptionField::largest, "a travel for each motor before it",
                 [this] { return motors_[0] > 0 && motors_[0] == motors_[1]; }, nullptr, true}} {}
    FittedReader(const FittedReader&) = delete;  // its fields point to its members

    bool read(DescriptionText& text) {
        begun_ = true;
        std::string set;
        const bool link = text.keyword == "fitted_link";
        DescriptionField& travels = once_.back();
        if (!link && text.keyword != "fitted_motor") {
            travels.count = motors_[0];
            return text.read(once_);
        }
        const bool known = text.word(set) && (set == "all" || set == "essential");
        const int number = set == "all" ? 0 : 1;
        FittedParameters& own = number == 0 ? fitted_.all : fitted_.essential;
        // No motor may follow the presliding travels.
        const bool fits = known && (link ? links_[number] < joints_ && read_link(text, own.link[links_[number]++])
                                         : motors_[number] < FittedParameters::max_motors && !travels.seen &&
                                               read_motor(text, own.motor[motors_[number]++]));
        return fits || text.fail(quoted("", text.keyword, " is not as 'bumpstop detector' writes it"));
    }
    /// Either all lines have been read, or none.
    bool complete() const {
        return !begun_ || (missing(once_) == nullptr && links_[0] == joints_ && links_[1] == joints_ &&
                           motors_[0] == motors_[1] && motors_[0] >= joints_);
    }
    /// The dynamics, or none where no line was read.
    std::optional<FittedDynamics> found() {
        if (!begun_) return std::nullopt;
        fitted_.by_all = std::uint32_t(by_all_);
        fitted_.motors = motors_[0];
        for (int m = 0; m < motors_[0]; ++m)
            fitted_.all.motor[m].presliding = fitted_.essential.motor[m].presliding = travel_[m];
        return fitted_;
    }

  private:
    bool read_link(DescriptionText& text, LinkInertia& link) {
        return text.finite_numbers(&link.mass, 1) && text.finite_numbers(link.center.data(), 3) &&
               text.finite_numbers(link.tensor.data(), 9);
    }
    bool read_motor(DescriptionText& text, FittedMotor& motor) {
        for (double* number :
             {&motor.sign_speed, &motor.coulomb, &motor.viscous, &motor.rotor, &motor.offset, &motor.bend})
            if (!text.finite_numbers(number, 1)) return false;
        return motor.sign_speed > 0 && text.numbers(&motor.top_speed, 1) && motor.top_speed > 0 &&
               text.finite_numbers(&motor.load, 1) && text.finite_numbers(motor.share.data(), joints_);
    }

    int joints_;
    FittedDynamics fitted_;
    double by_all_ = 0, travel_[FittedParameters::max_motors] = {};
    std::vector<DescriptionField> once_;
    bool begun_ = false;
    int links_[2] = {}, motors_[2] = {};
};

inline bool read_joint_torque(DescriptionText& text, JointTorqueParameters& p) {
    std::string map, friction;
    if (!text.word(map) || !text.word(friction)) return false;
    if ((map != "odd" && map != "load_dependent") || (friction != "power" && friction != "stribeck")) return false;
    p.map = map == "odd" ? CurrentMap::odd : CurrentMap::load_dependent;
    p.friction = friction == "power" ? FrictionLaw::power : FrictionLaw::stribeck;
    for (double* number : {&p.A, &p.B, &p.D, &p.F, &p.coulomb, &p.viscous, &p.stribeck, &p.stribeck_speed, &p.load,
                           &p.hysteresis, &p.inertia, &p.rest_speed})
        if (!text.finite_numbers(number, 1)) return false;
    for (double* limit : {&p.current_low, &p.current_high, &p.speed_high})  // may be infinite
        if (!text.numbers(limit, 1)) return false;
    return p.rest_speed > 0 && p.stribeck_speed > 0 && p.inertia >= 0 && p.current_low < p.current_high &&
           p.speed_high > 0 && p.F >= 0 && p.F <= 3 && p.load >= 0 && p.load < 1;
}

inline bool read_joint_errors(DescriptionText& text, JointTorqueErrors& e) {
    for (double* number : e.all())
        if (!text.numbers(number, 1, 0, DescriptionField::largest)) return false;
    return true;
}

}  // namespace detail

/// Reads a detector. Where the text is not valid the result is empty, and `error` says why and in which line.
inline std::optional<DetectorDescription> read_detector(std::istream& in, std::string& error) {
    detail::DescriptionText text(in, error);
    std::optional<RobotDescription> robot = detail::read_robot_part(text);
    if (!robot) return std::nullopt;
    DetectorDescription out;
    out.robot = *robot;
    const int n = int(robot->joints.size());
    const auto wrong = [&](const std::string& what) -> std::optional<DetectorDescription> {
        text.fail(what);
        return std::nullopt;
    };
    for (const RobotDescription::Joint& joint : robot->joints)
        if (!joint.inertia) return wrong("the inertia of " + joint.link + " is not known");

    DetectorSettings& s = out.settings;
    SampleLimits& samples = s.samples;
    AlarmSettings& alarm = s.alarm;
    ThresholdModel& thresholds = alarm.thresholds;
    PayloadMonitorSettings& watch = s.payload_monitor;
    constexpr double inf = std::numeric_limits<double>::infinity(), large = std::numeric_limits<double>::max();
    double degree = 0, measured_rates = 0, unknown = 0, unmonitored = 0, endless = 0, contact[4] = {}, payload[4] = {};
    std::string residual, source;
    const auto of_residual = [&] { return residual == "direct" || residual == "observer"; };
    const auto of_source = [&] { return source == "current" || source == "torque"; };
    std::vector<detail::DescriptionField> fields{
        {"residual", nullptr, 0, 0, 0, "direct or observer", of_residual, &residual},
        {"source", nullptr, 0, 0, 0, "current or torque", of_source, &source},
        {"period", &samples.period, 1, 1e-9, large},
        {"shortest_interval", &samples.shortest_interval, 1, 0, large},
        {"late_interval", &samples.late_interval, 1, 0, large},
        {"longest_interval", &samples.longest_interval, 1, 1e-9, large},
        {"resolution", &samples.resolution, 1, 0, large},
        {"lower", samples.lower.data(), n, -inf, inf},
        {"upper", samples.upper.data(), n, -inf, inf},
        {"velocity", samples.velocity.data(), n, 0, inf},
        {"signal", samples.signal.data(), n, 0, inf},
        {"measured_rates", &measured_rates, 1, 0, 1},
        {"frozen_time", &samples.frozen_time, 1, 0, inf},
        {"unmonitored", &unmonitored, 1, 0, double((1 << max_joints) - 1)},
        {"endless", &endless, 1, 0, double((1 << max_joints) - 1)},
        {"observer_gain", &s.observer_gain, 1, 1e-9, large},
        {"window", &s.window, 1, 1e-9, large},
        {"degree", &degree, 1, 2, double(max_fit_degree)},
        {"gravity", s.gravity.data(), 3, -large, large},
        {"max_no_data_time", &s.max_no_data_time, 1, 0, large},
        {"unknown", &unknown, 1, 0, double((1 << max_joints) - 1)},
        {"noise_sd", s.noise_sd.data(), n, 1e-300, inf},
        {"dead_zone", s.dead_zone.data(), n, 0, large},
        {"contact", contact, 4, -large, large},
        {"direction", s.direction.data(), 3, -1, 1},
        {"payload", payload, 4, -large, large},
        {"payload_monitor", &watch.window, 1, 1e-9, large},
        {"payload_interval", &watch.interval, 1, 0, large},
        {"payload_least", &watch.min_mass, 1, 0, large},
        {"payload_share", &watch.min_share, 1, 0, 1},
        {"payload_change", &watch.min_change, 1, 0, 1},
        {"constant", thresholds.constant.data(), n, 1e-300, inf},
        {"speed", thresholds.speed.data(), n, 0, large},
        {"acceleration", thresholds.acceleration.data(), n, 0, large},
        {"rest", thresholds.rest.data(), n, 0, large},
        {"rest_speed", thresholds.rest_speed.data(), n, 1e-300, large},
        {"fast", thresholds.fast.data(), n, 1e-300, inf},
        {"model_errors", &thresholds.model_errors, 1, 0, large},
        {"arming_delay", &alarm.arming_delay, 1, 0, large},
        {"rest_time", &alarm.rest_time, 1, 0, large},
        {"low_hz", &alarm.low_hz, 1, 1e-9, large},
        {"high_hz", &alarm.high_hz, 1, 1e-9, large},
        {"event_pause", &alarm.event_pause, 1, 1e-9, inf},
    };
    detail::FittedReader fitted(n);
    std::string version;
    if (!text.next() || text.keyword != "bumpstop-detector" || !text.word(version) || version != "2")
        return wrong("not a detector of version 2");
    while (text.done()) {
        if (!text.next()) return wrong("the detector ends without 'end'");
        if (text.keyword == "end") break;
        if (text.keyword == "joint_torque") {
            if (!detail::read_joint_torque(text, out.joints.emplace_back()))
                return wrong("'joint_torque' wants a map, a friction law and fifteen numbers");
        } else if (text.keyword == "joint_errors") {
            if (!detail::read_joint_errors(text, out.errors.emplace_back()))
                return wrong("'joint_errors' wants twelve numbers, not negative");
        } else if (!(text.keyword.rfind("fitted_", 0) == 0 ? fitted.read(text) : text.read(fields))) {
            return std::nullopt;
        }
    }
    if (!text.done()) return std::nullopt;
    if (const char* lacks = detail::missing(fields)) return wrong(detail::quoted("", lacks, " is missing"));
    s.residual = residual == "direct" ? ResidualKind::direct : ResidualKind::observer;
    s.source = source == "current" ? TorqueSource::current : TorqueSource::torque;
    if (!fitted.complete()) return wrong("the fitted dynamics are not complete");
    out.fitted = fitted.found();
    const std::size_t wanted = s.source == TorqueSource::current && !out.fitted ? std::size_t(n) : 0;
    if (out.joints.size() != wanted || out.errors.size() != wanted)
        return wrong("wanted " + std::to_string(wanted) + " lines 'joint_torque' and 'joint_errors'");
    if (!(alarm.low_hz < alarm.high_hz)) return wrong("'low_hz' is not below 'high_hz'");
    const auto finite = [&](const double* threshold) {
        return std::any_of(threshold, threshold + n, [](double x) { return std::isfinite(x); });
    };
    if (!finite(thresholds.constant.data()) && !finite(thresholds.fast.data()))
        return wrong("all thresholds, 'constant' and 'fast', are infinite: no joint is monitored");
    for (const double whole : {degree, measured_rates, unknown, unmonitored, endless, contact[0]})
        if (whole != std::floor(whole)) return wrong("a number that counts is not whole");
    if (!(contact[0] >= 0 && contact[0] < n)) return wrong("'contact' names no link");
    if (!detail::is_unit_vector(s.direction)) return wrong("'direction' wants a unit vector");
    if (!(payload[0] >= 0)) return wrong("'payload' has a negative mass");
    s.degree = int(degree);
    samples.measured_rates = measured_rates != 0;
    samples.unmonitored = std::uint32_t(unmonitored);
    samples.endless = std::uint32_t(endless);
    s.unknown = std::uint32_t(unknown);
    s.contact = link_point(robot->chain(), int(contact[0]), {contact[1], contact[2], contact[3]});
    s.payload = {payload[0], {payload[1], payload[2], payload[3]}};
    if (!text.next()) return out;
    return wrong("text after 'end'");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
