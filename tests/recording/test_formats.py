"""Every format, there and back, and what is refused."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from bumpstop import InputError, Robot
from bumpstop.cli.detection.residuals import holds_residuals
from bumpstop.detection import ResidualSeries
from bumpstop.recording import Recording
from recording.cases import COLUMNS, JOINTS, lines, recording, workbook, written


@pytest.mark.parametrize("ending", [".parquet", ".csv", ".mcap"])
def test_there_and_back(ending: str, tmp_path: Path) -> None:
    # Neither letters nor what elsewhere is a pattern mean anything in the name of a file.
    path = tmp_path / f"run [1] *\u00e9{ending}"
    before = recording()
    before.save(path)
    after = Recording.load(path)
    np.testing.assert_allclose(after.t, before.t, rtol=0, atol=1e-9)
    fields = ("q", "qd", "tau") if ending == ".mcap" else ("q", "qd", "current", "tau", "q_ref", "wrench")
    for field in fields:
        np.testing.assert_array_equal(getattr(after, field), getattr(before, field))
    assert after.joint_names == (() if ending == ".csv" else JOINTS)
    assert after.robot == ("arm" if ending == ".parquet" else "")
    assert after.report.rows_dropped == 0
    assert after.report.notes == ()


@pytest.mark.parametrize("separator", [",", ";", "\t", "  "])
@pytest.mark.parametrize("header", [True, False])
def test_separators_and_headers(separator: str, header: bool, tmp_path: Path) -> None:
    text = [separator.join(line.split(",")[:3]) for line in lines(50)]
    if separator == ";":
        text = [line.replace(".", ",") for line in text]
    path = written(tmp_path, [separator.join(("t", "q_1", "q_2")), *text] if header else text)
    found = Recording.load(path, columns=None if header else COLUMNS)
    assert found.q.shape == (50, 2)
    np.testing.assert_allclose(found.q[:, 0], np.sin(0.01 * np.arange(50)), atol=1e-8)


def test_windows_lines_comments_and_blank_lines(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(b"\xef\xbb\xbf# made by a logger\r\nt,q_1\r\n0,1\r\n\r\n1,2 \r\n2,3\r\n")
    found = Recording.load(path)
    assert found.q[:, 0].tolist() == [1, 2, 3]
    assert found.report.rows_read == 3
    path.write_text("# t q_1\n0 1\n1 2\n")
    assert Recording.load(path).q[:, 0].tolist() == [1, 2]


def test_a_line_that_tells_spreadsheets_the_separator_is_no_header(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("sep=;\nt;q_1\n0,0;1,5\n1,0;2,5\n")
    assert Recording.load(path).q[:, 0].tolist() == [1.5, 2.5]
    # Without names the line is none of them, though it has as many fields as the rows.
    path.write_text('"sep=;"\n0,0;1,5\n1,0;2,5\n')
    assert Recording.load(path, columns=COLUMNS | {"position": {"columns": [2]}}).q[:, 0].tolist() == [1.5, 2.5]


def test_a_last_line_without_an_end_is_a_row_too(tmp_path: Path) -> None:
    """Also where some lines are left out."""
    path = tmp_path / "run.csv"
    for text, times in (("t,q_1\n0,1\n1,2\n2,3", [0, 1, 2]), ("t,q_1\n0,1\n1,2,5\n2,3\n3,4", [0, 2, 3])):
        path.write_text(text)
        found = Recording.load(path, max_bad=0.5)
        assert found.t.tolist() == times
        assert found.q[:, 0].tolist() == [time + 1 for time in times]


def test_quantities_in_two_files_are_joined_row_by_row(tmp_path: Path) -> None:
    text = lines()
    text[20] = "short"
    path = written(tmp_path, text)
    other = [f"{i},{i}" for i in range(200)]
    other[40] = "short"
    (tmp_path / "current.csv").write_text("\n".join(["c_1,c_2", *other]) + "\n")
    current = {"columns": ["c_1", "c_2"], "file": "current.csv"}
    found = Recording.load(path, columns=COLUMNS | {"current": current})
    assert found.current is not None
    np.testing.assert_allclose(found.current[:, 0], 100 * found.t, atol=1e-9)
    assert [row for row, _ in found.report.dropped] == [21, 41]


def test_a_payload_that_a_controller_was_told_of_is_said(tmp_path: Path) -> None:
    names = ["timestamp", "actual_q_0", "actual_q_1", "payload", *(f"payload_cog_{axis}" for axis in range(3))]
    for payloads, said in (
        ((1.07, 1.07), "payload of 1.07 kg: --payload 1.07,0,0,0.058"),
        ((1.07, 2.0), "payload that changes"),
        ((0.0, 0.0), None),
    ):
        rows = [f"{0.01 * i},0.1,0.2,{payloads[i >= 30]},0,0,0.058" for i in range(60)]
        notes = Recording.load(written(tmp_path, [",".join(names), *rows])).report.notes
        assert [note for note in notes if "payload" in note] == [
            note for note in notes if said is not None and said in note
        ]
        assert any("payload" in note for note in notes) == (said is not None)
    # Most files say nothing of it.
    silent = Recording.load(written(tmp_path, [",".join(names[:3]), *(f"{0.01 * i},0.1,0.2" for i in range(60))]))
    assert silent.t.size == 60
    assert not any("payload" in note for note in silent.report.notes)


def test_rate_stands_for_a_time_column(tmp_path: Path) -> None:
    found = Recording.load(written(tmp_path, lines()), columns=COLUMNS | {"time": {"rate_hz": 500}})
    assert found.rate_hz == pytest.approx(500)


@pytest.mark.parametrize("turned", [False, True])
def test_matlab(turned: bool, tmp_path: Path) -> None:
    before = recording()
    q = np.degrees(before.q)
    scipy.io.savemat(tmp_path / "run.mat", {"rec": {"time": before.t, "q": q.T if turned else q}})
    columns = {"time": {"variable": "rec.time"}, "position": {"variable": "rec.q", "unit": "deg"}}
    found = Recording.load(tmp_path / "run.mat", columns=columns)
    np.testing.assert_allclose(found.q, before.q, atol=1e-12)
    columns["position"]["variable"] = "rec.p"
    with pytest.raises(InputError, match=r"there is no 'rec.p'; did you mean 'rec.q'"):
        Recording.load(tmp_path / "run.mat", columns=columns)


def shuffled(names: tuple[str, ...]) -> tuple[Recording, list[int]]:
    """A recording with a driver's order of the joints, and where each joint of the robot stands in it."""
    order = sorted(names)
    return replace(recording(dof=len(names)), joint_names=tuple(order)), [order.index(name) for name in names]


