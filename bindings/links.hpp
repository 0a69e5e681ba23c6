// The inertia of links as Python holds it.
#pragma once

#include "bumpstop/model/inertias.hpp"
#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

// One link a row, in its own frame: mass and rotor (n,), centre of mass (n, 3), tensor about it (n, 3, 3).
inline std::vector<LinkInertia> make_links(Vector mass, Matrix center, Tensor tensor, Vector rotor) {
    std::vector<LinkInertia> links(mass.shape(0));
    for (std::size_t i = 0; i < links.size(); ++i) {
        links[i].mass = mass(i);
        links[i].rotor = rotor(i);
        for (int k = 0; k < 3; ++k) {
            links[i].center[k] = center(i, k);
            for (int l = 0; l < 3; ++l) links[i].tensor[3 * k + l] = tensor(i, k, l);
        }
    }
    return links;
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
