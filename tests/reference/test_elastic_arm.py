"""The reference for arms that give, against closed forms, energies and somebody else's integrator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from reference.elastic_arm import Array, Body, ElasticArm, collide, first_order

STEP = 0.001


def random_arm(rng: np.random.Generator, n: int = 3, **changes: object) -> ElasticArm:
    half = rng.normal(size=(n, n))
    arm = ElasticArm.of_servo(
        half @ half.T + np.diag(rng.uniform(0.5, 2, n)),
        rng.uniform(0.3, 2, n),
        rng.uniform(5e3, 3e4, n),
        rng.normal(size=n),
        gear_damping_ratio=0.05,
        velocity_bandwidth=rng.uniform(20, 200),
        position_gain=rng.uniform(5, 50),
        rates=rng.normal(size=n),
    )
    return replace(arm, **changes)


def free(arm: ElasticArm) -> ElasticArm:
    """Without servo and damping."""
    return replace(arm, servo_stiffness=0.0, servo_damping=0.0, gear_damping=0.0)


def line(speed: float, steps: int) -> Array:
    return speed * STEP * np.arange(steps + 1)


def stopping(speed: float, steps: int, at: int, deceleration: float) -> Array:
    t = STEP * np.arange(steps + 1)
    late = np.clip(t - at * STEP, 0, speed / deceleration)
    return speed * np.minimum(t, at * STEP) + speed * late - deceleration * late**2 / 2


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "body", [Body(stiffness=5e4), Body(stiffness=5e4, mass=2.0), Body(stiffness=5e4, mass=1.0, spring=2e4)]
)
def test_energy_comes_from_the_path_and_stays(seed: int, body: Body) -> None:
    found = collide(free(random_arm(np.random.default_rng(seed))), body, line(0.3, 120), STEP)
    assert found.peak_force > 10
    assert not found.lost.any()
    np.testing.assert_allclose(found.stored, found.work, atol=2e-6 * found.stored.max())


@pytest.mark.parametrize("seed", range(3))
def test_energy_that_is_lost_is_lost_in_the_dampers(seed: int) -> None:
    body = Body(stiffness=5e4, damping=30.0, mass=1.0, spring=2e4, spring_damping=5.0)
    found = collide(random_arm(np.random.default_rng(seed)), body, stopping(0.3, 200, 30, 4.0), STEP, offset=1e-3)
    assert found.lost[-1] > 0.01 * found.stored.max()
    assert np.all(np.diff(found.lost) >= 0)
    # Where the contact's damper meets the body its force jumps within a step.
    np.testing.assert_allclose(found.stored + found.lost, found.work, atol=1e-3 * found.stored.max())


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("mass", [None, 3.0])
def test_stiff_gears_without_servo_are_two_masses_and_a_spring(seed: int, mass: float | None) -> None:
    arm = free(random_arm(np.random.default_rng(seed), gear_stiffness=1e9))
    a = np.asarray(arm.lever)
    inertia = np.asarray(arm.mass_matrix) + np.diag(np.asarray(arm.rotor_inertia))
    m = 1 / (a @ np.linalg.solve(inertia, a))
    m = m if mass is None else m * mass / (m + mass)
    K, v = 2e4, 0.25
    steps = int(1.2 * np.pi * np.sqrt(m / K) / STEP) + 1
    found = collide(arm, Body(stiffness=K, mass=mass), line(v, steps), STEP, tiny=2e-6)
    assert found.peak_force == pytest.approx(v * np.sqrt(m * K), rel=2e-4)
    assert found.peak_time == pytest.approx(np.pi / 2 * np.sqrt(m / K), abs=2e-5)
    assert found.contact_duration == pytest.approx(np.pi * np.sqrt(m / K), rel=2e-3)


def test_an_arm_that_does_not_give_follows_its_path() -> None:
    arm = ElasticArm(
        mass_matrix=np.eye(2) * 1e9,
        rotor_inertia=1e9,
        gear_stiffness=1e9,
        gear_damping=0.0,
        servo_stiffness=0.0,
        servo_damping=0.0,
        lever=[1.0, 0.5],
    )
    path = stopping(0.2, 200, 50, 3.0)
    found = collide(arm, Body(stiffness=3e4), path, STEP, offset=2e-3)
    np.testing.assert_allclose(found.force[::50], 3e4 * np.maximum(0, path - 2e-3), rtol=1e-6, atol=1e-5)


def test_what_comes_later_changes_nothing_before() -> None:
    arm = random_arm(np.random.default_rng(5), feedforward=0.3)
    on, stop = (
        collide(arm, Body(stiffness=4e4, mass=5.0), path, STEP)
        for path in (line(0.2, 100), stopping(0.2, 100, 40, 5.0))
    )
    same = on.time <= 0.040 + 1e-9
    for name in ("force", "residual", "link", "rotor"):
        rows = getattr(on, name)[same]
        np.testing.assert_allclose(getattr(stop, name)[same], rows, rtol=0, atol=1e-10 * np.abs(rows).max())
    assert np.abs(on.force - stop.force).max() > 1


def test_nothing_happens_before_contact_and_offsets_only_delay() -> None:
    arm = random_arm(np.random.default_rng(6))
    near = collide(arm, Body(stiffness=4e4), line(0.2, 80), STEP)
    far = collide(arm, Body(stiffness=4e4), line(0.2, 100), STEP, offset=0.2 * 0.0203)
    assert far.contacts[0][0] == pytest.approx(0.0203, abs=1e-9)
    assert not far.force[far.time < 0.0203].any()
    np.testing.assert_allclose(np.interp(near.time[:3000] + 0.0203, far.time, far.force), near.force[:3000], atol=2e-3)


@pytest.mark.parametrize(
    "body",
    [
        Body(stiffness=6e4),
        Body(stiffness=2e4, damping=40.0, mass=1.5),
        Body(stiffness=8e4, damping=10.0, mass=0.5, spring=7.5e4),
    ],
)
def test_against_another_integrator(body: Body) -> None:
    arm = random_arm(np.random.default_rng(7), 4)
    v, duration, n = 0.3, 0.08, 4
    M, B, a = (np.asarray(x) for x in (arm.mass_matrix, arm.rotor_inertia, arm.lever))
    Kg, Dg, P, D = (
        np.asarray(x) for x in (arm.gear_stiffness, arm.gear_damping, arm.servo_stiffness, arm.servo_damping)
    )

    def press(t: float, y: Array) -> tuple[float, float]:
        q, qd, x, xd = y[:n], y[2 * n : 3 * n], y[4 * n], y[4 * n + 1]
        d = v * t + a @ q - x
        return d, body.stiffness * d + body.damping * (v + a @ qd - xd)

    def flow(t: float, y: Array, force: float) -> Array:
        q, th, qd, thd, (x, xd) = (*np.split(y[: 4 * n], 4), y[4 * n :])
        gear = Kg * (th - q) + Dg * (thd - qd)
        rotor = (-gear - P * th - D * thd) / B
        link = np.linalg.solve(M, gear - a * force)
        push = 0.0 if body.mass is None else (force - (body.spring or 0.0) * x) / body.mass
        return np.concatenate([qd, thd, link, rotor, [0.0 if body.mass is None else xd, push]])

    def leaves(t: float, y: Array) -> float:
        return press(t, y)[1]

    leaves.terminal, leaves.direction = True, -1
    pressed = solve_ivp(
        lambda t, y: flow(t, y, press(t, y)[1]),
        (0, duration),
        np.zeros(4 * n + 2),
        "DOP853",
        events=leaves,
        rtol=1e-10,
        atol=1e-13,
        max_step=1e-4,
        dense_output=True,
    )
    found = collide(arm, body, line(v, 80), STEP)
    t = found.time[found.time < pressed.t[-1]]
    expected = pressed.sol(t)
    for name, rows in (("link", expected[:n]), ("rotor", expected[n : 2 * n])):
        np.testing.assert_allclose(getattr(found, name)[: len(t)], rows.T, rtol=0, atol=1e-6 * np.abs(rows).max())
    forces = np.array([press(when, y)[1] for when, y in zip(t, expected.T, strict=True)])
    np.testing.assert_allclose(found.force[1 : len(t)], forces[1:], rtol=0, atol=1e-6 * forces.max())
    if pressed.t_events[0].size:
        assert found.contact_duration == pytest.approx(pressed.t_events[0][0], abs=1e-7)


def test_the_residual_is_the_contact_torque_where_nothing_swings() -> None:
    arm = random_arm(np.random.default_rng(8), gear_damping=200.0)
    found = collide(arm, Body(stiffness=5e3), stopping(0.02, 3000, 100, 1.0), STEP, tiny=1e-4)
    expected = np.asarray(arm.lever) * found.force[-1]
    np.testing.assert_allclose(found.residual[-1], expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())
    observed = first_order(found.time, found.residual, 50.0)
    np.testing.assert_allclose(observed[-1], expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())


def test_no_residual_without_contact_where_gears_are_stiff() -> None:
    """A path that is not fed forward is followed late; a detector that knows the inertia sees no contact in that."""
    arm = random_arm(np.random.default_rng(9), feedforward=0.0, gear_stiffness=1e7, gear_damping=1e3)
    found = collide(arm, Body(stiffness=1e4), stopping(0.3, 150, 20, 5.0), STEP, offset=1.0, tiny=1e-5)
    inertial = np.abs(np.asarray(arm.mass_matrix) @ np.asarray(arm.rates)) * 5.0
    # The path's bends, one a millisecond, are steps of speed that the servo answers each: a filter takes them out.
    observed = np.abs(first_order(found.time, found.residual, 100.0))
    assert np.abs(found.link).max() > 1e-4
    assert observed.max() < 0.05 * inertial.max()


def test_a_gauge_pressed_slowly_is_pad_and_spring_in_series() -> None:
    arm = random_arm(
        np.random.default_rng(10),
        mass_matrix=np.eye(3) * 1e9,
        rotor_inertia=1e9,
        servo_damping=0.0,
        servo_stiffness=0.0,
    )
    gauge = Body(stiffness=2.5e5, damping=100.0, mass=0.5, spring=7.5e4, spring_damping=100.0)
    found = collide(arm, gauge, stopping(0.01, 600, 200, 0.05), STEP, tiny=5e-5)
    series = 1 / (1 / 2.5e5 + 1 / 7.5e4)
    way = stopping(0.01, 600, 200, 0.05)[-1]
    assert found.measured_force[-1] == pytest.approx(series * way, rel=1e-4)
    assert found.force[-1] == pytest.approx(series * way, rel=1e-4)


def test_contact_may_end_and_begin_again() -> None:
    """A light face between a pad and a soft spring flies off, and the arm follows."""
    arm = random_arm(np.random.default_rng(11))
    found = collide(arm, Body(stiffness=2e5, mass=2.0, spring=1e4), line(0.3, 150), STEP)
    assert len(found.contacts) > 1
    for (_, end), (begin, _) in zip(found.contacts, found.contacts[1:], strict=False):
        apart = (found.time > end + 1e-6) & (found.time < begin - 1e-6)
        assert begin > end
        assert not found.force[apart].any()


def test_a_feedforward_through_the_motors_winds_the_gears_up_first() -> None:
    """While the path slows down steadily the links are ahead of it by M q_r'' over the gears' stiffness."""
    arm = random_arm(
        np.random.default_rng(12), feeds_motors=True, servo_stiffness=1e6, servo_damping=1e4, gear_damping=300.0
    )
    # A bend of the path a millisecond is a blow each time; here they are small beside the gears' swing.
    path = stopping(0.3, 400, 50, 0.5)
    found = collide(arm, Body(stiffness=1e4), path, STEP, offset=10.0, tiny=5e-5)
    mass, gear, rates = (np.asarray(x) for x in (arm.mass_matrix, arm.gear_stiffness, arm.rates))
    wound_up = mass @ rates * 0.5 / gear
    late = found.link[found.time > 0.3].mean(axis=0) - found.rotor[found.time > 0.3].mean(axis=0)
    np.testing.assert_allclose(late, wound_up, atol=0.02 * np.abs(wound_up).max())


