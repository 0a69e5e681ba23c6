"""``bumpstop tune``: thresholds for a wanted number of false alarms an hour."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop.cli.detection.residual_source import ResidualSource, detector_settings, takes_residual_source
from bumpstop.cli.detection.residuals import holds_residuals, joint_numbers, load_series
from bumpstop.cli.folders import check_file, check_folder, check_inputs, scenario_files
from bumpstop.cli.progress import progress
from bumpstop.errors import InputError, near_matches
from bumpstop.terminal import table, terminal
from bumpstop.text_files import list_items, toml_value, write_text

if TYPE_CHECKING:
    from bumpstop.cli.detection.operating_curve import OperatingPoint
    from bumpstop.detection import ResidualSeries, Tuning
    from bumpstop.detection.tuning.result import Term

THRESHOLD_KEYS = ("thresholds_Nm", "per_speed_Nm_s", "per_acceleration_Nm_s2", "fast_Nm")
"""Of a file of thresholds, as far as they are tuned."""


@takes_residual_source
def command(
    recordings: Annotated[
        list[Path],
        typer.Argument(help="Contact-free recordings, or Parquet with residuals.", show_default=False),
    ],
    per_hour: Annotated[
        float | None,
        typer.Option(
            help="Wanted false alarms an hour, of all joints together.",
            show_default="one in ten times the recordings' length, at least 1",
        ),
    ] = None,
    *,
    residual_source: ResidualSource,
    joints: Annotated[str | None, typer.Option(metavar="LIST", help="Watch these joints only: 1,2,3.")] = None,
    confidence: Annotated[float, typer.Option(help="Of the intervals.")] = 0.95,
    terms: Annotated[
        str | None,
        typer.Option(metavar="LIST", help="What to tune beside constant thresholds: fast,speed,acceleration."),
    ] = None,
    trim_start: Annotated[
        float, typer.Option("--trim-start", help="Leave out so much at the start of every recording [s].")
    ] = 0.0,
    trim_end: Annotated[
        float, typer.Option("--trim-end", help="Leave out so much at the end of every recording [s].")
    ] = 0.0,
    scenario: Annotated[
        list[Path] | None, typer.Option(help="Show the trade against the forces of this scenario; may be repeated.")
    ] = None,
    save: Annotated[Path | None, typer.Option(help="Write the thresholds there (TOML), for --thresholds.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write report.html and its figures into this folder.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Choose thresholds from contact-free recordings, with intervals, and show what they cost in newtons."""
    from bumpstop.cli.detection.operating_curve import check_joints, load_scenarios, notes, operating_curve
    from bumpstop.cli.detection.scenario_noise import ScenarioNoise
    from bumpstop.detection import tune
    from bumpstop.detection.tuning.found_with import in_common, settings_of
    from bumpstop.model import unit_of

    wanted = _terms(terms)
    for option, value in (("--trim-start", trim_start), ("--trim-end", trim_end)):
        if not 0 <= value < math.inf:
            raise InputError(option, f"is {value}", "wanted zero or more")
    check_folder(out)
    check_file(save, "--save")
    scenarios = load_scenarios(scenario or [])
    read = [*residual_source.files_with(*recordings), *scenarios, *scenario_files(scenarios.values())]
    check_inputs(save, read, option="--save")
    check_inputs(out, read, "report.html")
    loaded = []
    with progress("reading residuals") as report:
        for done, one_file in enumerate(recordings, start=1):
            loaded.append(load_series(one_file, residual_source, motion="speed" in wanted or "acceleration" in wanted))
            report(done / len(recordings))
    series = [_trimmed(one, trim_start, trim_end) for one, _ in loaded]
    check_joints(scenarios, series[0].dof)
    common, differs = in_common([(one.source, one.found_with) for one in series])
    # What a file of thresholds says of the detector they are for.
    held = {"period_s": float(f"{series[0].period:.12g}")} | settings_of(common)
    recorded = not all(holds_residuals(path) for path in recordings)
    model, robot = residual_source.parts if recorded else (None, None)
    units = [] if robot is None else [unit_of(joint) for joint in robot.joints]
    monitored = joint_numbers(joints, series[0].dof) if joints is not None else None
    try:
        with progress("tuning"):
            tuning = tune(series, per_hour, joints=monitored, confidence=confidence, terms=wanted, units=units)
    except InputError as error:
        options = {"per_hour": "--per-hour", "confidence": "--confidence", "terms": "--terms"}
        option = options.get(error.field, error.field)
        raise InputError(option, error.problem, error.valid) from None
    of_files = dict.fromkeys(note for _, told in loaded for note in told)
    tuning = replace(tuning, notes=(*tuning.notes, *differs, *of_files))
    names = residual_source.names if recorded else []
    with ScenarioNoise(series) as noise:
        points = operating_curve(tuning, scenarios, noise, robot, model)
    whose = common.get("robot", "") if robot is None else robot.name
    told = notes(points, scenarios, noise, robot=whose, terms=bool(set(wanted) - {"fast"}))
    tuning = replace(tuning, notes=(*tuning.notes, *told))
    if save is not None:
        _save(tuning, series, save, held)
    page = None
    if out is not None:
        from bumpstop.report.detection.tuning import write_tuning

        asked = f"contact-free recordings: {', '.join(path.name for path in recordings)}"
        about = "; ".join(filter(None, (residual_source.arm, asked)))
        page = write_tuning(
            tuning,
            [point.to_json() for point in points],
            out,
            names,
            about,
            asked={
                "recordings": ", ".join(str(path) for path in recordings),
                "false alarms an hour": f"{tuning.target:.4g}",
                "joints": joints or "all",
                "confidence": f"{confidence:g}",
                "terms beside constant thresholds": terms or "none",
                "left out at the start, s": f"{trim_start:g}",
                "left out at the end, s": f"{trim_end:g}",
                "scenarios": ", ".join(str(path) for path in scenario or []) or "none",
                **residual_source.reading,
            },
            detector=detector_settings(residual_source, None) if recorded else {},
        )
    if as_json:
        found = tuning.to_json() | {key: None if value == math.inf else value for key, value in held.items()}
        found |= {"operating_curve": [point.to_json() for point in points]} if scenario else {}
        typer.echo(json.dumps(found, allow_nan=False, indent=2))
        return
    _print(tuning, points if scenario else [], names)
    for what, path in (("thresholds", save), ("report", page)):
        if path is not None:
            typer.echo(f"{what}: {path}")


