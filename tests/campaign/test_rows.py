"""What rows of a campaign and its summary say where there is no number."""

from __future__ import annotations

from pathlib import Path

import polars as pl

import bumpstop as bs
from bumpstop.campaign import load_campaign
from bumpstop.campaign.campaign_summary import NAMES, summary_lines
from bumpstop.model import Robot
from bumpstop.model.urdf.writer import write_urdf
from bumpstop.report.studies.campaign import SharesPart
from bumpstop.report.studies.study import StudyNotesPart
from bumpstop.shards import to_jsonable
from cli.support import REPOSITORY
from model.urdf_cases import scaled

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


def test_what_stands_beside_the_verdict_of_the_nearest_row_is_a_note(tmp_path: Path) -> None:
    """Coarse steps make a force too low, and a share of acceptable poses too high."""
    coarse = 'keys = { "simulation.step_s" = 0.004, "simulation.substeps" = 1, "contact.body" = "lower_arm_wrist" }\n'
    (tmp_path / "c.toml").write_text(f"poses = 8\nspeeds_mm_s = [100, 250]\nseed = 3\n{HAND}{coarse}")
    campaign = load_campaign(tmp_path / "c.toml")
    rows = pl.concat([campaign.shard(number) for number in range(campaign.shards)])
    nearest = rows.filter(pl.col("acceptable") & pl.col("p999_N").is_finite()).sort("p999_N").row(-1, named=True)
    scenario = campaign.scenario_of(0).with_values(
        {
            "pose_rad": campaign.joint_positions(0, [nearest["pose"]])[0].tolist(),
            "motion.velocity_mm_s": (campaign.direction_vectors[nearest["direction"]] * nearest["speed_mm_s"]).tolist(),
        }
    )
    warnings = bs.evaluate(scenario).warnings
    assert any("finer" in warning or "step_s" in warning for warning in warnings)
    summary = campaign.summarise([rows[:5], rows[5:]])
    which = f"hand, pose {nearest['pose']}, direction {nearest['direction']} at {nearest['speed_mm_s']:g} mm/s"
    assert [note for note in summary["notes"] if note.startswith(which)] == [f"{which}: {each}" for each in warnings]
    assert summary == campaign.summarise([rows])
    assert "".join(StudyNotesPart(summary["notes"]).content()).count(which) == len(warnings)
    # Nothing is said beside what is not acceptable anyway.
    refused = campaign.summarise([rows.with_columns(acceptable=pl.lit(value=False))])
    assert "notes" not in refused


def test_a_share_that_is_nearly_all_is_not_all() -> None:
    """Forty of a million poses that are not acceptable are not none of them."""
    group = dict.fromkeys(NAMES, "any") | {"speed_mm_s": 50.0, "distributions": 10**6, "singular_starts": 0}
    group |= {"p_over_force": 1e-5, "p_over_pressure": None, "undetected": 0.0, "largest_p99_N": 90.0}
    for share, said in ((0.99996, "99.996 %"), (1.0, "100 %"), (4e-5, "0.004 %"), (0.0, "0 %")):
        summary = {"distributions": 10**6, "singular_starts": 0, "groups": [group | {"acceptable_share": share}]}
        assert f" {said} acceptable" in "\n".join(summary_lines(summary))
        assert f">{said}<" in " ".join(SharesPart(summary).content())


def test_a_robot_in_millimetres_is_a_note(tmp_path: Path) -> None:
    write_urdf(scaled(Robot.load("ur10e"), 1e3), tmp_path / "a.urdf")
    arm = f'robot = "{tmp_path}/a.urdf"\npose_deg = [0, -90, 90, 0, 90, 0]'
    text = SPRING.replace('robot = "sia5d"\npose_deg = [0, 30, 0, -20, 0, -40, 0]', arm)
    text = text.replace("20, 10, 20, 20, 20, 20, 20", "20, 10, 20, 20, 20, 20")
    (tmp_path / "c.toml").write_text(f"poses = 1\nspeeds_mm_s = [50]\n{text}")
    summary = load_campaign(tmp_path / "c.toml").summarise([])
    assert any(note.startswith("spring: The lengths of") for note in summary["notes"])


def test_what_a_choice_sets_is_not_assumed(tmp_path: Path) -> None:
    """Each setup is asked, not the scenario that it starts from."""
    assumed = 'assumed = ["contact.stiffness_N_m", "reaction.joint_acceleration_rad_s2"]\n'
    spring = SPRING.replace("reaction =", f"{assumed}reaction =")
    body = '[[bodies]]\nname = "{}"\nkeys = {{ contact.stiffness_N_m = {} }}\n'
    bodies = body.format("soft", 60000) + body.format("stiff", 600000)
    (tmp_path / "c.toml").write_text(f"poses = 1\nspeeds_mm_s = [50]\n{spring}{bodies}")
    (note,) = load_campaign(tmp_path / "c.toml").summarise([])["notes"]
    assert note.startswith("spring: reaction.joint_acceleration_rad_s2 is ASSUMED")
    bodies += '[[bodies]]\nname = "given"\n'
    (tmp_path / "c.toml").write_text(f"poses = 1\nspeeds_mm_s = [50]\n{spring}{bodies}")
    measured, given = load_campaign(tmp_path / "c.toml").summarise([])["notes"]
    assert measured.startswith("spring soft and one more answer: reaction.joint_acceleration_rad_s2 is ASSUMED")
    assert given.startswith("spring given: contact.stiffness_N_m, reaction.joint_acceleration_rad_s2 are ASSUMED")
