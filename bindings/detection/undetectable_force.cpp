// Forces that no threshold detects.
#include "bumpstop/detection/undetectable_force.hpp"

#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

std::vector<ResidualBand> make_bands(Vector low, Vector high) {
    std::vector<ResidualBand> band(low.shape(0));
    for (std::size_t j = 0; j < band.size(); ++j) band[j] = {low(j), high(j)};
    return band;
}

void load_columns(Tensor jacobian, std::size_t pose, std::size_t joints, Point3<double>* column) {
    for (std::size_t j = 0; j < joints; ++j)
        column[j] = {jacobian(pose, 0, j), jacobian(pose, 1, j), jacobian(pose, 2, j)};
}

nb::tuple undetectable_forces(Tensor jacobian, Vector low, Vector high) {
    const std::size_t n = jacobian.shape(0), joints = jacobian.shape(2);
    NewArray<double> largest({n}), detectable({n}), largest_vector({n, 3}), singular({n, 3}), axes({n, 3, 3});
    NewArray<std::int64_t> rank({n});
    {
        nb::gil_scoped_release unlocked;
        const std::vector<ResidualBand> band = make_bands(low, high);
        for (std::size_t i = 0; i < n; ++i) {
            Point3<double> column[max_joints];
            load_columns(jacobian, i, joints, column);
            const UndetectableForce force = undetectable_force(column, band.data(), int(joints));
            largest.data[i] = force.largest;
            detectable.data[i] = force.largest_detectable;
            rank.data[i] = force.rank;
            for (std::size_t k = 0; k < 3; ++k) {
                largest_vector.data[3 * i + k] = force.largest_vector[k];
                singular.data[3 * i + k] = force.singular[k];
                for (std::size_t c = 0; c < 3; ++c) axes.data[9 * i + 3 * k + c] = force.axis[k][c];
            }
        }
    }
    return nb::make_tuple(largest.release(), detectable.release(), largest_vector.release(), singular.release(),
                          rank.release(), axes.release());
}

NewArray<double>::Array undetectable_forces_along(Tensor jacobian, Vector low, Vector high, Matrix direction) {
    const std::size_t n = jacobian.shape(0), joints = jacobian.shape(2);
    NewArray<double> out({n});
    {
        nb::gil_scoped_release unlocked;
        const std::vector<ResidualBand> band = make_bands(low, high);
        for (std::size_t i = 0; i < n; ++i) {
            Point3<double> column[max_joints];
            load_columns(jacobian, i, joints, column);
            out.data[i] = undetectable_force_along(column, band.data(), int(joints),
                                                   {direction(i, 0), direction(i, 1), direction(i, 2)});
        }
    }
    return out.release();
}

}  // namespace

void bind_sensitivity(nb::module_& module) {
    module.def("undetectable_forces", &undetectable_forces, nb::arg("jacobian"), nb::arg("low"), nb::arg("high"),
               "Largest force (N,), the same that is detectable (N,), its vector (N, 3), singular values (N, 3), rank "
               "(N,) and "
               "axes (N, 3, 3) from linear Jacobians (N, 3, dof).");
    module.def("undetectable_forces_along", &undetectable_forces_along, nb::arg("jacobian"), nb::arg("low"),
               nb::arg("high"), nb::arg("direction"), "Largest forces (N,) along `direction` (N, 3).");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
