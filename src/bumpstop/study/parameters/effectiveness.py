"""Effectiveness: what a detector is worth to every body part, by direction, speed and contact area."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from bumpstop.errors import InputError, near_matches
from bumpstop.study.requirement.sampling_ripple import has_ripple
from bumpstop.study.study import Study, check_risk
from bumpstop.study.variable import Variable

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.collision import CollisionResult, Scenario
    from bumpstop.contact import LimitTable
    from bumpstop.study.requirement.requirement import Requirement

# Base frame, seen from behind the base.
DIRECTIONS: Mapping[str, tuple[float, float, float]] = {
    "down": (0.0, 0.0, -1.0),
    "up": (0.0, 0.0, 1.0),
    "forward": (1.0, 0.0, 0.0),
    "back": (-1.0, 0.0, 0.0),
    "left": (0.0, 1.0, 0.0),
    "right": (0.0, -1.0, 0.0),
}
# Schroeder's speeds and areas, and its downward and lateral motion (its sections 6.2.1 and 6.2.2).
SPEEDS_MM_S = (10.0, 25.0, 50.0, 75.0, 100.0)
AREAS_CM2 = (1.0, 2.0)
# Reduced speed of robots with a person in the cell (ISO 10218-1).
MAX_SPEED_MM_S = 250.0
MIN_SPEED_MM_S = 1.0
SPEED_STEP_MM_S = 0.1
_MAX_SCENARIO_SPEED_MM_S = 1e5  # that a scenario takes
_SCAN = 10


@dataclass(frozen=True)
class EffectivenessStudy(Study):
    """One integrated distribution for each body part, direction and speed, judged on each contact area.

    Attributes:
        bodies: limit table and region; one shard each.
        directions: names of :data:`DIRECTIONS`.
        speeds_mm_s: ascending.
        areas_cm2: ascending.
        highest_speed_mm_s: up to which a safe speed is looked for.
    """

    name: ClassVar[str] = "effectiveness"
    title: ClassVar[str] = "effectiveness for body parts"

    bodies: tuple[tuple[str, str], ...] = ()
    directions: tuple[str, ...] = ("down", "left")
    speeds_mm_s: tuple[float, ...] = SPEEDS_MM_S
    areas_cm2: tuple[float, ...] = AREAS_CM2
    highest_speed_mm_s: float = MAX_SPEED_MM_S

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        bodies: list[str] | None = None,
        directions: list[str] | None = None,
        speeds_mm_s: list[float] | None = None,
        areas_cm2: list[float] | None = None,
        highest_speed_mm_s: float = MAX_SPEED_MM_S,
    ) -> EffectivenessStudy:
        """Check what a person asks for; None takes every region of every table, and Schroeder's other choices.

        Raises:
            InputError: a body or direction is unknown, a number cannot be used, or the scenario cannot move that way.
        """
        if scenario.motion.velocity_mm_s is None:
            raise InputError("motion.kind", "effectiveness is studied along straight lines", "wanted 'line'")
        check_risk(scenario)
        if scenario.contact.normal is not None:
            raise InputError("contact.normal", "would be the same for every direction", "leave it out")
        names = dict.fromkeys(("bgia2011", "ts15066", scenario.contact.limits))
        tables = {name: _load(scenario, name) for name in names}
        regions = sorted({row.name for table in tables.values() for row in table.regions})
        for body in bodies or []:
            if body not in regions:
                raise InputError("--body", f"{body!r} is a region of no table", near_matches(body, regions))
        chosen = tuple(
            (name, row.name)
            for name, table in tables.items()
            for row in table.regions
            if not bodies or row.name in bodies
        )
        for direction in directions or []:
            if direction not in DIRECTIONS:
                raise InputError("--direction", f"{direction!r} is unknown", near_matches(direction, DIRECTIONS))
        study = cls(
            scenario,
            chosen,
            tuple(dict.fromkeys(directions or ("down", "left"))),
            _ascending("--speed", speeds_mm_s, SPEEDS_MM_S),
            _ascending("--area", areas_cm2, AREAS_CM2),
            highest_speed_mm_s,
        )
        if not MIN_SPEED_MM_S < highest_speed_mm_s <= _MAX_SCENARIO_SPEED_MM_S:
            problem = f"{highest_speed_mm_s:g} mm/s cannot be used"
            valid = f"wanted more than {MIN_SPEED_MM_S:g} mm/s, and at most {_MAX_SCENARIO_SPEED_MM_S:g} mm/s"
            raise InputError("--highest-speed", problem, valid)
        study._check_directions()
        return study

    @property
    def shards(self) -> int:  # noqa: D102
        return len(self.bodies)

    def shard(self, number: int) -> pl.DataFrame:  # noqa: D102
        import polars as pl

        table, body = self.bodies[number]
        limits = _load(self.scenario, table).contact_limits(body, self.scenario.contact.kind)
        start = {"table": table, "body": body, "label": limits.label}
        refusal = limits.reason or self._without_law(table, body)
        rows: list[dict[str, Any]] = []
        for direction in self.directions:
            own = start | {"direction": direction}
            if refusal:
                rows += [
                    own | {"kind": "collision", "area_cm2": area, "speed_mm_s": speed, "reason": refusal}
                    for area in self.areas_cm2
                    for speed in self.speeds_mm_s
                ]
                rows += [own | {"kind": "safe_speed", "area_cm2": area, "reason": refusal} for area in self.areas_cm2]
                continue
            laws = _Laws(self, table, body, direction)
            rows += [own | laws.collision(v, a) for a in self.areas_cm2 for v in self.speeds_mm_s]
            rows += [own | laws.safe_speed(a) for a in self.areas_cm2]
        return pl.DataFrame(rows, schema=self._schema())

    def summary(self, rows: pl.DataFrame) -> dict[str, Any]:  # noqa: D102
        kinds = {kind: rows.filter(rows["kind"] == kind) for kind in ("collision", "safe_speed")}
        keys = ["table", "body", "label", "direction", "area_cm2"]
        return {
            "study": self.name,
            "contact": self.scenario.contact.kind,
            "risk": self.scenario.verdict.accepted_probability,
            "collisions": kinds["collision"].drop("kind", "safe_speed_mm_s", "binding").to_dicts(),
            "safe_speeds": kinds["safe_speed"].select(*keys, "safe_speed_mm_s", "binding", "reason").to_dicts(),
        }

    def scenario_of(self, table: str, body: str, direction: str, speed: float, area: float) -> Scenario:
        """The scenario of one collision: the body's own stiffness and mass; slower arms get longer to go as far."""
        from bumpstop.collision import Scenario
        from bumpstop.study.speed.motion_duration import duration_s

        data = self.scenario.to_dict()
        contact = data["contact"]
        for key in ("stiffness_N_m", "pressure_area"):
            contact.pop(key, None)
        if _load(self.scenario, table).region(body).effective_mass_kg is not None:
            contact.pop("body_mass_kg", None)
        contact |= {"body": body, "limits": table, "area_cm2": area}
        motion_end = duration_s(self.scenario, speed / Variable("motion.speed").value(self.scenario))
        data["motion"] |= {"velocity_mm_s": [speed * x for x in DIRECTIONS[direction]], "duration_s": motion_end}
        return Scenario.from_dict(data, self.scenario.folder)

    def _without_law(self, table: str, body: str) -> str:
        """Why this body has no distribution; empty where it has one."""
        if self.scenario.contact.kind == "clamped" or self.scenario.contact.body_mass_kg is not None:
            return ""
        if _load(self.scenario, table).region(body).effective_mass_kg is not None:
            return ""
        return f"{table} gives no mass of a body region, which free contact needs."

    def _check_directions(self) -> None:
        from bumpstop.collision import CollisionProblem

        table, body = next((each for each in self.bodies if not self._refused(*each)), (None, None))
        if table is None or body is None:
            raise InputError("contact.kind", "no body asked for has a limit and a mass for this kind of contact",
                             "valid: 'clamped', or give contact.body_mass_kg")  # fmt: skip
        for direction in self.directions:
            try:
                CollisionProblem.from_scenario(
                    self.scenario_of(table, body, direction, self.speeds_mm_s[0], self.areas_cm2[0])
                )
            except InputError as error:
                raise InputError(error.field, f"moving {direction}: {error.problem}", error.valid) from None

    def _refused(self, table: str, body: str) -> bool:
        limits = _load(self.scenario, table).contact_limits(body, self.scenario.contact.kind)
        return bool(limits.reason or self._without_law(table, body))

    def _schema(self) -> dict[str, Any]:
        from bumpstop.collision import CollisionProblem

        text = ("kind", "table", "body", "label", "direction")
        numbers = (
            "area_cm2", "speed_mm_s", "limit_force_N", "limit_pressure_N_cm2", "mean_N", "sd_N", "p99_N", "p999_N",
            "p_over_force", "p_over_pressure", "false_alarm", "undetected", "several_joints",
        )  # fmt: skip
        dof = CollisionProblem.from_scenario(self.scenario).robot.dof
        return (
            dict.fromkeys(text, str)
            | dict.fromkeys(numbers, float)
            | {f"trigger_{j + 1}": float for j in range(dof)}
            | {"acceptable": bool, "safe_speed_mm_s": float, "binding": str, "reason": str}
        )


