"""``bumpstop score``: events against labels."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop.cli.collision.evaluate import NOT_ACCEPTABLE
from bumpstop.cli.detection.residual_source import (
    Arming,
    ResidualSource,
    detector_settings,
    takes_residual_source,
    thresholds_of,
)
from bumpstop.cli.detection.residuals import holds_residuals, load_run, residuals_of
from bumpstop.cli.folders import check_folder, check_inputs
from bumpstop.cli.option_names import as_options
from bumpstop.cli.progress import progress
from bumpstop.errors import InputError
from bumpstop.text_files import read_text

if TYPE_CHECKING:
    from bumpstop.detection import Label, ResidualSeries, Roc, Score, Thresholds, Tolerance
    from bumpstop.recording import Recording

_MAX_BYTES = 100_000_000  # of events
_REARM_S = 0.5
# From a quarter of the thresholds to four times, in steps of a quarter of an octave.
_FACTORS = tuple(2 ** (k / 4) for k in range(-8, 9))


@takes_residual_source
def command(
    file: Annotated[
        Path, typer.Argument(help="Events (JSON of detect), residuals (Parquet), or a recording.", show_default=False)
    ],
    labels: Annotated[Path, typer.Option(help="CSV with start_s,end_s[,kind].", show_default=False)],
    thresholds: Annotated[
        str | None, typer.Option(metavar="LIST|FILE", help="Thresholds [Nm], for residuals or a recording.")
    ] = None,
    *,
    residual_source: ResidualSource,
    arming_delay: Arming = 0.0,
    early: Annotated[float, typer.Option(help="An event so long before a label still belongs to it [s].")] = 0.05,
    late: Annotated[float, typer.Option(help="An event so long after a label still belongs to it [s].")] = 0.25,
    rearm: Annotated[float, typer.Option(help="Quiet time before there may be another event [s].")] = _REARM_S,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write report.html and its figures into this folder.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> int:
    """Compare events with labelled contacts: delays, misses, false alarms, and what other thresholds would do.

    Exit status: 0 scored, 3 the detector was inactive all the time, 2 bad input.
    """
    from bumpstop.detection import Tolerance, load_labels

    for option, value in (("--early", early), ("--late", late), ("--rearm", rearm)):
        if not 0 <= value < math.inf:
            raise InputError(option, f"is {value}", "wanted zero or more")
    check_folder(out)
    check_inputs(out, [*residual_source.files_with(file), labels, thresholds], "report.html")
    tolerance = Tolerance(early, late)
    known = load_labels(labels)
    notes: list[str] = []
    if file.suffix == ".json":
        residual_source.refuse(f"the events of {str(file)!r}")
        for option, given in (
            ("--thresholds", thresholds is not None),
            ("--arming-delay", arming_delay != 0),
            ("--rearm", rearm != _REARM_S),
        ):
            if given:
                raise InputError(option, f"has no meaning with the events of {str(file)!r}", "leave it out")
        (found, inactive), roc = _of_events(file, known, tolerance), None
    else:
        if thresholds is None:
            raise InputError("--thresholds", "is missing", "residuals and recordings need it: numbers or a file")
        with progress("scoring"):
            found, roc, inactive, notes = _of_residuals(
                file, known, thresholds, residual_source, arming_delay, rearm, tolerance
            )
    report = None
    if out is not None:
        from bumpstop.report.detection.scoring import write_scoring

        asked = f"{file.name} against the labels of {labels.name}"
        recorded = file.suffix != ".json" and not holds_residuals(file)
        report = write_scoring(
            found,
            roc,
            out,
            "; ".join(filter(None, (residual_source.arm, asked))),
            asked={
                "events of": str(file),
                "labels": str(labels),
                "thresholds": "those of the events" if thresholds is None else thresholds,
                "arming delay, s": f"{arming_delay:g}",
                "early, s": f"{early:g}",
                "late, s": f"{late:g}",
                "time below the thresholds between events, s": f"{rearm:g}",
                **residual_source.reading,
            },
            detector=detector_settings(residual_source, thresholds) if recorded else {},
            inactive=inactive,
            notes=notes,
        )
    status = NOT_ACCEPTABLE if inactive else 0
    if as_json:
        whole = {"active": not inactive} | found.to_json() | ({"roc": roc.to_json()} if roc is not None else {})
        typer.echo(json.dumps(whole | {"notes": notes}, allow_nan=False, indent=2))
        return status
    if inactive:
        typer.echo(f"INACTIVE all the time ({inactive}): nothing could be detected")
    _print(found, roc)
    for note in notes:
        typer.echo(f"note: {note}")
    if report is not None:
        typer.echo(f"report: {report}")
    return status


def _of_events(file: Path, labels: tuple[Label, ...], tolerance: Tolerance) -> tuple[Score, str]:
    """Score, and why the detector was inactive all the time; empty: it was not, or the file does not say."""
    from bumpstop.detection import score
    from bumpstop.detection.scoring.scoring import cover

    wanted = "wanted what bumpstop detect --json prints: events, start_s, end_s, no_data"
    text = read_text(file, wanted, max_bytes=_MAX_BYTES)
    try:
        data: Any = json.loads(text)
        events = [float(event["t"]) for event in data["events"]]
        monitored = (float(data["start_s"]), float(data["end_s"]))
        no_data, arming = (
            [(float(a), float(b)) for a, b in intervals] for intervals in (data["no_data"], data.get("arming", []))
        )
    except KeyError as error:
        raise InputError(str(file), f"has no {error.args[0]!r}", wanted) from None
    except (ValueError, TypeError, OverflowError, RecursionError):
        raise InputError(str(file), "holds no events", wanted) from None
    found = score(events, labels, monitored, no_data=no_data, arming=arming, tolerance=tolerance)
    # Files of other programs need not say it, but for these times.
    inactive = data.get("active") is False or cover([*no_data, *arming], monitored)
    return found, "as the file of events says" if inactive else ""


def _print(found: Score, roc: Roc | None) -> None:
    from rich.table import Table

    from bumpstop.terminal import terminal

    console = terminal()
    console.print(str(found))
    if roc is None:
        return
    table = Table(box=None, pad_edge=False)
    for heading in ("factor", "detected", "false alarms an hour", "median delay, ms"):
        table.add_column(heading, justify="right")
    for row in roc.to_json():
        rate, delay = row["false_alarms_per_hour"], row["median_delay_s"]
        cells = ("-" if rate is None else f"{rate:.4g}", "-" if delay is None else f"{1e3 * delay:.4g}")
        table.add_row(f"{row['factor']:.3g}", f"{row['detected']} of {roc.labels}", *cells)
    console.print(table)


def _found_with_others(series: ResidualSeries, given: Thresholds) -> list[str]:
    """Sentences on what residuals were found with and thresholds were not; another kind of residual is refused."""
    from bumpstop.detection import DetectorSettings
    from bumpstop.detection.tuning.found_with import settings_of
    from bumpstop.model.dynamics import STANDARD_GRAVITY

    if not series.found_with:
        said = f"{series.source} does not say what its residuals were found with: whether the thresholds are for such"
        return [f"{said} is not known."] if given.settings else []
    # Of an upright arm, and of a payload at its tip, nothing is said.
    usual = {"gravity": STANDARD_GRAVITY, "payload_center": None}
    settings = DetectorSettings(**{**given.settings, **usual, **settings_of(series.found_with)})
    with as_options({"residual": series.source, "observer_gain_1_s": series.source}):
        given.check_residual(settings.residual, settings.observer_gain_1_s)
    return given.differences(settings)


def _of_residuals(
    file: Path,
    labels: tuple[Label, ...],
    thresholds: str,
    residual_source: ResidualSource,
    arming_delay_s: float,
    rearm_s: float,
    tolerance: Tolerance,
) -> tuple[Score, Roc | None, str, list[str]]:
    """Score, other thresholds, why the detector was inactive all the time (empty: it was not), and notes.

    Events of a recording are those of the detector; residuals alone are compared with constant thresholds.
    """
    import numpy as np

    from bumpstop.detection import DetectorSettings, event_times, gaps, roc, scaled_residual, score
    from bumpstop.detection.rate import period_of
    from bumpstop.detection.scoring.contact_forces import contact_forces

    series: ResidualSeries | None
    log: Recording | None = None
    notes: list[str] = []
    inactive = ""
    # As a run of the detector has them: a false alarm hides no contact behind it while it stands.
    apart_s = min(rearm_s, DetectorSettings.event_pause_s)
    if holds_residuals(file):
        series = residuals_of(file, residual_source)
        if arming_delay_s:
            raise InputError("--arming-delay", f"has no meaning with the residuals of {str(file)!r}", "leave it out")
        given = thresholds_of(thresholds, series.dof)
        period_of(series.t, DetectorSettings(), given)
        notes.extend(_found_with_others(series, given))
        if given.beyond_constant:
            left = ", ".join(given.beyond_constant)
            notes.append(
                f"Residuals without the recording are compared with thresholds_Nm alone; left out: {left}. "
                "Score the recording to count them."
            )
        inactive = "" if np.isfinite(given.constant).any() else "no joint is monitored"
        times = event_times(series, scaled_residual(series, given.constant), 1.0, apart_s)
        monitored, no_data, arming = (float(series.t[0]), float(series.t[-1])), gaps(series), []
    else:
        given = thresholds_of(thresholds, residual_source.parts[1])
        log = residual_source.recording(file)
        series, run, notes = load_run(file, given, residual_source, arming_delay_s, rearm_s, log)
        inactive = run.inactive
        times = np.array([event.t for event in run.events])
        monitored = (float(run.t[0]), float(run.t[-1]))
        no_data, arming = run.no_data_intervals(), run.arming_intervals()
    whole = score(times, labels, monitored, no_data=no_data, arming=arming, tolerance=tolerance)
    if log is not None and log.wrench is not None:
        whole = replace(whole, forces=contact_forces(whole.labels, whole.delay_s, log.t, log.wrench))
    if series is None:
        return whole, None, inactive, notes
    factors = roc(
        series,
        given.constant,
        labels,
        _FACTORS,
        rearm_s=apart_s,
        tolerance=tolerance,
        monitored=monitored,
        no_data=no_data,
        arming=arming,
    )
    return whole, factors, inactive, notes
