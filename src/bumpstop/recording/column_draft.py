"""A column file to start from, for a file whose names do not tell what its columns hold."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence

from bumpstop.errors import InputError
from bumpstop.text_files import toml_value

_MAX_LISTED = 20
# In this order: what is a rate or a current is often named after a position or an axis, too.
_WORDS = {
    "time": r"t|ts|time|timestamp|stamp|clock|zeit|seconds|millis|time_?m?s",
    "velocity": r"qd|dq|qdot|vel|speed|velocity|geschw\w*|q_?vel|rate",
    "current": r"i|cur|curr|current|amp|amps|ampere|strom",
    "torque": r"tau|trq|torque|effort|moment|drehmoment|nm",
    "position": r"q|pos|position|angle|theta|phi|joint|axis|achse|enc|encoder|j|a",
}
_UNITS = {
    "time": {"ms": "ms", "us": "us", "ns": "ns", "millis": "ms"},
    "position": {"deg": "deg", "degrees": "deg", "mm": "mm"},
    "velocity": {"deg": "deg/s", "degrees": "deg/s", "degs": "deg/s", "rpm": "rpm", "mm": "mm/s"},
    "current": {"ma": "mA"},
    "torque": {"mnm": "mNm", "knm": "kNm"},
}
_DEFAULT_UNIT = {"time": "s", "position": "rad", "velocity": "rad/s", "current": "A", "torque": "Nm"}


class MissingColumnsError(InputError):
    """Nothing says which columns of a file hold what; a draft of a column file comes with it.

    Attributes:
        draft: text of a column file (TOML) to start from, with what was found as comments.
    """

    def __init__(self, field: str, problem: str, valid: str = "", draft: str = "") -> None:
        super().__init__(field, problem, valid)
        self.draft = draft

    def __reduce__(self) -> tuple[type[InputError], tuple[str, ...]]:  # type: ignore[override]
        """Pickled by its parts, as every :class:`InputError`."""
        return type(self), (self.field, self.problem, self.valid, self.draft)


def as_list(names: Sequence[str]) -> str:
    """The names a file has, as many as can be read."""
    more = len(names) - _MAX_LISTED
    return ", ".join(name[:40] for name in names[:_MAX_LISTED]) + (f" and {more} more" if more > 0 else "")


def draft_of_names(names: Sequence[str]) -> str:
    """A draft for a table with a header: columns are put to quantities by what they are called."""
    groups = _grouped(names)
    lines = [_HEAD, *(f"#   {number}: {_plain(name)}" for number, name in enumerate(names, start=1))]
    time = groups.pop("time", [])
    if time:
        lines.append(f"time = {{ column = {toml_value(time[0])}, unit = {toml_value(_unit('time', time[0]))} }}")
    else:
        lines.append("time = { rate_hz = 100 }  # no column looks like one: give column = ... or the rate")
    lines += [_quantity(kind, "columns", toml_value(own), own[0]) for kind, own in groups.items()]
    if "position" not in groups:
        lines.append('position = { columns = [], unit = "rad" }  # the columns of the joint positions')
    lines += _to_fill_in(groups, "columns", "[]")
    return "\n".join(lines) + "\n"


def draft_of_numbers(width: int) -> str:
    """A draft for a table without a header."""
    joints = next((width - 1) // k for k in (3, 2, 1) if (width - 1) % k == 0 or k == 1)
    lines = [
        f"{_HEAD}\n#   {width}, without names: numbers from 1",
        'time = { column = 1, unit = "s" }',
        f'position = {{ columns = {list(range(2, 2 + joints))}, unit = "rad" }}',
    ]
    rest = list(range(2 + joints, width + 1))
    if rest:
        lines.append(f'# current = {{ columns = {rest}, unit = "A" }}, or velocity, or torque')
    return "\n".join(lines) + "\n"


def draft_of_variables(shapes: Mapping[str, tuple[int, ...]]) -> str:
    """A draft for a MATLAB file: variables by their dotted names and sizes."""
    shown = by_length(shapes)[: 2 * _MAX_LISTED]
    lines = [_HEAD, *(f"#   {_plain(name)}: {' x '.join(map(str, shapes[name]))}" for name in shown)]
    longest = max((max(shape, default=0) for shape in shapes.values()), default=0)
    usable = [name for name in by_length(shapes) if max(shapes[name], default=0) == longest and longest > 1]
    # Measured before commanded.
    usable.sort(key=lambda name: not re.search(r"act|meas|ist", name.rpartition(".")[2].casefold()))
    kinds: dict[str, str] = {}
    for name in usable:
        kind = _kind(name.rpartition(".")[2])
        row = len(shapes[name]) == 1 or min(shapes[name]) == 1
        if kind and (kind == "time") == row:
            kinds.setdefault(kind, name)
    if "time" in kinds:
        unit = _unit("time", kinds["time"])
        lines.append(f"time = {{ variable = {toml_value(kinds.pop('time'))}, unit = {toml_value(unit)} }}")
    else:
        lines.append("time = { rate_hz = 100 }  # no variable looks like one: give variable = ... or the rate")
    lines += [_quantity(kind, "variable", toml_value(name), name) for kind, name in kinds.items()]
    if "position" not in kinds:
        lines.append('position = { variable = "", unit = "rad" }  # the matrix of the joint positions')
    lines += _to_fill_in(kinds, "variable", '""')
    return "\n".join(lines) + "\n"


def by_length(shapes: Mapping[str, tuple[int, ...]]) -> list[str]:
    """Names of variables, those with the most rows first, as recorded ones have."""
    return sorted(shapes, key=lambda name: -max(shapes[name], default=0))


_HEAD = "# A column file to start from: check columns and units. What the file holds:"


def _quantity(kind: str, key: str, value: str, example: str) -> str:
    return f"{kind} = {{ {key} = {value}, unit = {toml_value(_unit(kind, example))} }}"


def _to_fill_in(found: Collection[str], key: str, value: str) -> list[str]:
    """A comment where nothing was found that a model can be fitted to: a torque or a current of each joint."""
    if "torque" in found or "current" in found:
        return []
    each = (f'{kind} = {{ {key} = {value}, unit = "{_DEFAULT_UNIT[kind]}" }}' for kind in ("torque", "current"))
    return [f"# {line}  # if the file holds any: fits and residuals want one of them" for line in each]


def _plain(name: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in name)[:80]


def _words(name: str) -> list[str]:
    """The words in a name, apart at signs, at digits, and where small letters turn to capitals."""
    return [word.casefold() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)]


def _kind(name: str) -> str:
    words = _words(name)
    for kind, known in _WORDS.items():
        if any(re.fullmatch(known, word) for word in words):
            return kind
    return ""


def _unit(kind: str, name: str) -> str:
    units, name = _UNITS[kind], re.sub("[°º]", " deg ", name)
    # "mA" is one word here, and two where capitals begin one.
    words = [*_words(name), *(word.casefold() for word in re.findall(r"[A-Za-z]+", name))]
    return next((units[word] for word in words if word in units), _DEFAULT_UNIT[kind])


def _grouped(names: Sequence[str]) -> dict[str, list[str]]:
    """Names by quantity: the first row of names alike but for a number in them, time by itself."""
    found: dict[str, list[str]] = {}
    rows: dict[tuple[str, str], list[str]] = {}
    for name in names:
        kind = _kind(name)
        if kind == "time":
            found.setdefault("time", []).append(name)
        elif kind and re.search(r"\d", name):
            # The last number that counts joints: "axis_1_pos", "q1", "joint_1_vel_deg_s2".
            rows.setdefault((kind, re.sub(r"\d+", "#", name, count=1)), []).append(name)
    for (kind, _), own in rows.items():
        # Of several rows of one kind the first that has the most joints.
        if len(own) > len(found.get(kind, [])):
            found[kind] = own
    joints = len(found.get("position", []))
    order = ("time", "position", "velocity", "current", "torque")
    return {kind: found[kind] for kind in order if kind in found and (kind == "time" or len(found[kind]) == joints)}
