"""Units and coupling of what column files name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bumpstop import InputError, Robot
from bumpstop.model import Joint
from bumpstop.recording import Recording
from recording.cases import recording, workbook, written

SCARA = Robot(
    name="scara",
    joints=(
        Joint(name="shoulder", link="upper", lower=-2.3, upper=2.3, velocity=6.0),
        Joint(name="quill", link="quill", kind="prismatic", lower=-0.2, upper=0.0, velocity=1.1),
    ),
)


def test_a_unit_for_each_column(tmp_path: Path) -> None:
    """A robot that turns and slides is logged in degrees and millimetres."""
    q = np.column_stack([np.linspace(-1, 1, 50), np.linspace(-0.15, 0, 50)])
    qd = q + 0.01
    text = [",".join(map(repr, (0.01 * i, *map(float, row)))) for i, row in enumerate(
        np.hstack([np.degrees(q[:, :1]), 1e3 * q[:, 1:], np.degrees(qd[:, :1]), 1e3 * qd[:, 1:]])
    )]  # fmt: skip
    path = written(tmp_path, text)
    columns: dict[str, Any] = {
        "time": {"column": 1},
        "position": {"columns": [2, 3], "unit": ["deg", "mm"]},
        "velocity": {"columns": [4, 5], "unit": ["deg/s", "mm/s"]},
    }
    found = Recording.load(path, columns=columns, robot=SCARA)
    np.testing.assert_allclose(found.q, q, rtol=1e-12, atol=1e-15)
    assert found.qd is not None
    np.testing.assert_allclose(found.qd, qd, rtol=1e-12)
    # In another order of the columns the units go with them.
    turned = columns | {
        "joint_names": ["quill", "shoulder"],
        "position": {"columns": [3, 2], "unit": ["mm", "deg"]},
        "velocity": {"columns": [5, 4], "unit": ["mm/s", "deg/s"]},
    }
    np.testing.assert_allclose(Recording.load(path, columns=turned, robot=SCARA).q, q, rtol=1e-12, atol=1e-15)
    with pytest.raises(InputError, match=r"^columns.position.unit: 3 of them for 2 columns"):
        Recording.load(path, columns=columns | {"position": {"columns": [2, 3], "unit": ["deg", "mm", "mm"]}})


@pytest.mark.parametrize(
    ("position", "velocity", "message"),
    [
        ("deg", "rad/s", r"position.unit: 'deg' is none of joint 'quill', which slides; .*example \[.deg., .mm.\]"),
        ("mm", "rad/s", r"position.unit: 'mm' is none of joint 'shoulder', which turns; .*example \[.deg., .mm.\]"),
        ("rad", "rpm", r"velocity.unit: 'rpm' is none of joint 'quill', which slides; .*example \[.rpm., .mm/s.\]"),
        (["mm", "deg"], "rad/s", r"position.unit: 'mm' is none of joint 'shoulder'"),
    ],
)
def test_units_of_angles_are_none_of_sliding_joints(position: Any, velocity: str, message: str, tmp_path: Path) -> None:
    """A factor of pi / 180 on a length is a wrong number that no limit need show."""
    columns = {
        "time": {"column": 1},
        "position": {"columns": [2, 3], "unit": position},
        "velocity": {"columns": [2, 3], "unit": velocity},
    }
    path = written(tmp_path, [f"{0.01 * i},{0.1 * i},{-0.0002 * i}" for i in range(50)])
    with pytest.raises(InputError, match=message):
        Recording.load(path, columns=columns, robot=SCARA)


def test_units_of_motors_are_those_of_motors(tmp_path: Path) -> None:
    """The motor of a joint that slides turns."""
    path = written(tmp_path, [f"{0.01 * i},{0.1 * i},{-10.0 * i}" for i in range(50)])
    columns = {
        "time": {"column": 1},
        "position": {"columns": [2, 3], "unit": "deg"},
        "coupling": {"ratio": [[1.0, 0.0], [0.0, 628.3]]},
    }
    found = Recording.load(path, columns=columns, robot=SCARA)
    np.testing.assert_allclose(found.q[-1], [np.radians(4.9), np.radians(-490.0) / 628.3], rtol=1e-12)


def test_units_and_coupling(tmp_path: Path) -> None:
    motor = np.random.default_rng(2).uniform(-100, 100, (50, 2))
    torque = np.random.default_rng(3).uniform(-1, 1, (50, 2))
    text = [f"{10 * i},{a},{b},{c},{d}" for i, (a, b, c, d) in enumerate(np.hstack([motor, torque]))]
    ratio = np.array([[45.0, 0.0], [32.0, 32.0]])
    columns = {
        "time": {"column": 1, "unit": "ms"},
        "position": {"columns": [2, 3], "unit": "deg"},
        "torque": {"columns": [4, 5], "side": "motor"},
        "coupling": {"ratio": ratio.tolist(), "offset_rad": [0.1, -0.2], "sign": [1, -1]},
    }
    found = Recording.load(written(tmp_path, text), columns=columns)
    q = np.linalg.solve(ratio, np.radians(motor).T).T + np.array([0.1, -0.2])
    np.testing.assert_allclose(found.q, q, rtol=1e-12)
    assert found.tau is not None
    np.testing.assert_allclose(found.tau, (ratio.T @ torque.T).T * [1, -1], rtol=1e-12)
    assert found.t[1] == 0.01
    # Rates turn as positions do, and have no zero to shift; whose they are is said for each.
    columns["velocity"] = {"columns": [2, 3], "unit": "deg/s"}
    for side in ("motor", "joint"):
        columns["velocity"]["side"] = side  # type: ignore[index]
        moving = Recording.load(written(tmp_path, text), columns=columns)
        rates = np.radians(motor if side == "joint" else np.linalg.solve(ratio, motor.T).T)
        np.testing.assert_allclose(np.array(moving.qd), rates, rtol=1e-12)
    # Where a file itself says what stands where, a coupling turns positions and rates.
    own = recording()
    own.save(tmp_path / "own.parquet")
    turned = Recording.load(tmp_path / "own.parquet", columns={"coupling": {"ratio": ratio.tolist()}})
    np.testing.assert_allclose(turned.q @ ratio.T, own.q, atol=1e-12)
    np.testing.assert_allclose(np.array(turned.qd) @ ratio.T, np.array(own.qd), atol=1e-12)
    # Positions that are the joints' already have no ratio, but where their zero lies is still said.
    columns["position"]["side"] = "joint"  # type: ignore[index]
    joint_side = Recording.load(written(tmp_path, text), columns=columns)
    np.testing.assert_allclose(joint_side.q, np.radians(motor) + np.array([0.1, -0.2]), rtol=1e-12)
    # Power is the same on both sides, but for the sign that was asked for.
    power = np.sum(found.tau * [1, -1] * np.linalg.solve(ratio, motor.T).T, axis=1)
    np.testing.assert_allclose(power, np.sum(torque * motor, axis=1))


@pytest.mark.parametrize("coupled", [False, True])
@pytest.mark.parametrize("name", ["velocity", "current", "torque"])
@pytest.mark.parametrize("width", [1, 3])
def test_a_quantity_has_one_column_for_each_joint(name: str, width: int, coupled: bool, tmp_path: Path) -> None:
    """One column of two joints was copied to both, with the signs of a coupling; three were a fault of ours."""
    path = written(tmp_path, [f"{0.01 * i},{0.1 * i},{-0.2 * i},{0.3 * i},1,2" for i in range(50)])
    columns: dict[str, Any] = {
        "time": {"column": 1},
        "position": {"columns": [2, 3]},
        name: {"columns": list(range(4, 4 + width))},
    }
    if coupled:
        columns["coupling"] = {"ratio": [[2.0, 0.0], [0.0, 3.0]], "sign": [1, -1]}
    with pytest.raises(InputError, match=f"^columns.{name}: {width} columns, positions have 2; wanted 2"):
        Recording.load(path, columns=columns)


@pytest.mark.parametrize("name", ["current", "torque"])
@pytest.mark.parametrize("side", ["motor", "joint"])
def test_the_sign_of_a_coupling_turns_currents_and_torques(name: str, side: str, tmp_path: Path) -> None:
    """Of either side, and of a current, of which there is one side alone."""
    path = written(tmp_path, [f"{0.01 * i},{0.1 * i},{-0.2 * i},{1.0 + i},{2.0 + i}" for i in range(50)])
    columns: dict[str, Any] = {
        "time": {"column": 1},
        "position": {"columns": [2, 3]},
        name: {"columns": [4, 5]} | ({"side": side} if name == "torque" else {}),
        "coupling": {"ratio": [[2.0, 0.0], [0.0, 4.0]], "sign": [1, -1]},
    }
    found = Recording.load(path, columns=columns)
    value = found.current if name == "current" else found.tau
    assert value is not None
    ratio = np.array([2.0, 4.0]) if name == "torque" and side == "motor" else np.ones(2)
    np.testing.assert_allclose(value[3], ratio * [4.0, -5.0])


@pytest.mark.parametrize(("beside", "mixed"), [(32.0, True), (-32.0, True), (0.5, False), (0.0, False)])
def test_a_current_of_a_motor_that_carries_other_joints_is_no_current_of_its_joint(
    beside: float, mixed: bool, tmp_path: Path
) -> None:
    """Of a coupled wrist a gain came out as 5.6 +- 0.6 in place of 9, and the fit was usable."""
    path = written(tmp_path, [f"{0.01 * i},{0.1 * i},{-0.2 * i},{1.0 + i},{2.0 + i}" for i in range(50)])
    columns: dict[str, Any] = {
        "time": {"column": 1},
        "position": {"columns": [2, 3]},
        "current": {"columns": [4, 5]},
        "coupling": {"ratio": [[45.0, 0.0], [beside, 32.0]]},
        "joint_names": ["tilt", "roll"],
    }
    # tau_motor = inverse(transpose(ratio)) tau: the first motor carries what the second joint has, not the other way.
    faults = Recording.load(path, columns=columns).report.faults
    assert [fault for fault in faults if "the current of tilt is of a motor" in fault] == list(faults[:mixed])
    assert len(faults) == mixed
    columns["torque"] = columns.pop("current") | {"side": "motor"}
    assert not Recording.load(path, columns=columns).report.faults


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        (("q1 [deg]", "q2 [deg]"), "deg"),
        (("q1 (mm)", "q2 (mm)"), "mm"),
        (("A1 [°]", "A2 [°]"), "deg"),
        (("q[1] (m)", "q[2] [rad]"), ""),
        (("q1 deg", "q2 deg"), ""),
    ],
)
def test_a_unit_in_a_name_is_not_passed_over(names: tuple[str, str], unit: str, tmp_path: Path) -> None:
    """Without a unit in the column file degrees of a slow arm were radians, without a word."""
    path = written(tmp_path, [f"t;{';'.join(names)}", *(f"{0.01 * i};{0.01 * i};0.5" for i in range(50))])
    columns: dict[str, Any] = {"time": {"column": "t"}, "position": {"columns": list(names)}}
    if unit:
        with pytest.raises(InputError) as error:
            Recording.load(path, columns=columns)
        said = f"columns.position.unit: is 'rad', but {str(path)!r} says {unit!r} in the name {names[0]!r}"
        assert str(error.value) == f'{said}; wanted "{unit}", or columns by number'
        columns["position"] = {"columns": [2, 3]}  # a name may be wrong
        assert Recording.load(path, columns=columns).q[0, 1] == 0.5
        columns["position"] = {"columns": list(names), "unit": unit}
    assert Recording.load(path, columns=columns).q[0, 1] == pytest.approx(
        {"deg": np.pi / 360, "mm": 5e-4, "": 0.5}[unit]
    )


@pytest.mark.parametrize("kind", ["csv", "xlsx"])
def test_units_below_the_names_are_not_passed_over(kind: str, tmp_path: Path) -> None:
    """They were one bad row, and the values were read in SI."""
    names, units = ["t", "q_1", "q_2"], ["ms", "[°]", "deg"]
    rows = [[10.0 * i, 0.1 * i, 0.5] for i in range(200)]
    if kind == "csv":
        path = written(tmp_path, [",".join(map(str, row)) for row in (names, units, *rows)])
    else:
        pytest.importorskip("fastexcel")
        path = workbook(tmp_path / "run.xlsx", [names, units, *rows])
    with pytest.raises(InputError, match=r"(line|row) 2: holds no number but ms, \[°\], deg: are these units\?.*unit"):
        Recording.load(path)
    columns: dict[str, Any] = {"time": {"column": "t", "unit": "ms"}, "position": {"columns": ["q_1", "q_2"]}}
    with pytest.raises(InputError, match=r"columns.position.unit: is 'rad', but .* says 'deg' in (line|row) 2"):
        Recording.load(path, columns=columns)
    columns["position"]["unit"] = "deg"
    found = Recording.load(path, columns=columns)
    assert [row for row, _ in found.report.dropped] == [2]
    np.testing.assert_allclose(found.q[:, 1], np.radians(0.5))


def test_quoted_decimal_commas_between_commas_are_refused(tmp_path: Path) -> None:
    """Without their quotes they were two numbers each, and other columns were read."""
    text = [f'{10 * i},"0,{123 + i}","0,500"' for i in range(50)]
    columns = {"time": {"column": 1, "unit": "ms"}, "position": {"columns": [2, 3]}}
    with pytest.raises(InputError, match=r"line 1: the quoted field '0,123' holds a ',', which separates fields here"):
        Recording.load(written(tmp_path, text), columns=columns)
    for advised in (";", "\t"):
        path = written(tmp_path, [line.replace(',"', f'{advised}"') for line in text])
        assert Recording.load(path, columns=columns).q[1].tolist() == [0.124, 0.5]
    words = [f'{0.01 * i:.2f},"so, it said","{i}","1"' for i in range(50)]
    shifted: dict[str, Any] = {"time": {"column": 1}, "position": {"columns": [3, 4]}}
    assert Recording.load(written(tmp_path, words), columns=shifted).q[7].tolist() == [7.0, 1.0]


@pytest.mark.parametrize(("unit", "size"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_the_unit_of_a_time_is_one_that_makes_seconds_of_it(unit: str, size: float, tmp_path: Path) -> None:
    """Of nanoseconds the note asked whether they are milliseconds: the rows would be 10 000 s apart."""
    log = recording()
    replace(log, t=size * log.t).save(tmp_path / "log.parquet")
    (note,) = [note for note in Recording.load(tmp_path / "log.parquet").report.notes if "s apart" in note]
    assert f'(time = {{ ..., unit = "{unit}" }})' in note
