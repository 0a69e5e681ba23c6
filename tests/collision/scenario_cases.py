"""A scenario that tests of the reader begin with, and a look at what a refusal holds."""

from __future__ import annotations

import gc
import tomllib
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bumpstop.errors import InputError

EXAMPLE = Path(__file__).parents[2] / "examples" / "01_hand_downward.toml"


def example() -> dict[str, Any]:
    return tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))


class Witness:
    """Something that a caller holds."""


def is_let_go(refused: Callable[[], object]) -> bool:
    """Whether a caller that catches the refusal, and what it holds, are let go of afterwards."""

    def caller(witness: Witness) -> None:
        with pytest.raises(InputError) as kept:
            refused()
        assert kept.value.field
        assert witness

    witness = Witness()
    seen = weakref.ref(witness)
    caller(witness)
    del witness
    gc.collect()
    return seen() is None
