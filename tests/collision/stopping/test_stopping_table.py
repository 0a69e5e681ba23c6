"""Files of stopping distances: every layout says the same, and bad ones are refused or mended by name."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.stopping import StoppingTable, load_stopping_table
from bumpstop.collision.stopping.column_names import read_column

ROOT = Path(__file__).resolve().parents[3]
TM5_700 = ROOT / "examples" / "stopping" / "tm5_700.toml"
DEG = math.pi / 180

# Two joints, two payloads, speeds in percent of 200 deg/s.
PLAIN = """# full_speed_deg_s = 200
payload_percent,extension_percent,speed_percent,distance_1_deg,distance_2_deg
50,100,33,2.0,1.0
50,100,66,8.0,4.0
50,100,100,18.0,9.0
100,100,33,3.0,1.5
100,100,66,12.0,6.0
100,100,100,27.0,13.5
"""


def load(tmp_path: Path, text: str, name: str = "table.csv", **options: object) -> StoppingTable:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return load_stopping_table(path, **options)  # type: ignore[arg-type]


def same(one: StoppingTable, other: StoppingTable) -> None:
    for name in ("payload", "extension", "speed", "distance"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-12, err_msg=name)
    assert one.joints == other.joints


def test_units_are_those_of_the_names(tmp_path: Path) -> None:
    table = load(tmp_path, PLAIN)
    assert table.joints == (1, 2)
    assert table.speed[0, 0] == pytest.approx(0.33 * 200 * DEG)
    assert table.distance[2].tolist() == pytest.approx([18 * DEG, 9 * DEG])
    assert table.payload.tolist() == [0.5] * 3 + [1.0] * 3


@pytest.mark.parametrize(
    "text",
    [
        # Columns in another order, by other names, in other units, with semicolons and decimal commas.
        """Arm extension [%];J2 stopping distance [rad];Axis 1 angle (°);Speed [°/s];Load (%)
