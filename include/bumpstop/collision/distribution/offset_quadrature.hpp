/// @file
/// The quadrature over contact offset and sensor noise.
#pragma once

#include "bumpstop/collision/contact/elastic_arm.hpp"
#include "bumpstop/collision/distribution/collision_distribution.hpp"
#include "bumpstop/math/quadrature.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// `detect`, which needs no stopping path, computes the probability of a detection at each tick; `finish` then takes
/// the stopping distances. The object keeps its memory for the next pose.
template <class T, class Alarms>
class OffsetQuadrature {
  public:
    /// Objects that integrate in turn may share `probabilities`, which then stay in a near cache.
    OffsetQuadrature(const CollisionSetup& setup, const GaussianThresholds& detector, const PreContactAlarms& before,
                     const Alarms& alarms, DetectionProbabilities& probabilities)
        : setup_(setup),
          detector_(detector),
          before_(before),
          mesh_(setup, detector, before),
          integrator_(setup, detector, before, alarms),
          probabilities_(probabilities) {}

    /// False where the noise is too narrow for a table of alarms; then nothing else may be called.
    bool detect(const LinePath& path, const QuadratureSettings& settings) {
        path_ = &path;
        settings_ = settings;
        if constexpr (Alarms::tabulated) {
            const double growth = path.end == PathEnd::all_detected ? AlarmTable::widest : Alarms::max_uncertain_growth;
            if (!mesh_.build(path, settings_, {PiecewiseDensity::block, growth, Alarms::max_offset_growth}))
                return false;
        } else {
            mesh_.build(path, settings_);
        }
        find_probabilities();
        find_beyond();
        combine_probabilities();
        return true;
    }

    /// By tick: probability, at most, of a detection there whose outcome depends on the stopping distance.
    const std::vector<double>& detection() const { return detection_; }

    /// `max_distance`: stopping distances by tick [m].
    void finish(const std::vector<double>& max_distance) {
        zero_force_ = alarm_before_ + result_.no_contact;
        if (dynamic()) {
            bumpstop::add_early_reactions(*reactions_, settings_.contact.offset, before_, mesh_.edges(),
                                          result_.early_reactions);
            zero_force_ -= result_.early_reactions.total;
        } else {
            add_alarms(max_distance);
        }
        result_.zero_force = std::max(0.0, zero_force_);
        find_quantities(max_distance);
    }

    const CollisionDistribution& result() const { return result_; }
    CollisionDistribution&& take() { return std::move(result_); }

  private:
    static constexpr int lanes = Scalar<T>::lanes;
    struct alignas(64) Row {
        double value[max_order];
    };

    bool dynamic() const { return settings_.paths != nullptr; }
    bool fixed() const { return settings_.contact.offset.kind == OffsetKind::fixed; }

    void find_probabilities() {
        integrator_.begin(*path_, mesh_, settings_.contact.body.stiffness * std::max(0.0, mesh_.edges().back()),
                          dynamic() && settings_.propagator->elastic());
        const auto interpolate = [&](auto&& contact) {
            InterpolatedPanels panels(integrator_, contact, mesh_, before_, probabilities_);
            panels();
            result_.interpolated = panels.interpolated();
        };
        if constexpr (!Alarms::tabulated) {
            if (dynamic()) {
                reactions_.emplace(*settings_.paths, *settings_.propagator, settings_.batch);
                cache_.emplace(mesh_.panels().size());
                return interpolate(DynamicContact<T>(*reactions_, *cache_));
            }
        }
        interpolate(ClampedContact<T>(settings_.contact.body.stiffness));
    }

    /// By edge, the probability that the offset lies beyond it.
    void find_beyond() {
        const std::vector<double>& edge = mesh_.edges();
        beyond_.assign((edge.size() + lanes - 1) / lanes * lanes, edge.back());
        std::copy(edge.begin(), edge.end(), beyond_.begin());
        if (fixed()) {
            const int first = mesh_.panels().empty() ? path_->ticks + 1 : mesh_.panels()[0].tick;
            for (int k = 0; k <= path_->ticks + 1; ++k) beyond_[std::size_t(k)] = first >= k;
            return;
        }
        for (std::size_t k = 0; k < edge.size(); k += std::size_t(lanes))
            store(settings_.contact.offset.probability_beyond(load<T>(&beyond_[k])), &beyond_[k]);
    }

