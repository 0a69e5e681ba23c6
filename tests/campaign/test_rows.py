"""What rows of a campaign and its summary say where there is no number."""

from __future__ import annotations

from pathlib import Path

import polars as pl

from bumpstop.campaign import load_campaign
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
