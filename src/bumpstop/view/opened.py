"""What a page begins with: a scenario, and what else was opened with it."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from bumpstop.collision import Scenario, load_scenario
from bumpstop.collision.scenario.scenario_file import robot_of
from bumpstop.collision.scenario_values import start_pose
from bumpstop.contact import LimitTable
from bumpstop.errors import InputError, near_matches
from bumpstop.register.starting_scenario import DEFAULT_ROBOT, starting_scenario
from bumpstop.text_files import parse_toml

if TYPE_CHECKING:
    from bumpstop.detection.detection_run import DetectionRun
    from bumpstop.model import Robot
    from bumpstop.recording import Recording
    from bumpstop.view.point_rows import PointRows
    from bumpstop.view.program_segments import ProgramSegments
    from bumpstop.view.scene.arm_shapes import LinkShape

# What a study of a workspace may leave out, by its key in ``[made_by]``.
_IGNORED = {"joint_limits": "joint limits", "velocity_limits": "joint velocity limits"}
_URDF = (".urdf", ".xml")
PROGRAM_ENDINGS = (".script", ".urscript", ".src", ".mod", ".modx", ".prg", ".sys")


class Watch(Protocol):
    """Runs a detector over a recording of a robot."""

    def __call__(self, recording: Recording, robot: Robot) -> DetectionRun: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class Recorded:
    """A recording to replay.

    Attributes:
        recording: of the arm.
        run: a detector over it; None where none was given.
    """

    recording: Recording
    run: DetectionRun | None


@dataclass(frozen=True, eq=False)
class Opened:
    """What a page begins with.

    Attributes:
        scenario: on screen at first.
        robot: of the scenario.
        title: what was opened.
        notes: what was assumed to open it.
        points: rows of a study.
        recorded: a recording.
        program: a robot program.
    """

    scenario: Scenario
    robot: Robot
    title: str
    notes: tuple[str, ...] = ()
    points: PointRows | None = None
    recorded: Recorded | None = None
    program: ProgramSegments | None = None

    @cached_property
    def folder(self) -> Path:
        """For files that the scenarios on screen name, such as slowed trajectories; it outlives the page."""
        if self.program is not None:
            return self.program.folder
        return Path(tempfile.mkdtemp(prefix="bumpstop-view-"))

    def discard(self) -> None:
        """Remove the folder, where nothing on a page names its files."""
        if self.program is not None:
            shutil.rmtree(self.program.folder)

    @cached_property
    def shapes(self) -> tuple[LinkShape, ...]:
        """Of the base and the links: a URDF's meshes where they can be read, else drawn from the kinematics."""
        from bumpstop.view.scene.arm_shapes import arm_shapes
        from bumpstop.view.scene.urdf_meshes import urdf_meshes

        shapes = {shape.link: shape for shape in arm_shapes(self.robot)}
        path = self.scenario.robot_path
        if path is not None:
            shapes |= {shape.link: shape for shape in urdf_meshes(path, self.robot)[0]}
        return tuple(shapes.values())


def open_source(
    source: str | None,
    *,
    robot: str | None = None,
    watch: Watch | None = None,
    columns: Path | None = None,
    topic: str | None = None,
    cell: Path | None = None,
    base: str | None = None,
    tip: str | None = None,
) -> Opened:
    """Open what the command line names.

    Args:
        source: path of a scenario, of a study's folder or its ``rows.parquet``, or of a recording; name of a built-in
            robot, or path of its URDF. None: the built-in robot that ``bumpstop new`` starts with.
        robot: of a recording: name of a built-in robot, or path of its URDF.
        watch: of a recording: runs a detector over it.
        columns: of a recording: its column file.
        topic: of a recording: that of a bag with several.
        cell: of a program: path of the scenario that it is judged with.
        base: of a URDF, also a recording's: link where the chain begins.
        tip: likewise, where it ends.

    Raises:
        InputError: it is none of these, or cannot be used.
    """
    from bumpstop.model import robots

    for option, link in (("--base", base), ("--tip", tip)):
        if link is not None and _ending(robot or source or "") not in _URDF:
            valid = "leave it out, or name a URDF; scenarios have a key for it"
            raise InputError(option, "has no meaning without a URDF", valid)
    if source is not None and _ending(source) in PROGRAM_ENDINGS:
        return _program(Path(source), cell)
    if cell is not None:
        raise InputError("--scenario", "has no meaning without a program", "leave it out, or name a program")
    if source is not None and _ending(source) not in (".toml", *_URDF) and Path(source).exists():
        rows = _study_rows(Path(source))
        if rows is not None:
            return _study(rows)
        return _recording(Path(source), robot, watch, columns, topic, base, tip)
    of_recordings = (("--robot", robot), ("--thresholds", watch), ("--columns", columns), ("--topic", topic))
    for option, value in of_recordings:
        given = value is not None
        if given and source is not None and source not in robots() and not Path(source).exists():
            raise InputError(source, "there is no such file", "wanted a recording")
        if given:
            raise InputError(option, "has no meaning without a recording", "leave it out, or name a recording")
    return _scenario(source, base, tip)