100;0,017453292519943295;2,0;66;50
100;0,06981317007977318;8,0;132;50
100;0,15707963267948966;18,0;200;50
100;0,02617993877991494;3,0;66;100
100;0,10471975511965977;12,0;132;100
100;0,23561944901923448;27,0;200;100
""",
        # One row for each joint.
        "# full_speed_deg_s: 200\njoint,payload_percent,extension_percent,speed_percent,distance_deg,time_ms\n"
        + "".join(
            f"{j},{p},100,{v},{d / j},100\n"
            for p, v, d in (
                (50, 33, 2),
                (50, 66, 8),
                (50, 100, 18),
                (100, 33, 3),
                (100, 66, 12),
                (100, 100, 27),
            )
            for j in (2, 1)
        ),
    ],
)
def test_other_layouts_say_the_same(tmp_path: Path, text: str) -> None:
    same(load(tmp_path, text), load(tmp_path / "", PLAIN, "plain.csv"))


def test_toml_by_columns_and_by_rows(tmp_path: Path) -> None:
    lines = [line for line in PLAIN.splitlines() if not line.startswith("#")]
    names = lines[0].split(",")
    columns = (
        f"full_speed_deg_s = [200, 200]\ncolumns = {names}\nrows = [{', '.join(f'[{row}]' for row in lines[1:])}]\n"
    )
    tables = "full_speed_deg_s = 200\n" + "".join(
        "[[row]]\n" + "".join(f"{name} = {cell}\n" for name, cell in zip(names, row.split(","), strict=True))
        for row in lines[1:]
    )
    plain = load(tmp_path, PLAIN)
    same(load(tmp_path, columns, "columns.toml"), plain)
    same(load(tmp_path, "[arm]\n" + columns, "nested.toml"), plain)
    same(load(tmp_path, tables, "tables.toml"), plain)


@pytest.mark.parametrize(
    ("name", "quantity", "joint", "unit"),
    [
        ("s1_deg", "distance", 1, "deg"),
        ("A1 [°]", "distance", 1, "deg"),
        ("Joint 0 (BASE) stopping distance (rad)", "distance", 1, "rad"),
        ("wrist 2 time [s]", "time", 5, "s"),
        ("TCP distance mm", "distance", 0, "mm"),
        ("v_percent", "speed", None, "percent"),
        ("velocity_deg_s", "speed", None, "deg/s"),
        ("Speed (°/s)", "speed", None, "deg/s"),
        ("Axis", "joint", None, ""),
        ("Override [%]", "speed", None, "percent"),
    ],
)
def test_names_of_columns(name: str, quantity: str, joint: int | None, unit: str) -> None:
    column = read_column(name)
    assert column is not None
    assert (column.quantity, column.counted(1).joint, column.unit) == (quantity, joint, unit)


UR = """speed (rad/s),Joint 0 (BASE) stopping distance [rad],Joint 1 (SHOULDER) stopping distance [rad],\
Joint 2 (ELBOW) stopping distance [rad],time base [ms],time 1 [ms],Joint 3 (WRIST 1) angle [rad]
0.7,0.105,0.175,0.084,300,500,0.05
1.4,0.210,0.350,0.168,300,500,0.10
"""


def test_a_word_beside_a_number_decides_how_the_file_counts(tmp_path: Path) -> None:
    """As in manuals of Universal Robots: joint 0 is the base."""
    table = load(tmp_path, UR)
    assert table.joints == (1, 2, 3, 4)
    assert table.distance[0].tolist() == [0.105, 0.175, 0.084, 0.05]
    np.testing.assert_array_equal(table.time[0], [0.3, 0.5, np.nan, np.nan])
    assert "The file counts joints from 0; here they are counted from 1." in table.notes
    names, *rows = UR.splitlines()
    without_base = "\n".join(",".join(row.split(",")[:1] + row.split(",")[2:4]) for row in (names, *rows))
    assert load(tmp_path, without_base).joints == (2, 3)
    as_here = UR.replace("Joint 0", "J1").replace("Joint 1", "J2").replace("Joint 2", "J3").replace("Joint 3", "J4")
    table = load(tmp_path, as_here.replace("time 1", "time 2"))
    assert table.joints == (1, 2, 3, 4)
    assert table.notes == ()


@pytest.mark.parametrize(
    ("names", "joints"),
    [
        ("joint", ("Joint 1 (SHOULDER)", "Joint 2 (ELBOW)")),
        ("joint", ("shoulder", "elbow")),
        ("joint,remark", ("1,Shoulder", "2,Elbow")),
        ("joint,joint name", ("2,SHOULDER", "3,ELBOW")),
        ("axis", ("A2", "A3")),
    ],
)
def test_rows_say_their_joints_by_word_and_number(tmp_path: Path, names: str, joints: tuple[str, str]) -> None:
    rows = [f"{joint},{v},{v * s}" for joint, s in zip(joints, (0.3, 0.2), strict=True) for v in (1, 2)]
    table = load(tmp_path, f"{names},speed [rad/s],distance [rad]\n" + "\n".join(rows) + "\n")
    assert table.joints == (2, 3)
    np.testing.assert_allclose(table.distance[0], [0.3, 0.2])


@pytest.mark.parametrize(
    ("name", "joint", "category"),
    [
        ("STOP 1 stopping distance A2 [deg]", 2, 1),
        ("Stopping distance axis 1 (STOP 0) [deg]", 1, 0),
        ("Axis 2 stopping distance Stop 0 [deg]", 2, 0),
        ("Stop category 0 distance A1 [deg]", 1, 0),
        ("Cat. 1 stopping distance J2 [deg]", 2, 1),
        ("distance_J2_cat2_deg", 2, 2),
        ("stop_1_distance_3_deg", 3, 1),
        ("stopping distance 2 [deg]", 2, None),
    ],
)
def test_the_number_of_a_stop_category_is_no_joint(tmp_path: Path, name: str, joint: int, category: int | None) -> None:
    table = load(tmp_path, f"speed [deg/s],{name}\n30,6\n60,12\n")
    assert (table.joints, table.category) == ((joint,), category)


def test_of_columns_of_several_stop_categories_one_must_be_chosen(tmp_path: Path) -> None:
    text = "speed [deg/s],STOP 0 distance A1 [deg],STOP 1 distance A1 [deg]\n50,1,2\n100,4,4\n"
    with pytest.raises(bs.InputError, match="stop categories 0, 1") as refused:
        load(tmp_path, text)
    assert refused.value.field == "category"
    np.testing.assert_allclose(load(tmp_path, text, category=1).distance[:, 0], [2 * DEG, 4 * DEG])
    with pytest.raises(bs.InputError, match="2 is not in"):
        load(tmp_path, text, category=2)


def test_unsorted_and_repeated_rows_are_mended_and_told(tmp_path: Path) -> None:
    head, rows = PLAIN.splitlines()[:2], PLAIN.splitlines()[2:]
    table = load(tmp_path, "\n".join([*head, *reversed(rows), rows[0]]) + "\n")
    same(table, load(tmp_path, PLAIN, "plain.csv"))
    assert any("sorted" in note for note in table.notes)
    assert any("repeats row" in note for note in table.notes)


def test_rows_are_cases_of_each_joint_where_joints_have_speeds_of_their_own(tmp_path: Path) -> None:
    """Joint 2 is slower where joint 1 is faster; then joint 1 says two distances of one speed."""
    head = "speed_1_deg_s,speed_2_deg_s,distance_1_deg,distance_2_deg\n"
    assert not load(tmp_path, f"{head}50,90,5,30\n100,60,20,15\n150,30,50,5\n").notes
    again = load(tmp_path, f"{head}50,30,5,5\n50,60,5,15\n100,90,20,30\n50,60,5,15\n")
    assert again.notes == ("Rows sorted by payload, extension and speed.", "Row 4 repeats row 1, 2: left out.")
    for distances in ("5", "10"), ("10", "5"):
        text = f"{head}50,30,{distances[0]},5\n50,60,{distances[1]},15\n100,90,20,30\n"
        with pytest.raises(bs.InputError, match=r"rows 1 and 2 say .* speed of joint 1"):
            load(tmp_path, text)


def test_rows_that_fill_each_others_holes_do_not_contradict_each_other(tmp_path: Path) -> None:
    table = load(tmp_path, "speed_deg_s,distance_1_deg,distance_2_deg\n50,5,\n50,,15\n100,20,\n100,,30\n")
    assert table.known.sum(axis=0).tolist() == [2, 2]
    long = load(tmp_path, "joint,speed_deg_s,distance_deg\n1,50,5\n1,50,\n1,100,20\n1,100,20\n")
    np.testing.assert_allclose(long.distance[:, 0], [5 * DEG, 20 * DEG])
    assert long.notes == ("Row 4 repeats an earlier row: left out.",)


def test_holes_are_left_out_and_told(tmp_path: Path) -> None:
    table = load(tmp_path, PLAIN.replace("8.0,4.0", ",4.0"))
    assert np.isnan(table.distance[1, 0])
    assert table.notes == ("No distance of joint 1 in row 2: left out.",)


def test_a_path_of_the_tcp_becomes_an_angle_by_reach_and_extension(tmp_path: Path) -> None:
    text = "speed_deg_s,extension_percent,distance_tcp_mm\n50,50,20\n100,50,80\n"
    assert load(tmp_path, text.replace("deg_s", "mm_s")).linear
    table = load(tmp_path, text, reach_mm=1000.0)
    assert not table.linear
    np.testing.assert_allclose(table.distance[:, 0], [0.02 / 0.5, 0.08 / 0.5])
    with pytest.raises(bs.InputError, match="distances as lengths and speeds as angles"):
        load(tmp_path, text)


def test_shares_are_told_from_percent(tmp_path: Path) -> None:
    text = PLAIN.replace(",33,", ",0.33,").replace(",66,", ",0.66,").replace(",100,100,", ",100,1.0,")
    text = text.replace("50,100,100,18", "50,100,1.0,18").replace("100,100,1.0,27", "100,100,1.0,27")
    table = load(tmp_path, text)
    same(table, load(tmp_path, PLAIN, "plain.csv"))
    assert any("read as shares" in note for note in table.notes)


def test_of_several_stop_categories_one_must_be_chosen(tmp_path: Path) -> None:
    text = "speed_deg_s,category,distance_1_deg\n50,0,1\n100,0,4\n50,1,2\n100,1,4\n"
    with pytest.raises(bs.InputError, match="stop categories 0, 1"):
        load(tmp_path, text)
    np.testing.assert_allclose(load(tmp_path, text, category=1).distance[:, 0], [2 * DEG, 4 * DEG])
    words = text.replace(",0,", ",STOP 0,").replace(",1,", ",Cat. 1,")
    same(load(tmp_path, words, category=1), load(tmp_path, text, category=1))


@pytest.mark.parametrize(
    ("text", "field", "problem"),
    [
        (PLAIN.replace("8.0,4.0", "-8.0,4.0"), "row 2, column 'distance_1_deg'", "-8 cannot be used"),
        (PLAIN.replace("8.0,4.0", "oops,4.0"), "row 2, column 'distance_1_deg'", "is not a number"),
        (PLAIN.replace("50,100,66", "50,100,"), "row 2, column 'speed_percent'", "is empty"),
        ("payload_kg,speed_deg_s,distance_1_deg\n0,10,1\n,20,9\n", "row 2, column 'payload_kg'", "is empty"),
        (PLAIN.replace("50,100,66", "50,100,166"), "row 2, column 'speed_percent'", "166 cannot be used"),
        (PLAIN.replace("8.0,4.0", "0.1396,4.0"), "row 2", "one unit for all rows"),
        (PLAIN.replace(",8.0,4.0", ",8.0"), "row 2", "has 4 values"),
        (PLAIN.replace("distance_2_deg", "distance_2_mm"), "table.csv", "is a length and"),
        (PLAIN.replace("distance_2_deg", "distance_2"), "column 'distance_2'", "says no unit"),
        (PLAIN.replace("distance_2_deg", "distance_1_deg"), "table.csv", "twice"),
        (PLAIN.replace("# full_speed_deg_s = 200\n", ""), "full_speed_deg_s", "is missing"),
        ("\n".join(PLAIN.splitlines()[:3]) + "\n", "table.csv", "has one distance of joint 1"),
        ("\n".join(PLAIN.splitlines()[:2]) + "\n", "table.csv", "has no rows"),
        (PLAIN + "50,100,66,8.5,4.0\n", "table.csv", "rows 2 and 7 say different distances"),
        ("speed_deg_s,payload_kg,distance_1_deg\n50,1,2\n50,2,3\n", "table.csv", "one speed of joint 1"),
        ("payload_kg,distance_1_deg\n1,2\n2,3\n", "table.csv", "has no speeds"),
        ("speed_deg_s,payload_kg\n50,1\n60,2\n", "table.csv", "has no distances"),
        ("", "table.csv", "is empty"),
        (PLAIN.replace("distance_2", "distance_j0"), "column 'distance_j0_deg'", "from 0"),
        ("joint,speed_deg_s,distance_deg\n0,1,1\n0,2,2\n", "row 1, column 'joint'", "from 0"),
        ("joint,speed_deg_s,distance_deg\n1.5,1,1\n1.5,2,2\n", "row 1, column 'joint'", "1.5 is no joint"),
        ("joint,speed_deg_s,distance_deg\n1,1,1\n,2,2\n", "row 2", "names no joint"),
        ("speed_deg_s,category,distance_1_deg\n1,1,1\n2,,4\n3,1,9\n", "row 2, column 'category'", "is empty"),
        ("speed_deg_s,category,distance_1_deg\n1,1,1\n2,1.5,4\n", "row 2, column 'category'", "no stop category"),
        (PLAIN.replace("distance_1", "distance_3_base"), "column 'distance_3_base_deg'", "word for joint 1"),
        (
            PLAIN.replace("distance_1", "distance_1_base").replace("distance_2", "distance_1_shoulder"),
            "column 'distance_1_shoulder_deg'",
            "counts joints from 0 by their words, and",
        ),
        (PLAIN.replace("distance_1", "J1_distance_A2"), "column 'J1_distance_A2_deg'", "names two joints"),
        (PLAIN.replace("distance_1", "wrist_distance_1"), "column 'wrist_distance_1_deg'", "names a wrist joint"),
        (PLAIN.replace("distance_1", "stop_1_cat_0_J1"), "column 'stop_1_cat_0_J1_deg'", "two stop categories"),
        (PLAIN.replace("distance_1", "S-axis_distance"), "column 'S-axis_distance_deg'", "says a joint, and not which"),
        (
            PLAIN.replace("distance_1", "S_distance").replace("distance_2", "L_distance"),
            "table.csv",
            "say no joint's number; wanted joints by their numbers",
        ),
        (PLAIN.replace("distance_1", "J2_angle"), "table.csv", "say the same joint; leave one of the two out"),
    ],
)
def test_bad_tables_are_refused_by_name(tmp_path: Path, text: str, field: str, problem: str) -> None:
    with pytest.raises(bs.InputError) as refused:
        load(tmp_path, text)
    assert field in refused.value.field
    assert problem in str(refused.value)


def test_a_quotation_mark_that_is_not_closed_swallows_no_rows(tmp_path: Path) -> None:
    """Here the longest distances would be gone, and what is left is a sound table."""
    header, *rows = PLAIN.splitlines()[1:]
    remarks = ["", "", "", "", "", ""]
    text = "\n".join(["# full_speed_deg_s = 200", f"{header},remark", *map(",".join, zip(rows, remarks, strict=True))])
    assert load(tmp_path, text).distance.shape == (6, 2)
    remarks[3] = '"warm'
    text = "\n".join(["# full_speed_deg_s = 200", f"{header},remark", *map(",".join, zip(rows, remarks, strict=True))])
    with pytest.raises(bs.InputError, match="line 6: has a cell that goes on in the next line, or a quotation mark"):
        load(tmp_path, text)


def test_a_faster_row_that_stops_sooner_is_told(tmp_path: Path) -> None:
    table = load(tmp_path, PLAIN.replace("18.0,9.0", "7.0,9.0"))
    assert any("row 3 is shorter than in the slower row 2" in note for note in table.notes)


def test_empty_columns_of_a_spreadsheet_are_passed_over(tmp_path: Path) -> None:
    stated, *rows = PLAIN.splitlines()
    table = load(tmp_path, "\n".join([stated, *(f"{row},, " for row in rows)]))
    same(table, load(tmp_path, PLAIN, "plain.csv"))
    assert table.notes == ()
    with pytest.raises(bs.InputError, match="has 7 values"):
        load(tmp_path, PLAIN.replace("8.0,4.0", "8.0,4.0,,1.0").replace("2.0,1.0", "2.0,1.0,,"))


def test_joints_of_kawasaki_and_staubli(tmp_path: Path) -> None:
    names = PLAIN.replace("distance_1_deg", "JT1 (deg)").replace("distance_2_deg", "Stopping distance jt 2 [deg]")
    same(load(tmp_path, names), load(tmp_path, PLAIN, "plain.csv"))


@pytest.mark.parametrize(("full", "separate"), [("3,14", "3.14"), ("3,14; 2,5", "3.14, 2.5"), ("3, 2", "3, 2")])
def test_decimal_commas_of_a_file_are_those_of_its_comments(tmp_path: Path, full: str, separate: str) -> None:
    """As a list they gave one joint 3 rad/s and the other 14."""
    rows = PLAIN.split("\n", 1)[1]
    semicolons = f"# full_speed_rad_s = {full}\n" + rows.replace(",", ";").replace(".", ",")
    same(load(tmp_path, semicolons), load(tmp_path, f"# full_speed_rad_s = {separate}\n" + rows, "points.csv"))


@pytest.mark.parametrize(("time", "told"), [("100", True), ("299", False), ("900", False), ("", False)])
@pytest.mark.parametrize("full", ["", "# full_speed_deg_s = 100\n"])
def test_a_distance_longer_than_all_of_the_time_at_its_speed_is_told(
    tmp_path: Path, time: str, told: bool, full: str
) -> None:
    """Three tenths of a second at 30 deg/s are 9 deg."""
    speed = "speed_percent" if full else "speed_deg_s"
    text = f"{full}{speed},distance_1_deg,time_1_ms\n30,9,{time}\n60,18,{time}\n90,27,900\n"
    (note,) = load(tmp_path, text).notes or ("",)
    row = (
        "The distance of joint 1 in row 1, 2 is longer than its speed for all of the published time: 9 deg at 30 deg/s"
    )
    assert note.startswith(row) is told
    assert note.endswith("the units and the full speed." if full else "the units.") is told


def test_full_speeds_go_to_joints_by_their_numbers(tmp_path: Path) -> None:
    text = "speed_percent,distance_3_deg,distance_1_deg\n50,1,1\n100,3,3\n"
    table = load(tmp_path, text, full_speed_deg_s=[100.0, 300.0])
    np.testing.assert_allclose(table.speed[1] / DEG, [100, 300])
    assert table.joints == (1, 3)
    with pytest.raises(bs.InputError, match="or 2: one for each joint of the table, by their numbers"):
        load(tmp_path, text, full_speed_deg_s=[100.0, 200.0, 300.0])
    absolute = load(tmp_path, text.replace("percent", "deg_s"), full_speed_deg_s=100.0)
    assert absolute.notes == ("full_speed_deg_s has no effect on speeds that are no shares.",)


def test_the_example_is_the_maker_s_table() -> None:
    table = load_stopping_table(TM5_700)
    assert table.distance.shape == (18, 3)
    # Typed again: rows 6 and 14 of table 16.
    np.testing.assert_allclose(table.distance[5] / DEG, [26.34, 27.72, 23.41])
    np.testing.assert_allclose(table.distance[13] / DEG, [17.92, 18.26, 18.26])
    np.testing.assert_allclose(table.time[5], [0.610, 0.528, 0.457])
