"""The current of a motor that a joint model wants for a motion: its torque law turned round, with derivatives.

:class:`~bumpstop.joint.JointTorqueModel` gives torque from current. Current is what a drive measures with noise, and
torque, rate and acceleration follow from the motion with hardly any, so a fit compares currents: a noisy regressor
would shrink the map's coefficients.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.joint.friction_law import OF_FRICTION
from bumpstop.joint.parameters import OF_MAP, JointParameters

# Slope of the map below this share of B: it has no inverse worth the name, and another value is tried.
_MIN_SLOPE = 0.02


@dataclass(frozen=True, eq=False)
class JointMotion:
    """What one joint did, and the torque that took.

    Attributes:
        torque: (N,) that the joint gives to the arm, without reflected inertia [Nm or N].
        qd: (N,) [rad/s or m/s].
        qdd: (N,) [rad/s2 or m/s2].
        held: (N,) share of hysteresis that acts, with the sign of the last motion, -1 to 1.
    """

    torque: FloatArray
    qd: FloatArray
    qdd: FloatArray
    held: FloatArray

    def rows(self, which: Any) -> JointMotion:
        """Some of the rows."""
        return JointMotion(self.torque[which], self.qd[which], self.qdd[which], self.held[which])


def stiction_share(qd: FloatArray, rest_speed: float, moving_rows: npt.NDArray[np.bool_] | None = None) -> FloatArray:
    """Share of hysteresis that acts at each row, with the sign of the last motion (eqs 2.22 and 2.23).

    All of it up to ``rest_speed``, nothing from twice that on, none before the first motion; as
    :class:`~bumpstop.joint.JointTorqueModel` has it.

    Args:
        qd: (N,) rates in time [rad/s].
        rest_speed: [rad/s].
        moving_rows: (N,) rows whose motion sets the hysteresis; default: all.
    """
    speed = np.abs(qd)
    at_rest = np.clip(2 - speed / rest_speed, 0.0, 1.0)
    moved = at_rest == 0 if moving_rows is None else (at_rest == 0) & moving_rows
    last = np.maximum.accumulate(np.where(moved, np.arange(qd.size), -1))
    direction = np.where(last >= 0, np.sign(qd[last]), 0.0)
    share: FloatArray = direction * at_rest
    return share


@dataclass(frozen=True)
class DriveModel:
    """A map and a friction law, and which of their parameters are free.

    Attributes:
        map: of joint current to torque; ``"unknown_gain"`` stands for currents proportional to torque and acceleration,
            for a joint whose gain is not identifiable.
        friction: how friction depends on the rate.
        names: of the free parameters, in the order of the columns of derivatives.
        fixed: values of the others; those named nowhere are zero.
        rest_speed: below it sgn(qd) is a line [rad/s].
    """

    map: str
    friction: str
    names: tuple[str, ...]
    fixed: Mapping[str, float]
    rest_speed: float

    @classmethod
    def of(
        cls, kind: str, friction: str, rest_speed: float, fixed: Mapping[str, float], *, hysteresis: bool
    ) -> DriveModel:
        """All parameters of a map and a friction law but the fixed ones."""
        own = ("torque", "acceleration") if kind == "unknown_gain" else (*OF_MAP[kind], "inertia")
        own = (*own, *OF_FRICTION[friction], *(("hysteresis",) if hysteresis and kind != "unknown_gain" else ()))
        return cls(kind, friction, tuple(name for name in own if name not in fixed), dict(fixed), rest_speed)

    def current(self, values: FloatArray, motion: JointMotion) -> tuple[FloatArray, FloatArray]:
        """Motor current (N,) and its derivatives (N, k) with respect to the free parameters."""
        p = {**self.fixed, **dict(zip(self.names, values.tolist(), strict=True))}
        derivative: dict[str, FloatArray] = {}
        sign = np.clip(motion.qd / self.rest_speed, -1.0, 1.0)
        joint_current = self._joint_current(p, motion, sign, derivative)
        wanted = joint_current + self._friction(p, motion, sign, derivative)
        if self.friction == "load_dependent":
            # i - sgn(qd) load |i| = wanted, whose sign is that of i as the load is below one.
            loaded = sign * np.sign(wanted)
            turn = 1 / (1 - p.get("load", 0.0) * loaded)
            wanted = wanted * turn
            derivative = {name: column * turn for name, column in derivative.items()}
            derivative["load"] = wanted * loaded * turn
        columns = [derivative[name] for name in self.names]
        return wanted, np.stack(columns, axis=1) if columns else np.empty((wanted.size, 0))

    def _joint_current(
        self, p: Mapping[str, float], motion: JointMotion, sign: FloatArray, derivative: dict[str, FloatArray]
    ) -> FloatArray:
        if self.map == "unknown_gain":
            derivative["torque"], derivative["acceleration"] = motion.torque, motion.qdd
            return p["torque"] * motion.torque + p["acceleration"] * motion.qdd
        A, B = p.get("A", 0.0), p["B"]
        wanted = motion.torque + p.get("inertia", 0.0) * motion.qdd + p.get("hysteresis", 0.0) * motion.held
        current, slope, square = inverse_map(self.map, A, B, wanted, sign)
        derivative["inertia"], derivative["hysteresis"] = motion.qdd / slope, motion.held / slope
        derivative["B"], derivative["A"] = -current / slope, -square / slope
        return current

    def _friction(
        self, p: Mapping[str, float], motion: JointMotion, sign: FloatArray, derivative: dict[str, FloatArray]
    ) -> FloatArray:
        speed = np.abs(motion.qd)
        if self.friction == "power":
            least = np.log(np.maximum(speed, self.rest_speed))
            derivative["D"] = sign * np.exp(p["F"] * least)
            derivative["F"] = p["D"] * derivative["D"] * least
            return p["D"] * derivative["D"]
        derivative["coulomb"], derivative["viscous"] = sign, motion.qd
        friction = p["coulomb"] * sign + p["viscous"] * motion.qd
        if self.friction == "stribeck":
            ratio = speed / p["stribeck_speed"]
            derivative["stribeck"] = sign * np.exp(-(ratio**2))
            derivative["stribeck_speed"] = p["stribeck"] * derivative["stribeck"] * 2 * ratio**2 / p["stribeck_speed"]
            friction = friction + p["stribeck"] * derivative["stribeck"]
        return friction


def inverse_map(
    kind: str, A: float, B: float, torque: FloatArray, sign: FloatArray | float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Joint current of a torque, the map's slope there, and what A multiplies; (N,) each.

    The current's derivatives by A, B and torque are -(what A multiplies), -current and 1, each over the slope.
    The slope is kept from falling below a small share of B, where the map would have no inverse.
    """
    if kind == "linear" or A == 0:
        current = torque / B
        square = np.abs(current) * current if kind != "load_dependent" else -sign * current**2
        return current, np.full_like(torque, B), square
    if kind == "odd":
        slope = np.sqrt(np.maximum(B * B + 4 * A * np.abs(torque), (_MIN_SLOPE * B) ** 2))
        current = 2 * torque / (B + slope)
        return current, slope, np.abs(current) * current
    slope = np.sqrt(np.maximum(B * B - 4 * A * sign * torque, (_MIN_SLOPE * B) ** 2))
    current = 2 * torque / (B + slope)
    return current, slope, -sign * current**2


