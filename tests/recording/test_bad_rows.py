"""Bad rows: found, located, counted, never let through."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bumpstop import InputError, Robot
from bumpstop.model import Joint
from bumpstop.recording import Recording
from bumpstop.recording.checks.checks import gaps_of
from bumpstop.recording.checks.jumps import impossible_rows
from bumpstop.recording.checks.time_order import disorder
from recording.cases import COLUMNS, lines, recording, written


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("0.50,0.1,0.2", "wrong field count"),
        ("0.50,0.1", "wrong field count"),
        ("0.50,0.1,0.2,ok,more", "wrong field count"),
        ("0.50,x,0.2,ok", "not a number"),
        ("0.50,,0.2,ok", "not a number"),
        ("0.50,nan,0.2,ok", "not a number"),
        ("0.50,inf,0.2,ok", "not finite"),
        ("0.50,0.1,1e306,ok", "impossible value"),
        ("0.50,0.1,-1e306,ok", "impossible value"),
        ("1e306,0.1,0.2,ok", "impossible value"),
        ("-1e306,0.1,0.2,ok", "impossible value"),
        ("0.49,0.1,0.2,ok", "doubled time"),
        ("0.30001,0.1,0.2,ok", "time runs backwards"),
        ("1.50001,0.1,0.2,ok", "time runs backwards"),
    ],
)
def test_bad_row_is_dropped_counted_and_located(line: str, reason: str, tmp_path: Path) -> None:
    text = lines()
    text[50] = line
    found = Recording.load(written(tmp_path, text), columns=COLUMNS)
    assert found.t.size == 199
    assert found.report.rows_read == 200
    assert found.report.counts == {reason: 1}
    ((row, why),) = found.report.dropped
    assert row == 51
    assert why.startswith(reason)
    assert np.abs(found.q).max() <= 1


def test_words_before_the_first_row_are_no_bad_rows(tmp_path: Path) -> None:
    text = lines()
    text[50] = "0.50,0.1"
    found = Recording.load(written(tmp_path, ["# Recorded on a Monday, by hand", "", *text]), columns=COLUMNS)
    assert found.report.rows_read == 200
    ((row, _),) = found.report.dropped
    assert row == 53
    assert found.t.size == 199


@pytest.mark.parametrize("size", [1, 7, 64])
def test_fields_are_counted_across_the_pieces_of_a_text(
    size: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = lines()
    text[3], text[40], text[41], text[70] = "0.03,0.1", "", "0.41,0.1,0.2,ok,", "0.70,0.1,0.2,ok,,"
    path = written(tmp_path, text)
    whole = Recording.load(path, columns=COLUMNS, max_bad=0.1)
    assert whole.report.rows_read == 199
    assert [row for row, _ in whole.report.dropped] == [4, 42, 71]
    monkeypatch.setattr("bumpstop.recording.formats.csv._AT_ONCE", size)
    found = Recording.load(path, columns=COLUMNS, max_bad=0.1)
    assert found.report == whole.report
    assert (found.q == whole.q).all()


@pytest.mark.parametrize("change", ["blanks", "quotes", "returns", "mark", "comments", "no end"])
def test_the_same_numbers_however_a_text_is_written(change: str, tmp_path: Path) -> None:
    text = ["t,q_1,q_2", *(f"{0.01 * i!r},{0.1 * i!r},{-0.2 * i!r}" for i in range(50))]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(text) + "\n")
    plain = Recording.load(path)
    body = {
        "blanks": "\n".join(line.replace(",", " , ") for line in text) + "\n",
        "quotes": "\n".join('"' + line.replace(",", '","') + '"' for line in text) + "\n",
        "returns": "\r\n".join(text) + "\r\n",
        "mark": "\ufeff" + "\n".join(text) + "\n",
        "comments": "# by a logger\n\n" + "\n".join(text) + "\n",
        "no end": "\n".join(text),
    }[change]
    path.write_bytes(body.encode())
    found = Recording.load(path)
    assert found.report.rows_dropped == 0
    assert (found.t == plain.t).all()
    assert (found.q == plain.q).all()


@pytest.mark.parametrize("line", ["{0}.5,1 2,3", "{0}.5,1  2,3", "{0},5 1,2 3,4"])
def test_two_numbers_never_become_one(line: str, tmp_path: Path) -> None:
    """Decimal commas between blanks look like columns between commas: 5 and 1 must not be read as 51."""
    path = written(tmp_path, [line.format(i) for i in range(20)])
    with pytest.raises(InputError, match="not a number: q_1 = nan"):
        Recording.load(path, columns=COLUMNS)


@pytest.mark.parametrize("mark", [";", "\t"])
def test_decimal_commas_may_begin_late(mark: str, tmp_path: Path) -> None:
    """An arm that stands still writes whole numbers, over more lines than a reader would look at to find out."""
    resting = [f"{i};0;0" for i in range(3000)]
    rows = ["t;q_1;q_2", *resting, "3000;0,25;-1,5", "3000,5;0,5;1"]
    path = written(tmp_path, [row.replace(";", mark) for row in rows])
    found = Recording.load(path, max_bad=0)
    assert found.t.size == 3002
    assert found.t[-1] == 3000.5
    assert found.q[-2:].tolist() == [[0.25, -1.5], [0.5, 1.0]]


def test_too_many_bad_rows_are_refused(tmp_path: Path) -> None:
    text = lines()
    for i in (3, 5, 7):
        text[i] = "garbage"
    path = written(tmp_path, text)
    with pytest.raises(InputError, match=r"3 of 200 rows are bad \(1.5 %\): line 4 .*at most 1 % may be"):
        Recording.load(path, columns=COLUMNS)
    assert Recording.load(path, columns=COLUMNS, max_bad=0.02).report.rows_dropped == 3


def test_first_twenty_are_listed(tmp_path: Path) -> None:
    text = lines()
    for i in range(10, 60):
        text[i] = "0,0"
    report = Recording.load(written(tmp_path, text), columns=COLUMNS, max_bad=0.5).report
    assert [row for row, _ in report.dropped] == list(range(11, 31))
    assert report.rows_dropped == 50
    assert report.gaps == ((pytest.approx(0.09), pytest.approx(0.51)),)


@pytest.mark.parametrize(("intervals", "gaps"), [(2.99, 0), (3.01, 1)])
def test_a_gap_is_longer_than_three_median_intervals(intervals: float, gaps: int) -> None:
    t = 0.01 * np.arange(100.0)
    t[50:] += (intervals - 1) * 0.01
    found = gaps_of(t)
    assert len(found) == gaps
    for start, length in found:
        assert (start, length) == (pytest.approx(0.49), pytest.approx(0.01 * intervals))


def test_time_stands_still(tmp_path: Path) -> None:
    text = [f"1.0,{i},0,ok" for i in range(20)]
    with pytest.raises(InputError, match="time stands still"):
        Recording.load(written(tmp_path, text), columns=COLUMNS)


@pytest.mark.parametrize("text", ["", "\n", "t,q_1\n"])
def test_empty(text: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"is empty|has no row of data"):
        Recording.load(path)


def test_degrees_for_radians(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    robot = Robot.load("panda")
    middle = np.degrees((robot.lower + robot.upper) / 2)
    t = np.arange(100) * 0.01
    degrees = Recording(t=t, q=middle + 60 * np.sin(t)[:, None] + np.linspace(0, 40, 100)[:, None])
    degrees.save(path)
    assert any("degrees" in note for note in Recording.load(path).report.notes)
    most = Recording(t=t, q=np.full((100, 7), 90.0) + np.sin(t)[:, None])
    most.save(path)
    with pytest.raises(InputError, match="degrees taken for radians"):
        Recording.load(path, robot=robot)
    columns = {
        "time": {"column": "t"},
        "position": {"columns": [f"q_{j}" for j in range(1, 8)], "unit": "deg"},
    }
    assert Recording.load(path, robot=robot, columns=columns).q[0, 0] == pytest.approx(np.pi / 2)


def test_millimetres_for_metres(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    joints = (
        Joint(name="x", link="carriage", kind="prismatic", lower=0.0, upper=2.0, velocity=1.0),
        Joint(name="c", link="wrist", lower=-3.0, upper=3.0, velocity=2.0),
    )
    t = np.arange(100) * 0.01
    q = np.column_stack([1000 + 500 * np.sin(t), np.cos(t)])
    Recording(t=t, q=q).save(path)
    hint = r'millimetres taken for metres; position = \{ ..., unit = \["mm", "rad"\] \} in the column file'
    with pytest.raises(InputError, match=hint):
        Recording.load(path, robot=Robot(name="gantry", joints=joints))
    # Of a robot that only slides one unit is that of all.
    Recording(t=t, q=q[:, :1]).save(path)
    with pytest.raises(InputError, match=r'millimetres taken for metres; .* unit = "mm" \}'):
        Recording.load(path, robot=Robot(name="rail", joints=joints[:1]))


def test_milliseconds_and_milliamperes_are_suspected(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    t, wave = np.arange(200) * 0.01, np.sin(np.arange(200) * 0.1)[:, None]
    Recording(t=t, q=wave, current=2 * wave).save(path)
    assert Recording.load(path).report.notes == ()
    Recording(t=1000 * t, q=wave, current=2000 * wave).save(path)
    slow, large = Recording.load(path).report.notes
    assert slow.startswith("Rows are 10 s apart")
    assert 'unit = "ms"' in slow
    assert large.startswith("Currents reach 2000 A")
    assert 'unit = "mA"' in large


def test_a_name_that_stands_twice_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, ["t,q_1,q_1,other,other", *(f"{0.1 * i},1,2,3,4" for i in range(9))])
    with pytest.raises(InputError, match="has 2 columns 'q_1'"):
        Recording.load(path)
    with pytest.raises(InputError, match="has 2 columns 'other'"):
        Recording.load(path, columns={"time": {"column": "t"}, "position": {"columns": ["other"]}})
    assert Recording.load(path, columns={"time": {"column": 1}, "position": {"columns": [2, 3]}}).q[0].tolist() == [
        1,
        2,
    ]


@pytest.mark.parametrize("value", [40.0, -40.0])
def test_robot_tells_what_is_impossible(value: float, tmp_path: Path) -> None:
    q = np.zeros((300, 7))
    q[7, 2] = value
    Recording(t=np.arange(300.0), q=q).save(tmp_path / "run.parquet")
    assert Recording.load(tmp_path / "run.parquet").report.rows_dropped == 0
    report = Recording.load(tmp_path / "run.parquet", robot=Robot.load("panda")).report
    assert report.dropped == ((8, f"impossible value: q_3 = {value:g}"),)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.integers(0, 30), max_size=40))
def test_fewest_rows_are_dropped_for_order(times: list[int]) -> None:
    t = np.array(times, dtype=float)
    doubled, backwards = disorder(t)
    kept = np.delete(t, np.concatenate([doubled, backwards]))
    assert (np.diff(kept) > 0).all()
    assert all(t[i] in t[:i] for i in doubled)
    # By brute force: a longest rising chain through what is left without doubles.
    left = np.delete(t, doubled)
    best = [0] * left.size
    for i in range(left.size):
        best[i] = 1 + max((best[j] for j in range(i) if left[j] < left[i]), default=0)
    assert kept.size == max(best, default=0)


def test_uneven_time_is_kept() -> None:
    steps = np.random.default_rng(1).uniform(0.005, 0.015, 999)
    t = np.concatenate([[0], np.cumsum(steps)])
    found = Recording(t=t, q=np.zeros((1000, 1)))
    assert found.duration == pytest.approx(steps.sum())
    assert 90 < found.rate_hz < 110


def test_between() -> None:
    whole = recording()
    part = whole.between(0.5, 1.0)
    assert part.t[0] == pytest.approx(0.5)
    assert part.t[-1] == pytest.approx(1.0)
    assert part.tau is not None
    assert part.tau.shape == (51, 2)
    with pytest.raises(InputError, match="fewer than 2 rows"):
        whole.between(5, 6)


@pytest.mark.parametrize("field", ["t", "q", "qd", "tau"])
def test_nothing_unusable_enters_by_hand(field: str) -> None:
    good = {"t": np.arange(3.0), "q": np.zeros((3, 2)), "qd": np.zeros((3, 2)), "tau": np.zeros((3, 2))}
    broken = {**good, field: np.full_like(good[field], np.nan)}
    with pytest.raises(InputError, match=field):
        Recording(**broken)


@pytest.mark.parametrize(("interval", "told"), [(0.0999, True), (0.1001, False)])
def test_positions_behind_a_gap_of_a_tenth_of_a_second_are_no_leap(interval: float, told: bool) -> None:
    """Ten median intervals of 5 ms are less: the tenth of a second decides."""
    assert leaps_after(interval, 0.005) is told


@pytest.mark.parametrize(("intervals", "told"), [(9.99, True), (10.01, False)])
def test_nor_are_those_behind_ten_median_intervals(intervals: float, told: bool) -> None:
    assert leaps_after(intervals * 0.02, 0.02) is told


def leaps_after(interval: float, period: float) -> bool:
    """Whether positions that leap by 100 rad over an interval are told."""
    t = period * np.arange(100.0)
    t[50:] += interval - period
    q = np.zeros((100, 2))
    q[50:] = 100.0
    dropped, leaps = impossible_rows(t, q, np.ones(2), np.zeros(2, dtype=bool))
    return bool(leaps.any() or dropped.any())


@pytest.mark.parametrize("above", [["Robot log v2", "Date: 2024-01-01", ""], ["Program: A, B, C"]])
def test_lines_above_the_header_may_be_comments(above: list[str], tmp_path: Path) -> None:
    """The refusal told numbers of columns, and not what would help."""
    rows = ["t,q_1", *(f"{0.01 * i:.2f},{0.1 * i:.3f}" for i in range(50))]
    with pytest.raises(InputError, match=r"line 1 names 3 columns, most rows have \d; .*delete or begin with #"):
        Recording.load(written(tmp_path, [*above, *rows]))
    path = written(tmp_path, [*(f"#{line}" for line in above), *rows])
    assert Recording.load(path).t.size == 50
    # As a spreadsheet writes a line of text.
    wide = [",".join(["t", *(f"q_{j}" for j in range(1, 7))]), *(",".join([f"{0.01 * i:.2f}"] * 7) for i in range(50))]
    with pytest.raises(InputError, match="or delete what stands above the names of the columns"):
        Recording.load(written(tmp_path, ["Robot log" + 6 * ",", *wide]))


@pytest.mark.parametrize("mark", [".", ","])
def test_marks_of_thousands_are_no_decimal_marks(mark: str, tmp_path: Path) -> None:
    """Of currents in mA 1.012 beside 987 were 1.012 and 987: the largest were the smallest, without a word."""
    path = tmp_path / "log.csv"
    t, other = 0.01 * np.arange(300), "," if mark == "." else "."

    def write(currents: list[str]) -> None:
        rows = (f"{time:.3f};{position:.4f}".replace(".", other) for time, position in zip(t, np.sin(t), strict=True))
        rows = (f"{row};{current}" for row, current in zip(rows, currents, strict=True))
        path.write_text("t;q_1;current_1\n" + "\n".join(rows) + "\n")

    sizes = 1010 + 100 * np.sin(9 * t)
    write([f"{size:,.0f}".replace(",", mark) for size in sizes])
    with pytest.raises(InputError, match=rf"column 'current_1' has 1\{mark}\d\d\d: is that a mark of thousands"):
        Recording.load(path)
    write([f"{size:.0f}" for size in sizes])
    np.testing.assert_allclose(Recording.load(path).current[:, 0], sizes, atol=0.51)
    # Three digits behind the mark may well be decimal ones.
    write([f"{size / 1000:.3f}".replace(".", other) for size in sizes])
    np.testing.assert_allclose(Recording.load(path).current[:, 0], sizes / 1000, atol=0.00051)
    write([f"{size:,.2f}".replace(",", "_").replace(".", other).replace("_", mark) for size in sizes])
    with pytest.raises(InputError, match="is that a mark of thousands"):
        Recording.load(path)


@pytest.mark.parametrize("channel", ["qd", "current", "tau"])
def test_a_channel_that_is_always_zero_is_refused(channel: str, tmp_path: Path) -> None:
    """As of a simulated driver without efforts: it ended in an internal fault."""
    t = 0.01 * np.arange(300)
    q = np.sin(t[:, None] + np.arange(6))
    given = {channel: np.zeros_like(q)}
    Recording(t=t, q=q, **given).save(tmp_path / "log.parquet")
    with pytest.raises(InputError, match=r"300 of 300 rows are bad.*row of zeros: all .* while the arm moves"):
        Recording.load(tmp_path / "log.parquet")
