/// @file
/// Probability of detection at every tick after contact, by survival from tick to tick.
#pragma once

#include "bumpstop/collision/distribution/alarm_models.hpp"
#include "bumpstop/collision/distribution/offset_mesh.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Detection probabilities at the Gauss nodes of panels, given no alarm before a panel's first tick. They are computed
/// for some panels and interpolated for the others.
struct DetectionProbabilities {
    static constexpr int max_nodes = 20;
    struct Panel {
        int slots = 0;  ///< ticks from the first one in contact on that may detect
        bool computed = false;
        std::size_t first_slot = 0, row = 0;  ///< of a computed panel
        std::size_t run = 0, weight = 0;      ///< of an interpolated panel
    };
    /// Computed panels that others are interpolated from.
    struct Run {
        int nodes = 0, shortest = 0, longest = 0;  ///< slots of the panels
        std::size_t panel[max_nodes] = {};
    };

    std::vector<Panel> panel;
    std::vector<double> detected;  ///< [slot][node], slots of all panels contiguous
    std::vector<double> survived;  ///< [row][node]: undetected by the end of the motion
    std::vector<double> trigger;   ///< [row][monitored joint, then several joints at one tick][node]
    std::vector<Run> run;
    std::vector<double> weight;
    std::size_t rows = 0;

    void begin(std::size_t panels) {
        panel.assign(panels, {});
        for (std::vector<double>* values : {&detected, &survived, &trigger, &weight}) values->clear();
        run.clear();
        rows = 0;
    }
    /// Begins a panel that is computed.
    void add(std::size_t p, std::size_t order, std::size_t monitored) {
        panel[p].computed = true;
        panel[p].first_slot = detected.size() / order;
        panel[p].row = rows++;
        survived.resize(rows * order);
        trigger.resize(rows * (monitored + 1) * order);
    }

    /// Values by slot and node of panel p, in the layout of `detected`; `room` holds interpolated ones.
    template <class T>
    const double* by_slot(const std::vector<double>& values, std::size_t p, std::size_t order,
                          std::vector<double>& room) const {
        const Panel& own = panel[p];
        if (own.computed) return values.data() + own.first_slot * order;
        const Run& from = run[own.run];
        room.resize(std::size_t(own.slots) * order);
        const double* source[max_nodes];
        for (int m = 0; m < from.nodes; ++m) source[m] = &values[panel[from.panel[m]].first_slot * order];
        combine<T>(from, own.weight, source, 0, std::size_t(std::min(from.shortest, own.slots)) * order, room.data());
        // A panel adds nothing to slots that it does not have.
        for (int slot = from.shortest; slot < own.slots; ++slot) {
            for (std::size_t g = 0; g < order; g += std::size_t(Scalar<T>::lanes)) {
                const std::size_t at = std::size_t(slot) * order + g;
                T sum = 0.0;
                for (int m = 0; m < from.nodes; ++m)
                    if (slot < panel[from.panel[m]].slots)
                        sum += weight[own.weight + std::size_t(m)] * load<T>(source[m] + at);
                store(sum, &room[at]);
            }
        }
        return room.data();
    }
    /// `count` values of panel p, in the layout of `survived` or `trigger`.
    template <class T>
    const double* by_panel(const std::vector<double>& values, std::size_t p, std::size_t count,
                           std::vector<double>& room) const {
        const Panel& own = panel[p];
        if (own.computed) return values.data() + own.row * count;
        const Run& from = run[own.run];
        room.resize(count);
        const double* source[max_nodes];
        for (int m = 0; m < from.nodes; ++m) source[m] = &values[panel[from.panel[m]].row * count];
        combine<T>(from, own.weight, source, 0, count, room.data());
        return room.data();
    }

  private:
    template <class T>
    void combine(const Run& from, std::size_t first_weight, const double* const* source, std::size_t begin,
                 std::size_t end, double* to) const {
        constexpr std::size_t lanes = std::size_t(Scalar<T>::lanes);
        // Several registers at a time hide the latency of their sums.
        const auto by_registers = [&]<std::size_t count>(std::integral_constant<std::size_t, count>) {
            for (; begin + count * lanes <= end; begin += count * lanes) {
                T sum[count];
                for (T& one : sum) one = 0.0;
                for (int m = 0; m < from.nodes; ++m)
                    for (std::size_t r = 0; r < count; ++r)
                        sum[r] = fused(T(weight[first_weight + std::size_t(m)]), load<T>(source[m] + begin + r * lanes),
                                       sum[r]);
                for (std::size_t r = 0; r < count; ++r) store(sum[r], to + begin + r * lanes);
            }
        };
        by_registers(std::integral_constant<std::size_t, 4>());
        by_registers(std::integral_constant<std::size_t, 1>());
    }
};

