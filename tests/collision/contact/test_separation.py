"""Ends of undetected contact that are interpolated, beside a simulation of every body."""

from __future__ import annotations

import itertools
import subprocess
from collections.abc import Callable

import numpy as np
import pytest

import bumpstop as bs
from collision.contact.elastic_cases import CASES, scenario
from cpp.builds import program_beside

STEP, STIFFNESS, MASS = 0.001, 20_000.0, 4.0
HALF_OSCILLATION = np.pi * np.sqrt(MASS / STIFFNESS) / STEP
"""In steps."""
SPEED = 5e-5
"""In metres a step."""

Separations = Callable[[np.ndarray, float], tuple[np.ndarray, np.ndarray]]


@pytest.fixture(scope="module")
def separations(tmp_path_factory: pytest.TempPathFactory) -> Separations:
    program = program_beside(__file__, "separation", tmp_path_factory.mktemp("separation"))

    def run(speed: np.ndarray, damping: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Offset, touch, end and smoothness of the bodies simulated, and of all; `speed` in every step."""
        path = np.concatenate([[0.0], np.cumsum(speed)])
        numbers = [STIFFNESS, damping, MASS, len(speed), STEP, *path]
        text = " ".join(repr(float(number)) for number in numbers)
        done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
        table = np.array([[float(value) for value in line.split()] for line in done.stdout.splitlines()])
        count = int(np.argmax(table[1:, 0] < table[:-1, 0])) + 1
        return table[:count], table[count:]

    return run


def random_speed(rng: np.random.Generator) -> np.ndarray:
    """A motion that keeps its speed, from rest or not, with changes that come at once or little by little."""
    steps = int(rng.integers(100, 700))
    speed = np.full(steps, SPEED)
    time = np.arange(steps)
    for _ in range(rng.integers(0, 4)):
        at, long = rng.integers(steps), rng.integers(1, int(3 * HALF_OSCILLATION))
        change = float(rng.choice([-1.5, -0.3, -0.05, 0.02, 0.08, 0.3, 1.0, 3.0]))
        window = (time >= at) & (time < at + long)
        speed = speed * (1 + change * window * (rng.random() < 0.5 or np.sin(np.pi * (time - at) / long)))
    if rng.random() < 0.3:
        speed = speed * (1 + rng.choice([0.01, 0.05, 0.2]) * np.sin(2 * np.pi * time / rng.uniform(5, 200)))
    if rng.random() < 0.3:
        speed = speed * np.minimum(1, (time + 1) / rng.integers(5, 300))
    return np.asarray(speed)


@pytest.mark.parametrize("damping", [0.0, 40.0, 400.0])
def test_no_body_between_those_simulated_separates_at_another_time(separations: Separations, damping: float) -> None:
    spared = 0
    for seed in range(60):
        found, every = separations(random_speed(np.random.default_rng([5, seed])), damping)
        spared += len(every) - len(found)
        assert np.isin(found[:, 0], every[:, 0]).all()
        for low, high in itertools.pairwise(found):
            between = every[(every[:, 0] > low[0]) & (every[:, 0] < high[0])]
            if not low[3]:
                assert len(between) == 0, (seed, low, high)
                continue
            # The later a body is touched the later it separates.
            end = np.concatenate([low[2:3], between[:, 2], high[2:3]])
            assert (np.diff(end) >= -1e-6).all(), (seed, low, high)
            share = (between[:, 1] - low[1]) / (high[1] - low[1])
            assert between[:, 2] == pytest.approx(low[2] + share * (high[2] - low[2]), abs=1.0), seed
    assert spared > 1000


def test_at_constant_speed_three_bodies_tell_of_all(separations: Separations) -> None:
    steps = 800
    found, every = separations(np.full(steps, SPEED), 0.0)
    assert len(every) == steps + 1
    # Those that the end of the path parts from the others are found by halving.
    assert len(found) < 30
    before = every[every[:, 1] < steps - HALF_OSCILLATION - 1]
    assert before[:, 2] - before[:, 1] == pytest.approx(HALF_OSCILLATION, rel=1e-9)


@pytest.mark.parametrize("case", ["elastic", "rigid"])
def test_nothing_is_detected_once_the_body_has_separated(case: str) -> None:
    # Residuals are large when contact ends, so the last tick before that decides how much is detected.
    free = scenario(**CASES["free body"])
    if case == "rigid":
        noise = {"detector.noise_sd_Nm": [15.0, 15.0, 11.0, 4.5, 4.5, 4.5]}
        free = free.with_values({"arm.model": "rigid", "contact.body_mass_kg": 2.0, **noise})
    integrated, sampled = bs.evaluate(free), bs.evaluate(free, samples=200_000, seed=2006)
    detected = 200_000 * (1 - sampled.undetected_probability - sampled.false_alarm_probability)
    for p in (0.5, 0.1, 0.01, 0.005):
        beyond = sampled.detection_delay.exceedance(integrated.detection_delay.quantile(1 - p))
        assert abs(beyond - p) < 4 * np.sqrt(p * (1 - p) / detected), p
