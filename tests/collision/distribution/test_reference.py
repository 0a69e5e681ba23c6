"""Schroeder's chapter 6 in the standard pose, as an independent scalar transcription of its simulator worked it out.

Columns: speed mm/s, mean, sd, median, p95, p99, force at detection, then P(over the force limit), P(over the pressure
limit with 1 cm²) and with 2 cm². 10 000 runs a row.
"""

from __future__ import annotations

import math

import pytest

import bumpstop as bs
from collision.cases import control_group

RUNS = 10_000
ROWS = {
    ("hand_finger", 10): (25.28, 3.48, 25.48, 30.71, 32.53, 23.30, 0.0, 0.0, 0.0),
    ("hand_finger", 25): (39.45, 4.47, 39.56, 46.70, 49.11, 26.80, 0.0, 0.0, 0.0),
    ("hand_finger", 50): (81.51, 6.06, 81.50, 91.40, 95.17, 30.77, 0.0, 1.0, 0.0),
    ("hand_finger", 75): (148.43, 7.92, 148.34, 161.43, 165.40, 34.67, 0.9623, 1.0, 1.0),
    ("hand_finger", 100): (239.73, 9.93, 239.57, 255.94, 260.34, 38.37, 1.0, 1.0, 1.0),
    ("lower_arm_wrist", 10): (22.64, 3.04, 22.84, 27.25, 28.94, 21.59, 0.0, 0.0, 0.0),
    ("lower_arm_wrist", 25): (30.95, 3.75, 31.12, 36.88, 38.96, 24.21, 0.0, 0.0, 0.0),
    ("lower_arm_wrist", 50): (54.19, 4.67, 54.27, 61.66, 64.51, 27.15, 0.0, 0.8127, 0.0),
    ("lower_arm_wrist", 75): (89.94, 5.44, 89.93, 98.82, 102.00, 29.31, 0.0, 1.0, 0.0282),
    ("lower_arm_wrist", 100): (138.61, 6.34, 138.60, 149.01, 152.80, 31.30, 0.0001, 1.0, 1.0),
}


@pytest.mark.parametrize("samples", [None, 20_000], ids=["exact", "sampled"])
@pytest.mark.parametrize(("body", "speed"), list(ROWS))
def test_row(body: str, speed: int, samples: int | None) -> None:
    mean, sd, median, p95, p99, at_detection, *shares = ROWS[body, speed]
    scenario = control_group(contact__body=body, motion__velocity_mm_s=[0, 0, -speed])
    result = bs.evaluate(scenario, samples=samples, seed=speed)
    force = result.peak_force
    # The rows have a sampling error of their own, and so have ours where they are sampled.
    error = sd * math.sqrt(1 / RUNS + (1 / samples if samples else 0))
    assert force.mean == pytest.approx(mean, abs=max(0.005 * mean, 4.5 * error))
    assert force.mean == pytest.approx(mean, rel=0.01)
    assert force.sd == pytest.approx(sd, rel=0.03)
    assert force.quantile(0.5) == pytest.approx(median, abs=6 * error)
    assert force.quantile(0.95) == pytest.approx(p95, abs=10 * error)
    assert force.quantile(0.99) == pytest.approx(p99, abs=18 * error)
    assert result.force_at_detection.mean == pytest.approx(at_detection, abs=5 * error)
    limits = result.problem.limits
    assert limits is not None
    assert limits.pressure_N_cm2 is not None
    for limit, share in zip((limits.force_N, limits.pressure_N_cm2, 2 * limits.pressure_N_cm2), shares, strict=True):
        ours = force.exceedance(limit)
        spread = math.sqrt(max(ours * (1 - ours), 1 / RUNS) * (1 / RUNS + (1 / samples if samples else 0)))
        assert share == pytest.approx(ours, abs=4.5 * spread)


def test_the_sources_29_of_1000() -> None:
    """Lower arm, downward, 75 mm/s, 2 cm²: Schroeder (2013) counted 29 of its 1000 runs over the pressure limit."""
    scenario = control_group(contact__body="lower_arm_wrist", contact__area_cm2=2.0, motion__velocity_mm_s=[0, 0, -75])
    over = bs.evaluate(scenario).verdict.p_over_pressure
    assert over is not None
    assert abs(29 - 1000 * over) < 2 * math.sqrt(1000 * over * (1 - over))


def test_lateral_motion_is_felt_by_joints_1_and_3_alike_and_more_often_by_both_as_speed_grows() -> None:
    laws = [bs.evaluate(control_group(motion__velocity_mm_s=[0, speed, 0])) for speed in (10, 25, 50, 100)]
    both = [result.multi_joint_probability for result in laws]
    assert both == sorted(both)
    assert both[0] == pytest.approx(0.15, abs=0.01)
    for result in laws:
        one, _, three, *rest = result.trigger_joint_probability
        assert one == pytest.approx(three, rel=0.1)
        assert max(rest) < 0.01
