"""Elastic arms that brake where their line ends: a path presses alike, whatever has been detected on it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.contact_course import contact_course

# A joint reaches its limit after 100 ms.
NEAR_LIMIT: dict[str, Any] = {
    "robot": "sia5d",
    "pose_rad": [
        1.1397175556530534, 0.9190962502545106, 0.6111390282543012, 1.9890811141596638, 1.9078253611600982,
        1.0319295996790467, 0.5176338823121234,
    ],
    "motion": {"velocity_mm_s": [110.06609152677188, 75.41214457467193, -148.9914895108746], "task": "position"},
    "contact": {"body": "lower_arm_wrist", "limits": "ts15066", "area_cm2": 2.0},
    "detector": {"thresholds_Nm": [20.0] * 7, "noise_sd_Nm": 2.0},
    "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 15.0},
    "arm": {"model": "elastic"},
}  # fmt: skip
NEVER, AT_ONCE = 1e6, 1e-3


def evaluate(latency: float, threshold: float = 20.0, samples: int | None = None, **more: Any) -> bs.CollisionResult:
    given = bs.Scenario.from_dict(NEAR_LIMIT).with_values(
        {"reaction.latency_s": latency, "detector.thresholds_Nm": [threshold] * 7}
        | {key.replace("__", "."): value for key, value in more.items()}
    )
    return bs.evaluate(given, samples=samples, seed=1)


def test_a_late_detection_is_no_milder_than_none() -> None:
    """From 85 ms on, where no reaction begins in time, it was acceptable at 155 N; never detected 173 N."""
    results = [evaluate(latency) for latency in (0.06, 0.07, 0.076, 0.08, 0.085, 0.091, 0.101, 0.12, 0.2)]
    results.append(evaluate(0.2, NEVER))
    forces = np.array([[each.peak_force.mean, each.peak_force.quantile(0.999)] for each in results])
    assert (np.diff(forces, axis=0) > -1e-4 * forces[:-1]).all()
    np.testing.assert_allclose(forces[-3:], forces[-1:].repeat(3, axis=0), rtol=1e-4)
    conclusions = [each.verdict.conclusion for each in results]
    assert conclusions == ["acceptable"] * 2 + ["not_acceptable"] * 8


@pytest.mark.parametrize("start", ["moving", "rest"])
@pytest.mark.parametrize("share", [1.0, 0.5])
@pytest.mark.parametrize("offset_mm", [0.0, 10.0, 22.0])
def test_the_same_braking_presses_alike_whoever_counts_it(offset_mm: float, share: float, start: str) -> None:
    """No reaction begins before the line ends: detected, after a false alarm or never, integrated and sampled."""
    more = {
        "motion__start": start, "contact__offset_law": "fixed", "contact__offset_mm": offset_mm,
        "arm__acceleration_feedforward": share,
    }  # fmt: skip
    never = evaluate(0.2, NEVER, **more)
    path = np.concatenate([never.curve.distance, never.curve.line.braking, np.full(400, never.curve.line.braking[-1])])
    course = contact_course(never.problem, never.curve, path, 1e-3 * offset_mm, len(never.curve.distance) - 1)
    # The course has its first step at the speed of the line.
    assert never.peak_force.mean == pytest.approx(course.peak, rel=1e-3 if start == "rest" else 1e-5)
    for threshold in (NEVER, 20.0, AT_ONCE):
        for samples in (None, 16):
            force = evaluate(0.2, threshold, samples, **more).peak_force
            assert force.mean == pytest.approx(never.peak_force.mean, rel=1e-5)


@pytest.mark.parametrize("latency_ms", [20, 50, 80])
def test_an_alarm_while_the_arm_speeds_up_brakes_it_when_the_latency_is_over(latency_ms: int) -> None:
    """Until then the controller foresees the motion, which was taken for a reaction from the alarm on: 58 N for 46."""
    offset = 1e-3 if latency_ms == 20 else 10e-3 if latency_ms == 50 else 14e-3
    more = {"motion__start": "rest", "contact__offset_law": "fixed", "contact__offset_mm": 1e3 * offset}
    result = evaluate(1e-3 * latency_ms, AT_ONCE, **more)
    begin = 1 + latency_ms
    (reaction,) = result.curve.kernel.reaction_paths([0], [0.0])
    path = np.concatenate([result.curve.distance[:begin], reaction, np.full(400, reaction[-1])])
    course = contact_course(result.problem, result.curve, path, offset, begin)
    assert course.peak > 20
    assert result.peak_force.mean == pytest.approx(course.peak, rel=1e-4)
