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

    /// A detection before contact whose stopping path still arrives. Those of a panel follow one another, the latest first.
    struct EarlyAlarm {
        double low, high, farthest, mass;
        double most;        ///< farthest minus low: the greatest of this and all that follow in its panel
        std::size_t after;  ///< index of the first of the next panel
    };

    /// Where panels are cut: of each the values at the nodes, the place on [-1, 1], and 1 / half its width [1/m].
    struct Cuts {
        std::vector<const double*> value;
        std::vector<double> place, inverse_half;

        void clear() {
            value.clear();
            place.clear();
            inverse_half.clear();
        }
        void add(const double* values, double cut, double low, double high) {
            const double inverse = 2 / (high - low);
            value.push_back(values);
            place.push_back((cut - 0.5 * (low + high)) * inverse);
            inverse_half.push_back(inverse);
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
        for (std::size_t i = 0; depth < most_early_ && i < early_.size();) {
            const EarlyAlarm& early = early_[i];
            if (early.most <= depth) {
                i = early.after;
                continue;
            }
            const double cut = early.farthest - depth;
            if (cut >= early.high) {
                sum.probability += early.mass;
            } else if (cut > early.low) {
                cuts_.add(&early_value_[i * order], cut, early.low, early.high);
            }
            ++i;
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
        for (int cut = slot - 1; cut >= 0 && farthest[cut] > low; --cut)
            add_slot(panel, std::size_t(cut), farthest[cut] - depth);
        return slot;
    }
    void add_any(const Panel& panel, double depth, TailAt& sum) {
        const double* farthest = farthest_.data() + panel.tick;
        for (int slot = 0; slot < panel.slots; ++slot) {
            if (farthest[slot] >= panel.high + depth) {
                sum.probability += mass_[panel.mass_at + std::size_t(slot)];
            } else if (farthest[slot] > panel.low + depth) {
                add_slot(panel, std::size_t(slot), farthest[slot] - depth);
            }
        }
    }
    void add_slot(const Panel& panel, std::size_t slot, double cut) {
        if (mass_[panel.mass_at + slot] > 0)
            cuts_.add(&value_[panel.value_at + slot * order], cut, panel.low, panel.high);
    }

    /// Adds what lies below the cuts.
    void add_cuts(TailAt& to) {
        const std::size_t count = cuts_.value.size();
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
                const double *node = cuts_.value[first + lane], inverse_half = cuts_.inverse_half[first + lane];
                T below = 0.0;
                for (int r = 0; r < registers; ++r) {
                    T part = 0.0, slope = 0.0;
                    BUMPSTOP_UNROLL
                    for (int l = 0; l < order; ++l) {
                        const T p = load<T>(half_legendre_[l] + r * lanes);
                        part += integral[l][lane] * p;
                        slope += value[l][lane] * p;
                    }
                    const T v = load<T>(node + r * lanes);
                    below += part * v;
                    density += slope * (v * inverse_half);
                }
                // The polynomial may dip below zero where there is next to nothing.
                to.probability += std::max(0.0, sum_of_lanes(below));
            }
        }
        to.density += sum_of_lanes(density);
    }

    /// Alarms before contact whose stopping path reaches the body.
    void find_early_alarms() {
        const int ticks = path_->ticks;
        double touching = 0;
        early_.clear();
        early_value_.clear();
        most_early_ = 0;
        if (quiet_.alarm_before(ticks) > 0) {
            // By tick: the farthest any stopping path gets that begins there or earlier.
            farthest_yet_.assign(farthest_.begin(), farthest_.begin() + ticks);
            for (int k = 1; k < ticks; ++k)
                farthest_yet_[std::size_t(k)] =
                    std::max(farthest_yet_[std::size_t(k)], farthest_yet_[std::size_t(k) - 1]);
            const std::size_t reached = panels_.size();
            this->add_end_panels(edge_.back(), farthest_yet_.back(), ticks + 1);
            for (const Panel& panel : panels_) {
                T offset[registers];
                this->weigh_offsets(panel, offset);
                const std::size_t first = early_.size();
                for (int k = std::min(panel.tick, ticks) - 1; k >= 0; --k) {
                    const double most = farthest_yet_[std::size_t(k)] - panel.low;
                    if (!(most > 0)) break;
                    const double farthest = farthest_[std::size_t(k)];
                    if (!quiet_.armed(k) || !(farthest > panel.low)) continue;
                    const double chance = quiet_.silence_before(k) * quiet_.idle().alarm;
                    early_.push_back({panel.low, panel.high, farthest, sum(offset) * chance, most, 0});
                    early_value_.resize(early_.size() * order);
                    double* value = &early_value_[early_value_.size() - order];
                    for (int r = 0; r < registers; ++r) store(offset[r] * chance, value + r * lanes);
                    touching += early_.back().mass;
                    most_early_ = std::max(most_early_, farthest - panel.low);
                }
                for (std::size_t i = first; i < early_.size(); ++i) early_[i].after = early_.size();
            }
            panels_.resize(reached);
        }
        harmless_ = std::max(0.0, alarm_before_ - touching) + no_contact;
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
        for (const EarlyAlarm& early : early_) {
            mass += early.mass;
            most_force_ = std::max(most_force_, stiffness_ * (early.farthest - early.low));
        }
        about = mass > 0 ? stiffness_ * about / mass : 0;
        T first = 0.0, second = 0.0;
        double sum1 = -harmless_ * about, sum2 = harmless_ * about * about;
        auto add = [&](const double* value, double low, double high, double farthest) {
            if (farthest > low && farthest < high) {
                add_reached(value, low, high, farthest, about, sum1, sum2);
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
        for (std::size_t i = 0; i < early_.size(); ++i)
            add(&early_value_[i * order], early_[i].low, early_[i].high, early_[i].farthest);
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

    /// Adds the first two moments about `about` of a panel that `farthest` is in: what lies beyond feels no force, and the
    /// rule is that of the nearer part, where the force is straight.
    void add_reached(const double* value, double low, double high, double farthest, double about, double& sum1,
                     double& sum2) const {
        double series[order], rest = 0;
        for (int l = 0; l < order; ++l) {
            double sum = 0;
            for (int g = 0; g < order; ++g) sum += half_legendre_[l][g] * value[g];
            series[l] = (2 * l + 1) * sum;
        }
        for (int g = 0; g < order; ++g) rest += value[g];
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
    std::vector<EarlyAlarm> early_;
    std::vector<double> early_value_;  ///< [early alarm][node]: probability
    Cuts cuts_;
    KnownTails known_;
    double most_early_ = 0;  ///< deepest an early alarm's path gets [m]
    double harmless_ = 0, most_force_ = 0;
    Moments moments_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
