"""Inertias that bodies can have, on the page of ``bumpstop identify --consistent``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.model import unit_of
from bumpstop.report.markup import Html, paragraph, table
from bumpstop.report.section import Part
from bumpstop.terminal import number

if TYPE_CHECKING:
    from bumpstop.identification import ConsistentFit


class InertiasPart(Part):
    """Mass, centre and principal moments of every link, and what the condition costs."""

    title = "Inertias that bodies can have"
    anchor = "bodies"

    def __init__(self, found: ConsistentFit) -> None:
        self._found = found

    def content(self) -> list[Html]:
        """One row for each link, one for each joint."""
        links, errors = [], []
        joints = self._found.robot.joints
        torques, rotors = unit_of(*joints), unit_of(*joints, turning="kg m2", sliding="kg")
        for joint, rmse, free in zip(self._found.robot.joints, self._found.rmse, self._found.rmse_free, strict=True):
            assert joint.inertia is not None
            moments = np.linalg.eigvalsh(np.asarray(joint.inertia.tensor))
            links.append(
                (
                    joint.link,
                    number(joint.inertia.mass),
                    ", ".join(f"{x:.3g}" for x in joint.inertia.center),
                    ", ".join(f"{x:.3g}" for x in moments),
                    number(joint.rotor_inertia),
                )
            )
            errors.append((joint.name, number(float(rmse)), number(float(free))))
        return [
            paragraph(
                "Masses, centres and moments of all links, fitted such that each could be a body. What the torque does "
                "not show stays near the inertia that the robot came with: single figures are no measurements, the "
                "torque they give together is."
            ),
            table(
                ("link", "mass [kg]", "centre [m]", "principal moments [kg m2]", f"rotor [{rotors}]"),
                links,
                caption="Links and rotors",
                numbers=True,
            ),
            table(
                ("joint", f"rmse [{torques}]", f"rmse of base parameters [{torques}]"),
                errors,
                caption="What the condition costs",
                numbers=True,
            ),
        ]
