"""One contact situation made ready to be measured: gauge, place, orientation, approach."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.curve import stopping_curve
from bumpstop.collision.problem import CollisionProblem
from bumpstop.errors import InputError
from bumpstop.measure.planning.gauge import Gauge, gauge_of
from bumpstop.measure.planning.trajectory_place import TrajectoryPlace
from bumpstop.register.rows import NAME, is_name

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision.scenario.scenario import Scenario
    from bumpstop.contact import ContactLimits

# Beyond where full speed is reached: servos settle.
_APPROACH_MARGIN = 1.25
_MIN_APPROACH_M = 0.02
_FULL_SPEED = 0.999
_FOLLOWS = 0.9
# A gauge may yield less than the path from which the arm turns back.
_LONGEST_APPROACH_S = 10.0


@dataclass(frozen=True, eq=False)
class MeasuredSituation:
    """A contact situation and what measures it.

    Attributes:
        name: unique in a plan.
        scenario: the situation itself, with the body.
        gauge: the device that stands for the body.
        measured: the scenario with the gauge in the body's place.
        contact_point: where the face of the gauge stands, base frame (3,) [m].
        normal: the way the contact point moves, into the gauge, base frame (3,) [1].
        speed_mm_s: of the tip; with a trajectory of the contact point where it meets the gauge [mm/s].
        pose: joint positions where the gauge is met (dof,) [rad or m].
        approach: of the contact point along the motion, until it has full speed and a quarter beyond; with a trajectory
            from its start [m].
        start_point: where the contact point begins to move, base frame (3,) [m].
        limit_N: force limit of the body region, of peaks in the first half second; NaN where there is none.
        lasting_limit_N: of what lasts.
        pressure_limit_N_cm2, lasting_pressure_limit_N_cm2: of the highest pressure, likewise.
        notes: what a reader should know.
        onset_s: time of the trajectory at which the gauge is met [s]; None: the motion is a line.
    """

    name: str
    scenario: Scenario
    gauge: Gauge
    measured: Scenario
    contact_point: FloatArray
    normal: FloatArray
    speed_mm_s: float
    pose: FloatArray
    approach: float
    start_point: FloatArray
    limit_N: float
    lasting_limit_N: float
    pressure_limit_N_cm2: float
    lasting_pressure_limit_N_cm2: float
    notes: tuple[str, ...]
    onset_s: float | None = None

    @property
    def clamped(self) -> bool:
        """Whether the gauge is fixed to the ground; else it is on a slide, with the mass of the body."""
        return self.scenario.contact.kind == "clamped"

    @classmethod
    def of(
        cls, name: str, scenario: Scenario, device: str | None = None, *, onset_s: float | None = None
    ) -> MeasuredSituation:
        """Find gauge, place and approach of a situation.

        Args:
            name: of it.
            scenario: of a line or a trajectory.
            device: gauge, see :func:`gauge_of`.
            onset_s: time of a trajectory at which the gauge is met [s], see :class:`TrajectoryPlace`.

        Raises:
            InputError: the scenario cannot be computed.
        """
        gauge = gauge_of(scenario, device)
        measured = gauge.measured(scenario)
        problem = CollisionProblem.from_scenario(measured)
        first_limits, lasting_limits = _limits(problem)
        if scenario.motion.kind == "trajectory":
            place = TrajectoryPlace.of(scenario, onset_s)
            return cls(
                name=name,
                scenario=scenario,
                gauge=gauge,
                measured=measured.with_values({"motion.contact_onset_s": place.onset}),
                contact_point=place.contact_point,
                normal=place.normal,
                speed_mm_s=1e3 * place.speed,
                pose=place.q,
                approach=place.way,
                start_point=place.start_point,
                limit_N=first_limits[0],
                lasting_limit_N=lasting_limits[0],
                pressure_limit_N_cm2=first_limits[1],
                lasting_pressure_limit_N_cm2=lasting_limits[1],
                notes=(*_gauge_notes(gauge), *place.notes()),
                onset_s=place.onset,
            )
        curve = stopping_curve(_short(measured, {}))
        notes = _gauge_notes(gauge)
        approach, reached = _approach(measured)
        if not reached:
            notes.append("From rest at the scenario's acceleration the arm does not reach full speed on this line.")
        velocity = np.asarray(problem.start.point_velocity, dtype=np.float64)
        way = velocity / np.linalg.norm(velocity)
        room = _room_behind(measured, approach, problem.approach_speed)
        if room is not None:
            notes.append(
                f"The approach of {1e3 * approach:.0f} mm has no room: the arm comes to {room} on the way back. Begin "
                "in another configuration, or measure at another place."
            )
        return cls(
            name=name,
            scenario=scenario,
            gauge=gauge,
            measured=measured,
            contact_point=curve.start,
            normal=curve.normal,
            speed_mm_s=1e3 * math.hypot(*scenario.motion.velocity),
            pose=problem.q,
            approach=approach,
            start_point=curve.start - approach * way,
            limit_N=first_limits[0],
            lasting_limit_N=lasting_limits[0],
            pressure_limit_N_cm2=first_limits[1],
            lasting_pressure_limit_N_cm2=lasting_limits[1],
            notes=tuple(notes),
        )

    def at_speed(self, speed_mm_s: float) -> Scenario:
        """The measurement at another speed of the tip [mm/s], along the same direction; a trajectory as it is."""
        if self.onset_s is not None:
            return self.measured
        v = np.asarray(self.measured.motion.velocity)
        return self.measured.with_values({"motion.velocity_mm_s": (speed_mm_s * v / np.linalg.norm(v)).tolist()})


def situations_of(named: Iterable[tuple[str, Scenario]], device: str | None = None) -> list[MeasuredSituation]:
    """Situations of anything that yields names and scenarios, in its order.

    Raises:
        InputError: there is none, a name cannot be used, two have one name, they are of different robots, or one cannot
            be measured.
    """
    found: list[MeasuredSituation] = []
    names: set[str] = set()
    for name, scenario in named:
        if not is_name(name):
            raise InputError("situation", f"{name!r} is no name", NAME)
        if name in names:
            raise InputError("situation", f"{name!r} is named twice", "give each situation a name of its own")
        names.add(name)
        try:
            found.append(MeasuredSituation.of(name, scenario, device))
        except InputError as error:
            field = error.field if error.field.startswith(f"{name}: ") else f"{name}: {error.field}"
            raise InputError(field, error.problem, error.valid) from None
    if not found:
        raise InputError("situation", "there is none", "give a scenario file")
    robots = {situation.scenario.robot for situation in found}
    if len(robots) > 1:
        raise InputError(
            "robot",
            f"the situations are of {len(robots)} robots: {', '.join(sorted(robots))}",
            "one plan measures one arm: make a plan for each",
        )
    return found


def _gauge_notes(gauge: Gauge) -> list[str]:
    return [gauge.note] if gauge.note else []


def _limits(problem: CollisionProblem) -> tuple[tuple[float, float], tuple[float, float]]:
    """Force [N] and pressure [N/cm2] of the first half second of contact, and the same of what lasts."""
    return _of_phase(problem.transient_limits or problem.limits), _of_phase(problem.limits)


def _of_phase(limits: ContactLimits | None) -> tuple[float, float]:
    if limits is None or not limits.permitted:
        return math.nan, math.nan
    return limits.force_N, math.nan if limits.pressure_N_cm2 is None else limits.pressure_N_cm2


def _short(scenario: Scenario, motion: dict[str, object], seconds: float = 0.1) -> CollisionProblem:
    step = scenario.simulation.step_s
    duration = max(1, round(seconds / step)) * step
    table = scenario.motion.model_copy(update={"duration_s": duration, **motion})
    return CollisionProblem.from_scenario(scenario.model_copy(update={"motion": table}))


def _approach(scenario: Scenario) -> tuple[float, bool]:
    """How far the contact point goes until it has full speed, with a margin [m], and whether it gets there."""
    seconds = 0.25
    full = _short(scenario, {"start": "moving"}).approach_speed
    while True:
        curve = stopping_curve(_short(scenario, {"start": "rest"}, seconds), whole=True)
        speed = np.diff(curve.distance) / scenario.simulation.step_s
        there = np.flatnonzero(speed >= _FULL_SPEED * full)
        if there.size:
            return max(_MIN_APPROACH_M, _APPROACH_MARGIN * float(curve.distance[there[0] + 1])), True
        if seconds >= _LONGEST_APPROACH_S or curve.end != "motion_end":
            return max(_MIN_APPROACH_M, _APPROACH_MARGIN * float(curve.distance.max())), False
        seconds *= 2


def _room_behind(scenario: Scenario, approach: float, speed: float) -> str | None:
    """What ends the way back to where the approach begins; None: there is room."""
    velocity = scenario.motion.velocity_mm_s
    assert velocity is not None
    back: dict[str, object] = {"velocity_mm_s": [-v for v in velocity], "start": "moving"}
    contact = scenario.contact.model_copy(update={"normal": None})
    curve = stopping_curve(_short(scenario.model_copy(update={"contact": contact}), back, approach / speed), whole=True)
    if curve.end == "joint_limit":
        return f"the limit of joint {curve.end_joint}"
    # Beside a singularity most arms do not meet it, but leave the line.
    lost = curve.distance[-1] < _FOLLOWS * approach
    return "a singularity" if lost or curve.end == "singularity" else None
