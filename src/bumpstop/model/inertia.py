"""What a link weighs and how its mass is spread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bumpstop.arrays import as_float_array
from bumpstop.errors import InputError

Vector3 = tuple[float, float, float]
_ZERO: tuple[Vector3, Vector3, Vector3] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True, kw_only=True)
class LinkInertia:
    """Inertia of a link, in the frame of that link.

    Attributes:
        mass: of the link and of all that is fixed to it [kg].
        center: of mass, in the link's frame [m].
        tensor: about the centre of mass, along the axes of the link's frame, as rows of a symmetric matrix [kg m2].
    """

    mass: float
    center: Vector3 = (0.0, 0.0, 0.0)
    tensor: tuple[Vector3, Vector3, Vector3] = _ZERO

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mass) and self.mass >= 0):
            raise InputError("mass", f"{self.mass} kg", "wanted zero or more")
        as_float_array(self.center, "center", (3,))
        tensor = as_float_array(self.tensor, "tensor", (3, 3))
        scale = float(np.abs(tensor).max())
        if float(np.abs(tensor - tensor.T).max()) > 1e-9 * scale:
            raise InputError("tensor", "is not symmetric")
        if scale > 0 and float(np.linalg.eigvalsh(tensor)[0]) < -1e-9 * scale:
            raise InputError("tensor", "has a negative principal moment", "wanted all of them zero or more")

    @property
    def breaks_triangle(self) -> bool:
        """Whether no body has these principal moments: one exceeds the sum of the other two."""
        moments = np.linalg.eigvalsh(np.asarray(self.tensor))
        return bool(moments[2] > (moments[0] + moments[1]) * (1 + 1e-6))
