"""The library's contact dynamics beside the reference simulator's, which takes tiny steps and shares no code."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from cpp.builds import program_beside
from reference.elastic_arm import Array, Body, ElasticArm, collide

STEP = 0.001


@dataclass(frozen=True)
class Found:
    force: Array
    peak: Array
    lasting: Array
    since: Array
    residual: Array


Simulate = Callable[[ElasticArm, Body, Array, float], Found]


@pytest.fixture(scope="module")
def simulate(tmp_path_factory: pytest.TempPathFactory) -> Simulate:
    program = program_beside(__file__, "contact_dynamics", tmp_path_factory.mktemp("contact"))

    def run(arm: ElasticArm, body: Body, path: Array, offset: float) -> Found:
        mass = np.asarray(arm.mass_matrix, dtype=float)
        n = len(mass)
        per_joint = [
            np.broadcast_to(np.asarray(value, dtype=float), (n,))
            for value in (
                arm.rotor_inertia,
                arm.gear_stiffness,
                arm.gear_damping,
                arm.servo_stiffness,
                arm.servo_damping,
                arm.feedforward,
                arm.lever,
                0.0 if arm.rates is None else arm.rates,
            )
        ]
        numbers = [n, len(path) - 1, STEP, offset, float(arm.feeds_motors)]
        numbers += [body.stiffness, body.damping, body.mass or 0.0, body.spring or 0.0]
        numbers += [*mass.ravel(), *np.concatenate(per_joint), *path]
        text = " ".join(repr(float(number)) for number in numbers)
        done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
        table = np.array([[float(value) for value in line.split()] for line in done.stdout.splitlines()])
        return Found(table[:, 0], table[:, 1], table[:, 2], table[:, 3], table[:, 4:])

    return run


def random_arm(rng: np.random.Generator) -> ElasticArm:
    n = int(rng.integers(1, 8))
    half = rng.normal(size=(n, n))

    def spread(low: float, high: float, *shape: int) -> Array:
        return np.exp(rng.uniform(np.log(low), np.log(high), shape))

    return ElasticArm.of_servo(
        half @ half.T / n + np.diag(spread(0.05, 2.0, n)),
        spread(0.1, 3.0, n),
        spread(2e3, 5e4, n),
        rng.normal(size=n) * 0.5,
        gear_damping_ratio=float(rng.uniform(0, 0.2)),
        velocity_bandwidth=spread(10, 300, n),
        position_gain=spread(1, 50, n),
        feedforward=rng.choice([0.0, 0.4, 1.0], n),
        rates=rng.normal(size=n) * 2,
    )


def random_path(rng: np.random.Generator) -> Array:
    """Straight, then slowing down; some turn back."""
    t = STEP * np.arange(201)
    speed, at, deceleration = rng.uniform(0.03, 0.5), STEP * int(rng.integers(5, 80)), rng.uniform(1, 15)
    late = np.maximum(t - at, 0)
    if rng.random() < 0.5:
        late = np.minimum(late, speed / deceleration)
    return np.asarray(speed * np.minimum(t, at) + speed * late - deceleration * late**2 / 2)


@pytest.mark.parametrize("seed", range(24))
@pytest.mark.parametrize("kind", ["clamped", "damped", "gauge", "free"])
def test_force_and_residual(simulate: Simulate, kind: str, seed: int) -> None:
    rng = np.random.default_rng([seed, len(kind)])
    # In a reaction what is fed forward has to wind up the gears.
    arm, path = replace(random_arm(rng), feeds_motors=seed % 2 == 1), random_path(rng)
    stiffness, offset = float(np.exp(rng.uniform(np.log(5e3), np.log(1.5e5)))), float(rng.uniform(0, 0.5 * path.max()))
    bodies = {
        "clamped": Body(stiffness=stiffness),
        "damped": Body(stiffness=stiffness, damping=float(rng.uniform(1, 60))),
        "gauge": Body(stiffness=3 * stiffness, damping=20.0, mass=float(rng.uniform(0.2, 2)), spring=stiffness),
        "free": Body(stiffness=stiffness, mass=float(rng.uniform(0.5, 60))),
    }
    expected = collide(arm, bodies[kind], path, STEP, offset=offset)
    found = simulate(arm, bodies[kind], path, offset)
    parts = round(STEP / (expected.time[1] - expected.time[0]))
    rows = slice(parts, None, parts)
    ends = [int(end / STEP) for _, end in expected.contacts if np.isfinite(end)]
    first, until = (ends[0] if ends else len(found.force)), len(found.force)
    # A body that nothing holds is gone when it has separated; whether the reference's is met again is its own affair.
    until = first if kind == "free" else until
    peak = expected.force.max()
    assert peak > 0
    force = expected.force[rows][:until]
    np.testing.assert_allclose(found.force[:first], force[:first], rtol=0, atol=1e-6 * peak)
    # A body that is grazed again is met a few microseconds sooner or later: the way there is interpolated.
    np.testing.assert_allclose(found.force[:until], force, rtol=0, atol=5e-3 * peak)
    highest = np.maximum.accumulate(expected.force)[rows][:until]
    # Greatest forces within a step are interpolated, and those of dampers begin with a leap.
    within = 2e-3 if bodies[kind].damping else 2e-4
    np.testing.assert_allclose(found.peak[:until], highest, rtol=0, atol=within * peak)
    torque = expected.residual[rows][:until]
    touched = found.since[:until] > 0
    scale = np.abs(torque).max()
    np.testing.assert_allclose(found.residual[:until][touched], torque[touched], rtol=0, atol=1e-2 * scale)
    np.testing.assert_allclose(
        found.residual[:first][touched[:first]], torque[:first][touched[:first]], rtol=0, atol=1e-5 * scale
    )


def test_an_even_acceleration_shows_no_residual(simulate: Simulate) -> None:
    """Steps of the reference's speed made it a tenth of the torque that the acceleration takes."""
    rng = np.random.default_rng(8)
    arm = random_arm(rng)
    assert np.unique(arm.feedforward).size > 1
    arm = replace(arm, servo_stiffness=20 * np.asarray(arm.servo_damping))
    path = 0.5 * (STEP * np.arange(1501)) ** 2
    found = simulate(arm, Body(stiffness=1e-3), path, 0.0)
    taken = np.abs(np.asarray(arm.mass_matrix) @ np.asarray(arm.rates)).max()
    assert np.abs(found.residual[-1]).max() < 0.02 * taken


