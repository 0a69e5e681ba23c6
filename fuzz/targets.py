"""Every reader of files, with the endings it takes and what to begin from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

Read = Callable[[Path], Any]


@dataclass(frozen=True)
class Target:
    """A reader.

    Attributes:
        read: a file of one of the corpus' names; may raise InputError and nothing else.
        corpus: makes the files to begin from, by name; their endings count.
        files: of the repository, patterns, that join the corpus.
    """

    read: Read
    corpus: Callable[[], dict[str, bytes]] = dict
    files: tuple[str, ...] = ()


def _scenario(path: Path) -> None:
    from bumpstop.collision import CollisionProblem, load_scenario

    CollisionProblem.from_scenario(load_scenario(path))


def _campaign(path: Path) -> None:
    from bumpstop.campaign import load_campaign

    load_campaign(path)


def _robot(path: Path) -> None:
    import bumpstop as bs

    bs.Robot.from_urdf(path)


def _drive_train(path: Path) -> None:
    import bumpstop as bs
    from bumpstop.model import load_drive_train

    load_drive_train(path, bs.Robot.load("ur5e"))


def _limits(path: Path) -> None:
    from bumpstop.contact import LimitTable

    LimitTable.load(str(path))


def _joint_model(path: Path) -> None:
    from bumpstop.joint import JointTorqueModel

    JointTorqueModel.load(path)


def _dynamics(path: Path) -> None:
    from bumpstop.identification import DynamicsFit

    DynamicsFit.load(path)


def _thresholds(path: Path) -> None:
    from bumpstop.detection import Thresholds

    Thresholds.load(path)


def _labels(path: Path) -> None:
    from bumpstop.detection.scoring.labels import load_labels

    load_labels(path)


def _recording(path: Path, columns: str | None = None) -> None:
    import bumpstop as bs

    bs.Recording.load(path, columns=columns)


def _columns(path: Path) -> None:
    from bumpstop.recording import Columns

    Columns.load(path, path.parent)


def _residuals(path: Path) -> None:
    from bumpstop.detection.tuning.residual_record import read_residuals

    read_residuals(path)


def _trajectory(path: Path) -> None:
    import bumpstop as bs
    from bumpstop.collision.trajectory.trajectory_file import read_rows

    read_rows(path, bs.Robot.load("sia5d"))


def _stopping_table(path: Path) -> None:
    from bumpstop.collision.stopping.table_file import load_stopping_table

    load_stopping_table(path)


def _gauge_curve(path: Path) -> None:
    from bumpstop.measure import read_gauge

    read_gauge(path)


def _register(path: Path) -> None:
    from bumpstop.register import load_register

    load_register(path)


def _experiment(path: Path) -> None:
    from bumpstop.plant import Experiment

    Experiment.load(path)


def _cpp_text(path: Path) -> None:
    from fuzz.cpp_text import read_text

    read_text(path)


def _target(read: Read, module: str, *files: str) -> Target:
    from importlib import import_module

    def corpus() -> dict[str, bytes]:
        made: dict[str, bytes] = getattr(import_module("fuzz.corpus"), module)()
        return made

    return Target(read, corpus if module else dict, files)


# One row for each reader. `corpus` is a function of fuzz/corpus.py, or empty where files of the repository are enough.
TARGETS: dict[str, Target] = {
    "scenario": _target(_scenario, "", "examples/0[1-57]*.toml"),
    "campaign": _target(_campaign, "campaigns"),
    "urdf": _target(_robot, "urdfs"),
    "drive_train": _target(_drive_train, "drive_trains"),
    "limit_table": _target(_limits, "limit_tables"),
    "joint_model": _target(_joint_model, "", "src/bumpstop/joint/data/*.toml"),
    "dynamics": _target(_dynamics, "dynamics"),
    "thresholds": _target(_thresholds, "thresholds"),
    "labels": _target(_labels, "labels"),
    "columns": _target(_columns, "column_files"),
    "recording_csv": _target(_recording, "recordings_csv"),
    "recording_parquet": _target(_recording, "recordings_parquet"),
    "recording_excel": _target(_recording, "recordings_excel"),
    "recording_matlab": _target(partial(_recording, columns="columns.toml"), "recordings_matlab"),
    "recording_mcap": _target(_recording, "recordings_mcap"),
    "recording_db3": _target(_recording, "recordings_db3"),
    "residuals": _target(_residuals, "residuals"),
    "trajectory": _target(_trajectory, "trajectories", "examples/06_pick_and_place.csv"),
    "stopping_table": _target(_stopping_table, "", "examples/stopping/*.toml"),
    "gauge_curve": _target(_gauge_curve, "gauge_curves"),
    "register": _target(_register, "registers"),
    "experiment": _target(_experiment, "", "examples/plant/*.toml"),
    "cpp_text": _target(_cpp_text, "cpp_texts"),
}