def _ending(source: str) -> str:
    return Path(source).suffix.lower()


def _scenario(source: str | None, base: str | None = None, tip: str | None = None) -> Opened:
    """A scenario, or one to start from for a robot."""
    from bumpstop.model import robots

    if source is None or source in robots():
        name = source or DEFAULT_ROBOT
        scenario = Scenario.from_dict(parse_toml(starting_scenario(name), name))
        notes: tuple[str, ...] = (
            "A scenario to start from: thresholds, noise and deceleration stand for those of your cell.",
        )
        return Opened(scenario, robot_of(scenario), name, notes)
    path = Path(source)
    if _ending(source) == ".toml":
        scenario = load_scenario(path)
        arm = robot_of(scenario)
        # Without these there are no controls. What else cannot be used is told on the page, and can be mended there.
        LimitTable.load(scenario.contact.limits, relative_to=scenario.folder)
        if scenario.motion.kind == "line":
            start_pose(scenario, arm)
        return Opened(scenario, arm, str(path))
    if _ending(source) in _URDF:
        from bumpstop.view.scene.urdf_meshes import urdf_meshes
        from bumpstop.view.urdf_scenario import urdf_scenario

        try:
            scenario, arm = urdf_scenario(path, base, tip)
        except InputError as error:
            field = f"--{error.field}" if error.field in ("base", "tip") else error.field
            raise InputError(field, error.problem, error.valid) from None
        return Opened(scenario, arm, str(path), urdf_meshes(path, arm)[1])
    kinds = "wanted a scenario (.toml), URDF, program, recording, study or built-in robot"
    valid = f"{kinds}; {near_matches(source, robots())}"
    raise InputError("SOURCE", f"{source!r} cannot be opened", valid)


def _study_rows(path: Path) -> Path | None:
    """The rows of a study, where a path leads to one: its folder, or the file in it."""
    file = path / "rows.parquet" if path.is_dir() else path
    known = file.suffix == ".parquet" and file.is_file() and (file.parent / "settings.toml").is_file()
    return file if known else None


def _study(file: Path) -> Opened:
    from bumpstop.shards.settings_file import read_made_by
    from bumpstop.view.point_rows import point_rows, read_rows

    scenario = load_scenario(file.parent / "settings.toml")
    if scenario.motion.kind != "line":
        raise InputError("SOURCE", f"{str(file)!r} is a study of a trajectory", "open the scenario of the trajectory")
    robot = robot_of(scenario)
    points = point_rows(read_rows(file), robot.dof, str(file))
    made = read_made_by((file.parent / "settings.toml").read_bytes())
    ignored = " and ".join(words for key, words in _IGNORED.items() if made.get(key) == "ignore")
    if not ignored:
        return Opened(scenario, robot, str(file.parent), points=points)
    points = replace(points, otherwise=f"computed with {ignored} ignored")
    note = f"The rows were {points.otherwise}; the arm on screen keeps to them, and its force there may be another."
    return Opened(scenario, robot, str(file.parent), (note,), points=points)


def _program(path: Path, cell: Path | None) -> Opened:
    from bumpstop.view.program_segments import ProgramSegments

    if cell is None:
        raise InputError("--scenario", "is missing", "name the scenario of the cell that the program is judged in")
    folder = Path(tempfile.mkdtemp(prefix="bumpstop-view-"))
    try:
        program = ProgramSegments.read(path, load_scenario(cell), folder)
        scenario = program.first()
    except BaseException:
        shutil.rmtree(folder)
        raise
    return Opened(scenario, robot_of(scenario), str(path), program.notes, program=program)


def _recording(
    path: Path,
    robot: str | None,
    watch: Watch | None,
    columns: Path | None,
    topic: str | None,
    base: str | None,
    tip: str | None,
) -> Opened:
    from bumpstop.model import robots
    from bumpstop.recording import Recording
    from bumpstop.recording.reading import robot_notes

    name = robot or Recording.load(path, columns=columns, topic=topic).robot
    if robot is None and name not in robots():
        raise InputError(
            "--robot", "is missing", f"the recording does not say whose it is; valid: {', '.join(robots())}"
        )
    start = _scenario(name, base, tip)
    # As the commands have it: the robot says which joints of a bag count, in which order, and what they cannot do.
    recording = Recording.load(path, columns=columns, topic=topic, robot=start.robot)
    recording.check_robot(start.robot)
    run = None if watch is None else watch(recording, start.robot)
    without = (*recording.report.notes, "Without --thresholds there are no residuals and no alarms.")
    told = robot_notes(recording.robot, start.robot.name)
    report = recording.report
    rows = [f"{report.rows_dropped} of {report.rows_read} rows dropped while reading."] * (report.rows_dropped > 0)
    notes = (*start.notes, *told, *rows, *(without if run is None else run.notes))
    return Opened(start.scenario, start.robot, str(path), notes, recorded=Recorded(recording, run))
