/// @file
/// Monte Carlo: single collisions with random offsets and noise, on a stopping curve.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <optional>

#include "bumpstop/collision/contact/contact.hpp"
#include "bumpstop/collision/contact/contact_collision.hpp"
#include "bumpstop/collision/contact/elastic_arm.hpp"
#include "bumpstop/collision/contact/reaction_paths.hpp"
#include "bumpstop/detection/gaussian_thresholds.hpp"
#include "bumpstop/detection/residual_record.hpp"
#include "bumpstop/math/philox.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Which runs, and what is kept of them.
struct MonteCarloSettings {
    std::uint64_t seed = 0;
    std::int64_t first = 0, count = 0;  ///< number of the first run, and how many there are
    int threads = 1;
    bool noise = true;  ///< noise and residual at the tick of detection are kept
};

/// The runs' results, one entry a run; noise and residual are run-major, dof wide.
struct MonteCarloRuns {
    std::vector<double> offset;              ///< [m]
    std::vector<std::int32_t> tick;          ///< of detection; -1: never
    std::vector<std::uint32_t> triggers;     ///< bit j: joint j over its threshold at that tick
    std::vector<double> noise;               ///< at that tick [Nm or N]; zero when never; empty where it is not kept
    std::vector<double> residual;            ///< noise and contact torque
    std::vector<double> peak_force;          ///< of dynamic contact [N]; else empty, as are the next three
    std::vector<double> lasting_force;       ///< after the transient phase [N]
    std::vector<double> duration;            ///< [s]
    std::vector<double> force_at_detection;  ///< [N]; zero when never, or before contact
    int dof;

    MonteCarloRuns(const MonteCarloSettings& settings, int joints, bool gives_way)
        : offset(std::size_t(settings.count)),
          tick(offset.size()),
          triggers(offset.size()),
          noise(settings.noise ? offset.size() * std::size_t(joints) : 0),
          residual(noise.size()),
          peak_force(gives_way ? offset.size() : 0),
          lasting_force(peak_force.size()),
          duration(peak_force.size()),
          force_at_detection(peak_force.size()),
          dof(joints) {}
};

/// Offset of a run, from a random stream of its own.
template <class T>
T draw_offset(const OffsetDistribution& offset, std::uint64_t seed, IntOf<T> run) {
    const PhiloxBlock<IntOf<T>> block = noise_block(seed, run, offset_tick, 0);
    const SignedProbability<T> draw = signed_probability<T>(block, 0);
    if (offset.kind == OffsetKind::fixed) return offset.size;
    // The half-normal is truncated where the integrated distribution truncates it.
    if (offset.kind == OffsetKind::half_normal)
        return min(normal_upper_quantile(draw.p) * offset.size, T(offset.largest()));
    return 2.0 * draw.p * offset.size;
}

/// The run number of every lane.
template <class T>
IntOf<T> run_lanes(const std::int64_t* run) {
    if constexpr (Scalar<T>::lanes == 1) {
        return run[0];
    } else {
        IntOf<T> r;
        for (int lane = 0; lane < Scalar<T>::lanes; ++lane) r.v[lane] = run[lane];
        return r;
    }
}

template <class T>
class MonteCarlo {
  public:
    /// `paths` and `propagator`: for dynamic contact.
    MonteCarlo(const CollisionSetup& setup, const StoppingCurve& curve, const GaussianThresholds& detector,
               const Contact& contact, const MonteCarloSettings& settings, const ResidualRecord* record = nullptr,
               const ContactPaths* paths = nullptr, const ContactPropagator* propagator = nullptr)
        : curve_(curve),
          detector_(detector),
          stiffness_(contact.body.stiffness),
          offset_(contact.offset),
          seed_(settings.seed),
          first_run_(settings.first),
          record_(record) {
        if (paths != nullptr) reactions_.emplace(*paths, *propagator);
        const int ticks = curve.path.ticks;
        s_.resize(ticks);
        for (int k = 0; k < ticks; ++k) s_[k] = curve.path.at_tick(k, setup.timing.period);
        while (first_armed_ < ticks && !detector.armed(setup.tick_time(first_armed_))) ++first_armed_;
        for (int w = 0; w < detector.monitored; ++w) {
            pair_[w] = detector.joint[w] / 2;
            half_[w] = detector.joint[w] % 2;
            const double threshold = detector.threshold[w], mean = detector.mean[w], scale = detector.scale[w];
            means_within_ = means_within_ && std::fabs(mean) < threshold;
            upper_[w] = 0.5 * erfc((threshold - mean) * scale);
            lower_[w] = 0.5 * erfc((threshold + mean) * scale);
        }
    }

