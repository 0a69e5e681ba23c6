/// @file
/// The law of one pose among many: the exact law's integrals to some 1e-8, at a fraction of its price.
#pragma once

#include "bumpstop/collision/batch_detection.hpp"
#include "bumpstop/collision/known_tails.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// The peak force of collisions whose detection is known. First `collide`, which needs no stopping path, says how probable
/// a detection at each tick is; then `stop` takes the stopping paths, and the figures may be asked for.
template <class T>
class BatchLaw : public BatchDetection<T> {
    using Detection = BatchDetection<T>;

  public:
    using Detection::no_contact;
    using Detection::undetected;

    BatchLaw(const ThresholdDetector& detector, const Timing& timing, const AlarmTable& alarms, const QuietTable& quiet,
             double stiffness, OffsetKind offset_kind)
        : Detection(detector, timing, alarms, quiet, stiffness, offset_kind) {
        const GaussRule& rule = gauss_rule(order);
        for (int g = 0; g < order; ++g) {
            for (int l = 0; l < order; ++l)
                half_legendre_[l][g] = rule.to_legendre[std::size_t(l) * order + g] / ((2 * l + 1) * rule.weight[g]);
        }
    }

    /// Takes the farthest points of the stopping paths, by tick.
    void stop(const std::vector<double>& farthest) {
        farthest_ = farthest;
        known_.clear();
        later_mass_ = mass_;
        for (Panel& panel : panels_) {
            const double* first = farthest_.data() + panel.tick;
            panel.sorted = std::is_sorted(first, first + panel.slots);
            for (std::size_t slot = std::size_t(panel.slots); slot-- > 1;)
                later_mass_[panel.mass_at + slot - 1] += later_mass_[panel.mass_at + slot];
        }
        find_early_alarms();
        find_moments();
    }

    /// Mean and standard deviation of the peak force, counting the force at the end where nothing was detected.
    Moments peak_force() const { return moments_; }

    /// P(peak force > force) of detected collisions.
    double tail(double force) { return ask(force).probability - undetected; }

    /// The smallest force with P(peak force > force) + undetected <= allowed; infinite where there is none.
    double upper_quantile(double allowed) {
        if (undetected > allowed) return std::numeric_limits<double>::infinity();
        // Every quantile is bracketed from below by the tail at no force.
        if (known_.knows_none()) ask(0.0);
        if (known_.at_none() <= allowed) return 0;
        double low = 0, high = most_force_;
        known_.narrow(allowed, low, high);
        const double resolution = 1e-11 * high, score = normal_score(allowed);
        const double small = std::max(resolution, small_step * moments_.sd);
        auto foretell = [&] {
            const double force = known_.foretell(score);
            return std::isnan(force) ? moments_.mean + moments_.sd * score : force;
        };
        double force = foretell();
        for (int iteration = 0; iteration < 200 && high - low > resolution; ++iteration) {
            if (!(force > low && force < high)) force = 0.5 * (low + high);
            const KnownTails::At at = ask(force);
            (at.probability > allowed ? low : high) = force;
            const double next = foretell();
            if (at.slope > 0 && std::fabs(at.probability - allowed) <= small_gap &&
                std::fabs(at.slope * (score - at.score)) <= small && std::fabs(next - force) <= small)
                return std::clamp(next, low, high);
            force = next;
        }
        return 0.5 * (low + high);
    }

  private:
    using Detection::alarm_before_;
    using Detection::edge_;
    using Detection::lanes;
    using Detection::mass_;
    using Detection::node_;
    using Detection::offset_;
    using Detection::order;
    using Detection::panels_;
    using Detection::path_;
    using Detection::quiet_;
    using Detection::registers;
    using Detection::stiffness_;
    using Detection::sum;
    using Detection::survived_;
    using Detection::value_;
    using Detection::weight_;
    using typename Detection::Panel;

    /// A last step towards a quantile may be this long, in standard deviations of the law, and make up for so much
    /// probability. A smooth law leaves next to nothing of that; others have kinks and steps between any two forces,
    /// about which what is known of the tail foretells nothing.
    static constexpr double small_step = 1e-5, small_gap = 1e-6;

    /// A panel of offsets that alarms before contact may meet: all of them with the same probabilities of the offset.
    struct EarlyPanel {
        double low, high, mid;
        double value[order];       ///< probability by node
        double moment[3];          ///< of value about the middle: sums of value, value d and value d^2
        std::size_t first, after;  ///< its alarms
        double most;               ///< the greatest of their depths
    };
    /// A detection before contact whose stopping path still arrives. Those of a panel follow one another, the latest first.
    struct EarlyAlarm {
        double farthest, chance;
        double most;  ///< farthest minus low: the greatest of this and all that follow in its panel
    };

