"""KRL's data: records as targets, places and frames."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence

from bumpstop.program.languages.expression import Expression, number_of, resolved
from bumpstop.program.languages.rotation import from_euler_zyx
from bumpstop.program.languages.statements import Target
from bumpstop.program.languages.syntax import Token


def forget_fractions(constants: dict[str, Expression], integers: Iterable[Sequence[Token]]) -> None:
    """Values that are not whole, of names that are declared as integers: the controller makes them whole."""
    names = {words[0].text.lower() for words in integers}
    for name in constants:
        if name.partition("[")[0] in names and not (number_of(constants[name], constants) or 0.0).is_integer():
            constants[name] = Expression("unknown", 0, 0)


def arc_place(expression: Expression | None, constants: Mapping[str, Expression]) -> Target:
    """The point that an arc goes through; its orientation does not count, and may be missing."""
    found = resolved(expression, constants)
    values = _record(found, constants) if found is not None and found.kind == "record" else None
    if values is None or not {"X", "Y", "Z"} <= set(values):
        return Target(why="the point its arc goes through is not known before the program runs")
    return Target(pose=(*(values[name] / 1e3 for name in "XYZ"), 0.0, 0.0, 0.0))


def pose_or_axes(expression: Expression | None, constants: Mapping[str, Expression], *, posture: bool) -> Target:
    """The target of a move, which may go to the posture that is written beside it."""
    found = resolved(expression, constants)
    unknown = Target(why="its target is not known before the program runs")
    if found is None or found.kind != "record":
        return unknown
    values = _record(found, constants)
    if values is None:
        return unknown
    external = tuple((name, value) for name, value in values.items() if re.fullmatch(r"E[1-6]", name))
    axes = [name for name in values if re.fullmatch(r"A[1-7]", name)]
    if axes:
        if sorted(axes) != [f"A{j + 1}" for j in range(len(axes))]:
            return Target(why="its target leaves axes as they are, which is not followed")
        return Target(joints=tuple(math.radians(values[name]) for name in sorted(axes)), external=external)
    pose = frame_of_record(found, constants)
    if pose is None:
        return Target(why="its target leaves X to C as they are")
    if posture and "S" in values and "T" not in values:
        # What its bits say hangs on how the arm is built.
        return Target(why="the posture that its S names is not known without T")
    # Bits of T say which axes are below zero.
    turns = int(values["T"]) if values.get("T", 0.5).is_integer() else None
    bits = [] if turns is None else [(j, turns >> j & 1) for j in range(6)]
    within = tuple((j, -math.inf if below else 0.0, 0.0 if below else math.inf) for j, below in bits)
    return Target(pose=pose, external=external, within=within)


def _record(expression: Expression, constants: Mapping[str, Expression]) -> dict[str, float] | None:
    values = {}
    for key, item in zip(expression.keys, expression.items, strict=True):
        value = number_of(item, constants)
        if value is None or key in values:
            return None
        values[key] = value
    return values


def frame_of_record(expression: Expression | None, constants: Mapping[str, Expression]) -> tuple[float, ...] | None:
    """Translation [m] and rotation vector [rad] of a record of X, Y, Z [mm] and A, B, C [deg], or of ``$NULLFRAME``."""
    if expression is not None and expression.kind == "name" and expression.name.lower() == "$nullframe":
        return (0.0,) * 6
    found = resolved(expression, constants)
    values = _record(found, constants) if found is not None and found.kind == "record" else None
    if values is None or not {"X", "Y", "Z", "A", "B", "C"} <= set(values):
        return None
    x, y, z = (values[name] / 1e3 for name in "XYZ")
    return (x, y, z, *from_euler_zyx(values["A"], values["B"], values["C"]))
