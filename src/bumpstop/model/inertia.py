"""What a link weighs and how its mass is spread."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.errors import InputError

Vector3 = tuple[float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]
_ZERO: Matrix3 = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


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
    tensor: Matrix3 = _ZERO

    def __post_init__(self) -> None:
        if as_number(self.mass, "mass") < 0:
            raise InputError("mass", f"{self.mass} kg", "wanted zero or more")
        as_float_array(self.center, "center", (3,))
        tensor = as_float_array(self.tensor, "tensor", (3, 3))
        scale = float(np.abs(tensor).max())
        if float(np.abs(tensor - tensor.T).max()) > 1e-9 * scale:
            raise InputError("tensor", "is not symmetric")
        if scale > 0 and float(np.linalg.eigvalsh(tensor)[0]) < -1e-9 * scale:
            raise InputError("tensor", "has a negative principal moment", "wanted all of them zero or more")

    def kernel(self, rotor: float = 0.0) -> _native.LinkInertia:
        """The link in the kernels' form, with the inertia of its motor, reflected to the joint [kg m2 or kg]."""
        center, tensor = (np.array(value, dtype=np.float64) for value in (self.center, self.tensor))
        return _native.LinkInertia(self.mass, center, tensor, rotor)

    @property
    def breaks_triangle(self) -> bool:
        """Whether no body has these principal moments: one exceeds the sum of the other two."""
        moments = np.linalg.eigvalsh(np.asarray(self.tensor))
        return bool(moments[2] > (moments[0] + moments[1]) * (1 + 1e-6))

    def moved(self, origin: npt.ArrayLike, rotation: npt.ArrayLike) -> LinkInertia:
        """The same body seen from another frame.

        Args:
            origin: of this inertia's frame in the other one [m], shape (3,).
            rotation: its orientation there, as rows of a rotation matrix, shape (3, 3).
        """
        turn = np.asarray(rotation)
        tensor = turn @ np.asarray(self.tensor) @ turn.T
        return LinkInertia(
            mass=self.mass,
            center=vector3(np.asarray(origin) + turn @ np.asarray(self.center)),
            tensor=matrix3((tensor + tensor.T) / 2),
        )


def merged(parts: Sequence[LinkInertia]) -> LinkInertia:
    """One body out of several that are fixed to each other and given in one frame."""
    mass = sum(part.mass for part in parts)
    center: FloatArray = np.zeros(3)
    if mass > 0:
        center = np.asarray(sum(part.mass / mass * np.asarray(part.center) for part in parts))
    tensor: FloatArray = np.zeros((3, 3))
    for part in parts:
        arm = np.asarray(part.center) - center
        tensor = tensor + np.asarray(part.tensor) + part.mass * ((arm @ arm) * np.eye(3) - np.outer(arm, arm))
    return LinkInertia(mass=mass, center=vector3(center), tensor=matrix3(tensor))


def vector3(values: npt.ArrayLike) -> Vector3:
    """Three numbers as a tuple."""
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return x, y, z


def matrix3(rows: npt.ArrayLike) -> Matrix3:
    """Three rows of three numbers as tuples."""
    first, second, third = np.asarray(rows, dtype=np.float64)
    return vector3(first), vector3(second), vector3(third)
