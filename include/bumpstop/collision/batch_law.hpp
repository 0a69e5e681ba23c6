/// @file
/// The law of one pose among many: the exact law's integrals to some 1e-6, at a fraction of its price.
#pragma once

#include "bumpstop/collision/batch_detection.hpp"
#include "bumpstop/collision/known_tails.hpp"
#include "bumpstop/collision/panel_moments.hpp"

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
             double stiffness, OffsetKind offset_kind, DetectionScratch& scratch)
        : Detection(detector, timing, alarms, quiet, stiffness, offset_kind, scratch) {}

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

    /// P(peak force > force), collisions never detected and without a bound included.
    double exceedance(double force) { return ask(force).probability; }

    /// The smallest force with P(peak force > force) <= allowed; infinite where there is none.
    double upper_quantile(double allowed) {
        if (unbounded() > allowed) return std::numeric_limits<double>::infinity();
        // Every quantile is bracketed from below by the tail at no force.
        if (known_.knows_none()) ask(0.0);
        if (known_.at_none() <= allowed) return 0;
        double low = 0, high = stiffness_ * most_depth_;
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
    using Detection::series_;
    using Detection::stiffness_;
    using Detection::survived_;
    using Detection::weight_;
    using typename Detection::Panel;

    /// A last step towards a quantile may be this long, in standard deviations of the law, and make up for so much
    /// probability. A smooth law leaves next to nothing of that; others have kinks and steps between any two forces,
    /// about which what is known of the tail foretells nothing.
    static constexpr double small_step = 1e-5, small_gap = 1e-6;

    /// A panel of offsets that alarms before contact may meet: all of them with the same probabilities of the offset.
    struct EarlyPanel {
        double low, high;
        double series[order];      ///< of the probability of the offset
        std::size_t first, after;  ///< its alarms
        double chances;            ///< of all of them
        double most;               ///< the greatest of their depths
    };
    /// A detection before contact whose stopping path still arrives, or none at all and an arm that brakes. Those of a panel follow one another, the farthest first.
    struct EarlyAlarm {
        double farthest, chance;
        double before;  ///< chances of those of its panel that come before it
    };

    /// Where a panel is cut: its series and what it is to be multiplied with, the place on [-1, 1], and 1 / half its width
    /// [1/m].
    struct Cut {
        const double* series;
        double factor, place, inverse_half;
    };

    /// Probability of collisions never detected whose force has no bound.
    double unbounded() const { return path_->rests() ? 0 : undetected; }

    KnownTails::At ask(double force) {
        const TailAt at = tail_at(force);
        return known_.add(force, at.probability + unbounded(), at.density);
    }

    TailAt tail_at(double force) {
        const double depth = force / stiffness_;
        TailAt sum{0, 0};
        if (depth >= most_depth_) return sum;
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
        // Those never detected of an arm that comes to rest: their series stand where those panels do.
        for (std::size_t p = 0; p < end_series_.size() / order; ++p) {
            const Panel& panel = panels_[p];
            const double* series = &end_series_[p * order];
            if (end_ - depth >= panel.high) {
                sum.probability += 2 * series[0];
            } else if (end_ - depth > panel.low) {
                const double inverse_half = 2 / (panel.high - panel.low);
                cuts_.push_back(
                    {series, 1.0, (end_ - depth - 0.5 * (panel.low + panel.high)) * inverse_half, inverse_half});
            }
        }
        // What begins to stop before contact does not press hard.
        for (const EarlyPanel& panel : early_panels_) {
            if (panel.most <= depth) continue;
            const double mid = 0.5 * (panel.low + panel.high), inverse_half = 2 / (panel.high - panel.low);
            const EarlyAlarm *const first = early_.data() + panel.first, *const end = early_.data() + panel.after;
            const EarlyAlarm* alarm = std::partition_point(
                first, end, [&](const EarlyAlarm& one) { return one.farthest - depth >= panel.high; });
            sum.probability += 2 * (alarm == end ? panel.chances : alarm->before) * panel.series[0];
            for (; alarm != end && alarm->farthest - depth > panel.low; ++alarm)
                cuts_.push_back(
                    {panel.series, alarm->chance, (alarm->farthest - depth - mid) * inverse_half, inverse_half});
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
            cuts_.push_back({&series_[panel.series_at + slot * order], 1.0,
                             (cut - 0.5 * (panel.low + panel.high)) * inverse_half, inverse_half});
    }

    /// Adds what lies below the cuts.
    void add_cuts(TailAt& to) const {
        T probability = 0.0, density = 0.0;
        for (std::size_t first = 0; first < cuts_.size(); first += lanes) {
            // Lanes beyond the last cut hold it once more, and count for nothing.
            const double* series[lanes];
            T x, factor, inverse_half;
            for (std::size_t lane = 0; lane < lanes; ++lane) {
                const Cut& cut = cuts_[std::min(first + lane, cuts_.size() - 1)];
                series[lane] = cut.series;
                set_lane(x, int(lane), cut.place);
                set_lane(factor, int(lane), first + lane < cuts_.size() ? cut.factor : 0.0);
                set_lane(inverse_half, int(lane), cut.inverse_half);
            }
            T below = 0.0, slope = 0.0, before = 1.0, here = x;
            BUMPSTOP_UNROLL
            for (int r = 0; r < registers; ++r) {
                T degree[lanes];
                for (int lane = 0; lane < lanes; ++lane) degree[lane] = load<T>(series[lane] + r * lanes);
                transpose(degree);
                BUMPSTOP_UNROLL
                for (int i = 0; i < lanes; ++i) {
                    const int l = r * lanes + i;
                    if (l == 0) {
                        below = (x + 1.0) * degree[0];
                        slope = degree[0];
                        continue;
                    }
                    const T after = legendre_factors.rise[l] * x * here - legendre_factors.fall[l] * before;
                    below += (after - before) * degree[i];
                    slope += ((2.0 * l + 1) * here) * degree[i];
                    before = here;
                    here = after;
                }
            }
            // The polynomial may dip below zero where there is next to nothing.
            probability += factor * maximum(below, T(0.0));
            density += factor * inverse_half * slope;
        }
        to.probability += sum_of_lanes(probability);
        to.density += sum_of_lanes(density);
    }

    /// Alarms before contact whose stopping path reaches the body.
    void find_early_alarms() {
        const int ticks = path_->ticks;
        double touching = 0;
        early_.clear();
        early_panels_.clear();
        // At the end of its line the arm may brake into a body that it did not reach before: one that nothing alarmed of.
        const double braking = path_->farthest_braking();
        if (quiet_.alarm_before(ticks) > 0 || path_->brakes()) {
            // By tick: the farthest any stopping path gets that begins there or earlier.
            farthest_yet_.assign(farthest_.begin(), farthest_.begin() + ticks);
            for (int k = 1; k < ticks; ++k)
                farthest_yet_[std::size_t(k)] =
                    std::max(farthest_yet_[std::size_t(k)], farthest_yet_[std::size_t(k) - 1]);
            const std::size_t reached = panels_.size();
            const double alarmed = ticks > 0 ? farthest_yet_.back() : 0;
            this->add_end_panels(edge_.back(), std::max(alarmed, braking), ticks + 1);
            for (const Panel& panel : panels_) {
                EarlyPanel made;
                made.first = early_.size();
                if (panel.tick > ticks && braking > panel.low)
                    early_.push_back({braking, quiet_.silence_before(ticks), 0});
                for (int k = std::min(panel.tick, ticks) - 1; k >= 0; --k) {
                    if (!(farthest_yet_[std::size_t(k)] > panel.low)) break;
                    const double farthest = farthest_[std::size_t(k)];
                    if (!quiet_.armed(k) || !(farthest > panel.low)) continue;
                    early_.push_back({farthest, quiet_.silence_before(k) * quiet_.idle().alarm, 0});
                }
                if (early_.size() == made.first) continue;
                made.after = early_.size();
                made.chances = sort_early_alarms(made.first);
                made.most = early_[made.first].farthest - panel.low;
                made.low = panel.low;
                made.high = panel.high;
                T offset[registers];
                this->weigh_offsets(panel, offset);
                this->find_series(offset, made.series);
                touching += 2 * made.series[0] * made.chances;
                early_panels_.push_back(made);
            }
            panels_.resize(reached);
        }
        harmless_ = std::max(0.0, alarm_before_ + no_contact - touching);
    }

    /// The alarms from `first` on are a panel's. Returns the sum of their chances.
    double sort_early_alarms(std::size_t first) {
        const auto begin = early_.begin() + std::ptrdiff_t(first);
        const auto farther = [](const EarlyAlarm& a, const EarlyAlarm& b) { return a.farthest > b.farthest; };
        if (!std::is_sorted(begin, early_.end(), farther)) std::sort(begin, early_.end(), farther);
        double chances = 0;
        for (auto alarm = begin; alarm != early_.end(); ++alarm) {
            alarm->before = chances;
            chances += alarm->chance;
        }
        return chances;
    }

    /// What is never detected, panel by panel.
    void find_end() {
        end_series_.clear();
        end_ = path_->greatest(this->end_step());
        if (!(undetected > 0)) return;
        end_series_.resize(panels_.size() * order);
        for (std::size_t p = 0; p < panels_.size(); ++p) {
            T row[registers];
            for (int r = 0; r < registers; ++r) row[r] = load<T>(&survived_[p * order + std::size_t(r) * lanes]);
            this->find_series(row, &end_series_[p * order]);
            if (path_->rests()) most_depth_ = std::max(most_depth_, end_ - panels_[p].low);
        }
    }

    void find_moments() {
        double mass = 0, sum = 0;
        most_depth_ = 0;
        find_end();
        auto each = [&](const Panel& panel, auto use) {
            for (int slot = 0; slot < panel.slots; ++slot) {
                const double here = mass_[panel.mass_at + std::size_t(slot)];
                if (here == 0) continue;
                use(&series_[panel.series_at + std::size_t(slot) * order], here,
                    farthest_[std::size_t(panel.tick + slot)]);
            }
        };
        for (const Panel& panel : panels_) {
            const double middle = 0.5 * (panel.low + panel.high);
            double most = panel.low;
            each(panel, [&](const double*, double here, double farthest) {
                sum += here * std::max(0.0, farthest - middle);
                mass += here;
                most = std::max(most, farthest);
            });
            most_depth_ = std::max(most_depth_, most - panel.low);
        }
        for (const EarlyPanel& panel : early_panels_) {
            for (std::size_t i = panel.first; i < panel.after; ++i) mass += 2 * early_[i].chance * panel.series[0];
            most_depth_ = std::max(most_depth_, panel.most);
        }
        const double total = mass + harmless_ + undetected, about = stiffness_ * sum / total;
        PanelMoments<T, order> moments(stiffness_, about, node_, weight_);
        for (const Panel& panel : panels_) {
            moments.begin(panel.low, panel.high);
            each(panel, [&](const double* series, double, double farthest) { moments.add(series, 1.0, farthest); });
            moments.end();
        }
        for (const EarlyPanel& panel : early_panels_) {
            moments.begin(panel.low, panel.high);
            for (std::size_t i = panel.first; i < panel.after; ++i)
                moments.add(panel.series, early_[i].chance, early_[i].farthest);
            moments.end();
        }
        for (std::size_t p = 0; p < end_series_.size() / order; ++p) {
            moments.begin(panels_[p].low, panels_[p].high);
            moments.add(&end_series_[p * order], 1.0, end_);
            moments.end();
        }
        if (!path_->rests()) end_series_.clear();  // no tail counts what has no bound
        moments.add_nothing(harmless_);
        const double offset = moments.first() / total;
        moments_ = {about + offset, std::sqrt(std::max(0.0, moments.second() / total - offset * offset))};
    }

    std::vector<double> farthest_, farthest_yet_;
    std::vector<double> later_mass_;  ///< mass_ of a slot and all later ones of its panel
    std::vector<EarlyPanel> early_panels_;
    std::vector<EarlyAlarm> early_;
    std::vector<Cut> cuts_;
    KnownTails known_;
    double harmless_ = 0;
    double most_depth_ = 0;           ///< how deep any collision is pressed [m]
    double end_ = 0;                  ///< the farthest that the undisturbed motion gets [m]
    std::vector<double> end_series_;  ///< of panels: of collisions never detected, for as long as they are needed
    Moments moments_{};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
