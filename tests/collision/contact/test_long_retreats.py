"""Collisions that stay undetected for long: refused by name before their retreats take gigabytes, else exact."""

from __future__ import annotations

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision import evaluate_batch
from bumpstop.collision.problem import CollisionProblem
from bumpstop.study.speed.motion_duration import duration_s
from cli.support import EXAMPLE
from collision.contact.elastic_cases import scenario

# A millimetre a second presses for a minute what no threshold detects.
SLOW = scenario(
    motion={"velocity_mm_s": [0, 0, -1], "duration_s": 60.0},
    contact={"stiffness_N_m": 1000.0},
    detector={"thresholds_Nm": [900.0] * 6, "noise_sd_Nm": 10.0},
    reaction={"kind": "reverse"},
)


def test_they_are_refused_before_they_take_the_memory() -> None:
    problem = CollisionProblem.from_scenario(SLOW)
    for refused in (
        lambda: bs.evaluate(SLOW),
        lambda: bs.evaluate(SLOW, samples=10),
        lambda: evaluate_batch(problem, problem.q[None], problem.velocity[None]),
    ):
        with pytest.raises(bs.InputError, match=r"^motion\.duration_s: collisions stay undetected for so long"):
            refused()
    assert not np.isnan(bs.evaluate(SLOW.with_values({"reaction.kind": "stop"})).undetected_probability)


def test_studies_follow_slow_arms_no_longer_than_they_can_be() -> None:
    short = SLOW.with_values({"motion.duration_s": 5.0})
    longest = duration_s(short, 0.1)
    assert 5.0 < longest < 50.0
    result = bs.evaluate(short.with_values({"motion.duration_s": longest}))
    assert result.undetected_probability == pytest.approx(1.0)
    # Nothing is kept of a stop, or of a spring alone.
    assert duration_s(short.with_values({"reaction.kind": "stop"}), 0.1) == 50.0
    assert duration_s(short.with_values({"arm.model": "rigid"}), 0.1) == 50.0


@pytest.mark.parametrize("kind", ["reverse", "stop"])
def test_detections_over_hundreds_of_cycles_are_those_of_a_spring_alone(kind: str) -> None:
    # A spring has a closed form. With next to no damping the same contacts are simulated, at few of the cycles.
    keys = {"motion.velocity_mm_s": [0, 0, -2.0], "contact.stiffness_N_m": 4000.0, "reaction.kind": kind}
    spring = bs.load_scenario(EXAMPLE).with_values(keys)
    ours, simulated = bs.evaluate(spring), bs.evaluate(spring.with_values({"contact.damping_Ns_m": 1e-6}))
    assert spring.detector.feedback_period_s * 300 < ours.detection_delay.mean
    assert simulated.peak_force.mean == pytest.approx(ours.peak_force.mean, rel=1e-8)
    assert simulated.peak_force.sd == pytest.approx(ours.peak_force.sd, rel=1e-7)
    for p in (0.01, 0.5, 0.99, 0.9999):
        assert simulated.peak_force.quantile(p) == pytest.approx(ours.peak_force.quantile(p), rel=5e-7)
        if kind == "reverse":
            assert simulated.contact_duration is not None
            assert ours.contact_duration is not None
            theirs = simulated.contact_duration.quantile(p)
            assert theirs == pytest.approx(ours.contact_duration.quantile(p), rel=2e-6)
