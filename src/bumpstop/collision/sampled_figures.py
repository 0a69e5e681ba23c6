"""Figures of single collisions that were drawn, along a line or a trajectory."""

from __future__ import annotations

import math
from typing import Any, TypedDict

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.collision.distribution.distribution import SampledDistribution

Flags = npt.NDArray[np.bool_]


class SampledFigures(TypedDict):
    """Fields of a result that follow from its runs."""

    force_at_detection: SampledDistribution
    detection_delay: SampledDistribution
    trigger_joint_probability: FloatArray
    multi_joint_probability: float
    false_alarm_probability: float
    undetected_probability: float
    no_contact_probability: float


def sampled_figures(
    runs: _native.MonteCarloRuns,
    joints: int,
    *,
    touches: Flags,
    after_contact: Flags,
    force: FloatArray,
    delay: FloatArray,
) -> SampledFigures:
    """Shares of the runs, and distributions over those detected in contact.

    Args:
        runs: of the kernels.
        joints: of the arm.
        touches: (N,) the undisturbed arm reaches the body.
        after_contact: (N,) detected at or after the first tick in contact.
        force: (N,) at the tick of detection [N].
        delay: (N,) from contact to detection [s].
    """
    detected = runs.tick >= 0
    fired = (runs.triggers[detected, None] >> np.arange(joints, dtype=np.uint32)) & 1
    some = bool(detected.any())
    return {
        "force_at_detection": SampledDistribution(force[after_contact]),
        "detection_delay": SampledDistribution(delay[after_contact]),
        "trigger_joint_probability": fired.mean(axis=0) if some else np.full(joints, math.nan),
        "multi_joint_probability": float((fired.sum(axis=1) > 1).mean()) if some else math.nan,
        "false_alarm_probability": float((detected & ~after_contact).mean()),
        "undetected_probability": float((~detected & touches).mean()),
        "no_contact_probability": float((~detected & ~touches).mean()),
    }


def kept_runs(
    runs: _native.MonteCarloRuns, *, offset: FloatArray, peak: FloatArray, force: FloatArray, after_contact: Flags
) -> dict[str, npt.NDArray[Any]]:
    """What a result keeps of every run, by name; arguments as for :func:`sampled_figures`, and ``peak`` forces [N]."""
    return {
        "offset": offset,
        "tick": runs.tick,
        "triggers": runs.triggers,
        "noise": runs.noise,
        "residual": runs.residual,
        "peak_force": peak,
        "force_at_detection": force,
        "detected_after_contact": after_contact,
    }
