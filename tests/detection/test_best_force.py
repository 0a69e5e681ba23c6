"""How well the shortest force is known that fits an alarm best."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bumpstop.detection import Detector, DetectorSettings, save_detector
from bumpstop.live.loaded_detector import LoadedDetector
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
    forces = np.array([made.explain(pose, row).force for row in rows])
    sd = made.best_force_noise.sd(pose, rows[0], np.zeros(6))
    np.testing.assert_allclose(forces.std(axis=0), sd, rtol=0.05, atol=1e-9)


def test_a_stretched_arm_knows_little() -> None:
    """Along itself, by the three joints in front of its wrist: forces of hundreds of newtons are noise there."""
    noise = detector(link="wrist_1_link").best_force_noise
    bent, stretched = (noise.sd(pose, np.full(6, 10.0), np.zeros(6)).max() for pose in (BENT, STRETCHED))
    assert bent < 10.0
    assert stretched > 300.0


def test_a_standing_joint_counts_with_what_friction_hides() -> None:
    made = detector()
    lever = UR5E.jacobian(BENT)[:3]
    hidden = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
    residual = PUSH @ lever
    assert abs(residual[2]) > 3 * NOISE[2]
    fit = np.linalg.pinv((lever / np.hypot(NOISE, hidden)).T)
    np.testing.assert_allclose(made.best_force_noise.sd(BENT, residual, hidden), np.linalg.norm(fit, axis=1))
    # Its zero says nothing.
    residual[2] = 0.0
    fit = np.linalg.pinv((lever / np.where(hidden > 0, np.inf, NOISE)).T)
    np.testing.assert_allclose(made.best_force_noise.sd(BENT, residual, hidden), np.linalg.norm(fit, axis=1))


def test_a_file_knows_it_as_the_detector_does(tmp_path: Path) -> None:
    made = detector(link="wrist_1_link", point=(0.01, 0.02, 0.03))
    save_detector(made, tmp_path / "arm.detector")
    loaded = LoadedDetector.load(tmp_path / "arm.detector").best_force_noise
    wanted = made.best_force_noise.sd(BENT, np.full(6, 8.0), np.zeros(6))
    np.testing.assert_allclose(loaded.sd(BENT, np.full(6, 8.0), np.zeros(6)), wanted, rtol=1e-12)
