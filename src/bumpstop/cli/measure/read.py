"""``bumpstop measure read``: what recordings of a gauge say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bumpstop.cli.folders import check_folder, check_inputs
from bumpstop.cli.option_names import as_options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.measure import GaugeFormat, GaugeReading

NOT_USABLE = 3
OPTIONS = {
    name: f"--{name.removesuffix('_hz').removesuffix('_N').replace('_', '-')}"
    for name in (
        *("time_column", "force_column", "pressure_column", "time_unit", "force_unit", "pressure_unit"),
        *("rate_hz", "trigger_N", "full_scale_N"),
    )
}

TimeColumn = Annotated[str | None, typer.Option("--time-column", help="Name or number of the column of time.")]
ForceColumn = Annotated[str | None, typer.Option("--force-column", help="Name or number of the column of force.")]
PressureColumn = Annotated[str | None, typer.Option("--pressure-column", help="Name or number of that of pressure.")]
TimeUnit = Annotated[str | None, typer.Option("--time-unit", help="s, ms or us.")]
ForceUnit = Annotated[str | None, typer.Option("--force-unit", help="N, kN, daN, lbf or kgf.")]
PressureUnit = Annotated[str | None, typer.Option("--pressure-unit", help="N/cm2, MPa, kPa, bar or psi.")]
Rate = Annotated[float | None, typer.Option("--rate", metavar="HZ", help="Sampling rate of a file without time.")]
Trigger = Annotated[float | None, typer.Option("--trigger", metavar="N", help="Force at which contact begins.")]
FullScale = Annotated[float | None, typer.Option("--full-scale", metavar="N", help="End of the device's range.")]


def read(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Recordings, CSV.", show_default=False)],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write report.html with the curves and readings.csv there.")
    ] = None,
    time_column: TimeColumn = None,
    force_column: ForceColumn = None,
    pressure_column: PressureColumn = None,
    time_unit: TimeUnit = None,
    force_unit: ForceUnit = None,
    pressure_unit: PressureUnit = None,
    rate: Rate = None,
    trigger: Trigger = None,
    full_scale: FullScale = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> int:
    """Read peak force, what is left after 0.5 s and faults from recordings of a gauge.

    Exit status: 0 all peaks can be relied on, 3 one cannot, 2 bad input.
    """
    from bumpstop.measure import GaugeFormat, read_gauge

    check_folder(out)
    check_inputs(out, files, "readings.csv", "report.html")
    with as_options(OPTIONS):
        form = GaugeFormat(
            time_column=time_column,
            force_column=force_column,
            pressure_column=pressure_column,
            time_unit=time_unit,
            force_unit=force_unit,
            pressure_unit=pressure_unit,
            rate_hz=rate,
            trigger_N=trigger,
            full_scale_N=full_scale,
        )
    readings = [read_gauge(file, form) for file in files]
    page = None
    if out is not None:
        from bumpstop.report.measure.reading import write_readings
        from bumpstop.text_files import write_text

        page = write_readings(readings, out)
        write_text(out / "readings.csv", readings_csv(readings))
    if as_json:
        typer.echo(json.dumps({"recordings": [each.to_json() for each in readings]}, allow_nan=False, indent=2))
    else:
        _print(readings)
        if page is not None:
            typer.echo(f"report: {page}")
    return 0 if all(each.usable for each in readings) else NOT_USABLE


def readings_csv(readings: Sequence[GaugeReading]) -> str:
    """Figures of recordings, a row each."""
    import csv
    import io

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    rows = [each.to_json() for each in readings]
    kept = [key for key in rows[0] if key not in ("columns", "units", "faults")]
    writer.writerow([*kept, "faults"])
    for row in rows:
        faults = " ".join(f"{fault['name']}:{fault['count']}" for fault in row["faults"])
        writer.writerow([*("" if row[key] is None else row[key] for key in kept), faults])
    return text.getvalue()


def _print(readings: Sequence[GaugeReading]) -> None:
    from bumpstop.terminal import table, terminal

    console = terminal()
    headings = ("recording", "peak, N", "after, ms", "left, N", "N/cm²", "Hz", "usable")
    rows = []
    for each in readings:
        figures = (each.peak_N, 1e3 * each.peak_time, each.lasting_N, each.peak_pressure_N_cm2, each.rate_hz)
        cells = ["-" if value != value else f"{value:.4g}" for value in figures]
        rows.append((Path(each.curve.source).name, *cells, "yes" if each.usable else "no"))
    console.print(table(headings, rows, left=("recording",)))
    for each in readings:
        for fault in each.faults:
            console.print(f"{Path(each.curve.source).name}: {fault.name} ({fault.count}): {fault.text}")


def format_of(
    time_unit: str | None, force_unit: str | None, time_column: str | None, force_column: str | None
) -> GaugeFormat:
    """What a user tells of the recordings of a plan."""
    from bumpstop.measure import GaugeFormat

    with as_options(OPTIONS):
        return GaugeFormat(
            time_column=time_column, force_column=force_column, time_unit=time_unit, force_unit=force_unit
        )
