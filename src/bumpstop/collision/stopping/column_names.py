"""Column names of stopping tables: which quantity, of which joint, in which unit."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

from bumpstop.collision.stopping.joint_names import NO_JOINT, JointName
from bumpstop.errors import InputError

_DEG = math.pi / 180
# By quantity: every unit that a column may have, and its value in SI or as a share.
UNITS: dict[str, dict[str, float]] = {
    "payload": {"percent": 0.01, "share": 1.0, "kg": 1.0},
    "extension": {"percent": 0.01, "share": 1.0, "mm": 1e-3, "m": 1.0},
    "speed": {"percent": 0.01, "share": 1.0, "deg/s": _DEG, "rad/s": 1.0, "mm/s": 1e-3, "m/s": 1.0},
    "time": {"s": 1.0, "ms": 1e-3},
    "distance": {"deg": _DEG, "rad": 1.0, "mm": 1e-3, "m": 1.0},
    "category": {"": 1.0},
    "joint": {"": 1.0},
}
LENGTHS = ("mm", "m", "mm/s", "m/s")
_QUANTITIES = {
    "category": ("category", "cat"),
    "payload": ("payload", "load"),
    "extension": ("extension", "reach", "radius"),
    "speed": ("speed", "velocity", "override", "v"),
    "time": ("time", "duration", "t"),
    "distance": ("distance", "angle", "path", "travel", "overtravel", "displacement", "d", "s"),
}
_UNIT_WORDS = {
    "percent": "percent pct",
    "share": "share fraction ratio",
    "kg": "kg",
    "deg/s": "deg/s dps degrees/s",
    "rad/s": "rad/s rads",
    "mm/s": "mm/s",
    "m/s": "m/s",
    "ms": "ms msec milliseconds",
    "s": "s sec seconds",
    "deg": "deg degree degrees",
    "rad": "rad radian radians",
    "mm": "mm",
    "m": "m",
}
_UNIT_OF = {word: unit for unit, words in _UNIT_WORDS.items() for word in words.split()}
# "STOP 1", "Cat. 1", "stop category 0", and so where "_" parts words.
STOP_CATEGORY = re.compile(r"(?<![a-z0-9])(?:stop[\W_]*)?(?:stop|cat(?:egory)?)[\W_]*([012])(?![a-z0-9]|[.,]\d)")


@dataclass(frozen=True)
class Column:
    """What a column holds.

    Attributes:
        name: as written.
        quantity: a key of :data:`UNITS`.
        unit: one of them; empty where the name says none.
        named: the joint, as the name says it.
        joint: the same from 1, :data:`TCP`, or None where the column is about all of them.
        category: the stop category that the name says, or None.
    """

    name: str
    quantity: str
    unit: str
    named: JointName
    joint: int | None = None
    category: int | None = None

    def counted(self, first: int) -> Column:
        """The column of a file whose first joint has the number ``first``.

        Raises:
            InputError: it counts joints from 0, and the file does not.
        """
        return replace(self, joint=self.named.joint(first, f"column {self.name!r}"))


def read_column(name: str) -> Column | None:
    """What a name says, but for the joint; None where it names no quantity of a stopping table.

    Args:
        name: such as ``speed_percent``, ``distance_2_deg``, ``J1 stopping time [ms]``, ``STOP 1 distance A2 [deg]``.

    Raises:
        InputError: it names two joints or two stop categories.
    """
    category, text = _take_category(name)
    words = words_of(text)
    if category is not None and not any(re.search("[a-z]", word) for word in words):  # "stop category (0, 1)"
        return Column(name, "category", "", NO_JOINT)
    unit, words = _take_unit(words)
    named = JointName.of(words, f"column {name!r}")
    rest, no_joint = named.rest, named.number is None and named.word is None
    quantity = next((known for known, names in _QUANTITIES.items() if any(word in names for word in rest)), "")
    if not quantity and no_joint and any(word in ("joint", "axis") for word in rest):
        quantity, unit = "joint", ""
    if not quantity and unit and (not no_joint or not rest):
        quantity = next(known for known in ("distance", "speed", "time", "payload") if unit in UNITS[known])
    return Column(name, quantity, unit, named, category=category) if quantity else None


def _take_category(name: str) -> tuple[int | None, str]:
    """The stop category in a name, and the name without it: its number is no joint's."""
    found = {int(said) for said in STOP_CATEGORY.findall(name.lower())}
    if len(found) > 1:
        raise InputError(f"column {name!r}", "names two stop categories", "wanted one")
    return next(iter(found), None), STOP_CATEGORY.sub(" ", name.lower())


def words_of(name: str) -> list[str]:
    """The lower-case words and numbers of a name; units are such words."""
    text = name.lower().replace("°", " deg ").replace("%", " percent ").replace("φ", " angle ")
    text = re.sub(r"deg\s*/\s*s(ec)?\b|degrees?\s*(per|/)\s*s(econd|ec)?\b", "deg/s", text)
    text = re.sub(r"\b(mm|m|rad)\s*/\s*s(ec)?\b", r"\1/s", text)
    return [word for word in re.split(r"[^a-z0-9/]+", text) if word]


def _take_unit(words: list[str]) -> tuple[str, list[str]]:
    """The unit that ends a name, also where it is written ``deg_s``; and the words before it."""
    if len(words) >= 2 and words[-1] in ("s", "sec") and words[-2] in ("deg", "rad", "mm", "m"):
        return f"{words[-2]}/s", words[:-2]
    # A single word is what the column is, as in "s" for a path: only with others beside it is it a unit.
    if words and words[-1] in _UNIT_OF and (len(words) > 1 or words[-1] not in ("s", "m")):
        return _UNIT_OF[words[-1]], words[:-1]
    for place in range(len(words) - 1, 0, -1):
        if words[place] in _UNIT_OF and words[place] not in ("s", "m"):
            return _UNIT_OF[words[place]], words[:place] + words[place + 1 :]
    return "", words


def check_unit(column: Column, field: str) -> float:
    """The factor of a column's unit.

    Raises:
        InputError: the name says no unit, or one of another quantity.
    """
    known = UNITS[column.quantity]
    if column.unit in known:
        return known[column.unit]
    valid = f"wanted a name with its unit, such as {column.quantity}_{next(iter(known)).replace('/', '_')}; "
    valid += f"units: {', '.join(known)}"
    problem = f"unit {column.unit!r} is none of a {column.quantity}" if column.unit else "says no unit"
    raise InputError(f"{field}, column {column.name!r}", problem, valid)
