"""Gains of joint models: how often intervals hold the truth where map and inertia are not known for sure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import bumpstop as bs
from bumpstop.identification import identify_joint_model
from bumpstop.model import inverse_dynamics, with_rotors
from identification.drives import Motion, driven, drives, fourier
from validation.findings import Findings

TITLE = "Gains of joint models"
INERTIA_OFF = 0.05  # of the simulated arm: standard deviation of masses and centres about the published ones
LEAST, LEAST_OF_FEW = 0.90, 0.75


def compare(findings: Findings, *, quick: bool) -> None:
    """Plant gains in arms whose inertia is not quite the published one, and count the intervals of B that hold them."""
    seeds, seconds = (1, 20.0) if quick else (8, 40.0)
    findings.say(
        f"Currents of known drives with {seeds} draws of motion, noise and inertia each; all settings, the map and the "
        "friction law are chosen by the fit. The arm that moves has the published inertia, or one whose masses and "
        f"centres are off by {100 * INERTIA_OFF:g} % (a standard deviation each); the fit knows the published one, and "
        "how uncertain it is. An interval is B and 1.96 standard errors either way; beside it the same by noise alone."
    )

    rows = []
    pooled: dict[tuple[str, float], list[tuple[float, float]]] = {}
    for name in ("ur10e", "panda"):
        robot = bs.Robot.load(name)
        for kind in ("linear", "odd"):
            for off in (0.0, INERTIA_OFF):
                scores = []
                for seed in range(seeds):
                    scores += gain_scores(robot, fourier(robot, seconds, 100.0, seed), kind, off, 1000 + seed)
                pooled.setdefault((kind, off), []).extend(scores)
                rows.append((name, kind, 100 * off, len(scores), *_held(scores)))
    rows += [("all", kind, 100 * off, len(scores), *_held(scores)) for (kind, off), scores in pooled.items()]
    headings = ("arm", "planted map", "inertia off, %", "intervals", "hold the gain", "by noise alone")
    findings.table("Intervals of B that hold the planted gain", headings, ("", "", "g", "d", ".3f", ".3f"), rows)
    least = LEAST_OF_FEW if quick else LEAST
    for (kind, off), scores in pooled.items():
        what = f"{kind} map, inertia off by {100 * off:g} %: at least {100 * least:g} % of the intervals hold the gain"
        findings.check(what, _held(scores)[0] >= least, f"{_held(scores)[0]:.3f} of {len(scores)}")


def _held(scores: list[tuple[float, float]]) -> tuple[float, float]:
    """Shares of the intervals that hold the truth: as they are, and by noise alone."""
    inside = np.abs(scores) < 1.96
    return float(inside[:, 0].mean()), float(inside[:, 1].mean())


def gain_scores(robot: bs.Robot, motion: Motion, kind: str, off: float, seed: int) -> list[tuple[float, float]]:
    """Errors of the gains that are seen, in standard errors and in those by noise alone."""
    moved = disturbed(robot, off, seed)
    truth = drives(moved, inverse_dynamics(with_rotors(moved, 0.0), *motion[1:]), kind=kind)
    fit = identify_joint_model(driven(moved, motion, truth, seed), robot, inertia_uncertainty=off)
    scores = []
    for found, planted in zip(fit.joints, truth.joints, strict=True):
        gain = found.parameters.parameters["B"]
        if gain is not None and gain.standard_error:
            error = gain.value - planted.value("B")
            scores.append((error / gain.standard_error, error / found.gain_errors["noise"]))
    return scores


def disturbed(robot: bs.Robot, share: float, seed: int) -> bs.Robot:
    """The arm with other masses, and centres farther along or back by a share of their distance; moments go along."""
    rng = np.random.default_rng(seed)
    joints = []
    for joint in robot.joints:
        assert joint.inertia is not None
        scale = 1 + share * rng.normal()
        center = np.asarray(joint.inertia.center)
        shift = share * float(np.linalg.norm(center)) * rng.normal(size=3)
        own = replace(
            joint.inertia,
            mass=joint.inertia.mass * scale,
            center=tuple((center + shift).tolist()),
            tensor=tuple(tuple((scale * np.asarray(row)).tolist()) for row in joint.inertia.tensor),
        )
        joints.append(replace(joint, inertia=own))
    return replace(robot, joints=tuple(joints))
