"""Which joint detects, and how long it takes."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.probability_text import percent
from bumpstop.collision.trajectory.trajectory_result import TrajectoryCollisionResult
from bumpstop.model import unit_of
from bumpstop.report.collision.bins import bins
from bumpstop.report.collision.distribution import draw_density
from bumpstop.report.formatting import quantity
from bumpstop.report.markup import Html, paragraph, table
from bumpstop.report.picture import AREA, FAINT, INK, LAW, Picture, axes
from bumpstop.report.section import Section
from bumpstop.terminal import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bumpstop.collision import Distribution

# Delays beyond this many p99 are not drawn: a tail of seconds would press all others into one line.
_FAR = 1.5


class DetectionSection(Section):
    """Trigger joints, detection delay, and what every joint would need to detect."""

    title = "Detection"
    anchor = "detection"

    def content(self) -> list[Html]:
        """Probabilities around detection, and a table of the joints."""
        result = self.result
        text = [
            paragraph(
                f"False alarm before contact: {self._percent(result.false_alarm_probability)}. "
                f"Never detected: {self._percent(result.undetected_probability)}. "
                f"Neither contact nor alarm: {self._percent(result.no_contact_probability)}. "
                f"Two or more joints in the same control cycle, given detection: "
                f"{self._percent(result.multi_joint_probability)}."
            )
        ]
        if not self._detects:
            text.append(paragraph("No collision is ever detected, so no joint triggers."))
        moving = isinstance(result, TrajectoryCollisionResult)
        caption = f"Joints as sensors at the {'hardest moment of contact' if moving else 'start of the motion'}"
        headings = (
            "joint", "threshold", "noise sd", "noise mean", "residual per 100 N", "force to reach the threshold",
            "over at detection",
        )  # fmt: skip
        text.append(table(headings, self._joints(), caption=caption, numbers=True))
        text.append(
            paragraph(
                "The force to reach the threshold is that of a contact along this motion's normal. Without noise "
                f"no force below the smallest of them is detected{' at that moment' if moving else ''}."
            )
        )
        return text

    def _joints(self) -> list[tuple[str, ...]]:
        result, problem = self.result, self.result.problem
        rows: list[tuple[str, ...]] = []
        # Before contact begins in a trajectory, it loads no joint.
        first = 0
        if isinstance(result, TrajectoryCollisionResult):
            first = int(np.searchsorted(result.curve.tick_time[:-1], result.onset, side="right"))
        for j, joint in enumerate(problem.robot.joints):
            unit = unit_of(joint)
            lever = abs(float(result.curve.torque_per_newton[first, j])) if result.curve.ticks else math.nan
            threshold = float(problem.thresholds[j])
            monitored = math.isfinite(threshold)
            # A rounding error is no lever: where the force does not load a joint, an infinite one is needed.
            needed = threshold / lever if lever > 1e-9 else math.inf
            rows.append(
                (
                    str(j + 1),
                    quantity(threshold, unit) if monitored else "not monitored",
                    quantity(float(problem.noise_sd[j]), unit),
                    quantity(float(problem.noise_mean[j]), unit),
                    quantity(100 * lever if lever > 1e-9 else 0.0, unit),
                    (quantity(needed, "N") if math.isfinite(needed) else "not detectable") if monitored else "",
                    self._percent(float(result.trigger_joint_probability[j])),
                )
            )
        return rows

    @cached_property
    def _detects(self) -> bool:
        return bool(np.isfinite(self.result.trigger_joint_probability).all())

    @cached_property
    def _delay(self) -> tuple[Distribution, str]:
        """Delay of detection and its unit: milliseconds, unless they are thousands."""
        seconds = self.result.detection_delay
        return (seconds, "s") if seconds.quantile(0.99) > 2 else (seconds.scaled(1e3), "ms")

    def pictures(self) -> list[Picture]:
        """Bars of the joints and the distribution of the delay, where there is a detection."""
        pictures = []
        if self._detects:
            shares = ", ".join(
                f"joint {j} {self._percent(float(p))}"
                for j, p in enumerate(self.result.trigger_joint_probability, start=1)
            )
            pictures.append(
                Picture(
                    "trigger_joints",
                    f"Bars: probability that each joint is over its threshold when the detector triggers. {shares}.",
                    "Joint over its threshold when the detector triggers, given detection. The bars may sum to more "
                    "than 100 %: several joints can trigger together.",
                    self._draw_joints,
                    height=0.85 + 0.27 * self.result.problem.robot.dof,
                )
            )
        delay, unit = self._delay
        edges = bins(delay, self.result.samples, most=_FAR * delay.quantile(0.99))
        if edges.size:
            middle, late = (quantity(delay.quantile(p), unit) for p in (0.5, 0.99))
            beyond = delay.exceedance(float(edges[-1]))
            left_out = f" {percent(beyond)} lie beyond the right edge." if beyond > 2e-4 else ""
            pictures.append(
                Picture(
                    "detection_delay",
                    f"Density of the time from touch to detection: median {middle}, p99 {late}.",
                    f"Time from touch to the control cycle of detection, given a detection after contact: median "
                    f"{middle}, p99 {late}. The feedback period is "
                    f"{1e3 * self.result.scenario.detector.feedback_period_s:g} ms.{left_out}",
                    lambda figure: self._draw_delay(figure, edges),
                    height=2.74,
                )
            )
        return pictures

    def _draw_joints(self, figure: Figure) -> None:
        problem, shares = self.result.problem, self.result.trigger_joint_probability
        panel = axes(figure, left=1.2, right=1.1, top=0.34)
        panel.set_title("Joint that triggers")
        numbers = np.arange(1, problem.robot.dof + 1)
        panel.barh(numbers, 100 * shares, height=0.66, color=AREA, edgecolor=LAW, hatch="//")
        for j, share in zip(numbers, shares, strict=True):
            monitored = math.isfinite(problem.thresholds[j - 1])
            text = self._percent(float(share)) if monitored else "not monitored"
            panel.annotate(
                text, (100 * share, j), (4, 0), textcoords="offset points", va="center", fontsize=8.5,
                color=INK if monitored else FAINT,
            )  # fmt: skip
        panel.set_yticks(numbers, [f"{j} {_short(problem.robot.joints[j - 1].name)}" for j in numbers])
        panel.invert_yaxis()
        panel.tick_params(axis="y", length=0)
        panel.set_xlim(0, 100)
        panel.set_xlabel("probability [%]")

    def _draw_delay(self, figure: Figure, edges: FloatArray) -> None:
        delay, unit = self._delay
        panel = axes(figure, left=0.75, top=0.34)
        panel.set_title("How long it takes")
        draw_density(panel, delay, edges)
        low, high = float(edges[0]), float(edges[-1])
        low = 0.0 if low < 0.6 * high else low
        panel.set_xlim(low, high + 0.06 * (high - low))
        panel.set_xlabel(f"detection delay [{unit}]")
        panel.set_ylabel(f"density [1/{unit}]")
        middle, late = (number(delay.quantile(p)) for p in (0.5, 0.99))
        panel.annotate(
            f"p50 {middle} {unit}, p99 {late} {unit}", (1, 1), (0, -2),
            xycoords="axes fraction", textcoords="offset points", ha="right", va="top", fontsize=8.5,
        )  # fmt: skip


def _short(name: str) -> str:
    """A joint's name, cut to what fits beside its bar."""
    name = name.removesuffix("_joint")
    return name if len(name) <= 13 else name[:12] + "…"
