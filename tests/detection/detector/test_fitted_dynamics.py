"""Fitted dynamics in a loop: the same residual as the fit's own torques at the causal motion, sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bumpstop as bs
from bumpstop import _native
from bumpstop.detection import Detector, DetectorSettings, Thresholds, detect
from bumpstop.detection.loop.detector_file import describe_detector
from bumpstop.errors import InputError
from bumpstop.identification import DynamicsModel, identify_dynamics
from bumpstop.identification.dynamics.regressor_columns import column_names
from bumpstop.identification.segments.motion import UniformMotion
from bumpstop.recording import Recording
from bumpstop.signal import causal_derivatives
from detection.moving_arms import UR5E, moving

DT = 0.004
WINDOW_S = 0.04
ROWS = 400


def planted(seed: int, *, essential: bool, gains: bool = False) -> DynamicsModel:
    """A fit with every kind of column: shared motors, bent friction, friction of loads, two sets of values."""
    draw = np.random.default_rng(seed)
    top, loaded, couplings = np.full(7, np.nan), (1, 4), (((4, 1.0), (5, -0.7)),)
    top[[0, 5, 6]] = 2.0, 1.5, 1.0
    presliding = np.full(7, np.nan)
    presliding[[1, 3, 6]] = 0.01, 0.03, 0.2
    names = column_names(UR5E, couplings, top, loaded)
    values = draw.normal(0, 1, len(names))
    for k, name in enumerate(names):
        if name.startswith("load"):
            values[k] = draw.uniform(0, 0.1)
    return DynamicsModel(
        robot=UR5E,
        columns=tuple(range(len(names))),
        values=values,
        predicting=np.where(draw.random(len(names)) < 0.6, values * draw.uniform(0.8, 1.2), 0.0) if essential else None,
        predicted_by_all=(0, 3) if essential else (),
        sign_speed=draw.uniform(0.01, 0.1, 6),
        presliding=presliding,
        top_speed=top,
        couplings=couplings,
        loaded=loaded,
        cutoff_hz=10.0,
        gravity=(1.0, -2.0, -9.0),
        gains=draw.uniform(5, 15, 6) if gains else None,
    )


def causal_motion(t: np.ndarray, q: np.ndarray, gravity: tuple[float, float, float]) -> UniformMotion:
    window = DetectorSettings(window_s=WINDOW_S).window_samples(DT)
    qd, qdd = causal_derivatives(t, q, window=window, degree=2)
    return UniformMotion(t, q, qd, qdd, 1 / DT, gravity)


@pytest.mark.parametrize(("seed", "essential", "gains"), [(1, False, False), (2, True, False), (3, True, True)])
def test_the_loop_has_the_residual_of_the_fit(seed: int, essential: bool, gains: bool) -> None:
    model = planted(seed, essential=essential, gains=gains)
    t, q, _, _, tau = moving(UR5E, ROWS, DT, seed)
    signal = tau if model.gains is None else tau / model.gains
    settings = DetectorSettings(window_s=WINDOW_S, limit_margin=1e3, frozen_s=np.inf, causal=True)
    run = Detector(UR5E, model, np.full(6, 1e9), settings).run_rows(t, q, signal)
    motion = causal_motion(t, q, model.gravity)
    seen = ~run.no_data
    assert seen.sum() == ROWS - settings.window_samples(DT) + 1
    # Friction that builds up begins at the loop's first motion.
    wanted = tau[seen] - model.torque(motion.part(seen))
    np.testing.assert_allclose(run.residual[seen], wanted, rtol=1e-9, atol=1e-8 * np.abs(wanted).max())
    # What a C++ loop reads gives the same to the last digit.
    text = describe_detector(Detector(UR5E, model, np.full(6, 1e9), replace(settings, period_s=DT)))
    found, error = _native.read_detector(text)
    assert found is not None, error
    again = found.detector().run(t, q, signal, None, 0.5)[0]
    np.testing.assert_array_equal(again[seen], run.residual[seen])


def test_friction_that_builds_up_begins_anew_behind_a_gap() -> None:
    """What the joints did meanwhile is not known: the loop goes on as one that begins there."""
    model = planted(5, essential=False)
    t, q, _, _, tau = moving(UR5E, ROWS, DT, 5)
    t[200:] += 1.0
    settings = DetectorSettings(window_s=WINDOW_S, limit_margin=1e3, frozen_s=np.inf, causal=True)

    def residual(rows: slice, own: DynamicsModel = model) -> np.ndarray:
        found: np.ndarray = (
            Detector(UR5E, own, np.full(6, 1e9), settings).run_rows(t[rows], q[rows], tau[rows]).residual
        )
        return found

    both, alone = residual(slice(None)), residual(slice(200, None))
    at_once = residual(slice(200, None), replace(model, presliding=None))
    np.testing.assert_allclose(both[200:], alone, rtol=1e-9, atol=1e-9)
    assert np.isfinite(alone[20:]).all()
    assert np.nanmax(np.abs(alone - at_once)) > 0.1


def test_the_observer_follows_a_step_of_torque_as_it_says() -> None:
    """The momentum of the fit's own torques leaves little; a step shows as 1 - exp(-K t)."""
    gain, at = 50.0, 200
    model = replace(planted(4, essential=True), loaded=(), sign_speed=np.full(6, 0.3), presliding=None, top_speed=None)
    names = column_names(UR5E, model.couplings)
    rotors = {name: 0.3 for name in names if name.startswith("rotor")}
    true = np.array([rotors.get(name, value) for name, value in zip(names, np.zeros(len(names)), strict=True)])
    true[: 10 * 6] = _inertial_of(UR5E)
    model = replace(model, columns=tuple(range(len(names))), values=true, predicting=None, predicted_by_all=())
    dt = 0.001
    t, q, qd, qdd, _ = moving(UR5E, 2000, dt, 5, pace=0.3)
    tau = model.torque(UniformMotion(t, q, qd, qdd, 1 / dt, model.gravity))
    tau[at:] += 7.0
    settings = DetectorSettings(
        residual="observer", observer_gain_1_s=gain, measured_rates=True, window_s=0.004, limit_margin=1e3,
        frozen_s=np.inf, causal=True,
    )  # fmt: skip
    run = Detector(UR5E, model, np.full(6, 1e9), settings).run_rows(t, q, tau, qd=qd)
    assert np.nanmax(np.abs(run.residual[:at])) < 0.02
    a = np.exp(-gain * dt)
    shown = 7.0 * (1 - a ** np.arange(2000 - at) * (1 + a) / 2)
    np.testing.assert_allclose(run.residual[at:], np.tile(shown[:, None], 6), atol=0.03)


