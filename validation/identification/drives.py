"""Joint models from simulated currents: how often intervals hold the truth, on synthetic and on recorded motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import bumpstop as bs
from bumpstop.identification import identify_joint_model
from identification.drives import Motion, fourier, planted, z_scores
from identification.recorded import FILES, arm_and_motion, there
from validation.findings import Findings

TITLE = "Joint models from motor currents"
MIN_SHARE, MAX_SHARE = 0.92, 0.975


def compare(findings: Findings, *, quick: bool) -> None:
    """Plant drives, fit them, and count the intervals that hold what was planted."""
    seeds, seconds = (2, 20.0) if quick else (20, 40.0)
    findings.say(
        f"Currents of known drives (odd map, power law of friction, reflected inertia) on {seeds} motions or seeds of "
        "noise each: noise of 0.05 A correlated by 0.8 from sample to sample, encoder noise of 1e-5 rad, 1 % of the "
        "samples lost. The cut-off is chosen by the fit. An interval is the value and 1.96 standard errors either way."
    )

    def synthetic(name: str) -> Callable[[int], tuple[bs.Robot, Motion]]:
        robot = bs.Robot.load(name)
        return lambda seed: (robot, fourier(robot, seconds, 100.0, seed))

    cases = {"ur10e, Fourier": synthetic("ur10e"), "panda, Fourier": synthetic("panda")}
    for name in FILES:
        if there(name) and not quick:
            recorded = arm_and_motion(name)
            cases[f"{name}, recorded"] = lambda seed, recorded=recorded: recorded  # type: ignore[misc]
    rows, pooled = [], []
    for case, motion_of in cases.items():
        scores: list[float] = []
        for seed in range(seeds):
            robot, motion = motion_of(seed)
            truth, log = planted(robot, motion, 1000 + seed)
            fit = identify_joint_model(log, robot, maps=["odd"], frictions=["power"], inertia_uncertainty=0.0)
            scores += z_scores(fit.model, truth)
        inside = np.abs(scores) < 1.96
        pooled += inside.tolist()
        rows.append((case, seeds, len(scores), float(np.mean(inside)), float(np.std(scores)), fit.cutoff_hz))
    headings = ("motion", "fits", "intervals", "hold the truth", "sd of errors, standard errors", "cut-off, Hz")
    findings.table("Intervals that hold the planted value", headings, ("", "d", "d", ".3f", ".2f", "g"), rows)
    share = float(np.mean(pooled))
    if quick:
        findings.check("Of the intervals at least 80 % hold the truth", share >= 0.8, f"{share:.3f} of {len(pooled)}")
    else:
        what = f"Pooled, between {100 * MIN_SHARE:g} and {100 * MAX_SHARE:g} % of the intervals hold the truth"
        findings.check(what, MIN_SHARE <= share <= MAX_SHARE, f"{share:.4f} of {len(pooled)}")
