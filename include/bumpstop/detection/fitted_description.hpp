/// @file
/// The lines of a detector's file that fitted dynamics have.
#pragma once

#include <optional>
#include <utility>

#include "bumpstop/detection/fitted_dynamics.hpp"
#include "bumpstop/model/robot_description.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET::detail {

/// Reads them one by one: the gains, the joints that `all` predicts, links and motors of each set in order, and, behind
/// the motors, travels over which their friction builds up, which there need not be.
class FittedReader {
  public:
    explicit FittedReader(int joints) : joints_(joints) {}

    /// False where a line is none of these, or comes too often.
    bool read(DescriptionLine& line) {
        begun_ = true;
        const std::string key = line.keyword;
        if (key == "fitted_gain") return once(gains_) && line.finite_numbers(fitted_.gain.data(), joints_);
        if (key == "fitted_by_all") {
            double bits = 0;
            if (!once(chosen_) || !line.finite_numbers(&bits, 1)) return false;
            if (!(bits >= 0 && bits < std::ldexp(1.0, joints_) && bits == std::floor(bits))) return false;
            fitted_.by_all = std::uint32_t(bits);
            return true;
        }
        if (key == "fitted_presliding") return once(slides_) && motors_[0] == motors_[1] && read_presliding(line);
        std::string set;
        if (!line.word(set) || (set != "all" && set != "essential")) return false;
        const int number = set == "all" ? 0 : 1;
        FittedParameters& own = number == 0 ? fitted_.all : fitted_.essential;
        if (key == "fitted_link") {
            if (links_[number] == joints_) return false;
            LinkInertia& link = own.link[links_[number]++];
            return line.finite_numbers(&link.mass, 1) && line.finite_numbers(link.center.data(), 3) &&
                   line.finite_numbers(link.tensor.data(), 9);
        }
        // Travels are those of the motors before them.
        if (key != "fitted_motor" || slides_ || motors_[number] == FittedParameters::max_motors) return false;
        return read_motor(line, own.motor[motors_[number]++]);
    }
    /// Everything or nothing has come.
    bool complete() const {
        return !begun_ || (gains_ && chosen_ && links_[0] == joints_ && links_[1] == joints_ &&
                           motors_[0] == motors_[1] && motors_[0] >= joints_);
    }
    /// The dynamics, or none where no line has come.
    std::optional<FittedDynamics> found() {
        if (!begun_) return std::nullopt;
        fitted_.motors = motors_[0];
        return fitted_;
    }

  private:
    bool read_motor(DescriptionLine& line, FittedMotor& motor) {
        double v[6];
        if (!line.finite_numbers(v, 6) || !(v[0] > 0) || !line.numbers(&motor.top_speed, 1) || !(motor.top_speed > 0))
            return false;
        motor.sign_speed = v[0];
        motor.coulomb = v[1];
        motor.viscous = v[2];
        motor.rotor = v[3];
        motor.offset = v[4];
        motor.bend = v[5];
        return line.finite_numbers(&motor.load, 1) && line.finite_numbers(motor.share.data(), joints_);
    }
    /// One for each motor, 0 or above.
    bool read_presliding(DescriptionLine& line) {
        double travel[FittedParameters::max_motors];
        if (motors_[0] == 0 || !line.finite_numbers(travel, motors_[0])) return false;
        for (int m = 0; m < motors_[0]; ++m) {
            if (!(travel[m] >= 0)) return false;
            fitted_.all.motor[m].presliding = fitted_.essential.motor[m].presliding = travel[m];
        }
        return true;
    }
    static bool once(bool& seen) { return !std::exchange(seen, true); }

    int joints_;
    FittedDynamics fitted_;
    bool begun_ = false, gains_ = false, chosen_ = false, slides_ = false;
    int links_[2] = {}, motors_[2] = {};
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET::detail