/// Clamped contact: the force follows from the distance of the arm.
template <class T>
class ClampedContact {
  public:
    explicit ClampedContact(double stiffness) : stiffness_(stiffness) {}

    void begin(const OffsetPanel&, const T* offset) { std::copy_n(offset, block_registers<T>, offset_); }
    /// At the i-th tick in contact, where the arm is at s.
    T force(double s, int, int r) const { return max(T(s - offset_[r]), T(0.0)) * stiffness_; }
    T residual(T force, double torque_per_N, int, int, int) const { return torque_per_N * force; }
    void finish(std::size_t, int) const {}

    static constexpr bool may_separate = false;
    double chance_tolerance() const { return 0.0; }
    T detectable(int, int) const { return 1.0; }

  private:
    double stiffness_;
    T offset_[block_registers<T>];
};

/// Integrates the survival of collisions from tick to tick, panel by panel.
template <class T, class Alarms>
class DetectionIntegrator {
  public:
    DetectionIntegrator(const CollisionSetup& setup, const GaussianThresholds& detector, const PreContactAlarms& before,
                        Alarms alarms, double negligible_survival = Alarms::negligible_survival)
        : timing_(setup.timing),
          detector_(detector),
          before_(before),
          alarms_(std::move(alarms)),
          negligible_survival_(negligible_survival) {}

    /// `mesh`: of the path. `max_force`: no collision of the path reaches a greater one [N]. In an `elastic` arm every
    /// joint oscillates after contact, also one that the contact force does not load.
    void begin(const LinePath& path, const OffsetMesh& mesh, double max_force, bool elastic = false) {
        path_ = &path;
        mesh_ = &mesh;
        loaded_count_ = 0;
        unloaded_ = {};
        const NoContactTick& alone = before_.no_contact(before_.unarmed());
        for (int w = 0; w < detector_.monitored; ++w) {
            const double residual =
                mesh.max_torque_per_N()[std::size_t(w)] * max_force * detector_.scale[std::size_t(w)];
            if (elastic || residual > Alarms::negligible_residual) {
                loaded_[loaded_count_++] = w;
            } else {
                const double alarm = alone.single[std::size_t(w)];
                unloaded_.add(w, {alarm, 1 - alarm});
            }
        }
    }

    /// Computes panel number p of `out`.
    template <class Contact>
    void find(Contact& contact, const OffsetPanel& panel, int order, std::size_t p, DetectionProbabilities& out) {
        allow_interruption();
        out.add(p, std::size_t(order), std::size_t(detector_.monitored));
        for (int first = 0; first < order; first += PiecewiseDensity::block)
            find_block(contact, panel, order, first, p, out);
    }

    const LinePath& path() const { return *path_; }

  private:
    static constexpr int lanes = Scalar<T>::lanes, registers = block_registers<T>;

