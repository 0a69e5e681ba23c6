// Chains and their kinematics.
#include "bumpstop/model/kinematics.hpp"
#include "model/registers.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

namespace {

using L = NativeLanes;

Chain make_chain(const std::vector<bool>& prismatic, Matrix origin, Tensor rotation, Matrix axis) {
    std::vector<JointSpec> specs(prismatic.size());
    for (std::size_t i = 0; i < specs.size(); ++i) {
        specs[i].prismatic = prismatic[i];
        for (int k = 0; k < 3; ++k) {
            specs[i].origin[k] = origin(i, k);
            specs[i].axis[k] = axis(i, k);
            for (int l = 0; l < 3; ++l) specs[i].rotation[3 * k + l] = rotation(i, k, l);
        }
    }
    return Chain(specs);
}

NewArray<double>::Array poses(const Chain& chain, Matrix q, int link, Vector point) {
    NewArray<double> out({q.shape(0), 4, 4});
    {
        nb::gil_scoped_release unlocked;
        const LinkPoint place = link_point(chain, link, {point(0), point(1), point(2)});
        for_postures(chain, q, [&](std::size_t first, int count, const Posture<L>& posture) {
            const Point3<L> p = posture.position(place);
            const Point3<L>&x = posture.frame_x[link], &y = posture.frame_y[link], &z = posture.axis[link];
            const Matrix3& to = chain.joint[link].to_link;
            for (int lane = 0; lane < count; ++lane) {
                double* m = &out.data[(first + lane) * 16];
                const Matrix3 frame{x.x[lane], y.x[lane], z.x[lane], x.y[lane], y.y[lane],
                                    z.y[lane], x.z[lane], y.z[lane], z.z[lane]};
                const Matrix3 rotation = frame * to;
                for (int i = 0; i < 3; ++i)
                    for (int j = 0; j < 3; ++j) m[4 * i + j] = rotation[3 * i + j];
                m[3] = p.x[lane];
                m[7] = p.y[lane];
                m[11] = p.z[lane];
                m[15] = 1;
            }
        });
    }
    return out.release();
}

NewArray<double>::Array jacobians(const Chain& chain, Matrix q, int link, Vector point) {
    const std::size_t dof = std::size_t(chain.dof);
    NewArray<double> out({q.shape(0), 6, dof});
    {
        nb::gil_scoped_release unlocked;
        const LinkPoint place = link_point(chain, link, {point(0), point(1), point(2)});
        for_postures(chain, q, [&](std::size_t first, int count, const Posture<L>& posture) {
            const Point3<L> p = posture.position(place);
            for (int j = 0; j <= link; ++j) {
                const Point3<L> linear = linear_column(chain, posture, p, j);
                const bool turns = !chain.joint[j].prismatic;
                for (int lane = 0; lane < count; ++lane) {
                    double* m = &out.data[(first + lane) * 6 * dof + std::size_t(j)];
                    m[0] = linear.x[lane];
                    m[dof] = linear.y[lane];
                    m[2 * dof] = linear.z[lane];
                    m[3 * dof] = turns ? posture.axis[j].x[lane] : 0;
                    m[4 * dof] = turns ? posture.axis[j].y[lane] : 0;
                    m[5 * dof] = turns ? posture.axis[j].z[lane] : 0;
                }
            }
        });
    }
    return out.release();
}

}  // namespace

void bind_model(nb::module_& module) {
    module.attr("max_joints") = max_joints;
    nb::class_<LinkPoint>(module, "LinkPoint", "A point fixed to a link.").def_ro("link", &LinkPoint::link);
    nb::class_<Chain>(module, "Chain", "A serial chain in computing form.")
        .def(
            "__init__",
            [](Chain* self, const std::vector<bool>& prismatic, Matrix origin, Tensor rotation, Matrix axis) {
                new (self) Chain(make_chain(prismatic, origin, rotation, axis));
            },
            nb::arg("prismatic"), nb::arg("origin"), nb::arg("rotation"), nb::arg("axis"))
        .def_ro("dof", &Chain::dof)
        .def(
            "link_point",
            [](const Chain& chain, int link, const Vector3& point) { return link_point(chain, link, point); },
            nb::arg("link"), nb::arg("point"), "A point given in the frame of a link [m].")
        .def("poses", &poses, nb::arg("q"), nb::arg("link"), nb::arg("point"),
             "Homogeneous transforms (N, 4, 4) of the frame of `link`, moved to `point` of it, in the base "
             "frame.")
        .def("jacobians", &jacobians, nb::arg("q"), nb::arg("link"), nb::arg("point"),
             "Jacobians (N, 6, dof) of `point` of `link`: linear rows, then angular rows, in the base frame.");
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
