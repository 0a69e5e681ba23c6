"""The C++ facade tells of every body what Python tells."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.model import describe
from cpp.builds import COMPILER, can, compiled

SOURCE = Path(__file__).parent / "facade.cpp"
BODIES: list[dict[str, Any]] = [
    {"stiffness_N_m": 1e4},
    {"stiffness_N_m": 1e4, "damping_Ns_m": 500.0},
    {"stiffness_N_m": 1e4, "damping_Ns_m": 1500.0},
    {"stiffness_N_m": 75e3, "gauge_mass_kg": 0.5, "gauge_spring_N_m": 3e4},
    {"stiffness_N_m": 25e3, "kind": "free", "body_mass_kg": 4.4},
    {"stiffness_N_m": 75e3, "kind": "free", "body_mass_kg": 0.6},
]


def told(contact: dict[str, Any], thresholds: tuple[float, ...], sd: float, duration_s: float = 5.0) -> list[float]:
    force = bs.evaluate(
        bs.Scenario.from_dict(
            {
                "robot": "ur10e",
                "pose_deg": [10, -80, 110, -120, -90, 20],
                "motion": {"velocity_mm_s": [0, 150, -200], "duration_s": duration_s},
                "contact": contact | {"offset_law": "half_normal", "offset_sd_s": 0.1},
                "detector": {"thresholds_Nm": list(thresholds), "noise_sd_Nm": [each / sd for each in thresholds]},
                "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": 6.0},
            }
        )
    ).peak_force
    return [force.mean, force.sd, force.quantile(0.5), force.quantile(0.999), force.exceedance(60.0)]


def test_of_every_body_and_of_no_motion(tmp_path: Path) -> None:
    options = [*COMPILER, "-O1"]
    if not can(options, tmp_path):
        pytest.skip(f"{' '.join(options)} builds nothing here")
    built = compiled(options, SOURCE, tmp_path / "facade")
    assert built.returncode == 0, built.stderr
    (tmp_path / "arm.robot").write_text(describe(bs.Robot.load("ur10e")), encoding="utf-8")
    done = subprocess.run(
        [tmp_path / "facade", tmp_path / "arm.robot"], capture_output=True, text=True, check=True, timeout=120
    )
    rows = np.array([[float(value) for value in line.split()] for line in done.stdout.splitlines()])
    alert, unarmed = ((40.0, 40.0, 30.0, 12.0, 12.0, 12.0), 5.5), ((1e4,) * 6, 1e4, 0.5)
    wanted = [told(contact, *alert) for contact in BODIES] + [told(BODIES[k], *unarmed) for k in (0, 3)]
    np.testing.assert_allclose(rows[:8], wanted, rtol=1e-6, atol=1e-9)
    # Where nothing is detected no force is the greatest: a mean of those until the motion ends would be too low.
    assert [row[0] for row in wanted[6:]] == [np.inf, np.inf]
    # Neither from a singular pose nor from beyond a joint's limit: nothing is known, and nothing is 0.
    assert np.isnan(rows[8:]).all()
    assert len(rows) == 10
