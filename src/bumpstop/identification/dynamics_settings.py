"""Cut-off of the filter and law of friction for a fit of dynamics, by the error on held-out fifths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.dynamics_system import FIT_PER_CUTOFF, System
from bumpstop.identification.torque_rows import TorqueRows

if TYPE_CHECKING:
    from bumpstop.identification.dynamics_system import Groups
    from bumpstop.identification.payload import Payload
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Speed over which Coulomb friction turns from one sign to the other, as a share of a joint's root mean square speed.
# The first is taken while the cut-off is chosen; then each joint gets the best of all.
SIGN_SHARES = (0.03, 0.001, 0.005, 0.01, 0.1, 0.3)
# Rows behind the filter that cut-off and friction are chosen on; of more, blocks spread over the time.
ENOUGH_TO_CHOOSE = 4_000
_CUTOFFS_HZ = (2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 30.0, 60.0)
_CLEAR_GAIN = 0.95
_AS_GOOD = 1.01


def choose_cutoff(
    recordings: Sequence[Recording],
    robot: Robot,
    couplings: Groups,
    payloads: Sequence[Payload | None],
    *,
    currents: bool = False,
) -> tuple[float, dict[float, float]]:
    """The cut-off [Hz] of the motion's filter, and the mean over joints of 1 - R2 on held-out fifths by cut-off.

    All are judged by one and the same torque. Of those that do as well as the best, the one that takes least away.

    Raises:
        InputError: too few rows a second for any.
    """
    rate = min(1 / float(np.median(np.diff(recording.t))) for recording in recordings)
    reference = min(20.0, 0.15 * rate)
    held_out: dict[float, float] = {}
    for candidate in _CUTOFFS_HZ:
        if candidate <= 0.4 * rate:
            filters = (FIT_PER_CUTOFF * candidate, reference)
            rows = TorqueRows.of(
                recordings,
                robot,
                candidate,
                payloads,
                currents=currents,
                limit=ENOUGH_TO_CHOOSE,
                filters_hz=filters,
            )
            system = System.of(rows, robot, candidate, couplings, SIGN_SHARES[0], reach=rows.reach)
            predicted = system.left_out()
            wanted = rows.torque_below(reference)
            if not currents:
                predicted = predicted + rows.reach.carried
            predicted = rows.reach.filtered(predicted, reference)
            spread = np.maximum(((wanted - wanted.mean(axis=0)) ** 2).sum(axis=0), 1e-300)
            held_out[candidate] = float(np.mean(((wanted - predicted) ** 2).sum(axis=0) / spread))
    if not held_out:
        raise InputError("recording", f"{rate:.3g} rows a second", "wanted at least 5")
    least = min(held_out.values())
    return max(candidate for candidate, share in held_out.items() if share <= _AS_GOOD * least), held_out


def best_friction(
    rows: TorqueRows, robot: Robot, cutoff_hz: float, couplings: Groups, *, of: TorqueRows | None = None
) -> System:
    """The system with the law and the widths of friction that predict held-out fifths best.

    Widths are tried on all joints at once and each joint takes its own best, where it is clearly better than straight
    friction of the usual width: a gain that another motion would not show is no reason to leave what is usual. Joints
    that share a motor cannot be told apart: they and their motor take one width, by the mean of what each leaves of its
    error. Friction that bends with the speed is taken for the whole arm, where that is clearly better with its widths.

    Args:
        rows: that it is chosen on.
        robot: the chain.
        cutoff_hz: of the rows' motion.
        couplings: joints that share a motor.
        of: rows of the system that is returned; default: the same.
    """
    first = System.of(rows, robot, cutoff_hz, couplings, SIGN_SHARES[0])
    teams = _teams(robot.dof, couplings)
    best: dict[bool, tuple[FloatArray, FloatArray]] = {}
    usual = np.empty(0)
    for bent in (False, True):
        tried = (System.of(rows, robot, cutoff_hz, couplings, share, bent=bent, known=first) for share in SIGN_SHARES)
        errors = np.array([system.held_out() for system in tried])
        shares = np.full(robot.dof + len(couplings), SIGN_SHARES[0])
        usual = errors[0] if not bent else usual
        left = errors[0].copy()
        for team in teams:
            joints = [j for j in team if j < robot.dof]
            ratios = (errors[:, joints] / np.maximum(usual[joints], 1e-300)).mean(axis=1)
            place = int(np.argmin(ratios))
            if ratios[place] <= _CLEAR_GAIN:
                shares[team], left[joints] = SIGN_SHARES[place], errors[place, joints]
        best[bent] = shares, left
    gain = float(np.mean(best[True][1] / np.maximum(best[False][1], 1e-300)))
    bent = gain <= _CLEAR_GAIN
    if of is None or of is rows:
        return System.of(rows, robot, cutoff_hz, couplings, best[bent][0], bent=bent, known=first)
    del first
    return System.of(of, robot, cutoff_hz, couplings, best[bent][0], bent=bent)


def _teams(dof: int, couplings: Groups) -> list[list[int]]:
    """Joints that shared motors tie together, with these motors, which are numbered after the joints."""
    teams = [[j] for j in range(dof)]
    for number, group in enumerate(couplings):
        joined = [team for team in teams if any(j in team for j, _ in group)]
        teams = [team for team in teams if team not in joined]
        teams.append(sorted({place for team in joined for place in team} | {dof + number}))
    return teams
