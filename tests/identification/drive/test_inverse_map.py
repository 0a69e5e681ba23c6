"""Currents that a torque takes, and the torque that they make."""

from __future__ import annotations

import numpy as np
import pytest

from bumpstop.identification.drive.drive_model import inverse_map
from bumpstop.reproduction.schroeder2013.protocol_steps import joint_torque


@pytest.mark.parametrize("kind", ["odd", "load_dependent"])
def test_maps_and_their_inverses(kind: str) -> None:
    """There and back, and derivatives against differences."""
    torque = np.linspace(-30, 30, 61)
    for sign in (1.0, -1.0):
        current, slope, square = inverse_map(kind, 0.03, 5.0, torque, sign)
        np.testing.assert_allclose(joint_torque(kind, 0.03, 5.0, current, sign), torque, atol=1e-12)
        more_a, more_b = (inverse_map(kind, 0.03 + da, 5.0 + db, torque, sign)[0] for da, db in ((1e-6, 0), (0, 1e-6)))
        np.testing.assert_allclose((more_a - current) / 1e-6, -square / slope, atol=1e-4)
        np.testing.assert_allclose((more_b - current) / 1e-6, -current / slope, atol=1e-5)
