"""Figures 2.7 to 2.12 of a protocol, one for each joint."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.identification.drive.drive_model import inverse_map
from bumpstop.report.formatting import with_error
from bumpstop.report.identification.validation import first_few
from bumpstop.report.markup import Html, paragraph
from bumpstop.report.picture import EVENT, FAINT, INK, LAW, LIMIT, Picture, axes
from bumpstop.report.section import Part
from bumpstop.reproduction.schroeder2013.protocol_steps import joint_torque
from bumpstop.terminal import number

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bumpstop.reproduction.schroeder2013.protocol import ProtocolFit, ProtocolJoint

_STROKES = 8  # shown, as in Schroeder's figures 2.7 and 2.9
_POINTS = 150  # of a stroke
_SIDES = {1: (LAW, "o"), -1: (LIMIT, "^")}  # by direction: colours and marks that differ in grey, too


class _JointsPart(Part):
    """A figure for each joint."""

    text = ""

    def __init__(self, fit: ProtocolFit) -> None:
        self._fit = fit

    def content(self) -> list[Html]:
        """How to read the figures."""
        return [paragraph(self.text)]

    def pictures(self) -> list[Picture]:
        """One for each joint that has something to show."""
        return [
            Picture(
                f"{self.anchor}_{joint.experiment.joint + 1}",
                f"{self.title} of joint {joint.experiment.name}.",
                f"Joint {joint.experiment.joint + 1}, {joint.experiment.name}. {self.caption(joint)}".strip(),
                self._drawing(joint),
                height=2.9,
            )
            for joint in self._fit.joints
            if self.has(joint)
        ]

    def _drawing(self, joint: ProtocolJoint) -> Callable[[Figure], None]:
        def draw(figure: Figure) -> None:
            panel = axes(figure, left=0.8)
            panel.set_title(joint.experiment.name)
            self.draw(panel, joint)

        return draw

    def has(self, joint: ProtocolJoint) -> bool:
        """Whether there is anything to draw."""
        return True

    def caption(self, joint: ProtocolJoint) -> str:
        """What else stands below the figure."""
        return ""

    @abstractmethod
    def draw(self, panel: Axes, joint: ProtocolJoint) -> None:
        """Put the content into the axes."""


class StrokesPart(_JointsPart):
    """Figure 2.7."""

    title = "Torque over measured current"
    anchor = "strokes"
    text = (
        "Strokes at constant speed (circles: forward, triangles: back), and the curve fitted to each (eq 2.25). Where "
        "a curve crosses zero torque all current goes into friction (as figure 2.7)."
    )

    def draw(self, panel: Axes, joint: ProtocolJoint) -> None:
        """Some of the strokes."""
        kind = joint.map_fit.kind
        for k in _some(joint):
            stroke, part = joint.strokes[k], joint.cut.constant[k]
            colour, mark = _SIDES[1 if part.speed > 0 else -1]
            rows = first_few(part.t.size, _POINTS)
            panel.plot(part.current[rows], part.torque[rows], mark, color=colour, markersize=1.6, alpha=0.35)
            torque = np.linspace(part.torque.min(), part.torque.max(), 60)
            current = stroke.friction + inverse_map(kind, stroke.A, stroke.B, torque, math.copysign(1, part.speed))[0]
            panel.plot(current, torque, color=INK, linewidth=0.9)
        panel.axhline(0, color=FAINT, linewidth=0.6)
        panel.set_xlabel("measured current [A]")
        panel.set_ylabel("predicted torque [Nm]")


class FrictionPart(_JointsPart):
    """Figures 2.8 and 2.12."""

    title = "Friction over speed"
    anchor = "friction"
    text = (
        "Friction current of every stroke (eq 2.26), the law through them and one standard deviation to either side, "
        "dashed (as figures 2.8 and 2.12). The law is D |speed|^F (eq 2.27), or Coulomb and viscous friction with a "
        "share of the current that is lost under load, whichever predicts strokes that it was not fitted to better."
    )

    def caption(self, joint: ProtocolJoint) -> str:
        """The law."""
        own = joint.friction.parameters.items()
        return ", ".join(f"{name} {with_error(parameter)}" for name, parameter in own) + "."

    def draw(self, panel: Axes, joint: ProtocolJoint) -> None:
        """Points and law."""
        speed = np.array([stroke.speed for stroke in joint.strokes])
        friction = np.array([stroke.friction for stroke in joint.strokes])
        for sign, (colour, mark) in _SIDES.items():
            side = np.sign(speed) == sign
            panel.plot(speed[side], friction[side], mark, color=colour, markersize=3, alpha=0.6)
            x = np.linspace(0.005, 1.05 * np.abs(speed).max(), 200)
            law = joint.friction.at_zero_torque(x)
            panel.plot(sign * x, sign * law, color=INK, linewidth=1.2)
            for shift in (-joint.friction_sd, joint.friction_sd):
                panel.plot(sign * x, sign * law + shift, color=FAINT, linewidth=0.8, linestyle="--")
        panel.axhline(0, color=FAINT, linewidth=0.6)
        panel.set_xlabel("speed [rad/s]")
        panel.set_ylabel("friction current [A]")


class MapPart(_JointsPart):
    """Figure 2.9."""

    title = "Torque over joint current"
    anchor = "map"
    text = (
        "The same strokes with friction taken off the current (eq 2.28), and the map fitted to all (eq 2.29, as "
        "figure 2.9). Of two maps the one with the smaller error on strokes it was not fitted to is taken, the odd one "
        "unless the other is better by 2 % and by more than chance."
    )

    def caption(self, joint: ProtocolJoint) -> str:
        """The choice."""
        tried = ", ".join(f"{kind.replace('_', ' ')} {number(value)} Nm" for kind, value in joint.held_out.items())
        return f"Held-out error: {tried}. Chosen: {joint.map.replace('_', ' ')}."

    def draw(self, panel: Axes, joint: ProtocolJoint) -> None:
        """Some of the strokes, and the map."""
        for k in _some(joint):
            part, current = joint.cut.constant[k], joint.joint_currents[k]
            colour, mark = _SIDES[1 if part.speed > 0 else -1]
            rows = first_few(part.t.size, _POINTS)
            panel.plot(current[rows], part.torque[rows], mark, color=colour, markersize=1.6, alpha=0.35)
        found = joint.map_fit
        x = np.linspace(*found.reach, 200)
        for sign in (1, -1) if found.kind == "load_dependent" else (1,):
            panel.plot(
                x, joint_torque(found.kind, found.A.value, found.B.value, x, float(sign)), color=INK, linewidth=1.1
            )
        panel.axhline(0, color=FAINT, linewidth=0.6)
        panel.axvline(0, color=FAINT, linewidth=0.6)
        panel.set_xlabel("joint current [A]")
        panel.set_ylabel("predicted torque [Nm]")


class HysteresisPart(_JointsPart):
    """Figure 2.10."""

    title = "Torque left at rest"
    anchor = "hysteresis"
    text = (
        "Torque that the map gives beyond the predicted one while the joint is held and another swings (eq 2.31), by "
        "the side from which the pose was reached. Shown from when half the hold is over; half the distance of the two "
        "sides is the hysteresis (as figure 2.10)."
    )

    def has(self, joint: ProtocolJoint) -> bool:
        """Where the joint was held."""
        return bool(joint.hold_values)

    def draw(self, panel: Axes, joint: ProtocolJoint) -> None:
        """Every hold over its own time."""
        found = joint.map_fit
        for hold in joint.cut.holds:
            colour, mark = _SIDES[1 if hold.speed > 0 else -1]
            rows = first_few(hold.t.size, 80)
            left = joint_torque(found.kind, found.A.value, found.B.value, hold.current, hold.speed) - hold.torque
            panel.plot(hold.t[rows] - hold.t[0], left[rows], mark, color=colour, markersize=2, alpha=0.4)
        held = joint.parameters["hysteresis"]
        centre = 0.0
        for sign in (1, -1):
            own = [
                sign * value
                for value, hold in zip(joint.hold_values, joint.cut.holds, strict=True)
                if hold.speed == sign
            ]
            centre += float(np.mean(own)) / 2
        if held is not None:
            for sign in (1, -1):
                panel.axhline(centre + sign * held.value, color=INK, linewidth=1.1)
        panel.set_xlabel("time [s]")
        panel.set_ylabel("torque [Nm]")


class InertiaPart(_JointsPart):
    """Figure 2.11."""

    title = "Torque over acceleration"
    anchor = "inertia"
    text = (
        "Torque that the map gives beyond Newton and Euler's on the ramps, minus what goes with the sign of the motion "
        "and with load; its slope over acceleration is the reflected inertia (eq 2.33, as figure 2.11 with the sign "
        "turned)."
    )

    def has(self, joint: ProtocolJoint) -> bool:
        """Where ramps were long enough."""
        return joint.inertia_fit is not None

    def caption(self, joint: ProtocolJoint) -> str:
        """The line."""
        assert joint.inertia_fit is not None
        return f"Inertia {with_error(joint.inertia_fit.inertia)} kg m2, R2 {joint.inertia_fit.r2:.4f}."

    def draw(self, panel: Axes, joint: ProtocolJoint) -> None:
        """Points and line."""
        found = joint.inertia_fit
        assert found is not None
        rows = first_few(found.acceleration.size, 1500)
        panel.plot(found.acceleration[rows], found.torque[rows], "o", color=EVENT, markersize=1.8, alpha=0.4)
        x = np.array([found.acceleration.min(), found.acceleration.max()])
        panel.plot(x, found.inertia.value * x, color=INK, linewidth=1.2)
        panel.set_xlabel("acceleration [rad/s2]")
        panel.set_ylabel("torque [Nm]")


def _some(joint: ProtocolJoint) -> list[int]:
    """Strokes of both directions at speeds that differ, few enough to be told apart."""
    order = np.argsort([stroke.speed for stroke in joint.strokes], kind="stable")
    return [int(order[k]) for k in first_few(len(order), _STROKES)]
