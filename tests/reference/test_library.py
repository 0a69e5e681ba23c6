"""Compiling the reference simulator, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from reference import build, simulate, tick_count
from reference.cases import sia5d


def test_build_is_done_once_for_the_same_source_and_flags(tmp_path):
    first = build(flags=["-O0", "-std=c++20", "-shared", "-fPIC"], cache_dir=tmp_path)
    stamp = first.stat().st_mtime_ns
    assert build(flags=["-O0", "-std=c++20", "-shared", "-fPIC"], cache_dir=tmp_path) == first
    assert first.stat().st_mtime_ns == stamp
    with pytest.raises(RuntimeError, match="could not compile"):
        build(flags=["-std=c++20", "-DNAN=", "-include", "no/such/header"], cache_dir=tmp_path)
    assert list(tmp_path.iterdir()) == [first]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"held_joints": (7,)}, "held_joints"),
        ({"start_position": (0, 0)}, "start_position"),
        ({"thresholds_Nm": (1, 2)}, "thresholds_Nm"),
        ({"max_acceleration": 0.0}, "max_acceleration"),
        ({"stiffness_N_m": 0.0}, "stiffness_N_m"),
        ({"contact_link": 7}, "link"),
        ({"per_axis_walls": True, "contact_link": 3}, "per_axis_walls"),
    ],
)
def test_impossible_settings_are_refused(changes, word):
    with pytest.raises(ValueError, match=word):
        simulate(sia5d((0, 0, -0.05), **changes), [0.0])


def test_arrays_of_the_wrong_shape_are_refused():
    settings = sia5d((0, 0, -0.05), duration_s=0.1)
    with pytest.raises(ValueError, match="ticks"):
        simulate(settings, [0.0], np.zeros((1, tick_count(settings) - 1, 7)))
    with pytest.raises(ValueError, match="noise"):
        simulate(settings, [0.0], np.zeros((2, tick_count(settings), 7)))
    with pytest.raises(ValueError, match="offsets"):
        simulate(settings, [[0.0, 0.0, 0.0]])