class _Laws:
    """Distributions of one body and direction, remembered by speed: the area changes only how they are judged."""

    def __init__(self, study: EffectivenessStudy, table: str, body: str, direction: str) -> None:
        self._study = study
        self._which = (table, body, direction)
        self._known: dict[float, CollisionResult] = {}
        self._at_risk: dict[float, float] = {}
        self._requirements: dict[float, Requirement] = {}

    @property
    def _two_phases(self) -> bool:
        scenario = self._study.scenario
        return scenario.verdict.clamped_limit == "two_phase" and scenario.contact.kind == "clamped"

    def result(self, speed: float, area: float) -> CollisionResult:
        """The distribution at a speed; where contact has two phases, the area belongs to it."""
        from bumpstop.collision import evaluate

        if speed not in self._known or self._two_phases:
            self._known[speed] = evaluate(self._study.scenario_of(*self._which, speed, area))
            self._at_risk.pop(speed, None)
        return self._known[speed]

    def force_at_risk(self, speed: float, area: float) -> float:
        """Peak force passed with the accepted risk [N]."""
        result = self.result(speed, area)
        if speed not in self._at_risk:
            self._at_risk[speed] = result.peak_force.quantile(1 - self._study.scenario.verdict.accepted_probability)
        return self._at_risk[speed]

    def over(self, speed: float, area: float) -> tuple[float | None, float | None]:
        """Probabilities of passing the force and the pressure limit with an area; None where there is no limit."""
        result = self.result(speed, area)
        limits = result.problem.limits
        assert limits is not None
        if self._two_phases:
            return result.verdict.p_over_force, result.verdict.p_over_pressure
        force = result.peak_force
        over_force = force.exceedance(limits.force_N)
        if limits.pressure_N_cm2 is None:
            return over_force, None
        allowed = limits.force_at_pressure_limit_N(area, result.scenario.contact.peak_factor)
        return over_force, force.exceedance(allowed)

    def judged(self, speed: float, area: float) -> tuple[bool, str]:
        """Whether a speed is acceptable on an area, and what stands against it or comes nearest to.

        By the quantile of the accepted risk, which costs a thousandth of a far tail.
        """
        settings = self._study.scenario.verdict
        result = self.result(speed, area)
        limits = result.problem.limits
        assert limits is not None
        if result.false_alarm_probability > settings.max_false_alarm:
            return False, "false_alarm"
        if self._two_phases:
            force, pressure = (p or 0.0 for p in self.over(speed, area))
            return max(force, pressure) <= settings.accepted_probability, "pressure" if pressure > force else "force"
        factor = result.scenario.contact.peak_factor
        within = self.force_at_risk(speed, area) <= limits.allowed_force_N(area, factor)
        return within, limits.governing(area, factor)

    def collision(self, speed: float, area: float) -> dict[str, Any]:
        """One row: the distribution at a speed, judged on an area."""
        over = self.over(speed, area)
        result = self.result(speed, area)
        limits = result.problem.limits
        assert limits is not None
        force = result.peak_force
        triggers = {f"trigger_{j + 1}": float(p) for j, p in enumerate(result.trigger_joint_probability)}
        return {
            "kind": "collision",
            "area_cm2": area,
            "speed_mm_s": speed,
            "limit_force_N": limits.force_N,
            "limit_pressure_N_cm2": limits.pressure_N_cm2,
            "mean_N": force.mean,
            "sd_N": force.sd,
            "p99_N": force.quantile(0.99),
            "p999_N": force.quantile(0.999),
            "false_alarm": result.false_alarm_probability,
            "undetected": result.undetected_probability,
            "several_joints": result.multi_joint_probability,
            **triggers,
            "p_over_force": over[0],
            "p_over_pressure": over[1],
            "acceptable": self.judged(speed, area)[0],
        }

    def safe_speed(self, area: float) -> dict[str, Any]:
        """The highest speed below which every speed looked at is acceptable, in tenths of mm/s; None: not even 1 mm/s.

        A scan finds the first speed that is not acceptable, and bisection the edge below it. Where the risk is a
        sampling ripple in the speed, a requirement looks at all crests, and the scan only at false alarms.
        """
        found: dict[str, Any] = {"kind": "safe_speed", "area_cm2": area, "reason": ""}
        top = self._study.highest_speed_mm_s
        judged, beyond = self.judged, "none"
        if self._has_ripple:
            required = self._required(area)
            if required.value is None:
                return found | {"binding": required.binding, "reason": f"Not acceptable even at {required.low:g} mm/s."}
            if required.binding != "range":
                tenths = math.floor(required.value / SPEED_STEP_MM_S + 1e-6)
                top, beyond = round(tenths * SPEED_STEP_MM_S, 1), required.binding
            judged = self._alarms_judged
        ratio = (top / MIN_SPEED_MM_S) ** (1 / (_SCAN - 1))
        scan = sorted({round(MIN_SPEED_MM_S * ratio**i, 1) for i in range(_SCAN - 1)} | {top})
        low = None
        for speed in scan:
            acceptable, binding = judged(speed, area)
            if not acceptable:
                break
            low = speed
        else:
            reason = f"Nothing stands against it up to {top:g} mm/s." if beyond == "none" else ""
            return found | {"safe_speed_mm_s": top, "binding": beyond, "reason": reason}
        if low is None:
            return found | {"binding": binding, "reason": f"Not acceptable even at {scan[0]:g} mm/s."}
        # Whole tenths, so that the speed returned is one that was looked at.
        below, above = math.floor(low / SPEED_STEP_MM_S + 1e-6), math.ceil(speed / SPEED_STEP_MM_S - 1e-6)
        tries = 0
        while above - below > 1:
            # By straight lines through the logarithms, and every third time by halves.
            tries += 1
            middle = (below + above) // 2 if tries % 3 == 0 else self._crossing(below, above, area)
            acceptable, against = judged(round(middle * SPEED_STEP_MM_S, 1), area)
            if acceptable:
                below = middle
            else:
                above, binding = middle, against
        return found | {"safe_speed_mm_s": round(below * SPEED_STEP_MM_S, 1), "binding": binding}

    @property
    def _has_ripple(self) -> bool:
        """Whether the risk may have a sampling ripple in the speed, and an integrated distribution."""
        scenario = self._study.scenario
        return has_ripple(scenario) and scenario.detector.residuals is None

    def _required(self, area: float) -> Requirement:
        """The highest speed that meets the risk, with every slower one; slower arms get longer to go as far."""
        from bumpstop.study.requirement.requirement import solve_requirement

        own = Variable("motion.speed").value(self._study.scenario)
        scenario = self._study.scenario_of(*self._which, own, area)
        limits = self.result(own, area).problem.limits
        assert limits is not None
        # Without phases the area decides nothing but the force that is allowed.
        key = area if self._two_phases else limits.allowed_force_N(area, scenario.contact.peak_factor)
        if key not in self._requirements:
            highest = self._study.highest_speed_mm_s
            self._requirements[key] = solve_requirement(scenario, "motion.speed", low=MIN_SPEED_MM_S, high=highest)
        return self._requirements[key]

    def _alarms_judged(self, speed: float, area: float) -> tuple[bool, str]:
        """As :meth:`judged`, by false alarms alone."""
        result = self.result(speed, area)
        return result.false_alarm_probability <= self._study.scenario.verdict.max_false_alarm, "false_alarm"

    def _crossing(self, below: int, above: int, area: float) -> int:
        """Whole tenths between two others where the force at risk should reach what is allowed; else the middle."""
        middle = (below + above) // 2
        if self._two_phases or below == 0:
            return middle
        ends = [round(tenths * SPEED_STEP_MM_S, 1) for tenths in (below, above)]
        limits = self.result(ends[0], area).problem.limits
        assert limits is not None
        allowed = limits.allowed_force_N(area, self._study.scenario.contact.peak_factor)
        low, high = (self.force_at_risk(speed, area) for speed in ends)
        if not 0 < low < high < math.inf or not low <= allowed < high:
            return middle
        share = math.log(allowed / low) / math.log(high / low)
        # The nearest tenth above: where the guess is good the next one closes the bracket from below.
        found: int = math.ceil(below * math.exp(share * math.log(above / below)))
        return min(max(found, below + 1), above - 1)


def _load(scenario: Scenario, table: str) -> LimitTable:
    from bumpstop.contact import LimitTable

    return LimitTable.load(table, relative_to=scenario.folder)


def _ascending(field: str, values: list[float] | None, default: tuple[float, ...]) -> tuple[float, ...]:
    if not values:
        return default
    for value in values:
        if not 0 < value < math.inf:
            raise InputError(field, f"{value:g} cannot be used", "wanted a finite number above 0")
    return tuple(sorted(set(values)))
