"""``bumpstop evaluate --json``: one strict object of the documented shape, equal to what the Python API says."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

import bumpstop as bs
from cli.support import EXAMPLE, REPOSITORY, Result, evaluate, run, strict_json

SIX = ["mean", "sd", "p50", "p95", "p99", "p999"]
QUANTITIES = [
    "peak_force_N",
    "pressure_N_cm2",
    "compression_mm",
    "force_at_detection_N",
    "detection_delay_s",
    "contact_duration_s",
]
PROBABILITIES = ["multi_joint_probability", "false_alarm_probability", "undetected_probability"]
VERDICT = {
    "acceptable": bool,
    "reason": str,
    "limit_force_N": float,
    "limit_pressure_N_cm2": float,
    "p_over_force": float,
    "p_over_pressure": float,
    "false_alarm_ok": bool,
}


def check(result: Result) -> dict[str, Any]:
    """The object, after a look at its shape and at what must hold between its figures."""
    assert result.err == ""
    law = strict_json(result.out)
    for name in QUANTITIES:
        figures = law[name]
        if figures is None:
            assert name == "contact_duration_s"
            continue
        assert list(figures) == SIX
        assert all(value is None or isinstance(value, float) for value in figures.values())
        ordered = [figures[name] for name in SIX[2:]]
        known = [value for value in ordered if value is not None]
        assert ordered[: len(known)] == sorted(known), "quantiles grow, and beyond one without bound none has any"
        assert all(value >= 0 for value in known)
    for p in [*law["trigger_joint_probability"], *(law[name] for name in PROBABILITIES)]:
        assert p is None or (isinstance(p, float) and 0 <= p <= 1)
    verdict = law["verdict"]
    for name, kind in VERDICT.items():
        assert isinstance(verdict[name], kind | None)
    if verdict["acceptable"] is not None:
        over = max(verdict["p_over_force"], verdict["p_over_pressure"] or 0.0)
        assert verdict["acceptable"] == (over <= verdict["accepted_probability"] and verdict["false_alarm_ok"])
        assert verdict["p_over_force"] >= law["undetected_probability"] * (1 - 1e-9), "undetected counts as over"
    assert verdict["false_alarm_ok"] == (law["false_alarm_probability"] <= verdict["max_false_alarm"])
    assert verdict["reason"].endswith(".")
    assert law["notes"]
    assert all(isinstance(note, str) and note.endswith(".") for note in law["notes"])
    if law["law"] == "sampled":
        assert type(law["samples"]) is int
        assert type(law["seed"]) is int
    else:
        assert law["law"] == "exact"
        assert "samples" not in law
        assert "seed" not in law
    assert result.status == (3 if verdict["acceptable"] is False else 0)
    return law


def test_the_examples_have_the_documented_shape() -> None:
    found = {}
    for path in sorted((REPOSITORY / "examples").glob("*.toml")):
        law = check(evaluate(scenario=path))
        dof = 6 if "ur10e" in path.name else 7
        assert len(law["trigger_joint_probability"]) == dof
        found[path.name] = law["verdict"]["acceptable"]
    assert found["01_hand_downward.toml"] is True
    # Status 3 occurs among them, or the check above has not seen it.
    assert False in found.values()


@pytest.mark.usefixtures("unsaved_pictures")
def test_trajectories_in_every_output(tmp_path: Path) -> None:
    example = REPOSITORY / "examples" / "06_pick_and_place_trajectory.toml"
    for changes in ((), ("motion.contact_onset_s=1.4", "reaction.kind=reverse")):
        for options in ((), ("--sampled", 200)):
            law = check(evaluate(*changes, scenario=example, options=(*options, "--out", tmp_path)))
            assert any("follows a joint trajectory" in note for note in law["notes"])
            assert any("Contact begins" in note for note in law["notes"])
            assert (tmp_path / "law.parquet").stat().st_size > 0
            # The copy of the scenario finds the file from anywhere.
            again = check(evaluate(scenario=tmp_path / "settings.toml", options=options))
            assert again == law


def test_units_agree_with_one_another() -> None:
    law = check(evaluate("contact.area_cm2=2.5", "contact.peak_factor=1.5", "contact.stiffness_N_m=50000"))
    for name in SIX:
        force = law["peak_force_N"][name]
        assert law["pressure_N_cm2"][name] == pytest.approx(1.5 * force / 2.5, rel=1e-12)
        assert law["compression_mm"][name] == pytest.approx(force / 50000 * 1e3, rel=1e-12)


@pytest.mark.parametrize("sampled", [None, 300])
def test_it_is_what_the_python_interface_says(sampled: int | None) -> None:
    options = () if sampled is None else ("--sampled", sampled, "--seed", 11)
    law = bs.evaluate(bs.load_scenario(EXAMPLE), samples=sampled, seed=11)
    # Through JSON, as it knows no tuples.
    assert check(evaluate(options=options)) == json.loads(json.dumps(law.to_json()))


def test_undetected_collisions_have_no_bound() -> None:
    """The motion is over after 0.2 s; a half-normal offset of sd 0.1 s of travel lies beyond that in 4.6 %."""
    law = check(evaluate("motion.duration_s=0.2"))
    undetected = law["undetected_probability"]
    assert 0.005 < undetected < 0.05
    force = law["peak_force_N"]
    assert force["mean"] is None
    assert force["sd"] is None
    assert force["p50"] is not None
    assert force["p95"] is not None
    assert force["p999"] is None
    assert law["compression_mm"]["p999"] is None
    # Given a detection there is a figure.
    assert law["force_at_detection_N"]["p999"] is not None
    assert law["verdict"]["acceptable"] is False
    assert law["verdict"]["p_over_force"] >= undetected
    assert any("not detected within 0.2 s" in note for note in law["notes"])
    # Half-normal, 0.1 s of travel: beyond 0.2 s of it lie 4.55 %.
    assert "In 4.5 % of cases the motion ends before contact." in law["notes"]


def test_nothing_is_ever_detected() -> None:
    law = check(evaluate("detector.thresholds_Nm=[inf, inf, inf, inf, inf, inf, inf]", "motion.duration_s=1.0"))
    assert law["undetected_probability"] == pytest.approx(1, abs=1e-9)
    for name in QUANTITIES:
        assert list(law[name].values()) == [None] * 6
    assert law["trigger_joint_probability"] == [None] * 7
    assert law["multi_joint_probability"] is None
    assert law["verdict"]["p_over_force"] == pytest.approx(1, abs=1e-9)
    assert law["verdict"]["acceptable"] is False


@pytest.mark.parametrize("change", ["reaction.kind=reverse", "detector.residual=observer"])
def test_the_one_joint_that_feels_it_does_so_with_a_probability_of_one(change: str) -> None:
    """Of many shares, whose sum passes one by roundings."""
    law = check(evaluate("detector.noise_sd_Nm=0", change))
    assert law["trigger_joint_probability"] == pytest.approx([0, 1, 0, 0, 0, 0, 0], abs=1e-9)


def test_an_arm_that_stops_stays_in_contact() -> None:
    assert check(evaluate("reaction.kind=stop"))["contact_duration_s"] is None
    assert check(evaluate("reaction.kind=reverse"))["contact_duration_s"] is not None


def test_without_a_body_there_is_nothing_to_judge_by(tmp_path: Path) -> None:
    path = tmp_path / "spring.toml"
    path.write_text(EXAMPLE.read_text(encoding="utf-8").replace('body = "hand_finger"', "stiffness_N_m = 75000"))
    result = evaluate(scenario=path)
    law = check(result)
    assert result.status == 0
    verdict = law["verdict"]
    for name in ("acceptable", "limit_force_N", "limit_pressure_N_cm2", "p_over_force", "p_over_pressure"):
        assert verdict[name] is None
    assert "no limit" in verdict["reason"]
    # The hand of the table is as stiff, so the force is the same.
    assert law["peak_force_N"] == check(evaluate())["peak_force_N"]


def test_too_fast_is_status_3() -> None:
    result = evaluate("motion.velocity_mm_s=[0, 0, -100]")
    assert check(result)["verdict"]["acceptable"] is False
    assert result.status == 3


def test_false_alarms_alone_are_status_3() -> None:
    result = evaluate(
        "detector.noise_sd_Nm=[8, 4, 8, 8, 8, 8, 8]", "contact.area_cm2=10", "verdict.accepted_probability=0.9"
    )
    verdict = check(result)["verdict"]
    assert verdict["p_over_force"] <= 0.9
    assert verdict["false_alarm_ok"] is False
    assert result.status == 3
    assert "false alarm" in verdict["reason"]


def test_a_seed_names_its_runs() -> None:
    options = ("--sampled", 400, "--seed", 2**64 - 1)
    first = evaluate(options=options)
    assert check(first)["seed"] == 2**64 - 1
    assert check(first)["samples"] == 400
    assert evaluate(options=options).out == first.out
    assert evaluate(options=(*options, "--threads", 3)).out == first.out
    other = check(evaluate(options=("--sampled", 400, "--seed", 1)))
    assert other["peak_force_N"] != check(first)["peak_force_N"]


def test_too_few_runs_to_judge_by_say_so() -> None:
    """Accepted is 0.1 %: of 9999 runs fewer than ten."""
    found = check(evaluate(options=("--sampled", 2000)))
    (note,) = [note for note in found["notes"] if "too few" in note]
    assert note in found["verdict"]["warnings"]
    assert note == (
        "2000 sampled collisions are too few to judge by: a probability of the accepted 0.1 % is some 2 of them."
    )
    assert f"warning: {note}" in " ".join(run("evaluate", EXAMPLE, "--sampled", 2000).out.split())
    for samples, risk in ((10_000, "1e-3"), (1000, "0.01")):
        options = (
            "--sampled",
            samples,
            "--set",
            f"verdict.accepted_probability={risk}",
            "--set",
            f"verdict.max_false_alarm={risk}",
        )
        assert not any("too few" in note for note in check(evaluate(options=options))["notes"])


def test_one_run_is_a_law_too() -> None:
    law = check(evaluate(options=("--sampled", 1)))
    assert law["peak_force_N"]["sd"] == 0
    assert law["peak_force_N"]["p50"] == law["peak_force_N"]["mean"]


def test_set_is_as_good_as_an_editor(tmp_path: Path) -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    edited = text.replace('"hand_finger"', '"lower_arm_wrist"').replace("[0, 0, -50]", "[0, 50, 0]")
    edited = edited.replace("held_joints = [7]", 'held_joints = [7]\nstart = "rest"') + "[simulation]\nsubsteps = 4\n"
    assert tomllib.loads(edited) != tomllib.loads(text)
    path = tmp_path / "edited.toml"
    path.write_text(edited, encoding="utf-8")
    result = evaluate(
        "contact.body=lower_arm_wrist",  # a bare string
        "motion.velocity_mm_s=[0, 99, 0]",
        " motion . start = 'rest' ",
        "simulation.substeps=4  # in a table the file has not",
        "motion.velocity_mm_s=[0, 50, 0]",  # the last one counts
    )
    assert check(result)
    assert evaluate(scenario=path).out == result.out


def test_nothing_else_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    check(evaluate())
    assert list(tmp_path.iterdir()) == []


def test_the_words_for_people_agree() -> None:
    found = check(evaluate())
    result = run("evaluate", EXAMPLE)
    assert result.status == 0
    assert result.err == ""
    lines = result.out.splitlines()
    assert lines[0] == "Yaskawa Motoman SIA5D at 50 mm/s against Hand/Finger (bgia2011)"
    assert lines[1].startswith(" ACCEPTABLE ")
    row = next(line for line in lines if line.startswith("peak force, N"))
    assert [float(cell) for cell in row.split()[3:9]] == [float(f"{found['peak_force_N'][name]:.4g}") for name in SIX]
    bad = run("evaluate", EXAMPLE, "--set", "motion.velocity_mm_s=[0, 0, -100]")
    assert bad.status == 3
    assert bad.out.splitlines()[1].startswith(" NOT ACCEPTABLE ")


def test_a_table_without_bounds_still_fits_the_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    unmonitored = run("evaluate", EXAMPLE, "--set", "detector.thresholds_Nm=[inf, inf, inf, inf, inf, inf, inf]")
    assert unmonitored.status == 3
    rows = [
        line.split()
        for line in unmonitored.out.splitlines()
        if line.startswith(("peak force, N", "force at detection, N"))
    ]
    assert rows == [
        ["peak", "force,", "N", *["inf"] * 6, "135", "1.0000"],
        ["force", "at", "detection,", "N", *["none"] * 6],
    ]
