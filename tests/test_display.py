"""Results that show themselves: figure, page of a notebook, data frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import polars as pl
import pytest
from matplotlib.figure import Figure

import bumpstop as bs
from bumpstop.model import inverse_dynamics
from bumpstop.study import run

ROOT = Path(__file__).resolve().parents[1]
HAND = ROOT / "examples" / "01_hand_downward.toml"


def recording() -> bs.Recording:
    """A UR5e that swings all joints, with noise, and is pushed at the end."""
    robot, rng = bs.Robot.load("ur5e"), np.random.default_rng(3)
    t = np.arange(0, 12, 0.008)
    phase = np.outer(t, 2 * np.pi * np.array([0.1, 0.17, 0.23, 0.31, 0.37, 0.43]))
    q = np.array([0, -1.2, 1.4, -0.5, 0.3, 0.2]) + 0.4 * np.sin(phase)
    rates = np.gradient(q, t, axis=0)
    tau = inverse_dynamics(robot, q, rates, np.gradient(rates, t, axis=0)) + 0.2 * rng.normal(size=q.shape)
    tau[1300:1340] += 25
    return bs.Recording(t=t, q=q, tau=tau, robot="ur5e")


@pytest.fixture(scope="module")
def shown() -> dict[str, Any]:
    log, scenario = recording(), bs.load_scenario(HAND)
    result = bs.evaluate(scenario)
    study = bs.ParameterStudy.of(scenario, ["motion.speed=20:60"])
    return {
        "result": result,
        "curve": result.curve,
        "run": bs.detect(log, bs.Robot.load("ur5e"), None, [20, 20, 20, 10, 10, 10]),
        "study": run(study),
        "fit": bs.identify_dynamics(log.between(0, 10), bs.Robot.load("ur5e"), cutoff_hz=6),
        "uncertain": bs.evaluate_uncertain(bs.load_scenario(ROOT / "examples" / "07_hand_uncertain.toml")),
    }


@pytest.mark.parametrize("name", ["result", "curve", "run", "study", "fit", "uncertain"])
def test_a_notebook_shows_text_and_figure(shown: dict[str, Any], name: str) -> None:
    page = shown[name]._repr_html_()
    first = str(shown[name]).splitlines()[0][:20].replace("&", "&amp;").replace("<", "&lt;")
    assert first in page
    assert page.count("<svg") == page.count("</svg>") == 1
    assert "<script" not in page
    axes = Figure().add_subplot()
    assert shown[name].plot(axes) is axes
    assert axes.get_xlabel()


def test_text_stays_text_in_a_notebook(shown: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """There rich would show what it prints by itself, and the text would be empty."""
    expected = {name: str(shown[name]) for name in ("result", "run", "uncertain")}
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    assert {name: str(shown[name]) for name in expected} == expected
    assert all(expected.values())


def test_a_figure_of_its_own(shown: dict[str, Any]) -> None:
    with mpl.rc_context({"backend": "agg"}):
        axes = shown["result"].plot()
    force, probability = axes.lines[0].get_data()
    middle = len(force) // 2
    assert probability[middle] == pytest.approx(shown["result"].peak_force.exceedance(force[middle]))
    assert axes.get_legend().get_texts()[0].get_text() == "allowed force"
    allowed = next(line for line in axes.lines if line.get_label() == "allowed force").get_xdata()[0]
    assert allowed == pytest.approx(min(135.0, 60.0 * 2.0))


def test_the_tornado_chart_has_the_widest_bar_on_top(shown: dict[str, Any]) -> None:
    axes = shown["uncertain"].plot(Figure().add_subplot())
    widths = [bar.get_width() for bar in axes.patches]
    assert len(widths) == len(shown["uncertain"].tornado)
    assert widths == sorted(widths, reverse=True)


def test_data_frames(shown: dict[str, Any]) -> None:
    run_frame, fit_frame = shown["run"].to_frame(), shown["fit"].to_frame()
    assert run_frame.columns[:3] == ["t", "state", "residual_1"]
    over = run_frame.filter(pl.col("residual_2").abs() > pl.col("threshold_2"))["t"]
    pushed = ((over > 10.4) & (over < 10.72)).mean()
    assert over.len() > 20
    assert pushed > 0.7  # the derivative of a window sees the beginning of the motion, too
    assert (
        fit_frame.filter(pl.col("name") == shown["fit"].names[0].split()[0])["value"][0] == shown["fit"].model.values[0]
    )
    assert shown["result"].to_frame()["peak_force_N"].is_sorted()
    assert shown["study"].to_frame() is shown["study"].rows


def test_a_recording_goes_through_a_data_frame_unchanged() -> None:
    log = recording()
    frame = log.to_frame().with_columns(pl.lit("x").alias("remark"))
    back = bs.Recording.from_frame(frame, robot="ur5e")
    assert back.robot == "ur5e"
    for name in ("t", "q", "tau"):
        np.testing.assert_array_equal(getattr(back, name), getattr(log, name))
    assert back.current is None


@pytest.mark.parametrize(
    ("frame", "problem"),
    [
        ({"t": [0.0]}, "is a dict"),
        (pl.DataFrame({"q_1": [0.0]}), "has no column 't'"),
        (pl.DataFrame({"t": [0.0, 1.0], "q_1": [0.0, 1.0], "tau_1": [0.0, float("nan")]}), "recording.tau"),
    ],
)
def test_frames_that_cannot_be_used(frame: Any, problem: str) -> None:
    with pytest.raises(bs.InputError, match=problem):
        bs.Recording.from_frame(frame)


def test_a_fit_without_errors_draws_nothing() -> None:
    from bumpstop.display import draw_parameters

    with pytest.raises(bs.InputError, match="no parameter"):
        draw_parameters(Figure().add_subplot(), {"m": 1.0}, {"m": None})
