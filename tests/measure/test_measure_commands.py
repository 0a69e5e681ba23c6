"""``bumpstop measure`` from the plan to the calibrated scenario, and bad input."""

from __future__ import annotations

import csv
import json
import os
import tomllib
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.cli.main import main
from bumpstop.cli.measure.scenarios import named_scenarios
from bumpstop.text_files import to_toml
from measure.cells import RIGID
from measure.gauge_cases import pressed, write, write_with_pressure
from register.cases import write_register


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    capsys.readouterr()
    with pytest.raises(SystemExit) as ended:
        main(["measure", *arguments])
    printed = capsys.readouterr()
    assert "Traceback" not in printed.err
    return int(ended.value.code or 0), printed.out, printed.err


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    (tmp_path / "hand.toml").write_text(to_toml(RIGID))
    (tmp_path / "belly.toml").write_text(to_toml(RIGID | {"contact": {"body": "abdomen", "limits": "ts15066"}}))
    return tmp_path


def fill(table: Path, forces: list[float], *, ratio: float) -> None:
    rows = list(csv.reader(table.read_text().splitlines()))
    for row, bad in zip(rows[1:], forces, strict=False):
        row[rows[0].index("measured_peak_force_N")] = f"{ratio * bad * float(row[3]):.2f}"
    with table.open("w", newline="") as file:
        csv.writer(file).writerows(rows)


