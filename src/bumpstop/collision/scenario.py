"""Scenarios: the file a person writes, read strictly."""

from __future__ import annotations

import difflib
import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from bumpstop.errors import InputError, near_matches

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Probability = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)]
Vector = Annotated[list[Finite], Field(min_length=3, max_length=3)]
# Values that later versions of the format know and this one does not compute.
_NOT_YET = {
    ("contact", "kind"): {"free"},
    ("contact", "arm"): {"two_mass"},
    ("detector", "residual"): {"observer"},
    ("verdict", "clamped_limit"): {"two_phase"},
    ("motion", "kind"): {"trajectory"},
}


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Motion(_Table):
    """A straight line of the tip at constant speed, base frame."""

    kind: Literal["line"] = "line"
    velocity_mm_s: Vector
    start: Literal["moving", "rest"] = "moving"
    duration_s: Positive = 5.0
    task: Literal["pose", "position"] = "pose"
    held_joints: list[int] = []
    damping: NotNegative = 0.0

    @property
    def velocity(self) -> tuple[float, float, float]:
        """Velocity of the tip, base frame [m/s]."""
        x, y, z = (v / 1e3 for v in self.velocity_mm_s)
        return x, y, z

    @model_validator(mode="after")
    def _moves(self) -> Motion:
        if not any(self.velocity_mm_s):
            raise ValueError("motion.velocity_mm_s|is zero|an arm that does not move hits nothing: give a direction")
        return self


class Contact(_Table):
    """What is hit, where on the arm, and how far away it is."""

    body: str | None = None
    limits: str = "bgia2011"
    kind: Literal["clamped"] = "clamped"
    area_cm2: Positive = 1.0
    stiffness_N_m: Positive | None = None
    pressure_area: str | None = None
    peak_factor: Annotated[float, Field(ge=1, allow_inf_nan=False)] = 1.0
    link: str | None = None
    point_m: Vector = [0.0, 0.0, 0.0]
    normal: Vector | None = None
    arm: Literal["position_driven"] = "position_driven"
    offset_law: Literal["half_normal", "uniform", "fixed"] = "uniform"
    offset_sd_s: Positive = 0.1
    offset_mm: NotNegative | None = None

    @model_validator(mode="after")
    def _complete(self) -> Contact:
        if self.body is None and self.stiffness_N_m is None:
            raise ValueError("contact.body|is missing|name a body region, or give contact.stiffness_N_m without one")
        if self.normal is not None and not any(self.normal):
            raise ValueError("contact.normal|is zero|wanted a direction")
        if self.offset_law == "fixed" and self.offset_mm is None:
            raise ValueError('contact.offset_mm|is missing|offset_law = "fixed" needs it')
        if self.offset_law != "fixed" and self.offset_mm is not None:
            raise ValueError(
                f"contact.offset_mm|has no meaning with offset_law = {self.offset_law!r}|"
                'valid with offset_law = "fixed"'
            )
        return self


class Detector(_Table):
    """Thresholds and noise of the residual (estimated minus predicted motor torque), per joint."""

    thresholds_Nm: list[float]
    noise_sd_Nm: NotNegative | list[NotNegative]
    noise_mean_Nm: Finite | list[Finite] = 0.0
    feedback_period_s: Positive = 0.004
    residual: Literal["direct"] = "direct"
    arming_delay_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _thresholds(self) -> Detector:
        for j, threshold in enumerate(self.thresholds_Nm, start=1):
            if math.isnan(threshold) or threshold <= 0:
                raise ValueError(
                    f"detector.thresholds_Nm|joint {j} is {threshold}|wanted a positive number, or inf to leave the "
                    "joint unwatched"
                )
        return self


class Reaction(_Table):
    """What the arm does after detection."""

    kind: Literal["reverse", "stop"] = "reverse"
    joint_acceleration_rad_s2: Positive | list[Positive]
    latency_s: NotNegative = 0.0


class Simulation(_Table):
    """Time steps of the simulated controller."""

    step_s: Positive = 0.001
    substeps: Annotated[int, Field(ge=1, le=1000)] = 5


class VerdictSettings(_Table):
    """What counts as acceptable."""

    risk: Probability = 1e-3
    max_false_alarm: Probability = 1e-3
    clamped_limit: Literal["quasi_static"] = "quasi_static"


class Scenario(_Table):
    """One collision: robot, pose, motion, contact, detector, reaction.

    The attributes are the keys of the scenario file, in the file's units (docs/collision.md lists them). ``folder`` is
    where relative paths start.
    """

    robot: str
    pose_deg: list[Finite] | None = None
    pose_rad: list[Finite] | None = None
    motion: Motion
    contact: Contact
    detector: Detector
    reaction: Reaction
    simulation: Simulation = Simulation()
    verdict: VerdictSettings = VerdictSettings()
    folder: Annotated[Path, Field(exclude=True)] = Path()

    @model_validator(mode="after")
    def _one_pose(self) -> Scenario:
        if (self.pose_deg is None) == (self.pose_rad is None):
            problem = "is missing" if self.pose_deg is None else "and pose_rad are both given"
            raise ValueError(f"pose_deg|{problem}|give pose_deg or pose_rad, one of them")
        return self

    @classmethod
    def from_dict(cls, data: dict[str, Any], folder: Path | str = ".") -> Scenario:
        """Check a scenario given as nested dictionaries.

        Args:
            data: the tables and keys of the scenario file.
            folder: where relative paths in it start.

        Raises:
            InputError: a key is unknown, missing or has a value that cannot be used.
        """
        _refuse_later_keys(data)
        try:
            return cls.model_validate({**data, "folder": Path(folder)})
        except ValidationError as error:
            raise _explain(error, data) from None

    def with_values(self, changes: dict[str, Any]) -> Scenario:
        """A copy with some keys changed.

        Args:
            changes: dotted keys and their new values, e.g. ``{"motion.velocity_mm_s": [0, 50, 0]}``.
        """
        data = self.to_dict()
        for key, value in changes.items():
            set_key(data, key, value)
        return Scenario.from_dict(data, self.folder)

    def to_dict(self) -> dict[str, Any]:
        """The scenario as nested dictionaries, without keys that are not set."""
        return self.model_dump(exclude_none=True, mode="python")


