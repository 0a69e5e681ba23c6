// A collision for JavaScript: numbers in SI go in by name, the figures of its distribution come out. What is written in a
// scenario is checked before, by scenario.js.
#include "bumpstop/collision/collision.hpp"

#include <emscripten/bind.h>

#include "bumpstop/collision/distribution/tail_without_interpolation.hpp"

namespace {

using namespace bumpstop;
using emscripten::val;
using L = Lanes<native_lanes>;

std::vector<double> numbers(const val& from) { return emscripten::convertJSArrayToNumberVector<double>(from); }
double number(const val& from, const char* name) { return from[name].as<double>(); }
int whole(const val& from, const char* name) { return from[name].as<int>(); }
template <std::size_t N>
std::array<double, N> first(const val& from) {
    const std::vector<double> all = numbers(from);
    std::array<double, N> out{};
    std::copy(all.begin(), all.end(), out.begin());
    return out;
}

Chain chain_of(const val& joints) {
    std::vector<JointSpec> specs;
    for (int j = 0; j < joints["length"].as<int>(); ++j) {
        const val joint = joints[j];
        specs.push_back({joint["prismatic"].as<bool>(), first<3>(joint["origin"]), first<9>(joint["rotation"]),
                         first<3>(joint["axis"])});
    }
    return Chain(specs);
}

CollisionSetup setup_of(const val& from) {
    CollisionSetup setup;
    setup.chain = chain_of(from["joints"]);
    MotionSettings& motion = setup.motion;
    motion.tip = link_point(setup.chain, whole(from, "tip_link"), first<3>(from["tip_point"]));
    motion.task_rows = whole(from, "task_rows");
    const std::vector<double> free = numbers(from["free_joints"]);
    motion.free_count = int(free.size());
    std::copy(free.begin(), free.end(), motion.free_joint.begin());
    motion.damping = number(from, "damping");
    motion.step = number(from, "step");
    motion.substeps = whole(from, "substeps");
    motion.acceleration_limit = first<max_joints>(from["acceleration_limit"]);
    motion.velocity_limit = first<max_joints>(from["velocity_limit"]);
    motion.lower = first<max_joints>(from["lower"]);
    motion.upper = first<max_joints>(from["upper"]);
    Deceleration& deceleration = motion.deceleration;
    const std::string law = from["deceleration"].as<std::string>();
    if (law == "constant_time") deceleration.law = DecelerationLaw::constant_time;
    if (law == "ramp") deceleration.law = DecelerationLaw::ramp;
    deceleration.stopping_time = number(from, "stopping_time");
    deceleration.ramp_time = number(from, "ramp_time");
    deceleration.independent = from["independent"].as<bool>();
    setup.contact.point = link_point(setup.chain, whole(from, "contact_link"), first<3>(from["contact_point"]));
    setup.contact.along_motion = from["normal"].isNull();
    if (!setup.contact.along_motion) setup.contact.normal = first<3>(from["normal"]);
    setup.timing = {whole(from, "steps"), whole(from, "period"), whole(from, "latency"), from["from_rest"].as<bool>()};
    setup.reaction = from["reaction"].as<std::string>() == "stop" ? ReactionKind::stop : ReactionKind::reverse;
    return setup;
}

GaussianThresholds detector_of(const val& from) {
    const std::vector<double> threshold = numbers(from["threshold"]), sd = numbers(from["noise_sd"]),
                              mean = numbers(from["noise_mean"]);
    GaussianThresholds detector;
    for (std::size_t j = 0; j < threshold.size(); ++j) detector.add_joint(threshold[j], sd[j], mean[j]);
    detector.arming_delay = number(from, "arming_delay");
    detector.correlation = number(from, "correlation");
    detector.filter = number(from, "filter");
    return detector;
}

// One collision: `start` says whether it can begin, `integrate` must come before what is asked of its distribution.
class Collision {
  public:
    explicit Collision(const val& from)
        : setup_(setup_of(from)),
          q_(numbers(from["q"])),
          velocity_(first<3>(from["velocity"])),
          detector_(detector_of(from)) {
        contact_.body.stiffness = number(from, "stiffness");
    }

