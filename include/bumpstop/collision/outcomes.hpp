/// @file
/// When collisions are detected, offset by offset: the part of the exact law that knows the detector.
#pragma once

#include "bumpstop/collision/quiet_ticks.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Survival below this ends a panel's ticks: nothing that is printed can feel it.
inline constexpr double negligible_survival = 1e-18;

/// Offsets low..high [m], whose first tick in contact is `tick`.
struct Panel {
    double low, high;
    int tick;
};

/// What happens in a panel given that nothing alarmed before its first tick, at the Gauss nodes of every panel of a
/// list. The list is padded to whole registers by repeating its last panel.
struct Outcomes {
    int panels = 0;                             ///< padded
    std::vector<std::vector<double>> detected;  ///< [slot after contact][node][panel]: D, detected at that tick
    std::vector<double> survived;               ///< [node][panel]: not detected by the end
    std::vector<double> trigger;                ///< [watched joint][node][panel]
    std::vector<double> several;                ///< [node][panel]
};

/// Clamped contact: the force follows from where the arm is.
template <class T>
struct ClampedContact {
    double stiffness;  ///< N/m

    struct Collision {
        double stiffness;
        T offset;

        // At the i-th tick in contact, where the arm is at s.
        T force(const T& s, int) const { return maximum(s - offset, T(0.0)) * stiffness; }
        // 1 where a detection then is one of this contact.
        T felt(int) const { return 1.0; }
    };
    /// At a node of the panels first .. first + lanes - 1.
    Collision begin(int, int, const T& offset) const { return {stiffness, offset}; }
};

/// Works out what happens to bodies of some kind of contact.
template <class T>
class OutcomeFinder {
  public:
    OutcomeFinder(const LinePath& path, const Timing& timing, const ThresholdDetector& detector,
                  const QuietTicks& quiet)
        : path_(path), timing_(timing), detector_(detector), quiet_(quiet) {}

