"""Cells of devices and people: decimal marks, thousands marks, and rows that are longer than the header."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.measure.planning.filled_shots import read_shots
from bumpstop.measure.reading.gauge_reading import GaugeReading, read_gauge
from bumpstop.measure.reading.text_table import read_text_table
from measure.gauge_cases import pressed


def _numbers(path: Path, text: str, column: int = -1) -> list[float]:
    path.write_text(text, encoding="utf-8")
    table = read_text_table(path, "wanted a table")
    return table.numbers(range(len(table.names))[column])


NAN = math.nan


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a;b\n0,5;150\n1,5;1.962\n", [150, 1962]),
        ("a;b\n0,5;150\n1,5;-1.962,30\n", [150, -1962.3]),
        ("a;b\n0.5;150\n1.5;1,962\n", [150, 1962]),
        ("a;b\n0.5;150\n1.5;1,962,300.5\n", [150, 1962300.5]),
        ('a,b\n0.5,150\n1.5,"1,962"\n', [150, 1962]),
        ("a;b\n0,5;999\n1,5;1.000\n", [999, 1000]),
        ("a;b\n5;999\n6;1.000\n", [999, 1000]),
        ("a;b\n5;999\n6;1,000\n", [999, 1000]),
        # As many digits in each cell: no thousands marks.
        ("a;b\n5;12.345\n6;98.123\n", [12.345, 98.123]),
        ("a;b\n5;12,345\n6;98,123\n", [12.345, 98.123]),
        ("a;b\n0.5;1.962\n1.5;12.500\n", [1.962, 12.5]),
        ("a;b\n0,5;1,962\n1,5;12,500\n", [1.962, 12.5]),
        ("a;b\n0,5;0,125\n1,5;1,962\n", [0.125, 1.962]),
        # A column has its own mark.
        ("a;b\n0.001;9,84\n1.002;1,962\n", [9.84, 1.962]),
        ("a;b\n5;98,4\n6;97.5\n7;1e3\n8;1.5e-2\n", [98.4, 97.5, 1000, 0.015]),
        ("a;b\n5;1 962,3\n6;12 345 678\n7;1'000\n", [1962.3, 12345678, 1000]),
        # The minus sign of typesetting: without it the rows below zero are missing, and with them half of the noise.
        ("a;b\n0,5;\u22120,3\n1,5;0,2\n2,5;\u2212\n", [-0.3, 0.2, NAN]),
        ("a;b\n5;1.2.3\n6;1,2,3\n7;12:00\n8;\n9;1.23,4\n10;7\n", [NAN, NAN, NAN, NAN, NAN, 7]),
    ],
)
def test_decimal_and_thousands_marks(tmp_path: Path, text: str, expected: list[float]) -> None:
    assert _numbers(tmp_path / "t.csv", text) == pytest.approx(expected, rel=1e-15, nan_ok=True)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16", "utf-16-be"])
def test_texts_of_devices(tmp_path: Path, encoding: str) -> None:
    path, text = tmp_path / "t.csv", "Prüfstelle;Zeit [µs];Größe\nGreifer;0,5;1\nMüller;1,5;2\n"
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    path.write_bytes((mark + text).encode(encoding))
    table = read_text_table(path, "wanted a table")
    assert list(table.names) == ["Prüfstelle", "Zeit [µs]", "Größe"]
    assert table.numbers(1) == [0.5, 1.5]


def test_half_a_character_of_utf_16(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_bytes("a;b\n1;2\n".encode("utf-16")[:-1])
    with pytest.raises(InputError, match="is not UTF-16 text"):
        read_text_table(path, "wanted a table")


def test_a_column_before_others_with_commas_keeps_its_points(tmp_path: Path) -> None:
    assert _numbers(tmp_path / "t.csv", "a;b\n0.001;9,84\n1.002;1,962\n", 0) == [0.001, 1.002]


@pytest.mark.parametrize(("first", "second"), [("0,5", "1.962"), ("0.5", "1,962")])
def test_marks_that_cannot_be_told_are_refused(tmp_path: Path, first: str, second: str) -> None:
    said = f"t.csv, column 'b': '{second}' may be 1962 or have a decimal mark; wanted one decimal mark in all columns"
    with pytest.raises(InputError, match=said):
        _numbers(tmp_path / "t.csv", f"a;b\n{first};{second}\n{first};{second}\n")


def _german(path: Path, header: str, separator: str, every: int = 1) -> GaugeReading:
    """A recording with decimal commas in every nth row."""
    _, force = pressed(rate=1000.0)
    rows = [
        f"{at}{separator}{value:.2f}".replace(".", "," if at % every == 0 else ".")
        for at, value in enumerate(force.tolist())
    ]
    path.write_text("\n".join([header, *rows]) + "\n")
    return read_gauge(path)


@pytest.mark.parametrize("header", ["Zeit [ms],Kraft [N]", "Zeit [ms],Kraft [daN]", "Zeit [ms],Kraft [N],"])
def test_decimal_commas_between_commas_are_refused(tmp_path: Path, header: str) -> None:
    said = "row 1: has 3 cells under 2 columns; wanted one cell for each column; numbers with decimal commas need semi"
    with pytest.raises(InputError, match=said):
        _german(tmp_path / "cut.csv", header, ",")
    assert _german(tmp_path / "whole.csv", header.replace(",", ";"), ";").usable


def test_a_few_long_rows_are_dropped_and_counted(tmp_path: Path) -> None:
    reading = _german(tmp_path / "few.csv", "Zeit [ms],Kraft [N]", ",", every=100)
    assert {fault.name: fault.count for fault in reading.faults} == {"unreadable": 13}


def test_remarks_beyond_the_header_and_separators_at_the_end_cost_nothing(tmp_path: Path) -> None:
    _, force = pressed(rate=1000.0)
    rows = [f"{at},{value:.2f},{'trigger' if at == 50 else ''}" for at, value in enumerate(force.tolist())]
    path = tmp_path / "remarks.csv"
    path.write_text("\n".join(["Zeit [ms],Kraft [N]", *rows]) + "\n")
    assert read_gauge(path).faults == ()


def test_a_quotation_mark_that_is_not_closed_swallows_no_rows(tmp_path: Path) -> None:
    """Here all rows from before the collision on; names of columns may go on in the next line."""
    _, force = pressed(rate=1000.0)
    rows = [f"{at},{value:.2f}," for at, value in enumerate(force.tolist())]
    path, header = tmp_path / "remarks.csv", '"Time\n[ms]","Force\n[N]",Remark'
    path.write_text("\n".join([header, *rows]) + "\n")
    assert read_gauge(path).faults == ()
    path.write_text("\n".join([header, *rows[:50], f'{rows[50]}"warm', *rows[51:]]) + "\n")
    with pytest.raises(InputError, match="row 51: has a quotation mark that is not closed, in '50,"):
        read_gauge(path)


def test_thousands_of_milliseconds_and_newtons(tmp_path: Path) -> None:
    """The time goes from 999 to 1.000, the force beyond 1.000."""
    _, force = pressed(rate=1000.0)
    whole, path = np.round(20 * force), tmp_path / "t.csv"
    rows = [f"{at:,d}{';'}{value:,.0f}" for at, value in enumerate(whole.tolist())]
    for text in ("\n".join(rows), "\n".join(rows).replace(",", ".")):
        path.write_text(f"Zeit [ms];Kraft [N]\n{text}\n")
        reading = read_gauge(path)
        assert reading.sampled_peak_N == pytest.approx(whole.max(), abs=10)
        assert reading.rate_hz == pytest.approx(1000)
        assert "unreadable" not in {fault.name for fault in reading.faults}


PLAN = "situation,shot,speed_mm_s,measured_peak_force_N,recording,remark\n"


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("a,1,250,98,4,,\n", "row 2: has 7 cells under 6 columns; wanted one cell"),
        ("a,1,250,98,4\n", "row 2, recording: '4' stands beside a force of 98 N; wanted a file, and decimal points"),
        ("a,1,250,98.4,,wet, cold\n", "row 2: has 7 cells under 6 columns"),
    ],
)
def test_decimal_commas_typed_into_a_plan_are_refused(tmp_path: Path, row: str, said: str) -> None:
    path = tmp_path / "plan.csv"
    path.write_text(PLAN + "b,2,250,97.1,,\n" + row)
    with pytest.raises(InputError, match=said):
        read_shots(path)
    path.write_text(PLAN.replace(",", ";") + "a;1;250;98,4;;\nb;2;250;1.097,5;;wet, cold\n")
    assert [shot.measured_N for shot in read_shots(path)] == [98.4, 1097.5]


@pytest.mark.parametrize("separator", [";", ",", "\t"])
@pytest.mark.parametrize(
    "above",
    [
        ["Serial number;12345"],
        ["Fmax [N];98.4"],
        ["12345"],
        ["12345;"],
        ["Serial;12345", "Spring constant [N/mm];75", "Range;500"],
        ["Device;XY", "Date;27.11.2026", "Shore;70"],
        ["Limits;140;280;N"],
        [],
    ],
)
def test_lines_with_a_number_above_the_header_are_no_rows(tmp_path: Path, above: list[str], separator: str) -> None:
    time, force = pressed(rate=1000.0)
    rows = [f"{t:.4f};{f:.3f}" for t, f in zip(time.tolist(), force.tolist(), strict=True)]
    path = tmp_path / "t.csv"
    for begin in (rows, ["-0.0510;OVER", *rows], ["-0.0510;", *rows]):
        text = "\n".join([*above, "Time [s];Force [N]", *begin]) + "\n"
        path.write_text(text.replace(";", separator))
        reading = read_gauge(path)
        assert reading.curve.columns == ("Time [s]", "Force [N]", "")
        assert reading.curve.time.size == time.size
        assert reading.curve.unreadable == len(begin) - len(rows)


@pytest.mark.parametrize(
    "above",
    [
        "time;force\n[ms];[kgf]",
        "time;force\nms;daN",
        "time;force\n[msec];[kp]",
        "time;force;temperature\n[ms];[lbf];[C]",
        "time;force;temperature;humidity\n[ms];[N];[C];[%]",
    ],
)
def test_every_unit_is_known_in_a_line_of_its_own(tmp_path: Path, above: str) -> None:
    """Also beside units of something else."""
    _, force = pressed(rate=1000.0)
    more = ";21" * (above.split("\n")[0].count(";") - 1)
    path = tmp_path / "t.csv"
    path.write_text("\n".join([above, *(f"{at};{value:.3f}{more}" for at, value in enumerate(force.tolist()))]) + "\n")
    reading = read_gauge(path)
    assert reading.rate_hz == pytest.approx(1000)
    newtons = {"kgf": 9.80665, "kp": 9.80665, "daN": 10.0, "lbf": 4.4482216152605, "N": 1.0}
    (unit,) = (unit for unit in newtons if unit in above.replace("[", ";").replace("]", ";").split("\n")[1].split(";"))
    assert reading.sampled_peak_N == pytest.approx(newtons[unit] * force.max(), rel=0.02)


@pytest.mark.parametrize("separator", [",", "\t", ";"])
@pytest.mark.parametrize("other", [",", "\t", ";"])
def test_lines_above_have_any_separator(tmp_path: Path, other: str, separator: str) -> None:
    _, force = pressed(rate=1000.0)
    rows = [f"{at}{separator}{value:.2f}" for at, value in enumerate(force.tolist())]
    path = tmp_path / "t.csv"
    path.write_text("\n".join([f"Device{other}XY", f"time [ms]{separator}force [N]", *rows]) + "\n")
    assert read_gauge(path).faults == ()
    # A line below lacks it.
    path.write_text("\n".join([f"time [ms]{separator}force [N]", *rows, "end"]) + "\n")
    assert {fault.name for fault in read_gauge(path).faults} == {"unreadable"}