    val start() const {
        LinePath path;
        const auto line = begin_line<double>(setup_, q_.data(), {velocity_[0], velocity_[1], velocity_[2]}, &path, 1);
        val out = val::object();
        out.set("singular", bool(line.rates.conditioning.singular));
        out.set("approach_speed", path.approach_speed);
        const Point3<double> v = line.point_velocity;
        out.set("speed", std::sqrt(dot(v, v)));
        return out;
    }

    void integrate(const std::string& kind, double size) {
        contact_.offset.kind = kind == "half_normal" ? OffsetKind::half_normal
                               : kind == "fixed"     ? OffsetKind::fixed
                                                     : OffsetKind::uniform;
        contact_.offset.size = size;
        curve_ = stopping_curve<L>(setup_, request(), &detector_, contact_);
        law_ = bumpstop::integrate<L>(setup_, curve_, detector_, {contact_});
        for (LinearQuantity* one : {&law_.peak_force, &law_.force_at_detection, &law_.detection_delay})
            if (!one->has_moments) find_moments<L>(law_.density, *one);
    }

    val figures() const {
        val out = val::object();
        const Moments peak = law_.moments();
        out.set("mean", peak.mean);
        out.set("sd", peak.sd);
        out.set("rests", law_.rests);
        out.set("false_alarm", law_.false_alarm);
        out.set("undetected", law_.undetected);
        out.set("no_contact", law_.no_contact);
        out.set("multi_joint", law_.multi_joint);
        out.set("after_contact", law_.force_at_detection.total);
        out.set("force_at_detection", moments_of(law_.force_at_detection));
        out.set("detection_delay", moments_of(law_.detection_delay));
        out.set("trigger", val::array(law_.trigger, law_.trigger + setup_.chain.dof));
        out.set("end", std::string(name_of(curve_.path.end)));
        out.set("end_joint", curve_.path.end_joint);
        out.set("cut_step", curve_.path.cut_step);
        out.set("velocity_limited", curve_.path.velocity_limited);
        // What a tick alarms with when nothing is touched.
        out.set("alarm_of_tick", any_alarm<double>(detector_, [](int) { return 0.0; }).alarm);
        return out;
    }

    // P(peak force > force) of detected collisions [N], and by itself where that is so small that digits are lost.
    double tail(double force) const { return bumpstop::tail<L>(law_.density, law_.peak_force, force).probability; }
    double far_tail(double force) const {
        return tail_without_interpolation<L>(setup_, curve_, detector_, contact_, force);
    }
    double upper_quantile(const std::string& name, double allowed, double never) const {
        const LinearQuantity& of = name == "force_at_detection" ? law_.force_at_detection
                                   : name == "detection_delay"  ? law_.detection_delay
                                                                : law_.peak_force;
        return bumpstop::upper_quantile<L>(law_.density, of, allowed, never);
    }
    // After every simulation step along the contact normal [m].
    val distance() const { return val::array(curve_.path.s); }

  private:
    static val moments_of(const LinearQuantity& of) {
        val out = val::object();
        out.set("mean", of.moments.mean);
        out.set("sd", of.moments.sd);
        return out;
    }
    LineRequest request() const { return {q_.data(), {velocity_[0], velocity_[1], velocity_[2]}}; }

    CollisionSetup setup_;
    std::vector<double> q_;
    std::array<double, 3> velocity_;
    GaussianThresholds detector_;
    Contact contact_{};
    StoppingCurve curve_{};
    CollisionDistribution law_{};
};

}  // namespace

EMSCRIPTEN_BINDINGS(bumpstop) {
    emscripten::class_<Collision>("Collision")
        .constructor<val>()
        .function("start", &Collision::start)
        .function("integrate", &Collision::integrate)
        .function("figures", &Collision::figures)
        .function("tail", &Collision::tail)
        .function("far_tail", &Collision::far_tail)
        .function("upper_quantile", &Collision::upper_quantile)
        .function("distance", &Collision::distance);
}
