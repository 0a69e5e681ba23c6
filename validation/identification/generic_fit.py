"""Fits of real arms beside generic least squares, on parts of their recordings that neither has seen."""

from __future__ import annotations

import numpy as np

from bumpstop.identification import identify_dynamics
from identification.generic_fit import COMPARED_HZ, MOTORS, arm_and_recording, generic_r2, splits
from identification.recorded import SHARED
from validation.facts import MissingFacts
from validation.findings import Cell, Findings

TITLE = "Dynamics of real arms beside generic least squares"
BELOW, MIN_SHARE = 0.002, 0.97


def compare(findings: Findings, *, quick: bool) -> None:
    """Fit with default options to all but a part of each recording, seven parts of each, and compare R2 there."""
    findings.say(
        "R2 at the rows where a joint moves, behind a zero-phase filter. The generic fit has inertial parameters, "
        "Coulomb friction by the sign of the speed, viscous friction, rotors and offsets, and filters all at the "
        "frequency of the comparison. Currents of the UR3e are torques by its controller's gains."
    )
    differences: list[float] = []
    below: list[str] = []
    rows: list[list[Cell]] = []
    for name in ("panda",) if quick else tuple(COMPARED_HZ):
        found = arm_and_recording(name)
        if found is None:
            raise MissingFacts(f"the recording of {name} in {SHARED} is absent: set BUMPSTOP_SHARED")
        robot, log = found
        for part, fitted, unseen in list(splits(log))[: 1 if quick else None]:
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
        "R2 by joint on the part left out",
        ("arm", "part", "cut-off, Hz", "ours", "generic", "least difference"),
        ("", "", "g", "", "", ".4f"),
        rows,
    )
    share = float(np.mean(np.array(differences) >= -BELOW))
    what = f"{100 * MIN_SHARE:g} % of joints and parts are not below by more than {BELOW:g}"
    findings.check(what, share >= MIN_SHARE, f"{len(differences)} compared; below: {', '.join(below) or 'none'}")
