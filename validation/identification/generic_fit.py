"""Fits of real arms beside generic least squares, on parts of their recordings that neither has seen."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import islice

import numpy as np

from bumpstop.identification import identify_dynamics
from bumpstop.recording import Recording
from identification.generic_fit import (
    COMPARED_HZ,
    MOTORS,
    arm_and_recording,
    generic_r2,
    splits,
    unsettled_splits,
)
from identification.recorded import SHARED
from validation.facts import MissingFacts
from validation.findings import Cell, Findings

TITLE = "Dynamics of real arms beside generic least squares"
BELOW, MIN_SHARE = 0.002, 0.97
# On parts that the fit's rules were not settled on, fewer: an arm never seen is predicted as these are.
MIN_SHARE_UNSETTLED = 0.9


def compare(findings: Findings, *, quick: bool) -> None:
    """Fit with default options to all but a part of each recording, twice seven parts of each, and compare R2 there."""
    findings.say(
        "R2 at the rows where a joint moves, behind a zero-phase filter. The generic fit has inertial parameters, "
        "Coulomb friction by the sign of the speed, viscous friction, rotors and offsets, and filters all at the "
        "frequency of the comparison. Currents of the UR3e are torques by its controller's gains."
    )
    arms = ("panda",) if quick else tuple(COMPARED_HZ)
    _compare_parts(findings, "on the parts left out", arms, splits, MIN_SHARE, most=1 if quick else None)
    if not quick:
        _compare_parts(findings, "on parts that no rule was settled on", arms, unsettled_splits, MIN_SHARE_UNSETTLED)


def _compare_parts(
    findings: Findings,
    where: str,
    arms: Sequence[str],
    parts: Callable[[Recording], Iterable[tuple[str, list[Recording], Recording]]],
    least_share: float,
    *,
    most: int | None = None,
) -> None:
    """R2 of both fits on the first ``most`` of some parts, and the share of joints and parts that must not be below."""
    differences: list[float] = []
    below: list[str] = []
    rows: list[list[Cell]] = []
    for name in arms:
        found = arm_and_recording(name)
        if found is None:
            raise MissingFacts(f"the recording of {name} in {SHARED} is absent: set BUMPSTOP_SHARED")
        robot, log = found
        for part, fitted, unseen in islice(parts(log), most):
            fit = identify_dynamics(fitted, robot, couplings=MOTORS.get(name, ()))
            ours = np.array([score.r2 for score in fit.score(unseen, filter_hz=COMPARED_HZ[name])])
            others = generic_r2(robot, fitted, unseen, COMPARED_HZ[name], name)
            own = (ours - others)[np.isfinite(ours)]
            differences += own.tolist()
            below += [f"{name} {part} joint {j + 1} {x:.4f}" for j, x in enumerate(ours - others) if x < -BELOW]
            told = (" ".join(f"{x:.3f}" for x in r2) for r2 in (ours, others))
            rows.append([name, part, fit.model.cutoff_hz, *told, float(own.min())])
            findings.progress(f"{name} {part}: least difference {own.min():.4f}")
    findings.table(
        f"R2 by joint {where}",
        ("arm", "part", "cut-off, Hz", "ours", "generic", "least difference"),
        ("", "", "g", "", "", ".4f"),
        rows,
    )
    share = float(np.mean(np.array(differences) >= -BELOW))
    what = f"{100 * least_share:g} % of joints and parts are not below by more than {BELOW:g}, {where}"
    findings.check(what, share >= least_share, f"{len(differences)} compared; below: {', '.join(below) or 'none'}")
