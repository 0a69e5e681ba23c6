"""A small campaign, and what its folder holds."""

from __future__ import annotations

from pathlib import Path

from bumpstop.campaign import Campaign
from bumpstop.shards import ResultFolder, Workers
from bumpstop.shards.run import complete
from cli.support import REPOSITORY

EXAMPLE = REPOSITORY / "examples" / "campaign" / "two_arms.toml"


def small(folder: Path) -> Path:
    """The example with fewer poses and more shards."""
    text = EXAMPLE.read_text(encoding="utf-8").replace("../", f"{REPOSITORY}/examples/")
    file = folder / "campaign.toml"
    file.write_text(text.replace("poses = 20", "poses = 3").replace("shard_s = 0.1", "shard_s = 0.009"))
    return file


def computed(campaign: Campaign, folder: Path, workers: Workers | None = None) -> Path:
    store = ResultFolder(folder, campaign)
    store.open(campaign)
    complete(campaign, store, workers or Workers())
    return folder


def result(folder: Path) -> dict[str, bytes]:
    names = ("settings.toml", "manifest.json", "summary.json", "rows/00000.parquet")
    return {name: (folder / name).read_bytes() for name in names}