def test_one_shot_is_planned_in_one_situation(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, printed, _ = run(capsys, "plan", "hand.toml", "-o", "plan", "--points", "32", "--shots", "1")
    assert status == 0
    # No cell is folded where nobody says how wide the page is.
    assert "pad 70 Shore A (K1 276 N/mm)  " in printed.splitlines()[1]
    assert ": 1 shot in 1 situation<" in Path("plan/report.html").read_text()


def test_from_plan_to_calibrated_scenarios(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small = ("--points", "32", "--speeds", "60,100", "--shots", "8")
    status, printed, _ = run(capsys, "plan", "hand.toml", "second=belly.toml", "-o", "plan", *small)
    assert status == 0
    assert "fill in: plan/plan.csv" in printed
    assert {"plan.csv", "plan.toml", "report.html", "situations"} <= {path.name for path in Path("plan").iterdir()}
    page = Path("plan/report.html").read_text()
    assert "second" in page
    assert "<script" not in page
    fill(Path("plan/plan.csv"), [1, 1, 1, 1.9, 1, 1, 1, 1], ratio=1.12)
    status, printed, _ = run(capsys, "calibrate", "plan", "-o", "learned", "--json")
    assert status == 0
    said = json.loads(printed)
    assert [each["shot"] for each in said["bad_shots"]] == [4]
    assert said["shots"] == 8
    at_own = [force for force in said["forces"] if force["speed_mm_s"] == pytest.approx(100)]
    assert {force["situation"] for force in at_own} == {"hand", "second"}
    assert all(force["expected_N"][0] > 1.03 * force["before_N"][0] for force in at_own)
    for name in ("hand", "second"):
        data = tomllib.loads(Path(f"learned/{name}.toml").read_text())
        spread = data.pop("uncertainty")
        assert "reaction.latency_s" in spread
        assert bs.Scenario.from_dict(data).contact.body in ("hand_finger", "abdomen")
    assert "next best shot" in Path("learned/report.html").read_text().lower()
    status, _, said_wrong = run(capsys, "plan", "hand.toml", "-o", "plan", *small)
    assert status == 2
    assert said_wrong.startswith("error: plan/plan.csv: is filled in already")


def test_the_dossier_of_calibrated_situations(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Their register has the names of the plan and what its rows said; values that were learned have a new source."""
    rows = [{"name": "hand, on the table", "payload_kg": 1.5, "frequency": "often"}, {"name": "calibrated register"}]
    inputs = [
        {"key": "reaction", "status": "published", "source": "manual"},
        {"key": "detector.thresholds_Nm", "status": "assumed"},
        {"key": "contact.body", "status": "agreed", "source": "risk assessment"},
    ]
    (folder / "slow.toml").write_text(to_toml(RIGID | {"motion": {"velocity_mm_s": [0, 0, -50]}}), encoding="utf-8")
    register = {"scenario": "slow.toml", "situation": rows, "input": inputs}
    (folder / "cell.toml").write_text(to_toml(register), encoding="utf-8")
    run(capsys, "plan", "cell.toml", "-o", "plan", "--points", "32", "--speeds", "100", "--shots", "6")
    fill(Path("plan/plan.csv"), [1] * 6, ratio=1.12)
    time, force = pressed(noise=0.1)
    write(Path("plan/cut.csv"), time, np.minimum(3 * force, 180.0))
    table = Path("plan/plan.csv")
    head, first, *others = csv.reader(table.read_text().splitlines())
    first[6:8] = ["", "cut.csv"]
    with table.open("w", newline="") as file:
        csv.writer(file).writerows([head, first, *others])
    status, printed, _ = run(capsys, "calibrate", "plan", "-o", "learned")
    assert status == 0
    assert "register: learned/calibrated_register.toml\n" in printed
    assert Path("learned/calibrated_register.toml").read_text(encoding="utf-8").count("\n[[situation]]\n") == 2
    found = bs.load_register("learned/calibrated_register.toml")
    assert [one.name for one in found.situations] == [row["name"] for row in rows]
    hand = found.situations[0]
    assert (hand.payload_kg, hand.frequency) == (1.5, "often")
    assert hand.scenario.uncertainty
    told = [key for key in hand.statements if hand.statements[key].status == "identified"]
    assert told
    assert hand.statements[told[0]].source == "5 measured peak forces"
    left = {key: statement.status for key, statement in hand.statements.items() if key not in told}
    assert left.pop("detector.thresholds_Nm", "assumed") == "assumed"
    assert left == {"contact.body": "agreed"}, "the manual says nothing of what was learned"
    capsys.readouterr()
    head_of_page = ("--cell", "4", "--author", "A", "--revision", "B", "--out", "out")
    with pytest.raises(SystemExit) as ended:
        main(["report", "learned/calibrated_register.toml", "--shots", "learned/shots.csv", *head_of_page])
    assert ended.value.code == 3
    (bound,) = [
        row["lower_bound_N"]
        for row in csv.DictReader(Path("learned/shots.csv").read_text().splitlines())
        if row["lower_bound_N"]
    ]
    assert float(bound) == pytest.approx(180, abs=0.1)
    said = f"measured at least {float(bound):.15g} N, above the limit of"
    assert said in Path("out/report.html").read_text(encoding="utf-8")
    # It is written again, and nothing that somebody else wrote is written over.
    assert run(capsys, "calibrate", "plan", "-o", "learned")[0] == 0
    (folder / "mine").mkdir()
    Path("mine/calibrated_register.toml").write_text(to_toml(register), encoding="utf-8")
    status, _, wrong = run(capsys, "calibrate", "plan", "-o", "mine")
    assert status == 2
    assert "'mine/calibrated_register.toml' exists, and is no file of this command" in wrong


def test_one_scenario_into_one_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("shots.csv").write_text("situation;speed_mm_s;measured_peak_force_N\nhand;100,0;141,5\nhand;100;139\n")
    status, printed, _ = run(capsys, "calibrate", "shots.csv", "--scenario", "hand.toml", "-o", "carried.toml")
    assert status == 0
    assert "scenario: carried.toml" in printed
    assert "next best shot: hand at 100 mm/s" in printed
    assert Path("carried.toml").read_text().startswith("# Calibrated by measured peak forces.")
    status, _, wrong = run(capsys, "calibrate", "shots.csv")
    assert status == 2
    assert "row 1, situation: 'hand' has no scenario; give its scenario: --scenario FILE" in wrong


def test_a_recording_whose_pressure_is_above_the_limit_fails_the_dossier(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its force is as predicted: the dossier passed."""
    register = write_register(folder, {"name": "hand", "speed_mm_s": 50})
    run(capsys, "plan", str(register), "-o", "plan", "--points", "32", "--speeds", "100", "--shots", "2")
    head, first, *others = csv.reader(Path("plan/plan.csv").read_text().splitlines())
    first[7] = "a.csv"
    with Path("plan/plan.csv").open("w", newline="") as file:
        csv.writer(file).writerows([head, first, *others])
    time, force = pressed(noise=0.1)
    force *= float(first[3]) / force.max()
    limits = bs.evaluate_register(bs.load_register(register)).results[0].verdict.limits
    assert limits is not None
    assert limits.pressure_N_cm2 is not None
    for share, status in ((0.9, 0), (1.1, 3)):
        pressure = np.maximum(force, 0) * share * limits.pressure_N_cm2 / force.max()
        write_with_pressure(Path("plan/a.csv"), time, force, pressure)
        said = json.loads(run(capsys, "calibrate", "plan", "-o", "learned", "--json")[1])
        over = f"show more pressure than the limit of {limits.pressure_N_cm2:g} N/cm²"
        assert [over in note for note in said["notes"] if "pressure" in note] == [True] * (share > 1)
        assert (over in Path("learned/report.html").read_text(encoding="utf-8")) == (share > 1)
        assert (over in run(capsys, "calibrate", "plan")[1].replace("\n", " ")) == (share > 1)
        head_of_page = ("--cell", "4", "--author", "A", "--revision", "B", "--out", "out")
        with pytest.raises(SystemExit) as ended:
            main(["report", str(register), "--shots", "learned/shots.csv", *head_of_page])
        assert int(ended.value.code or 0) == status
        page = Path("out/report.html").read_text(encoding="utf-8")
        assert ("measured a pressure of" in page) == (share > 1)


@pytest.mark.parametrize(("out", "name"), [("hand.toml", "hand.toml"), (".", "hand.toml"), (".", "shots.csv")])
def test_a_calibration_writes_over_nothing_that_it_reads(
    folder: Path, out: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "in").mkdir()
    shots = name if name.endswith(".csv") else "in/shots.csv"
    scenario = name if name.endswith(".toml") else "in/hand.toml"
    Path(shots).write_text("situation,speed_mm_s,measured_peak_force_N\nhand,100,141.5\n")
    Path(scenario).write_text("# my remark\n" + to_toml(RIGID))
    before = Path(name).read_bytes()
    status, _, said = run(capsys, "calibrate", shots, "--scenario", f"hand={scenario}", "-o", out)
    other = "file" if out == name else "folder"
    assert (status, said) == (2, f"error: --out: {name!r} is read, and would be written over; give another {other}\n")
    assert Path(name).read_bytes() == before


def test_a_calibration_does_not_write_over_the_situations_of_its_plan(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, "plan", "hand.toml", "-o", "plan", "--points", "32", "--speeds", "100", "--shots", "1")
    name = "plan/situations/hand.toml"
    before = Path(name).read_bytes()
    status, _, said = run(capsys, "calibrate", "plan", "-o", "plan/situations")
    assert (status, said) == (2, f"error: --out: {name!r} is read, and would be written over; give another folder\n")
    assert Path(name).read_bytes() == before


def test_plan_as_json_repeats(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small = ("plan", "hand.toml", "--points", "32", "--speeds", "100", "--shots", "2", "--json")
    (status, first, _), (_, again, _) = run(capsys, *small), run(capsys, *small)
    assert status == 0
    assert first == again
    said = json.loads(first)
    assert said["situations"][0]["gauge"]["spring_N_mm"] == 75
    assert said["situations"][0]["normal"] == pytest.approx([0, 0, -1], abs=1e-9)
    assert len(said["shots"]) == 2
    other = json.loads(run(capsys, *small, "--seed", "5")[1])
    assert other["shots"][0]["predicted_peak_force_N"] == said["shots"][0]["predicted_peak_force_N"]
    assert other["spread"] != said["spread"]


def test_read(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    time, force = pressed()
    write(folder / "good.csv", time, force)
    write(folder / "bad.csv", time, np.minimum(force, 80.0))
    status, printed, _ = run(capsys, "read", "good.csv")
    assert status == 0
    assert "good.csv" in printed
    status, printed, _ = run(capsys, "read", "good.csv", "bad.csv", "-o", "page")
    assert status == 3
    assert "bad.csv: saturated (" in printed
    rows = list(csv.DictReader(Path("page/readings.csv").read_text().splitlines()))
    assert [row["usable"] for row in rows] == ["True", "False"]
    assert rows[1]["faults"].startswith("saturated:")
    assert "saturated" in Path("page/report.html").read_text()
    said = json.loads(run(capsys, "read", "good.csv", "bad.csv", "--json")[1])["recordings"]
    assert said[0]["peak_N"] == pytest.approx(float(rows[0]["peak_N"]))
    assert said[1]["faults"][0]["name"] == "saturated"


def test_read_a_recording_whose_name_is_no_text(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / os.fsdecode(b"g\xff.csv")
    write(path, *pressed())
    status, _, said = run(capsys, "read", path.name, "-o", "page")
    assert (status, said) == (0, "")
    assert r"g\udcff.csv" in Path("page/report.html").read_text(encoding="utf-8")
    assert r"g\udcff.csv" in Path("page/readings.csv").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "wrong"),
    [
        (("plan", "nothing.toml"), "error: nothing.toml: cannot be read (No such file or directory)"),
        (("plan", "hand.toml", "hand.toml"), "error: SCENARIO: 'hand' is named twice; give one of them as NAME=FILE"),
        (("plan", "hand.toml", "--gauge", "hnd"), "error: --gauge: 'hnd' is no device; did you mean 'hand'"),
        (("plan", "hand.toml", "--speeds", "fast"), "error: --speeds: 'fast' cannot be used; wanted percent"),
        (("plan", "hand.toml", "--speeds", "200"), "error: --speeds: '200' cannot be used; wanted percent"),
        (("plan", "hand.toml", "--spread", "latency"), "error: --spread: 'latency' is not KEY=SD"),
        (("plan", "hand.toml", "--spread", "latency=1"), "error: --spread: 'latency' is no key that measured forces"),
        (("plan", "hand.toml", "--gauge-error", "0"), "error: --gauge-error: is 0; wanted percent"),
        (("plan", "hand.toml", "--shots", "none"), "error: --shots: 'none' cannot be used; wanted a whole number"),
        (("read", "hand.toml"), "error: hand.toml"),
        (("read", "nothing.csv"), "error: nothing.csv: cannot be read"),
        (("read", "x.csv", "--rate", "-3"), "error: --rate: is -3; wanted a number above zero"),
        (("calibrate", "nothing"), "error: nothing: cannot be read"),
    ],
)
def test_bad_input(folder: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], wrong: str) -> None:
    status, _, printed = run(capsys, *arguments)
    assert status == 2
    assert printed.splitlines()[-1].startswith(wrong)


def test_nothing_is_measured(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("shots.csv").write_text("situation,speed_mm_s,measured_peak_force_N\nhand,100,\n")
    status, _, printed = run(capsys, "calibrate", "shots.csv", "--scenario", "hand.toml")
    assert (status, printed) == (2, "error: measured_peak_force_N: no shot is measured; fill in one row at least\n")


@pytest.mark.parametrize("name", ["plan.toml", "situations/hand.toml"])
def test_a_scenario_is_not_written_over(folder: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "situations").mkdir(exist_ok=True)
    text = "# my remark\n" + Path("hand.toml").read_text(encoding="utf-8")
    Path(name).write_text(text, encoding="utf-8")
    refused = f"error: --out: {name!r} is read, and would be written over; give another folder\n"
    for scenario in (name, f"hand={name}"):
        status, _, said = run(capsys, "plan", scenario, "-o", ".", "--points", "32", "--speeds", "100", "--shots", "1")
        assert (status, said) == (2, refused)
    assert Path(name).read_text(encoding="utf-8") == text


def test_damaged_settings(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(capsys, "plan", "hand.toml", "-o", "plan", "--points", "32", "--speeds", "100", "--shots", "1")
    settings = Path("plan/plan.toml")
    text = settings.read_text()
    for before, after, wrong in (
        ("points = 32", 'points = "many"', "error: plan/plan.toml, points: 'many' cannot be used"),
        ("points = 32", "points = ", "error: plan/plan.toml: is not valid TOML"),
        ('name = "hand"', "name = 3", "error: plan/plan.toml, situation 1, name: is missing; wanted text"),
    ):
        settings.write_text(text.replace(before, after))
        status, _, printed = run(capsys, "calibrate", "plan")
        assert status == 2
        assert printed.startswith(wrong)


def test_the_rows_of_a_register_are_situations(folder: Path) -> None:
    """Each is the scenario that its row makes, and no two situations have one name."""
    register = {"scenario": "hand.toml", "situation": [{"name": "slow", "contact.area_cm2": 2.0}, {"name": "hand"}]}
    (folder / "register.toml").write_text(to_toml(register), encoding="utf-8")
    rows = named_scenarios(["register.toml"], {}, "SCENARIO")
    assert [name for name, _ in rows] == ["slow", "hand"]
    assert rows[0][1].contact.area_cm2 == 2.0
    with pytest.raises(bs.InputError, match="SCENARIO: 'hand'"):
        named_scenarios(["register.toml", "hand.toml"], {}, "SCENARIO")