    /// Weights of the nodes times the density of the offset there. Returns their sum.
    double offset_weights(double low, double high, Row& row) const {
        const GaussRule& rule = gauss_rule(mesh_.order());
        const double mid = 0.5 * (low + high), half = 0.5 * (high - low);
        T sum = 0.0;
        for (int g = 0; g < mesh_.order(); g += lanes) {
            const T o = mid + half * load<T>(&rule.node[std::size_t(g)]);
            const T weight = load<T>(&rule.weight[std::size_t(g)]) *
                             (fixed() ? T(0.5) : T(settings_.contact.offset.density(o) * half));
            store(weight, row.value + g);
            sum += weight;
        }
        return sum_of_lanes(sum);
    }

    /// Multiplies the probabilities of detection, of the offset and of no alarm before contact.
    void combine_probabilities() {
        const int order = mesh_.order(), ticks = path_->ticks;
        const std::size_t step = std::size_t(order);
        const GaussRule& rule = gauss_rule(order);
        PiecewiseDensity& density = result_.density;
        density.clear(order);
        alarm_before_ = result_.undetected = result_.multi_joint = 0;
        std::fill(result_.trigger, result_.trigger + max_joints, 0.0);
        contact_from_.assign(std::size_t(ticks) + 1, 0.0);
        detection_.assign(std::size_t(ticks), 0.0);
        // An alarm before contact matters if the arm still reaches the body. That is not known yet: all of them count.
        for (int k = before_.unarmed(); k < ticks; ++k)
            detection_[std::size_t(k)] =
                before_.survival_before(k) * before_.no_contact(k).alarm * beyond_[std::size_t(k) + 1];
        std::size_t slots = 0;
        for (std::size_t p = 0; p < mesh_.panels().size(); ++p) {
            const OffsetPanel& from = mesh_.panels()[p];
            density.panel.push_back({from.low, from.high, from.tick, probabilities_.panel[p].slots, slots});
            slots += std::size_t(density.panel.back().slots);
        }
        density.series.resize(slots * step);
        density.mass.resize(slots);
        node_weight_.assign(probabilities_.rows * step, 0.0);
        Row weight, row;
        for (std::size_t p = 0; p < density.panel.size(); ++p) {
            allow_interruption();
            PiecewiseDensity::Panel& panel = density.panel[p];
            const double total = offset_weights(panel.low, panel.high, weight);
            const double survival = before_.survival_before(panel.first_tick);
            double detected_mass = 0;
            alarm_before_ += total * before_.false_alarm_before(panel.first_tick);
            contact_from_[std::size_t(std::min(panel.first_tick, ticks))] += total;
            for (int g = 0; g < order; g += lanes) store(load<T>(weight.value + g) * survival, weight.value + g);
            const double* from = probabilities_.by_slot<T>(probabilities_.detected, p, step, room_);
            double *series = density.series.data() + panel.first_slot * step,
                   *detected = detection_.data() + panel.first_tick;
            for (int slot = 0; slot < panel.slots; ++slot, from += step, series += step) {
                // Where the probability is zero interpolation may leave a small negative one.
                for (int g = 0; g < order; g += lanes)
                    store(load<T>(weight.value + g) * max(load<T>(from + g), T(0.0)), row.value + g);
                half_legendre_sums<T>(rule, row.value, series);
                const double mass = 2 * series[0];
                density.mass[panel.first_slot + std::size_t(slot)] = mass;
                detected[slot] += mass;
                detected_mass += mass;
            }
            panel.mass = detected_mass;
            const double* survived = probabilities_.by_panel<T>(probabilities_.survived, p, step, room_);
            T missed = 0.0;
            for (int g = 0; g < order; g += lanes) {
                const T here = load<T>(weight.value + g) * load<T>(survived + g);
                store(here, row.value + g);
                missed += here;
            }
            add_node_weights(p, weight);
            const double undetected = sum_of_lanes(missed);
            if (undetected == 0) continue;
            result_.undetected += undetected;
            density.end_series.resize(density.panel.size() * step, 0.0);
            half_legendre_sums<T>(rule, row.value, &density.end_series[p * step]);
        }
        find_triggers();
        density.sum_later_masses();
        if (dynamic()) {
            result_.nodes.gives_way = true;
            result_.nodes.pressed = !settings_.contact.body.gets_away() && !path_->rests();
            ContactOutcomes<T>(*reactions_, mesh_.panels(), mesh_.order(), probabilities_, *cache_, result_.nodes)();
            cache_.reset();
        }
        count_false_alarms();
    }

