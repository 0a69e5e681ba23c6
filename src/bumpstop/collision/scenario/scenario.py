"""Scenarios: the tables a person writes, checked strictly."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError, field_validator, model_validator

from bumpstop.collision.scenario.keys import ASSUMED, MADE_BY, leave_out, set_keys, told_to_take_out
from bumpstop.collision.scenario.scenario_tables import ScenarioTables
from bumpstop.collision.scenario.scenario_words import as_written, explain, explain_all, unknown_key
from bumpstop.collision.scenario.spellings import other_spelling
from bumpstop.collision.scenario.uncertainty_table import check_uncertainty, flattened
from bumpstop.collision.scenario.unused_keys import given_without_effect, keys_without_effect
from bumpstop.errors import InputError, near_matches
from bumpstop.model.dynamics import check_free_fall

# Keys of [motion] that say its velocity in parts.
_SPEED = ("speed_mm_s", "direction")
# Where the body is, is how far the line still goes to it; in a trajectory it is when contact begins.
_OFFSET = ("offset_law", "offset_sd_s", "offset_mm")


class Scenario(ScenarioTables):
    """One collision: robot, pose, motion, contact, detector, reaction.

    The attributes are the keys of the scenario file, in the file's units (docs/reference/collision.md lists them).
    ``folder`` is where relative paths start.
    """

    @field_validator("uncertainty", mode="before")
    @classmethod
    def _dotted_keys(cls, value: Any) -> dict[str, Any]:
        return flattened(value)

    @model_validator(mode="after")
    def _links_of_urdf(self) -> Scenario:
        for key in ("base", "tip"):
            if getattr(self, key) is not None and self.robot_path is None:
                raise InputError(
                    key, f"has no meaning with the built-in robot {self.robot!r}", "give it with the path of a URDF"
                )
        return self

    @model_validator(mode="after")
    def _falls_as_on_earth(self) -> Scenario:
        check_free_fall(self.gravity_m_s2, "gravity_m_s2")
        return self

    @model_validator(mode="after")
    def _one_arm(self) -> Scenario:
        if self.arm.model == "elastic" and self.contact.arm == "two_mass":
            raise InputError(
                "contact.arm",
                "'two_mass' has no meaning with arm.model = \"elastic\"",
                "an elastic arm has its own masses",
            )
        return self

    @model_validator(mode="after")
    def _one_pose(self) -> Scenario:
        if self.motion.kind == "trajectory":
            for key in ("pose_deg", "pose_rad"):
                if getattr(self, key) is not None:
                    raise InputError(key, 'has no meaning with motion.kind = "trajectory"', "leave it out")
            for key in _OFFSET:
                if key in self.contact.model_fields_set:
                    raise InputError(
                        f"contact.{key}",
                        'has no meaning with motion.kind = "trajectory"',
                        "leave it out: motion.contact_onset_s says when contact begins",
                    )
            if self.contact.arm == "two_mass":
                problem = "'two_mass' is not available with motion.kind = \"trajectory\""
                raise InputError("contact.arm", problem, "valid: 'position_driven': the arm's mass changes on the way")
            if self.reaction.stop_category == 0:
                problem = '0 is not available with motion.kind = "trajectory"'
                raise InputError("reaction.stop_category", problem, "valid: 1 or 2, which keep to the path")
            return self
        if (self.pose_deg is None) == (self.pose_rad is None):
            problem = "is missing" if self.pose_deg is None else "and pose_rad are both given"
            raise InputError("pose_deg", problem, "give pose_deg or pose_rad, one of them")
        return self

    @model_validator(mode="after")
    def _assumed_is_given(self) -> Scenario:
        if not self.assumed:
            return self
        given = self.model_fields_set - {ASSUMED, "folder"}
        tables = {name for name in given if hasattr(getattr(self, name), "model_fields_set")}
        keys = (given - tables) | {f"{name}.{key}" for name in tables for key in getattr(self, name).model_fields_set}
        for key in self.assumed:
            if keys.isdisjoint((key, *other_spelling(key))):
                problem = f"{as_written(key)} is no key that is given here"
                raise InputError(ASSUMED, problem, near_matches(key, sorted(keys)))
        return self

    @model_validator(mode="after")
    def _possible_uncertainty(self) -> Scenario:
        if self.uncertainty:
            check_uncertainty(self)
        return self

    @classmethod
    def from_dict(cls, data: dict[str, Any], folder: Path | str = ".") -> Scenario:
        """Check a scenario given as nested dictionaries.

        Args:
            data: the tables and keys of the scenario file. The table ``made_by`` of a ``settings.toml`` is not read.
            folder: where relative paths in it start.

        Raises:
            InputError: a key is unknown, missing or has a value that cannot be used.
        """
        scenario, faults = cls.check(data, folder, all_faults=False)
        if scenario is None:
            raise faults[0]
        return scenario

    @classmethod
    def check(
        cls, data: dict[str, Any], folder: Path | str = ".", *, all_faults: bool = True
    ) -> tuple[Scenario | None, list[InputError]]:
        """The scenario of nested dictionaries, or what is wrong with it.

        Args:
            data: the tables and keys of the scenario file, as in :meth:`from_dict`.
            folder: where relative paths in it start.
            all_faults: find every key that cannot be used, not the first alone.
        """
        if not isinstance(data, Mapping):
            problem = f"{as_written(data)} cannot be used"
            return None, [InputError("scenario", problem, "wanted a dictionary of its tables and keys")]
        tables = _plain(data)
        if isinstance(tables.get(MADE_BY), dict):
            del tables[MADE_BY]
        if "folder" in tables:
            return None, [unknown_key(cls, ("folder",))]
        try:
            return cls.model_validate({**tables, "folder": Path(folder)}), []
        except ValidationError as error:
            # Only their words: pydantic's error holds that of a validator, and so the frames that lead there, where the
            # collector of cycles cannot see it. As context of a refusal that a caller keeps it would never be freed.
            return None, explain_all(cls, error) if all_faults else [explain(cls, error)]

    def with_values(self, changes: dict[str, Any]) -> Scenario:
        """A copy with some keys changed.

        Args:
            changes: dotted keys and their new values, e.g. ``{"motion.velocity_mm_s": [0, 50, 0]}``; None, or the
                word ``none``, takes a key out.
        """
        data = self.as_given()
        set_keys(data, changes)
        try:
            return Scenario.from_dict(data, self.folder)
        except InputError as error:
            raise told_to_take_out(error, changes) from None

    def without_uncertainty(self) -> Scenario:
        """The same collision, its numbers taken for known."""
        if not self.uncertainty:
            return self
        data = self.as_given()
        leave_out(data, ("uncertainty", "verdict.confidence"))
        return Scenario.from_dict(data, self.folder)

    def as_given(self) -> dict[str, Any]:
        """The scenario as nested dictionaries, with the keys that were given and no default."""
        # What was not given stays so: a default must not count as given where a change takes its effect away.
        data = self.model_dump(exclude_unset=True, exclude_none=True, mode="python")
        # What a copy was given besides counts.
        if "velocity_mm_s" in data["motion"]:
            data["motion"] = {key: value for key, value in data["motion"].items() if key not in _SPEED}
        if "stiffness_N_m" in data["contact"]:
            data["contact"].pop("stiffness_N_mm", None)
        return data

    def to_dict(self) -> dict[str, Any]:
        """The scenario as nested dictionaries.

        Defaults are spelt out, but not a contact area that was assumed, nor those that have no effect. Of two spellings
        it has the velocity and N/m.
        """
        data = self.model_dump(exclude_none=True, mode="python")
        for key in (*self.motion.other_keys, *_SPEED):
            data["motion"].pop(key, None)
        data["contact"].pop("stiffness_N_mm", None)
        for key in _OFFSET if self.motion.kind == "trajectory" else ():
            data["contact"].pop(key, None)
        if "area_cm2" not in self.contact.model_fields_set:
            del data["contact"]["area_cm2"]
        if self.contact.kind == "clamped":
            del data["contact"]["arm"]
        for key in ("uncertainty", ASSUMED):
            if not data[key]:
                del data[key]
        for key in keys_without_effect(self).keys() - given_without_effect(self).keys():
            table, _, name = key.rpartition(".")
            (data[table] if table else data).pop(name, None)
        return data


def as_scenario(value: Any) -> Scenario:
    """What everything starts with; a path or a dictionary must be read first.

    Raises:
        InputError: it is something else.
    """
    if isinstance(value, Scenario):
        return value
    problem = f"a value of type {type(value).__name__} is no scenario"
    raise InputError("scenario", problem, "wanted load_scenario(path) or Scenario.from_dict(tables)")


def _plain(value: Any) -> Any:
    """Numbers and lists for those of numpy, and lists for tuples."""
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return value.tolist() if type(value).__module__ == "numpy" else value
