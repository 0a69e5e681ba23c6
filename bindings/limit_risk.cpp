// How probably a collision passes a force.
#include "bumpstop/study/limit_risk.hpp"

#include "bumpstop/collision/survival_criterion.hpp"
#include "interrupt.hpp"
#include "setup.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

nb::dict limit_risk(const Setup& setup, Vector q, Vector velocity, const ThresholdDetector& detector, double stiffness,
                    const std::string& offset_kind, double offset_size, double force, double accepted, KnownPath* known,
                    bool crossing_decides) {
    LimitRisk found;
    KnownPath none;
    {
        const Unlocked unlocked;
        const LimitQuestion question{stiffness, offset_law(offset_kind, offset_size), force, accepted,
                                     crossing_decides};
        KnownPath& path_known = known == nullptr ? none : *known;
        auto criterion = [&]<class T>(T) {
            return SurvivalCriterion<T>(detector, setup.timing, setup.motion.step, stiffness,
                                        question.offset.largest());
        };
        LinePath path;
        if (auto finished = criterion(0.0); !path_known.shortened(setup.timing, finished, path)) {
            path = trace_line(setup, q.data(), velocity, criterion(L()));
            if (known != nullptr) known->path = path;
        }
        found = LimitRiskFinder<L>(setup.chain, setup.motion, setup.contact, setup.timing, setup.reaction, detector,
                                   q.data(), question, path_known)(std::move(path));
    }
    nb::dict out;
    out["low"] = found.low;
    out["high"] = found.high;
    out["undetected"] = found.undetected;
    out["false_alarm"] = found.false_alarm;
    out["at_crossing"] = found.at_crossing;
    out["follows"] = found.follows;
    out["reactions"] = found.reactions;
    return out;
}

}  // namespace

void bind_limit_risk(nb::module_& module) {
    nb::class_<KnownPath>(module, "KnownPath", "A path as far as it is traced, and the reactions simulated on it.")
        .def(nb::init<>());
    module.def("limit_risk", &limit_risk, nb::arg("setup"), nb::arg("q"), nb::arg("velocity"), nb::arg("detector"),
               nb::arg("stiffness"), nb::arg("offset_kind"), nb::arg("offset_size"), nb::arg("force"),
               nb::arg("accepted"), nb::arg("known").none() = nb::none(), nb::arg("crossing_decides") = false,
               "Bounds of the probability of passing a force, close where it is near the accepted.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