    /// Simulates the runs [first, last) of `out`.
    void run(std::int64_t first, std::int64_t last, MonteCarloRuns& out) const {
        constexpr std::int64_t block = 4096;
        std::vector<std::int64_t> order;
        for (std::int64_t begin = first; begin < last; begin += block) {
            const std::int64_t end = std::min(last, begin + block);
            for (std::int64_t i = begin; i < end; i += lanes) {
                std::int64_t number[lanes];
                for (int lane = 0; lane < lanes; ++lane) number[lane] = first_run_ + std::min(i + lane, end - 1);
                const T o = draw_offset<T>(offset_, seed_, run_lanes<T>(number));
                for (int lane = 0; lane < lanes && i + lane < end; ++lane) out.offset[i + lane] = lane_of(o, lane);
            }
            // Runs with similar offsets share a register, because they are detected at about the same tick. A counting
            // sort into bins of offset is order enough.
            constexpr int bins = 512;
            std::array<std::int64_t, bins + 1> start{};
            const double scale = offset_.largest() > 0 ? (bins - 1) / offset_.largest() : 0;
            auto bin = [&](std::int64_t i) { return std::size_t(out.offset[i] * scale); };
            for (std::int64_t i = begin; i < end; ++i) ++start[bin(i) + 1];
            for (int b = 0; b < bins; ++b) start[b + 1] += start[b];
            order.resize(std::size_t(end - begin));
            for (std::int64_t i = begin; i < end; ++i) order[std::size_t(start[bin(i)]++)] = i;
            for (std::size_t i = 0; i < order.size(); i += lanes) {
                allow_interruption();
                std::int64_t index[lanes];
                const int used = int(std::min<std::size_t>(lanes, order.size() - i));
                for (int lane = 0; lane < lanes; ++lane) index[lane] = order[i + std::min(lane, used - 1)];
                simulate(index, used, out);
            }
        }
    }

  private:
    static constexpr int lanes = Scalar<T>::lanes;
    static constexpr int many_ticks = 1024;            ///< an interruption is allowed after so many
    static constexpr double beyond_four_sd = 3.17e-5;  ///< a little more than P(Z > 4) = 3.167e-5

    void simulate(const std::int64_t* index, int used, MonteCarloRuns& out) const {
        std::int64_t number[lanes];
        T offset;
        bool open[lanes];
        for (int lane = 0; lane < lanes; ++lane) {
            number[lane] = first_run_ + index[lane];
            set_lane(offset, lane, out.offset[index[lane]]);
            open[lane] = lane < used;
            if (!open[lane]) continue;
            out.tick[index[lane]] = -1;
            out.triggers[index[lane]] = 0;
        }
        const IntOf<T> runs = run_lanes<T>(number);
        if (reactions_) {
            int touch[lanes];
            for (int lane = 0; lane < lanes; ++lane) touch[lane] = first_beyond(lane_of(offset, lane));
            std::vector<ContactCollision> collision;
            for (int lane = 0; lane < used; ++lane)
                collision.emplace_back(*reactions_, touch[lane], lane_of(offset, lane));
            tick_by_tick(number, runs, offset, open, index, used, out, touch, collision.data());
            for (int lane = 0; lane < used; ++lane)
                record_outcome(collision[std::size_t(lane)], touch[lane], index[lane], out);
            return;
        }
        if (record_ != nullptr || detector_.correlated_noise()) {
            tick_by_tick(number, runs, offset, open, index, used, out, nullptr, nullptr);
            return;
        }
        int remaining = used;
        const int dof = curve_.path.dof;
        for (int k = first_armed_; k < curve_.path.ticks && remaining > 0; ++k) {
            if (k % many_ticks == 0) allow_interruption();
            const T force = max(s_[k] - offset, T(0.0)) * stiffness_;
            const bool contact = any(force > T(0.0));
            auto fired = mask_of<T>(false);
            MaskOf<T> over[max_joints];
            T noise[max_joints], residual[max_joints];
            PhiloxBlock<IntOf<T>> block{};
            int last_pair = -1;
            for (int w = 0; w < detector_.monitored; ++w) {
                if (pair_[w] != last_pair) {
                    last_pair = pair_[w];
                    block = noise_block(seed_, runs, k, last_pair);
                }
                const SignedProbability<T> draw = signed_probability<T>(block, half_[w]);
                if (contact || !means_within_) {
                    const double a = curve_.path.torque_per_N[std::size_t(k) * dof + detector_.joint[w]];
                    // Four standard deviations below the threshold only draws beyond four can alarm. Most joints are
                    // that far from theirs at most ticks, and their quantiles need not be computed.
                    const auto far =
                        abs(a * force + detector_.mean[w]) < T(detector_.threshold[w] - 4 * detector_.sd[w]);
                    if (all(far & (draw.p > T(beyond_four_sd)))) {
                        over[w] = mask_of<T>(false);
                        continue;
                    }
                    noise[w] = draw.normal() * detector_.sd[w] + detector_.mean[w];
                    residual[w] = noise[w] + a * force;
                    over[w] = abs(residual[w]) > T(detector_.threshold[w]);
                } else {
                    // Without contact the draw is compared with the probability of an alarm, without its quantile.
                    over[w] = draw.p < select(draw.negative, T(lower_[w]), T(upper_[w]));
                }
                fired = fired | over[w];
            }
            if (!any(fired)) continue;
            for (int lane = 0; lane < used; ++lane) {
                if (record_detection(k, lane, fired, over, open, index, out)) --remaining;
            }
        }
        if (!out.noise.empty()) record_noise(index, used, out);
    }

