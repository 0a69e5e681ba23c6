/// @file
/// Reads the fitted dynamics of a detector's file.
#pragma once

#include <optional>

#include "bumpstop/detection/fitted_dynamics.hpp"
#include "bumpstop/model/description_text.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET::detail {

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

}  // namespace bumpstop::inline BUMPSTOP_TARGET::detail
