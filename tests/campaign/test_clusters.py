"""Campaigns on a scheduler of dask.distributed and its workers."""

from __future__ import annotations

import json
import pickle
from collections.abc import Iterator
from pathlib import Path

import pytest
from validation.campaign.cell import cluster

import bumpstop as bs
from bumpstop.campaign import load_campaign
from bumpstop.shards import ResultFolder, Workers
from bumpstop.shards.run import complete
from bumpstop.shards.workers import _compute_far
from cli.support import REPOSITORY, run


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with cluster(1, tmp_path_factory.mktemp("cluster")) as (found, *_):
        yield found


@pytest.fixture
def beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a campaign whose scenario names a file beside it; the command runs there, and workers do not."""
    built_in = REPOSITORY / "src" / "bumpstop" / "contact" / "data" / "bgia2011.toml"
    limits = built_in.read_text(encoding="utf-8").replace('name = "bgia2011"', 'name = "mine"')
    (tmp_path / "mine.toml").write_text(limits)
    scenario = (REPOSITORY / "examples" / "01_hand_downward.toml").read_text(encoding="utf-8")
    (tmp_path / "hand.toml").write_text(scenario.replace('"bgia2011"', '"mine.toml"'))
    robot = '[[robots]]\nscenario = "hand.toml"\n'
    (tmp_path / "c.toml").write_text(f'poses = 2\ndirections = ["down"]\nspeeds_mm_s = [50]\n{robot}')
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_workers_elsewhere_find_the_files_that_a_scenario_names(address: str, beside: Path) -> None:
    ran = run("campaign", "run", "c.toml", "--out", "far", "--cluster", address, "--json")
    assert (ran.status, ran.err) == (0, "")
    assert json.loads(ran.out)["shards_computed"] == 1
    assert run("campaign", "run", "c.toml", "--out", "near", "--workers", "1").status == 0
    rows = [(beside / out / "rows" / "00000.parquet").read_bytes() for out in ("far", "near")]
    assert rows[0] == rows[1]


def test_a_file_that_a_worker_does_not_see_is_named(beside: Path) -> None:
    """It is no lost connection, which the client takes an OSError for."""
    campaign = load_campaign("c.toml")
    folder = ResultFolder("out", campaign)
    folder.open(campaign)
    job, folder = pickle.loads(pickle.dumps((campaign, folder)))
    Path("mine.toml").rename("gone.toml")
    with pytest.raises(bs.InputError) as refused:
        _compute_far(job, folder, [0])
    assert refused.value.field == "--cluster"
    assert f"({beside}/mine.toml: No such file or directory); wanted input files" in str(refused.value)


def test_a_scheduler_without_workers_is_told_and_waited_for(beside: Path) -> None:
    campaign = load_campaign("c.toml")
    folder = ResultFolder("out", campaign)
    folder.open(campaign)
    with cluster(0, beside) as (address, scheduler, _):
        told: list[str] = []

        def tell(note: str) -> None:
            told.append(note)
            scheduler.kill()

        with pytest.raises(bs.InputError, match="is lost; what is done is kept"):
            complete(campaign, folder, Workers(cluster=address, tell=tell))
    assert told == [f"the scheduler at '{address}' has no workers: shards wait until some come"]
