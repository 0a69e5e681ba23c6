"""Which law a table obeys: planted laws are found, the TM5-700 stops in constant time, and numbers cover every row."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

import bumpstop as bs
from bumpstop.collision.stopping import StoppingTable, fit_stopping, load_stopping_table
from bumpstop.collision.stopping.deceleration_laws import LAWS, ramp_distance

ROOT = Path(__file__).resolve().parents[3]
TM5_700 = ROOT / "examples" / "stopping" / "tm5_700.toml"


def planted(name: str, scale: np.ndarray, shape: np.ndarray, *, noise: float = 0.0, seed: int = 1) -> StoppingTable:
    """Three joints, four speeds, payloads and extensions that change the scale as ``scale`` says (2, 2)."""
    rng = np.random.default_rng(seed)
    rows = [(p, e, v) for p in (0, 1) for e in (0, 1) for v in (0.4, 1.0, 2.0, 3.0)]
    speed = np.repeat([[v] for *_, v in rows], 3, axis=1) * [1.0, 0.9, 1.3]
    scales = np.array([scale[p, e] for p, e, _ in rows])[:, None] * [1.0, 1.2, 0.8]
    distance = LAWS[name].distance(speed, scales, shape) * np.exp(noise * rng.normal(size=speed.shape))
    return StoppingTable(
        source="planted",
        joints=(1, 2, 3),
        payload=np.array([p / 2 + 0.5 for p, *_ in rows]),
        payload_unit="share",
        extension=np.array([e / 2 + 0.5 for _, e, _ in rows]),
        speed=speed,
        distance=distance,
        time=np.full(speed.shape, np.nan),
        full_speed=np.full(3, np.nan),
        linear=False,
        row=tuple(range(1, len(rows) + 1)),
    ).checked()


SCALE = np.array([[1.0, 1.3], [0.9, 1.1]])


@pytest.mark.parametrize(
    ("name", "scale", "shape"),
    [
        ("constant_time", 0.3, []),
        ("constant", 4.0, [0.0]),
        ("constant", 4.0, [0.05]),
        ("ramp", 8.0, [0.03, 0.3]),
    ],
)
@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_a_planted_law_is_found(name: str, scale: float, shape: list[float], noise: float) -> None:
    table = planted(name, scale * SCALE, np.array(shape), noise=noise)
    fit = fit_stopping(table)
    assert fit.law == name
    found = fit.fits[name]
    assert found.median_error < 1e-4 + 3 * noise
    if noise == 0:
        np.testing.assert_allclose(found.scale[0], scale * SCALE.ravel(), rtol=0.01)
        np.testing.assert_allclose(found.shape[0], shape, atol=2e-3)


def test_the_tm5_700_stops_in_constant_time() -> None:
    """Figures that the maker's table was found to have: exponent of the distance over speed, leave-one-out errors."""
    fit = fit_stopping(load_stopping_table(TM5_700))
    assert fit.law == "constant_time"
    assert (np.abs(fit.exponent - 1) < 0.03).all()
    one = fit.fits["constant_time"]
    assert one.median_error < 0.02
    assert one.worst_error < 0.15
    np.testing.assert_allclose(one.scale, 0.30, atol=0.025)


def test_errors_leave_the_row_out() -> None:
    """By hand: the stopping time of the other two rows of a combination predicts the third."""
    table = load_stopping_table(TM5_700)
    errors = fit_stopping(table).fits["constant_time"].errors
    time = 2 * table.distance / table.speed
    i, k = 5, 2  # the worst of all
    assert errors[i, k] == pytest.approx(time[i, k] / np.sqrt(time[i - 1, k] * time[i - 2, k]) - 1)
    assert abs(errors[i, k]) == np.nanmax(np.abs(errors))


@given(
    v=st.floats(0.01, 6),
    a=st.floats(0.5, 50),
    dead=st.floats(0, 0.3),
    ramp=st.floats(0.001, 1),
)
def test_the_distance_of_a_ramp_is_its_speed_integrated(v: float, a: float, dead: float, ramp: float) -> None:
    def speed(t: float) -> float:
        return v - (a * t * t / (2 * ramp) if t < ramp else a * (t - ramp / 2))

    end = (2 * v * ramp / a) ** 0.5 if v <= a * ramp / 2 else ramp / 2 + v / a
    assert speed(end) == pytest.approx(0, abs=1e-9 * v)
    area, _ = quad(speed, 0, end, points=[ramp] if ramp < end else None, epsabs=1e-12)
    found = ramp_distance(np.array([v]), np.array([a]), np.array([dead, ramp]))[0]
    assert found == pytest.approx(v * dead + area, rel=1e-8)


