"""``bumpstop evaluate``: from a scenario file to a verdict."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from bumpstop.cli.completion import complete_setting
from bumpstop.errors import InputError

NOT_ACCEPTABLE = 3
INCONCLUSIVE = 4
MAX_SAMPLES = 100_000_000
MAX_THREADS = 256


def whole(low: int, high: int) -> Callable[[str | int], int]:
    """Reads a whole number; typer's own messages leave out what was written."""

    def read(written: str | int) -> int:
        text = str(written)  # defaults come here too
        # The length first: thousands of digits are refused by int itself.
        if not re.fullmatch(r"[+-]?[0-9]{1,30}", text) or not low <= int(text) <= high:
            raise typer.BadParameter(f"{text!r} cannot be used; wanted a whole number from {low} to {high}")
        return int(text)

    return read


Sampled = Annotated[
    int | None,
    typer.Option(
        parser=whole(1, MAX_SAMPLES), metavar="RUNS", help="Draw this many collisions instead of integrating."
    ),
]
SampleSeed = Annotated[
    int, typer.Option(parser=whole(0, 2**64 - 1), metavar="NUMBER", help="Seed of the sampled collisions.")
]


def command(
    scenarios: Annotated[
        list[Path],
        typer.Argument(
            metavar="SCENARIO...", help="Scenario files (TOML), or registers (TOML, CSV).", show_default=False
        ),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write report.html, figures, law.parquet and settings.toml there."),
    ] = None,
    sampled: Sampled = None,
    seed: SampleSeed = 0,
    threads: Annotated[
        int,
        typer.Option(
            parser=whole(1, MAX_THREADS),
            metavar="NUMBER",
            help="Threads that sample, or share times of contact or situations; they do not change the result.",
        ),
    ] = 2,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            autocompletion=complete_setting,
            help="Replace a key, e.g. --set contact.body=lower_arm_wrist.",
        ),
    ] = None,
) -> int:
    """Compute the force distribution of a scenario and judge it; or of many, worst first.

    Exit status: 0 acceptable, 3 not acceptable, 4 inconclusive, 2 bad input; of many, that of the worst.
    """
    from bumpstop.cli.folders import check_folder, check_inputs, check_no_job, scenario_files
    from bumpstop.cli.progress import progress
    from bumpstop.collision import evaluate, load_scenario
    from bumpstop.register.register_file import is_register

    changed = dict(change(text) for text in changes or [])
    if len(scenarios) > 1 or is_register(scenarios[0]):
        from bumpstop.cli.register.evaluate import evaluate_many

        return evaluate_many(scenarios, changed, samples=sampled, seed=seed, threads=threads, as_json=as_json, out=out)
    check_folder(out)
    check_no_job(out)
    checked = load_scenario(scenarios[0], changed)
    read = [*scenarios, *scenario_files([checked])]
    check_inputs(out, read, "settings.toml", "law.parquet", "report.html")
    uncertain = None
    try:
        with progress("drawing" if sampled else "evaluating") as share:
            if checked.uncertainty:
                from bumpstop.uncertainty import evaluate_uncertain

                uncertain = evaluate_uncertain(checked, samples=sampled, seed=seed, progress=share)
                result = uncertain.central
            else:
                result = evaluate(checked, samples=sampled, seed=seed, threads=threads, progress=share)
    except MemoryError:
        if sampled is None:
            problem = "is not given, and integrating over so many control cycles needs more memory than there is"
            raise InputError("--sampled", problem, "try --sampled 100000") from None
        raise InputError("--sampled", f"{sampled} collisions need more memory than there is", "give fewer") from None
    report = None
    if out is not None:
        from bumpstop.cli.collision.output import write_outputs

        report = write_outputs(result, out, uncertain)
    if as_json:
        typer.echo(json.dumps((uncertain or result).to_json(), allow_nan=False, indent=2))
    else:
        from rich.console import Console

        console = Console(highlight=False, markup=False)
        (uncertain or result).print_to(console)
        if report is not None:
            # Not wrapped, so that it can be copied or clicked.
            console.print(f"report: {report}", soft_wrap=True)
    # Without a body region there is nothing to judge, and no verdict that could fail.
    conclusion = result.verdict.conclusion if uncertain is None else uncertain.conclusion
    return {"not_acceptable": NOT_ACCEPTABLE, "inconclusive": INCONCLUSIVE}.get(conclusion, 0)


def change(text: str) -> tuple[str, Any]:
    """``key=value`` with a TOML value or numbers with commas between them, else a bare string."""
    key, equals, value = text.partition("=")
    key = re.sub(r"\s*\.\s*", ".", key.strip())
    # As messages write them; the dots within are as good as those without.
    key = re.sub(r'^uncertainty\."(.*)"$', r"uncertainty.\1", key)
    if not equals or not re.fullmatch(r"[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)*(\[[0-9]+\])?", key):
        raise InputError("--set", f"{text[:200]!r} is not KEY=VALUE", "for example --set contact.area_cm2=2")
    from bumpstop.collision.scenario.keys import value_of

    return key, value_of(value)
