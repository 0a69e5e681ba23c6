"""How well the shortest force is known that fits an alarm best."""

from __future__ import annotations

import numpy as np
import pytest

from bumpstop.detection import Detector, DetectorSettings
from detection.moving_arms import UR5E

NOISE = np.array([0.5, 0.8, 0.6, 0.3, 0.3, 0.2])
BENT = np.array([0.3, -1.2, 1.4, -0.8, -1.1, 0.4])
STRETCHED = np.array([0.3, -1.2, 0.002, -0.8, -1.1, 0.4])
PUSH = np.array([30.0, -20.0, 40.0])


def detector(**settings: object) -> Detector:
    given = DetectorSettings(**{"period_s": 0.004, "noise_sd": tuple(NOISE.tolist())} | settings)  # type: ignore[arg-type]
    return Detector(UR5E, None, np.full(6, 10.0), given)


@pytest.mark.parametrize("pose", [BENT, STRETCHED])
@pytest.mark.parametrize("link", [None, "wrist_1_link"])
def test_forces_spread_by_their_standard_deviations(pose: np.ndarray, link: str | None) -> None:
    """Of the kernels' own estimates of residuals with noise."""
    made = detector(link=link)
    lever = UR5E.jacobian(pose, link)[:3]
    rng = np.random.default_rng(1)
    rows = PUSH @ lever + NOISE * rng.standard_normal((4000, 6))
    found = [made.explain(pose, row) for row in rows]
    np.testing.assert_allclose(np.std([one.force for one in found], axis=0), found[0].force_sd, rtol=0.05, atol=1e-9)


def test_a_stretched_arm_knows_little() -> None:
    """Along itself, by the three joints in front of its wrist: forces of hundreds of newtons are noise there."""
    made = detector(link="wrist_1_link")
    bent, stretched = (max(made.explain(pose, np.full(6, 10.0)).force_sd) for pose in (BENT, STRETCHED))
    assert bent < 10.0
    assert stretched > 300.0


def test_a_standing_joint_counts_with_what_friction_hides() -> None:
    hidden = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
    made = detector(stiction=tuple(hidden.tolist()))
    lever = UR5E.jacobian(BENT)[:3]
    residual, still = PUSH @ lever, np.zeros(6)
    assert abs(residual[2]) > 3 * NOISE[2]
    fit = np.linalg.pinv((lever / np.hypot(NOISE, hidden)).T)
    np.testing.assert_allclose(made.explain(BENT, residual, still).force_sd, np.linalg.norm(fit, axis=1))
    # Its zero says nothing.
    residual[2] = 0.0
    fit = np.linalg.pinv((lever / np.where(hidden > 0, np.inf, NOISE)).T)
    np.testing.assert_allclose(made.explain(BENT, residual, still).force_sd, np.linalg.norm(fit, axis=1))


def test_where_the_point_loads_no_joint_nothing_is_known() -> None:
    made = Detector(UR5E, None, np.array([np.inf] * 5 + [10.0]), DetectorSettings(period_s=0.004))
    found = made.explain(BENT, np.full(6, 10.0))
    assert np.isnan([*found.force, *found.force_sd]).all()