def motor_current(joint: JointParameters, motion: JointMotion) -> FloatArray:
    """Motor current (N,) with which ``joint`` would give the torque of ``motion``; NaN where its gain is unknown.

    The inverse of :meth:`JointTorqueModel.torque`, outside the fitted range along the map's tangent.
    """
    sign = np.clip(motion.qd / joint.rest_speed, -1.0, 1.0)
    if joint.parameters["B"] is None:
        return np.full_like(motion.qd, np.nan)
    A, B = joint.value("A"), joint.value("B")
    wanted = motion.torque + joint.value("inertia") * motion.qdd + joint.value("hysteresis") * motion.held
    current, _, _ = inverse_map(joint.map, A, B, wanted, sign)
    if joint.current_range is not None and A != 0:
        for edge, beyond in zip(joint.current_range, (np.less, np.greater), strict=True):
            bend = A * abs(edge) if joint.map == "odd" else -sign * A * edge
            tangent = edge + (wanted - edge * (B + bend)) / (B + 2 * bend)
            current = np.where(beyond(tangent, edge), tangent, current)
    values = {name: joint.value(name) for name in joint.parameters}
    law = DriveModel(
        "unknown_gain", joint.friction, (), {**values, "torque": 1.0, "acceleration": 0.0}, joint.rest_speed
    )
    still = JointMotion(current, motion.qd, motion.qdd, motion.held)
    return law.current(np.empty(0), still)[0]
