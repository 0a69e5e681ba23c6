"""The compiled functions and classes, for the widest instruction set here or the one ``BUMPSTOP_TARGET`` names.

Whoever imports this module has all that the compiled one holds under the same names.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
from typing import TYPE_CHECKING

from bumpstop import _cpu
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from types import ModuleType

    # One stub serves all instruction sets.
    from bumpstop._kernels_baseline import *  # noqa: F403


def available_targets() -> list[str]:
    """Instruction sets this processor runs and this build has a compiled module for, widest first."""
    return [name for name in _cpu.supported_targets() if importlib.util.find_spec(f"bumpstop._kernels_{name}")]


def load(name: str) -> ModuleType:
    """Import the compiled module of one instruction set.

    Args:
        name: ``"baseline"``, ``"avx2"``, ``"avx512"`` or ``"neon"``.

    Raises:
        InputError: this processor or this build lacks it. Running it would crash the interpreter.
    """
    known = available_targets()
    if name not in known:
        raise InputError("BUMPSTOP_TARGET", f"{name!r} is not built or cannot run here", "valid: " + ", ".join(known))
    return importlib.import_module(f"bumpstop._kernels_{name}")


target: str = os.environ.get("BUMPSTOP_TARGET") or available_targets()[0]
module: ModuleType = load(target)
globals().update({name: value for name, value in vars(module).items() if not name.startswith("__")})
