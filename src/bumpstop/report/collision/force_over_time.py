"""Force over time of a median and of a bad collision, as in Schroeder's figure 5.3."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision.trajectory.trajectory_result import TrajectoryCollisionResult
from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.model import unit_of
from bumpstop.report.collision.rollout import Rollout, Rollouts
from bumpstop.report.formatting import quantity
from bumpstop.report.markup import Html, paragraph
from bumpstop.report.picture import AREA, EVENT, FAINT, INK, LAW, LIMIT, PAPER, Picture, scale_by, stack
from bumpstop.report.section import Section
from bumpstop.terminal import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bumpstop.collision import CollisionResult

_CASES = (("median", "A median collision", 0.5), ("bad", "A bad collision", 0.99))


class ForceOverTimeSection(Section):
    """One collision of middling force and one that 99 of 100 stay below."""

    title = "From touch to release"
    anchor = "force-over-time"

    @cached_property
    def _rollouts(self) -> list[tuple[str, str, float, Rollout]]:
        rollouts = Rollouts(self.result)
        cases = [(name, title, p, rollouts.nearest(p)) for name, title, p in _CASES]
        # Where nothing varies, or nothing is ever detected, both are the same run: once is enough.
        median, bad = cases
        return cases if median[3].run != bad[3].run else [("median", "A median and bad collision", *median[2:])]

    def content(self) -> list[Html]:
        """What the panels mean."""
        drawn = "the distribution's own sampled runs" if self.result.kind == "sampled" else "runs drawn with seed 0"
        same = len(self._rollouts) == 1
        spring = "The body is a linear spring, so the same line read on the right-hand scale is its deformation. "
        if self.result.scenario.contact.damping_Ns_m > 0:
            spring = (
                "The body is a linear spring with a damper: the right-hand scale is the deformation of the spring "
                "alone under that force. "
            )
        return [
            paragraph(
                "Two single collisions out of many: one whose peak force is about the median, and one whose peak force "
                "99 of 100 collisions stay below. They are chosen from ",
                drawn,
                ". Here both are the same. " if same else ". ",
                f"Upper panel: the contact force. {spring}Lower panel: the residual of the joint that triggered, which "
                "the detector compares with its threshold once every feedback period; dotted: the part of it that is "
                "contact, without noise.",
            )
        ]

    def pictures(self) -> list[Picture]:
        """One figure a collision, on the same scales where that keeps both readable."""
        peaks = [rollout.peak_force for *_, rollout in self._rollouts]
        ends = [_window(rollout, self._stays) for *_, rollout in self._rollouts]
        common = max(peaks) < 3 * min(peaks)
        pictures = []
        for (name, title, p, rollout), window in zip(self._rollouts, ends, strict=True):
            top = self._top(max(peaks) if common else rollout.peak_force)
            if common:
                window = (min(begin for begin, _ in ends), max(end for _, end in ends))
            panels = _Panels(self.result, rollout, title, window, top, self._stays)
            pictures.append(
                Picture(
                    f"force_over_time_{name}",
                    f"{title}: contact force over time above, residual of joint {rollout.joint + 1} below. "
                    f"{_story(rollout)}",
                    f"{title} ({_which(self.result, p)}; run {rollout.run}, seed {rollout.seed}). {_story(rollout)}",
                    panels.draw,
                    height=4.2,
                )
            )
        return pictures

    def _top(self, peak: float) -> float:
        """End of the force scale [N]: head room for labels above the peak, and above the limit where it is near."""
        allowed = max((force for _, force in _allowed(self.result)), default=1.0)
        near = allowed < 1.6 * peak or peak == 0
        return 1.28 * (max(peak, allowed) if near else peak)

    @property
    def _stays(self) -> bool:
        """A stopped arm keeps pressing, unless the body gets away."""
        return self.result.scenario.reaction.kind == "stop" and not self.result.problem.gets_away


def _allowed(result: CollisionResult) -> list[tuple[float, float]]:
    """Forces that the limits allow on this area [N], each with the time after the touch until which it holds [s]."""
    limits, first, contact = result.problem.limits, result.problem.transient_limits, result.scenario.contact
    if limits is None or not limits.permitted or (first is not None and not first.permitted):
        return []
    phases = [(math.inf, limits)] if first is None else [(FIRST_PHASE_S, first), (math.inf, limits)]
    return [(until, phase.allowed_force_N(contact.area_cm2, contact.peak_factor)) for until, phase in phases]


def _which(result: CollisionResult, p: float) -> str:
    quantile = result.peak_force.quantile(p)
    if math.isfinite(quantile):
        return f"p{100 * p:g} of the peak force is {number(quantile)} N"
    if isinstance(result, TrajectoryCollisionResult):
        return f"about p{100 * p:g} of the forces, those of collisions never detected included"
    return f"the p{100 * p:g} collision is never detected: its force is unbounded"


def _story(rollout: Rollout) -> str:
    """What happens, in one or two sentences."""
    if rollout.detection is None:
        if rollout.touch is None:
            return "The arm does not reach the body and nothing is detected."
        if rollout.displacement.any():
            return f"Never detected: the body gets away from {quantity(rollout.peak_force, 'N')}."
        return (
            f"Never detected: the force reaches {quantity(rollout.peak_force, 'N')} by the end of what was simulated."
        )
    joint = f"joint {rollout.joint + 1}"
    if rollout.touch is None:
        return f"A false alarm in {joint}: the arm reacts before it reaches the body."
    if rollout.detection < 0:
        return (
            f"A false alarm in {joint} {_ms(-rollout.detection)} before the touch; the arm still reaches the body with "
            f"{quantity(rollout.peak_force, 'N')}."
        )
    return (
        f"Detected by {joint} {_ms(rollout.detection)} after the touch; the force peaks at "
        f"{quantity(rollout.peak_force, 'N')}, {_ms(float(rollout.time[np.argmax(rollout.force)]))} after the touch."
    )


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.1f} ms" if seconds < 1 else f"{seconds:.2f} s"


def _window(rollout: Rollout, stays: bool) -> tuple[float, float]:
    """First and last time to show [s]: a little of the approach, then until the force is gone."""
    known = [t for t in (rollout.touch, rollout.detection) if t is not None]
    begin, pressed = min(known, default=float(rollout.time[0])), rollout.time[rollout.force > 0]
    end = float(rollout.time[-1]) if not pressed.size else max(float(pressed[-1]), rollout.detection or 0.0)
    length = max(end - begin, 0.02)
    return begin - 0.2 * length, begin + length * (1.35 if stays else 1.08)


class _Panels:
    """Force above, residual below."""

    def __init__(
        self,
        result: CollisionResult,
        rollout: Rollout,
        title: str,
        window: tuple[float, float],
        top: float,
        stays: bool,
    ) -> None:
        self._result, self._rollout, self._title, self._window = result, rollout, title, window
        self._top, self._stays = top, stays
        # A motion of seconds is read in seconds.
        self._scale, self._unit = (1.0, "s") if window[1] - window[0] > 2 else (1e3, "ms")

    def draw(self, figure: Figure) -> None:
        """Draw both panels."""
        # The limits of two phases have a line of their own below the title.
        two = len(_allowed(self._result)) == 2
        top = 0.52 if two else 0.34
        force, residual = stack(figure, [1.5, 1.0], left=1.0, right=0.62, bottom=0.5, top=top, gap=0.14)
        for panel in (force, residual):
            panel.yaxis.set_label_coords(-0.185, 0.5)
        force.set_title(self._title, pad=20 if two else None)
        self._force(force)
        self._residual(residual)
        residual.set_xlim(self._window[0] * self._scale, self._window[1] * self._scale)
        touch = self._rollout.touch is not None
        zero = "touch" if touch else "detection" if self._rollout.detection is not None else "start"
        residual.set_xlabel(f"time after {zero} [{self._unit}]")

    def _force(self, panel: Axes) -> None:
        rollout = self._rollout
        time, force = rollout.time, rollout.force
        if self._stays and rollout.detection is not None:
            time, force = np.append(time, self._window[1]), np.append(force, force[-1])
        x = time * self._scale
        panel.fill_between(x, force, color=AREA, alpha=0.25, linewidth=0)
        panel.plot(x, force, color=LAW)
        panel.set_ylim(0, self._top)
        panel.set_ylabel("force [N]")
        # Padding takes its own share.
        stiffness = self._result.problem.body_stiffness
        millimetres = panel.secondary_yaxis("right", functions=scale_by(1e3 / stiffness))
        millimetres.set_ylabel("deformation [mm]")
        self._limit(panel)
        self._events(panel)

    def _events(self, panel: Axes) -> None:
        rollout = self._rollout
        if rollout.peak_force > 0:
            at = int(np.argmax(rollout.force))
            x = rollout.time[at] * self._scale
            panel.plot(x, rollout.peak_force, marker="D", color=INK, markersize=5, clip_on=False)
            late = rollout.time[at] > self._window[0] + 0.6 * (self._window[1] - self._window[0])
            panel.annotate(
                f"{number(rollout.peak_force)} N",
                (x, rollout.peak_force),
                (-7 if late else 7, 3),
                textcoords="offset points",
                ha="right" if late else "left",
                va="bottom",
                fontweight="bold",
                bbox=PAPER,
            )
        if rollout.detection is not None:
            self._detection(panel)
            room = rollout.detection > self._window[0] + 0.2 * (self._window[1] - self._window[0])
            panel.annotate(
                "detected",
                (rollout.detection * self._scale, self._top),
                (-4 if room else 4, -1),
                textcoords="offset points",
                ha="right" if room else "left",
                va="top",
                color=EVENT,
            )

    def _detection(self, panel: Axes) -> None:
        assert self._rollout.detection is not None
        panel.axvline(self._rollout.detection * self._scale, color=EVENT, linestyle="-.", linewidth=1.4)

    def _limit(self, panel: Axes) -> None:
        """Draw what the limits allow, while it holds."""
        begin, last = self._window

        # What would cover a curve inside the panel stands above it: limits beyond the scale, and those of two phases.
        def note(text: str, x: float, y: float, *, up: float = 2) -> None:
            panel.annotate(
                text, (x * self._scale, y), (-2, up), textcoords="offset points", ha="right", va="bottom",
                color=LIMIT, bbox=PAPER,
            )  # fmt: skip

        phases = _allowed(self._result)
        said = []
        for until, allowed in phases:
            if begin >= last:
                # An arm that stays meets the later limit beyond what is drawn.
                if self._stays:
                    panel.axhline(allowed, color=LIMIT, linestyle=":", linewidth=1.4)
                    said.append(f"{number(allowed)} N from {FIRST_PHASE_S:g} s on")
                break
            end = min(until, last)
            if allowed < self._top:
                panel.hlines(
                    allowed, begin * self._scale, end * self._scale, color=LIMIT, linestyle="--", linewidth=1.4
                )
            said.append(f"{number(allowed)} N" + (" ↑" if allowed >= self._top else ""))
            if len(phases) == 1:
                inside = allowed < self._top
                note(f"limit {said[0]}", end if inside else last, min(allowed, self._top), up=2 if inside else 5)
            begin = end
        if len(phases) == 2:
            note(f"limit {', '.join(said)}", last, self._top, up=5)

    def _residual(self, panel: Axes) -> None:
        rollout = self._rollout
        joint = self._result.problem.robot.joints[rollout.joint]
        unit = unit_of(joint)
        x = rollout.tick_time * self._scale
        panel.axhline(0, color=FAINT, linewidth=0.8)
        panel.plot(x, rollout.contact_torque, color=LAW, linewidth=1.2, linestyle=":")
        seen = rollout.tick_time >= self._window[0]
        # Seconds of ticks merge into a band, which a line draws as well as a thousand dots.
        few = np.count_nonzero(seen) <= 100
        look: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 3.5} if few else {"linewidth": 0.5}
        panel.plot(x, rollout.residual, color=LAW, **look)
        reach = max(float(np.abs(rollout.residual[seen]).max(initial=0.0)), 1e-9)
        reach = self._threshold(panel, reach, unit)
        if rollout.detection is not None:
            self._detection(panel)
            panel.plot(
                rollout.detection * self._scale,
                rollout.residual[-1],
                marker="o",
                markersize=8,
                markerfacecolor="none",
                markeredgecolor=EVENT,
                markeredgewidth=1.8,
            )
        panel.set_ylim(-1.35 * reach, 1.35 * reach)
        panel.set_ylabel(f"residual of\njoint {rollout.joint + 1} [{unit}]")

    def _threshold(self, panel: Axes, reach: float, unit: str) -> float:
        """Draw the thresholds, unless they are far beyond the residual; returns what the scale must reach."""
        threshold = self._rollout.threshold
        text = f"threshold ±{number(threshold)} {unit}" if math.isfinite(threshold) else "not monitored"
        label: dict[str, Any] = {
            "textcoords": "offset points", "ha": "right", "va": "top", "color": LIMIT, "bbox": PAPER,
        }  # fmt: skip
        if threshold > 8 * reach:
            beyond = f"{text}: beyond this panel" if math.isfinite(threshold) else text
            panel.annotate(beyond, (1, 1), (-2, -2), xycoords="axes fraction", **label)
            return reach
        for sign in (-1, 1):
            panel.axhline(sign * threshold, color=LIMIT, linestyle="--", linewidth=1.4)
        panel.annotate(text, (self._window[1] * self._scale, threshold), (-2, -3), **label)
        return max(reach, threshold)