    /// Where panels are cut: of each the values at the nodes and what they are to be multiplied with, the place on [-1, 1],
    /// and 1 / half its width [1/m].
    struct Cuts {
        struct Values {
            const double* at_nodes;
            double factor, inverse_half;
        };
        std::vector<Values> values;
        std::vector<double> place;

        void clear() {
            values.clear();
            place.clear();
        }
        void add(const Values& cut, double at) {
            values.push_back(cut);
            place.push_back(at);
        }
    };

    KnownTails::At ask(double force) {
        const TailAt at = tail_at(force);
        return known_.add(force, at.probability + undetected, at.density);
    }

    TailAt tail_at(double force) {
        const double depth = force / stiffness_;
        TailAt sum{0, 0};
        cuts_.clear();
        int passing = 0;  // in the panel before: few more or fewer pass here
        for (const Panel& panel : panels_) {
            if (panel.mass == 0) continue;
            if (panel.sorted) {
                passing = add_sorted(panel, depth, passing, sum);
            } else {
                add_any(panel, depth, sum);
            }
        }
        // What begins to stop before contact does not press hard.
        for (const EarlyPanel& panel : early_panels_) {
            if (panel.most <= depth) continue;
            const double inverse_half = 2 / (panel.high - panel.low);
            for (std::size_t i = panel.first; i < panel.after && early_[i].most > depth; ++i) {
                const double cut = early_[i].farthest - depth;
                if (cut >= panel.high) {
                    sum.probability += early_[i].chance * panel.moment[0];
                } else if (cut > panel.low) {
                    cuts_.add({panel.value, early_[i].chance, inverse_half}, (cut - panel.mid) * inverse_half);
                }
            }
        }
        add_cuts(sum);
        sum.probability = std::max(0.0, sum.probability);
        sum.density = std::max(0.0, sum.density) / stiffness_;
        return sum;
    }

    /// Of a panel whose stopping paths end the farther the later they begin, the last slots pass. Returns the first of them,
    /// which is looked for from `guess` on.
    int add_sorted(const Panel& panel, double depth, int guess, TailAt& sum) {
        const double *farthest = farthest_.data() + panel.tick, low = panel.low + depth, high = panel.high + depth;
        int slot = std::min(guess, panel.slots);
        while (slot > 0 && farthest[slot - 1] >= high) --slot;
        while (slot < panel.slots && farthest[slot] < high) ++slot;
        if (slot < panel.slots) sum.probability += later_mass_[panel.mass_at + std::size_t(slot)];
        if (slot == 0 || farthest[slot - 1] <= low) return slot;
        const double inverse_half = 2 / (panel.high - panel.low);
        for (int cut = slot - 1; cut >= 0 && farthest[cut] > low; --cut)
            add_slot(panel, std::size_t(cut), farthest[cut] - depth, inverse_half);
        return slot;
    }
    void add_any(const Panel& panel, double depth, TailAt& sum) {
        const double *farthest = farthest_.data() + panel.tick, inverse_half = 2 / (panel.high - panel.low);
        for (int slot = 0; slot < panel.slots; ++slot) {
            if (farthest[slot] >= panel.high + depth) {
                sum.probability += mass_[panel.mass_at + std::size_t(slot)];
            } else if (farthest[slot] > panel.low + depth) {
                add_slot(panel, std::size_t(slot), farthest[slot] - depth, inverse_half);
            }
        }
    }
    void add_slot(const Panel& panel, std::size_t slot, double cut, double inverse_half) {
        if (mass_[panel.mass_at + slot] > 0)
            cuts_.add({&value_[panel.value_at + slot * order], 1.0, inverse_half},
                      (cut - 0.5 * (panel.low + panel.high)) * inverse_half);
    }

