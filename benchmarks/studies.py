"""Speed of the studies: a workspace study besides its distributions, predicted forces, speed limits of a trajectory."""

from __future__ import annotations

import dataclasses
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import bumpstop as bs
from bumpstop.collision import BatchResult, CollisionProblem
from bumpstop.report.studies.study import write_study_report
from bumpstop.report.studies.workspace import pages_of
from bumpstop.study import run
from bumpstop.study.prediction import predict_batch
from bumpstop.study.workspace.workspace import WorkspaceStudy

REPOSITORY = Path(__file__).resolve().parent.parent
SOURCE_POSES = 61_000
LINK_RADIUS_MM = 50.0
WAYPOINTS = 1000
COMMAND = (sys.executable, "-c", "from bumpstop.cli.main import main; main()", "study")


def workspace_without_laws() -> float:
    """CPU time of Schroeder's study besides its distributions [s]: poses, self-collision, files, summary, page."""
    scenario = bs.load_scenario(REPOSITORY / "examples/01_hand_downward.toml")
    slow = scenario.with_values({"motion.velocity_mm_s": [0, 0, -10]})
    study = WorkspaceStudy(
        slow, poses=SOURCE_POSES, speed_sd_mm_s=2.0, directions="polar", link_radius_mm=LINK_RADIUS_MM
    )
    one = study._laws(CollisionProblem.from_scenario(slow).q[None], np.array([[0.0, 0.0, -0.01]]))

    def same(self: Any, q: Any, velocity: Any) -> BatchResult:
        rows = np.zeros(len(q), dtype=np.int64)
        laws = {field.name: getattr(one, field.name)[rows] for field in dataclasses.fields(one)}
        # Some spread, for figures as full as they are.
        laws["quantile"] = laws["quantile"] * (0.5 + 40 * np.linalg.norm(velocity, axis=1))[:, None]
        return BatchResult(**laws)

    begin = time.process_time()
    with patch.object(WorkspaceStudy, "_laws", same), tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        rows, summary = run(study, out)
        title, parts, notes = pages_of(study, rows, summary)
        write_study_report(study, title, parts, out, notes=notes)
    return time.process_time() - begin


def workspace_command() -> tuple[float, float]:
    """Schroeder's study as a command on two threads: seconds to the table of its rows, and to the page."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        begin = time.time()
        done = subprocess.run(
            [
                *COMMAND,
                *("workspace", str(REPOSITORY / "examples/01_hand_downward.toml"), "--poses", str(SOURCE_POSES)),
                *("--set", "motion.velocity_mm_s=[0,0,-10]", "--speed-sd", "2", "--directions", "polar"),
                *("--threads", "2", "--out", str(out)),
            ],
            capture_output=True,
            check=False,
            env=_environment(),
        )
        if done.returncode not in (0, 3):
            raise RuntimeError(done.stderr.decode())
        return (out / "rows.parquet").stat().st_mtime - begin, time.time() - begin


def predicted_case(poses: int = 4000) -> float:
    """Processor time of one predicted case of the source's control group [s], the best of three."""
    scenario = bs.load_scenario(REPOSITORY / "examples/01_hand_downward.toml")
    robot = bs.Robot.load(scenario.robot)
    rng = np.random.default_rng(1)
    q = rng.uniform(robot.lower, robot.upper, (poses, robot.dof))
    q[:, 6] = 0
    direction = rng.normal(size=(poses, 3))
    velocity = 0.01 * direction / np.linalg.norm(direction, axis=1)[:, None]
    times = []
    for _ in range(3):
        begin = time.process_time()
        predict_batch(scenario, q, velocity)
        times.append(time.process_time() - begin)
    return min(times) / poses


def speed_limits_command() -> tuple[float, float]:
    """The whole command on a trajectory of 1000 waypoints, start of Python and page included: wall and processor time.

    Each the best of three [s].
    """
    example = REPOSITORY / "examples/06_pick_and_place_trajectory.toml"
    trajectory = CollisionProblem.from_scenario(bs.load_scenario(example)).trajectory
    assert trajectory is not None
    t = np.linspace(0, trajectory.duration, WAYPOINTS)
    walls, processors = [], []
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        shutil.copy(example, home / "scenario.toml")
        header = ",".join(["t", *(f"q_{j + 1}" for j in range(trajectory.position.shape[1]))])
        rows = np.column_stack([t, trajectory.at(t)])
        np.savetxt(home / "06_pick_and_place.csv", rows, delimiter=",", header=header, comments="", fmt="%.12g")
        for number in range(3):
            before, begin = _children_s(), time.perf_counter()
            arguments = ["speed-limits", str(home / "scenario.toml"), "--out", str(home / f"out{number}")]
            done = subprocess.run([*COMMAND, *arguments], capture_output=True, check=False, env=_environment())
            if done.returncode not in (0, 3):
                raise RuntimeError(done.stderr.decode())
            walls.append(time.perf_counter() - begin)
            processors.append(_children_s() - before)
    return min(walls), min(processors)


def _environment() -> dict[str, str]:
    """Python's compiled files are kept, as an installed package has them."""
    return {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}


def _children_s() -> float:
    import resource

    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
