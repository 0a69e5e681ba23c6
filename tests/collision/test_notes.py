"""What a law notes of itself: said where it is so, and only there."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.verdict import percent
from collision.cases import control_group

DEAF = [6000.0] * 7
# What is changed, and what is said of it alone.
SAID: list[tuple[dict[str, Any], str]] = [
    ({"detector__thresholds_Nm": [20.0, 10.0, math.inf, 20.0, 20.0, 20.0, math.inf]}, "Not watched: joint 3, 7."),
    ({"detector__arming_delay_s": 0.05}, "The detector is blind for the first 0.05 s."),
    ({"reaction__latency_s": 0.0105}, "Reaction latency rounded up to 11 ms, whole simulation steps."),
    ({"reaction__latency_s": 0.011}, ""),
    (
        {"detector__thresholds_Nm": DEAF, "motion__duration_s": 2.0},
        "Some collisions are not detected within 2 s; their force has no bound and the mean is not given.",
    ),
]


@pytest.mark.parametrize(("changes", "said"), SAID)
def test_what_differs_from_the_usual_is_said(changes: dict[str, Any], said: str) -> None:
    usual, notes = bs.evaluate(control_group()).notes, bs.evaluate(control_group(**changes)).notes
    assert [note for note in notes if note not in usual] == ([said] if said else [])
    assert set(usual) <= set(notes)


def test_a_motion_that_ends_at_a_joint_limit_says_when_and_at_which() -> None:
    """Joint 2 has 0.3 degrees left."""
    law = bs.evaluate(control_group(pose_deg=[0, 109.7, 0, -20, 0, -40, 0], motion__velocity_mm_s=[0, 0, -30]))
    rate = law.problem.start["qd"][1]
    after = math.radians(0.3) / rate
    (said,) = (float(note.split()[4]) for note in law.notes if note.endswith(" s: joint 2 reaches its limit."))
    assert said == pytest.approx(after, abs=2e-3)
    # Whoever stands farther away than the arm gets is not touched.
    reach = float(law.curve.distance.max())
    untouched = math.erfc(reach / law.problem.offset_size / math.sqrt(2))
    assert law.no_contact_probability == pytest.approx(untouched, rel=1e-3)
    assert f"In {percent(law.no_contact_probability)} of cases the motion ends before contact." in law.notes


def test_joints_that_are_too_slow_for_the_speed_asked_for_are_said() -> None:
    for speed, slowed in ((-50.0, False), (-3000.0, True)):
        law = bs.evaluate(control_group(motion__velocity_mm_s=[0.0, 0.0, speed]))
        limit = law.problem.robot.velocity
        line = np.linalg.pinv(law.problem.robot.jacobian(law.problem.q)) @ [0, 0, speed / 1e3, 0, 0, 0]
        assert bool((np.abs(line) > limit).any()) == slowed
        assert any("joint-velocity limit slows the motion" in note for note in law.notes) == slowed
