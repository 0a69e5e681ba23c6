"""``bumpstop measure plan``: which shots to take where, and what to expect."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bumpstop.cli.collision.evaluate import change, whole
from bumpstop.cli.completion import complete_setting
from bumpstop.cli.folders import check_folder, check_inputs, check_no_job, check_own, scenario_files
from bumpstop.cli.measure.scenarios import named_situations
from bumpstop.cli.option_names import as_options
from bumpstop.errors import InputError, near_matches
from bumpstop.terminal import in_percent, table, terminal
from bumpstop.text_files import list_items

if TYPE_CHECKING:
    from bumpstop.measure import MeasurementPlan

_SHOWN = 12  # shots on the terminal


def plan(
    scenarios: Annotated[
        list[str],
        typer.Argument(metavar="SCENARIO...", help="Scenario files, or NAME=FILE, and registers.", show_default=False),
    ],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write the sheet, plan.csv to fill in and the scenarios there.")
    ] = None,
    gauge: Annotated[
        str | None, typer.Option(help="Device for all situations.", show_default="that of each body region")
    ] = None,
    speeds: Annotated[str, typer.Option(metavar="LIST", help="Speeds, as percent of each situation's.")] = "50,75,100",
    shots: Annotated[
        int | None,
        typer.Option(
            parser=whole(1, 10_000), metavar="NUMBER", help="Shots to plan.", show_default="30, or one each situation"
        ),
    ] = None,
    repeats: Annotated[
        int, typer.Option(parser=whole(1, 100), metavar="NUMBER", help="Most shots at one situation and speed.")
    ] = 3,
    spread: Annotated[
        list[str] | None,
        typer.Option(
            "--spread",
            metavar="KEY=SD",
            help="How far a key may be off: of its logarithm, or of reaction.latency_s in seconds; 0: it is known.",
        ),
    ] = None,
    gauge_error: Annotated[
        float, typer.Option("--gauge-error", help="Standard deviation of a shot by gauge and cell, percent.")
    ] = 3.0,
    model_error: Annotated[
        float, typer.Option("--model-error", help="Standard deviation of the model at a place, percent.")
    ] = 2.0,
    points: Annotated[
        int,
        typer.Option(parser=whole(32, 100_000), metavar="NUMBER", help="Points of the cell that are computed."),
    ] = 128,
    seed: Annotated[int, typer.Option(parser=whole(0, 2**32 - 1), metavar="NUMBER", help="Seed of these points.")] = 0,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", autocompletion=complete_setting, help="Replace a key of all scenarios."
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Plan which collisions to measure with a gauge, ordered by what narrows the verdicts most."""
    from bumpstop.cli.progress import progress
    from bumpstop.measure import plan_measurements, write_plan
    from bumpstop.measure.learning.posterior import ErrorModel
    from bumpstop.measure.planning.plan_file import SCENARIOS, SETTINGS, TABLE

    check_folder(out)
    check_no_job(out)
    situations = named_situations(scenarios, dict(change(text) for text in changes or []), "SCENARIO")
    named = [(one.name, one.scenario) for one in situations]
    files = [Path(path) for text in scenarios for path in (text, text.partition("=")[2])]
    read = [*files, *scenario_files(scenario for _, scenario in named)]
    check_inputs(out, read, TABLE, SETTINGS, f"{SCENARIOS}/*", "report.html")
    if out is not None:
        check_own(out / SETTINGS, lambda _, data: {"situation", "points"} <= data.keys(), "give another folder")
    known = spreads(spread or [])
    with as_options({"gauge": "--gauge"}), progress("planning") as share:
        made = plan_measurements(
            named,
            device=gauge,
            speed_shares=_shares(speeds),
            shots=shots,
            repeats=repeats,
            spread={key: sd for key, sd in known.items() if sd > 0},
            fixed=[key for key, sd in known.items() if sd == 0],
            errors=ErrorModel(
                gauge=_percent(gauge_error, "--gauge-error"), model=_percent(model_error, "--model-error")
            ),
            points=points,
            seed=seed,
            progress=share,
        )
    table = page = None
    if out is not None:
        from bumpstop.report.measure.plan import write_plan_page

        table = write_plan(made, out, situations)
        page = write_plan_page(made, out)
    if as_json:
        typer.echo(json.dumps(made.to_json(), allow_nan=False, indent=2))
        return
    _print(made)
    for what, path in (("fill in", table), ("sheet", page)):
        if path is not None:
            typer.echo(f"{what}: {path}")


def spreads(given: list[str]) -> dict[str, float]:
    """Standard deviations by key, of ``KEY=SD``.

    Raises:
        InputError: one is no key with a number.
    """
    from bumpstop.measure.parameters import KEYS

    found: dict[str, float] = {}
    for text in given:
        key, _, value = text.partition("=")
        key = key.strip()
        try:
            found[key] = float(value)
        except ValueError:
            valid = "for example --spread reaction.latency_s=0.01"
            raise InputError("--spread", f"{text!r} is not KEY=SD", valid) from None
        if key not in KEYS:
            raise InputError("--spread", f"{key!r} is no key that measured forces tell", near_matches(key, KEYS))
        if not 0 <= found[key] < 10:
            raise InputError("--spread", f"{text!r} cannot be used", "wanted a number from 0 to below 10")
    return found


def _shares(text: str) -> list[float]:
    shares = []
    for item in list_items(text):
        try:
            percent = float(item)
        except ValueError:
            percent = math.nan
        if not 1 <= percent <= 100:
            raise InputError("--speeds", f"{item!r} cannot be used", "wanted percent from 1 to 100, as 50,75,100")
        shares.append(percent / 100)
    return shares


def _percent(value: float, option: str) -> float:
    if not 0 < value <= 100:
        raise InputError(option, f"is {value:g}", "wanted percent, above 0 and at most 100")
    return value / 100


def _print(made: MeasurementPlan) -> None:
    console = terminal()
    headings: tuple[str, ...] = ("situation", "gauge", "contact point, mm", "approach, mm")
    places = [
        (
            each.name,
            each.gauge.words,
            ", ".join(f"{1e3 * part:.1f}" for part in each.contact_point),
            f"{1e3 * each.approach:.0f}",
        )
        for each in made.situations
    ]
    console.print(table(headings, places, left=headings))
    headings = ("shot", "situation", "mm/s", "expected, N", "5 % to 95 %, N", "spread left, %")
    shots = [
        (
            str(shot.number),
            shot.situation,
            f"{shot.speed_mm_s:.4g}",
            f"{shot.predicted_N:.4g}",
            f"{shot.low_N:.4g} to {shot.high_N:.4g}",
            f"{100 * shot.spread:.2g}",
        )
        for shot in made.shots[:_SHOWN]
    ]
    console.print(table(headings, shots, left=("situation",)))
    if len(made.shots) > _SHOWN:
        console.print(f"and {len(made.shots) - _SHOWN} more; spread before any shot {in_percent(made.spread, 2)}")
    for situation in made.situations:
        for note in situation.notes:
            console.print(f"note: {situation.name}: {note}")
    for note in made.notes:
        console.print(f"note: {note}")
