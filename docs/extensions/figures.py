"""The figures of the theory pages, each computed by the library when the site is built."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import norm

import bumpstop as bs
from bumpstop.detection import undetectable_forces
from bumpstop.report.picture import EVENT, FAINT, LAW, LIMIT, Picture, axes, stack

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def _logarithmic(panel: Axes) -> None:
    """Plain numbers on a logarithmic scale: the pages' style takes no mathematical text."""
    panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    panel.yaxis.set_minor_formatter(lambda value, _: "")


def stopping_curve(figure: Figure) -> None:
    """Distance at each control cycle and stopping distance of a reaction to it, and their difference."""
    curve = bs.evaluate(bs.load_scenario(EXAMPLES / "02_lower_arm_downward.toml")).curve
    time, upper_lower = 1e3 * curve.tick_time, stack(figure, [2, 1])
    upper, lower = upper_lower
    upper.plot(time, 1e3 * curve.max_distance, color=LAW, label="s_stop(k): farthest, reacting to cycle k")
    upper.plot(time, 1e3 * curve.tick_distance, color=EVENT, linestyle="--", label="s(k): at cycle k")
    upper.set_ylabel("distance, mm")
    upper.legend(loc="upper left")
    lower.plot(time, 1e3 * (curve.max_distance - curve.tick_distance), color=LIMIT)
    lower.set_ylim(bottom=0)
    lower.set(ylabel="overtravel, mm", xlabel="time of the control cycle, ms")


def force_distribution(figure: Figure) -> None:
    """Exceedance of the peak force over 15 decades, with the limit and the accepted probability."""
    panel = axes(figure, left=0.8)
    for speed, style in ((-50, ":"), (-75, "-"), (-100, "--")):
        scenario = bs.load_scenario(EXAMPLES / "02_lower_arm_downward.toml", {"motion.velocity_mm_s": [0, 0, speed]})
        result = bs.evaluate(scenario)
        force = np.linspace(0, 320, 160)
        shown = np.array([result.peak_force.exceedance(one) for one in force])
        panel.semilogy(force, np.where(shown > 0, shown, np.nan), style, color=LAW, label=f"{-speed} mm/s")
    limit = result.verdict.limits.allowed_force_N(2.0) if result.verdict.limits else math.nan
    panel.axvline(limit, color=LIMIT)
    panel.axhline(result.verdict.accepted_probability, color=FAINT, linewidth=1)
    panel.set(xlabel="force, N", ylabel="probability of a larger peak force", ylim=(1e-15, 2), xlim=(0, 320))
    panel.legend(loc="upper right")
    _logarithmic(panel)


def elastic_arm(figure: Figure) -> None:
    """Peak force against speed, of a rigid arm and of one whose gears and servos give."""
    panel, speeds = axes(figure), np.array([40, 80, 120, 160, 200])
    for model, style, colour in (("rigid", "-", LAW), ("elastic", "--", LIMIT)):
        forces = []
        for speed in speeds:
            changes = {"arm.model": model, "motion.velocity_mm_s": [0, 0, -float(speed)]}
            scenario = bs.load_scenario(EXAMPLES / "05_ur10e.toml", changes)
            forces.append(bs.evaluate(scenario).peak_force.quantile(0.5))
        panel.plot(speeds, forces, style, color=colour, marker="o", label=f"{model} arm")
    panel.set(xlabel="speed, mm/s", ylabel="median peak force, N", ylim=(0, None), xlim=(0, None))
    panel.legend()


def thresholds(figure: Figure) -> None:
    """False alarms an hour of seven joints at 250 Hz against the threshold in standard deviations of white noise."""
    panel, level = axes(figure, left=0.8), np.linspace(3, 7.5, 200)
    for rate, style in ((250, "-"), (1000, "--")):
        tick = -np.expm1(7 * np.log1p(-2 * norm.sf(level)))
        panel.semilogy(level, 3600 * rate * tick, style, color=LAW, label=f"seven joints at {rate} Hz")
    panel.axhline(1, color=LIMIT, linewidth=1)
    panel.set(xlabel="threshold over standard deviation of the noise", ylabel="false alarms an hour")
    panel.legend()
    _logarithmic(panel)


def undetectable_force(figure: Figure) -> None:
    """Largest undetectable force at the tool of a UR10e while its elbow bends, at two sets of thresholds."""
    robot, panel, elbow = bs.Robot.load("ur10e"), axes(figure), np.linspace(5, 150, 120)
    q = np.deg2rad([[0, -60, angle, -30, 90, 0] for angle in elbow])
    for share, style in ((1.0, "-"), (0.5, "--")):
        found = undetectable_forces(robot, q, share * np.array([40, 40, 25, 12, 12, 12]))
        label = "thresholds 40 40 25 12 12 12 Nm" if share == 1 else "thresholds half as high"
        panel.plot(elbow, found.largest, style, color=LAW, label=label)
    panel.set(xlabel="elbow, deg", ylabel="force, N", ylim=(0, None))
    panel.legend()


def observer(figure: Figure) -> None:
    """A step of contact torque as the residual of a momentum observer shows it, at three gains."""
    panel, time = axes(figure), np.linspace(0, 0.2, 400)
    panel.axhline(1, color=FAINT, linewidth=1)
    for gain, style in ((10, ":"), (25, "--"), (50, "-")):
        panel.plot(1e3 * time, -np.expm1(-gain * time), style, color=LAW, label=f"K = {gain} 1/s")
        panel.plot(1e3 / gain, 1 - math.exp(-1), "o", color=EVENT)
    panel.set(xlabel="time after contact, ms", ylabel="residual over contact torque", ylim=(0, 1.1))
    panel.legend(loc="lower right")


PICTURES = [
    Picture("stopping_curve", "Two rising curves and their difference", "", stopping_curve, height=3.8),
    Picture("force_distribution", "Three falling curves on a logarithmic scale", "", force_distribution),
    Picture("elastic_arm", "Peak force against speed, two curves", "", elastic_arm),
    Picture("thresholds", "False alarms an hour fall steeply with the threshold", "", thresholds),
    Picture("undetectable_force", "Undetectable force against the elbow's angle", "", undetectable_force),
    Picture("observer", "Three exponential rises", "", observer),
]
