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


@pytest.mark.parametrize(
    "lines", [[], [HEAD], [HEAD.replace("shot,", ""), "a,1,1,1,1,1"], [f"{HEAD},shot", "a" + "," * 7]]
)
def test_files_that_are_none(tmp_path: Path, lines: list[str]) -> None:
    with pytest.raises(bs.InputError, match="wanted a file of shots"):
        load_shots(write(tmp_path, *lines), SITUATIONS)
