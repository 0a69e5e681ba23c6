"""Gains, friction and inertia from simulated currents alone: how often intervals of gains hold the truth."""

from __future__ import annotations

import numpy as np

import bumpstop as bs
from bumpstop.identification import identify_gains, with_payload
from identification.test_gains_fit import ALL_GAINS, LOAD, currents
from validation.findings import Findings

TITLE = "Drive gains of arms of unknown inertia"
MIN_SHARE, MAX_SHARE = 0.92, 0.975
NOISES_A = (0.05, 0.2)
_FIRST_SEED = 1000  # lower ones were looked at while the standard errors were made


def compare(findings: Findings, *, quick: bool) -> None:
    """Plant gains, fit them with a load in one of two recordings, and count the intervals that hold them."""
    seeds, seconds = (1, 12.0) if quick else (20, 20.0)
    findings.say(
        f"Two recordings of {seconds:g} s at 94 Hz, uneven by 10 %, the second with a known load of {LOAD.mass:g} kg, "
        f"{seeds} pairs of motions for each arm and noise; noise of the currents correlated by 0.8 from sample to "
        "sample. Inertia, friction and gains are unknown to the fit. An interval is the value and 1.96 standard errors "
        "either way."
    )
    rows, pooled, pair = [], [], _FIRST_SEED
    for name in ("ur5e",) if quick else ("ur5e", "panda"):
        robot = bs.Robot.load(name)
        truth = ALL_GAINS[: robot.dof]
        loaded = with_payload(robot, LOAD.mass, LOAD.center)
        for noise in NOISES_A:
            scores, shares = [], []
            for _ in range(seeds):
                logs = [
                    currents(robot, 2 * pair, seconds=seconds, noise=noise),
                    currents(loaded, 2 * pair + 1, seconds=seconds, noise=noise),
                ]
                pair += 1
                fit = identify_gains(logs, robot, payloads=[None, LOAD], cutoff_hz=15.0)
                assert fit.model.gains is not None
                assert fit.gain_errors is not None
                seen = np.isfinite(fit.gain_errors)
                scores += ((fit.model.gains - truth)[seen] / fit.gain_errors[seen]).tolist()
                shares += (np.abs(fit.model.gains - truth)[seen] / truth[seen]).tolist()
            inside = np.abs(scores) < 1.96
            pooled += inside.tolist()
            rows.append(
                (name, noise, len(scores), float(np.mean(inside)), float(np.std(scores)), 100 * np.median(shares))
            )
    headings = ("arm", "noise, A", "intervals", "hold the truth", "sd of errors, standard errors", "median error, %")
    findings.table("Intervals of gains", headings, ("", "g", "d", ".3f", ".2f", ".2f"), rows)
    share, least = float(np.mean(pooled)), 0.6 if quick else MIN_SHARE
    findings.check(
        f"Pooled, between {100 * least:g} and {100 * MAX_SHARE:g} % of the intervals hold the truth",
        least <= share <= (1.0 if quick else MAX_SHARE),
        f"{share:.4f} of {len(pooled)}",
    )
