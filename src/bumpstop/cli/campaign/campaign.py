"""``bumpstop campaign``: force distributions by the million, in shards."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop.cli.collision.evaluate import whole
from bumpstop.cli.command_group import group
from bumpstop.cli.option_names import as_options
from bumpstop.cli.progress import progress
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.campaign import Campaign
    from bumpstop.shards import ResultFolder, Workers
    from bumpstop.shards.run import Account

app = group("Compute force distributions of many arms, tools, poses, bodies and detectors, on one machine or many.")
MAX_WORKERS = 1024

# What is wrong with a folder is told of --out, which commands on a folder that is there do not have.
_OF_FOLDER = {"--out": "FOLDER"}

Folder = Annotated[str, typer.Argument(help="Folder of the campaign, or a URL such as s3://bucket/run.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
NumberOfWorkers = Annotated[
    int,
    typer.Option(
        "--workers", parser=whole(1, MAX_WORKERS), metavar="NUMBER", help="Processes; they do not change the result."
    ),
]
Cluster = Annotated[
    str, typer.Option(metavar="ADDRESS", help="local, or a scheduler of dask.distributed: tcp://HOST:PORT.")
]
Share = Annotated[str, typer.Option(metavar="K/N", help="Compute the K-th of N shares of the shards, and do not join.")]


@app.command("run")
def run(
    file: Annotated[Path, typer.Argument(help="Campaign file (TOML).", show_default=False)],
    out: Annotated[str | None, typer.Option("--out", "-o", help="Folder or URL for the shards and the result.")] = None,
    workers: NumberOfWorkers = 2,
    cluster: Cluster = "local",
    shard: Share = "1/1",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say how many, how long and how large; compute a part.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Compute what a campaign still lacks, and join it."""
    from bumpstop.campaign import estimate, load_campaign
    from bumpstop.shards import ResultFolder
    from bumpstop.text_files import running_command

    campaign = load_campaign(file)
    who, share = _workers(workers, cluster), _share(shard)
    if dry_run:
        found = estimate(campaign, workers)
        typer.echo(json.dumps(found.to_json(), indent=2) if as_json else "\n".join(found.lines()))
        return
    if not out:
        raise InputError("--out", "is missing", "wanted a folder, or --dry-run")
    folder = ResultFolder(out, campaign)
    folder.open(campaign, running_command())
    _compute(campaign, folder, who, share, as_json)


@app.command("resume")
@as_options(_OF_FOLDER)
def resume(
    folder: Folder,
    workers: NumberOfWorkers = 2,
    cluster: Cluster = "local",
    shard: Share = "1/1",
    as_json: AsJson = False,
) -> None:
    """Go on with the campaign of a folder; what is damaged is named and computed again."""
    who, share = _workers(workers, cluster), _share(shard)
    campaign, store = _opened(folder)
    _compute(campaign, store, who, share, as_json)


@app.command("merge")
@as_options(_OF_FOLDER)
def merge(folder: Folder, as_json: AsJson = False) -> None:
    """Join the shards of a folder, which must all be there."""
    campaign, store = _opened(folder)
    missing = campaign.shards - len(store.done())
    if missing:
        raise InputError(folder, f"lacks {missing} of {campaign.shards} shards", "compute them first: resume")
    with store.storage.lock(None):
        summary = store.finish(campaign.summarise)
    _print(campaign, summary, as_json)


@app.command("status")
@as_options(_OF_FOLDER)
def status(
    folder: Folder,
    check: Annotated[bool, typer.Option("--check", help="Compare every file with its checksum.")] = False,
    as_json: AsJson = False,
) -> None:
    """Say how far a campaign is; exit status 3 where damage shows."""
    from bumpstop.shards import DamagedError

    campaign, store = _opened(folder, to_read=True)
    damaged = store.damaged_settings() if check else []
    try:
        done, joined = store.done(), store.complete
        damaged += store.missing_manifest()
        damaged += _damaged(store, done) if check else []
    except DamagedError as manifest:  # without it nothing counts as done, as resume has it
        done, joined = set(), False
        damaged.append(manifest.problem)
    files = store.storage.sizes("shards") | store.storage.sizes("rows")
    found: dict[str, Any] = {
        "shards": campaign.shards,
        "done": len(done),
        "joined": joined,
        "bytes": sum(files.values()),
        "damaged": damaged if check or damaged else None,
    }
    if as_json:
        typer.echo(json.dumps(found, indent=2))
    else:
        typer.echo(
            f"{len(done)} of {campaign.shards} shards done{', joined' if joined else ''}; {found['bytes'] / 1e6:.3g} MB"
        )
        for problem in damaged:
            typer.echo(f"damaged: {problem}")
        if check and not damaged:
            typer.echo("every file is what was written")
    if damaged:
        raise typer.Exit(3)


