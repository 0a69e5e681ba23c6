"""``bumpstop evaluate``: from a scenario file to a verdict."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Annotated, Any

import typer

from bumpstop.errors import InputError

NOT_ACCEPTABLE = 3


def command(
    scenario: Annotated[Path, typer.Argument(help="Scenario file (TOML).", show_default=False)],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    out: Annotated[
        Path | None, typer.Option(help="Write report.html, figures, law.parquet and settings.toml there.")
    ] = None,
    sampled: Annotated[
        int | None, typer.Option(min=1, help="Draw this many collisions instead of the exact law.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=2**64 - 1, help="Seed of the sampled law.")] = 0,
    threads: Annotated[int, typer.Option(min=1, help="Threads of the sampled law; they do not change it.")] = 1,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Replace a key, e.g. --set contact.body=lower_arm_wrist."),
    ] = None,
) -> int:
    """Work out the force law of a scenario and judge it.

    Exit status: 0 acceptable, 3 not acceptable, 2 bad input.
    """
    from bumpstop.collision import evaluate, load_scenario

    law = evaluate(
        load_scenario(scenario, dict(_change(text) for text in changes or [])),
        samples=sampled,
        seed=seed,
        threads=threads,
    )
    report = None
    if out is not None:
        from bumpstop.cli.output import write_outputs

        report = write_outputs(law, out)
    if as_json:
        typer.echo(json.dumps(law.to_json(), allow_nan=False, indent=2))
    else:
        from bumpstop.cli.summary import print_summary

        print_summary(law, report)
    return NOT_ACCEPTABLE if law.verdict.acceptable is False else 0


def _change(text: str) -> tuple[str, Any]:
    """``key=value`` with a TOML value, else a bare string."""
    key, equals, value = text.partition("=")
    key = key.strip()
    if not equals or not key or not all(key.split(".")):
        raise InputError("--set", f"{text!r} is not KEY=VALUE", "for example --set contact.area_cm2=2")
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key, value.strip()
