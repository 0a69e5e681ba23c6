"""A figure of a person, whose parts stand for the body regions of a limit table."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.view.scene.arm_shapes import capsule

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.arrays import FloatArray
    from bumpstop.contact import LimitTable

# It fills more of the picture than the arm, and need not be as round: without a graphics card corners cost time.
_SECTIONS = 10
# Ends [m] and radius [m] of the capsules of a person 1.75 m tall, who stands at the origin and looks along +x, by words
# that the names of regions hold; the first that fits. What lies on the left is on the right, too. Proportions are
# rough: the figure is there to be clicked.
_PARTS: tuple[tuple[tuple[str, ...], tuple[tuple[float, ...], ...]], ...] = (
    (("face",), ((0.05, 0, 1.60, 0.06, 0, 1.64, 0.075),)),
    (("temple",), ((0.0, 0.05, 1.67, 0.0, 0.06, 1.68, 0.05),)),
    (("masticatory",), ((0.05, 0.045, 1.58, 0.05, 0.05, 1.57, 0.035),)),
    (("cranium", "skull", "forehead"), ((-0.01, 0, 1.68, 0.0, 0, 1.70, 0.095),)),
    (("neck_front", "larynx"), ((0.035, 0, 1.46, 0.035, 0, 1.52, 0.04),)),
    (("neck",), ((-0.02, 0, 1.44, -0.02, 0, 1.54, 0.05),)),
    (("back", "shoulder"), ((-0.08, 0.12, 1.36, -0.08, -0.12, 1.36, 0.08), (-0.07, 0, 1.1, -0.07, 0, 1.3, 0.1))),
    (("chest", "sternum", "pectoral"), ((0.03, 0.08, 1.28, 0.03, -0.08, 1.28, 0.12),)),
    (("stomach", "abdomen", "abdominal", "belly"), ((0.03, 0.05, 1.05, 0.03, -0.05, 1.05, 0.11),)),
    (("pelvi",), ((0.02, 0.07, 0.93, 0.02, -0.07, 0.93, 0.1),)),
    (("bottom", "buttock"), ((-0.09, 0.08, 0.88, -0.09, -0.08, 0.88, 0.09),)),
    (("upper_arm",), ((0, 0.23, 1.36, 0, 0.27, 1.1, 0.05),)),
    (("lower_arm", "forearm"), ((0.02, 0.28, 1.06, 0.1, 0.3, 0.86, 0.042),)),
    (("hand", "finger"), ((0.13, 0.3, 0.79, 0.18, 0.3, 0.69, 0.036),)),
    (("thigh",), ((0, 0.1, 0.82, 0.01, 0.11, 0.5, 0.075),)),
    (("lower_leg", "shin", "calf"), ((0.0, 0.11, 0.42, -0.02, 0.12, 0.1, 0.055),)),
    (("feet", "foot", "toe"), ((-0.03, 0.12, 0.04, 0.13, 0.14, 0.035, 0.035),)),
    (("knee",), ((0.03, 0.11, 0.46, 0.03, 0.11, 0.48, 0.065),)),
)


def person_parts(table: LimitTable) -> dict[str, tuple[FloatArray, npt.NDArray[np.int64]]]:
    """Meshes of a standing person by the name of a region: vertices (V, 3) [m] and faces (F, 3).

    Regions whose names tell nothing of where they are have none; the list of regions has them all.
    """
    found: dict[str, tuple[FloatArray, npt.NDArray[np.int64]]] = {}
    for region in table.regions:
        for words, capsules in _PARTS:
            if any(word in region.name for word in words):
                found[region.name] = _together([part for numbers in capsules for part in _capsules(numbers)])
                break
    return found


def _capsules(numbers: tuple[float, ...]) -> list[tuple[FloatArray, npt.NDArray[np.int64]]]:
    """A capsule, and its mirror image where it lies on the left."""
    start, end, radius = np.array(numbers[:3]), np.array(numbers[3:6]), numbers[6]
    mirror = np.array([1.0, -1.0, 1.0])
    sides = [np.ones(3), mirror] if start[1] > 0 and end[1] > 0 else [np.ones(3)]
    return [capsule(side * start, side * end, radius, _SECTIONS) for side in sides]


def _together(
    parts: list[tuple[FloatArray, npt.NDArray[np.int64]]],
) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    counts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [triangles + count for (_, triangles), count in zip(parts, counts, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)
