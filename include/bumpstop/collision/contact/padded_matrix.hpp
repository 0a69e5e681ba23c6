/// @file
/// Small matrices that are multiplied by many vectors.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "bumpstop/math/lanes.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace detail {

/// Adds `registers` registers of rows of M x to y. If they are few, partial sums of each hide the latency of additions.
template <int registers>
void multiply_add_registers(const double* column, int stride, int columns, const double* x, double* y) {
    using Native = Lanes<native_lanes>;
    constexpr int sums = registers <= 2 ? 4 : registers <= 4 ? 2 : 1;
    Native sum[sums][registers];
    for (int n = 0; n < sums; ++n)
        for (int r = 0; r < registers; ++r) sum[n][r] = n == 0 ? Native::load(y + r * native_lanes) : Native(0.0);
    int j = 0;
    for (; j + sums <= columns; j += sums)
        for (int n = 0; n < sums; ++n)
            for (int r = 0; r < registers; ++r)
                sum[n][r] =
                    fused(Native::load(column + (j + n) * stride + r * native_lanes), Native(x[j + n]), sum[n][r]);
    for (; j < columns; ++j)
        for (int r = 0; r < registers; ++r)
            sum[0][r] = fused(Native::load(column + j * stride + r * native_lanes), Native(x[j]), sum[0][r]);
    for (int r = 0; r < registers; ++r) {
        for (int n = 1; n < sums; ++n) sum[0][r] += sum[n][r];
        sum[0][r].store(y + r * native_lanes);
    }
}

/// Adds M x to y, for a matrix of `columns` stored one after the other, each of `stride` values, of which some may be
/// padding: whole registers of rows.
inline void multiply_add(const double* column, int stride, int columns, const double* x, double* y) {
    constexpr int most = 8;
    for (int i = 0; i < stride; i += most * native_lanes) {
        const auto add = [&]<int... n>(std::integer_sequence<int, n...>) {
            const int registers = std::min(most, (stride - i) / native_lanes);
            ((registers == n + 1 ? multiply_add_registers<n + 1>(column + i, stride, columns, x, y + i) : void()), ...);
        };
        add(std::make_integer_sequence<int, most>());
    }
}

/// A matrix in the layout of `multiply_add`: columns padded with zeros.
class PaddedMatrix {
  public:
    static constexpr int padding = 8;
    static constexpr int padded(int rows) { return (rows + padding - 1) / padding * padding; }

    PaddedMatrix() = default;
    PaddedMatrix(int rows, int columns)
        : stride_(padded(rows)), columns_(columns), column_(std::size_t(stride_ * columns), 0.0) {}
    double& operator()(int i, int j) { return column_[std::size_t(j * stride_ + i)]; }
    double operator()(int i, int j) const { return column_[std::size_t(j * stride_ + i)]; }
    /// Padding included.
    int rows() const { return stride_; }
    int columns() const { return columns_; }
    /// Adds M x to y, of length `rows`.
    void add(const double* x, double* y) const { multiply_add(column_.data(), stride_, columns_, x, y); }

    friend PaddedMatrix operator*(const PaddedMatrix& a, const PaddedMatrix& b) {
        PaddedMatrix product(a.stride_, b.columns_);
        for (int j = 0; j < b.columns_; ++j)
            a.add(&b.column_[std::size_t(j * b.stride_)], &product.column_[std::size_t(j * a.stride_)]);
        return product;
    }
    friend PaddedMatrix operator+(PaddedMatrix a, const PaddedMatrix& b) {
        for (std::size_t i = 0; i < a.column_.size(); ++i) a.column_[i] += b.column_[i];
        return a;
    }
    friend PaddedMatrix operator*(double f, PaddedMatrix a) {
        for (double& value : a.column_) value *= f;
        return a;
    }
    PaddedMatrix transposed() const {
        PaddedMatrix turned(columns_, columns_);
        for (int j = 0; j < columns_; ++j)
            for (int i = 0; i < columns_; ++i) turned(j, i) = (*this)(i, j);
        return turned;
    }
    /// 1-norm: the greatest sum of a column's magnitudes.
    double norm() const {
        double most = 0;
        for (int j = 0; j < columns_; ++j) {
            double sum = 0;
            for (int i = 0; i < stride_; ++i) sum += std::fabs((*this)(i, j));
            most = std::max(most, sum);
        }
        return most;
    }

  private:
    int stride_ = 0, columns_ = 0;
    std::vector<double> column_;
};

}  // namespace detail

}  // namespace bumpstop::inline BUMPSTOP_TARGET
