"""``bumpstop evaluate`` as a user calls it: refusals, JSON, files, exit statuses."""

from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest

import bumpstop as bs
from bumpstop.cli.main import main

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "01_hand_downward.toml"


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main([str(argument) for argument in arguments])
    out = capsys.readouterr()
    return int(stop.value.code or 0), out.out, out.err


REFUSALS = {
    "contact.stiffness=3": "contact.stiffness",
    "motion.velocity_mm_s=[0, 0]": "motion.velocity_mm_s",
    "motion.velocity_mm_s=[0, 0, 0]": "motion.velocity_mm_s",
    "motion.velocity_mm_s=[0, 0, nan]": "motion.velocity_mm_s",
    "motion.velocity_mm_s=fast": "motion.velocity_mm_s",
    "contact.stiffness_N_m=-5": "contact.stiffness_N_m",
    "contact.area_cm2=0": "contact.area_cm2",
    "contact.body=hand_fingr": "hand_finger",
    "contact.body=abdomen": "abdomen",
    "contact.peak_factor=0.5": "contact.peak_factor",
    "contact.kind=free": "contact.kind",
    "detector.noise_sd_Nm=-1": "detector.noise_sd_Nm",
    "detector.noise_sd_Nm=[1, 2]": "detector.noise_sd_Nm",
    "detector.thresholds_Nm=[0, 1, 1, 1, 1, 1, 1]": "detector.thresholds_Nm",
    "detector.thresholds_Nm=[1, 1, 1]": "detector.thresholds_Nm",
    "detector.thresholds_Nm=[1, 1, nan, 1, 1, 1, 1]": "detector.thresholds_Nm",
    "detector.feedback_period_s=0": "detector.feedback_period_s",
    "detector.feedback_period_s=0.0035": "detector.feedback_period_s",
    "detector.residual=observer": "detector.residual",
    "reaction.joint_acceleration_rad_s2=0": "reaction.joint_acceleration_rad_s2",
    "robot=sia5": "sia5d",
    "pose_deg=[0, 30, 0, -20, 0, -40]": "pose_deg",
    "pose_deg=[0, 130, 0, -20, 0, -40, 0]": "joint 2",
    "pose_deg=[0, 0, 0, 0, 0, 0, 0]": "singular",
    "motion.held_joints=[8]": "motion.held_joints",
    "motion.held_joints=[6, 7]": "motion.task",
    "verdict.risk=2": "verdict.risk",
    "simulation.substeps=0": "simulation.substeps",
    "reaction=3": "reaction",
}


@pytest.mark.parametrize("change", list(REFUSALS))
def test_refused_by_name(change: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = run(capsys, "evaluate", EXAMPLE, "--set", change)
    last = err.strip().splitlines()[-1]
    assert status == 2
    assert out == ""
    assert last.startswith("error: ")
    assert REFUSALS[change] in last
    assert "Traceback" not in err


@pytest.mark.parametrize("missing", ["robot", "pose_deg", "[detector]", "thresholds_Nm", "velocity_mm_s", "[reaction]"])
def test_missing_key_or_table(missing: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = EXAMPLE.read_text().splitlines()
    if missing.startswith("["):
        begin = lines.index(missing)
        end = next((i for i in range(begin + 1, len(lines)) if lines[i].startswith("[")), len(lines))
        kept = lines[:begin] + lines[end:]
    else:
        kept = [line for line in lines if not line.startswith(missing)]
    path = tmp_path / "scenario.toml"
    path.write_text("\n".join(kept))
    status, _, err = run(capsys, "evaluate", path)
    assert status == 2
    assert err.startswith("error: ")
    assert missing.strip("[]") in err
    assert "missing" in err


def test_files_that_cannot_be_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    damaged, binary = tmp_path / "damaged.toml", tmp_path / "binary.toml"
    damaged.write_text("robot = \n")
    binary.write_bytes(b"\xff\xfe\x00")
    for path in (tmp_path / "absent.toml", tmp_path, damaged, binary):
        status, _, err = run(capsys, "evaluate", path)
        assert status == 2
        assert str(path) in err
    occupied = tmp_path / "file"
    occupied.write_text("")
    status, _, err = run(capsys, "evaluate", EXAMPLE, "--out", occupied / "below")
    assert status == 2
    assert "--out" in err


def test_json_is_the_law(capsys: pytest.CaptureFixture[str]) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    status, out, _ = run(capsys, "evaluate", EXAMPLE, "--json")
    found = json.loads(out, parse_constant=refuse)
    assert status == 0
    assert found == json.loads(json.dumps(bs.evaluate(bs.load_scenario(EXAMPLE)).to_json()))
    assert found["law"] == "exact"
    assert set(found["peak_force_N"]) == {"mean", "sd", "p50", "p95", "p99", "p999"}
    assert found["verdict"]["limit_force_source"]
    assert found["verdict"]["limit_force_status"]


def test_status_3_when_not_acceptable_and_null_without_limits(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "evaluate", EXAMPLE, "--json", "--set", "motion.velocity_mm_s=[0, 0, -100]")
    assert status == 3
    assert json.loads(out)["verdict"]["acceptable"] is False
    scenario = bs.load_scenario(EXAMPLE).to_dict()
    del scenario["contact"]["body"]
    scenario["contact"]["stiffness_N_m"] = 5600.0
    law = bs.evaluate(bs.Scenario.from_dict(scenario))
    assert law.verdict.acceptable is None


def test_files_of_out_repeat_the_evaluation(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("--sampled", 500, "--seed", 3, "--json")
    status, first, _ = run(capsys, "evaluate", EXAMPLE, *arguments, "--out", tmp_path)
    assert status == 0
    table = pl.read_parquet(tmp_path / "law.parquet")
    assert table.height == 500
    assert {"offset_m", "peak_force_N", "noise_at_detection_2_Nm", "condition_number_at_detection"} <= set(
        table.columns
    )
    assert table["peak_force_N"].mean() == pytest.approx(json.loads(first)["peak_force_N"]["mean"])
    assert (tmp_path / "report.html").stat().st_size > 50_000
    assert list(tmp_path.glob("*.png"))
    assert len(list(tmp_path.glob("*.png"))) == len(list(tmp_path.glob("*.svg")))
    _, again, _ = run(capsys, "evaluate", tmp_path / "settings.toml", *arguments)
    assert again == first


def test_set_takes_toml_or_a_bare_string(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "evaluate", EXAMPLE, "--json", "--set", "contact.body=lower_arm_wrist")
    assert status == 0
    assert json.loads(out)["verdict"]["limit_force_N"] == 160
    for bad in ("contact.area_cm2", "=3", "contact..x=1", "robot.name=3"):
        status, _, err = run(capsys, "evaluate", EXAMPLE, "--set", bad)
        assert status == 2
        assert err.startswith("error: ")


def test_listings(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "robots")
    assert status == 0
    assert "sia5d" in out
    assert "ur10e" in out
    status, out, _ = run(capsys, "bodies", "--limits", "ts15066")
    assert status == 0
    assert "hand_finger" in out
    status, _, err = run(capsys, "bodies", "--limits", "ts15065")
    assert status == 2
    assert "ts15066" in err
    assert run(capsys, "frobnicate")[0] == 2
    assert run(capsys, "evaluate", EXAMPLE, "--sampled", "0")[0] == 2