def _inertial_of(robot: bs.Robot) -> np.ndarray:
    found = []
    for joint in robot.joints:
        assert joint.inertia is not None
        m, c = joint.inertia.mass, np.array(joint.inertia.center)
        i = np.array(joint.inertia.tensor) + m * ((c @ c) * np.eye(3) - np.outer(c, c))
        found += [m, *(m * c), i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
    return np.array(found)


def _log(seed: int, rows: int = 3000) -> Recording:
    t, q, _, _, tau = moving(UR5E, rows, DT, seed, pace=0.4)
    return Recording(t=t, q=q, tau=tau + np.random.default_rng(seed).normal(0, 0.2, tau.shape))


def test_a_planted_collision_is_found_where_it_is() -> None:
    """Twelve newtons on the tip along y; what the loop says of the force is that, within its noise."""
    model = identify_dynamics([_log(1, 1500)], UR5E, cutoff_hz=25.0).model
    settings = DetectorSettings(causal=True, arming_delay_s=0.1, direction=(0.0, 1.0, 0.0))
    free = detect(_log(2), UR5E, model, np.full(6, 1e6), settings)
    limits = Thresholds(1.5 * np.nanmax(np.abs(free.residual), axis=0))
    log = _log(3)
    assert log.tau is not None
    force = np.array([0.0, 40.0, 0.0])
    tau = log.tau.copy()
    for row in range(1500, 1750):
        tau[row] += UR5E.jacobian(log.q[row])[:3].T @ force
    run = detect(replace(log, tau=tau), UR5E, model, limits, settings)
    assert [event for event in run.events if event.t < 1500 * DT] == []
    event = run.events[0]
    assert 1500 * DT <= event.t < 1510 * DT
    assert event.force_along == pytest.approx(40.0, abs=8.0)


def test_what_cannot_be_is_refused() -> None:
    model = planted(1, essential=False)
    with pytest.raises(InputError, match="model: is for 6 joints; panda has 7"):
        Detector(bs.Robot.load("panda"), model, np.full(7, 10.0))
    with pytest.raises(InputError, match="model_errors"):
        Detector(UR5E, model, Thresholds(np.full(6, 10.0), model_errors=1.0))
    text = describe_detector(Detector(UR5E, model, np.full(6, 10.0), DetectorSettings(period_s=DT)))
    for broken in (
        text.replace("fitted_gain", "fitted_gains"),
        "\n".join(line for line in text.splitlines() if not line.startswith("fitted_by_all")),
        text.replace("fitted_link all", "fitted_link none", 1),
        text.replace("fitted_motor all", "fitted_motor all nan", 1),
        text.replace("fitted_presliding ", "fitted_presliding 1.0 "),
        text.replace("fitted_presliding ", "fitted_presliding -1.0 #"),
        text.replace("fitted_presliding 0.0", "fitted_presliding -1.0"),
        text.replace("fitted_presliding 0.0", "fitted_presliding inf"),
        text.replace("fitted_link all", "fitted_presliding 0 0 0 0 0 0 0\nfitted_link all", 1),
    ):
        found, error = _native.read_detector(broken)
        assert found is None
        assert "fitted" in error
