"""Variables: what about a scenario is varied, by the name a person gives it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bumpstop.arrays import as_name
from bumpstop.errors import InputError, near_matches
from bumpstop.study.speed.motion_duration import duration_s

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario

# Names for what is more than one key: with unit, and what they mean.
ALIASES = {
    "motion.speed": ("mm/s", "speed of the tip; the direction stays, and slower arms get longer to go as far"),
    "detector.thresholds": ("Nm", "lowest threshold; the others in proportion, the noise stays"),
    "detector.thresholds_and_noise": ("Nm", "lowest threshold; the others and the noise in proportion"),
    "contact.padding": ("N/m", "contact.padding_N_m"),
    "contact.stiffness": ("N/m", "contact.stiffness_N_m"),
}
# Keys of a scenario that mean what an alias does.
_KEYS_OF_ALIASES = {"motion.speed_mm_s": "motion.speed"}
_WORDS = {
    "detector.thresholds": "lowest threshold",
    "detector.thresholds_and_noise": "lowest threshold and noise",
}
# What comes first is taken: _mm_s ends in _s, too.
_UNITS = {
    "_rad_s2": "rad/s2", "_m_s2": "m/s2", "_mm_s": "mm/s", "_N_mm": "N/mm", "_Ns_m": "Ns/m", "_Nm_rad": "Nm/rad",
    "_N_m": "N/m", "_kg_m2": "kg m2", "_cm2": "cm2", "_1_s": "1/s", "_percent": "%", "_hz": "Hz", "_deg": "deg",
    "_rad": "rad", "_Nm": "Nm", "_kg": "kg", "_mm": "mm", "_m": "m", "_s": "s",
}  # fmt: skip
# Units of a joint that turns, and those of one that slides.
_SLIDING = {"rad/s2": "m/s2", "deg": "m", "rad": "m", "Nm": "N", "Nm/rad": "N/m", "kg m2": "kg"}
_NOT_VARIED = (
    *("motion.velocity_mm_s", "motion.direction", "pose_deg", "pose_rad"),
    *("contact.point_m", "contact.normal", "gravity_m_s2"),
)


def canonical(name: str) -> str:
    """The name of a variable that has two."""
    return _KEYS_OF_ALIASES.get(name, name)


def per(quantity: str, unit: str) -> str:
    """Unit of a derivative: ``per("N", "mm/s")`` is ``"N/(mm/s)"``, and nothing is divided by no unit."""
    if not unit:
        return quantity
    return f"{quantity}/({unit})" if "/" in unit or " " in unit else f"{quantity}/{unit}"


@dataclass(frozen=True)
class Variable:
    """A numeric key of a scenario, one item of a list, or one of :data:`ALIASES`.

    Attributes:
        name: ``motion.speed``, ``contact.area_cm2``, ``detector.thresholds_Nm[2]``; items count from 1. The name of a
            list with one number per joint stands for the lowest of them; the others change in proportion.
    """

    name: str

    def __post_init__(self) -> None:
        """Call what has two names by one."""
        object.__setattr__(self, "name", canonical(as_name(self.name, "--vary", "wanted a key of a scenario")))

    def unit(self, scenario: Scenario) -> str:
        """Of its values; empty for a bare number. What belongs to joints that slide has their unit."""
        if self.name in ALIASES:
            unit = ALIASES[self.name][0]
        else:
            unit = next((unit for ending, unit in _UNITS.items() if self.key.endswith(ending)), "")
        if unit not in _SLIDING:
            return unit
        from bumpstop.collision.scenario.scenario_file import robot_of
        from bumpstop.model import unit_of

        joints = robot_of(scenario).joints
        whole = scenario.detector.thresholds_Nm if self.name in ALIASES else self._whole(scenario)
        if self._item is not None:
            joints = joints[self._item - 1 : self._item]
        elif isinstance(whole, list):
            joints = tuple(joint for joint, value in zip(joints, whole, strict=True) if value == min(whole))
        return unit_of(*joints, turning=unit, sliding=_SLIDING[unit])

    def label(self, scenario: Scenario) -> str:
        """Name with unit, for people."""
        words = self.name.rpartition(".")[2] if self.name in ALIASES else self.name
        unit = self.unit(scenario)
        return _WORDS.get(self.name, words) + (f" [{unit}]" if unit else "")

    @property
    def key(self) -> str:
        """The key of a scenario that it sets, or an alias of more than one."""
        return {"contact.padding": "contact.padding_N_m", "contact.stiffness": "contact.stiffness_N_m"}.get(
            self.name, self.name.partition("[")[0]
        )

    @property
    def _item(self) -> int | None:
        found = re.fullmatch(r"[^\[\]]+\[([0-9]{1,4})\]", self.name)
        return int(found[1]) if found else None

    def value(self, scenario: Scenario) -> float:
        """Its value in a scenario; of ``contact.padding`` infinity where there is none.

        A latency counts as what it is rounded up to: whole simulation steps.

        Raises:
            InputError: it is no numeric key, or the scenario has no value there.
        """
        motion, detector = scenario.motion, scenario.detector
        if self.name == "motion.speed":
            if motion.velocity_mm_s is None:
                raise InputError(self.name, "has no meaning with a trajectory", 'wanted motion.kind = "line"')
            return math.hypot(*motion.velocity_mm_s)
        if self.name in ("detector.thresholds", "detector.thresholds_and_noise"):
            lowest = min(detector.thresholds_Nm, default=math.inf)
            if not math.isfinite(lowest):
                raise InputError(self.name, "monitors no joint", "wanted a finite threshold")
            return lowest
        if self.name in ("contact.stiffness", "contact.stiffness_N_mm"):
            stiffness = scenario.contact.stiffness_N_m
            if stiffness is None:
                from bumpstop.collision import CollisionProblem

                stiffness = CollisionProblem.from_scenario(scenario).body_stiffness
            return stiffness if self.name == "contact.stiffness" else stiffness / 1e3
        if self.name == "contact.padding" and scenario.contact.padding_N_m is None:
            return math.inf
        found = self._lookup(scenario)
        if isinstance(found, bool) or not isinstance(found, int | float):
            raise self._unusable(found)
        if self.name == "reaction.latency_s":
            step = scenario.simulation.step_s
            return self.quantised(scenario, math.ceil(found / step - 1e-9) * step)
        return float(found)

    def apply(self, scenario: Scenario, value: float) -> Scenario:
        """A copy of the scenario with this value; quantised ones must have been rounded by :meth:`quantised`.

        Raises:
            InputError: the value is outside what the key takes.
        """
        return scenario.with_values(self.changes(scenario, value))

    def changes(self, scenario: Scenario, value: float) -> dict[str, Any]:
        """The keys to be changed for this value, as :meth:`Scenario.with_values` takes them."""
        value = float(value)
        if self.name in ALIASES and not value > 0:
            problem = f"{self.name} of {value:g} {self.unit(scenario)} has no meaning"
            raise InputError("--vary", problem, "wanted a value above 0")
        detector = scenario.detector
        if self.name == "motion.speed":
            assert scenario.motion.velocity_mm_s is not None
            factor = value / self.value(scenario)
            # In the same time a slow arm would not get to the body, and its force would seem to be zero.
            return {
                "motion.velocity_mm_s": [factor * v for v in scenario.motion.velocity_mm_s],
                "motion.duration_s": duration_s(scenario, factor),
            }
        if self.name in ("detector.thresholds", "detector.thresholds_and_noise"):
            factor = value / self.value(scenario)
            changes: dict[str, Any] = {"detector.thresholds_Nm": [factor * t for t in detector.thresholds_Nm]}
            if self.name == "detector.thresholds_and_noise":
                sd = detector.noise_sd_Nm
                if sd is None:
                    raise InputError(self.name, "cannot scale measured residuals", "valid: detector.thresholds")
                changes["detector.noise_sd_Nm"] = [factor * s for s in sd] if isinstance(sd, list) else factor * sd
            return changes
        written: Any = int(value) if self.quantum(scenario) == 1 and value == int(value) else value
        if self.name == "contact.padding" and math.isinf(value):
            return {"contact.padding_N_m": None}
        item, whole = self._item, self._whole(scenario)
        if item is None and isinstance(whole, list):
            factor = value / self.value(scenario)
            return {self.key: [factor * each for each in whole]}
        if item is None:
            return {self.key: written}
        assert isinstance(whole, list)
        found = list(whole)
        found[item - 1] = written
        return {self.key: found}

    def quantum(self, scenario: Scenario) -> float | None:
        """Step between the values it can take: a simulation step, or 1 for whole numbers; None: any value will do."""
        if self.key in ("detector.feedback_period_s", "reaction.latency_s"):
            return scenario.simulation.step_s
        return 1.0 if self.key == "simulation.substeps" else None

    def quantised(self, scenario: Scenario, value: float) -> float:
        """The nearest value it can take."""
        step = self.quantum(scenario)
        if step is None:
            return float(value)
        # Of decimals like 0.003 the product of steps is not the nearest number.
        return float(f"{round(value / step) * step:.12g}")

    def check(self, scenario: Scenario) -> None:
        """Refuse a name that is no numeric key of a scenario, or has no value there.

        Raises:
            InputError: names what could be meant.
        """
        self.value(scenario)

    def _lookup(self, scenario: Scenario) -> Any:
        table, _, key = self.key.rpartition(".")
        here: Any = getattr(scenario, table, None) if table else scenario
        fields = getattr(type(here), "model_fields", {}) if here is not None else {}
        if key not in fields or key in ("folder", "robot", "base", "tip") or "." in table:
            raise InputError(
                "--vary", f"{self.name!r} is no numeric key of a scenario", near_matches(self.name, names())
            )
        found = getattr(here, key)
        item = self._item
        if "[" in self.name and item is None:
            raise InputError("--vary", f"{self.name!r} names no item", f"items count from 1, e.g. {self.key}[1]")
        if hasattr(type(found), "model_fields"):
            raise InputError("--vary", f"{self.name!r} is a table", f"wanted one of its keys, e.g. {_key_of(key)}")
        if item is not None and not isinstance(found, list):
            raise InputError("--vary", f"{self.name!r} is not there", f"{self.key} is no list in this scenario")
        if item is not None:
            if not 1 <= item <= len(found):
                raise InputError("--vary", f"{self.name!r} is not there", f"{self.key} has {len(found)} items")
            return found[item - 1]
        if item is None and isinstance(found, list) and found and self.key not in _NOT_VARIED:
            lowest = min(found)
            if not 0 < lowest < math.inf:
                problem = f"{self.name!r} has {lowest:g} as its lowest item, to which nothing is in proportion"
                raise InputError("--vary", problem, f"wanted one of its items, e.g. {self.key}[1]")
            return lowest
        return found

    def _whole(self, scenario: Scenario) -> Any:
        table, _, key = self.key.rpartition(".")
        return getattr(getattr(scenario, table) if table else scenario, key)

    def _unusable(self, found: Any) -> InputError:
        if self.key in ("motion.velocity_mm_s", "motion.direction"):
            return InputError("--vary", f"{self.name!r} is a direction", "valid: motion.speed, or one of its items")
        if isinstance(found, list):
            return InputError("--vary", f"{self.name!r} is a list", f"wanted one of its items, e.g. {self.key}[1]")
        if found is None:
            return InputError("--vary", f"{self.name!r} has no value in the scenario", "give it one with --set first")
        return InputError("--vary", f"{self.name!r} is {found!r}, no number", "wanted a numeric key")


def _key_of(name: str) -> str:
    return next(key for key in names() if key.startswith(f"{name}.") and key not in ALIASES)


def names() -> list[str]:
    """Names of all variables, aliases first; those of lists stand for their items too."""
    from bumpstop.collision.scenario.scenario import Scenario

    found = list(ALIASES)
    for table in ("motion", "contact", "detector", "reaction", "simulation", "verdict"):
        schema: Any = Scenario.model_fields[table].annotation
        for key, about in schema.model_json_schema()["properties"].items():
            kinds = {branch.get("type") for branch in [about, *about.get("anyOf", [])]}
            if kinds & {"number", "integer", "array"}:
                found.append(f"{table}.{key}")
    return found
