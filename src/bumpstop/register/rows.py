"""Rows of a register: from what a person wrote to a checked situation, or to all that is wrong with it."""

from __future__ import annotations

import copy
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bumpstop.collision import CollisionProblem, Scenario
from bumpstop.collision.scenario.keys import set_keys, takes_out, told_to_take_out
from bumpstop.collision.scenario.scenario_file import robot_of
from bumpstop.collision.scenario.scenario_words import as_written
from bumpstop.errors import InputError, near_matches
from bumpstop.register.situation import Situation
from bumpstop.register.statements import Statement

# Short words of a row, and the scenario keys that they set.
WORDS = {
    "link": "contact.link",
    "point_m": "contact.point_m",
    "body": "contact.body",
    "kind": "contact.kind",
    "direction": "motion.direction",
    "speed_mm_s": "motion.speed_mm_s",
}
# Keys of a row that belong to the register alone.
OWN = ("name", "scenario", "payload_kg", "frequency", "note")
_PAYLOAD = ("payload_kg", "reaction.payload_kg")  # where a stopping table asks for it
_PAYLOADS = ("reaction.payload_kg", "reaction.payload_percent")
_MAX_PAYLOAD_KG = 1e4
MAX_NAME = 80
"""Letters of a name: names stand in tables."""
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+")
_UNCERTAIN = re.compile(r'uncertainty\."([^"]+)"')  # how errors begin that name an uncertain input
FORMULA = ("=", "+", "-", "@")
"""What no name begins with: a spreadsheet, in which such tables are opened, would compute the rest."""
NAME = f"wanted a text of 1 to {MAX_NAME} letters on one line that does not begin with {' '.join(FORMULA)}"
"""What a name may be."""


@dataclass(frozen=True)
class Base:
    """A scenario file that rows stand on.

    Attributes:
        path: of the file.
        tables: as read, not checked.
    """

    path: Path
    tables: Mapping[str, Any]


@dataclass(frozen=True)
class Fault:
    """What is wrong with a row.

    Attributes:
        key: dotted key of a scenario, or a key of the register.
        field: what of it, as an item of its list, in the words of the scenario.
        of_row: the row gives the key itself.
        error: under the name that the row has for the key.
    """

    key: str
    field: str
    of_row: bool
    error: InputError


class Row:
    """One row as it was written.

    Attributes:
        file: the register.
        place: of the row in it, ``row 3``.
        values: by the keys as written, without empty cells.
        texts: of the cells of a table, by the same keys; a value of two numbers may be one with a decimal comma.
    """

    def __init__(
        self, file: Path, place: str, values: Mapping[str, Any], texts: Mapping[str, str] | None = None
    ) -> None:
        self.file, self.place, self.texts = file, place, texts or {}
        name = values.get("name")
        self.name: str = (name.strip() or name) if isinstance(name, str) else ""
        self.values = {**values, "name": self.name} if self.name else values

    @property
    def where(self) -> str:
        """How messages call the row."""
        return f"{self.file} {self.place}" + (f" ({self.name!r})" if self.name else "")

    def check(
        self, base: Base, changes: Mapping[str, Any], statements: Mapping[str, Statement]
    ) -> tuple[Situation | None, list[Fault]]:
        """The situation, or all of its faults.

        Args:
            base: the scenario it stands on.
            changes: dotted keys that replace those of row and scenario.
            statements: of the register.
        """
        own, given, faults = self._split()
        data = copy.deepcopy(dict(base.tables))
        if isinstance(own.get("payload_kg"), float) and _by_stopping_table(data, given, changes):
            given["reaction.payload_kg"] = own["payload_kg"]
        scenario: Scenario | None = None
        try:
            set_keys(data, given)
            set_keys(data, changes)
        except InputError as error:
            faults.append(self._fault(error, given))
        else:
            scenario, found = Scenario.check(data, base.path.parent)
            found += _name_faults(data, scenario)
            if scenario is not None and not found:
                found += _problem_faults(scenario)
            faults += [self._fault(told_to_take_out(error, {**given, **changes}), given) for error in _distinct(found)]
        if faults or scenario is None:
            return None, faults
        return Situation(
            name=own["name"],
            scenario=scenario,
            file=self.file,
            scenario_file=base.path,
            place=self.place,
            frequency=own.get("frequency", ""),
            payload_kg=_payload_kg(scenario, own.get("payload_kg")),
            note=own.get("note", ""),
            given=given,
            changed=frozenset(changes),
            statements=statements,
        ), []

    def own_faults(self) -> list[Fault]:
        """Faults of the row that show without its scenario."""
        return self._split()[2]

    def _split(self) -> tuple[dict[str, Any], dict[str, Any], list[Fault]]:
        """Values of the register's own keys, dotted keys of the scenario, and faults of either."""
        own: dict[str, Any] = {}
        given: dict[str, Any] = {}
        faults: list[InputError] = []
        if "name" not in self.values:
            faults.append(InputError("name", "is missing", "wanted a text that no other situation has"))
        for key, value in self.values.items():
            if key in OWN:
                fault = _own_fault(key, value)
                faults += [fault] if fault is not None else []
                own[key] = float(value) if key == "payload_kg" and fault is None else value
            elif key in WORDS and WORDS[key] in self.values:
                faults.append(InputError(key, f"and {WORDS[key]} are both given", "give one of the two"))
            elif key in _PAYLOADS and "payload_kg" in self.values and not takes_out(value):
                faults.append(InputError("payload_kg", f"and {key} are both given", "give one of the two"))
            elif (unknown := unknown_key_of_row(key)) is not None:
                faults.append(unknown)
            else:
                given[WORDS.get(key, key)] = value
        # A whole table first: keys of it stand beside it, in whatever column.
        given = dict(sorted(given.items(), key=lambda item: "." in item[0]))
        return own, given, [Fault(each.field, each.field, True, self._named(each, each.field)) for each in faults]

    def _fault(self, error: InputError, given: Mapping[str, Any]) -> Fault:
        """A fault of the scenario under the word that the row has for its key."""
        uncertain = _UNCERTAIN.match(error.field)
        plain = f"uncertainty.{uncertain[1]}" if uncertain else error.field.partition("[")[0]
        words = {key: word for word, key in (*WORDS.items(), _PAYLOAD) if word in self.values}
        name = error.field.replace(plain, words.get(plain, plain), 1)
        return Fault(plain, error.field, is_set(given, plain), self._named(error, name))

    def _named(self, error: InputError, key: str) -> InputError:
        text, problem, valid = self.texts.get(key, ""), error.problem, error.valid
        if isinstance(self.values.get(key), list) and text:
            problem = problem.replace(as_written(self.values[key]), repr(text))
            if _DECIMAL_COMMA.fullmatch(text):
                valid = "write decimals with a dot: commas stand between the numbers of a list"
        return InputError(f"{self.where}, {key}", problem, valid)


