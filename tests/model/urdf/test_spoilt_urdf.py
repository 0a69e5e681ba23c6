"""Spoilt URDF files are read right or refused."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from model.urdf_cases import ARM, changed, check, read, spoilt, survives


@settings(max_examples=300, deadline=2000, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_spoilt_files_are_read_right_or_refused(data: st.DataObject, tmp_path: Path) -> None:
    survives(spoilt(ARM, lambda n: data.draw(st.integers(0, n - 1))), tmp_path)


def test_spoiling_leaves_some_files_sound(tmp_path: Path) -> None:
    rng = random.Random(1)
    sound = sum(survives(spoilt(ARM, rng.randrange), tmp_path) for _ in range(300))
    assert 20 < sound < 150


def test_the_independent_look_sees_what_is_broken(tmp_path: Path) -> None:
    arm = read(ARM, tmp_path)
    for replacement in (
        ('<child link="wrist"/>', '<child link="slide"/>'),
        ('<parent link="base"/>', '<parent link="tool"/>'),
        ('xyz="0 0 0.4"', 'xyz="0 0 0.5"'),
        ('value="4"', 'value="5"'),
        ('<link name="base"/>', '<link name="base"/><link name="lost"/>'),
    ):
        with pytest.raises(AssertionError):
            check(changed(replacement), arm)
