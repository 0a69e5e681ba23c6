"""Cut-off of the filter and law of friction for a fit of dynamics, by the error on held-out fifths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.dynamics.dynamics_system import FIT_PER_CUTOFF, System
from bumpstop.identification.segments.drive_samples import split_at_gaps
from bumpstop.identification.segments.torque_samples import TorqueSamples
from bumpstop.model.dynamics import STANDARD_GRAVITY

if TYPE_CHECKING:
    from bumpstop.identification.dynamics.dynamics_system import Groups
    from bumpstop.identification.payload.payload import Payload
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Speed over which Coulomb friction turns from one sign to the other, as a share of a joint's root mean square speed.
# A joint keeps the first, all but a jump as in any generic fit, unless its motion tells of another.
SIGN_SHARES = (0.001, 0.005, 0.01, 0.03, 0.1, 0.3)
_CUTOFF_SHARE = 0.03  # of all joints while the cut-off is chosen
# Travel over which it turns round after a reversal instead [rad or m].
TRAVELS = (0.01, 0.03)
# Rows behind the filter that cut-off and friction are chosen on; of more, blocks spread over the time.
ENOUGH_TO_CHOOSE = 4_000
# Cut-offs are compared on the same rows, so many times the frequency that they are compared at.
_ROWS_PER_REFERENCE = 5.0
_MAX_AT_END = 0.05  # of a segment, that is left out at either end while the cut-off is chosen
_CUTOFFS_HZ = (2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 30.0, 60.0)
# Another law of friction is taken where it leaves so much of the error on held-out fifths, and where the parts of the
# rows say so beyond chance, by so many standard errors.
_CLEAR_GAIN, _SURE = 0.95, 2.0
# A width, or a presliding travel, is taken where it leaves so much. It need not be beyond chance: a recording has few
# reversals at which a joint creeps, and where it has none that tell, others will have some.
_LESS = 0.98
_LOAD_ROUNDS = 3  # of a load that depends on what is fitted
_AS_GOOD = 1.01


def choose_cutoff(
    recordings: Sequence[Recording],
    robot: Robot,
    couplings: Groups,
    payloads: Sequence[Payload | None],
    *,
    currents: bool = False,
    gravity: tuple[float, float, float] = STANDARD_GRAVITY,
) -> tuple[float, dict[float, float]]:
    """The cut-off [Hz] of the motion's filter, and the mean over joints of 1 - R2 on held-out fifths by cut-off.

    All are judged by one and the same torque. Of those that do as well as the best, the one that takes least away.

    Raises:
        InputError: too few rows a second for any.
    """
    rate = min(1 / float(np.median(np.diff(recording.t))) for recording in recordings)
    reference = min(20.0, 0.15 * rate)
    trim = min(1 / _CUTOFFS_HZ[0], _MAX_AT_END * _usual_segment(recordings))
    held_out: dict[float, float] = {}
    for candidate in _CUTOFFS_HZ:
        if candidate <= 0.4 * rate:
            filters = (FIT_PER_CUTOFF * candidate, reference)
            rows = TorqueSamples.of(
                recordings,
                robot,
                candidate,
                payloads,
                currents=currents,
                limit=ENOUGH_TO_CHOOSE,
                filters_hz=filters,
                rate_hz=_ROWS_PER_REFERENCE * reference,
                trim_s=trim,
                gravity=gravity,
            )
            system = System.of(rows, robot, candidate, couplings, _CUTOFF_SHARE, reach=rows.reach)
            predicted = system.left_out()
            wanted = rows.torque_below(reference)
            if not currents:
                predicted = predicted + rows.reach.carried
            predicted = rows.reach.filtered(predicted, reference)
            middle = np.where(rows.used, wanted, 0.0).sum(axis=0) / system.counts
            spread = np.maximum(np.where(rows.used, (wanted - middle) ** 2, 0.0).sum(axis=0), 1e-300)
            left = np.where(rows.used, (wanted - predicted) ** 2, 0.0).sum(axis=0)
            held_out[candidate] = float(np.mean(left / spread))
    if not held_out:
        raise InputError("recording", f"{rate:.3g} rows a second", "wanted at least 5")
    least = min(held_out.values())
    good = [candidate for candidate, share in held_out.items() if share <= _AS_GOOD * least]
    middle = math.sqrt(good[0] * good[-1])
    return min(good, key=lambda candidate: abs(math.log(candidate / middle))), held_out


def best_friction(
    rows: TorqueSamples, robot: Robot, cutoff_hz: float, couplings: Groups, *, of: TorqueSamples | None = None
) -> System:
    """The system with the laws and the widths of friction that predict held-out fifths best, joint by joint.

    Laws and widths are tried on all joints at once and each joint takes its own best, simplest first: another width,
    where it is better; friction that bends with the speed, friction that grows with the load, each only where it is
    clearly better than the simpler one, beyond chance. A gain that another motion would not show is no reason to leave
    what is usual. Last comes friction that builds up over a presliding travel, which need only be better. Joints that
    share a motor cannot be told apart: they and their motor take one law and width, by the mean of what each leaves of
    its error.

    Args:
        rows: that it is chosen on.
        robot: the chain.
        cutoff_hz: of the rows' motion.
        couplings: joints that share a motor.
        of: rows of the system that is returned; default: the same.
    """
    first = System.of(rows, robot, cutoff_hz, couplings, SIGN_SHARES[0])
    loads = dict(enumerate(first.load_of(first.values).T))
    groups, teams = robot.dof + len(couplings), _teams(robot.dof, couplings)
    shares, bent, loaded = np.full(groups, SIGN_SHARES[0]), np.zeros(groups, dtype=bool), np.zeros(groups, dtype=bool)
    best = first.held_out_parts()
    for bends, grows in ((False, False), (True, False), (False, True), (True, True)):

        def system(
            share: float, bends: bool = bends, own: dict[int, FloatArray] | None = loads if grows else None
        ) -> System:
            return System.of(rows, robot, cutoff_hz, couplings, share, bent=bends, loads=own, known=first)

        tried = [system(share).held_out_parts() for share in SIGN_SHARES]
        for team, place in _taken(best, tried, teams, surely=bends or grows):
            shares[team], bent[team], loaded[team] = SIGN_SHARES[place], bends, grows
    laws = {j: loads[j] for j in np.flatnonzero(loaded[: robot.dof]).tolist()}
    presliding = np.full(groups, np.nan)

    def sliding(travel: float) -> System:
        every = np.full(groups, travel)
        return System.of(
            rows, robot, cutoff_hz, couplings, SIGN_SHARES[0], presliding=every, bent=bent, loads=laws, known=first
        )

    for team, place in _taken(best, [sliding(travel).held_out_parts() for travel in TRAVELS], teams, surely=False):
        # What builds up begins with the whole sign of the speed, unless the joint stands.
        shares[team], presliding[team] = SIGN_SHARES[0], TRAVELS[place]
    if of is not None and of is not rows:
        first = System.of(of, robot, cutoff_hz, couplings, SIGN_SHARES[0])
    return _with_laws(first, shares, presliding, bent, sorted(laws))


def _taken(
    best: FloatArray, tried: Sequence[FloatArray], teams: Sequence[list[int]], *, surely: bool = True
) -> list[tuple[list[int], int]]:
    """Teams that one of some models is better for, and its place.

    Args:
        best: (parts, n) errors so far, which those of the models that are taken replace.
        tried: (parts, n) errors of each model.
        teams: joints, and motors after them, that take one model together.
        surely: it must be clearly better, and beyond chance.
    """
    errors, found = np.array(tried), []
    for team in teams:
        joints = [j for j in team if j < best.shape[1]]
        # Shares of the joints' errors before, and what each part has of them.
        whole = np.maximum(best[:, joints].sum(axis=0), 1e-300)
        after = (errors[:, :, joints] / whole).mean(axis=2)
        place = int(np.argmin(after.sum(axis=1)))
        gains = (best[:, joints] / whole).mean(axis=1) - after[place]
        if after[place].sum() <= (_CLEAR_GAIN if surely else _LESS) and (not surely or _is_sure(gains)):
            best[:, joints] = errors[place][:, joints]
            found.append((team, place))
    return found


def _is_sure(gains: FloatArray) -> bool:
    """Whether the mean of gains, one for each part of the rows, is beyond chance."""
    return bool(gains.mean() > _SURE * gains.std(ddof=1) / math.sqrt(gains.size))


def _with_laws(
    first: System, shares: FloatArray, presliding: FloatArray, bent: np.ndarray, loaded: Sequence[int]
) -> System:
    """The system with these laws of friction, its loads those that its own solution says.

    Args:
        first: a system of the same rows without loads.
        shares: (n + shared motors,) speed over which Coulomb friction turns, as for :meth:`System.of`.
        presliding: (n + shared motors,) travel over which it turns instead; NaN: it does not.
        bent: (n + shared motors,) where friction bends with the speed.
        loaded: joints (from 0) whose friction grows with the load.
    """
    load = first.load_of(first.values) if loaded else None
    loads = {} if load is None else {j: np.ascontiguousarray(load[:, j]) for j in loaded}
    found = System.of(
        first.rows,
        first.robot,
        first.cutoff_hz,
        first.couplings,
        shares,
        presliding=presliding if np.isfinite(presliding).any() else None,
        bent=bent,
        loads=loads,
        known=first,
    )
    for _ in range(_LOAD_ROUNDS if loaded else 0):
        found = found.reloaded(found.values if first.rows.currents else found.base.values)
    return found


def _usual_segment(recordings: Sequence[Recording]) -> float:
    """Length of the segment that the middle one of all rows lies in [s]."""
    lengths = sorted(
        (float(recording.t[rows.stop - 1] - recording.t[rows.start]), rows.stop - rows.start)
        for recording in recordings
        for rows in split_at_gaps(recording.t)
    )
    rows_up_to = np.cumsum([rows for _, rows in lengths])
    return lengths[int(np.searchsorted(rows_up_to, rows_up_to[-1] / 2))][0]


def _teams(dof: int, couplings: Groups) -> list[list[int]]:
    """Joints that shared motors tie together, with these motors, which are numbered after the joints."""
    teams = [[j] for j in range(dof)]
    for number, group in enumerate(couplings):
        joined = [team for team in teams if any(j in team for j, _ in group)]
        teams = [team for team in teams if team not in joined]
        teams.append(sorted({place for team in joined for place in team} | {dof + number}))
    return teams