    /// Adds the weights of a panel to the nodes of computed panels: its own, or those that it is interpolated from.
    void add_node_weights(std::size_t p, const Row& weight) {
        const std::size_t step = std::size_t(mesh_.order());
        const DetectionProbabilities::Panel& panel = probabilities_.panel[p];
        const auto add = [&](std::size_t from, double factor) {
            double* to = &node_weight_[probabilities_.panel[from].row * step];
            for (std::size_t g = 0; g < step; g += std::size_t(lanes))
                store(load<T>(to + g) + factor * load<T>(weight.value + g), to + g);
        };
        if (panel.computed) return add(p, 1.0);
        const DetectionProbabilities::Run& run = probabilities_.run[panel.run];
        for (int m = 0; m < run.nodes; ++m) add(run.panel[m], probabilities_.weight[panel.weight + std::size_t(m)]);
    }
    void find_triggers() {
        const std::size_t step = std::size_t(mesh_.order()), monitored = std::size_t(detector_.monitored);
        const double* trigger = probabilities_.trigger.data();
        T sum[max_joints + 1];
        std::fill(sum, sum + monitored + 1, T(0.0));
        for (std::size_t row = 0; row < probabilities_.rows; ++row) {
            for (std::size_t w = 0; w <= monitored; ++w, trigger += step)
                for (std::size_t g = 0; g < step; g += std::size_t(lanes))
                    sum[w] += load<T>(&node_weight_[row * step + g]) * load<T>(trigger + g);
        }
        for (std::size_t w = 0; w < monitored; ++w) result_.trigger[detector_.joint[w]] = sum_of_lanes(sum[w]);
        result_.multi_joint = sum_of_lanes(sum[monitored]);
    }

    void count_false_alarms() {
        const int ticks = path_->ticks;
        const double beyond = beyond_[std::size_t(ticks) + 1];
        alarm_before_ += beyond * before_.false_alarm_before(ticks);
        contact_from_.back() += beyond;
        result_.no_contact = beyond * before_.survival_before(ticks);
        result_.false_alarm = beyond_[std::size_t(ticks)] * before_.false_alarm_before(ticks);
        for (int k = 0; k < ticks; ++k)
            result_.false_alarm +=
                (beyond_[std::size_t(k)] - beyond_[std::size_t(k) + 1]) * before_.false_alarm_before(k);
        // Joints share in them as in the alarms of ticks without contact.
        double waiting = 0;  // probability of contact after tick k
        for (int k = ticks - 1; k >= before_.unarmed(); --k) {
            waiting += contact_from_[std::size_t(k) + 1];
            const NoContactTick& tick = before_.no_contact(k);
            const double here = waiting * before_.survival_before(k);
            for (int w = 0; w < detector_.monitored; ++w)
                result_.trigger[detector_.joint[std::size_t(w)]] += here * tick.single[std::size_t(w)];
            result_.multi_joint += here * std::max(0.0, tick.alarm - tick.one);
        }
    }

    /// Alarms before contact after which the arm still reaches the body. At the end of its line the arm may brake into
    /// a body that it had not reached before, without an alarm.
    void add_alarms(const std::vector<double>& max_distance) {
        const int ticks = path_->ticks;
        const double braking = path_->max_braking_distance();
        if (!(before_.false_alarm_before(ticks) > 0) && !path_->brakes()) return;
        // By tick: greatest stopping distance up to it.
        max_distance_yet_.assign(max_distance.begin(), max_distance.begin() + ticks);
        for (std::size_t k = 1; k < max_distance_yet_.size(); ++k)
            max_distance_yet_[k] = std::max(max_distance_yet_[k], max_distance_yet_[k - 1]);
        PiecewiseDensity& density = result_.density;
        end_panels_.clear();
        mesh_.add_end_panels(mesh_.edges().back(), std::max(ticks > 0 ? max_distance_yet_.back() : 0.0, braking),
                             ticks + 1, end_panels_);
        for (const OffsetPanel& panel : end_panels_) density.panel.push_back({panel.low, panel.high, panel.tick});
        if (!density.end_series.empty())
            density.end_series.resize(density.panel.size() * std::size_t(density.order), 0.0);
        Row row;
        for (std::size_t p = 0; p < density.panel.size(); ++p) {
            PiecewiseDensity::Panel& panel = density.panel[p];
            panel.first_alarm = int(density.alarm.size());
            if (panel.first_tick > ticks && braking > panel.low)
                density.alarm.push_back({ticks, braking, before_.survival_before(ticks), 0});
            for (int k = std::min(panel.first_tick, ticks) - 1; k >= 0; --k) {
                if (!(max_distance_yet_[std::size_t(k)] > panel.low)) break;
                if (before_.armed(k))
                    density.alarm.push_back(
                        {k, max_distance[std::size_t(k)], before_.survival_before(k) * before_.no_contact(k).alarm, 0});
            }
            panel.end_alarm = int(density.alarm.size());
            if (panel.first_alarm == panel.end_alarm) continue;
            density.offset_series.resize(density.panel.size() * std::size_t(density.order), 0.0);
            double* series = &density.offset_series[p * std::size_t(density.order)];
            offset_weights(panel.low, panel.high, row);
            half_legendre_sums<T>(gauss_rule(density.order), row.value, series);
            zero_force_ -= 2 * series[0] * sort_alarms(panel);
        }
    }