    /// Records a detection at tick k in a lane that is still open, if some joint has `fired`, by the joints that are
    /// `over`. Returns whether there is one.
    bool record_detection(int k, int lane, const MaskOf<T>& fired, const MaskOf<T>* over, bool* open,
                          const std::int64_t* index, MonteCarloRuns& out) const {
        if (!open[lane] || !lane_of(fired, lane)) return false;
        open[lane] = false;
        const std::int64_t i = index[lane];
        out.tick[i] = k;
        for (int w = 0; w < detector_.monitored; ++w)
            if (lane_of(over[w], lane)) out.triggers[i] |= 1u << detector_.joint[w];
        return true;
    }

    /// The first tick at which the arm is beyond an offset; the number of ticks if there is none.
    int first_beyond(double offset) const {
        return int(std::find_if(s_.begin(), s_.end(), [&](double s) { return s > offset; }) - s_.begin());
    }

    void record_outcome(ContactCollision& collision, int touch, std::int64_t i, MonteCarloRuns& out) const {
        const bool known = out.tick[i] >= 0;
        const int since = out.tick[i] - touch;
        const ContactCollision::Outcome outcome = known ? collision.detected(since) : collision.undetected();
        out.peak_force[i] = outcome.peak;
        out.lasting_force[i] = outcome.lasting;
        out.duration[i] = outcome.duration;
        out.force_at_detection[i] = known ? collision.force(since) : 0.0;
    }

    /// Runs whose noise or noiseless residual depends on the ticks before, so that every tick is simulated. In dynamic
    /// contact `touch` is the first tick in contact of every lane.
    void tick_by_tick(const std::int64_t* number, IntOf<T> runs, T offset, bool* open, const std::int64_t* index,
                      int used, MonteCarloRuns& out, const int* touch, ContactCollision* collision) const {
        const int dof = curve_.path.dof;
        const double innovation = std::sqrt((1 - detector_.correlation) * (1 + detector_.correlation));
        T noise[max_joints];  // by joint, monitored or not
        NoiselessResidual<T> contact[max_joints];
        int remaining = used;
        for (int k = 0; k < curve_.path.ticks && remaining > 0; ++k) {
            if (k % many_ticks == 0) allow_interruption();
            T torque[max_joints];
            if (collision == nullptr) {
                const T force = max(s_[k] - offset, T(0.0)) * stiffness_;
                for (int j = 0; j < dof; ++j) torque[j] = curve_.path.torque_per_N[std::size_t(k) * dof + j] * force;
            } else {
                for (int j = 0; j < dof; ++j) torque[j] = 0.0;
                for (int lane = 0; lane < lanes; ++lane) {
                    const int i = k - touch[lane];
                    if (i < 0 || !open[lane]) continue;
                    // Once the body has separated it is not detected.
                    if (collision[lane].separated(i)) {
                        open[lane] = false;
                        --remaining;
                        continue;
                    }
                    const bool elastic = reactions_->elastic();
                    for (int j = 0; j < dof; ++j)
                        set_lane(torque[j], lane,
                                 elastic
                                     ? collision[lane].residual(i, j)
                                     : curve_.path.torque_per_N[std::size_t(k) * dof + j] * collision[lane].force(i));
                }
            }
            for (int j = 0; j < dof; ++j) detector_.advance(contact[j], torque[j]);
            if (k < first_armed_) continue;
            if (record_ != nullptr) {
                for (int lane = 0; lane < used; ++lane) {
                    const double* row = &record_->row[std::size_t(record_->row_of(seed_, number[lane], k) * dof)];
                    for (int j = 0; j < dof; ++j) set_lane(noise[j], lane, row[j] + detector_.noise_mean[j]);
                }
            } else {
                PhiloxBlock<IntOf<T>> block{};
                for (int j = 0; j < dof; ++j) {
                    if (j % 2 == 0) block = noise_block(seed_, runs, k, j / 2);
                    const T white = signed_probability<T>(block, j % 2).normal() * detector_.noise_sd[j];
                    const double mean = detector_.noise_mean[j];
                    noise[j] = k == first_armed_
                                   ? white + mean
                                   : detector_.correlation * (noise[j] - mean) + innovation * white + mean;
                }
            }
            MaskOf<T> fired = mask_of<T>(false), over[max_joints];
            for (int w = 0; w < detector_.monitored; ++w) {
                const int j = detector_.joint[w];
                over[w] = abs(noise[j] + contact[j].value) > T(detector_.threshold[w]);
                fired = fired | over[w];
            }
            if (!any(fired)) continue;
            for (int lane = 0; lane < used; ++lane) {
                if (!record_detection(k, lane, fired, over, open, index, out)) continue;
                --remaining;
                const std::int64_t i = index[lane];
                for (int j = 0; !out.noise.empty() && j < dof; ++j) {
                    out.noise[i * dof + j] = lane_of(noise[j], lane);
                    out.residual[i * dof + j] = lane_of(noise[j], lane) + lane_of(contact[j].value, lane);
                }
            }
        }
        for (int lane = 0; !out.noise.empty() && lane < used; ++lane) {
            for (int j = 0; out.tick[index[lane]] < 0 && j < dof; ++j)
                out.noise[index[lane] * dof + j] = out.residual[index[lane] * dof + j] = 0;
        }
    }

