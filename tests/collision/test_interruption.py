"""Ctrl-C is heard while the kernels work, not after; what was there before is as it was."""

from __future__ import annotations

import signal
import subprocess
import sysconfig
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop import CollisionProblem, Scenario
from bumpstop.study.prediction import predict_batch
from cli.support import REPOSITORY
from collision.cases import control_group, free

# Somebody who waits detects a second; a machine that does much else may take some more.
AFTER_S, PATIENCE_S = 0.4, 2.0
COMMAND = Path(sysconfig.get_path("scripts")) / "bumpstop"
PICK_AND_PLACE = REPOSITORY / "examples" / "06_pick_and_place_trajectory.toml"


@contextmanager
def interrupted() -> Iterator[list[float]]:
    """Soon, what Ctrl-C does; gives when it was done."""
    done: list[float] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    done.append(time.monotonic() + AFTER_S)
    signal.setitimer(signal.ITIMER_REAL, AFTER_S)
    try:
        yield done
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def many_poses(count: int) -> tuple[Any, Any]:
    problem = CollisionProblem.from_scenario(control_group())
    rng = np.random.default_rng(5)
    q = rng.uniform(problem.robot.lower, problem.robot.upper, (count, problem.robot.dof))
    return q, 0.05 * rng.normal(size=(count, 3))


def trajectory(**changes: Any) -> Scenario:
    return bs.load_scenario(PICK_AND_PLACE).with_values(
        {key.replace("__", "."): value for key, value in changes.items()}
    )


# Each takes many seconds, or minutes, in one kernel.
LONG: dict[str, Callable[[], object]] = {
    # Every sub-step is gone one by one: the arm never has the rates asked for.
    "a path": lambda: bs.evaluate(
        control_group(
            motion__velocity_mm_s=[0, 0, -0.01], motion__duration_s=1500.0, simulation__substeps=100,
            detector__arming_delay_s=1400.0, contact__offset_law="fixed", contact__offset_mm=0.001,
        )
    ),
    "an integrated distribution": lambda: bs.evaluate(
        control_group(
            detector__noise_correlation=0.99, detector__feedback_period_s=0.001, motion__velocity_mm_s=[0, 0, -1],
        )
    ),
    "noise before contact": lambda: bs.evaluate(
        control_group(
            detector__noise_correlation=0.5, detector__feedback_period_s=0.001, detector__arming_delay_s=900.0,
            motion__duration_s=1000.0,
        )
    ),
    "a body that gets away": lambda: bs.evaluate(
        free(40.0, motion__velocity_mm_s=[0, 0, -20], simulation__step_s=1e-4, detector__feedback_period_s=1e-4)
    ),
    "runs": lambda: bs.evaluate(control_group(detector__noise_correlation=0.5), samples=3_000_000),
    "runs in two threads": lambda: bs.evaluate(
        control_group(detector__noise_correlation=0.5), samples=3_000_000, threads=2
    ),
    "a batch": lambda: bs.evaluate_batch(control_group(), *many_poses(200_000)),
    "a batch in two threads": lambda: bs.evaluate_batch(control_group(), *many_poses(200_000), threads=2),
    "a trajectory": lambda: bs.evaluate(trajectory(simulation__step_s=1e-4, detector__feedback_period_s=1e-4)),
    "a trajectory in two threads": lambda: bs.evaluate(
        trajectory(simulation__step_s=1e-4, detector__feedback_period_s=1e-4), threads=2
    ),
    "runs of a trajectory": lambda: bs.evaluate(trajectory(), samples=60_000, threads=2),
    "predictions": lambda: predict_batch(control_group(), *many_poses(1_000_000)),
}  # fmt: skip


@pytest.mark.parametrize("name", LONG)
def test_an_interruption_is_heard(name: str) -> None:
    bs.evaluate(control_group(), samples=10)  # what is imported on first use
    with pytest.raises(KeyboardInterrupt), interrupted() as at:
        LONG[name]()
    assert time.monotonic() - at[0] < PATIENCE_S


def test_nothing_is_lost() -> None:
    """The same objects answer as before."""
    problem = CollisionProblem.from_scenario(control_group())
    curve = bs.stopping_curve(problem)
    q, velocity = many_poses(100_000)
    before = bs.evaluate_batch(problem, q[:50], velocity[:50])
    runs = bs.evaluate(control_group(), samples=2000, seed=3).runs
    with pytest.raises(KeyboardInterrupt), interrupted():
        bs.evaluate_batch(problem, q, velocity, threads=2)
    after = bs.evaluate_batch(problem, q[:50], velocity[:50], threads=2)
    np.testing.assert_array_equal(after.mean, before.mean)
    np.testing.assert_array_equal(bs.stopping_curve(problem).max_distance, curve.max_distance)
    again = bs.evaluate(control_group(), samples=2000, seed=3, threads=2).runs
    assert runs is not None
    assert again is not None
    np.testing.assert_array_equal(again["tick"], runs["tick"])


@pytest.mark.skipif(not COMMAND.exists(), reason="bumpstop is not installed here")
@pytest.mark.parametrize(
    ("arguments", "after_s"),
    # Computed, the path is traced within two seconds, and panels of thousands of ticks are found behind that.
    [(["--sampled", "3000000", "--threads", "2"], 1.5), ([], 1.5), ([], 4.0)],
    ids=["drawn", "computed", "computed, later"],
)
def test_the_command_line(arguments: list[str], after_s: float) -> None:
    """One line, and the status that shells know."""
    command = [str(COMMAND), "evaluate", "examples/01_hand_downward.toml", *arguments]
    for change in ("noise_correlation=0.99", "feedback_period_s=0.001"):
        command += ["--set", f"detector.{change}"]
    command += ["--set", "motion.velocity_mm_s=[0, 0, -1]", "--json"]
    with subprocess.Popen(
        command, cwd=REPOSITORY, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        time.sleep(after_s)
        process.send_signal(signal.SIGINT)
        begin = time.monotonic()
        try:
            out, err = process.communicate(timeout=20)
        finally:
            process.kill()
    assert time.monotonic() - begin < PATIENCE_S
    assert (process.returncode, out, err) == (130, "", "error: interrupted\n")
