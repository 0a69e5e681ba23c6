"""Inputs of a situation: every value that its verdict rests on, what kind of value it is, and where it comes from."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from bumpstop.collision.scenario.arm_table import QUANTITY
from bumpstop.collision.scenario.keys import ASSUMED
from bumpstop.contact import builtin_tables, limit_forms
from bumpstop.contact.limits import LimitTable
from bumpstop.register.situation import says
from bumpstop.text_files import toml_value

if TYPE_CHECKING:
    from bumpstop.collision import CollisionResult
    from bumpstop.contact import ContactLimits
    from bumpstop.register.situation import Situation

Kind = Literal["required", "standard", "choice"]
KIND_WORDS: dict[Kind, str] = {
    "required": "required",
    "standard": "from a standard",
    "choice": "engineering choice",
}
"""Kinds of inputs as pages call them: what must be known of the cell, what a standard says, what somebody chose."""

_NONE = "no contact permitted"
# Tables of which every key is a fact of the cell, and further keys that are.
_REQUIRED_TABLES = ("motion", "detector", "reaction", "arm")
_REQUIRED = (
    *("robot", "base", "tip", "pose_deg", "pose_rad", "gravity_m_s2"),
    *("contact.body", "contact.kind", "contact.link", "contact.point_m", "contact.stiffness_N_m"),
    *("contact.body_mass_kg", "contact.padding_N_m", "contact.gauge_spring_N_m", "contact.gauge_mass_kg"),
)
_STANDARD = ("contact.limits", "contact.pressure_area", "verdict.clamped_limit")


@dataclass(frozen=True, kw_only=True)
class Input:
    """A value that a verdict rests on.

    Attributes:
        key: dotted key of the scenario, or a name in words where the value comes from elsewhere.
        value: as a page shows it, with its unit where the key has none.
        kind: required, from a standard, or an engineering choice.
        status: how well it is known: ``given``, ``default`` where nobody gave it, or the word of its source.
        source: where it comes from; empty: not told.
    """

    key: str
    value: str
    kind: Kind
    status: str
    source: str = ""


def inputs_of(situation: Situation, result: CollisionResult) -> tuple[Input, ...]:
    """Every key of the scenario that counts, then limits, stiffness, robot and drive train."""
    return (*_scenario_inputs(situation), *_limit_inputs(result), *_robot_inputs(situation, result))


def kind_of(key: str) -> Kind:
    """What kind of value a dotted key of a scenario is."""
    if key in _STANDARD:
        return "standard"
    return "required" if key in _REQUIRED or key.partition(".")[0] in _REQUIRED_TABLES else "choice"


def _scenario_inputs(situation: Situation) -> list[Input]:
    found = []
    scenario = situation.scenario
    given = _flat(scenario.model_dump(exclude_unset=True, exclude_none=True, mode="python"))
    for key, value in _flat(scenario.to_dict()).items():
        if key == ASSUMED:
            continue
        statement, somebody = situation.statement_of(key), key in given or says(given, key)
        if statement is not None:
            status, source = statement.status, statement.source
        elif key in scenario.assumed:
            status, source = "assumed", f"by {situation.scenario_file}"
        elif somebody and _gives(situation.changed, key):
            status, source = "given", "set when the register was read (--set)"
        elif somebody and _gives(situation.given, key):
            status, source = "given", f"{situation.file} {situation.place}"
        elif somebody:
            status, source = "given", str(situation.scenario_file)
        else:
            status, source = "default", "of bumpstop: nobody gave it"
        found.append(Input(key=key, value=toml_value(value), kind=kind_of(key), status=status, source=source))
    if "area_cm2" not in scenario.contact.model_fields_set and scenario.contact.body is not None:
        found.append(Input(key="contact.area_cm2", value="1", kind="choice", status="assumed", source="nobody gave it"))
    return found


def _gives(keys: Collection[str], key: str) -> bool:
    """Whether one of some dotted keys gives a value; of an uncertain input they name no more than the whole of it."""
    return says(keys, key) or any(each.startswith("uncertainty") and key.startswith(f"{each}.") for each in keys)


def _limit_inputs(result: CollisionResult) -> list[Input]:
    limits, problem = result.problem.limits, result.problem
    if limits is None:
        return []
    kind: Kind = "standard" if _of_standard(limits) else "choice"
    where = f"{limits.label} ({limits.table})"
    found = [
        Input(
            key=f"force limit, {where}",
            value=f"{limits.force_N:g} N" if limits.permitted else _NONE,
            kind=kind,
            status=limits.force_status,
            source=limits.force_source,
        )
    ]
    if limits.pressure_N_cm2 is not None:
        found.append(
            Input(
                key=f"pressure limit, {where}",
                value=f"{limits.pressure_N_cm2:g} N/cm² ({limits.pressure_area})" if limits.permitted else _NONE,
                kind=kind,
                status=limits.pressure_status or "",
                source=limits.pressure_source or "",
            )
        )
    contact = result.scenario.contact
    of_table = {"kind": kind, "status": limits.force_status, "source": limits.force_source}
    if contact.stiffness_N_m is None:
        found.append(Input(key=f"stiffness, {where}", value=f"{problem.body_stiffness:g} N/m", **of_table))  # type: ignore[arg-type]
    if contact.kind == "free" and contact.body_mass_kg is None and problem.body_mass is not None:
        found.append(Input(key=f"moving mass, {where}", value=f"{problem.body_mass:g} kg", **of_table))  # type: ignore[arg-type]
    return found


def _of_standard(limits: ContactLimits) -> bool:
    return limits.table in (*builtin_tables(), *limit_forms())


def _robot_inputs(situation: Situation, result: CollisionResult) -> list[Input]:
    robot, problem = result.problem.robot, result.problem
    found = [
        Input(
            key="geometry of the robot",
            value=robot.title or robot.name,
            kind="required",
            status="published" if situation.scenario.robot_path is None else "given",
            source=robot.source or str(situation.scenario.robot),
        )
    ]
    if problem.elastic or situation.scenario.contact.arm == "two_mass":
        found.append(
            Input(
                key="inertia of the robot",
                value="of its links",
                kind="required",
                status=robot.inertia_status,
                source=robot.inertia_source,
            )
        )
    if problem.elastic:
        train = problem.drive_train
        given = {quantity for key, quantity in QUANTITY.items() if getattr(situation.scenario.arm, key) is not None}
        found += [
            Input(
                key=f"drive train: {name.replace('_', ' ')}",
                value=", ".join(f"{value:.4g}" for value in getattr(train, name)),
                kind="required",
                status=train.status[name],
                source=train.source[name],
            )
            for name in train.status
            if name not in given
        ]
    reaction = situation.scenario.reaction
    if situation.payload_kg is not None and reaction.payload_kg is None and reaction.payload_percent is None:
        found.append(
            Input(
                key="payload",
                value=f"{situation.payload_kg:g} kg",
                kind="required",
                status="given",
                source=f"{situation.file} {situation.place}",
            )
        )
    return found


def _flat(data: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Dotted keys and their values."""
    found: dict[str, Any] = {}
    for key, value in data.items():
        found |= _flat(value, f"{prefix}{key}.") if isinstance(value, Mapping) else {prefix + key: value}
    return found


def tables_used(situations: list[Situation]) -> list[LimitTable]:
    """Limit tables of the user that situations are judged by, each once, in their order; built-in ones are left out.

    Their names have the file as the scenario names it: two tables may call themselves the same.
    """
    found: dict[LimitTable, str] = {}
    for situation in situations:
        contact = situation.scenario.contact
        if contact.body is not None and contact.limits not in builtin_tables():
            table = LimitTable.load(contact.limits, relative_to=situation.scenario.folder)
            found.setdefault(table, contact.limits)
    return [replace(table, name=f"{table.name} ({file})") for table, file in found.items()]
