"""Placeholders for the inertia of an arm: figures that were put in so that a simulator runs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from bumpstop.model.joint import Joint

# Of so many moving links no two halves of a real arm are the same; two wrist links of one shape are common.
_MIN_EQUAL = 3
_PLACEHOLDER_KG = (0.0, 1.0, 2.0)
# The lightest arms on sale, of plastic and carbon fibre, move some 5 kg per square metre of reach, industrial ones 15
# and more. No arm is known below this.
_MIN_KG_PER_M2 = 4.0
# The heaviest industrial arms move less than 1000 kg per square metre, and toys of 5 kg in grams 5000 and more.
_MAX_KG_PER_M2, _HEAVY_KG = 2500.0, 500.0


def inertia_doubts(name: str, joints: Sequence[Joint], reach: float, turning_reach: float) -> tuple[str, ...]:
    """Why the masses and tensors of a robot are probably placeholders.

    Args:
        name: of the robot, to speak of it.
        joints: with the inertia of some of their links.
        reach: how far the tip gets from the axis of joint 1 [m].
        turning_reach: likewise, with joints that slide held [m].

    Returns:
        One sentence that names what was found: equal masses or moments of inertia in three or more links (in all, of
        two), masses of 0, 1 or 2 kg in half of the links or more, no mass at all in a link, or a sum below 4 or
        above 2500 kg per square metre of reach, or a link whose centre lies farther from its frame than the arm
        reaches, or that turns as if its mass did. Masses and moments that agree to four digits are equal. Empty: none
        of that.
    """
    links = [(joint.link, joint.inertia) for joint in joints if joint.inertia is not None]
    if not links:
        return ()
    masses = [inertia.mass for _, inertia in links]
    moments_of = [np.linalg.eigvalsh(np.asarray(inertia.tensor)) for _, inertia in links]
    tensors = [tuple(_rounded(value, float(principal[2])) for value in principal) for principal in moments_of]
    found = []
    many = max(2, min(_MIN_EQUAL, len(links)))
    mass, count = Counter(_rounded(mass, mass) for mass in masses).most_common(1)[0]
    if count >= many:
        found.append(f"{count} of {len(links)} links have the same mass, {mass:g} kg")
    moments, count = Counter(tensors).most_common(1)[0]
    if count >= many:
        values = ", ".join(f"{moment:.3g}" for moment in moments)
        found.append(f"{count} of {len(links)} links have the same moments of inertia, {values} kg m2")
    without = [link for link, inertia in links if inertia.mass == 0]
    if without:
        found.append(f"link {', '.join(repr(link) for link in without[:5])} has no mass")
    round_ones = sum(mass in _PLACEHOLDER_KG for mass in masses)
    if 2 * round_ones >= len(links) >= 2 and round_ones > len(without):
        found.append(f"{round_ones} of {len(links)} links weigh exactly 0, 1 or 2 kg")
    total = sum(masses)
    if len(links) == len(joints) and total < _MIN_KG_PER_M2 * turning_reach**2:
        found.append(
            f"all links together weigh {total:.3g} kg, less than any known arm that reaches {turning_reach:.3g} m "
            f"({_MIN_KG_PER_M2 * turning_reach**2:.3g} kg)"
        )
    if len(links) == len(joints) and total > max(_MAX_KG_PER_M2 * turning_reach**2, _HEAVY_KG):
        found.append(
            f"all links together weigh {total:.3g} kg, more than any known arm that reaches {turning_reach:.3g} m "
            f"({max(_MAX_KG_PER_M2 * turning_reach**2, _HEAVY_KG):.3g} kg; are the masses grams?)"
        )
    for (link, inertia), principal in zip(links, moments_of, strict=True):
        off = float(np.linalg.norm(inertia.center))
        if off > reach:
            found.append(f"link {link!r} has its centre {off:.3g} m off its frame, the arm reaches {reach:.3g} m")
            break
        away = math.sqrt(max(float(principal[2]), 0.0) / inertia.mass) if inertia.mass > 0 else 0.0
        if away > reach:
            found.append(f"link {link!r} turns as if its {inertia.mass:.3g} kg were {away:.3g} m off its centre")
            break
    if not found:
        return ()
    return (f"The inertia of {name} looks like placeholders, not like an arm's: {'; '.join(found)}.",)


def _rounded(value: float, scale: float) -> float:
    """To four digits of the scale, so that figures that were written twice with other roundings are equal."""
    if scale == 0:
        return 0.0
    digits = 3 - math.floor(math.log10(abs(scale)))
    return round(float(value), digits) + 0.0