def is_set(keys: Collection[str], key: str) -> bool:
    """Whether one of some dotted keys is a key, or the table that it stands in."""
    return key in keys or key.partition(".")[0] in keys


def _by_stopping_table(data: Mapping[str, Any], given: Mapping[str, Any], changes: Mapping[str, Any]) -> bool:
    """Whether the arm brakes by a stopping table, which asks for the payload; what is said last counts."""
    key, reaction = "reaction.deceleration", data.get("reaction")
    of_scenario = reaction.get("deceleration") if isinstance(reaction, Mapping) else None
    return bool(changes.get(key, given.get(key, of_scenario)) == "table")


def _payload_kg(scenario: Scenario, of_row: float | None) -> float | None:
    """What the arm carries [kg], as the stopping table has it where it is told; None: not told."""
    reaction = scenario.reaction
    if reaction.payload_percent is None:
        return of_row if reaction.payload_kg is None else reaction.payload_kg
    rated = robot_of(scenario).payload_kg
    return None if rated is None else rated * reaction.payload_percent / 100


def plain_keys() -> tuple[str, ...]:
    """Keys of a row that stand in no table of its scenario."""
    fields = Scenario.model_fields.items()
    plain = (name for name, model in fields if name != "folder" and not hasattr(model.annotation, "model_fields"))
    return (*OWN, *WORDS, *plain)


def unknown_key_of_row(key: str) -> InputError | None:
    """What is wrong with a key that no row can have; None where it may stand in one."""
    table, dot, name = key.partition(".")
    fields = {field: model.annotation for field, model in Scenario.model_fields.items() if field != "folder"}
    keys = getattr(fields.get(table), "model_fields", {})
    if dot:
        if name in keys or table == "uncertainty":
            return None
        valid = near_matches(name, keys) if keys else near_matches(table, fields)
        return InputError(key, "is not a key of a scenario", valid)
    if key in (*OWN, *WORDS) or (key in fields and not keys):
        return None
    valid = f"{near_matches(key, plain_keys())}; a key of a table is written with it, as contact.area_cm2"
    return InputError(key, "is no key of a situation", valid)


def _own_fault(key: str, value: Any) -> InputError | None:
    problem = f"{as_written(value)} cannot be used"
    if key == "payload_kg":
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if number and 0 <= value <= _MAX_PAYLOAD_KG:
            return None
        return InputError(key, problem, f"wanted a number from 0 to {_MAX_PAYLOAD_KG:g}")
    if not isinstance(value, str):
        return InputError(key, problem, "wanted a text")
    return None if key != "name" or is_name(value) else InputError(key, problem, NAME)


def is_name(text: str) -> bool:
    """Whether a situation can have this name."""
    plain = text.strip()
    return 0 < len(plain) <= MAX_NAME and text.isprintable() and not plain.startswith(FORMULA)


def _name_faults(data: Mapping[str, Any], scenario: Scenario | None) -> list[InputError]:
    """Names of body region and link that do not exist, also beside other faults."""
    from bumpstop.contact import LimitTable
    from bumpstop.model import Robot, robots

    found: list[InputError] = []
    contact = data.get("contact")
    if not isinstance(contact, Mapping):
        return found
    limits, body, link = contact.get("limits", "bgia2011"), contact.get("body"), contact.get("link")
    relative = scenario.folder if scenario is not None else Path()
    if isinstance(limits, str) and isinstance(body, str) and (scenario is not None or not _is_file(limits)):
        try:
            LimitTable.load(limits, relative_to=relative).region(body)
        except InputError as error:
            found.append(error)
    name = data.get("robot")
    if isinstance(link, str):
        try:
            if scenario is not None:
                robot_of(scenario).frame(link)
            elif name in robots():
                Robot.load(str(name)).frame(link)
        except InputError as error:
            key = f"contact.{error.field}" if error.field == "link" else error.field
            found.append(InputError(key, error.problem, error.valid))
    return found


def _is_file(limits: str) -> bool:
    return limits.endswith(".toml") or "/" in limits


def _problem_faults(scenario: Scenario) -> list[InputError]:
    """What is wrong with a scenario beside its robot, its limit table and its files."""
    try:
        problem = CollisionProblem.from_scenario(scenario)
        assert problem.setup is not None
        if scenario.uncertainty:
            from bumpstop.uncertainty.resolved_input import resolve

            resolve(problem)
    except InputError as error:
        return [error]
    return []


def _distinct(faults: list[InputError]) -> list[InputError]:
    return list({(fault.field, fault.problem): fault for fault in faults}.values())
