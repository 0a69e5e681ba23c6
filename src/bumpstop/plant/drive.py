"""The drives of the arm: what motor and gear do between the current and the link, the other way round than `joint`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.errors import InputError, near_matches
from bumpstop.model import mass_matrix, with_rotors

if TYPE_CHECKING:
    from bumpstop.joint import JointParameters, JointTorqueModel
    from bumpstop.model import Robot

PerJoint = float | Sequence[float]
ScatterPer = Literal["sample", "motion"]
# Below the first multiple of the rest speed friction acts as damping alone, so that it cannot turn a joint round; above
# the second as the tangent of its law.
_SECANT_BELOW, _TANGENT_ABOVE = 2.0, 6.0
_NEAR = 1.01  # speeds this factor apart tell how a friction law bends
# Of the difference, how much the load that friction goes by follows in a millisecond: a time constant of 20 ms.
_LOAD_SHARE_PER_MS = 0.05


@dataclass(frozen=True, kw_only=True)
class Gears:
    """What the gears do beyond the joint torque model, a number for all joints or one for each.

    It loads the motors, and no model of the class that is identified can represent it.

    Attributes:
        rotor_inertia: reflected to the joint [kg m2 or kg]; None: the joint model's inertia, else the robot's rotor's.
        load_share: friction per torque through the gear, against the motion [1].
        stribeck: friction at rest beyond that at speed [Nm].
        stribeck_speed: at which it has fallen to 1/e [rad/s].
        ripple: amplitude of the torque that a harmonic drive's wave generator makes [Nm].
        ripple_per_turn: waves in a turn of the joint: twice the gear ratio.
        presliding: way over which hysteresis builds up and turns round [rad]; 0: at once, as the joint model has it.
        stiffness: of the gear [Nm/rad]; infinite: rigid.
        damping_ratio: of the twist of a gear that gives, a share of the critical damping of the rotor on it.
        damping: of the twist [Nm s/rad]; None: by ``damping_ratio``.
        scatter: sd of the friction current about its law; None: the joint model's ``friction_sd``.
        scatter_per: ``"sample"`` draws it anew at every sample, as noise; ``"motion"`` once for a run, with the sign of
            the rate, as friction that is not the same from day to day.
    """

    rotor_inertia: PerJoint | None = None
    load_share: PerJoint = 0.0
    stribeck: PerJoint = 0.0
    stribeck_speed: PerJoint = 0.05
    ripple: PerJoint = 0.0
    ripple_per_turn: PerJoint = 200.0
    presliding: PerJoint = 0.0
    stiffness: PerJoint = np.inf
    damping_ratio: float = 0.05
    damping: PerJoint | None = None
    scatter: PerJoint | None = None
    scatter_per: ScatterPer = "sample"

    def __post_init__(self) -> None:
        if self.scatter_per not in get_args(ScatterPer):
            problem = f"{self.scatter_per!r} is none"
            raise InputError("friction.scatter_per", problem, near_matches(str(self.scatter_per), get_args(ScatterPer)))
        if not 0 <= as_number(self.damping_ratio, "friction.damping_ratio") <= 2:
            raise InputError("friction.damping_ratio", f"is {self.damping_ratio}", "wanted 0 to 2")

    @classmethod
    def of(cls, robot: Robot, q: npt.ArrayLike) -> Gears:
        """Rotors and gears of a robot's drive train, without friction beyond the joint model's.

        Args:
            robot: with inertia and its ``drive_train``.
            q: pose in which the gears have their share of the critical damping of rotor and link (dof,) [rad or m].
        """
        train = robot.drive_train
        links = np.diag(mass_matrix(with_rotors(robot, np.zeros(robot.dof)), q))
        reduced = 1 / (1 / train.rotor_inertia + 1 / links)
        return cls(
            rotor_inertia=train.rotor_inertia.tolist(),
            stiffness=train.gear_stiffness.tolist(),
            damping=(2 * train.gear_damping * np.sqrt(train.gear_stiffness * reduced)).tolist(),
        )


class Drives:
    """All drives of an arm, with the hysteresis of their gears.

    With i the current, f the joint model's map and i_f its friction current, the gear passes on f(i - i_f). Hysteresis
    and what :class:`Gears` adds are further torques against the motor. The current is the one that gives what the motor
    had to give: ``JointTorqueModel.torque`` undoes it exactly where gears add nothing.
    """

    def __init__(self, robot: Robot, model: JointTorqueModel | None, gears: Gears) -> None:
        n = robot.dof
        self.names = tuple(joint.name for joint in robot.joints)
        self.gears = gears
        self._model = model
        known = {} if model is None else {joint.name: joint for joint in model.joints}
        stray = [name for name in known if name not in self.names]
        if stray:
            raise InputError(
                "joint_model", f"has a joint {stray[0]!r} that {robot.name} has not", f"valid: {', '.join(self.names)}"
            )
        joints: list[JointParameters | None] = [known.get(name) for name in self.names]
        self.unmodelled = tuple(
            name for name, joint in zip(self.names, joints, strict=True) if joint is None and model is not None
        )

        def each(name: str, default: float = 0.0) -> FloatArray:
            return np.array([default if joint is None else joint.value(name) for joint in joints])

        # A joint without a model is a motor whose current is its torque.
        self.A, self.B = each("A"), each("B", 1.0)
        self.odd = np.array([joint is None or joint.map == "odd" for joint in joints])
        self.laws = tuple("none" if joint is None else joint.friction for joint in joints)
        self.power = np.array([joint is None or joint.friction == "power" for joint in joints])
        self.D, self.F = each("D"), each("F")
        self.coulomb, self.viscous = each("coulomb"), each("viscous")
        self.stribeck, self.load = each("stribeck"), each("load")
        self.stribeck_speed = np.array(
            [1.0 if joint is None else joint.value("stribeck_speed") or 1.0 for joint in joints]
        )
        self.hysteresis = each("hysteresis")
        self.rest = np.array([0.01 if joint is None else joint.rest_speed for joint in joints])
        ranges = [None if joint is None else joint.current_range for joint in joints]
        self.low = np.array([-np.inf if found is None else found[0] for found in ranges])
        self.high = np.array([np.inf if found is None else found[1] for found in ranges])
        own = [joint.rotor_inertia for joint in robot.joints]
        fitted = [None if joint is None else joint.parameters["inertia"] for joint in joints]
        self.inertia = per_joint(
            [rotor if found is None else found.value for rotor, found in zip(own, fitted, strict=True)]
            if gears.rotor_inertia is None
            else gears.rotor_inertia,
            n,
            "friction.rotor_inertia",
        )
        self.scatter = per_joint(
            [0.0 if joint is None or joint.friction_sd is None else joint.friction_sd for joint in joints]
            if gears.scatter is None
            else gears.scatter,
            n,
            "friction.scatter",
        )
        self.load_share = per_joint(gears.load_share, n, "friction.load_share", 0.99)
        self.extra = per_joint(gears.stribeck, n, "friction.stribeck")
        self.extra_speed = per_joint(gears.stribeck_speed, n, "friction.stribeck_speed", least=1e-6)
        self.ripple = per_joint(gears.ripple, n, "friction.ripple")
        self.waves = per_joint(gears.ripple_per_turn, n, "friction.ripple_per_turn")
        self.presliding = per_joint(gears.presliding, n, "friction.presliding")
        self.stiffness = per_joint(gears.stiffness, n, "friction.stiffness", np.inf, least=1.0)
        finite = np.isfinite(self.stiffness)
        critical = 2 * np.sqrt(np.where(finite, self.stiffness, 0.0) * np.maximum(self.inertia, 1e-12))
        by_ratio = gears.damping_ratio * critical
        self.damping = by_ratio if gears.damping is None else per_joint(gears.damping, n, "friction.damping")
        # Most drives need a few of the terms only, and this is the innermost loop that is not MuJoCo's.
        self._all_odd, self._all_power = bool(self.odd.all()), bool(self.power.all())
        self._endless = bool(np.isinf(self.low).all() and np.isinf(self.high).all())
        self._ripples, self._slides = bool(self.ripple.any()), bool(self.presliding.any())
        self._more = bool(self.load_share.any() or self.extra.any())
        self._loads, self._B2, self._A4 = bool(self.load.any()), self.B * self.B, 4 * self.A
        self.reset(np.zeros(n))

    @property
    def notes(self) -> tuple[str, ...]:
        """What the joint model's file says against it, and what could not be modelled, a sentence each."""
        from bumpstop.identification.fit_verdict import as_sentences, fit_faults

        notes = as_sentences(fit_faults(self._model))
        if self.unmodelled:
            notes.append(
                f"No joint model of {', '.join(self.unmodelled)}: the current is the torque, without friction."
            )
        return tuple(notes)

    def reset(self, q: FloatArray, qd: FloatArray | None = None, tau: FloatArray | None = None) -> None:
        """Forget the motion: start in this pose (dof,), with these rates and torques passed on (dof,)."""
        self._memory = np.zeros_like(q) if qd is None else np.where(np.abs(qd) > 2 * self.rest, np.sign(qd), 0.0)
        self._last = q.copy()
        self._slope: FloatArray | float = 0.0
        self._base: FloatArray | float = 0.0
        self._passed: FloatArray = np.zeros_like(q) if tau is None else tau

    def _friction(self, qd: FloatArray) -> tuple[FloatArray, FloatArray]:
        """sgn(qd) and the friction current without its share of the current, both as the joint model has them."""
        speed = np.abs(qd)
        sign = np.minimum(np.maximum(qd / self.rest, -1.0), 1.0)
        by_power = self._by_power(speed)
        if self._all_power:
            return sign, sign * by_power
        by_stribeck = self.coulomb + self.stribeck * np.exp(-((speed / self.stribeck_speed) ** 2))
        return sign, sign * np.where(self.power, by_power, by_stribeck) + self.viscous * qd

    def _by_power(self, speed: FloatArray) -> FloatArray:
        return np.asarray(self.D * np.maximum(speed, self.rest) ** self.F)

    def _map(self, current: FloatArray, sign: FloatArray) -> FloatArray:
        if self._endless and self._all_odd:
            return np.asarray(current * (self.B + self.A * np.abs(current)))
        inside = np.minimum(np.maximum(current, self.low), self.high)
        bend = np.where(self.odd, np.abs(inside), -sign * inside) * self.A
        return np.asarray(inside * (self.B + bend) + (current - inside) * (self.B + 2 * bend))

    def _inverse_map(self, tau: FloatArray, sign: FloatArray) -> FloatArray:
        """The joint current that gives a torque; the maps are monotone over their range."""
        if self._endless and self._all_odd:
            return np.asarray(2 * tau / (self.B + np.sqrt(np.maximum(self._B2 + self._A4 * np.abs(tau), 0.0))))
        root = np.where(self.odd, np.abs(tau), -sign * tau) * self.A
        current: FloatArray = 2 * tau / (self.B + np.sqrt(np.maximum(self.B**2 + 4 * root, 0.0)))
        inside = np.minimum(np.maximum(current, self.low), self.high)
        if (inside != current).any():
            bend = np.where(self.odd, np.abs(inside), -sign * inside) * self.A
            beyond = inside + (tau - inside * (self.B + bend)) / (self.B + 2 * bend)
            current = np.where(inside != current, beyond, current)
        return current

    def _taken(self, passed: FloatArray, sign: FloatArray, friction: FloatArray) -> FloatArray:
        """Torque that friction takes where so much is passed on (dof,)."""
        return self._map(self._current(passed, sign, friction), sign) - passed

    def _current(self, mapped: FloatArray, sign: FloatArray, friction: FloatArray) -> FloatArray:
        """Current of the motors, with the friction that grows with the current itself."""
        current = self._inverse_map(mapped, sign) + friction
        if not self._loads:
            return current
        return np.asarray(current / (1.0 - self.load * sign * np.sign(current)))

    def resist(
        self, q: FloatArray, qd: FloatArray, tau: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """What the gears do now; brings their memory forward.

        Friction of the joint model is a line over the rate until the next call: its tangent, or at low speeds a line
        through zero. Held as damping through zero it would grow with the rate within the millisecond, and the torque
        at its end, which sensors see, would not be that of the mean acceleration.

        Args:
            q: positions of the motors (dof,) [rad or m].
            qd: their rates (dof,).
            tau: what they give (dof,) [Nm or N].

        Returns:
            Damping (dof,) [Nm s/rad], torque against +q that does not follow the rate (dof,) [Nm], and how much of
            both is friction of the joint model (dof,) [Nm s/rad] and [Nm].
        """
        speed = np.abs(qd)
        ahead = np.where(qd < 0, -1.0, 1.0)
        slow = np.minimum(np.maximum(2.0 - speed / self.rest, 0.0), 1.0)
        if self._slides:
            way = q - self._last
            aim = np.sign(way)
            share = np.exp(-np.abs(way) / np.maximum(self.presliding, 1e-12))
            gradual = np.where(way == 0, self._memory, aim + (self._memory - aim) * share)
            self._memory = np.where(self.presliding > 0, gradual, np.where(slow > 0, self._memory, np.sign(qd)))
            self._last = q.copy()
        else:
            self._memory = np.where(slow > 0, self._memory, np.sign(qd))
        against = self._memory * slow * self.hysteresis
        if self._ripples:
            against = against + self.ripple * np.sin(self.waves * q)
        # Below the speed of rest friction is a line through zero: its slope there is that at the speed of rest.
        moving = ahead * np.maximum(speed, self.rest)
        sign, friction = (ahead, ahead * self._by_power(speed)) if self._all_power else self._friction(moving)
        # At once, friction that grows with the load and a servo that answers it would chase each other.
        self._passed = passed = self._passed + _LOAD_SHARE_PER_MS * (
            tau - against - self._base - self._slope * qd - self._passed
        )
        taken = self._taken(passed, sign, friction)
        near = _NEAR * moving
        ahead_of = ahead * self._by_power(_NEAR * np.abs(moving)) if self._all_power else self._friction(near)[1]
        # Friction that falls with the rate must not become a drive.
        tangent = np.maximum((self._taken(passed, sign, ahead_of) - taken) / (near - moving), 0.0)
        share = np.minimum(np.maximum((speed / self.rest - _SECANT_BELOW) / (_TANGENT_ABOVE - _SECANT_BELOW), 0.0), 1.0)
        secant = taken / moving
        slope = secant + share * (tangent - secant)
        base = share * (secant - tangent) * qd
        self._slope, self._base = slope, base
        if not self._more:
            return slope, against + base, slope, base
        more = self.load_share * np.abs(passed) + self.extra * np.exp(-((speed / self.extra_speed) ** 2))
        return slope + more / np.abs(moving), against + base, slope, base

    def current(self, tau: FloatArray, qd: FloatArray, taken: FloatArray) -> FloatArray:
        """Current of the motors.

        Args:
            tau: what the motors give (dof,) [Nm or N].
            qd: their rates (dof,).
            taken: by friction of the joint model (dof,) [Nm or N].

        Returns:
            (dof,) in the joint model's unit.
        """
        sign, friction = self._friction(qd)
        return self._current(tau - taken, sign, friction)

    def scattered(self, draws: FloatArray, samples: npt.NDArray[np.int64], qd: FloatArray) -> FloatArray:
        """What the friction current has beyond its law.

        Args:
            draws: of sd 1, of a whole run (N, dof).
            samples: which of them are asked for (M,).
            qd: rates of the joints then (M, dof).

        Returns:
            (M, dof) in the joint model's unit.
        """
        if self.gears.scatter_per == "sample":
            return np.asarray(self.scatter * draws[samples])
        return np.asarray(self.scatter * draws[0] * np.clip(qd / self.rest, -1.0, 1.0))


def per_joint(value: PerJoint, n: int, field: str, most: float = 1e6, least: float = 0.0) -> FloatArray:
    """A number for all joints or a list of one each, as (n,); refuses what is out of range."""
    given = np.full(n, float(value)) if isinstance(value, int | float | np.number) else value
    numbers = as_float_array(given, field, (n,), finite=False)
    for j in range(n):
        if not least <= numbers[j] <= most:
            raise InputError(f"{field}[{j + 1}]", f"is {numbers[j]:g}", f"wanted {least:g} to {most:g}")
    return numbers
