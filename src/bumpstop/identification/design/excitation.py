"""Periodic motions of all joints together that make base parameters visible: finite Fourier series.

Swevers and others 1997, "Optimal robot excitation and identification". The condition number of the base regressor says
how much worse the worst seen combination of parameters is than the best.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.design.clearance import Clearance, usable_joint_range
from bumpstop.identification.design.plan import loaded_robot
from bumpstop.identification.design.timed_path import TimedPath
from bumpstop.identification.dynamics.regressor import inertial_names, inertial_regressor
from bumpstop.model.dynamics import STANDARD_GRAVITY, check_free_fall

if TYPE_CHECKING:
    from bumpstop.model import Robot

_DEPENDENT = 1e-8  # of a column of random motion that others make up
_RANDOM_ROWS = 200
_ROWS = 60  # of a period, while it is optimised
_FINE = 40  # rows of a period of the highest harmonic, by which limits and clearance are judged
_RATE_HZ = 50.0  # of waypoints, at least
_KEEP = 0.98  # of every limit


@dataclass(frozen=True, kw_only=True)
class ExcitationSettings:
    """What an excitation is made for.

    Attributes:
        period_s: of the series; its base frequency is one over it [s].
        harmonics: of every joint.
        periods: how often it is run through.
        acceleration: most of every joint [rad/s2].
        speed_share: of every joint's largest speed.
        floor: height in the base frame [m], or None.
        radius: of the links' capsules [m].
        gravity: acceleration of free fall in the base frame [m/s2].
        seed: of the search.
        rounds: of the search; each tries one change of all coefficients.
    """

    period_s: float = 10.0
    harmonics: int = 5
    periods: int = 3
    acceleration: float = 4.5
    speed_share: float = 0.6
    floor: float | None = 0.0
    radius: float = 0.08
    gravity: tuple[float, float, float] = STANDARD_GRAVITY
    seed: int = 0
    rounds: int = 300

    def __post_init__(self) -> None:
        for name, low, high in (
            ("period_s", 1, 600),
            ("harmonics", 2, 20),
            ("periods", 1, 1000),
            ("acceleration", 0.01, 1000),
            ("speed_share", 0.01, 1),
            ("radius", 0, 1),
            ("rounds", 0, 100_000),
            ("seed", 0, 2**63),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(name, f"is {value}", f"wanted {low:g} to {high:g}")
        if self.floor is not None and not math.isfinite(self.floor):
            raise InputError("floor", f"is {self.floor}", "wanted a height [m]")
        check_free_fall(self.gravity, "gravity")


@dataclass(frozen=True, kw_only=True, eq=False)
class Excitation:
    """A periodic motion that begins and ends at rest.

    q_j(t) = middle_j + sum over k of a_jk sin(k w t) / (k w) - b_jk cos(k w t) / (k w)

    Attributes:
        robot: the arm.
        settings: as asked for.
        middle: (n,) [rad or m].
        sine, cosine: a and b (n, harmonics) [rad/s or m/s].
        condition: condition number of the base regressor, columns of length one.
        start_condition: of the random motion the search began with.
        parameters: number of base parameters.
        clearance: least distance to the floor or between parts of the arm [m].
    """

    robot: Robot
    settings: ExcitationSettings
    middle: FloatArray
    sine: FloatArray
    cosine: FloatArray
    condition: float
    start_condition: float
    parameters: int
    clearance: float

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, speeds and accelerations (N, n)."""
        return _series(self.middle, self.sine, self.cosine, self.settings.period_s, t)

    def path(self, rate_hz: float | None = None) -> TimedPath:
        """All periods as waypoints at an even rate; default: at which the curve through them is the series."""
        series = self.settings
        if rate_hz is None:
            rate_hz = max(_RATE_HZ, _FINE * series.harmonics / series.period_s)
        seconds = series.periods * series.period_s
        t = np.linspace(0.0, seconds, max(2, math.ceil(seconds * rate_hz)) + 1)
        q, qd, qdd = self.at(t)
        # At rest to the last digit: what rounding leaves is a motion that begins at next to no speed.
        qd[[0, -1]] = qdd[[0, -1]] = 0.0
        return TimedPath(t, q, qd, qdd)


def plan_excitation(
    robot: Robot,
    settings: ExcitationSettings | None = None,
    *,
    progress: Callable[[float], None] | None = None,
) -> Excitation:
    """Search a Fourier series with a small condition number of the base regressor inside all limits.

    Random coefficients are scaled into the limits of position, speed and acceleration, and drawn together until they
    are clear of the floor and of the arm; then random changes are kept when they lower the condition number. Every
    motion starts and ends at rest: the coefficients of a joint's sines add up to zero, those of its cosines times k
    as well. The search begins about the clearest of many poses.

    Raises:
        InputError: a joint without a largest speed, or no motion that is clear of the floor.
    """
    settings = settings or ExcitationSettings()
    report = progress or (lambda share: None)
    for joint in robot.joints:
        if not math.isfinite(joint.velocity):
            raise InputError(f"joint {joint.name!r} velocity", "is not stated", "the plan needs every joint's limit")
    search = _Search(robot, settings)
    rng = np.random.default_rng(settings.seed)
    best = search.begin(rng)
    condition = start = search.condition(*best)
    step = 0.5
    for number in range(settings.rounds):
        changed = search.changed(rng, best, step)
        found = math.inf if changed is None else search.condition(*changed)
        if changed is not None and found < condition:
            best, condition, step = changed, found, min(1.2 * step, 1.0)
        else:
            step = max(0.97 * step, 0.02)
        report((number + 1) / settings.rounds)
    middle, sine, cosine = best
    return Excitation(
        robot=robot,
        settings=settings,
        middle=middle,
        sine=sine,
        cosine=cosine,
        condition=condition,
        start_condition=start,
        parameters=len(search.columns),
        clearance=search.least(*best),
    )


