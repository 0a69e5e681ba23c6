"""Recorded currents and torques that are constant, or clipped at an end."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.terminal import in_percent

if TYPE_CHECKING:
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# A column is clipped where it stands at its end for so many rows on end, in so many places or for such a share of rows.
_ON_END, _PLACES, _SHARE = 5, 2, 0.01
_MOVES = 0.01  # [rad or m]
_WORDS = {"current": "current", "tau": "torque"}


def tell_doubtful_columns(
    recordings: Sequence[Recording],
    robot: Robot,
    quantity: str,
    faults: list[str],
    warnings: list[str],
    *,
    judged: Collection[str],
) -> None:
    """Add a sentence on every doubtful column: of a joint that is judged by it, a constant one is a fault.

    Args:
        recordings: of this robot.
        robot: whose joints they are.
        quantity: ``"current"`` or ``"tau"``.
        faults: constant columns of the joints in ``judged`` are added.
        warnings: other doubtful columns are added.
        judged: names of joints.
    """
    dead = _constant(recordings, robot, quantity)
    faults += [sentence for name, sentence in dead.items() if name in judged]
    warnings += [sentence for name, sentence in dead.items() if name not in judged]
    warnings += _clipped(recordings, robot, quantity, but=dead)


def doubtful_columns(recordings: Sequence[Recording], robot: Robot, quantity: str) -> list[str]:
    """Sentences on columns that are constant while their joint moves, or clipped.

    Args:
        recordings: of this robot.
        robot: whose joints they are.
        quantity: ``"current"`` or ``"tau"``.
    """
    found: list[str] = []
    tell_doubtful_columns(recordings, robot, quantity, found, found, judged=())
    return found


def constant_words(name: str, quantity: str) -> str:
    """The sentence on a joint whose ``"current"`` or ``"tau"`` is constant while it moves."""
    return f"the {_WORDS[quantity]} of {name} is constant while the joint moves: is it the right column?"


def _columns(recordings: Sequence[Recording], quantity: str, j: int) -> list[tuple[Recording, FloatArray]]:
    return [(log, value[:, j]) for log in recordings for value in (getattr(log, quantity),) if value is not None]


def _constant(recordings: Sequence[Recording], robot: Robot, quantity: str) -> dict[str, str]:
    """By the names of joints, a sentence on columns that are constant while the joint moves."""
    return {
        joint.name: constant_words(joint.name, quantity)
        for j, joint in enumerate(robot.joints)
        if any(np.ptp(x) == 0 and np.ptp(log.q[:, j]) > _MOVES for log, x in _columns(recordings, quantity, j))
    }


def _clipped(recordings: Sequence[Recording], robot: Robot, quantity: str, *, but: Collection[str]) -> list[str]:
    """Sentences on columns that are clipped, of other joints than ``but``."""
    found = []
    for j, joint in enumerate(robot.joints):
        columns = [] if joint.name in but else _columns(recordings, quantity, j)
        shares = [clipped_share(x) for _, x in columns]
        worst = max(shares, default=0.0)
        if worst:
            top = max(float(np.abs(x).max()) for _, x in columns)
            found.append(
                f"the {_WORDS[quantity]} of {joint.name} stands at an end of its range, {top:.4g}, in "
                f"{in_percent(worst, 2)} of the rows: it is clipped"
            )
    return found


def clipped_share(x: FloatArray) -> float:
    """Share of the rows (N,) that stand at the largest or least value; 0: it is not clipped.

    A value that lasts is no sign by itself: a joint at rest may have one current all the time. So the ends must be
    reached from different sides, rows on end, and the values next to the end must be far fewer than those at it.
    """
    low, high = float(x.min()), float(x.max())
    if not high > low:
        return 0.0
    share = 0.0
    for end, inward in ((high, -1.0), (low, 1.0)):
        at = x == end
        runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], at.astype(np.int8), [0]])))).tolist()[::2]
        long = [run for run in runs if run >= _ON_END]
        # Quantized values near an end thin out; clipped ones pile up there.
        near = (inward * (x - end) <= 0.02 * (high - low)) & ~at
        if (
            len(long) >= _PLACES
            and at.mean() >= _SHARE
            and at.sum() > 3 * near.sum()
            and abs(end) > 0.3 * max(abs(low), abs(high))
        ):
            share += float(at.mean())
    return share
