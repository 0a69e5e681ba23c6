"""Cells of stopping tables: numbers, joints, stop categories."""

from __future__ import annotations

import math
from typing import Any

from bumpstop.collision.stopping.column_names import STOP_CATEGORY, words_of
from bumpstop.collision.stopping.joint_names import TCP, JointName
from bumpstop.errors import InputError


def number_of(cell: Any) -> float | None:
    """A number, NaN for an empty cell, or None."""
    if isinstance(cell, bool):
        return None
    if isinstance(cell, int | float):
        return float(cell)
    if cell is None:
        return math.nan
    text = str(cell).strip().rstrip("%°").strip()
    if text.lower() in ("", "-", "nan", "n/a", "na", "none"):
        return math.nan
    try:
        return float(text)
    except ValueError:
        return None


def category_of(cell: Any, field: str) -> float:
    """A stop category, also in words, such as ``STOP 1``.

    Raises:
        InputError: there is none. Of an empty cell nobody knows whether it means the one above or all categories.
    """
    value = number_of(cell)
    if value is None and (said := STOP_CATEGORY.fullmatch(str(cell).strip().lower())):
        value = float(said[1])
    if value is None or value not in (0, 1, 2):
        problem = "is empty" if value is not None and math.isnan(value) else f"{str(cell)[:40]!r} is no stop category"
        raise InputError(field, problem, "wanted 0, 1 or 2 in every row")
    return value


def joint_of(cells: list[Any], field: str) -> JointName:
    """The joint that the cells of a row say together, such as ``2``, ``A2``, ``Joint 1 (SHOULDER)``.

    Raises:
        InputError: a number that is not whole, or two joints.
    """
    said = []
    for cell in cells:
        value = number_of(cell)
        if value is None:
            said.append(str(cell))
        elif value >= 0 and value.is_integer():
            said.append(str(int(value)))
        elif not math.isnan(value):
            raise InputError(field, f"{value:g} is no joint", "wanted whole numbers from 1")
    return JointName.of(words_of(" ".join(said)), field)


def are_joint_words(cells: list[Any]) -> bool:
    """Whether a column by whatever name says joints by their words."""
    words = [JointName.of(words_of(cell), "").word if isinstance(cell, str) else None for cell in cells]
    return bool(words) and all(word not in (None, TCP) for word in words)
