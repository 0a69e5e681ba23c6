"""``bumpstop study speed-limits``: how fast the arm may move, along a trajectory or all over its workspace."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop import output_files
from bumpstop.cli.collision.evaluate import NOT_ACCEPTABLE, whole
from bumpstop.cli.collision.study import AsJson, Changes, Out, ScenarioFile, Seed, Threads, execute, load
from bumpstop.cli.folders import check_inputs, scenario_files
from bumpstop.errors import InputError

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.study.speed.trajectory.retiming import Retimed
    from bumpstop.study.speed.trajectory.trajectory_speed_limits import TrajectorySpeedLimits

_MAX_POSES = 10_000_000
_NOTES = (
    "At every row the tool moves on a straight line through the pose, and the body is clamped; where the scenario does "
    "not say how far away, one feedback period of travel or less, evenly.",
    "Speeds come from integrated force distributions: each one written here meets the accepted risk, and a speed at "
    "most 1 % higher does not, unless another cause is named.",
)


def speed_limits(
    scenario: ScenarioFile,
    poses: Annotated[
        int | None,
        typer.Option(
            parser=whole(1, _MAX_POSES),
            metavar="NUMBER",
            help="Random poses, for a scenario of a line.",
            show_default=False,
        ),
    ] = None,
    cone: Annotated[
        float | None,
        typer.Option(
            metavar="DEG",
            help="Half angle of the cone of directions; default: 0 along a trajectory, else 180.",
            show_default=False,
        ),
    ] = None,
    max_speed: Annotated[float, typer.Option(metavar="MM_S", help="No speed above it is looked at.")] = 1000.0,
    null_space: Annotated[
        bool,
        typer.Option(
            "--null-space", help="Suggest joint positions that detect smaller forces, for arms of seven joints."
        ),
    ] = False,
    out: Out = None,
    as_json: AsJson = False,
    threads: Threads = 2,
    seed: Seed = 0,
    changes: Changes = None,
) -> int:
    """Find the highest safe speed at every waypoint of a trajectory, and slow the trajectory down to it.

    A scenario of a line gives the highest safe speed at random poses instead. Exit status: 0 done, 3 the trajectory is
    too fast as it is, 2 bad input.
    """  # fmt: skip
    from bumpstop.study.speed.trajectory.trajectory_speed_limits import TrajectorySpeedLimits
    from bumpstop.study.speed.workspace_speed_limits import WorkspaceSpeedLimits

    checked = load(scenario, changes)
    if checked.motion.kind == "line":
        if null_space:
            raise InputError("--null-space", "has no meaning without a trajectory", "leave it out")
        study = WorkspaceSpeedLimits(
            checked,
            max_speed_mm_s=max_speed,
            cone_deg=180.0 if cone is None else cone,
            poses=200 if poses is None else poses,
            seed=seed,
        )

        def report(rows: pl.DataFrame, summary: dict[str, Any]) -> Any:
            from bumpstop.report.studies.speed_limits import WorkspaceSpeedLimitsPart

            return "Safe speed over the workspace", [WorkspaceSpeedLimitsPart(rows, summary)], _NOTES

        execute(study, out=out, as_json=as_json, threads=threads, report=report)
        return 0
    if poses is not None:
        raise InputError("--poses", "has no meaning with a trajectory", "leave it out")
    if seed:
        raise InputError("--seed", "has no meaning with a trajectory, where nothing is drawn", "leave it out")
    written = ("retimed.*", "speed_limit.csv", "suggestions.parquet", "report.html")
    check_inputs(out, [scenario, *scenario_files([checked])], *written)
    return _along(
        TrajectorySpeedLimits(checked, max_speed_mm_s=max_speed, cone_deg=cone or 0.0),
        null_space,
        out,
        as_json,
        threads,
    )


def _along(study: TrajectorySpeedLimits, null_space: bool, out: Path | None, as_json: bool, threads: int) -> int:
    if null_space:
        from bumpstop.study.null_space import check_redundant

        if out is None:
            raise InputError("--null-space", "has no place for its suggestions", "give --out as well")
        check_redundant(study.problem)

    files: list[str] = []

    def report(rows: pl.DataFrame, summary: dict[str, Any]) -> Any:
        from bumpstop.report.studies.speed_limits import SuggestionPart, TrajectorySpeedLimitsPart

        assert out is not None
        retimed = study.slowed(rows).retimed
        if retimed is not None:
            from bumpstop.study.speed.trajectory.trajectory_writing import write_csv, write_ros

            write_csv(out / "retimed.csv", retimed)
            write_ros(out / "retimed.json", retimed, study.problem.robot)
            files.extend(("retimed.csv", "retimed.json"))
        else:
            # Left from another run they would be taken for this trajectory's.
            for name in ("retimed.csv", "retimed.json"):
                (out / name).unlink(missing_ok=True)
        output_files.write_csv(out / "speed_limit.csv", rows.select("waypoint", "t_s", "limit_mm_s"))
        files.append("speed_limit.csv")
        parts: list[Any] = [TrajectorySpeedLimitsPart(rows, summary, _speeds(study, retimed, rows))]
        if null_space:
            waypoints = rows.filter(~rows["between"])
            suggestions = _suggest(study, waypoints)
            output_files.write_parquet(out / "suggestions.parquet", suggestions)
            files.append("suggestions.parquet")
            parts.append(SuggestionPart(waypoints, suggestions))
        return "Safe speed along a trajectory", parts, _NOTES

    summary = execute(study, out=out, as_json=as_json, threads=threads, report=report)
    if files and not as_json:
        typer.echo(f"files: {', '.join(str(out / name) for name in files if out is not None)}")
    return 0 if summary["acceptable"] else NOT_ACCEPTABLE


def _speeds(study: TrajectorySpeedLimits, retimed: Retimed | None, rows: pl.DataFrame) -> Any:
    """Speed of the slowed tip at the rows [mm/s]; None where there is no slower trajectory."""
    import numpy as np

    if retimed is None:
        return None
    rate = study.trajectory.at(study.trajectory.time, 1)
    new = np.linalg.norm(retimed.velocity[retimed.waypoint], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.nan_to_num(new / np.linalg.norm(rate, axis=1))
    return share * rows["speed_mm_s"].to_numpy()


def _suggest(study: TrajectorySpeedLimits, rows: pl.DataFrame) -> pl.DataFrame:
    import polars as pl

    from bumpstop.study.null_space import improve_detectability

    direction = rows.select("direction_x", "direction_y", "direction_z").to_numpy()
    found = improve_detectability(study.problem, study.given.position, direction)
    columns = {f"q_{j + 1}": found.q[:, j] for j in range(found.q.shape[1])}
    return pl.DataFrame(
        {"waypoint": rows["waypoint"], **columns, "undetectable_N": found.undetectable, "gain": found.gain}
    )
