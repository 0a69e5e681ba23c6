"""What a scenario says of how well its numbers are known: a distribution or an admissible interval by key."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal, cast

from bumpstop.collision.scenario.scenario_words import as_written, short
from bumpstop.collision.scenario.spellings import check_one_spelling
from bumpstop.collision.scenario.unused_keys import keys_without_effect
from bumpstop.errors import InputError, near_matches

if TYPE_CHECKING:
    from pydantic import BaseModel

    from bumpstop.collision.scenario.scenario_tables import ScenarioTables

Shape = Literal["normal", "lognormal", "uniform", "triangular", "samples", "interval"]

# Keys of an inline table: the sets that a shape takes, and what errors say of them.
_FORMS: dict[str, tuple[set[str], ...]] = {
    "normal": ({"mean", "sd"}, {"mean", "relative_sd"}, {"sd"}, {"relative_sd"}),
    "lognormal": ({"median", "sigma"}, {"sigma"}),
    "uniform": ({"low", "high"}, {"relative"}),
    "triangular": ({"low", "mode", "high"}, {"relative"}),
    "samples": ({"file"}, {"relative_file"}),
    "interval": ({"interval"}, {"relative"}),
}
_FIGURES = ("mean", "sd", "relative_sd", "median", "sigma", "low", "mode", "high")
_LISTS = ("relative", "interval")
_TEXTS = ("file", "relative_file")
_KNOWN = ("distribution", *_FIGURES, *_LISTS, *_TEXTS, "assumed")

# Factors that are no key of a scenario; each is 1 where nobody says otherwise.
FACTORS = {
    "detector.threshold_scale": "thresholds as they act over those given, as they drift with temperature",
    "detector.torque_gain": "joint torque as the joint model estimates it over the true one",
}
FACTOR_RANGE = (0.01, 100.0)
# Keys outside [contact], [arm], [detector] and [reaction] that may be uncertain, the last two by item.
_OTHERS = ("motion.speed_mm_s", "motion.contact_onset_s", "pose_deg", "pose_rad")
# Numbers that are settings, not quantities of the cell.
_NOT_UNCERTAIN = ("detector.feedback_period_s", "reaction.stop_category")
# Lists that are vectors or poses: no factor has a meaning for all of their items.
_BY_ITEM = ("contact.point_m", "contact.normal", "pose_deg", "pose_rad")
_NO_KEY = "is not a number of a scenario that may be uncertain"
_MAX_INPUTS = 40
_THRESHOLDS = (1e-6, 1e9)


@dataclass(frozen=True)
class UncertainInput:
    """One key of ``[uncertainty]``.

    Attributes:
        key: dotted key of the scenario, with ``[i]`` for an item of a list, counted from 1; or one of :data:`FACTORS`.
        shape: of the distribution, or ``"interval"``.
        figures: normal: mean (NaN: the value given) and sd; lognormal: median and sd of the logarithm; uniform and
            interval: low, high; triangular: low, mode, high; samples: none. In the unit of the key, or as factors.
        relative: the figures are factors on the value given.
        assumed: nobody measured it; intervals always are.
        file: of samples, as written.
    """

    key: str
    shape: Shape
    figures: tuple[float, ...]
    relative: bool
    assumed: bool
    file: str | None = None

    @property
    def field(self) -> str:
        """How errors name it."""
        return f'uncertainty."{self.key}"'

    @property
    def whole_key(self) -> str:
        """The key without the item."""
        return self.key.partition("[")[0]

    @property
    def item(self) -> int | None:
        """The item of a list, from 0; None: the whole key."""
        found = re.search(r"\[([0-9]+)\]$", self.key)
        return int(found[1]) - 1 if found else None

    @property
    def is_factor(self) -> bool:
        """Whether it is one of :data:`FACTORS`."""
        return self.whole_key in FACTORS


def flattened(value: Any) -> dict[str, Any]:
    """The table with dotted keys, whether they were written in quotes or as tables within tables.

    Raises:
        InputError: it is no table, or has a key in both ways.
    """
    if not isinstance(value, Mapping):
        raise InputError(
            "uncertainty", f"{as_written(value)} cannot be used", "wanted a table: [uncertainty] with keys and tables"
        )
    found: dict[str, Any] = {}
    for key, spec in _leaves("", value):
        if key in found:
            raise InputError(f'uncertainty."{key}"', "is given twice", "give it once")
        found[key] = spec
    return found


def _leaves(before: str, table: Mapping[Any, Any]) -> Iterator[tuple[str, Any]]:
    for name, inner in table.items():
        key = f"{before}{name}"
        # A table of tables is a part of a dotted key; what says how well something is known has none inside.
        if isinstance(inner, Mapping) and inner and all(isinstance(value, Mapping) for value in inner.values()):
            yield from _leaves(f"{key}.", inner)
        else:
            yield key, inner


def uncertain_inputs(scenario: ScenarioTables) -> tuple[UncertainInput, ...]:
    """The uncertain inputs of a checked scenario, in the order in which they are written."""
    return tuple(_parsed(key, spec) for key, spec in scenario.uncertainty.items())


def check_uncertainty(scenario: ScenarioTables) -> None:
    """Check ``[uncertainty]`` against the other tables.

    Raises:
        InputError: a key that is none or cannot be uncertain, an unusable form or figure, a value that is impossible.
    """
    if len(scenario.uncertainty) > _MAX_INPUTS:
        problem = f"names {len(scenario.uncertainty)} keys"
        raise InputError("uncertainty", problem, f"wanted at most {_MAX_INPUTS}")
    inputs = uncertain_inputs(scenario)
    for each in inputs:
        _check_key(each, scenario)
        low, high = valid_range(type(scenario), each)
        if not each.relative:
            _check_figures(each, low, high)
    whole = {each.key for each in inputs if each.item is None}
    for each in inputs:
        if each.item is not None and each.whole_key in whole:
            raise InputError(each.field, f"and {each.whole_key} are both given", "give the list or its items")
    try:
        check_one_spelling(each.whole_key for each in inputs)
    except InputError as error:
        raise InputError(f'uncertainty."{error.field}"', error.problem, error.valid) from None


def check_name(name: str, scenario: type[BaseModel]) -> None:
    """Refuse what is neither a key that may be uncertain, with or without an item, nor a table of such keys."""
    known = [*_numeric_keys(scenario), *FACTORS]
    whole = name.partition("[")[0]
    if not any(key == whole or key.startswith(f"{name}.") for key in known):
        raise InputError(f'uncertainty."{name}"', _NO_KEY, near_matches(whole, known))


def _parsed(key: str, spec: Any) -> UncertainInput:
    field = f'uncertainty."{key}"'
    if not isinstance(spec, Mapping):
        raise InputError(
            field, f"{as_written(spec)} cannot be used", 'wanted { distribution = "normal", ... } or { interval = ... }'
        )
    for name in spec:
        if name not in _KNOWN:
            raise InputError(f"{field}.{name}", "is not a key of an uncertain input", near_matches(str(name), _KNOWN))
    shape = spec.get("distribution", "interval")
    if shape not in _FORMS or (shape == "interval" and "distribution" in spec):
        valid = near_matches(str(shape), [name for name in _FORMS if name != "interval"])
        raise InputError(f"{field}.distribution", f"{as_written(shape)} cannot be used", valid)
    assumed = spec.get("assumed", shape == "interval")
    if not isinstance(assumed, bool):
        raise InputError(f"{field}.assumed", f"{as_written(assumed)} cannot be used", "wanted true or false")
    if shape == "interval" and not assumed:
        raise InputError(f"{field}.assumed", "is false", "what only has an interval is assumed: give a distribution")
    given = set(spec) - {"distribution", "assumed"}
    if given not in _FORMS[shape]:
        forms = " or ".join(" with ".join(sorted(form, key=_KNOWN.index)) for form in _FORMS[shape])
        got = ", ".join(sorted(given, key=_KNOWN.index)) or "nothing"
        raise InputError(field, f"{shape} has {got}", f"wanted {forms}")
    figures = {name: _number(f"{field}.{name}", spec[name]) for name in given if name in _FIGURES}
    relative, values = _figures(shape, given, figures, field, spec)
    file = next((spec[name] for name in _TEXTS if name in given), None)
    if shape == "samples" and not isinstance(file, str):
        raise InputError(f"{field}.file", f"{as_written(file)} cannot be used", "wanted the path of a CSV file")
    return UncertainInput(key, cast(Shape, shape), values, relative, assumed, file)


def _figures(
    shape: str, given: set[str], figures: dict[str, float], field: str, spec: Mapping[str, Any]
) -> tuple[bool, tuple[float, ...]]:
    """Whether they are factors, and the figures in the order of :class:`UncertainInput`."""
    if shape == "samples":
        return "relative_file" in given, ()
    for name in given & {"sd", "relative_sd", "sigma"}:
        if not figures[name] > 0:
            raise InputError(f"{field}.{name}", f"is {figures[name]:g}", "wanted a number above 0")
    if shape == "normal":
        if "sd" in given:
            return False, (figures.get("mean", math.nan), figures["sd"])
        if "mean" in given:
            if figures["mean"] == 0:
                raise InputError(f"{field}.relative_sd", "is a share of a mean of 0", "give sd")
            return False, (figures["mean"], figures["relative_sd"] * abs(figures["mean"]))
        return True, (1.0, figures["relative_sd"])
    if shape == "lognormal":
        if "median" in given and not figures["median"] > 0:
            raise InputError(f"{field}.median", f"is {figures['median']:g}", "wanted a number above 0")
        return "median" not in given, (figures.get("median", 1.0), figures["sigma"])
    written = next((part for part in _LISTS if part in given), None)
    wanted = 3 if shape == "triangular" else 2
    if written is None:
        values = tuple(figures[part] for part in ("low", "mode", "high") if part in given)
    else:
        items = spec[written]
        if not isinstance(items, list | tuple) or len(items) != wanted:
            raise InputError(f"{field}.{written}", f"{as_written(items)} cannot be used", f"wanted {wanted} numbers")
        values = tuple(_number(f"{field}.{written}[{i}]", item) for i, item in enumerate(items, start=1))
    ordered = all(a <= b for a, b in pairwise(values)) and values[0] < values[-1]
    if not ordered:
        problem = f"runs from {' to '.join(f'{value:g}' for value in values)}"
        raise InputError(field if written is None else f"{field}.{written}", problem, "wanted ascending numbers")
    if written == "relative" and not values[0] > 0:
        raise InputError(f"{field}.relative", f"begins with {values[0]:g}", "wanted factors above 0")
    return written == "relative", values


def _number(field: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= 1e12:
        raise InputError(field, f"{as_written(value)} cannot be used", "wanted a number from -1e12 to 1e12")
    return float(value)


def _check_key(each: UncertainInput, scenario: ScenarioTables) -> None:
    if each.is_factor:
        if scenario.detector.residuals is not None:
            raise InputError(each.field, "has no meaning with detector.residuals", "vary detector.thresholds_Nm")
        return
    known = _numeric_keys(type(scenario))
    if each.whole_key not in known or re.search(r"[\[\]]", each.key.replace(f"[{(each.item or 0) + 1}]", "", 1)):
        raise InputError(each.field, _NO_KEY, near_matches(each.whole_key, [*known, *FACTORS]))
    if each.whole_key in _BY_ITEM and each.item is None:
        raise InputError(each.field, "is a list", f"name one of its items, as {each.key}[1]")
    if each.whole_key.startswith("arm.") and scenario.arm.model == "rigid":
        raise InputError(each.field, 'has no meaning with arm.model = "rigid"', 'leave it out, or model = "elastic"')
    if each.whole_key == "contact.area_cm2" and "area_cm2" not in scenario.contact.model_fields_set:
        # Its default is an assumption, which no verdict should be relative to.
        raise InputError(each.field, "tells how well an area is known that is not given", "give contact.area_cm2, too")
    why = keys_without_effect(scenario).get(each.whole_key)
    if why is not None:
        raise InputError(each.field, f"has no effect {why}", "leave it out")


def _check_figures(each: UncertainInput, low: float, high: float) -> None:
    """Of shapes with ends, both must be possible; of the others the middle."""
    if each.shape in ("uniform", "triangular", "interval"):
        ends = [each.figures[0], each.figures[-1]]
    else:
        ends = [value for value in each.figures[:1] if not math.isnan(value)]
    for value in ends:
        if not low <= value <= high:
            problem = f"reaches {value:g}, which {each.whole_key} cannot be"
            raise InputError(each.field, problem, f"wanted {short(low)} to {short(high)}")


def valid_range(scenario: type[BaseModel], each: UncertainInput) -> tuple[float, float]:
    """Least and greatest value of a key."""
    return FACTOR_RANGE if each.is_factor else _numeric_keys(scenario)[each.whole_key]


@cache
def _numeric_keys(scenario: type[BaseModel]) -> dict[str, tuple[float, float]]:
    """Keys that may be uncertain, with least and greatest value."""
    found: dict[str, tuple[float, float]] = {}
    for table in ("contact", "arm", "detector", "reaction", "motion"):
        model: Any = scenario.model_fields[table].annotation
        for name, schema in model.model_json_schema()["properties"].items():
            key = f"{table}.{name}"
            if key not in _NOT_UNCERTAIN and (table != "motion" or key in _OTHERS) and (ends := _ends(schema)):
                found[key] = ends
    properties = scenario.model_json_schema()["properties"]
    for key in ("pose_deg", "pose_rad"):
        ends = _ends(properties[key])
        assert ends is not None
        found[key] = ends
    return found | {"detector.thresholds_Nm": _THRESHOLDS}


def _ends(schema: dict[str, Any]) -> tuple[float, float] | None:
    """Of a JSON schema of a number, or of a list of numbers; None of anything else."""
    for branch in [schema, *schema.get("anyOf", [])]:
        inner = branch.get("items", branch) if branch.get("type") == "array" else branch
        if inner.get("type") == "number" and "minimum" in inner:
            return float(inner["minimum"]), float(inner["maximum"])
    return None
