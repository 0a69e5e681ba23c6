"""``bumpstop measure calibrate``: what measured shots say of a cell."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bumpstop.cli.collision.evaluate import whole
from bumpstop.cli.folders import check_file, check_folder, check_inputs, check_own, scenario_files
from bumpstop.cli.measure.read import ForceColumn, ForceUnit, TimeColumn, TimeUnit, format_of
from bumpstop.cli.measure.scenarios import named_situations
from bumpstop.errors import InputError
from bumpstop.terminal import in_percent, table, terminal

if TYPE_CHECKING:
    from bumpstop.measure.learning.plan_calibration import PlanCalibration


def calibrate(
    plan: Annotated[Path, typer.Argument(help="Folder of the plan, or its table, filled in.", show_default=False)],
    scenario: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME=]FILE", help="Scenario of a situation, in place of the plan's.", show_default=False
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="FILE.toml: write the one scenario; a folder: scenarios, their register, shots.csv, report.html.",
        ),
    ] = None,
    time_column: TimeColumn = None,
    force_column: ForceColumn = None,
    time_unit: TimeUnit = None,
    force_unit: ForceUnit = None,
    seed: Annotated[
        int | None,
        typer.Option(
            parser=whole(0, 2**32 - 1), metavar="NUMBER", help="Seed of the draws.", show_default="the plan's"
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Learn latency, deceleration, stiffness, rotor inertia and threshold margin from measured peak forces."""
    from bumpstop.cli.progress import progress
    from bumpstop.measure import calibrate_plan, load_plan
    from bumpstop.measure.learning.calibrated_register import HEAD, calibrated_register
    from bumpstop.measure.learning.calibrated_scenario import calibrated_toml
    from bumpstop.measure.planning.filled_shots import shots_text
    from bumpstop.measure.planning.plan_file import REGISTER, file_names
    from bumpstop.text_files import write_text

    file = out if out is not None and out.suffix == ".toml" else None
    folder = out if file is None else None
    check_file(file)
    check_folder(folder)
    given = named_situations(scenario or [], {}, "--scenario")
    filled = load_plan(plan, {one.name: one.scenario for one in given}).with_rows_of(given)
    names = file_names([name for name, _ in filled.named])
    given_files = [Path(path) for text in scenario or [] for path in (text, text.partition("=")[2])]
    read = [*filled.files, *given_files, *scenario_files(found for _, found in filled.named)]
    check_inputs(file, read)
    check_inputs(folder, read, "shots.csv", "report.html", REGISTER, *names.values())
    if folder is not None:
        check_own(folder / REGISTER, lambda text, _: text.startswith(HEAD), "give another folder")
    if file is not None and len(filled.named) > 1:
        raise InputError("--out", f"{str(file)!r} is one file for {len(filled.named)} situations", "give a folder")
    form = format_of(time_unit, force_unit, time_column, force_column)
    with progress("learning") as share:
        made = calibrate_plan(filled, form=form, seed=seed, progress=share)
    written: list[Path] = []
    if file is not None:
        write_text(file, calibrated_toml(made.calibration, filled.named[0][1]))
        written.append(file)
    page = None
    if folder is not None:
        from bumpstop.report.measure.calibration import write_calibration

        page = write_calibration(made, folder)
        write_text(folder / "shots.csv", shots_text(filled.shots, made.readings))
        for name, found in filled.named:
            write_text(folder / names[name], calibrated_toml(made.calibration, found))
            written.append(folder / names[name])
        write_text(folder / REGISTER, calibrated_register(made.calibration, filled, names))
    if as_json:
        typer.echo(
            json.dumps(made.calibration.to_json() | {"left_out": list(made.left_out)}, allow_nan=False, indent=2)
        )
        return
    _print(made)
    for path in written:
        typer.echo(f"scenario: {path}")
    if page is not None:
        typer.echo(f"register: {page.parent / REGISTER}")
        typer.echo(f"report: {page}")


def _print(made: PlanCalibration) -> None:
    from bumpstop.report.measure.calibration import value_words

    console = terminal()
    found = made.calibration
    headings: tuple[str, ...] = ("", "key", "after the shots")
    parameters = [(each.label, each.key, value_words(each)) for each in found.found]
    console.print(table(headings, parameters, left=headings))
    headings = ("situation", "mm/s", "shots", "before, N", "expected, N", "single shots, N", "limit, N")
    forces = [
        (
            force.situation,
            f"{force.speed_mm_s:.4g}",
            str(force.shots),
            _interval(force.before_N),
            _interval(force.expected_N),
            f"{force.single_N[0]:.4g} to {force.single_N[1]:.4g}",
            "-" if force.limit_N != force.limit_N else f"{force.limit_N:.4g}",
        )
        for force in found.forces
    ]
    console.print(table(headings, forces, left=("situation",)))
    for warning in found.warnings:
        console.print(f"warning: {warning}")
    for note in (*made.left_out, *found.notes):
        console.print(f"note: {note}")
    best = found.next_shot
    console.print(
        f"next best shot: {best.situation} at {best.speed_mm_s:.4g} mm/s, spread {in_percent(best.spread_now, 2)} to "
        f"{in_percent(best.spread_after, 2)}"
    )


def _interval(values: tuple[float, float, float]) -> str:
    return f"{values[0]:.4g} [{values[1]:.4g}, {values[2]:.4g}]"