    /// Adds what lies below the cuts.
    void add_cuts(TailAt& to) {
        const std::size_t count = cuts_.values.size();
        cuts_.place.resize((count + lanes - 1) / lanes * lanes, 0.0);
        T density = 0.0;
        for (std::size_t first = 0; first < count; first += lanes) {
            // The interpolating polynomial is a Legendre series; P_l integrates to (P_l+1 - P_l-1) / (2l + 1).
            double integral[order][lanes], value[order][lanes];
            const T x = load<T>(&cuts_.place[first]);
            T before = 1.0, here = x;
            store(x + 1.0, integral[0]);
            store(T(1.0), value[0]);
            for (int l = 1; l < order; ++l) {
                const T after = legendre_factors.rise[l] * x * here - legendre_factors.fall[l] * before;
                store(after - before, integral[l]);
                store((2.0 * l + 1) * here, value[l]);
                before = here;
                here = after;
            }
            for (std::size_t lane = 0; lane < lanes && first + lane < count; ++lane) {
                const typename Cuts::Values& cut = cuts_.values[first + lane];
                const double slope_factor = cut.factor * cut.inverse_half;
                T below = 0.0;
                for (int r = 0; r < registers; ++r) {
                    T part = 0.0, slope = 0.0;
                    BUMPSTOP_UNROLL
                    for (int l = 0; l < order; ++l) {
                        const T p = load<T>(half_legendre_[l] + r * lanes);
                        part += integral[l][lane] * p;
                        slope += value[l][lane] * p;
                    }
                    const T v = load<T>(cut.at_nodes + r * lanes);
                    below += part * v;
                    density += slope * (v * slope_factor);
                }
                // The polynomial may dip below zero where there is next to nothing.
                to.probability += cut.factor * std::max(0.0, sum_of_lanes(below));
            }
        }
        to.density += sum_of_lanes(density);
    }

    /// Alarms before contact whose stopping path reaches the body.
    void find_early_alarms() {
        const int ticks = path_->ticks;
        double touching = 0;
        early_.clear();
        early_panels_.clear();
        if (quiet_.alarm_before(ticks) > 0) {
            // By tick: the farthest any stopping path gets that begins there or earlier.
            farthest_yet_.assign(farthest_.begin(), farthest_.begin() + ticks);
            for (int k = 1; k < ticks; ++k)
                farthest_yet_[std::size_t(k)] =
                    std::max(farthest_yet_[std::size_t(k)], farthest_yet_[std::size_t(k) - 1]);
            const std::size_t reached = panels_.size();
            this->add_end_panels(edge_.back(), farthest_yet_.back(), ticks + 1);
            for (const Panel& panel : panels_) {
                EarlyPanel made;
                made.first = early_.size();
                made.most = 0;
                double chances = 0;
                for (int k = std::min(panel.tick, ticks) - 1; k >= 0; --k) {
                    const double most = farthest_yet_[std::size_t(k)] - panel.low;
                    if (!(most > 0)) break;
                    const double farthest = farthest_[std::size_t(k)];
                    if (!quiet_.armed(k) || !(farthest > panel.low)) continue;
                    const double chance = quiet_.silence_before(k) * quiet_.idle().alarm;
                    early_.push_back({farthest, chance, most});
                    chances += chance;
                    made.most = std::max(made.most, farthest - panel.low);
                }
                if (early_.size() == made.first) continue;
                made.after = early_.size();
                made.low = panel.low;
                made.high = panel.high;
                made.mid = 0.5 * (panel.low + panel.high);
                weigh_early(panel, made);
                touching += made.moment[0] * chances;
                early_panels_.push_back(made);
            }
            panels_.resize(reached);
        }
        harmless_ = std::max(0.0, alarm_before_ - touching) + no_contact;
    }

    void weigh_early(const Panel& panel, EarlyPanel& made) const {
        const double half = 0.5 * (panel.high - panel.low);
        T offset[registers], moment[3][registers];
        this->weigh_offsets(panel, offset);
        for (int r = 0; r < registers; ++r) {
            const T d = half * load<T>(node_ + r * lanes);
            store(offset[r], made.value + r * lanes);
            moment[0][r] = offset[r];
            moment[1][r] = offset[r] * d;
            moment[2][r] = offset[r] * d * d;
        }
        for (int i = 0; i < 3; ++i) made.moment[i] = sum(moment[i]);
    }

