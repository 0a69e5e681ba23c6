"""Recordings of arms whose drives are known: currents of a joint torque model on a given motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

import bumpstop as bs
from bumpstop.identification import JointMotion, motor_current, stiction_share
from bumpstop.joint import JointParameters, JointTorqueModel, Parameter
from bumpstop.model import inverse_dynamics, with_rotors
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.recording import Recording

Motion = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def fourier(robot: bs.Robot, seconds: float, rate: float, seed: int, rests: int = 0) -> Motion:
    """A smooth motion with five harmonics in every joint, and so many rests of half a second: t, q, qd, qdd."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1 / rate)
    middle = np.where(np.isfinite(robot.lower + robot.upper), (robot.lower + robot.upper) / 2, 0.0)
    harmonics = 0.11 * 2 * np.pi * np.arange(1, 6)[:, None]
    a, b = rng.normal(size=(2, 5, robot.dof)) * 0.5 / np.arange(1, 6)[None, :, None]
    u, du, ddu = _clock(t, rests)
    q, qd, qdd = (np.zeros((t.size, robot.dof)) for _ in range(3))
    for w, sine, cosine in zip(harmonics[:, 0], a, b, strict=True):
        s, c = np.sin(w * u)[:, None], np.cos(w * u)[:, None]
        slope, bend = w * (sine * c - cosine * s), -w * w * (sine * s + cosine * c)
        q += sine * s + cosine * c
        qd += slope * du[:, None]
        qdd += bend * du[:, None] ** 2 + slope * ddu[:, None]
    return t, q + middle, qd, qdd


def _clock(t: np.ndarray, rests: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time along the motion with its rates: it stands still for half a second ``rests`` times, without a jerk."""
    if rests == 0:
        return t, np.ones_like(t), np.zeros_like(t)
    period, still, ramp = t[-1] / rests, 0.5, 0.4
    x = np.mod(t, period)
    rise = np.clip((np.abs(x - period / 2) - still / 2) / ramp, 0, 1)
    du = rise**2 * (3 - 2 * rise)
    ddu = np.where((rise > 0) & (rise < 1), 6 * rise * (1 - rise) / ramp * np.sign(x - period / 2), 0.0)
    u = np.concatenate([[0], np.cumsum((du[1:] + du[:-1]) / 2 * np.diff(t))])
    return u, du, ddu


def drives(
    robot: bs.Robot,
    torque: np.ndarray,
    *,
    kind: str = "odd",
    friction: Mapping[str, float] | None = None,
    law: str = "power",
    hysteresis: float = 0.0,
) -> JointTorqueModel:
    """Drives that reach some 3 A at the largest of these torques (N, n), whose map bends by a few percent."""
    joints = []
    for j, joint in enumerate(robot.joints):
        B = float(np.abs(torque[:, j]).max()) / 3 + 1e-9
        figures = {"B": B, **(friction or {"D": 0.6, "F": 0.3}), "inertia": 0.4 * B / (5 + j)}
        figures |= {"hysteresis": hysteresis * B, **({"A": 0.03 * B} if kind != "linear" else {})}
        joints.append(
            JointParameters(
                name=joint.name,
                map=kind,  # type: ignore[arg-type]
                friction=law,  # type: ignore[arg-type]
                parameters={name: Parameter(value) for name, value in figures.items()},
                current_range=(-8.0, 8.0),
            )
        )
    return JointTorqueModel(robot=robot.name, created_from="a test", unit="A", joints=tuple(joints))


def driven(
    robot: bs.Robot,
    motion: Motion,
    model: JointTorqueModel,
    seed: int,
    *,
    noise: float = 0.05,
    lost: float = 0.01,
    encoder: float = 1e-5,
    gravity: tuple[float, float, float] = STANDARD_GRAVITY,
) -> Recording:
    """What such an arm records: noise correlated by 0.8 a sample [A], encoder noise [rad], lost samples."""
    from scipy.signal import lfilter

    t, q, qd, qdd = motion
    rng = np.random.default_rng(seed)
    torque = inverse_dynamics(with_rotors(robot, 0.0), q, qd, qdd, gravity=gravity)
    current = np.empty_like(torque)
    for j, joint in enumerate(model.joints):
        held = stiction_share(qd[:, j], joint.rest_speed)
        current[:, j] = motor_current(joint, JointMotion(torque[:, j], qd[:, j], qdd[:, j], held))
    current += noise * lfilter([0.6], [1, -0.8], rng.normal(size=current.shape), axis=0)
    kept = rng.random(t.size) >= lost
    kept[[0, -1]] = True
    return Recording(t=t[kept], q=(q + encoder * rng.normal(size=q.shape))[kept], current=current[kept])


def planted(robot: bs.Robot, motion: Motion, seed: int, **options: object) -> tuple[JointTorqueModel, Recording]:
    """A model made for a motion, and what the arm records of it."""
    model = drives(robot, inverse_dynamics(with_rotors(robot, 0.0), *motion[1:]))
    return model, driven(robot, motion, model, seed, **options)  # type: ignore[arg-type]


def z_scores(found: JointTorqueModel, truth: JointTorqueModel) -> Sequence[float]:
    """Errors of all fitted parameters in standard errors."""
    scores = []
    for own, planted_joint in zip(found.joints, truth.joints, strict=True):
        for name, parameter in own.parameters.items():
            if parameter is not None and parameter.standard_error is not None:
                scores.append((parameter.value - planted_joint.value(name)) / parameter.standard_error)
    return scores
