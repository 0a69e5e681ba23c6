"""Campaigns: every row is its own distribution, and no cut, order or number of workers leaves a trace."""

from __future__ import annotations

import json
import os
import pickle
import random
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from bumpstop.campaign import Campaign, estimate, load_campaign
from bumpstop.campaign.numbering import Numbering
from bumpstop.shards import ResultFolder, Workers
from bumpstop.shards.run import complete, compute_missing
from campaign.cases import computed, result, small
from cli.support import REPOSITORY, run


def test_shards_cut_the_distributions_without_gap_or_overlap() -> None:
    rng = random.Random(5)
    for _ in range(50):
        costs = [rng.choice((1, 7, 60)) for _ in range(rng.randint(1, 6))]
        numbering = Numbering(rng.randint(1, 40), costs, rng.choice((5, 50, 1000)))
        seen = [
            (setup, motion)
            for shard in range(numbering.shards)
            for setup, motions in numbering.slices(shard)
            for motion in motions
        ]
        assert seen == [(setup, motion) for setup in range(len(costs)) for motion in range(numbering.motions)]
        # A shard is never dearer than it may be, but for the distribution that its end cuts.
        for shard in range(numbering.shards):
            cost = sum(costs[setup] * len(motions) for setup, motions in numbering.slices(shard))
            assert cost < numbering.shard_cost + max(costs)


def test_a_shard_has_one_distribution_at_least(campaign: Campaign) -> None:
    numbering = replace(campaign, shard_s=1e-3).numbering
    assert numbering.shards <= numbering.distributions
    assert all(any(len(motions) for _, motions in numbering.slices(shard)) for shard in range(numbering.shards))


def test_every_row_is_the_distribution_of_its_own_scenario(campaign: Campaign, whole: Path) -> None:
    rows = pl.read_parquet(whole / "rows" / "00000.parquet")
    assert rows.height == campaign.numbering.distributions == 96
    for row in rows.sample(6, seed=1).iter_rows(named=True):
        scenario = campaign.scenario_of(row["setup"])
        velocity = campaign.direction_vectors[row["direction"]] * row["speed_mm_s"]
        pose = campaign.joint_positions(row["setup"], [row["pose"]])[0]
        alone = bs.evaluate(
            scenario.with_values({"pose_rad": pose.tolist(), "motion.velocity_mm_s": velocity.tolist()})
        )
        if row["end"] == "singular_start":
            continue
        assert row["p50_N"] == pytest.approx(alone.peak_force.quantile(0.5), rel=1e-6)
        assert row["p_over_force"] == pytest.approx(alone.verdict.p_over_force, rel=1e-5, abs=1e-9)
        assert row["p_over_pressure"] == pytest.approx(alone.verdict.p_over_pressure, rel=1e-5, abs=1e-9)
        assert row["acceptable"] is alone.verdict.acceptable
    assert set(rows["robot"]) == {"sia5d", "ur10e"}
    probabilities = ["p_over_force", "p_over_pressure", "false_alarm", "undetected", "no_contact"]
    # Sums over cells, which rounding takes beyond 1 in some of the rows.
    assert rows.select(pl.all_horizontal(pl.col(probabilities).is_between(0, 1)).all()).item()
    names = [choice.name for choice in campaign.setups[rows["setup"][50]]]
    assert names == [rows[axis][50] for axis in ("robot", "tool", "body", "detector", "arm")]


def test_the_summary_is_that_of_the_rows(campaign: Campaign, whole: Path) -> None:
    rows = pl.read_parquet(whole / "rows" / "00000.parquet").filter(pl.col("end") != "singular_start")
    summary = json.loads((whole / "summary.json").read_text())
    assert summary["distributions"] == rows.height
    for group in summary["groups"]:
        own = rows.filter(*(pl.col(key) == group[key] for key in ("robot", "body", "detector", "speed_mm_s")))
        assert own.height == group["distributions"]
        assert group["p_over_force"] == pytest.approx(float(np.mean(own["p_over_force"].to_numpy())), rel=1e-14)
        assert group["acceptable_share"] == pytest.approx(own["acceptable"].to_numpy().mean())
    assert 0 < summary["acceptable_share"] < 1


