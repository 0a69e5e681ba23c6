"""Plans whose shots were made: what recordings and forces become, and what limits they are held against."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.measure import calibrate_plan, load_plan, plan_measurements, write_plan
from bumpstop.measure.planning.filled_shots import read_shots, shots_text
from bumpstop.measure.planning.measured_situation import situations_of
from bumpstop.measure.planning.plan_file import COLUMNS
from measure.cells import rigid
from measure.gauge_cases import pressed, write, write_with_pressure


def test_plan_filled_by_forces_and_recordings(tmp_path: Path) -> None:
    """From the plan over a table and a recording to figures; a spoilt recording is left out and said to be."""
    plan = plan_measurements(
        [("hand", rigid())], speed_shares=[1.0], points=40, repeats=3, fixed=["contact.stiffness_N_m"]
    )
    table = write_plan(plan, tmp_path)
    time, force = pressed(noise=0.1)
    scale = plan.shots[0].predicted_N / force.max()
    write(tmp_path / "good.csv", time, scale * force)
    write(tmp_path / "bad.csv", time, np.minimum(scale * force, 50.0))
    lines = table.read_text().splitlines()
    for i, (measured, recording) in enumerate(
        [(f"{plan.shots[0].predicted_N:.2f}", ""), ("", "good.csv"), ("", "bad.csv")]
    ):
        cells = lines[i + 1].split(",")
        cells[6], cells[7] = measured, recording
        lines[i + 1] = ",".join(cells)
    table.write_text("\n".join(lines) + "\n")
    made = calibrate_plan(load_plan(tmp_path))
    assert [shot.number for shot in made.calibration.shots] == [1, 2]
    assert made.calibration.shots[1].force_N == pytest.approx(plan.shots[0].predicted_N, rel=5e-3)
    rows = [row.split(",") for row in shots_text(load_plan(tmp_path).shots, made.readings).splitlines()]
    of_recordings = (
        "lower_bound_N",
        "unusable_recording",
        "lasting_force_N",
        "pressure_N_cm2",
        "lasting_pressure_N_cm2",
    )
    assert rows[0] == [*COLUMNS[:7], *of_recordings]
    assert [row[6] != "" for row in rows[1:]] == [True, True, False]
    # Rounded down it could fall to a limit that it is above.
    (peak,) = (reading.peak_N for reading in made.readings.values() if reading.usable)
    for force in (peak, 135.001, 135.009, 135.0):
        readings = {row: replace(reading, peak_N=force) for row, reading in made.readings.items()}
        written = shots_text(load_plan(tmp_path).shots, readings).splitlines()[2].split(",")[6]
        assert 0 <= float(written) - force < 0.01
    # A peak that was cut off at 50 N is none, and no less than that.
    assert [row[7:9] for row in rows[1:]] == [["", ""], ["", ""], [rows[3][7], "bad.csv"]]
    assert float(rows[3][7]) == pytest.approx(50, abs=0.1)
    (tmp_path / "shots.csv").write_text("\n".join(",".join(row) for row in rows))
    assert read_shots(tmp_path / "shots.csv")[1].measured_N == pytest.approx(plan.shots[0].predicted_N, rel=5e-3)
    assert math.isnan(read_shots(tmp_path / "shots.csv")[2].measured_N)
    assert len(made.left_out) == 1
    assert made.left_out[0].startswith("Shot 3 is left out, its recording 'bad.csv' cannot be relied on: ")
    assert "The peak is at least 49.9" in made.left_out[0]
    assert made.calibration.forces[0].expected_N[0] == pytest.approx(plan.shots[0].predicted_N, rel=0.03)
    assert "contact.stiffness_N_m" not in made.calibration.parameters.keys


def test_what_a_gauge_is_pressed_with_goes_into_the_shots(tmp_path: Path) -> None:
    """An arm that presses on after its collision: the limit is passed by what lasts, and a later hit is none of it."""
    plan = plan_measurements([("hand", rigid(motion__velocity_mm_s=[0, 0, -50]))], speed_shares=[1.0], points=32)
    table = write_plan(plan, tmp_path)
    time, force = pressed(noise=0.1)
    force *= 90 / force.max()
    push = 160 * np.clip((time - 0.55) / 0.3, 0, 1)
    write(tmp_path / "pressing.csv", time, np.maximum(force, push))
    write(tmp_path / "hit.csv", time, np.where(time < 0.3, force, np.where(time > 0.8, 0.8 * force.max(), 0)))
    lines = [line.split(",") for line in table.read_text().splitlines()]
    for row, name in ((1, "pressing.csv"), (2, "hit.csv")):
        lines[row][7] = name
    table.write_text("\n".join(",".join(line) for line in lines) + "\n")
    made = calibrate_plan(load_plan(tmp_path))
    assert made.calibration.shots[0].force_N == pytest.approx(90, abs=1)
    assert any("1 of 2 shots press with more than the limit of 140 N" in note for note in made.calibration.notes)
    said = shots_text(load_plan(tmp_path).shots, made.readings)
    rows = list(csv.DictReader(said.splitlines()))
    assert float(rows[0]["lasting_force_N"]) == pytest.approx(160, abs=1)
    assert rows[1]["lasting_force_N"] == ""
    assert [fault.name for fault in made.readings[1].faults] == ["late"]
    assert "the gauge was pressed on" in made.readings[1].faults[0].text
    # What was read before is not lost where the shots are read again.
    (tmp_path / "shots.csv").write_text(said)
    assert shots_text(read_shots(tmp_path / "shots.csv"), {}) == said


def test_pressures_of_recordings_go_into_the_shots(tmp_path: Path) -> None:
    """Those beside a force that cannot be relied on, too, and beside one that somebody wrote into the plan."""
    plan = plan_measurements(
        [("hand", rigid(motion__velocity_mm_s=[0, 0, -50]))], speed_shares=[1.0], repeats=5, points=32
    )
    table = write_plan(plan, tmp_path)
    time, force = pressed(noise=0.1)
    force *= 90 / force.max()
    pressure = np.maximum(force, 0) * (195.001 / force.max())
    write_with_pressure(tmp_path / "high.csv", time, force, pressure)
    write_with_pressure(tmp_path / "cut.csv", time, np.minimum(force, 40.0), np.minimum(pressure, 193.0))
    write_with_pressure(tmp_path / "unit.csv", time, force, pressure, "MPa")
    lines = [f"{line}," for line in table.read_text().splitlines()]
    lines[0] += "pressure_N_cm2"
    cells = [line.split(",") for line in lines]
    for row, (measured, recording, film) in enumerate(
        (("", "high.csv", "90"), ("", "cut.csv", ""), ("", "unit.csv", ""), ("88", "", "201.5"), ("", "", "12")), 1
    ):
        cells[row][6], cells[row][7], cells[row][-1] = measured, recording, film
    table.write_text("\n".join(",".join(row) for row in cells) + "\n")
    made = calibrate_plan(load_plan(tmp_path))
    said = shots_text(load_plan(tmp_path).shots, made.readings)
    rows = list(csv.DictReader(said.splitlines()))
    assert [row["pressure_N_cm2"] for row in rows] == ["195.01", rows[1]["pressure_N_cm2"], "", "201.50", "12.00"]
    assert float(rows[1]["pressure_N_cm2"]) == pytest.approx(193, abs=0.3)
    assert [row["lasting_pressure_N_cm2"] != "" for row in rows] == [True, True, False, False, False]
    notes = made.calibration.notes
    assert "hand at 50 mm/s: 3 of 4 shots show more pressure than the limit of 190 N/cm², up to 201.5 N/cm²." in notes
    assert any(note.startswith("The pressure of shot 3 is left out: A pressure of ") for note in notes)
    (tmp_path / "shots.csv").write_text(said)
    assert shots_text(read_shots(tmp_path / "shots.csv"), {}) == said
    for bad in ("0", "-1", "inf", "high"):
        cells[1][-1] = bad
        table.write_text("\n".join(",".join(row) for row in cells) + "\n")
        with pytest.raises(InputError, match=r"row 1, pressure_N_cm2: .* cannot be used; wanted a number above zero"):
            load_plan(tmp_path)


def test_pressures_of_what_lasts_are_noted(tmp_path: Path) -> None:
    two = rigid(motion__velocity_mm_s=[0, 0, -50], verdict__clamped_limit="two_phase")
    (situation,) = situations_of([("hand", two)])
    assert (situation.pressure_limit_N_cm2, situation.lasting_pressure_limit_N_cm2) == (380, 190)
    table = write_plan(plan_measurements([("hand", two)], speed_shares=[1.0], points=32), tmp_path)
    lines = [f"{line},," for line in table.read_text().splitlines()]
    lines[0] = f"{lines[0][:-1]}pressure_N_cm2,lasting_pressure_N_cm2"
    cells = [line.split(",") for line in lines]
    cells[1][6], cells[1][-2], cells[1][-1] = "90", "300", "191"
    table.write_text("\n".join(",".join(row) for row in cells) + "\n")
    notes = calibrate_plan(load_plan(tmp_path)).calibration.notes
    said = "1 of 1 shots show more pressure than the limit of 190 N/cm² after the first 0.5 s, up to 191 N/cm²."
    assert [note for note in notes if "pressure" in note] == [f"hand at 50 mm/s: {said}"]


def test_a_recording_counts_once(tmp_path: Path) -> None:
    """Copied into another row, it was another shot, as sure as the first."""
    plan = plan_measurements([("hand", rigid())], speed_shares=[0.5, 1.0], points=32, shots=3)
    table = write_plan(plan, tmp_path)
    write(tmp_path / "a.csv", *pressed())
    lines = [line.split(",") for line in table.read_text().splitlines()]
    for row, name in ((1, "a.csv"), (3, "./a.csv")):
        lines[row][7] = name
    table.write_text("\n".join(",".join(line) for line in lines) + "\n")
    with pytest.raises(InputError, match=r"row 3, recording: './a.csv' is that of row 1; give each shot its own"):
        calibrate_plan(load_plan(tmp_path))


def test_each_phase_has_its_limit() -> None:
    """Of contact that is judged in two phases a peak has the transient one."""
    (one,), (two,) = (
        situations_of([("hand", rigid(verdict__clamped_limit=law))]) for law in ("quasi_static", "two_phase")
    )
    assert (one.limit_N, one.lasting_limit_N) == (140, 140)
    assert (two.limit_N, two.lasting_limit_N) == (280, 140)
    # Of a region that nothing may hit there is none, and the order of shots counts all situations alike.
    face = rigid(verdict__clamped_limit="two_phase", contact__body="face")
    (situation,) = situations_of([("face", face)])
    assert math.isnan(situation.limit_N)
    assert plan_measurements([("face", face), ("hand", rigid())], points=32, shots=2).spread > 0
