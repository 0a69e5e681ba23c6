// Shapes shared by the binding files.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <memory>
#include <vector>

#include "bumpstop/math/lanes.hpp"

namespace nb = nanobind;

namespace bumpstop::inline BUMPSTOP_TARGET {

using NativeLanes = Lanes<native_lanes>;

// Arrays come in checked, contiguous and of the right dtype: the Python floor sees to that.
using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Tensor = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Counters = nb::ndarray<const std::int64_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// A new numpy array that owns its memory, and a pointer to fill it by.
template <class Scalar>
struct NewArray {
    using Array = nb::ndarray<nb::numpy, Scalar>;
    std::vector<std::size_t> shape;
    std::unique_ptr<Scalar[]> data;

    explicit NewArray(std::vector<std::size_t> dimensions) : shape(std::move(dimensions)) {
        std::size_t size = 1;
        for (std::size_t n : shape) size *= n;
        data.reset(new Scalar[size]());
    }
    Array release() {
        Scalar* raw = data.release();
        nb::capsule owner(raw, [](void* p) noexcept { delete[] static_cast<Scalar*>(p); });
        return Array(raw, shape.size(), shape.data(), owner);
    }
};

// What a member vector holds, for as long as Python has its object: nanobind ties a property's array to that.
template <class Scalar>
using View = nb::ndarray<nb::numpy, const Scalar>;
template <class Scalar>
View<Scalar> view(const Scalar* data, std::vector<std::size_t> shape) {
    static constexpr Scalar none{};  // an empty vector may be nowhere
    return View<Scalar>(data != nullptr ? data : &none, shape.size(), shape.data(), nb::handle());
}
template <class Scalar>
View<Scalar> view(const std::vector<Scalar>& values) {
    return view(values.data(), {values.size()});
}

// A member array with a number for each joint; as many as the chain has joints are written.
template <class Of, auto Member>
View<double> by_joint(const Of& self) {
    return view((self.*Member).data(), {(self.*Member).size()});
}
template <class Of, auto Member>
void set_by_joint(Of& self, Vector values) {
    std::copy_n(values.data(), values.shape(0), (self.*Member).begin());
}

inline NewArray<double>::Array array_of(const std::vector<double>& values, std::vector<std::size_t> shape) {
    NewArray<double> array(std::move(shape));
    std::copy(values.begin(), values.end(), array.data.get());
    return array.release();
}

// A register of rows, from `first` on, by columns. Past the end the last row is repeated.
inline void load_rows(Matrix rows, std::size_t first, NativeLanes* column) {
    const std::size_t n = rows.shape(0), width = rows.shape(1);
    const double* row[native_lanes];
    for (int lane = 0; lane < native_lanes; ++lane) row[lane] = rows.data() + std::min(first + lane, n - 1) * width;
    for (std::size_t j = 0; j < width; ++j)
        for (int lane = 0; lane < native_lanes; ++lane) set_lane(column[j], lane, row[lane][j]);
}
// The first `count` lanes into rows of `width` numbers.
inline void store_rows(const NativeLanes* column, int width, std::size_t first, int count, double* rows) {
    for (int lane = 0; lane < count; ++lane)
        for (int j = 0; j < width; ++j) rows[(first + lane) * std::size_t(width) + j] = column[j][lane];
}

void bind_math(nb::module_& module);
void bind_model(nb::module_& module);
void bind_dynamics(nb::module_& module);
void bind_signal(nb::module_& module);
void bind_joint(nb::module_& module);
void bind_detection(nb::module_& module);
void bind_detector_settings(nb::module_& module);
void bind_sensitivity(nb::module_& module);
void bind_workspace(nb::module_& module);
void bind_contact(nb::module_& module);
void bind_deceleration(nb::module_& module);
void bind_setup(nb::module_& module);
void bind_distribution(nb::module_& module);
void bind_collision(nb::module_& module);
void bind_batch(nb::module_& module);
void bind_trajectory(nb::module_& module);

}  // namespace bumpstop::inline BUMPSTOP_TARGET