    /// The nodes from `first` on.
    template <class Contact>
    void find_block(Contact& contact, const OffsetPanel& panel, int order, int first, std::size_t p,
                    DetectionProbabilities& out) {
        const GaussRule& rule = gauss_rule(order);
        const double mid = 0.5 * (panel.low + panel.high), half = 0.5 * (panel.high - panel.low);
        T offset[registers], survival[registers], multi_joint[registers], armed[registers],
            single[max_joints][registers];
        for (int r = 0; r < registers; ++r) {
            offset[r] = mid + half * load<T>(&rule.node[std::size_t(first + r * lanes)]);
            survival[r] = 1.0;
            multi_joint[r] = armed[r] = 0.0;
            for (int f = 0; f < loaded_count_; ++f) single[f][r] = 0.0;
        }
        TickContact<T> here;
        contact.begin(panel, offset);
        alarms_.begin();
        DetectionProbabilities::Panel& own = out.panel[p];
        for (int k = panel.tick; k < path_->ticks; ++k) {
            const int slot = k - panel.tick;
            if (slot == own.slots) {
                ++own.slots;
                out.detected.resize(out.detected.size() + std::size_t(order), 0.0);
            }
            double* detected =
                &out.detected[(own.first_slot + std::size_t(slot)) * std::size_t(order) + std::size_t(first)];
            const double s = path_->at_tick(k, timing_.period);
            const double* torque_per_N = &mesh_->torque_per_N()[std::size_t(k) * max_joints];
            here.tick = k;
            here.torque_per_N = torque_per_N;
            for (int r = 0; r < registers; ++r) here.force[r] = contact.force(s, slot, r);
            if constexpr (!Alarms::tabulated) {
                for (int f = 0; f < loaded_count_; ++f) {
                    const int w = loaded_[f], joint = detector_.joint[std::size_t(w)];
                    for (int r = 0; r < registers; ++r)
                        here.residual[w][r] = contact.residual(here.force[r], torque_per_N[w], joint, slot, r);
                }
            }
            if (!before_.armed(k)) {
                alarms_.skip(here);
                continue;
            }
            T alarm[registers], no_alarm[registers], one[registers], weight[registers], most = 0.0;
            for (int r = 0; r < registers; ++r) {
                alarm[r] = unloaded_.alarm;
                no_alarm[r] = unloaded_.no_alarm;
                one[r] = unloaded_.one;
                weight[r] = survival[r];
                if constexpr (Contact::may_separate) weight[r] *= contact.detectable(slot, r);
                armed[r] += weight[r];
            }
            auto&& tick = alarms_.at(here);
            for (int f = 0; f < loaded_count_; ++f) {
                for (int r = 0; r < registers; ++r) {
                    const AlarmProbability<T> joint = tick.chance(loaded_[f], r, here);
                    single[f][r] += weight[r] * joint.alarm;
                    one[r] = one[r] * joint.no_alarm + no_alarm[r] * joint.alarm;
                    alarm[r] += no_alarm[r] * joint.alarm;
                    no_alarm[r] = no_alarm[r] * joint.no_alarm;
                }
            }
            for (int r = 0; r < registers; ++r) {
                multi_joint[r] += weight[r] * max(alarm[r] - one[r], T(0.0));
                store(weight[r] * alarm[r], detected + r * lanes);
                T left = survival[r] * no_alarm[r];
                if constexpr (Contact::may_separate) {
                    // Once the body has separated it is not detected any more.
                    const auto in_contact = contact.detectable(slot, r) > T(0.0);
                    survival[r] = select(in_contact, left, survival[r]);
                    left = select(in_contact, left, T(0.0));
                } else {
                    survival[r] = left;
                }
                most = max(most, left);
            }
            if (!all(most < T(negligible_survival_))) continue;
            // The next ticks detect the rest. As undetected it would count with the force of an arm that presses on.
            for (int r = 0; r < registers; ++r) {
                T left = survival[r];
                if constexpr (Contact::may_separate) left = select(contact.detectable(slot, r) > T(0.0), left, T(0.0));
                store(load<T>(detected + r * lanes) + left, detected + r * lanes);
                survival[r] -= left;
            }
            break;
        }
        for (int r = 0; r < registers; ++r) {
            const std::size_t at = std::size_t(first + r * lanes), rows = std::size_t(detector_.monitored) + 1;
            const auto row = [&](int w) {
                return &out.trigger[(own.row * rows + std::size_t(w)) * std::size_t(order) + at];
            };
            store(survival[r], &out.survived[own.row * std::size_t(order) + at]);
            for (int w = 0; w < detector_.monitored; ++w) store(armed[r] * unloaded_.single[std::size_t(w)], row(w));
            for (int f = 0; f < loaded_count_; ++f) store(single[f][r], row(loaded_[f]));
            store(multi_joint[r], row(detector_.monitored));
        }
        contact.finish(p, own.slots);
    }

    const Timing& timing_;
    const GaussianThresholds& detector_;
    const PreContactAlarms& before_;
    Alarms alarms_;
    double negligible_survival_;
    const LinePath* path_ = nullptr;
    const OffsetMesh* mesh_ = nullptr;
    int loaded_[max_joints] = {}, loaded_count_ = 0;  ///< monitored joints that a contact force loads
    NoContactTick unloaded_;                          ///< of the others
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