def test_names_of_a_file_put_joints_into_the_robots_order(tmp_path: Path) -> None:
    """As in a bag: what is converted without a robot has the driver's order."""
    robot = Robot.load("ur10e")
    own = tuple(joint.name for joint in robot.joints)
    before, place = shuffled(own)
    before.save(tmp_path / "run.parquet")
    found = Recording.load(tmp_path / "run.parquet", robot=robot)
    assert found.joint_names == own
    for name in ("q", "qd", "current", "tau"):
        np.testing.assert_array_equal(getattr(found, name), getattr(before, name)[:, place])
    np.testing.assert_array_equal(found.wrench, before.wrench)
    before.save(tmp_path / "run.csv")
    columns = {
        "time": {"column": "t"},
        "position": {"columns": [f"q_{i + 1}" for i in range(6)]},
        "joint_names": list(before.joint_names),
    }
    np.testing.assert_array_equal(Recording.load(tmp_path / "run.csv", columns=columns, robot=robot).q, found.q)
    with pytest.raises(InputError, match=r"columns.joint_names: 2 of them; the positions have 6"):
        Recording.load(tmp_path / "run.csv", columns=columns | {"joint_names": ["a", "b"]})


def test_other_names_are_told(tmp_path: Path) -> None:
    robot = Robot.load("ur10e")
    recording(dof=6).save(tmp_path / "run.parquet")
    assert any(
        "calls the joints j0, j1" in note for note in Recording.load(tmp_path / "run.parquet", robot=robot).report.notes
    )


