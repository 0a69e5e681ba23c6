"""Long texts where a number or a unit belongs are read once, not once from each of their characters."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from fuzz.targets import TARGETS

import bumpstop as bs
from bumpstop.measure.reading.gauge_columns import unit_of_name

LONG = 300_000  # characters: minutes, were each a begin of its own
DIGITS, SPACES = "9" * LONG + "x", "1" + " " * LONG + "x"


@pytest.mark.parametrize(
    ("target", "name", "text"),
    [
        ("drive_train", "a.xml", f"<mujoco><default><joint armature='{DIGITS}'/></default></mujoco>"),
        ("trajectory", "a.yaml", f"joint_names: [joint_1]\npoints:\n- positions: ['{DIGITS}']\n  time_from_start: 0\n"),
        ("stopping_table", "a.csv", f"# payload = {SPACES}\nspeed,distance,time\n1,2,3\n"),
    ],
    ids=["number in XML", "number in YAML", "statement in CSV"],
)  # fmt: skip
def test_a_long_text_is_refused_at_once(target: str, name: str, text: str, tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    begin = time.process_time()
    with pytest.raises(bs.InputError):
        TARGETS[target].read(file)
    assert time.process_time() - begin < 5


def test_brackets_that_nothing_closes_state_no_unit() -> None:
    begin = time.process_time()
    assert unit_of_name("[" * LONG, "force") is None
    assert time.process_time() - begin < 5
    assert unit_of_name("Force [N]", "force") == "N"
