"""The joint torque model: against its equations, its memory, its file, and what it refuses."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.joint import JointParameters, JointTorqueModel, Parameter, TorqueState, joint_models
from bumpstop.model import robots

FRICTIONS: dict[str, dict[str, float]] = {
    "power": {"D": 250.0, "F": 0.3},
    "stribeck": {"coulomb": 60.0, "viscous": 40.0, "stribeck": 30.0, "stribeck_speed": 0.2},
    "load_dependent": {"coulomb": 60.0, "viscous": 40.0, "load": 0.15},
}
MAPS: dict[str, dict[str, float]] = {
    "odd": {"A": 3e-5, "B": 0.1},
    "load_dependent": {"A": 3e-5, "B": 0.1},
    "linear": {"B": 0.1},
}
KINDS = [(m, f) for m in MAPS for f in FRICTIONS]
REST = 0.02


def joint(kind: str = "odd", friction: str = "power", **changes: Any) -> JointParameters:
    figures = MAPS[kind] | FRICTIONS[friction] | {"hysteresis": 6.0, "inertia": 0.7}
    figures |= {name: changes.pop(name) for name in list(changes) if name in figures}
    settings: dict[str, Any] = {
        "name": "elbow",
        "map": kind,
        "friction": friction,
        "parameters": {name: Parameter(value, 0.01) for name, value in figures.items()},
        "current_range": (-900.0, 800.0),
        "speed_range": (0.1, 1.5),
        "rest_speed": REST,
    }
    return JointParameters(**settings | changes)


def model(*joints: JointParameters) -> JointTorqueModel:
    return JointTorqueModel(robot="arm", created_from="a test", unit="controller", joints=joints or (joint(),))


def plain_torque(j: JointParameters, i: np.ndarray, qd: np.ndarray, qdd: np.ndarray, direction: float) -> np.ndarray:
    """Eqs 2.22 to 2.30 written out, at one sample after another; ``direction`` is that of the motion before."""
    v = {name: parameter.value for name, parameter in j.parameters.items() if parameter}
    low, high = j.current_range or (-np.inf, np.inf)
    out = []
    for current, rate, acceleration in zip(i, qd, qdd, strict=True):
        sign = float(np.clip(rate / j.rest_speed, -1, 1))
        if j.friction == "power":
            friction = sign * v["D"] * max(abs(rate), j.rest_speed) ** v["F"]
        elif j.friction == "stribeck":
            dip = np.exp(-((rate / v["stribeck_speed"]) ** 2))
            friction = sign * (v["coulomb"] + v["stribeck"] * dip) + v["viscous"] * rate
        else:
            friction = sign * (v["coulomb"] + v["load"] * abs(current)) + v["viscous"] * rate
        ij = current - friction
        x = min(max(ij, low), high)
        a = v.get("A", 0.0)
        f, slope = v["B"] * x + a * x * abs(x), v["B"] + 2 * a * abs(x)
        if j.map == "load_dependent":
            f, slope = v["B"] * x - sign * a * x**2, v["B"] - 2 * sign * a * x
        at_rest = float(np.clip(2 - abs(rate) / j.rest_speed, 0, 1))
        if at_rest == 0:
            direction = np.sign(rate)
        out.append(f + slope * (ij - x) - v["inertia"] * acceleration - v["hysteresis"] * direction * at_rest)
    return np.array(out)


def samples(count: int = 500, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    slow = rng.random(count) < 0.5
    rate = rng.uniform(-1, 1, count) * np.where(slow, 3 * REST, 3.0)
    return rng.uniform(-1500, 1500, count), rate, rng.normal(size=count)


@pytest.mark.parametrize(("kind", "friction"), KINDS)
def test_against_the_equations(kind: str, friction: str) -> None:
    j = joint(kind, friction)
    i, qd, qdd = samples()
    tau = model(j).torque(i[:, None], qd[:, None], qdd[:, None])
    np.testing.assert_allclose(tau[:, 0], plain_torque(j, i, qd, qdd, 0.0), rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize(("kind", "friction"), KINDS)
def test_symmetry(kind: str, friction: str) -> None:
    m = model(joint(kind, friction, current_range=(-800.0, 800.0)))
    i, qd, qdd = (x[:, None] for x in samples())
    assert (m.torque(-i, -qd, -qdd) == -m.torque(i, qd, qdd)).all()


@pytest.mark.parametrize(("kind", "friction"), KINDS)
def test_continuous_through_zero_speed(kind: str, friction: str) -> None:
    """There and back through rest, in steps that halve: the largest step of the torque halves too."""
    m = model(joint(kind, friction))
    jumps = []
    for count in (4001, 8001):
        qd = np.concatenate([np.linspace(0.1, -0.1, count), np.linspace(-0.1, 0.1, count)])[:, None]
        jumps.append(np.abs(np.diff(m.torque(np.full_like(qd, 300.0), qd), axis=0)).max())
    assert 0 < jumps[1] < 0.51 * jumps[0]


def test_friction_opposes_motion() -> None:
    m = model(joint(hysteresis=0.0))
    assert m.torque([0.0], [1.0]) < 0 < m.torque([0.0], [-1.0])
    assert m.torque([0.0], [0.0]) == 0


def test_hysteresis_remembers_the_last_motion() -> None:
    m = model(joint())
    unpadded = model(joint(hysteresis=0.0)).torque([300.0], [0.0])
    assert m.torque([300.0], [0.0]) == unpadded  # no motion yet
    for direction in (1, -1):
        state = TorqueState.at_rest(1)
        m.torque([300.0], [direction * 0.5], state=state)
        assert state.direction == direction
        m.torque([300.0], [-direction * 1.9 * REST], state=state)
        assert state.direction == direction  # too slow to be a motion
        assert m.torque([300.0], [0.0], state=state) == pytest.approx(unpadded - direction * 6)


def test_state_joins_two_halves() -> None:
    m = model(joint(), replace(joint(), name="wrist"))
    i, qd, qdd = (np.stack([x, -x], axis=1) for x in samples())
    state, whole = TorqueState.at_rest(2), TorqueState.at_rest(2)
    halves = [m.torque(i[part], qd[part], qdd[part], state) for part in (slice(0, 211), slice(211, None))]
    assert (np.concatenate(halves) == m.torque(i, qd, qdd, whole)).all()
    one_by_one = TorqueState.at_rest(2)
    single = [m.torque(*row, state=one_by_one) for row in zip(i, qd, qdd, strict=True)]
    assert (np.array(single) == np.concatenate(halves)).all()
    for name in ("direction", "outside_current", "outside_speed"):
        assert (getattr(state, name) == getattr(whole, name)).all()
        assert (getattr(one_by_one, name) == getattr(whole, name)).all()


def test_inertia_is_subtracted() -> None:
    m = model(joint())
    assert m.torque([300.0], [0.5]) - m.torque([300.0], [0.5], [2.0]) == pytest.approx(1.4)


def test_beyond_the_range_the_map_is_a_line_and_it_is_counted() -> None:
    m = model(joint(D=0.0))
    state = TorqueState.at_rest(1)
    i = np.array([700.0, 800.0, 900.0, 1000.0, 2000.0])[:, None]
    tau = m.torque(i, np.full_like(i, 0.5), state=state)[:, 0]
    slope = 0.1 + 2 * 3e-5 * 800
    np.testing.assert_allclose(tau[2:], tau[1] + slope * (i[2:, 0] - 800))
    assert tau[1] - tau[0] != pytest.approx(slope * 100)
    assert (state.outside_current, state.outside_speed) == (3, 0)
    m.torque(i[:2], [[1.6], [-1.7]], state=state)
    assert state.outside_speed == 2
    assert m.notes(state) == (
        "elbow: 3 samples outside the fitted range of current, extrapolated linearly",
        "elbow: 2 samples faster than the fitted range of speed",
    )
    assert m.notes() == ()


# --- Schroeder's model ----------------------------------------------------------------------------------------


def test_sia5d_is_table_2_2() -> None:
    """Typed a second time from the table. Hysteresis is what is subtracted, so its sign is not the table's."""
    m = JointTorqueModel.load("sia5d")
    assert joint_models() == ("sia5d",)
    arm = next(robot for robot in robots() if robot == "sia5d")
    assert m.robot == arm
    table = [
        (3.36e-5, 0.112, 295.724, 0.322, 4, 13.6),
        (2.26e-5, 0.117, 267.345, 0.290, 8, 17.6),
        (3.30e-5, 0.094, 233.976, 0.327, 3, 14.9),
        (3.93e-5, 0.065, 217.814, 0.288, 4, 15.4),
        (1.75e-4, 0.022, 285.269, 0.334, 5, 17.3),
        (5.95e-5, 0.034, 456.312, 0.369, 5, 21.6),
    ]
    found = [(*(j.value(name) for name in ("A", "B", "D", "F", "hysteresis")), j.friction_sd) for j in m.joints]
    assert found == table
    assert {j.map for j in m.joints} == {"odd"}
    # 500 units at 1 rad/s along joint 2: 232.655 are left.
    tau = m.torque([0, 500, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0])
    assert tau[1] == pytest.approx(0.117 * 232.655 + 2.26e-5 * 232.655**2)