def test_columns_chosen_keep_the_names_of_their_joints(tmp_path: Path) -> None:
    robot = Robot.load("ur10e")
    own = tuple(joint.name for joint in robot.joints)
    before, place = shuffled(own)
    path = tmp_path / "run.parquet"
    before.save(path)
    columns = {
        "time": {"column": "t"},
        "position": {"columns": [f"q_{i + 1}" for i in range(6)]},
        "torque": {"columns": [f"tau_{i + 1}" for i in range(6)]},
    }
    found = Recording.load(path, columns=columns, robot=robot)
    np.testing.assert_array_equal(found.q, before.q[:, place])
    assert found.tau is not None
    assert before.tau is not None
    np.testing.assert_array_equal(found.tau, before.tau[:, place])
    columns["position"]["columns"] = ["q_2", 2]
    del columns["torque"]
    assert Recording.load(path, columns=columns).joint_names == (before.joint_names[1], before.joint_names[0])


def test_names_that_say_nothing_of_the_columns_are_told(tmp_path: Path) -> None:
    """Columns that are none of ours, or those of one joint for position and another for torque."""
    path = tmp_path / "run.parquet"
    recording(dof=2).save(path)
    time = {"column": "t"}
    for columns in (
        {"position": {"columns": ["current_1", "current_2"]}},
        {"position": {"columns": ["q_1", "q_2"]}, "torque": {"columns": ["tau_2", "tau_1"]}},
    ):
        found = Recording.load(path, columns={"time": time, **columns}, max_bad=1.0)
        assert found.joint_names == ()
        (note,) = [note for note in found.report.notes if "calls its joints" in note]
        assert note.startswith("The file calls its joints a, b, but the column file does not choose its own columns")
    named = Recording.load(path, columns={"time": time, **columns, "joint_names": ["x", "y"]}, max_bad=1.0)
    assert named.joint_names == ("x", "y")
    assert not [note for note in named.report.notes if "calls its joints" in note]


def test_joints_in_another_order_are_no_recording_of_the_robot() -> None:
    robot = Robot.load("ur10e")
    before, _ = shuffled(tuple(joint.name for joint in robot.joints))
    with pytest.raises(InputError, match=r"joint_names: are those of ur10e in another order: elbow_joint, shoulder"):
        before.check_robot(robot)
    with pytest.raises(InputError, match=r"recording: has 2 joints; ur10e has 6"):
        recording().check_robot(robot)
    recording(dof=6).check_robot(robot)


def test_a_square_matlab_matrix_asks_which_way_it_lies(tmp_path: Path) -> None:
    """As many rows as joints: read one way or the other it would be another motion."""
    q = np.random.default_rng(3).normal(size=(6, 6))
    scipy.io.savemat(tmp_path / "run.mat", {"t": 0.1 * np.arange(6), "q": q})
    for time in ({"variable": "t"}, {"rate_hz": 10}):
        columns = {"time": time, "position": {"variable": "q"}}
        with pytest.raises(InputError, match=r"columns.position.axis: 'q' is 6 x 6.*give axis"):
            Recording.load(tmp_path / "run.mat", columns=columns)
        columns["position"]["axis"] = "rows"
        np.testing.assert_array_equal(Recording.load(tmp_path / "run.mat", columns=columns).q, q.T)


def test_time_may_be_a_column_of_a_matlab_matrix(tmp_path: Path) -> None:
    t, q = 0.1 * np.arange(9), np.random.default_rng(3).normal(size=(9, 2))
    scipy.io.savemat(tmp_path / "run.mat", {"log": np.hstack([q, 1e3 * t[:, None]])})
    columns = {
        "time": {"variable": "log", "column": 3, "unit": "ms"},
        "position": {"variable": "log", "columns": [2, 1]},
    }
    found = Recording.load(tmp_path / "run.mat", columns=columns)
    np.testing.assert_allclose(found.t, t, atol=1e-12)
    np.testing.assert_array_equal(found.q, q[:, ::-1])
    with pytest.raises(InputError, match=r"columns.time.column: 4 is no column of 'log'; 1 to 3"):
        Recording.load(tmp_path / "run.mat", columns=columns | {"time": {"variable": "log", "column": 4}})
    with pytest.raises(InputError, match=r"columns.time.variable: 'log' is 9 x 3; wanted one row or column"):
        Recording.load(tmp_path / "run.mat", columns=columns | {"time": {"variable": "log"}})