@app.command("report")
def report(
    folder: Folder,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write the page there; default: into the folder.")
    ] = None,
) -> None:
    """Write the page of a campaign whose shards are joined."""
    from bumpstop.report.studies.campaign import write_campaign_report

    with as_options(_OF_FOLDER):
        campaign, store = _opened(folder, to_read=True)
        if not store.complete:
            raise InputError(folder, "is not joined yet", "bumpstop campaign resume, or merge")
        summary = json.loads(store.read_summary())
    if out is None and "://" in folder:
        raise InputError("--out", "is missing", "the page of a URL is written to a folder of this machine")
    typer.echo(f"report: {write_campaign_report(campaign, summary, out or Path(folder))}")


def _opened(location: str, *, to_read: bool = False) -> tuple[Campaign, ResultFolder]:
    """The campaign that a folder is of, by its settings; what another build has computed can be read alone."""
    from bumpstop.campaign import Campaign, parse_campaign
    from bumpstop.shards import ResultFolder
    from bumpstop.shards.settings_file import SETTINGS, read_made_by
    from bumpstop.shards.storage import storage_at

    storage = storage_at(location)
    try:
        content = storage.read(SETTINGS)
        text = content.decode("utf-8")
    except FileNotFoundError:
        raise InputError(location, "is no folder of a campaign: it has no settings.toml", "campaign run FILE") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{location}/{SETTINGS}", f"cannot be read ({error})", "wanted the file as written") from None
    made_by = read_made_by(content)
    if made_by and made_by.get("study") != Campaign.name:
        what = f"a study ({made_by['study']})" if "study" in made_by else "something else"
        raise InputError(location, f"is the folder of {what}, not of a campaign", "campaign run FILE")
    campaign = parse_campaign(text, f"{location}/{SETTINGS}", Path())
    if to_read:
        return campaign, ResultFolder(storage, campaign, str(made_by.get("fingerprint", "")))
    store = ResultFolder(storage, campaign)
    store.open(campaign)
    return campaign, store


def _workers(workers: int, cluster: str) -> Workers:
    from bumpstop.shards import Workers

    if cluster == "local":
        return Workers(processes=workers)
    if "://" not in cluster:
        raise InputError("--cluster", f"{cluster!r} is no address", "wanted local, or tcp://HOST:PORT")
    return Workers(cluster=cluster, tell=lambda note: typer.echo(f"note: {note}", err=True))


def _compute(campaign: Campaign, store: ResultFolder, who: Workers, share: tuple[int, int], as_json: bool) -> None:
    from bumpstop.shards.run import complete, compute_missing

    k, n = share
    begin = time.perf_counter()
    summary = None
    with store.storage.lock(None if n == 1 else f"{k}-of-{n}"), progress("campaign") as bar:
        tell = lambda done, total: bar(done / max(1, total))  # noqa: E731
        if n == 1:
            summary, account = complete(campaign, store, who, progress=tell)
        else:
            account = compute_missing(campaign, store, who, share=share, progress=tell)
    _print(campaign, summary, as_json, account, time.perf_counter() - begin)


def _print(
    campaign: Campaign,
    summary: dict[str, Any] | None,
    as_json: bool,
    account: Account | None = None,
    seconds: float = 0.0,
) -> None:
    from bumpstop.shards import to_jsonable

    done: dict[str, Any] = {}
    if account is not None:
        done = {"shards_computed": account.shards, "damaged": account.damaged, "seconds": round(seconds, 3)}
    if as_json:
        typer.echo(json.dumps(to_jsonable(summary or {}) | done, allow_nan=False, indent=2))
        return
    for problem in done.get("damaged", []):
        typer.echo(f"damaged, computed again: {problem}")
    if account is not None:
        typer.echo(f"{account.shards} shards with {account.rows} distributions computed in {seconds:.1f} s")
    if summary is not None:
        typer.echo(campaign.text(summary))


def _damaged(store: ResultFolder, done: set[int]) -> list[str]:
    from bumpstop.shards import DamagedError

    found = []
    for number in sorted(done):
        if not store.has_shard(number):
            continue
        try:
            store.get(number)
        except DamagedError as damaged:
            found.append(damaged.problem)
    return found + store.damaged_results()


def _share(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise InputError("--shard", f"{text!r} is no share", "wanted K/N with 1 <= K <= N, for example 3/8")
    return int(found[1]), int(found[2])