def test_time_in_contact(simulate: Simulate) -> None:
    rng = np.random.default_rng(5)
    arm = random_arm(rng)
    path = 0.2 * STEP * np.arange(121)
    body = Body(stiffness=5e4, mass=2.0)
    expected, found = collide(arm, body, path, STEP), simulate(arm, body, path, 0.0)
    assert found.since[-1] == pytest.approx(expected.contact_duration, rel=1e-4)


@pytest.mark.parametrize("seed", range(8))
def test_lasting_force_from_within_a_step(simulate: Simulate, seed: int) -> None:
    """The force falls when the transient phase ends, 0.5 s after a touch between two steps."""
    rng = np.random.default_rng([9, seed])
    arm, body = random_arm(rng), Body(stiffness=float(rng.uniform(1e4, 1e5)))
    t = STEP * np.arange(601)
    # The arm turns back slowly enough to press until the end.
    turn = float(rng.uniform(0.4, 0.48))
    path = np.where(t < turn, 0.1 * t, 0.1 * turn - 0.3 * (t - turn))
    offset = 0.1 * STEP * float(rng.uniform(0, 1))
    expected, found = collide(arm, body, path, STEP, offset=offset), simulate(arm, body, path, offset)
    end = expected.contacts[0][0] + 0.5
    greatest = max(expected.force[expected.time >= end].max(), np.interp(end, expected.time, expected.force))
    assert found.lasting[-1] == pytest.approx(greatest, rel=1e-5)