def test_sia5d_says_what_is_unknown() -> None:
    notes = " ".join(JointTorqueModel.load("sia5d").notes())
    for word in (
        "sign of A",
        "rad/s assumed",
        "unit of current",
        "fitted range",
        "inertia",
        "joint 7",
        "standard errors",
    ):
        assert word in notes


def test_the_sources_minus_sign_is_refused_for_joint_5() -> None:
    """With the minus its torque peaks at 0.7 Nm."""
    peak = 0.022**2 / (4 * 1.75e-4)
    assert peak == pytest.approx(0.7, abs=0.05)
    with pytest.raises(InputError, match=r"joint elbow map: 'odd' .* slope is zero at a joint current of 62.857"):
        joint(A=-1.75e-4, B=0.022)


# --- Monotone maps ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "A"), [("odd", -1e-4), ("load_dependent", 1e-4), ("load_dependent", -1e-4)])
def test_maps_must_be_monotone_over_their_range(kind: str, A: float) -> None:
    """The slope 0.1 - 2e-4 i is zero at 500."""
    for current_range in ((-499.0, 300.0), (-300.0, 499.0)):
        m = model(joint(kind, A=A, current_range=current_range, D=0.0, hysteresis=0.0))
        for qd in (-1.0, 0.0, 1.0):
            i = np.linspace(-2000, 2000, 4001)[:, None]
            assert (np.diff(m.torque(i, np.full_like(i, qd)), axis=0) > 0).all()
    for refused in ((-501.0, 300.0), (-300.0, 501.0), None):
        with pytest.raises(InputError, match=f"joint elbow map: '{kind}' with A = .* is not monotone"):
            joint(kind, A=A, current_range=refused)


