"""What a distribution notes of itself: said where it is so, and only there."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.distribution.contact_duration import integrated_contact_duration
from bumpstop.collision.probability_text import percent
from collision.cases import control_group

DEAF = [6000.0] * 7
# What is changed, and what is said of it alone.
SAID: list[tuple[dict[str, Any], str]] = [
    ({"detector__thresholds_Nm": [20.0, 10.0, math.inf, 20.0, 20.0, 20.0, math.inf]}, "Not monitored: joint 3, 7."),
    ({"detector__arming_delay_s": 0.05}, "The detector is not armed for the first 0.05 s."),
    ({"reaction__latency_s": 0.0105}, "Reaction latency rounded up to 11 ms, whole simulation steps."),
    ({"reaction__latency_s": 0.011}, ""),
    (
        {"detector__thresholds_Nm": DEAF, "motion__duration_s": 2.0},
        "Over 99.9999 % of collisions are not detected within 2 s (motion.duration_s). They count as over every limit: "
        "their force is unbounded and the mean is not given.",
    ),
]


@pytest.mark.parametrize(("changes", "said"), SAID)
def test_what_differs_from_the_usual_is_said(changes: dict[str, Any], said: str) -> None:
    usual, notes = (
        # How often thresholds alarm for nothing is told of each.
        [note for note in bs.evaluate(scenario).notes if "false alarms an hour" not in note]
        for scenario in (control_group(), control_group(**changes))
    )
    assert [note for note in notes if note not in usual] == ([said] if said else [])
    assert set(usual) <= set(notes)


@pytest.mark.parametrize(
    ("contact", "said"),
    [
        ({}, "contact does not slow it, and the body is clamped behind a linear spring of 75000 N/m."),
        (
            {"damping_Ns_m": 200.0},
            "the body is clamped behind a linear spring of 75000 N/m with a damper of 200 Ns/m.",
        ),
        (
            {"gauge_spring_N_m": 60e3, "gauge_mass_kg": 0.3},
            "is clamped behind a linear spring of 75000 N/m, before a gauge of 0.3 kg on a spring of 60000 N/m.",
        ),
        (
            {"gauge_spring_N_m": 60e3, "gauge_mass_kg": 0.3, "damping_Ns_m": 200.0},
            "spring of 75000 N/m with a damper of 200 Ns/m, before a gauge of 0.3 kg on a spring of 60000 N/m.",
        ),
        # In series, which is told apart.
        ({"gauge_spring_N_m": 75e3}, "the body is clamped behind a linear spring of 37500 N/m."),
        (
            {"kind": "free", "body_mass_kg": 3.0, "damping_Ns_m": 200.0},
            "a mass of 3 kg behind a linear spring of 75000 N/m with a damper of 200 Ns/m, judged by transient limits.",
        ),
    ],
)
def test_all_that_the_arm_meets_is_told(contact: dict[str, Any], said: str) -> None:
    contact = {"stiffness_N_m": 75e3} | contact
    result = bs.evaluate(control_group(**{f"contact__{key}": value for key, value in contact.items()}))
    (note,) = [note for note in result.notes if "behind a linear spring" in note]
    assert said in note


def test_a_motion_that_ends_at_a_joint_limit_says_when_and_at_which() -> None:
    """Joint 2 has 0.3 degrees left."""
    result = bs.evaluate(control_group(pose_deg=[0, 109.7, 0, -20, 0, -40, 0], motion__velocity_mm_s=[0, 0, -30]))
    rate = result.problem.start.qd[1]
    after = math.radians(0.3) / rate
    (said,) = (float(note.split()[4]) for note in result.notes if note.endswith(" s: joint 2 reaches its limit."))
    assert said == pytest.approx(after, abs=2e-3)
    # Whoever stands farther away than the arm gets is not touched.
    reach = float(result.curve.distance.max())
    untouched = math.erfc(reach / result.problem.offset_size / math.sqrt(2))
    assert result.no_contact_probability == pytest.approx(untouched, rel=1e-3)
    assert f"In {percent(result.no_contact_probability)} of cases the motion ends before contact." in result.notes


def test_joints_that_are_too_slow_for_the_speed_asked_for_are_said() -> None:
    for speed, slowed in ((-50.0, False), (-3000.0, True)):
        result = bs.evaluate(control_group(motion__velocity_mm_s=[0.0, 0.0, speed]))
        limit = result.problem.robot.velocity
        line = np.linalg.pinv(result.problem.robot.jacobian(result.problem.q)) @ [0, 0, speed / 1e3, 0, 0, 0]
        assert bool((np.abs(line) > limit).any()) == slowed
        assert any("joint-velocity limit slows the motion" in note for note in result.notes) == slowed


def test_an_arm_left_in_contact_is_noted() -> None:
    """Beside a wrist singularity it swings forward again, farther than it is followed."""
    beside = control_group(
        pose_deg=[31.92, -9.44, 50.64, 105.39, 91.72, 3.71, 0.0], motion__velocity_mm_s=[27.4, 25.1, -33.5]
    )
    result = bs.evaluate(beside)
    ticks = [5, 20]
    behind = result.curve.tick_distance[ticks]
    paths = result.curve.kernel.reaction_paths(ticks, behind.tolist())
    assert any(path[-1] > distance for distance, path in zip(behind, paths, strict=True))
    assert result.left_in_contact_probability > 0.9
    # It weakens the verdict: beside it on the terminal, the page and in JSON, sampled as well.
    (said,) = [warning for warning in result.warnings if "the reversing arm has not left the body" in warning]
    assert said in result.notes
    drawn = bs.evaluate(beside, samples=4000)
    assert drawn.left_in_contact_probability == pytest.approx(result.left_in_contact_probability, abs=0.02)
    assert any("the reversing arm has not left the body" in warning for warning in drawn.warnings)
    plain = bs.evaluate(control_group())
    assert plain.left_in_contact_probability == 0
    assert not any("reversing arm" in note for note in plain.notes)


def test_whether_an_arm_may_be_left_in_contact_is_told_without_the_contact_time() -> None:
    """The quick look says no only where the integral over all contacts is zero."""
    rng = np.random.default_rng(4)
    low, high = [-170, -100, -160, -80, -170, -100, -170], [170, 100, 160, 110, 170, 100, 170]
    left = []
    while len(left) < 5:
        pose, velocity = rng.uniform(low, high).tolist(), (40 * rng.normal(size=3)).tolist()
        try:
            result = bs.evaluate(control_group(pose_deg=pose, motion__velocity_mm_s=velocity))
        except bs.InputError:
            continue
        integral = integrated_contact_duration(result.problem, result.curve.line, result.integral)[1]
        assert result.left_in_contact_probability == integral
        left.append(integral > 0)
    assert any(left)
    assert not all(left)
