"""Sampled distributions of many runs: counted block by block they say what all runs together say."""

from __future__ import annotations

import math
import tracemalloc
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.distribution import monte_carlo_blocks as sampled_blocks
from bumpstop.collision.distribution.distribution import SampledDistribution
from bumpstop.collision.distribution.monte_carlo_blocks import Counter
from collision.cases import control_group
from study.speed_limit_cases import PICK

LINE = control_group(reaction__kind="stop")


def small_blocks(monkeypatch: pytest.MonkeyPatch, size: int) -> None:
    monkeypatch.setattr(sampled_blocks, "BLOCK", size)


@pytest.mark.parametrize("scenario", [LINE, bs.load_scenario(PICK)], ids=["line", "trajectory"])
def test_blocks_say_what_all_runs_together_say(scenario: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = 6000
    whole = bs.evaluate(scenario, samples=runs, seed=3)
    small_blocks(monkeypatch, 2500)
    shares: list[float] = []
    blocks = bs.evaluate(scenario, samples=runs, seed=3, threads=2, progress=shares.append)
    assert blocks.to_json() == bs.evaluate(scenario, samples=runs, seed=3).to_json(), "threads change nothing"
    assert shares == [2500 / runs, 5000 / runs, 1.0]
    assert blocks.samples == runs
    # Of lines the runs are the same; of trajectories each block draws its own, from the same law.
    own = whole.problem.trajectory is not None
    for p in (0.2, 0.5, 0.9):
        assert blocks.peak_force.quantile(p) == pytest.approx(whole.peak_force.quantile(p), rel=0.1 if own else 1e-4)
    assert blocks.peak_force.mean == pytest.approx(whole.peak_force.mean, rel=0.06 if own else 1e-12, nan_ok=True)
    for name in ("false_alarm_probability", "undetected_probability", "multi_joint_probability"):
        found, wanted = getattr(blocks, name), getattr(whole, name)
        assert found == pytest.approx(wanted, abs=5 * math.sqrt(0.25 / runs) if own else 1e-12)
    assert blocks.runs is not None
    assert blocks.runs["tick"].size == 2500


def test_counts_are_those_of_the_values() -> None:
    rng = np.random.default_rng(1)
    blocks = [np.abs(rng.normal(100, 40, size)) for size in (1, 500, 3000)]
    blocks[2][:7] = 0.0
    missed = [rng.random(block.size) < 0.01 for block in blocks]
    counter = Counter()
    for block, never in zip(blocks, missed, strict=True):
        counter.add(SampledDistribution(block, never))
    found, whole = counter.distribution(), SampledDistribution(np.concatenate(blocks), np.concatenate(missed))
    assert (found.mean, found.sd) == (pytest.approx(whole.mean, rel=1e-13), pytest.approx(whole.sd, rel=1e-12))
    for p in (1e-4, 0.2, 0.5, 0.98):
        # On the safe side, by no more than a bin.
        assert whole.quantile(p) <= found.quantile(p) <= whole.quantile(p) * (1 + 7e-5)
    assert found.quantile(0.9999) == math.inf
    assert found.exceedance(0.0) == whole.exceedance(0.0)
    assert found.exceedance(130.0) == pytest.approx(whole.exceedance(130.0), abs=1e-3)
    assert found.scaled(2.0).quantile(0.5) == 2 * found.quantile(0.5)


def test_no_runs_have_no_figures() -> None:
    found = Counter().distribution()
    assert all(math.isnan(x) for x in (found.mean, found.sd, found.quantile(0.5), found.exceedance(1.0)))


def test_memory_does_not_grow_with_the_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    small_blocks(monkeypatch, 10_000)

    def peak(samples: int) -> int:
        tracemalloc.start()
        bs.evaluate(LINE, samples=samples)
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return found

    assert peak(150_000) < 1.5 * peak(50_000)