@pytest.mark.parametrize("law", ["constant_time", "constant", "ramp"])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_what_is_written_covers_every_row(law: str, noise: float) -> None:
    shape = {"constant_time": [], "constant": [0.05], "ramp": [0.02, 0.1]}[law]
    table = planted(law, {"constant_time": 0.3}.get(law, 5.0) * SCALE, np.array(shape), noise=noise)
    keys = fit_stopping(table, law).reaction
    assert keys["deceleration"] == law
    if law == "constant_time":
        most = table.speed * keys["stopping_time_s"] / 2
    else:
        times = np.array([keys[f"{name}_s"] for name in ("dead_time", "ramp_time") if f"{name}_s" in keys])
        most = LAWS[law].distance(table.speed, np.full(1, keys["joint_acceleration_rad_s2"]), times)
    assert (most >= table.distance * (1 - 1e-9)).all()
    if noise == 0:  # and no more than the worst row needs
        assert (most / table.distance).min() < 1.02


def test_of_brakes_the_table_itself_is_recommended(tmp_path: Path) -> None:
    slowest, dead = np.array([4.7, 3.0, 5.1, 9.5, 6.6, 14.5]), 0.027
    speeds = np.array([2, 10, 30, 60, 120]) * np.pi / 180
    cells = [[v, *(v * dead + v**2 / (2 * slowest))] for v in speeds]
    for category, told in ((0, True), (1, False)):
        names = ["speed_rad_s", *(f"STOP {category} distance J{j}_rad" for j in range(1, 7))]
        (tmp_path / "table.csv").write_text("\n".join([",".join(names), *(",".join(map(str, row)) for row in cells)]))
        fit = fit_stopping(load_stopping_table(tmp_path / "table.csv"))
        assert ("stop_category = 0" in fit.reaction_toml) == told
        assert tomllib.loads(fit.reaction_toml)["reaction"] == fit.reaction


@pytest.mark.parametrize("rounding", [0.0, 1e-4])
def test_a_deceleration_that_the_dead_time_leaves_open_is_one_that_a_scenario_takes(
    tmp_path: Path, rounding: float
) -> None:
    rows = [f"{v},{0.1 * v + (rounding if v > 30 else 0.0):.6g}\n" for v in (30, 60, 90)]
    (tmp_path / "table.csv").write_text("speed_deg_s,distance_1_deg\n" + "".join(rows))
    reaction = fit_stopping(load_stopping_table(tmp_path / "table.csv"), "constant").reaction
    assert reaction["dead_time_s"] == 0.1
    assert reaction["joint_acceleration_rad_s2"] == 1e5


def test_below_the_slowest_row_the_table_itself_is_recommended() -> None:
    """There a constant deceleration stops sooner than the table, which takes as long as in its slowest row."""
    said = 'Where a scenario may be slower, name the table itself (deceleration = "table")'
    fit = fit_stopping(planted("constant", 4.0 * SCALE, np.array([0.05])))
    assert said in fit.reaction_toml
    assert str(fit).count(said) == 1
    # A scenario takes no lengths of the tool centre point.
    lengths = fit_stopping(replace(planted("constant_time", 0.3 * SCALE, np.zeros(0)), linear=True))
    assert said not in lengths.reaction_toml


def test_two_speeds_do_not_tell_laws_with_more_numbers() -> None:
    table = planted("constant_time", 0.3 * SCALE, np.zeros(0))
    two = table._only(np.flatnonzero(np.isin(table.speed[:, 0], (0.4, 3.0))))
    fit = fit_stopping(two)
    assert fit.law == "constant_time"
    assert "ramp" not in fit.fits
    assert any("two speeds" in note for note in fit.notes)
    with pytest.raises(bs.InputError, match="more numbers"):
        fit_stopping(two, "ramp")


def test_a_combination_with_one_row_does_not_hinder() -> None:
    table = planted("constant", 4.0 * SCALE, np.array([0.0]))
    holed = replace(table, distance=np.where(np.arange(16)[:, None] % 4 == 0, table.distance, np.nan))
    mixed = replace(table, distance=np.where(np.arange(16)[:, None] < 13, table.distance, np.nan))
    assert fit_stopping(mixed).law == "constant"
    with pytest.raises(bs.InputError, match="one speed"):
        holed.checked()


def test_lengths_say_a_stopping_time_and_no_joint_acceleration() -> None:
    table = replace(planted("constant", 4.0 * SCALE, np.array([0.0])), linear=True)
    with pytest.raises(bs.InputError, match="reach_mm"):
        _ = fit_stopping(table).reaction
    timed = replace(planted("constant_time", 0.3 * SCALE, np.zeros(0)), linear=True)
    assert fit_stopping(timed).reaction["stopping_time_s"] == pytest.approx(0.3 * 1.3 * 1.2, abs=2e-4)
