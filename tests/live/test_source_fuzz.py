"""Damaged messages: no crash, and no gap that nobody names. ``python -m validation --only fuzz_sources`` makes 10^6."""

from __future__ import annotations

import numpy as np

from live.fuzz_cases import fuzz_dds_source, fuzz_decoders, fuzz_rtde_source


def test_decoders() -> None:
    found = fuzz_decoders(np.random.default_rng(1), 5000)
    assert found.rejected > 1000
    assert len(found.kinds) > 8


def test_rtde_source() -> None:
    found = fuzz_rtde_source(np.random.default_rng(2), 8000)
    assert found.samples > 2000
    assert {"damaged", "foreign", "restarted"} <= set(found.kinds)


def test_dds_source() -> None:
    found = fuzz_dds_source(np.random.default_rng(3), 8000)
    assert found.samples > 500
    assert {"damaged", "foreign"} <= set(found.kinds)
