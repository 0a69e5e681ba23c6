"""What rows of a campaign and its summary say where there is no number."""

from __future__ import annotations

from pathlib import Path

import polars as pl

from bumpstop.campaign import load_campaign
from bumpstop.report.studies.campaign import SharesPart
from bumpstop.shards import to_jsonable
from cli.support import REPOSITORY

HAND = f'[[robots]]\nname = "hand"\nscenario = "{REPOSITORY}/examples/01_hand_downward.toml"\n'
SPRING = """
[[robots]]
name = "spring"
[robots.scenario]
robot = "sia5d"
pose_deg = [0, 30, 0, -20, 0, -40, 0]
motion = { velocity_mm_s = [0, 0, -50] }
contact = { stiffness_N_m = 75000 }
detector = { thresholds_Nm = [20, 10, 20, 20, 20, 20, 20], noise_sd_Nm = 3 }
reaction = { joint_acceleration_rad_s2 = 4.5 }
"""


def test_what_has_no_limit_is_null_and_exceeds_none(tmp_path: Path) -> None:
    """NaN would be more than any number to whoever filters the rows."""
    (tmp_path / "c.toml").write_text(f"poses = 2\nspeeds_mm_s = [50]\n{HAND}{SPRING}")
    campaign = load_campaign(tmp_path / "c.toml")
    rows = pl.concat([campaign.shard(number) for number in range(campaign.shards)])
    unlimited = rows.filter(pl.col("robot") == "spring")
    assert unlimited.height == 4
    assert unlimited.select("p_over_force", "p_over_pressure", "acceptable").null_count().row(0) == (4, 4, 4)
    assert set(rows.filter(pl.col("p_over_force") >= 0)["robot"]) == {"hand"}
    summary = to_jsonable(campaign.summarise([rows]))
    hand, spring = summary["groups"]
    assert (spring["p_over_force"], spring["acceptable_share"]) == (None, None)
    assert 0 <= hand["p_over_force"] <= 1


def test_a_largest_force_without_an_end_is_unbounded(tmp_path: Path) -> None:
    """Undetected collisions of a motion that presses on; none and unbounded are not the same."""
    keys = 'keys = { "motion.duration_s" = 0.12 }\n'
    speeds = "speeds_mm_s = [25, 50]\n"
    (tmp_path / "c.toml").write_text(f'poses = 10\ndirections = ["down"]\n{speeds}{HAND}{keys}')
    campaign = load_campaign(tmp_path / "c.toml")
    rows = pl.concat([campaign.shard(number) for number in range(campaign.shards)])
    pressing = [rows.filter((pl.col("speed_mm_s") == speed) & pl.col("p99_N").is_infinite()) for speed in (25, 50)]
    assert [some.height > 0 for some in pressing] == [True, True]
    bounded = rows.filter((pl.col("speed_mm_s") == 25) | pl.col("p99_N").is_finite())
    summary = to_jsonable(campaign.summarise([rows[:9], rows[9:]]))
    assert [group["unbounded_p99"] for group in summary["groups"]] == [some.height for some in pressing]
    assert [group["largest_p99_N"] for group in summary["groups"]] == [None, None]
    assert f"unbounded in {pressing[1].height}" in " ".join(SharesPart(summary).content())
    other = to_jsonable(campaign.summarise([bounded]))["groups"][1]
    fastest = bounded.filter(pl.col("speed_mm_s") == 50)["p99_N"].max()
    assert (other["unbounded_p99"], other["largest_p99_N"]) == (0, fastest)
    for group in summary["groups"]:
        del group["unbounded_p99"]
    assert ">unbounded<" in " ".join(SharesPart(summary).content())