def _save(tuning: Tuning, series: list[ResidualSeries], path: Path, held: dict[str, Any]) -> None:
    import bumpstop
    from bumpstop.detection.durations import hours_in_words, rates_in_words

    times = tuning.extrapolation()
    told = [
        f"bumpstop {bumpstop.__version__} tune, {tuning.target:.4g} false alarms an hour wanted",
        f"rate {100 * tuning.confidence:g} % interval: {rates_in_words(*tuning.per_hour_interval())} an hour",
        f"from {hours_in_words(tuning.tail.hours)}; one alarm is expected in {times:.4g} times that",
        *(f"recording: {json.dumps(one.source)}" for one in series),
        *tuning.notes,
    ]
    found = tuning.to_json()
    lines = [f"# {' '.join(line.split())}" for line in told]
    for key in THRESHOLD_KEYS:
        if key in found:
            values = ", ".join("inf" if x is None else repr(x) for x in found[key])
            lines.append(f"{key} = [{values}]")
    lines += [f"{key} = {toml_value(value)}" for key, value in ({"per_hour": tuning.target} | held).items()]
    write_text(path, "\n".join(lines) + "\n")


def _terms(text: str | None) -> tuple[Term, ...]:
    from typing import get_args

    from bumpstop.detection.tuning.result import Term

    known = get_args(Term)
    names = [] if text is None else list_items(text)
    for name in names:
        if name not in known:
            raise InputError("--terms", f"{name[:40]!r} is none", near_matches(name, known))
    return tuple(term for term in known if term in names)


def _trimmed(series: ResidualSeries, start_s: float, end_s: float) -> ResidualSeries:
    """What is left of a recording's residuals, counted from its first and its last row."""
    import numpy as np

    begin, end = float(series.t[0]) + start_s, float(series.t[-1]) - end_s
    first, last = np.searchsorted(series.t, begin), np.searchsorted(series.t, end, side="right")
    if last - first < 2:
        length = float(series.t[-1] - series.t[0])
        option = "--trim-start" if start_s >= end_s else "--trim-end"
        raise InputError(option, f"leaves nothing of {series.source}", f"it is {length:.6g} s long")
    return series.only(slice(int(first), int(last)))


def _print(tuning: Tuning, points: list[OperatingPoint], names: list[str]) -> None:
    console = terminal()
    tuning.show(console, names)
    if points:
        console.print(_operating_curve_table(points))
    for note in tuning.notes:
        console.print(f"note: {note}")


def _operating_curve_table(points: list[OperatingPoint]) -> Any:
    from bumpstop.report.formatting import acceptable

    headings = ("alarms an hour", "scenario", "peak N p50", "p95", "p99.9", "undetectable N", "acceptable")
    rows = []
    for point in points:
        rate = f"{point.per_hour:.4g}" + (" *" if point.extrapolated else "")
        for name, forces in point.forces.items():
            cells = ("-" if forces[k] is None else f"{forces[k]:.4g}" for k in ("p50", "p95", "p999", "anywhere"))
            rows.append((rate, Path(name).stem, *cells, acceptable(forces, "-")))
    made = table(headings, rows, left=("scenario",))
    if any(point.extrapolated for point in points):
        made.caption = "* more than 100 times what was recorded"
    return made
