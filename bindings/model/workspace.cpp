// What a study of the workspace asks of poses: self-collision, and singular values of some columns.
#include "bumpstop/model/singular_values.hpp"
#include "bumpstop/study/capsules.hpp"
#include "model/registers.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

NewArray<bool>::Array self_collisions(const Chain& chain, Matrix q, int tip_link, Vector tip_point, double radius) {
    NewArray<bool> out({q.shape(0)});
    {
        nb::gil_scoped_release unlocked;
        const LinkPoint tip = link_point(chain, tip_link, {tip_point(0), tip_point(1), tip_point(2)});
        for_postures(chain, q, [&](std::size_t first, int count, const Posture<L>& posture) {
            const L hit = select(self_collision(chain, posture, tip, radius), L(1.0), L(0.0));
            for (int lane = 0; lane < count; ++lane) out.data[first + lane] = lane_of(hit, lane) > 0.5;
        });
    }
    return out.release();
}

NewArray<double>::Array segment_distances(Matrix p, Matrix p_end, Matrix r, Matrix r_end) {
    NewArray<double> out({p.shape(0)});
    const auto point = [](Matrix rows, std::size_t i) { return Point3<double>{rows(i, 0), rows(i, 1), rows(i, 2)}; };
    for (std::size_t i = 0; i < p.shape(0); ++i)
        out.data[i] = segment_distance(point(p, i), point(p_end, i), point(r, i), point(r_end, i));
    return out.release();
}

template <int Rows>
NewArray<double>::Array singular_values_of_columns(const Chain& chain, Matrix q, int link, Vector point,
                                                   const std::vector<int>& columns) {
    NewArray<double> out({q.shape(0), std::size_t(Rows)});
    {
        nb::gil_scoped_release unlocked;
        const LinkPoint place = link_point(chain, link, {point(0), point(1), point(2)});
        for_postures(chain, q, [&](std::size_t first, int count, const Posture<L>& posture) {
            L values[Rows];
            singular_values<Rows>(chain, posture, place, columns.data(), int(columns.size()), values);
            store_rows(values, Rows, first, count, out.data.get());
        });
    }
    return out.release();
}

}  // namespace

void bind_workspace(nb::module_& module) {
    module.def("self_collisions", &self_collisions, nb::arg("chain"), nb::arg("q"), nb::arg("tip_link"),
               nb::arg("tip_point"), nb::arg("radius"), "Whether two links touch (N,), for poses (N, dof).");
    module.def("segment_distances", &segment_distances, nb::arg("p"), nb::arg("p_end"), nb::arg("r"), nb::arg("r_end"),
               "Shortest distances (N,) between segments, all ends (N, 3).");
    const auto values = [](const Chain& chain, Matrix q, int link, Vector point, const std::vector<int>& columns,
                           bool angular) {
        return angular ? singular_values_of_columns<6>(chain, q, link, point, columns)
                       : singular_values_of_columns<3>(chain, q, link, point, columns);
    };
    module.def("singular_values_of_columns", values, nb::arg("chain"), nb::arg("q"), nb::arg("link"), nb::arg("point"),
               nb::arg("columns"), nb::arg("angular"),
               "Singular values (N, 3) or (N, 6) of some columns of the Jacobian, largest first.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
