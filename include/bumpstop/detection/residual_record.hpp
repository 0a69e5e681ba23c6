/// @file
/// Measured residuals from which Monte Carlo runs draw their noise.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "bumpstop/math/philox.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

/// Measured residuals of free motion. A block bootstrap keeps their correlation between joints and in time: a run
/// consists of blocks of consecutive rows, each from a random row on; the first block is entered at a random place. The
/// first row follows the last, so that all rows are drawn alike.
struct ResidualRecord {
    std::vector<double> row;  ///< [row][dof], at the feedback rate [Nm or N]
    std::int64_t rows = 0;
    std::int64_t block = 1;  ///< rows in a block, at most `rows`

    /// The row used at tick k of a run.
    std::int64_t row_of(std::uint64_t seed, std::int64_t run, std::int64_t k) const {
        const std::int64_t place = k + number_below(seed, run, 0, block);
        const std::int64_t first = number_below(seed, run, 1 + place / block, rows);
        return (first + place % block) % rows;
    }

  private:
    static std::int64_t number_below(std::uint64_t seed, std::int64_t run, std::int64_t draw, std::int64_t bound) {
        const SignedProbability<double> u =
            signed_probability<double>(noise_block<std::int64_t>(seed, run, block_tick, int(draw)), 0);
        return std::min(std::int64_t((u.negative ? 1 - u.p : u.p) * double(bound)), bound - 1);
    }
};

}  // namespace bumpstop::inline BUMPSTOP_TARGET