def test_another_file_beside_a_matlab_file_is_refused(tmp_path: Path) -> None:
    """It was passed over, and a variable of the same name in the first file was read in its place."""
    for name, value in (("run.mat", 1.0), ("more.mat", 2.0)):
        scipy.io.savemat(tmp_path / name, {"t": np.arange(9.0), "q": np.full((9, 2), value)})
    columns = {
        "time": {"variable": "t"},
        "position": {"variable": "q"},
        "current": {"variable": "q", "file": "more.mat"},
    }
    with pytest.raises(InputError, match=r"columns.current.file: cannot be used with a MATLAB file"):
        Recording.load(tmp_path / "run.mat", columns=columns)


def test_times_may_stand_in_a_file_of_their_own(tmp_path: Path) -> None:
    """The same column of the recording itself was read in their place."""
    written(tmp_path, [f"{7 * i},{0.002 * i}" for i in range(50)]).rename(tmp_path / "times.csv")
    path = written(tmp_path, lines(50))
    time = {"column": 2, "file": "times.csv"}
    found = Recording.load(path, columns=COLUMNS | {"time": time})
    np.testing.assert_allclose(found.t, 0.002 * np.arange(50), atol=1e-12)
    np.testing.assert_array_equal(found.q, Recording.load(path, columns=COLUMNS).q)


def test_a_name_too_long_for_any_file_is_bad_input(tmp_path: Path) -> None:
    for load in (Recording.load, ResidualSeries.load, holds_residuals):
        with pytest.raises(InputError, match="File name too long"):
            load(tmp_path / ("x" * 300 + ".parquet"))


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"time": {"column": 1, "rate_hz": 100}}, "columns.time.column: and rate_hz are both given"),
        ({"position": {"columns": [2, 9]}}, "9 is no column of .*it has 4"),
        ({"position": {"columns": ["q", "r"]}}, "no header: give numbers"),
        ({"position": {"columns": [2, 3], "unit": "grad"}}, "columns.position.unit: 'grad' .*did you mean 'rad'"),
        ({"positions": {}}, "did you mean 'position'"),
        ({"current": {"columns": [2]}}, "1 columns, positions have 2"),
        ({"torque": {"columns": [2, 3], "side": "motor"}}, r"needs a \[coupling\]"),
        ({"position": {"columns": [2, 3], "side": "motor"}}, r"columns.position.side: .* needs a \[coupling\]"),
        ({"velocity": {"columns": [2, 3], "side": "motor"}}, r"columns.velocity.side: .* needs a \[coupling\]"),
        (
            {"current": {"columns": [2, 3], "side": "joint"}, "coupling": {"ratio": [[2, 0], [1, 2]]}},
            "columns.current.side: 'joint' cannot be used: currents are",
        ),
        ({"coupling": {"ratio": [[1, 1], [1, 1]]}}, "cannot be inverted"),
        ({"coupling": {"ratio": [[2, 0], [0, 2]], "sign": [1, 2]}}, r"columns.coupling.sign: is \[1.0, 2.0\]"),
        ({"coupling": {"ratio": [[1]]}}, "is for 1 joints, positions have 2"),
        ({"format": "xls"}, "did you mean 'xlsx'"),
        ({"position": {"columns": [0, 1]}}, "0 is no column"),
    ],
)
def test_column_file_errors(change: dict[str, object], match: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=match):
        Recording.load(written(tmp_path, lines()), columns=COLUMNS | change)


def test_column_file_on_disk(tmp_path: Path) -> None:
    path = written(tmp_path, lines())
    toml = tmp_path / "columns.toml"
    toml.write_text('header = false\ntime = { column = 1 }\nposition = { columns = [2, 3], unit = "rad" }\n')
    assert Recording.load(path, columns=toml).dof == 2
    toml.write_bytes(b"\xef\xbb\xbf" + toml.read_bytes().replace(b"\n", b"\r\n"))
    assert Recording.load(path, columns=toml).dof == 2
    for damaged in ("time = ", f"time = {'1' * 5000}"):
        toml.write_text(damaged)
        with pytest.raises(InputError, match="not valid TOML"):
            Recording.load(path, columns=toml)


