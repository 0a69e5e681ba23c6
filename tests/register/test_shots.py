"""Files of shots: read, and every bad cell named."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import bumpstop as bs
from bumpstop.register import RegisterError
from bumpstop.register.shots import COLUMNS, load_shots
from register.cases import EXAMPLES

SITUATIONS = bs.load_register(EXAMPLES / "sia5d_downward.csv").situations
HEAD = ",".join(COLUMNS)


def write(folder: Path, *lines: str) -> Path:
    path = folder / "shots.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_shots_planned_and_made_in_any_order_of_columns(tmp_path: Path) -> None:
    lines = [
        "hand on the table,1,50,88,80,97,84.5",
        "hand on the table,2,50,88,80,97,",
        "lower arm on the table,1,45,,,,99",
    ]
    one, two, three = load_shots(write(tmp_path, "# made on Monday", HEAD, *lines), SITUATIONS)
    assert (one.in_band, two.in_band, three.in_band) == (True, None, None)
    assert (one.measured, two.measured, three.measured) == (True, False, True)
    assert math.isnan(three.predicted_N)
    turned = [";".join(reversed(line.split(","))).replace(".", ",") for line in (HEAD, *lines)]
    assert [str(shot) for shot in load_shots(write(tmp_path, *turned), SITUATIONS)] == [
        str(s) for s in (one, two, three)
    ]


def test_every_bad_cell_is_named(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        HEAD,
        "hand on the tabel,1,50,88,80,97,84",
        "hand on the table,2,,88,97,80,much",
        "hand on the table,3,50,88,80,-1,nan",
        "hand on the table,4,50",
        "hand on the table,5,50,88,80,97,84",
    )
    with pytest.raises(RegisterError) as refused:
        load_shots(path, SITUATIONS)
    told = [str(fault).removeprefix(str(path)) for fault in refused.value.faults]
    assert [line.partition(":")[0] for line in told] == [
        " row 2, situation",
        " row 3, speed_mm_s",
        " row 3, predicted_low_N",
        " row 3, measured_peak_force_N",
        " row 4, predicted_high_N",
        " row 4, measured_peak_force_N",
        " row 5",
    ]
    assert "did you mean 'hand on the table'" in told[0]


@pytest.mark.parametrize("speed", ["0", "0.0009", "-5"])
def test_a_shot_of_an_arm_that_stands_is_refused(tmp_path: Path, speed: str) -> None:
    """Nothing can be computed to compare it with."""
    (told,) = told_of(write(tmp_path, HEAD, f"hand on the table,1,{speed},,,,134"))
    assert told == f"row 2, speed_mm_s: '{speed}' cannot be used; wanted a number from 0.001 to 100000"
    (slow,) = load_shots(write(tmp_path, HEAD, "hand on the table,1,0.001,,,,134"), SITUATIONS)
    assert slow.speed_mm_s == 0.001


def told_of(path: Path) -> list[str]:
    with pytest.raises(RegisterError) as refused:
        load_shots(path, SITUATIONS)
    return [str(fault).removeprefix(f"{path} ") for fault in refused.value.faults]


def test_a_quotation_mark_that_is_not_closed_swallows_no_shot(tmp_path: Path) -> None:
    made = 'hand on the table,{},50,88,80,97,{},"{}'
    rows = [made.format(1, 84, "see sheet 4"), made.format(2, 500, 'hit hard"'), made.format(3, 84, "")]
    told = told_of(write(tmp_path, f"{HEAD},note", *rows, "nobody,1,45,,,,99,"))
    assert [line.partition(":")[0] for line in told] == ["row 2", "row 4", "row 5, situation"]
    assert "has a cell that goes on in the next line" in told[0]


def test_a_shot_that_begins_as_a_comment_is_refused(tmp_path: Path) -> None:
    alone = ["# made on Monday, by Smith", "#,,,,,,"]
    rows = ["hand on the table,1,50,88,80,97,84", "#hand on the table,2,50,88,80,97,500"]
    (told,) = told_of(write(tmp_path, *alone, HEAD, *alone, *rows))
    assert told == (
        "row 7: begins with '#' and has a cell for each column; remove the mark, or the row: only a comment that "
        "stands alone is passed over"
    )


def test_dots_beside_decimal_commas_are_refused(tmp_path: Path) -> None:
    head = HEAD.replace(",", ";")
    rows = ["hand on the table;1;50;81,5;70;92;1.250", "hand on the table;2;50.0;81;70;92;80"]
    told = told_of(write(tmp_path, head, *rows))
    assert [line.partition(":")[0] for line in told] == ["row 2, measured_peak_force_N", "row 3, speed_mm_s"]
    assert "'1.250' has a dot, and the file has decimal commas" in told[0]
    assert load_shots(write(tmp_path, head, rows[1]), SITUATIONS)[0].speed_mm_s == 50
    assert load_shots(write(tmp_path, head, rows[0].replace(".", "")), SITUATIONS)[0].predicted_N == 81.5


@pytest.mark.parametrize(("low", "high", "missing"), [("", "92", "low"), ("70", "", "high")])
def test_half_a_band_is_refused(tmp_path: Path, low: str, high: str, missing: str) -> None:
    (told,) = told_of(write(tmp_path, HEAD, f"hand on the table,1,50,81,{low},{high},120"))
    assert told.startswith(f"row 2, predicted_{missing}_N: is missing")


def test_shots_without_a_peak_that_can_be_relied_on(tmp_path: Path) -> None:
    """The columns of ``measure calibrate`` and the recordings of a plan are read; what was made is not 'planned'."""
    head = f"{HEAD},lower_bound_N,unusable_recording,recording"
    made = "hand on the table,{},50,88,80,97,{}"
    ends = (",150.5,s.csv,", ",,s.csv,", ",,,r.csv", ",,,", "84,,,r.csv")
    rows = [made.format(number, end) for number, end in enumerate(ends, start=1)]
    shots = load_shots(write(tmp_path, head, *rows), SITUATIONS)
    assert [shot.without_peak for shot in shots] == [True, True, True, False, False]
    assert (shots[0].lower_bound_N, shots[0].unusable_recording, shots[2].recording) == (150.5, "s.csv", "r.csv")
    (told,) = told_of(write(tmp_path, head, made.format(1, "84,150,s.csv,")))
    assert told == "row 2, lower_bound_N: stands beside a measured peak; give one of the two"
    lasting = load_shots(write(tmp_path, f"{HEAD},lasting_force_N", made.format(1, "84,120.5")), SITUATIONS)
    assert lasting[0].lasting_N == 120.5
    with pytest.raises(bs.InputError, match="column recording: is there twice"):
        load_shots(write(tmp_path, f"{head},recording", made.format(1, "84,,,,")), SITUATIONS)


@pytest.mark.parametrize(
    "lines", [[], [HEAD], [HEAD.replace("shot,", ""), "a,1,1,1,1,1"], [f"{HEAD},shot", "a" + "," * 7]]
)
def test_files_that_are_none(tmp_path: Path, lines: list[str]) -> None:
    with pytest.raises(bs.InputError, match="wanted a file of shots"):
        load_shots(write(tmp_path, *lines), SITUATIONS)