    void find_moments() {
        // About a value near the mean, so that a narrow law far from zero keeps its digits.
        double about = 0, mass = 0;
        most_force_ = 0;
        auto each = [&](auto use) {
            for (const Panel& panel : panels_) {
                if (panel.mass == 0) continue;
                for (int slot = 0; slot < panel.slots; ++slot)
                    use(panel, &value_[panel.value_at + std::size_t(slot) * order],
                        mass_[panel.mass_at + std::size_t(slot)], farthest_[std::size_t(panel.tick + slot)]);
            }
        };
        each([&](const Panel& panel, const double*, double here, double farthest) {
            if (here == 0) return;
            about += here * std::max(0.0, farthest - 0.5 * (panel.low + panel.high));
            mass += here;
            most_force_ = std::max(most_force_, stiffness_ * (farthest - panel.low));
        });
        for (const EarlyPanel& panel : early_panels_) {
            for (std::size_t i = panel.first; i < panel.after; ++i) mass += early_[i].chance * panel.moment[0];
            most_force_ = std::max(most_force_, stiffness_ * panel.most);
        }
        about = mass > 0 ? stiffness_ * about / mass : 0;
        T first = 0.0, second = 0.0;
        double sum1 = -harmless_ * about, sum2 = harmless_ * about * about;
        auto add = [&](const double* value, double low, double high, double farthest) {
            if (farthest > low && farthest < high) {
                add_reached(value, 1.0, low, high, farthest, about, sum1, sum2);
                return;
            }
            const double mid = 0.5 * (low + high), half = 0.5 * (high - low);
            for (int r = 0; r < registers; ++r) {
                const T offset = mid + half * load<T>(node_ + r * lanes);
                const T force = maximum(stiffness_ * (farthest - offset), T(0.0)) - about;
                const T weighted = load<T>(value + r * lanes) * force;
                first += weighted;
                second += weighted * force;
            }
        };
        each([&](const Panel& panel, const double* value, double here, double farthest) {
            if (here != 0) add(value, panel.low, panel.high, farthest);
        });
        for (const EarlyPanel& panel : early_panels_) {
            for (std::size_t i = panel.first; i < panel.after; ++i) {
                const double farthest = early_[i].farthest, chance = early_[i].chance;
                if (farthest < panel.high) {
                    add_reached(panel.value, chance, panel.low, panel.high, farthest, about, sum1, sum2);
                    continue;
                }
                const double middle = stiffness_ * (farthest - panel.mid) - about;
                sum1 += chance * (middle * panel.moment[0] - stiffness_ * panel.moment[1]);
                sum2 += chance * (middle * (middle * panel.moment[0] - 2 * stiffness_ * panel.moment[1]) +
                                  stiffness_ * stiffness_ * panel.moment[2]);
            }
        }
        if (undetected > 0) {
            const double end = path_->ticks > 0 ? path_->s[this->end_step()] : 0;
            for (std::size_t p = 0; p < panels_.size(); ++p)
                add(&survived_[p * order], panels_[p].low, panels_[p].high, end);
        }
        const double total = mass + harmless_ + undetected;
        sum1 += sum_of_lanes(first);
        sum2 += sum_of_lanes(second);
        const double offset = sum1 / total;
        moments_ = {about + offset, std::sqrt(std::max(0.0, sum2 / total - offset * offset))};
    }

    /// Adds the first two moments about `about` of a panel that `farthest` is in, its values multiplied with `factor`: what lies beyond feels no force, and the
    /// rule is that of the nearer part, where the force is straight.
    void add_reached(const double* value, double factor, double low, double high, double farthest, double about,
                     double& sum1, double& sum2) const {
        double series[order], rest = 0;
        for (int l = 0; l < order; ++l) {
            double sum = 0;
            for (int g = 0; g < order; ++g) sum += half_legendre_[l][g] * value[g];
            series[l] = factor * (2 * l + 1) * sum;
        }
        for (int g = 0; g < order; ++g) rest += factor * value[g];
        const double share = (farthest - low) / (high - low);
        for (int g = 0; g < order; ++g) {
            const double part = 0.5 * (node_[g] + 1);  // of the way from `low` to `farthest`
            const double here = share * weight_[g] *
                                legendre_series(order, 2 * share * part - 1, [&](int l) { return series[l]; }).value;
            const double force = stiffness_ * (farthest - low) * (1 - part) - about;
            sum1 += here * force;
            sum2 += here * force * force;
            rest -= here;
        }
        sum1 -= rest * about;
        sum2 += rest * about * about;
    }

    double half_legendre_[order][order];  ///< half_legendre_[l]: P_l / 2 at the nodes

    std::vector<double> farthest_, farthest_yet_;
    std::vector<double> later_mass_;  ///< mass_ of a slot and all later ones of its panel
    std::vector<EarlyPanel> early_panels_;
    std::vector<EarlyAlarm> early_;
    Cuts cuts_;
    KnownTails known_;
    double harmless_ = 0, most_force_ = 0;
    Moments moments_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