def test_a_map_needs_a_gain() -> None:
    with pytest.raises(InputError, match=r"joint elbow map: 'linear' .* not monotone"):
        joint("linear", B=0.0)


# --- Files -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "friction"), KINDS)
def test_round_trip(kind: str, friction: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(len(kind) + len(friction))
    given = joint(kind, friction, name='el"bow\\ \x7f\n\u00e9')
    unknown = replace(
        given,
        name="wrist",
        parameters={
            k: p if k in ("A", "B") else Parameter(p.value * rng.random(), None)
            for k, p in given.parameters.items()
            if p
        }
        | {"inertia": None},
        current_range=None if kind != "load_dependent" else (-1 / 3, 1e-7),
        speed_range=None,
        friction_sd=1 / 3,
    )
    whole = replace(model(given, unknown), note="a\tnote", unit="A")
    whole.save(tmp_path / "model.toml")
    assert JointTorqueModel.load(tmp_path / "model.toml") == whole
    assert JointTorqueModel.load(str(tmp_path / "model.toml")) == whole


def test_builtin_round_trip(tmp_path: Path) -> None:
    m = JointTorqueModel.load("sia5d")
    copy = tmp_path / "copy.toml"
    m.save(copy)
    assert JointTorqueModel.load(copy) == m
    # As an editor on Windows saves it.
    copy.write_bytes(b"\xef\xbb\xbf" + copy.read_bytes().replace(b"\n", b"\r\n"))
    assert JointTorqueModel.load(copy) == m


GOOD = """robot = "arm"
created_from = "a test"
unit = "A"

[[joint]]
name = "elbow"
map = "odd"
A = { value = 0.5, standard_error = 0.1 }
B = { value = 10.0, standard_error = 0.1 }
D = { value = 1.0, standard_error = "unknown" }
F = { value = 0.3, standard_error = 0.1 }
hysteresis = { value = 4.0, standard_error = 0.1 }
inertia = "unknown"
current_range = [-5, 5]
speed_range = [0.1, 2]
"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('unit = "A"', 'unit = "Nm"', "unit: 'Nm' is no unit of current; valid: A, controller"),
        ('unit = "A"', "", "unit: is missing"),
        ('robot = "arm"', 'robbot = "arm"', "robbot: is not a key of a joint model; did you mean 'robot'?"),
        ('robot = "arm"', "robot = 3", "robot: 3 cannot be used; wanted text"),
        ('name = "elbow"', "", "joint[1].name: is missing"),
        ('map = "odd"', 'map = "od"', "joint elbow map: 'od' is no map; did you mean 'odd'?"),
        ('map = "odd"', "", "joint elbow map: is missing"),
        ('map = "odd"', 'map = "linear"', "joint elbow A: is no parameter of map 'linear' with friction 'power'"),
        ('map = "odd"', 'map = "odd"\nfriction = "dry"', "joint elbow friction: 'dry' is no friction law"),
        ('map = "odd"', 'map = "odd"\nfriction = "stribeck"', "joint elbow D: is no parameter of map 'odd'"),
        ("F = {", "f = {", "joint elbow f: is not a key of a joint model"),
        ("F = { value = 0.3, standard_error = 0.1 }", "", "joint elbow F: is missing"),
        ("F = { value = 0.3", "F = { value = nan", "joint elbow F.value: is nan; wanted a finite number"),
        ("F = { value = 0.3", "F = { value = -0.3", "joint elbow F.value: is -0.3; wanted from 0 to 3"),
        ("F = { value = 0.3", "F = { valu = 0.3", "joint elbow F.valu: is not a key of a joint model"),
        ("F = { value = 0.3, standard_error = 0.1 }", "F = 0.3", "joint elbow F: 0.3 cannot be used"),
        (
            "F = { value = 0.3, standard_error = 0.1 }",
            "F = { value = 0.3 }",
            "joint elbow F.standard_error: is missing",
        ),
        ("0.3, standard_error = 0.1", "0.3, standard_error = -1", "joint elbow F.standard_error: is -1.0; wanted zero"),
        ("0.3, standard_error = 0.1", "0.3, standard_error = true", "joint elbow F.standard_error: True is not"),
        ("D = { value = 1.0", 'D = { value = "1"', "joint elbow D.value: '1' is not a number"),
        ("D = { value = 1.0", "D = { value = -1", "joint elbow D.value: is -1.0; wanted at least 0"),
        ("A = { value = 0.5", "A = { value = -1.5", "joint elbow map: 'odd' with A = -1.5, B = 10 is not monotone"),
        ("[-5, 5]", "[5, -5]", "joint elbow current_range: is [5.0, -5.0]"),
        ("[-5, 5]", "[-5, nan]", "joint elbow current_range[1]: is nan"),
        ("[-5, 5]", "[-5, 0, 5]", "joint elbow current_range: has shape (3,)"),
        ("current_range = [-5, 5]", "", "joint elbow current_range: is missing"),
        ("[0.1, 2]", "[-2, 2]", "joint elbow speed_range: is [-2.0, 2.0]"),
        ("[0.1, 2]", "[0.1, 2]\nrest_speed = 0", "joint elbow rest_speed: is 0; wanted at least 1e-6 rad/s"),
        ("[0.1, 2]", '[0.1, 2]\nrest_speed = "slow"', "joint elbow rest_speed: 'slow' is not a number"),
        ("[0.1, 2]", "[0.1, 2]\nfriction_sd = -1", "joint elbow friction_sd: is -1; wanted zero or more"),
        ('inertia = "unknown"', "inertia = { value = -1, standard_error = 0 }", "joint elbow inertia.value: is -1.0"),
        ("[[joint]]", "[joint]", "joint: is not a list of tables"),
        ('unit = "A"', "unit = ", "is not valid TOML"),
    ],
)
def test_files_are_read_strictly(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text(GOOD)
    JointTorqueModel.load(path)
    assert old in GOOD
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(InputError, match=re.escape(message)) as refused:
        JointTorqueModel.load(path)
    assert str(path) in str(refused.value)


@pytest.mark.parametrize("figure", ["value", "standard_error"])
def test_a_figure_that_no_arm_has_is_refused(figure: str, tmp_path: Path) -> None:
    """Torques of it are infinite, and were an internal fault where they are written."""
    path = tmp_path / "joints.toml"
    JointTorqueModel.load("sia5d").save(path)
    text = path.read_text(encoding="utf-8")
    start = text.index("B = ")
    line = text[start : text.index("\n", start)]
    huge = re.sub(rf"{figure} = [^,}}]+", f"{figure} = 1e308 ", line)
    path.write_text(text.replace(line, huge, 1), encoding="utf-8")
    with pytest.raises(InputError, match=rf"B.{figure}: is 1e\+308; wanted up to 1e\+12"):
        JointTorqueModel.load(path)


def test_the_file_of_the_documentation(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "robot" / "joint.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```toml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    path = tmp_path / "model.toml"
    path.write_text(re.sub(r"^# (note|friction_sd)", r"\1", example, flags=re.MULTILINE))
    loaded = JointTorqueModel.load(path)
    assert (loaded.note, loaded.joints[0].friction_sd, loaded.joints[0].speed_range) == ("...", 0.15, (0.1, 2.0))


def test_two_joints_of_one_name_and_none_at_all(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="joint elbow name: appears twice"):
        model(joint(), joint())
    path = tmp_path / "model.toml"
    path.write_text(GOOD[: GOOD.index("[[joint]]")])
    with pytest.raises(InputError, match="joint: is missing"):
        JointTorqueModel.load(path)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: JointTorqueModel.load("sia5"), "joint model: none is called 'sia5'; did you mean 'sia5d'?"),
        (lambda: JointTorqueModel.load("no/such.toml"), "joint model: 'no/such.toml' cannot be read (No such file"),
        (lambda: model().torque([[1.0], [1.0, 2.0]], [[0.0], [0.0]]), "current: rows of different lengths"),
        (lambda: model().torque([1.0, 2.0], [0.0, 0.0]), "current: has shape (2,); wanted (1,)"),
        (lambda: model().torque([[1.0]], [[0.0], [0.0]]), "qd: has shape (2, 1); wanted (1, 1)"),
        (lambda: model().torque([1.0], [0.0], [[0.0]]), "qdd: has shape (1, 1); wanted (1,)"),
        (lambda: model().torque([np.nan], [0.0]), "current[0]: is nan"),
        (lambda: model().torque([1.0], [0.0], state=TorqueState.at_rest(2)), "state.direction: has shape (2,)"),
    ],
)
def test_refusals(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        call()


def test_a_model_does_not_change() -> None:
    j = joint()
    with pytest.raises(TypeError):
        j.parameters["A"] = Parameter(1.0)  # type: ignore[index]
    with pytest.raises(AttributeError):
        j.map = "linear"  # type: ignore[misc]
