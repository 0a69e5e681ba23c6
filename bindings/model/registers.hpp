// Rows of joint positions, a register of postures at a time.
#pragma once

#include "bumpstop/model/kinematics.hpp"
#include "common.hpp"

namespace bumpstop::inline BUMPSTOP_TARGET {

// Calls visit(first, count, position, angle) for registers of rows of q.
template <class Visit>
void for_registers(const Chain& chain, Matrix q, Visit visit) {
    const std::size_t n = q.shape(0);
    for (std::size_t first = 0; first < n; first += native_lanes) {
        NativeLanes position[max_joints];
        load_rows(q, first, position);
        JointAngles<NativeLanes> angle;
        angle.set(chain, position);
        visit(first, int(std::min<std::size_t>(native_lanes, n - first)), position, angle);
    }
}

// Calls visit(first, count, posture) for registers of rows of q.
template <class Visit>
void for_postures(const Chain& chain, Matrix q, Visit visit) {
    for_registers(
        chain, q,
        [&](std::size_t first, int count, const NativeLanes* position, const JointAngles<NativeLanes>& angle) {
            Posture<NativeLanes> posture;
            forward_kinematics(chain, position, angle, posture);
            visit(first, count, posture);
        });
}

}  // namespace bumpstop::inline BUMPSTOP_TARGET
