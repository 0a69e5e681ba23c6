"""``bumpstop require``: what its exit status and its lines say of alarms before contact."""

from __future__ import annotations

from pathlib import Path

import pytest

from cli.support import EXAMPLE, run, strict_json

SPEED = ("require", EXAMPLE, "--vary", "motion.speed")


def test_a_trade_curve_without_a_point_free_of_alarms_is_not_acceptable() -> None:
    """Of one point by itself the command says so, too."""
    noisy = run(*SPEED, "--set", "detector.thresholds_Nm=[2, 1, 2, 2, 2, 2, 2]")
    assert noisy.status == 3
    assert "Alarms before contact" in noisy.out
    curve = run(*SPEED, "--vary", "detector.thresholds=1:2:2")
    assert curve.status == 3
    assert curve.out.count("; alarms before contact 9") == 2
    # One point that is acceptable is an answer.
    curve = run(*SPEED, "--vary", "detector.thresholds=[2, 12]")
    assert curve.status == 0
    assert [("alarms" in line) for line in curve.out.splitlines()] == [False, True, False]


def test_thresholds_are_told_joint_by_joint() -> None:
    """The value is the lowest of them: nobody may take it for that of all."""
    scenario = ("--set", "detector.thresholds_Nm=[20, 10, 40, 20, 20, inf, 20]")
    printed = run("require", EXAMPLE, "--vary", "detector.thresholds", *scenario).out
    (line,) = [line for line in printed.splitlines() if line.startswith("that is the lowest threshold; by joint ")]
    by_joint = [
        float(each)
        for each in line.removeprefix("that is the lowest threshold; by joint ").removesuffix(" Nm").split(", ")
    ]
    value = strict_json(run("require", EXAMPLE, "--vary", "detector.thresholds", *scenario, "--json").out)["value"]
    assert by_joint == pytest.approx([factor * value for factor in (2, 1, 4, 2, 2, float("inf"), 2)], rel=1e-5)
    for factor, status in ((1.0, 0), (1.01, 3)):
        wanted = ", ".join(f"{factor * each:.6f}" for each in by_joint)
        assert run("evaluate", EXAMPLE, "--set", f"detector.thresholds_Nm=[{wanted}]").status == status
    curve = run("require", EXAMPLE, "--vary", "motion.speed", "--vary", "detector.thresholds=10:20:2").out
    assert "lowest threshold [Nm]" in curve


def test_a_risk_is_either_given_or_varied() -> None:
    result = run(*SPEED, "--vary", "verdict.accepted_probability=0.001:0.1:2", "--risk", "0.01")
    assert (result.status, result.out) == (2, "")
    assert result.err.startswith("error: --risk: would replace the risk that is varied")
    rows = strict_json(run(*SPEED, "--vary", "verdict.accepted_probability=0.001:0.1:2", "--json").out)["curve"]
    assert [row["risk"] for row in rows] == pytest.approx([0.001, 0.1])
    assert rows[0]["value"] < rows[1]["value"]


def test_a_value_beyond_uncertain_figures_is_told_and_inconclusive(tmp_path: Path) -> None:
    path = tmp_path / "uncertain.toml"
    figures = '"motion.speed_mm_s" = { distribution = "uniform", low = 39, high = 41 }'
    text = (EXAMPLE.parent / "07_hand_uncertain.toml").read_text(encoding="utf-8")
    path.write_text(f"{text.partition('[uncertainty]')[0]}[uncertainty]\n{figures}\n", encoding="utf-8")
    found = run("require", path, "--vary", "motion.speed=10:200", "--json")
    told = strict_json(found.out)
    assert [value["word"] for value in told.values() if isinstance(value, dict) and "word" in value] == ["INCONCLUSIVE"]


@pytest.mark.parametrize("vary", ["detector.thresholds", "contact.padding", "reaction.joint_acceleration_rad_s2"])
def test_of_a_trajectory_the_motion_is_refused_and_not_its_speed(vary: str) -> None:
    found = run("require", EXAMPLE.parent / "06_pick_and_place_trajectory.toml", "--vary", vary)
    assert found.status == 2
    assert found.err.startswith("error: motion.kind: 'trajectory' has no requirements: they are found along straight")
