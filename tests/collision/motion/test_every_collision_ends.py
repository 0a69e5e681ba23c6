"""No collision is simulated for ever, and all instruction sets tell the same of it.

Each runs in a process of its own, which is ended where it stands still. ``make validate`` (endings) has thousands.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop import _native
from bumpstop.errors import InputError
from cli.support import REPOSITORY
from collision.random_scenarios import ALLOWED, difference, random_scenario

# Hundreds of times as long as it takes.
MAX_DURATION_S = 120
TARGETS = _native.available_targets()
ONE_SUB_STEP = "--one-sub-step"


def run(*command: str, target: str) -> str:
    return subprocess.run(
        [sys.executable, *command],
        cwd=REPOSITORY / "tests",
        env=os.environ | {"BUMPSTOP_TARGET": target},
        capture_output=True,
        text=True,
        timeout=MAX_DURATION_S,
        check=True,
    ).stdout


@cache
def random_scenarios(first: int, count: int, *options: str, target: str = TARGETS[0]) -> list[dict[str, Any]]:
    lines = run("-m", "collision.random_scenarios", str(first), str(count), *options, target=target).splitlines()
    return [json.loads(line) for line in lines]


# Its reactions brake to exactly the last change of the rates: a leap there was undone and tried again, for ever.
LANDS_ON_THE_LAST_CHANGE = {
    "robot": "sia5d",
    "pose_rad": [
        1.6868185830150182, 0.20343258609693304, -1.818153016619557, -0.03663004296256256, -1.1764451207812643,
        -0.9467363944716063, -1.016518052774293,
    ],
    "motion": {"velocity_mm_s": [-59.56, 45.32, 4.93], "start": "rest"},
    "contact": {"stiffness_N_m": 50_000.0},
    "detector": {"thresholds_Nm": [20.0] * 7, "noise_sd_Nm": 3.0, "feedback_period_s": 0.004},
    "reaction": {"kind": "stop", "joint_acceleration_rad_s2": [10.08, 7.26, 21.85, 11.13, 23.86, 18.54, 8.49]},
    "simulation": {"step_s": 0.002, "substeps": 1},
}  # fmt: skip
EVALUATE = "import bumpstop, json, sys; law = bumpstop.evaluate(bumpstop.Scenario.from_dict(json.loads(sys.argv[1])))"


@pytest.mark.parametrize("target", TARGETS)
def test_a_leap_that_ends_where_the_rates_are_reached(target: str) -> None:
    mean = run("-c", f"{EVALUATE}; print(law.peak_force.mean)", json.dumps(LANDS_ON_THE_LAST_CHANGE), target=target)
    assert float(mean) == pytest.approx(123.989414246405, rel=1e-12)


@pytest.mark.parametrize("options", [(), (ONE_SUB_STEP,)], ids=["any sub-steps", "one sub-step"])
def test_random_scenarios_end(options: tuple[str, ...]) -> None:
    found = random_scenarios(0, 40, *options)
    assert [one["seed"] for one in found] == list(range(40))
    assert [one["stood_still"] for one in found if "stood_still" in one] == []
    assert sum("refused" in one for one in found) < 8


@pytest.mark.skipif(len(TARGETS) < 2, reason="there is one set of kernels here")
@pytest.mark.parametrize("target", TARGETS[1:])
def test_figures_do_not_depend_on_the_width_of_registers(target: str) -> None:
    ours = random_scenarios(0, 40, ONE_SUB_STEP)
    theirs = random_scenarios(0, 40, ONE_SUB_STEP, target=target)
    for one, two in zip(ours, theirs, strict=True):
        assert difference(one, two) <= ALLOWED, (one, two)


def test_more_latency_is_no_milder_whatever_the_scenario(tmp_path: Path) -> None:
    """Random robots, steps, sub-steps, limits for each joint or all alike, from rest and under way."""
    compared = 0
    for seed in range(60):
        scenario = random_scenario(seed, tmp_path, one_sub_step=seed % 2 == 0)
        if scenario.contact.kind != "clamped" or scenario.verdict.clamped_limit == "two_phase":
            continue
        late = [1e-9 + steps * scenario.simulation.step_s if steps else 0.0 for steps in (0, 1, 5, 17)]
        try:
            results = [bs.evaluate(scenario.with_values({"reaction.latency_s": each})) for each in late]
        except InputError:
            continue
        forces = np.array([[result.peak_force.quantile(p) for p in (0.5, 0.99)] for result in results])
        assert (forces[1:] >= forces[:-1] * (1 - 1e-9)).all(), seed
        compared += 1
    assert compared > 25