    /// Records noise and residual of all joints at the tick of detection, monitored or not.
    void record_noise(const std::int64_t* index, int used, MonteCarloRuns& out) const {
        const int dof = curve_.path.dof;
        for (int lane = 0; lane < used; ++lane) {
            const std::int64_t i = index[lane];
            const int k = out.tick[i];
            double* noise = &out.noise[std::size_t(i * dof)];
            double* residual = &out.residual[std::size_t(i * dof)];
            for (int j = 0; j < dof; ++j) noise[j] = residual[j] = 0;
            if (k < 0) continue;
            const double force = std::max(0.0, s_[k] - out.offset[i]) * stiffness_;
            for (int j = 0; j < dof; ++j) {
                const auto block = noise_block<std::int64_t>(seed_, first_run_ + i, k, j / 2);
                noise[j] =
                    signed_probability<double>(block, j % 2).normal() * detector_.noise_sd[j] + detector_.noise_mean[j];
            }
            for (int j = 0; j < dof; ++j)
                residual[j] = noise[j] + curve_.path.torque_per_N[std::size_t(k) * dof + j] * force;
        }
    }

    const StoppingCurve& curve_;
    const GaussianThresholds& detector_;
    double stiffness_;
    OffsetDistribution offset_;
    std::uint64_t seed_;
    std::int64_t first_run_;
    const ResidualRecord* record_;               ///< measured noise instead of Gaussian; may be null
    std::optional<ContactReactions> reactions_;  ///< of dynamic contact
    std::vector<double> s_;
    int first_armed_ = 0;
    bool means_within_ = true;  ///< every noise mean lies within its thresholds
    /// By monitored joint: two joints share a block of random numbers, of which each has a half.
    int pair_[max_joints] = {}, half_[max_joints] = {};
    double upper_[max_joints] = {}, lower_[max_joints] = {};  ///< probabilities beyond +- threshold without contact
};

/// Runs on a stopping curve. `record`: measured noise instead of Gaussian.
template <class T>
MonteCarloRuns monte_carlo(const CollisionSetup& setup, const StoppingCurve& curve, const GaussianThresholds& detector,
                           const Contact& contact, const MonteCarloSettings& settings,
                           const ResidualRecord* record = nullptr) {
    const std::optional<ContactPropagator> by = contact_propagator(setup, curve.path, contact);
    MonteCarloRuns out(settings, setup.chain.dof, by.has_value());
    const ContactPaths paths = by ? contact_paths<T>(setup, curve, *by, contact.offset.largest()) : ContactPaths{};
    const MonteCarlo<T> runs(setup, curve, detector, contact, settings, record, by ? &paths : nullptr,
                             by ? &*by : nullptr);
    // Whole blocks of runs go to threads: a run's numbers depend on its own number alone.
    constexpr std::int64_t block = 1 << 16;
    std::atomic<std::int64_t> next{0};
    work_in_threads(settings.threads, [&] {
        for (std::int64_t begin = block * next++; begin < settings.count; begin = block * next++)
            runs.run(begin, std::min(begin + block, settings.count), out);
    });
    return out;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