def test_processes_shares_and_order_leave_no_trace(campaign: Campaign, whole: Path, tmp_path: Path) -> None:
    assert result(computed(campaign, tmp_path / "two", Workers(processes=2))) == result(whole)
    store = ResultFolder(tmp_path / "shares", campaign)
    store.open(campaign)
    for k in (3, 1, 2):
        compute_missing(campaign, store, Workers(), share=(k, 3))
    assert complete(campaign, store, Workers())[1].shards == 0
    assert result(tmp_path / "shares") == result(whole)


def test_a_url_holds_the_same(campaign: Campaign, whole: Path, tmp_path: Path) -> None:
    import fsspec

    url = "memory://bumpstop/run"
    store = ResultFolder(url, campaign)
    store.open(campaign)
    compute_missing(campaign, store, Workers(), share=(1, 2))
    assert len(store.done()) == -(-campaign.shards // 2)
    _, account = complete(campaign, store, Workers())
    assert account.shards == campaign.shards // 2
    assert {name: fsspec.filesystem("memory").cat_file(f"/bumpstop/run/{name}") for name in result(whole)} == result(
        whole
    )
    assert store.storage.sizes("shards") == {}
    assert result(computed(campaign, Path(f"{tmp_path}/plain"))) == result(whole)


def test_what_is_sent_to_a_worker_computes_the_same(campaign: Campaign) -> None:
    campaign.shard(0)
    sent = pickle.loads(pickle.dumps(campaign))
    assert sent == campaign
    assert sent.fingerprint() == campaign.fingerprint()
    assert sent.shard(1).equals(campaign.shard(1))


def test_settings_are_the_campaign_and_commands_need_the_folder_alone(whole: Path, campaign: Campaign) -> None:
    assert load_campaign(whole / "settings.toml").fingerprint() == campaign.fingerprint()
    status = run("campaign", "status", whole, "--check", "--json")
    found = json.loads(status.out)
    assert (status.status, found["done"], found["joined"], found["damaged"]) == (0, campaign.shards, True, [])
    before = result(whole)
    page = run("campaign", "report", whole)
    assert (page.status, page.err) == (0, "")
    html = (whole / "report.html").read_text(encoding="utf-8")
    assert "96 distributions" in html
    assert ">nan<" not in html
    again = run("campaign", "resume", whole, "--json")
    assert json.loads(again.out)["shards_computed"] == 0
    assert result(whole) == before


def test_files_that_a_scenario_names_do_not_make_it_another_campaign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built_in = REPOSITORY / "src" / "bumpstop" / "contact" / "data" / "bgia2011.toml"
    limits = built_in.read_text(encoding="utf-8").replace('name = "bgia2011"', 'name = "mine"')
    (tmp_path / "mine.toml").write_text(limits)
    scenario = (REPOSITORY / "examples" / "01_hand_downward.toml").read_text(encoding="utf-8")
    (tmp_path / "hand.toml").write_text(scenario.replace('"bgia2011"', '"mine.toml"'))
    (tmp_path / "sub").mkdir()
    robot = '[[robots]]\nscenario = "../hand.toml"\n'
    (tmp_path / "sub" / "c.toml").write_text(f'poses = 1\ndirections = ["down"]\nspeeds_mm_s = [50]\n{robot}')
    monkeypatch.chdir(tmp_path)
    for file in ("sub/c.toml", f"{tmp_path}/sub/../sub/c.toml"):
        out = tmp_path / f"out{len(file)}"
        ran = run("campaign", "run", file, "--out", out, "--shard", "1/1", "--workers", "1")
        assert (ran.status, ran.err) == (0, "")
        merged, resumed = run("campaign", "merge", out), run("campaign", "resume", out)
        assert (merged.status, merged.err, resumed.status, resumed.err) == (0, "", 0, "")


def test_relative_paths_of_keys_start_at_each_scenario_from_wherever_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files of one name in two folders, with other limits each."""
    built_in = REPOSITORY / "src" / "bumpstop" / "contact" / "data" / "bgia2011.toml"
    limits = built_in.read_text(encoding="utf-8").replace('name = "bgia2011"', 'name = "mine"')
    hand = 'label = "Hand/Finger"\nforce_N = '
    assert f"{hand}135" in limits
    robots = ""
    for place, limit in (("a", 110), ("b", 100)):
        (tmp_path / place).mkdir()
        (tmp_path / place / "mine.toml").write_text(limits.replace(f"{hand}135", f"{hand}{limit}"))
        shutil.copy(REPOSITORY / "examples" / "01_hand_downward.toml", tmp_path / place / "hand.toml")
        robots += f'[[robots]]\nname = "{place}"\nscenario = "{place}/hand.toml"\n'
    bodies = '[[bodies]]\nname = "mine"\nkeys = { "contact.limits" = "mine.toml" }\n'
    (tmp_path / "c.toml").write_text(f'poses = 1\ndirections = ["down"]\nspeeds_mm_s = [50]\n{robots}{bodies}')
    monkeypatch.chdir(tmp_path)
    ran = run("campaign", "run", "c.toml", "--out", "out", "--workers", "1")
    assert (ran.status, ran.err) == (0, "")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    status, resumed = run("campaign", "status", "../out", "--check"), run("campaign", "resume", "../out", "--json")
    assert (status.status, status.err, resumed.status, resumed.err) == (0, "", 0, "")
    assert json.loads(resumed.out)["shards_computed"] == 0
    again = load_campaign(tmp_path / "out" / "settings.toml")
    problems = [bs.CollisionProblem.from_scenario(again.scenario_of(setup)) for setup in (0, 1)]
    assert [problem.limits.force_N for problem in problems if problem.limits] == [110, 100]


def test_a_folder_in_use_is_refused_and_shares_accompany_each_other(campaign: Campaign, tmp_path: Path) -> None:
    store = ResultFolder(tmp_path, campaign)
    store.open(campaign)
    with store.storage.lock("1-of-2"):
        with ResultFolder(tmp_path, campaign).storage.lock("2-of-2"):
            pass
        for share in (None, "1-of-2"):
            with pytest.raises(bs.InputError, match="in use"), ResultFolder(tmp_path, campaign).storage.lock(share):
                pass
    with store.storage.lock(None):
        pass


def test_an_estimate_counts_everything(campaign: Campaign) -> None:
    found = estimate(campaign, workers=2)
    assert (found.distributions, found.shards) == (96, campaign.shards)
    assert 0 < found.seconds < 60
    assert found.seconds == pytest.approx(found.shard_s * found.shards / 2)


ROBOT = f'[[robots]]\nscenario = "{REPOSITORY}/examples/01_hand_downward.toml"\n'
REFUSED: dict[str, tuple[str, str]] = {
    "no robot": ("poses = 3\n", "robots: is missing"),
    "an unknown key": (f"pose = 3\n{ROBOT}", "pose: is no key of a campaign; did you mean 'poses'?"),
    "no poses": (f"poses = 0\n{ROBOT}", "poses: is 0; wanted a whole number from 1"),
    "a direction": (f'directions = ["dwn"]\n{ROBOT}', "directions: 'dwn' is unknown; did you mean 'down'?"),
    "no speed": (f"speeds_mm_s = []\n{ROBOT}", "speeds_mm_s: is no list of speeds"),
    "twice": (ROBOT + ROBOT, "robots.name: '01_hand_downward' is there twice"),
    "a scenario's key": (ROBOT + 'keys = { "contact.aera_cm2" = 1 }\n', "01_hand_downward: is not a key of a scenario"),
    "a scenario's folder": (f'{ROBOT}folder = "a"\n', "robots[1].folder: is that of the scenario's file; leave it out"),
    "a contact point": (
        f'{ROBOT}[[tools]]\nname = "gripper"\nkeys = {{ "contact.point_m" = [0, 0, 0.1] }}\n',
        "contact.point_m: 01_hand_downward gripper: batches are computed for contact at the tip",
    ),
    "a nameless tool": (f"{ROBOT}[[tools]]\nkeys = {{}}\n", "tools[1].name: None is no name"),
    "too many": (f"poses = 1000000000\ndirections = 100000\n{ROBOT}", "poses: make 3e+14 distributions"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_used_is_named(case: str, tmp_path: Path) -> None:
    text, message = REFUSED[case]
    (tmp_path / "c.toml").write_text(text)
    refused = run("campaign", "run", tmp_path / "c.toml", "--dry-run")
    assert (refused.status, refused.out) == (2, "")
    assert message in refused.err


OPTIONS: dict[str, tuple[tuple[Any, ...], str]] = {
    "share": (("--shard", "4/3"), "--shard: '4/3' is no share"),
    "address": (("--cluster", "nowhere"), "--cluster: 'nowhere' is no address"),
    "out": ((), "--out: is missing"),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_options_that_cannot_be_used(case: str, tmp_path: Path) -> None:
    options, message = OPTIONS[case]
    where = () if case == "out" else ("--out", tmp_path / "o")
    refused = run("campaign", "run", small(tmp_path), *where, *options)
    assert (refused.status, refused.out) == (2, "")
    assert message in refused.err
    assert not (tmp_path / "o").exists()


def test_acceptable_is_what_a_verdict_says(tmp_path: Path) -> None:
    """Also where false alarms are too many, and where they keep the arm from the body in most cases."""
    noisy = '\n[[detectors]]\nname = "noisy"\nkeys = { "detector.noise_sd_Nm" = [14, 14, 10, 4, 4, 4] }\n'
    off = '\n[[detectors]]\nname = "wrist off"\nkeys = { "detector.thresholds_Nm" = [40, 40, 30, 12, inf, inf] }\n'
    text = small(tmp_path).read_text().replace('name = "sia5d"', 'name = "ur10"', 1)
    text = text.replace("01_hand_downward", "05_ur10e") + noisy + off
    file = tmp_path / "noisy.toml"
    file.write_text(text.replace("poses = 3", "poses = 2"))
    done = computed(load_campaign(file), tmp_path / "out")
    rows = pl.read_parquet(done / "rows" / "00000.parquet").filter(pl.col("end") != "singular_start")
    found = load_campaign(file)
    said = set()
    for row in rows.filter(pl.col("detector") == "noisy").iter_rows(named=True):
        velocity = found.direction_vectors[row["direction"]] * row["speed_mm_s"]
        pose = found.joint_positions(row["setup"], [row["pose"]])[0]
        keys = {"pose_rad": pose.tolist(), "motion.velocity_mm_s": velocity.tolist()}
        verdict = bs.evaluate(found.scenario_of(row["setup"]).with_values(keys)).verdict
        assert row["acceptable"] is verdict.acceptable
        said.add((verdict.conclusion, verdict.fails_by == ("false_alarm",)))
    assert ("not_acceptable", True) in said
    # What it wrote can be read again, infinite thresholds too.
    assert run("campaign", "status", done, "--check").status == 0
    shares = json.loads((done / "summary.json").read_text())["groups"]
    limited = rows.filter(pl.col("p_over_force").is_not_nan())
    assert sum(g["acceptable_share"] * g["distributions"] for g in shares) == pytest.approx(
        limited["acceptable"].fill_null(value=False).sum()
    )


def test_ctrl_c_while_workers_begin_is_told_in_a_line(tmp_path: Path) -> None:
    """A terminal sends it to all processes; those that still import must not print how far they got."""
    command = [
        sys.executable,
        "-c",
        "from bumpstop.cli.main import main; main()",
        "campaign",
        "run",
        str(small(tmp_path)),
    ]
    command += ["--workers", "2", "--out", str(tmp_path / "out")]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        while process.poll() is None:
            begun = [Path(f"/proc/{child}") for child in children.read_text().split()]
            if any(
                "spawn_main" in (one / "cmdline").read_text() and "numpy" in (one / "maps").read_text() for one in begun
            ):
                break
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.splitlines()[-1] == "error: interrupted"
    assert "Traceback" not in err
