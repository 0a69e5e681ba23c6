"""Where ``tune`` and ``score`` get residuals from: a file of them, or a recording with a model."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.cli.detection.residual_source import DETECTOR_OPTIONS, ResidualSource
from bumpstop.cli.identification.arm_recordings import fit_notes, span_of
from bumpstop.cli.identification.fit_verdict import with_faults
from bumpstop.cli.option_names import as_options
from bumpstop.errors import InputError
from bumpstop.text_files import list_items, shown

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.detection import DetectionRun, ResidualSeries, Thresholds
    from bumpstop.recording import Recording

# What also has a meaning for residuals that are there already.
OF_RESIDUALS = ("begin", "until")


def load_series(
    path: Path, residual_source: ResidualSource, *, motion: bool = False
) -> tuple[ResidualSeries, list[str]]:
    """Residuals of a file that holds them, or of a contact-free recording; and what a reader must know of them.

    Args:
        path: of the file.
        residual_source: of a recording's residuals.
        motion: take speeds and accelerations of the joints, too.

    Raises:
        InputError: a file that cannot be used, or options for residuals that need none.
    """
    from bumpstop.detection import ResidualSeries, residual_record
    from bumpstop.detection.motion_rows import with_motion

    if holds_residuals(path):
        if motion:
            raise InputError("--terms", f"{str(path)!r} holds residuals without the motion", "give the recording")
        return residuals_of(path, residual_source), []
    model, arm = residual_source.parts
    log = residual_source.recording(path)
    with with_faults([log]), as_options({**DETECTOR_OPTIONS, "residuals": shown(path)}):
        record = residual_record(log, arm, model, settings=residual_source.settings)
    assert record.t is not None
    notes = [note for note in record.notes if "blocks of" not in note]
    series = ResidualSeries(record.t, record.rows, shown(path), found_with=record.found_with)
    if motion:
        series = with_motion(series, log, arm, model, residual_source.settings)
    known = fit_notes(residual_source.model, [log])
    return series, [*reading_notes(log, path), *known, *_unexplained(log, path, residual_source, record.rows), *notes]


def _unexplained(log: Recording, path: Path, residual_source: ResidualSource, residual: FloatArray) -> list[str]:
    """Notes of joints whose channel is dead, clipped or wrong: their thresholds are high for nothing else."""
    from bumpstop.identification.unexplained import unexplained

    model, arm = residual_source.parts
    settings = residual_source.settings
    found = unexplained(log, arm, model, residual, payload=residual_source.carried, gravity=settings.gravity)
    return [f"{shown(path)}: {sentence}{'' if sentence.endswith('?') else '.'}" for sentence in found]


def residuals_of(path: Path, residual_source: ResidualSource) -> ResidualSeries:
    """Of a file that holds them: the part between ``--from`` and ``--until``.

    Raises:
        InputError: other options of the origin were given, or nothing is left.
    """
    import numpy as np

    from bumpstop.detection import ResidualSeries

    residual_source.refuse(f"the residuals of {str(path)!r}", but=OF_RESIDUALS)
    series = ResidualSeries.load(path)
    if residual_source.begin is None and residual_source.until is None:
        return series
    start, length = float(series.t[0]), float(series.t[-1] - series.t[0])
    low, high = span_of(residual_source.begin, residual_source.until, length)
    first, last = np.searchsorted(series.t, [start + low, math.nextafter(start + high, math.inf)])
    if last - first < 2:
        raise InputError("--from", f"{low:g} leaves nothing before {high:g}", f"valid: 0 to {length:.6g} s")
    return replace(series, t=series.t[first:last], rows=series.rows[first:last])


def load_run(
    path: Path,
    thresholds: Thresholds,
    residual_source: ResidualSource,
    arming_delay_s: float,
    rearm_s: float,
    log: Recording,
) -> tuple[ResidualSeries | None, DetectionRun, list[str]]:
    """Residuals of a recording without its rows of no data, what the detector made of them, and what to know of them.

    There are none where fewer than two rows are left.
    """
    from bumpstop.detection import ResidualSeries, detect

    model, arm = residual_source.parts
    log = residual_source.recording(path)
    settings = residual_source.settings_for(thresholds, arming_delay_s=arming_delay_s)
    with as_options(DETECTOR_OPTIONS):
        run = detect(log, arm, model, thresholds, settings, rearm_s=rearm_s)
    seen, notes = ~run.no_data, [*reading_notes(log, path), *run.notes]
    if seen.sum() < 2:
        dark = f"{run.t.size - seen.sum()} of {run.t.size} rows"
        return None, run, [*notes, f"Other thresholds are not compared: the detector had no data in {dark}."]
    return ResidualSeries(run.t[seen], run.residual[seen], shown(path)), run, notes


def reading_notes(log: Recording, path: Path) -> list[str]:
    """Notes of the rows that a reader dropped, if it did, and of what the recording contradicts."""
    from bumpstop.identification.fit_verdict import as_sentences, reading_faults

    report = log.report
    rows = [f"{shown(path)}: {report.rows_dropped} of {report.rows_read} rows dropped while reading."]
    return [*rows * (report.rows_dropped > 0), *as_sentences(reading_faults([log]))]


def holds_residuals(path: Path) -> bool:
    """Whether a file is Parquet with a column ``residual_1``.

    Raises:
        InputError: there is no such file, or it is damaged: before anything else is asked for.
    """
    wanted = "wanted a recording, or Parquet with residuals"
    try:
        there = path.exists()
    except OSError as error:  # as of a name that is too long for any
        raise InputError(str(path), f"cannot be read ({error.strerror})", wanted) from None
    if not there:
        raise InputError(str(path), "there is no such file", wanted)
    if path.suffix != ".parquet" or not path.is_file():
        return False
    from bumpstop.recording.formats.parquet_excel import read_parquet

    return any(name.startswith("residual_") for name in read_parquet(path).names)


def joint_numbers(text: str, dof: int) -> list[int]:
    """Numbers from 0 of the joints that a person lists from 1."""
    try:
        numbers = [int(part) for part in list_items(text)]
    except ValueError:
        numbers = []
    if not numbers or not all(1 <= number <= dof for number in numbers):
        raise InputError("--joints", f"{text[:80]!r} cannot be used", f"wanted numbers from 1 to {dof}, as 1,2,3")
    return [number - 1 for number in numbers]
