"""The detector: residuals against closed forms, alarms, blindness, and what it says of a contact."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.arrays import FloatArray
from bumpstop.detection import Detector, DetectorSettings, residual_record
from bumpstop.detection.events import FAULTS, STATES
from bumpstop.kernels import core
from bumpstop.model import Robot, inverse_dynamics
from bumpstop.recording import Recording

UR5E = Robot.load("ur5e")
DT = 0.002


def moving(robot: Robot, rows: int = 1000, dt: float = DT, seed: int = 1) -> tuple[FloatArray, ...]:
    """Times, positions, rates, accelerations and torques of a smooth motion without contact."""
    rng = np.random.default_rng(seed)
    t = dt * np.arange(rows)
    rate, phase = rng.uniform(1, 3, robot.dof), rng.uniform(0, 6, robot.dof)
    angle = t[:, None] * rate + phase
    q, qd, qdd = 0.4 * np.sin(angle), 0.4 * rate * np.cos(angle), -0.4 * rate**2 * np.sin(angle)
    return t, q, qd, qdd, inverse_dynamics(robot, q, qd, qdd)


def parabola(robot: Robot, rows: int = 500, dt: float = DT) -> tuple[FloatArray, ...]:
    """Constant accelerations, which a causal fit of degree 2 differentiates without error."""
    t = dt * np.arange(rows)
    qdd = np.ones((rows, 1)) * np.linspace(0.1, 0.4, robot.dof)
    q, qd = 0.2 + qdd * t[:, None] ** 2 / 2, qdd * t[:, None]
    return t, q, qd, qdd, inverse_dynamics(robot, q, qd, qdd)


# --- Residuals --------------------------------------------------------------------------------------------------------


def test_direct_residual_of_exact_data_is_zero_to_rounding() -> None:
    t, q, _, _, tau = parabola(UR5E)
    run = Detector(UR5E, None, [1.0] * 6).run(Recording(t=t, q=q, tau=tau))
    # Rounding of q enters the acceleration by its noise gain, 720 / (m (m^2 - 1) (m^2 - 4)) under the root, over dt^2.
    gain = math.sqrt(720 / (8 * 63 * 60)) / DT**2
    bound = 2**-52 * gain * np.abs(q).max() * np.abs(tau).max() * 8
    assert np.nanmax(np.abs(run.residual)) < bound < 1e-7
    assert run.events == ()


def test_observer_error_falls_as_the_square_of_the_sample_time() -> None:
    """With the true rates; the derivative's own error is of its own order."""
    errors = []
    for dt in (0.004, 0.002, 0.001):
        t, q, qd, _, tau = moving(UR5E, round(2 / dt), dt)
        settings = DetectorSettings(residual="observer", measured_rates=True)
        run = Detector(UR5E, None, [1e3] * 6, settings).run(Recording(t=t, q=q, qd=qd, tau=tau))
        errors.append(np.nanmax(np.abs(run.residual[t > 0.5])))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.05)


def test_observer_answers_a_step_in_closed_form() -> None:
    """Of a torque held by the motors: 1 - a^k (1 + a) / 2, k samples after the first that has it."""
    t = DT * np.arange(300)
    q = np.full((300, 6), 0.3)
    tau = np.repeat(inverse_dynamics(UR5E, q[:1], 0 * q[:1], 0 * q[:1]), 300, axis=0)
    tau[100:, 2] += 7.0
    settings = DetectorSettings(residual="observer", observer_gain_1_s=40.0)
    run = Detector(UR5E, None, [1e3] * 6, settings).run(Recording(t=t, q=q, tau=tau))
    a, k = math.exp(-40 * DT), np.arange(200)
    np.testing.assert_allclose(run.residual[100:, 2], 7 * (1 - a**k * (1 + a) / 2), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(run.residual[100:, [0, 1, 3, 4, 5]], 0, atol=1e-11)


@pytest.mark.parametrize("residual", ["direct", "observer"])
def test_sign_of_a_push(residual: str) -> None:
    """A body that pushes the arm up, against a hand moving down, raises the residual by J_v' n F with n downward."""
    q = np.array([0.1, -1.2, 1.4, -0.8, -1.5, 0.0])
    rows, normal, force = 200, np.array([0.0, 0.0, -1.0]), 30.0
    wrench = np.concatenate([-normal * force, np.zeros(3)])
    held = inverse_dynamics(UR5E, q, 0 * q, 0 * q, wrench=wrench)
    free = inverse_dynamics(UR5E, q, 0 * q, 0 * q)
    tau = np.where(np.arange(rows)[:, None] < 100, free, held)
    settings = DetectorSettings(residual=residual)  # type: ignore[arg-type]
    run = Detector(UR5E, None, [5.0] * 6, settings).run(
        Recording(t=DT * np.arange(rows), q=np.tile(q, (rows, 1)), tau=tau)
    )
    wanted = UR5E.jacobian(q)[:3].T @ normal * force
    (event,) = run.events
    # The observer has had 0.2 s: e^-10 of the torque is missing.
    np.testing.assert_allclose(run.residual[-1], wanted, rtol=1e-9 if residual == "direct" else 1e-4, atol=1e-9)
    if residual == "direct":
        assert event.t == pytest.approx(0.2)
        assert event.force_along == pytest.approx(force)
        np.testing.assert_allclose(event.force, normal * force, atol=1e-6)
    assert event.force_along > 0


def test_observer_and_direct_residual_agree_after_a_while() -> None:
    t, q, qd, _, tau = moving(UR5E)
    tau = tau + 3.0
    log = Recording(t=t, q=q, qd=qd, tau=tau)
    found = [
        Detector(UR5E, None, [1e3] * 6, DetectorSettings(residual=kind, measured_rates=True)).run(log).residual[-1]  # type: ignore[arg-type]
        for kind in ("direct", "observer")
    ]
    np.testing.assert_allclose(found[0], found[1], atol=0.3)
    np.testing.assert_allclose(found[1], 3.0, atol=0.01)


def test_residual_record_goes_into_a_scenario(tmp_path: object) -> None:
    t, q, _, _, tau = moving(UR5E, 2000)
    noise = np.random.default_rng(3).normal(size=tau.shape)
    record = residual_record(Recording(t=t, q=q, tau=tau + noise), UR5E, None, feedback_period_s=0.004)
    assert record.rows.shape == (997, 6)
    path = f"{tmp_path}/free.parquet"
    record.save(path)
    again = type(record).load(path, 6, 0.004)
    np.testing.assert_array_equal(again.rows, record.rows)
    with pytest.raises(bs.InputError, match="no multiple of the rows' period"):
        residual_record(Recording(t=t, q=q, tau=tau), UR5E, None, feedback_period_s=0.003)


# --- The two sides of the seam ----------------------------------------------------------------------------------------


def test_names_of_states_and_faults_are_those_of_cpp() -> None:
    for names, kind, count in (
        (STATES, core.DetectorState, core.detector_states),
        (FAULTS, core.SampleFault, core.sample_faults),
    ):
        assert len(names) == count
        assert tuple(member.name for member in sorted(kind, key=lambda member: member.value)) == names
        assert [member.value for member in sorted(kind, key=lambda member: member.value)] == list(range(count))