def set_key(data: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key in nested dictionaries, making tables on the way. Of the pose's two spellings one remains."""
    *tables, last = key.split(".")
    here = data
    for table in tables:
        here = here.setdefault(table, {})
        if not isinstance(here, dict):
            raise InputError(key, f"{table!r} is not a table")
    if not tables and last in ("pose_deg", "pose_rad"):
        data.pop("pose_rad" if last == "pose_deg" else "pose_deg", None)
    here[last] = value


def load_scenario(path: str | Path, changes: dict[str, Any] | None = None) -> Scenario:
    """Read a scenario file.

    Args:
        path: of a TOML file.
        changes: dotted keys and values that replace those of the file before it is checked.

    Raises:
        InputError: the file is absent or damaged, or a key is unknown, missing or has an unusable value.
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8")
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror})", "wanted a scenario file") from None
    except UnicodeDecodeError as error:
        raise InputError(str(path), f"is not UTF-8 text (byte {error.start})", "wanted a scenario file") from None
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(str(path), f"is not valid TOML: {error}") from None
    for key, value in (changes or {}).items():
        set_key(data, key, value)
    return Scenario.from_dict(data, path.parent)


def _refuse_later_keys(data: dict[str, Any]) -> None:
    """Name keys and values that the format knows and this version does not compute."""
    for (table, key), values in _NOT_YET.items():
        here = data.get(table)
        if isinstance(here, dict) and isinstance(here.get(key), str) and here[key] in values:
            raise InputError(f"{table}.{key}", f"{here[key]!r} is not available in this version")
    for table, key, idle in (
        ("", "base", None),
        ("", "tip", None),
        ("contact", "body_mass_kg", None),
        ("detector", "noise_correlation", 0.0),
        ("detector", "residuals", None),
        ("detector", "observer_gain_1_s", None),
    ):
        here = data.get(table) if table else data
        if isinstance(here, dict) and key in here:
            if idle is not None and here[key] == idle:
                del here[key]
                continue
            raise InputError(f"{table}.{key}" if table else key, "is not available in this version")


def _explain(error: ValidationError, data: dict[str, Any]) -> InputError:
    """Turn pydantic's first complaint into one sentence with the field, the value and what would be valid."""
    details = error.errors()
    # An unknown key often explains a missing one.
    first = next((d for d in details if d["type"] == "extra_forbidden"), details[0])
    places = [str(part) for part in first["loc"] if not _is_union_branch(part)]
    field = ".".join(part for part in places if not part.isdigit())
    index = next((int(part) for part in places if part.isdigit()), None)
    value = first.get("input")
    kind = first["type"]
    if kind == "value_error":
        field, problem, valid = str(first["ctx"]["error"]).split("|")
        return InputError(field, problem, valid)
    if kind == "extra_forbidden":
        return InputError(field, "is not a key of a scenario", near_matches(places[-1], _known_keys(places[:-1])))
    if kind == "missing":
        below = data
        for part in places[:-1]:
            below = below.get(part, {})
        table = Scenario.model_fields[places[0]].annotation if len(places) == 1 else None
        what = "table is missing" if isinstance(table, type) and issubclass(table, _Table) else "is missing"
        near = difflib.get_close_matches(places[-1], [str(key) for key in below], n=1)
        return InputError(field, what, f"did you mean it by {near[0]!r}?" if near else "")
    if index is not None:
        field = f"{field}[{index + 1}]"
    return InputError(field, f"{value!r} cannot be used", _wanted(first))


def _is_union_branch(part: int | str) -> bool:
    """Pydantic names the branches of ``number | list`` in the location; a person did not write them."""
    return isinstance(part, str) and (
        part.startswith(("list[", "constrained-", "nullable")) or part in ("float", "int")
    )


def _known_keys(places: list[str]) -> list[str]:
    model: Any = Scenario
    for place in places:
        model = model.model_fields[place].annotation
    return [name for name in model.model_fields if name != "folder"]


def _wanted(detail: Any) -> str:
    context = detail.get("ctx", {})
    kind = detail["type"]
    words = {
        "greater_than": "wanted more than {gt}",
        "greater_than_equal": "wanted at least {ge}",
        "less_than": "wanted less than {lt}",
        "less_than_equal": "wanted at most {le}",
        "finite_number": "wanted a finite number",
        "float_type": "wanted a number",
        "int_type": "wanted a whole number",
        "string_type": "wanted text",
        "list_type": "wanted a list",
        "literal_error": "valid: {expected}",
        "too_short": "wanted {min_length} values, found {actual_length}",
        "too_long": "wanted {max_length} values, found {actual_length}",
        "model_type": "wanted a table",
        "model_attributes_type": "wanted a table",
    }
    if kind in words:
        return words[kind].format(**context)
    return str(detail["msg"])