def test_where_gears_are_stiff_it_does_not_matter_what_is_fed() -> None:
    path, body = stopping(0.3, 120, 20, 6.0), Body(stiffness=2e4)
    arm = random_arm(np.random.default_rng(13), gear_stiffness=3e7, gear_damping=2e3, feedforward=[1.0, 0.5, 0.8])
    direct, through = (collide(replace(arm, feeds_motors=fed), body, path, STEP, tiny=4e-6) for fed in (False, True))
    nothing = collide(replace(arm, feedforward=0.0), body, path, STEP, tiny=4e-6)
    assert through.peak_force == pytest.approx(direct.peak_force, rel=2e-3)
    assert abs(nothing.peak_force / direct.peak_force - 1) > 0.02


def test_two_levers_where_the_force_acts_elsewhere() -> None:
    """A lever twice as long in the distance alone is a spring twice as stiff against the links, at half the way."""
    arm = free(random_arm(np.random.default_rng(14)))
    a = np.asarray(arm.lever)
    twice = collide(replace(arm, gap_lever=2 * a), Body(stiffness=2e4), line(0.4, 60), STEP)
    other = collide(arm, Body(stiffness=4e4), line(0.2, 60), STEP)
    np.testing.assert_allclose(twice.force, other.force, atol=1e-6 * other.peak_force)