    template <class Contact>
    Outcomes operator()(const Contact& contact, const std::vector<Panel>& panels, int order) const {
        const GaussRule& rule = gauss_rule(order);
        const int real = int(panels.size()), n = (real + lanes - 1) / lanes * lanes;
        Outcomes out;
        out.panels = n;
        const std::size_t block = std::size_t(order) * n;
        out.survived.assign(block, 0.0);
        out.several.assign(block, 0.0);
        out.trigger.assign(block * detector_.watched, 0.0);
        for (int first = 0; first < real; first += lanes) {
            Register at;
            at.first = first;
            for (int lane = 0; lane < lanes; ++lane) {
                const Panel& panel = panels[std::min(first + lane, real - 1)];
                at.tick[lane] = panel.tick;
                at.most_left = std::max(at.most_left, path_.ticks - panel.tick);
                set_lane(at.low, lane, panel.low);
                set_lane(at.high, lane, panel.high);
            }
            if (detector_.remembers()) {
                with_memory(contact, at, rule, out);
            } else {
                without_memory(contact, at, rule, out);
            }
        }
        return out;
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;

    struct Register {
        int first = 0;
        int tick[lanes] = {}, most_left = 0;
        T low, high;

        T offset(double node) const { return 0.5 * (low + high) + 0.5 * (high - low) * node; }
    };

    /// What is the same at one slot for all offsets of the panels.
    struct Slot {
        T s, watch = 1.0, torque[max_joints];  // watch: 1 where the tick exists and the detector is armed
        bool armed = true;                     // in all lanes whose tick exists
    };
    Slot slot(const Register& at, int i) const {
        Slot made;
        for (int lane = 0; lane < lanes; ++lane) {
            const int k = std::min(at.tick[lane] + i, path_.ticks - 1);
            const bool exists = at.tick[lane] + i < path_.ticks, armed = quiet_.armed(k);
            if (!exists || !armed) set_lane(made.watch, lane, 0.0);
            made.armed = made.armed && (armed || !exists);
            set_lane(made.s, lane, path_.at_tick(k, timing_.period));
            const double* a = &path_.torque_per_N[std::size_t(k) * path_.dof];
            for (int w = 0; w < detector_.watched; ++w) set_lane(made.torque[w], lane, a[detector_.joint[w]]);
        }
        return made;
    }

    /// Alarms of one tick, joint by joint.
    struct Tick {
        T alarm = 0.0, silent = 1.0, one = 0.0, single[max_joints];  // one: exactly one so far

        void add(int w, const AlarmProbability<T>& joint) {
            alarm = alarm + silent * joint.alarm;
            one = one * joint.silent + silent * joint.alarm;
            silent = silent * joint.silent;
            single[w] = joint.alarm;
        }
    };
    /// What has happened to one offset of every panel.
    struct Fate {
        T survival = 1.0, several = 0.0, trigger[max_joints];

        explicit Fate(int watched) {
            for (int w = 0; w < watched; ++w) trigger[w] = 0.0;
        }
        // Returns the probability of detection at this tick.
        T meet(const Tick& tick, T watch, int watched) {
            const T weight = survival * watch;
            for (int w = 0; w < watched; ++w) trigger[w] += weight * tick.single[w];
            several += weight * maximum(tick.alarm - tick.one, T(0.0));
            survival = select(watch > T(0.0), survival * tick.silent, survival);
            return weight * tick.alarm;
        }
    };
    void keep(const Fate& fate, std::size_t at, Outcomes& out) const {
        const std::size_t block = out.survived.size();
        store(fate.survival, &out.survived[at]);
        store(fate.several, &out.several[at]);
        for (int w = 0; w < detector_.watched; ++w) store(fate.trigger[w], &out.trigger[w * block + at]);
    }
    std::vector<double>& detected(Outcomes& out, int i) const {
        if (std::size_t(i) == out.detected.size()) out.detected.emplace_back(out.survived.size(), 0.0);
        return out.detected[std::size_t(i)];
    }

    template <class Contact>
    void without_memory(const Contact& contact, const Register& at, const GaussRule& rule, Outcomes& out) const {
        std::vector<typename Contact::Collision> collision;
        std::vector<Fate> fate(std::size_t(rule.order), Fate(detector_.watched));
        for (int g = 0; g < rule.order; ++g) collision.push_back(contact.begin(at.first, g, at.offset(rule.node[g])));
        Tick idle;
        for (int w = 0; w < detector_.watched; ++w) idle.add(w, joint_alarm(detector_, w, T(0.0)));
        for (int i = 0; i < at.most_left; ++i) {
            allow_interruption();
            const Slot here = slot(at, i);
            std::vector<double>& row = detected(out, i);
            T most_survival = 0.0;
            for (int g = 0; g < rule.order; ++g) {
                const T force = collision[g].force(here.s, i);
                const T watch = here.watch * collision[g].felt(i);
                Tick tick;
                if (any(force > T(0.0))) {
                    for (int w = 0; w < detector_.watched; ++w)
                        tick.add(w, joint_alarm(detector_, w, here.torque[w] * force));
                } else {
                    tick = idle;
                }
                store(fate[g].meet(tick, watch, detector_.watched), &row[std::size_t(g) * out.panels + at.first]);
                most_survival = maximum(most_survival, select(watch > T(0.0), fate[g].survival, T(0.0)));
            }
            // Ticks before the detector is armed are not watched either, but those after them are.
            if (all(most_survival < T(negligible_survival)) && here.armed) break;
        }
        for (int g = 0; g < rule.order; ++g) keep(fate[g], std::size_t(g) * out.panels + at.first, out);
    }

    /// The same where a tick depends on those before: correlated noise, or an observer.
    template <class Contact>
    void with_memory(const Contact& contact, const Register& at, const GaussRule& rule, Outcomes& out) const {
        std::vector<TruncatedDensity<T>> density(detector_.watched);
        std::vector<T> work;
        for (int g = 0; g < rule.order; ++g) {
            const auto collision = contact.begin(at.first, g, at.offset(rule.node[g]));
            Fate fate(detector_.watched);
            T residual[max_joints];
            for (int w = 0; w < detector_.watched; ++w) {
                residual[w] = 0.0;
                if (quiet_.has_memory(w)) begin(at, w, density[std::size_t(w)]);
            }
            for (int i = 0; i < at.most_left; ++i) {
                allow_interruption();
                const Slot here = slot(at, i);
                const T force = collision.force(here.s, i);
                const T felt = here.watch * collision.felt(i);
                Tick tick;
                for (int w = 0; w < detector_.watched; ++w) {
                    residual[w] = detector_.filtered(residual[w], T(here.torque[w] * force));
                    tick.add(w, watch(w, residual[w], here.watch, density[std::size_t(w)], work));
                }
                store(fate.meet(tick, felt, detector_.watched),
                      &detected(out, i)[std::size_t(g) * out.panels + at.first]);
                if (all(fate.survival < T(negligible_survival))) break;
            }
            keep(fate, std::size_t(g) * out.panels + at.first, out);
        }
    }

    AlarmProbability<T> watch(int w, T residual, T watched, TruncatedDensity<T>& density, std::vector<T>& work) const {
        if (!quiet_.has_memory(w)) return joint_alarm(detector_, w, residual);
        const AlarmProbability<T> chance = watch_tick(*quiet_.memory(w), density, residual, work);
        // A tick that is not watched says nothing about the noise.
        density.known = select(watched > T(0.0), density.known, T(0.0));
        return chance;
    }

    /// The noise as the ticks before contact left it.
    void begin(const Register& at, int w, TruncatedDensity<T>& density) const {
        density.forget(*quiet_.memory(w));
        for (int lane = 0; lane < lanes; ++lane) {
            const TruncatedDensity<double>& before = quiet_.density_before(w, std::min(at.tick[lane], path_.ticks));
            for (std::size_t i = 0; i < density.value.size(); ++i) set_lane(density.value[i], lane, before.value[i]);
            set_lane(density.low, lane, before.low);
            set_lane(density.high, lane, before.high);
            set_lane(density.centre, lane, before.centre);
            set_lane(density.known, lane, before.known);
        }
    }

    const LinePath& path_;
    const Timing& timing_;
    const ThresholdDetector& detector_;
    const QuietTicks& quiet_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
