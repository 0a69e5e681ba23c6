"""The door through which arrays enter: dtype, layout, shape and finiteness are settled here once."""

from __future__ import annotations

import math
import numbers
import reprlib
import sys
from typing import Any

import numpy as np
import numpy.typing as npt

from bumpstop.errors import InputError

FloatArray = npt.NDArray[np.float64]


def as_float_array(value: Any, field: str, shape: tuple[int | None, ...], *, finite: bool = True) -> FloatArray:
    """Turn ``value`` into a C-contiguous float64 array of the given shape.

    Strided views, other float or integer dtypes and lists are converted; text, objects, complex numbers and booleans
    are refused, as converting them would hide a mistake.

    Args:
        value: anything numpy can read as an array.
        field: name used in the error.
        shape: wanted shape; ``None`` accepts any length along that axis.
        finite: refuse NaN and infinities.

    Raises:
        InputError: the dtype, the shape or a value cannot be used; names the first offending index.
    """
    # Of a mask asarray would make nothing, silently. Numpy loads its module only for those who use one.
    if "numpy.ma" in sys.modules and np.ma.is_masked(value):
        raise InputError(field, "has masked values", "leave their rows out, or fill them")
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(field, "rows of different lengths", f"wanted shape {_words(shape)}") from error
    if array.dtype.kind not in "fiu":
        raise InputError(field, f"values of type {array.dtype} are not real numbers")
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=False)):
        raise InputError(field, f"has shape {array.shape}", f"wanted {_words(shape)}")
    result: FloatArray = np.ascontiguousarray(array, dtype=np.float64)
    if finite and not np.isfinite(result).all():
        index = tuple(int(i) for i in np.argwhere(~np.isfinite(result))[0])
        raise InputError(f"{field}{list(index)}", f"is {result[index]}", "wanted a finite number")
    return result


def as_name(value: Any, field: str, valid: str = "") -> str:
    """Let a name pass; of an array in its place comparisons would make arrays, or numpy's own refusals.

    Args:
        value: a text.
        field: name used in the error.
        valid: what would be a name.

    Raises:
        InputError: it is no text.
    """
    if not isinstance(value, str):
        raise InputError(field, f"{reprlib.repr(value)} is no name", valid or "wanted text")
    return value


def as_number(value: Any, field: str, *, finite: bool = True) -> float:
    """Turn ``value`` into a float; refuses what :func:`as_float_array` refuses.

    Args:
        value: a float or an integer, of Python or numpy.
        field: name used in the error.
        finite: refuse NaN and infinities.

    Raises:
        InputError: it is no number, or none that can be used.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise InputError(field, f"{value!r} is not a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if finite and not math.isfinite(number):
        raise InputError(field, f"is {number}", "wanted a finite number")
    return number


def as_whole_number(value: Any, field: str, low: int, high: int, bounds: str = "") -> int:
    """Turn ``value`` into an int.

    Args:
        value: an integer, of Python or numpy.
        field: name used in the error.
        low: lowest that can be used.
        high: highest.
        bounds: how the error names the two; default: as numbers.

    Raises:
        InputError: it is no whole number, or none that can be used.
    """
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if not whole or not low <= int(value) <= high:
        raise InputError(field, f"is {value!r}", f"wanted a whole number from {bounds or f'{low} to {high}'}")
    return int(value)


def as_rows(value: Any, field: str, width: int) -> tuple[FloatArray, bool]:
    """Turn ``value`` of shape (width,) or (N, width) into (N, width), and say whether it was a single row.

    Raises:
        InputError: as ``as_float_array``.
    """
    try:
        single = np.ndim(value) == 1
    except ValueError:  # rows of different lengths, refused by the same door as everything else
        single = False
    if single:
        return as_float_array(value, field, (width,))[None], True
    return as_float_array(value, field, (None, width)), False


def finite_or_none(value: float) -> float | None:
    """A number for JSON, which has no NaN and no infinity."""
    return float(value) if math.isfinite(value) else None


def _words(shape: tuple[int | None, ...]) -> str:
    names = ["N" if n is None else str(n) for n in shape]
    return "(" + ", ".join(names) + ("," if len(names) == 1 else "") + ")"