    /// Sorts the alarms of a panel by reach; returns the sum of their probabilities.
    double sort_alarms(const PiecewiseDensity::Panel& panel) {
        const auto all = result_.density.alarm.begin(), begin = all + panel.first_alarm, end = all + panel.end_alarm;
        const auto farther = [](const PreContactAlarm& a, const PreContactAlarm& b) { return a.reach > b.reach; };
        if (!std::is_sorted(begin, end, farther)) std::sort(begin, end, farther);
        double chances = 0;
        for (auto alarm = begin; alarm != end; ++alarm) {
            alarm->before = chances;
            chances += alarm->chance;
        }
        return chances;
    }

    void find_quantities(const std::vector<double>& max_distance) {
        PiecewiseDensity& density = result_.density;
        const int ticks = path_->ticks;
        result_.rests = path_->rests();
        LinearQuantity& force = result_.peak_force;
        force.scale = settings_.contact.body.stiffness;
        force.of_alarms = true;
        force.of_end = result_.rests;
        if (settings_.batch) force.last_step = 1e-6;
        force.reach.assign(max_distance.begin(), max_distance.begin() + ticks);
        force.end_reach = path_->max_distance(mesh_.end_step());
        summarise(density, force);
        find_moments<T>(density, force);
        result_.detected = alarm_before_;
        for (const PiecewiseDensity::Panel& panel : density.panel) result_.detected += panel.mass;
        if (settings_.batch) return;
        LinearQuantity& end = result_.end_force;
        end.scale = settings_.contact.body.stiffness;
        end.of_detected = false;
        end.of_end = true;
        end.end_reach = force.end_reach;
        summarise(density, end);
        LinearQuantity &at_detection = result_.force_at_detection, &delay = result_.detection_delay;
        at_detection.scale = settings_.contact.body.stiffness;
        at_detection.reach.resize(std::size_t(ticks));
        delay.reach.resize(std::size_t(ticks));
        for (int k = 0; k < ticks; ++k) {
            at_detection.reach[std::size_t(k)] = mesh_.s_tick(k);
            delay.reach[std::size_t(k)] = setup_.tick_time(k);
        }
        // Between the ends of a panel the path is straight in time.
        delay.low.clear();
        delay.high.clear();
        for (const PiecewiseDensity::Panel& panel : density.panel) {
            delay.low.push_back(contact_time(panel.low, panel.first_tick));
            delay.high.push_back(contact_time(panel.high, panel.first_tick));
        }
        summarise(density, at_detection);
        summarise(density, delay);
    }

    /// Time at which the point passes offset o, first in contact at tick k: linear between simulation steps.
    double contact_time(double o, int k) const {
        const std::vector<double>& s = path_->s;
        const std::size_t last = std::min(std::size_t(k * setup_.timing.period) + 1, s.size() - 1);
        std::size_t i = k == 0 ? 0 : std::size_t((k - 1) * setup_.timing.period) + 1;
        while (i + 1 < last && s[i + 1] <= o) ++i;
        if (i >= last) return double(i) * setup_.motion.step;
        const double step = s[i + 1] - s[i];
        const double part = step > 0 ? std::clamp((o - s[i]) / step, 0.0, 1.0) : 0.0;
        return (double(i) + part) * setup_.motion.step;
    }

    const CollisionSetup& setup_;
    const GaussianThresholds& detector_;
    const PreContactAlarms& before_;
    QuadratureSettings settings_;
    OffsetMesh mesh_;
    DetectionIntegrator<T, Alarms> integrator_;
    DetectionProbabilities& probabilities_;
    std::optional<ContactReactions> reactions_;  ///< of dynamic contact,
    std::optional<CollisionCache> cache_;        ///< and the collisions that detection has simulated
    const LinePath* path_ = nullptr;
    double alarm_before_ = 0;           ///< probability of an alarm before contact
    double zero_force_ = 0;             ///< of no contact, or an alarm after which the arm does not reach the body
    std::vector<double> contact_from_;  ///< by first tick in contact: probability; the last is all later ones
    std::vector<double> detection_, beyond_, max_distance_yet_, room_, node_weight_;
    std::vector<OffsetPanel> end_panels_;
    CollisionDistribution result_;
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
