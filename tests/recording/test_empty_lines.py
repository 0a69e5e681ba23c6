"""Empty lines are no samples: they move neither the clock nor the rows of another file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bumpstop.recording import Recording
from cli.support import run
from recording.cases import COLUMNS, workbook

ROWS = 300
T = 0.01 * np.arange(ROWS)
Q = np.column_stack([np.sin(T), np.cos(T)])
CURRENT = np.column_stack([2 * np.sin(3 * T), np.cos(3 * T)])
# What Python's csv.writer leaves on Windows without newline="", a line written out by hand, and a file without any.
SCATTERED = {"none": (), "every": range(ROWS), "first": (0,), "one": (120,), "blank": (7, 120)}


def table(path: Path, columns: np.ndarray, kind: str, torn: int | None = None) -> Path:
    """A file of numbers, text or Excel, with empty lines before the rows of that kind."""
    rows: list[list[str | float | None]] = [[float(x) for x in row] for row in columns]
    if torn is not None:
        rows[torn] = ["torn"]
    before = set(SCATTERED[kind])
    if path.suffix == ".xlsx":
        sheet = [line for i, row in enumerate(rows) for line in ([[], row] if i in before else [row])]
        return workbook(path, sheet)
    text = [",".join(map(str, row)) for row in rows]
    if kind == "every":
        path.write_bytes(("\r\n" + "\r\r\n".join(text) + "\r\r\n").encode())
    else:
        empty = " \t\n" if kind == "blank" else "\n"
        path.write_text("".join((empty if i in before else "") + line + "\n" for i, line in enumerate(text)))
    return path


@pytest.fixture(params=["csv", "xlsx"])
def ending(request: pytest.FixtureRequest) -> str:
    if request.param == "xlsx":
        pytest.importorskip("fastexcel")
    return str(request.param)


@pytest.mark.parametrize("kind", SCATTERED)
def test_a_rate_counts_rows_that_hold_something(kind: str, ending: str, tmp_path: Path) -> None:
    """An unreadable row was a sample, and keeps its place."""
    path = table(tmp_path / f"run.{ending}", np.column_stack([T, Q]), kind, torn=200)
    columns = COLUMNS | {"time": {"rate_hz": 250}}
    found = Recording.load(path, columns=columns)
    np.testing.assert_allclose(found.t, np.delete(np.arange(ROWS), 200) / 250, rtol=0, atol=1e-12)
    assert found.rate_hz == pytest.approx(250)
    # Its message still has its number in the file.
    assert [row for row, _ in found.report.dropped] == [201 + sum(i <= 200 for i in SCATTERED[kind])]
    (tmp_path / "c.toml").write_text(
        "header = false\ntime = { rate_hz = 250 }\nposition = { columns = [2, 3] }\n", encoding="utf-8"
    )
    assert "median rate 250 Hz" in run("recording", "info", path, "--columns", tmp_path / "c.toml").out


@pytest.mark.parametrize("kind", SCATTERED)
@pytest.mark.parametrize("other", SCATTERED)
def test_rows_of_two_files_are_paired_by_their_order(kind: str, other: str, ending: str, tmp_path: Path) -> None:
    """A row torn in either is left out, under its number in the file of the positions."""
    path = table(tmp_path / f"run.{ending}", np.column_stack([T, Q]), kind, torn=50)
    table(tmp_path / f"current.{ending}", CURRENT, other, torn=200)
    current = {"columns": [1, 2], "file": str(tmp_path / f"current.{ending}")}
    found = Recording.load(path, columns=COLUMNS | {"current": current})
    kept = np.delete(np.arange(ROWS), [50, 200])
    np.testing.assert_allclose(found.t, T[kept], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.q, Q[kept], rtol=0, atol=1e-9)
    assert found.current is not None
    np.testing.assert_allclose(found.current, CURRENT[kept], rtol=0, atol=1e-9)
    places = [row + 1 + sum(i <= row for i in SCATTERED[kind]) for row in (50, 200)]
    assert [row for row, _ in found.report.dropped] == places