def test_column_file_of_the_documentation(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "robot" / "recording.md").read_text(encoding="utf-8")
    (tmp_path / "c.toml").write_text(re.findall(r"^```toml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)[0])
    path = written(tmp_path, [f"{i},90,45,1,1,2,3" for i in range(10)])
    found = Recording.load(path, columns=tmp_path / "c.toml")
    assert found.rate_hz == pytest.approx(1000)
    assert found.tau is not None
    assert found.tau[0].tolist() == [77, 32]


@pytest.mark.parametrize("name", ["run.parquet", "run.xlsx", "run.mat", "run.mcap", "run.db3"])
def test_damaged_files(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"this is something else" * 20)
    columns = {"time": {"variable": "t"}, "position": {"variable": "q"}} if name.endswith("mat") else None
    with pytest.raises(InputError, match=r"cannot be read|damaged"):
        Recording.load(tmp_path / name, columns=columns)


def test_text_without_names_asks_for_a_column_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no header, and 4 columns; say with --columns"):
        Recording.load(written(tmp_path, lines()))
    (tmp_path / "x.abc").touch()
    with pytest.raises(InputError, match="no known ending"):
        Recording.load(tmp_path / "x.abc")


def test_names_of_an_excel_file_are_found_out(tmp_path: Path) -> None:
    """A first row of numbers is data, also where a number stands in it twice."""
    pytest.importorskip("fastexcel")
    rows = [[0.01 * i, 0.0, 0.0] for i in range(60)]
    path = workbook(tmp_path / "run.xlsx", rows)
    columns = {"time": {"column": 1}, "position": {"columns": [2, 3]}}
    assert Recording.load(path, columns=columns).t.tolist() == [row[0] for row in rows]
    # Names all the same, if the column file says so.
    assert Recording.load(path, columns=columns | {"header": True}).t.size == 59
    with pytest.raises(InputError, match="has no header, and 3 columns; say with --columns"):
        Recording.load(path)
    workbook(path, [["t", "q_1", "q_2"], *rows])
    assert Recording.load(path).t.tolist() == [row[0] for row in rows]


def test_a_name_that_stands_twice_in_an_excel_file_is_refused(tmp_path: Path) -> None:
    """The second had another ending, and the first was read."""
    pytest.importorskip("fastexcel")
    rows = [[0.01 * i, 0.02 * i, 0.1 * i, 0.5] for i in range(20)]
    columns = {"time": {"column": "t"}, "position": {"columns": ["q_1", "q_2"]}}
    for names in (["t", "q_1", "q_1", "q_2"], ["t", "t", "q_1", "q_2"]):
        path = workbook(tmp_path / "run.xlsx", [names, *rows])
        twice = next(name for name in names if names.count(name) > 1)
        with pytest.raises(InputError, match=rf"has 2 columns '{twice}'; say with --columns"):
            Recording.load(path)
        with pytest.raises(InputError, match=rf"has 2 columns '{twice}'; give their numbers"):
            Recording.load(path, columns=columns)


def test_rows_and_columns_of_an_excel_file_count_as_excel_counts_them(tmp_path: Path) -> None:
    """Also after such as have no cell."""
    pytest.importorskip("fastexcel")
    rows: list[list[str | float | None]] = [[0.01 * i, None, 0.5, 0.1 * i] for i in range(300)]
    rows[200][2] = "torn"
    columns = {"time": {"column": 1}, "position": {"columns": [3, 4]}}
    for names in ([["t", None, "q_1", "q_2"]], []):
        sheet = [[], [], *names, *rows[:100], [], *rows[100:]]
        found = Recording.load(workbook(tmp_path / "run.xlsx", sheet), columns=columns)
        assert [row for row, _ in found.report.dropped] == [204 + len(names)]
        assert (found.report.rows_read, found.q[1].tolist()) == (300, [0.5, 0.1])
    for sheet, problem in (([["t", "q_1"]], "has no row of data"), ([], "is empty")):
        with pytest.raises(InputError, match=problem):
            Recording.load(workbook(tmp_path / "run.xlsx", sheet))
