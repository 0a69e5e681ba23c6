"""The compiled kernels for this processor's widest instruction set, or for the one ``BUMPSTOP_TARGET`` names."""

from __future__ import annotations

import importlib
import importlib.util
import os
from types import ModuleType
from typing import TYPE_CHECKING

from bumpstop import _cpu
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop import _kernels_baseline as core

__all__ = ["available_targets", "core", "load", "target"]


def available_targets() -> list[str]:
    """Instruction sets this processor runs and this build has kernels for, widest first."""
    return [name for name in _cpu.supported_targets() if importlib.util.find_spec(f"bumpstop._kernels_{name}")]


def load(name: str) -> ModuleType:
    """Import the kernels of one instruction set.

    Args:
        name: ``"baseline"``, ``"avx2"``, ``"avx512"`` or ``"neon"``.

    Raises:
        InputError: this processor or this build lacks it. Running it would crash the interpreter.
    """
    known = available_targets()
    if name not in known:
        raise InputError("BUMPSTOP_TARGET", f"{name!r} cannot run here", "valid: " + ", ".join(known))
    return importlib.import_module(f"bumpstop._kernels_{name}")


target: str = os.environ.get("BUMPSTOP_TARGET") or available_targets()[0]
if not TYPE_CHECKING:
    core = load(target)
