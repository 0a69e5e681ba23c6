"""Effectiveness: what a detector is worth to every body part, by direction, speed and contact area."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

from bumpstop.errors import InputError, near_matches
from bumpstop.study.answer_warnings import FAILS_WITH_FINER_STEPS, AnswerWarnings
from bumpstop.study.parameters.region_collisions import MIN_SPEED_MM_S, RegionCollisions, keys_of_the_body
from bumpstop.study.study import Study, check_risk
from bumpstop.study.variable import Variable

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.collision import Scenario
    from bumpstop.contact import LimitTable

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
_MAX_SCENARIO_SPEED_MM_S = 1e5  # that a scenario takes
_OF_SAFE_SPEEDS = ("safe_speed_mm_s", "warnings", "fails_with_finer_steps")


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
        refusal = limits.reason or self._without_distribution(table, body)
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
            at = partial(self.scenario_of, table, body, direction)
            collisions = RegionCollisions(self.scenario, at, self.highest_speed_mm_s)
            rows += [own | collisions.collision(v, a) for a in self.areas_cm2 for v in self.speeds_mm_s]
            rows += [own | collisions.safe_speed(a) for a in self.areas_cm2]
        return pl.DataFrame(rows, schema=self._schema())

    def summary(self, rows: pl.DataFrame) -> dict[str, Any]:  # noqa: D102
        kinds = {kind: rows.filter(rows["kind"] == kind) for kind in ("collision", "safe_speed")}
        keys = ["table", "body", "label", "direction", "area_cm2"]
        return {
            "study": self.name,
            "contact": self.scenario.contact.kind,
            "risk": self.scenario.verdict.accepted_probability,
            "collisions": kinds["collision"].drop("kind", "binding", *_OF_SAFE_SPEEDS).to_dicts(),
            "safe_speeds": kinds["safe_speed"].select(*keys, "binding", "reason", *_OF_SAFE_SPEEDS).to_dicts(),
        }

    def answer_warnings(self, rows: pl.DataFrame, summary: Mapping[str, Any]) -> list[AnswerWarnings]:  # noqa: D102
        return [
            AnswerWarnings(f"{s['table']} {s['body']} {s['direction']} {s['area_cm2']:g} cm²", s["warnings"])
            for s in summary["safe_speeds"]
            if s["warnings"]
        ]

    def lines(self, summary: Mapping[str, Any]) -> list[str]:  # noqa: D102
        lines = [f"highest safe speed, mm/s (P(over a limit) at most {summary['risk']:g})"]
        for each in summary["safe_speeds"]:
            speed = each["safe_speed_mm_s"]
            found = each["reason"]
            if speed is not None:
                binding = each["binding"].replace("_", " ")
                ends = {"none": " or more", "untouched": ", faster nothing is hit in most cases"}
                found = f"{speed:g}{ends.get(binding, f', bound by {binding}')}"
                found += f", but {FAILS_WITH_FINER_STEPS}" if each["fails_with_finer_steps"] else ""
            lines.append(f"  {each['table']} {each['body']} {each['direction']} {each['area_cm2']:g} cm²: {found}")
        return lines

    def scenario_of(self, table: str, body: str, direction: str, speed: float, area: float) -> Scenario:
        """The scenario of one collision: the body's own stiffness and mass; slower arms get longer to go as far."""
        from bumpstop.collision import Scenario
        from bumpstop.collision.scenario.keys import leave_out
        from bumpstop.study.speed.motion_duration import duration_s

        data = self.scenario.to_dict()
        contact = data["contact"]
        leave_out(data, [f"contact.{key}" for key in keys_of_the_body(_load(self.scenario, table).region(body))])
        contact |= {"body": body, "limits": table, "area_cm2": area}
        motion_end = duration_s(self.scenario, speed / Variable("motion.speed").value(self.scenario))
        data["motion"] |= {"velocity_mm_s": [speed * x for x in DIRECTIONS[direction]], "duration_s": motion_end}
        return Scenario.from_dict(data, self.scenario.folder)

    def _without_distribution(self, table: str, body: str) -> str:
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
        return bool(limits.reason or self._without_distribution(table, body))

    def _schema(self) -> dict[str, Any]:
        import polars as pl

        from bumpstop.collision.scenario.scenario_file import robot_of

        text = ("kind", "table", "body", "label", "direction")
        numbers = (
            "area_cm2", "speed_mm_s", "limit_force_N", "limit_pressure_N_cm2", "mean_N", "sd_N", "p99_N", "p999_N",
            "p_over_force", "p_over_pressure", "false_alarm", "undetected", "several_joints",
        )  # fmt: skip
        dof = robot_of(self.scenario).dof
        return (
            dict.fromkeys(text, str)
            | dict.fromkeys(numbers, float)
            | {f"trigger_{j + 1}": float for j in range(dof)}
            | {"acceptable": bool, "safe_speed_mm_s": float, "binding": str, "reason": str}
            | {"warnings": pl.List(pl.String), "fails_with_finer_steps": bool}
        )


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
