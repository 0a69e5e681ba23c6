"""Limit tables of a user's own, and how they are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from bumpstop.contact import LimitTable
from bumpstop.errors import InputError

HEAD = """
name = "mine"
title = "My own table"
source = "my measurements"
status = "measured once"
"""

REGION = """
[[region]]
name = "tail"
force_N = 100
transient_multiplier = 1.5
spring_N_mm = 20
"""


def area(lines: str, pressure: float = 200, transient: str = "transient_multiplier = 2") -> str:
    return f'[[area]]\nregion = "tail"\n{lines}\npressure_N_cm2 = {pressure}\n{transient}\n'


TIP = area('name = "tip"')


def load(folder: Path, rows: str, head: str = HEAD) -> LimitTable:
    (folder / "mine.toml").write_text(head + rows, encoding="utf-8")
    return LimitTable.load("mine.toml", relative_to=folder)


def refusal_of(folder: Path, rows: str, head: str = HEAD) -> InputError:
    with pytest.raises(InputError) as refusal:
        load(folder, rows, head)
    message = str(refusal.value)
    assert "mine.toml" in message
    assert "\n" not in message
    return refusal.value