class _Search:
    """What is the same for all candidates."""

    def __init__(self, robot: Robot, settings: ExcitationSettings) -> None:
        self.robot, self.settings = robot, settings
        self.arm = loaded_robot(robot, 0.0, (0.0, 0.0, 0.0))
        self.clear = Clearance(robot, settings.floor, settings.radius)
        self.low, self.high = usable_joint_range(robot, math.radians(5))
        self.columns = base_columns(robot, settings.gravity)
        self.fine = np.linspace(0.0, settings.period_s, _FINE * settings.harmonics + 1)
        self.coarse = np.linspace(0.0, settings.period_s, _ROWS, endpoint=False)

    def begin(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
        poses = np.vstack([(self.low + self.high) / 2, rng.uniform(self.low, self.high, size=(2000, self.robot.dof))])
        least = np.minimum(self.clear.least(poses), 0.3)
        room = np.minimum(poses - self.low, self.high - poses) / (self.high - self.low)
        order = np.argsort(-(least + 0.5 * room.mean(axis=1)), kind="stable")
        for middle in poses[order[least[order] > 0][:10]]:
            for _ in range(5):
                a, b = self._at_rest(*rng.normal(size=(2, self.robot.dof, self.settings.harmonics)))
                found = self._inside(middle, a, b)
                if found is not None:
                    return found
        raise InputError("floor", "no motion is clear of it", "a lower floor, or slimmer capsules")

    def changed(
        self, rng: np.random.Generator, best: tuple[FloatArray, FloatArray, FloatArray], step: float
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        middle, a, b = best
        size = np.sqrt((a**2 + b**2).mean(axis=1, keepdims=True))
        joints = rng.random((self.robot.dof, 1)) < 0.5
        a = a + step * size * joints * rng.normal(size=a.shape)
        b = b + step * size * joints * rng.normal(size=b.shape)
        shift = 0.2 * step * (self.high - self.low) * joints[:, 0] * rng.normal(size=middle.shape)
        return self._inside(np.clip(middle + shift, self.low + 0.02, self.high - 0.02), *self._at_rest(a, b))

    def condition(self, middle: FloatArray, a: FloatArray, b: FloatArray) -> float:
        """Of the base regressor, its columns at length one."""
        q, qd, qdd = _series(middle, a, b, self.settings.period_s, self.coarse)
        matrix = inertial_regressor(self.arm, q, qd, qdd, self.settings.gravity)[:, :, self.columns]
        flat = matrix.reshape(-1, len(self.columns))
        length = np.linalg.norm(flat, axis=0)
        if not (length > 0).all():
            return math.inf
        # Squares of the singular values: a small matrix, exact enough up to conditions of 1e6.
        values = np.linalg.eigvalsh((flat / length).T @ (flat / length))
        return math.sqrt(values[-1] / values[0]) if values[0] > 1e-14 * values[-1] else math.inf

    def least(self, middle: FloatArray, a: FloatArray, b: FloatArray) -> float:
        """Clearance along the motion [m]."""
        q, _, _ = _series(middle, a, b, self.settings.period_s, self.fine)
        return float(self.clear.least(q).min())

    def _at_rest(self, a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The nearest coefficients that begin with neither speed nor acceleration."""
        k = np.arange(1, self.settings.harmonics + 1)
        return a - a.mean(axis=1, keepdims=True), b - np.outer(b @ k / (k @ k), k)

    def _inside(
        self, middle: FloatArray, a: FloatArray, b: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """The motion made as large as the limits allow; None: it is not clear of floor and arm."""
        q, qd, qdd = _series(middle, a, b, self.settings.period_s, self.fine)
        swing = q - middle
        with np.errstate(divide="ignore"):
            share = np.minimum.reduce(
                [
                    (self.high - middle) / np.maximum(swing.max(axis=0), 1e-12),
                    (middle - self.low) / np.maximum(-swing.min(axis=0), 1e-12),
                    self.settings.speed_share * self.robot.velocity / np.maximum(np.abs(qd).max(axis=0), 1e-12),
                    self.settings.acceleration / np.maximum(np.abs(qdd).max(axis=0), 1e-12),
                ]
            )
        a, b = (_KEEP * share[:, None] * x for x in (a, b))
        for shrink in (1.0, 0.8, 0.6, 0.4, 0.2):
            if self.least(middle, shrink * a, shrink * b) > 0:
                return middle, shrink * a, shrink * b
        return None


def base_columns(robot: Robot, gravity: tuple[float, float, float]) -> list[int]:
    """Columns of the inertial regressor that are independent in general motion, as many as base parameters."""
    from scipy.linalg import qr

    rng = np.random.default_rng(3)
    q, qd, qdd = rng.uniform(-2, 2, size=(3, _RANDOM_ROWS, robot.dof))
    matrix = inertial_regressor(robot, q, qd, qdd, gravity).reshape(-1, len(inertial_names(robot)))
    length = np.linalg.norm(matrix, axis=0)
    seen = np.flatnonzero(length > 1e-9 * length.max())
    triangle, order = qr(matrix[:, seen] / length[seen], mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    rank = int((diagonal > _DEPENDENT * diagonal[0]).sum())
    return sorted(int(seen[c]) for c in order[:rank])


def _series(
    middle: FloatArray, a: FloatArray, b: FloatArray, period: float, t: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    w = 2 * math.pi / period * np.arange(1, a.shape[1] + 1)
    sine, cosine = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    q = middle + sine @ (a / w).T - cosine @ (b / w).T
    qd = cosine @ a.T + sine @ b.T
    qdd = -sine @ (a * w).T + cosine @ (b * w).T
    return q, qd, qdd
