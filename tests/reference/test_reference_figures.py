"""The reference simulator against the figures of another transcription of Schroeder's simulator."""

from __future__ import annotations

import math

import numpy as np
import pytest

from reference import half_normal_offsets, simulate_seeded
from reference.cases import sia5d

# Straight down, 10 000 runs a row of another transcription of Schroeder's simulator. Speed (mm/s); peak
# force (N): mean, sd, median, 95 %, 99 %; mean force at detection (N); shares of runs over the three limits.
HAND = (75_000.0, (135.0, 60.0, 120.0))  # N/m; N: force limit, pressure limit on 1 cm², on 2 cm²
LOWER_ARM = (40_000.0, (160.0, 50.0, 100.0))
REFERENCE_ROWS = [
    (HAND, 10, 25.28, 3.48, 25.48, 30.71, 32.53, 23.30, (0.0000, 0.0000, 0.0000)),
    (HAND, 25, 39.45, 4.47, 39.56, 46.70, 49.11, 26.80, (0.0000, 0.0000, 0.0000)),
    (HAND, 50, 81.51, 6.06, 81.50, 91.40, 95.17, 30.77, (0.0000, 1.0000, 0.0000)),
    (HAND, 75, 148.43, 7.92, 148.34, 161.43, 165.40, 34.67, (0.9623, 1.0000, 1.0000)),
    (HAND, 100, 239.73, 9.93, 239.57, 255.94, 260.34, 38.37, (1.0000, 1.0000, 1.0000)),
    (LOWER_ARM, 10, 22.64, 3.04, 22.84, 27.25, 28.94, 21.59, (0.0000, 0.0000, 0.0000)),
    (LOWER_ARM, 25, 30.95, 3.75, 31.12, 36.88, 38.96, 24.21, (0.0000, 0.0000, 0.0000)),
    (LOWER_ARM, 50, 54.19, 4.67, 54.27, 61.66, 64.51, 27.15, (0.0000, 0.8127, 0.0000)),
    (LOWER_ARM, 75, 89.94, 5.44, 89.93, 98.82, 102.00, 29.31, (0.0000, 1.0000, 0.0282)),
    (LOWER_ARM, 100, 138.61, 6.34, 138.60, 149.01, 152.80, 31.30, (0.0001, 1.0000, 1.0000)),
]
RUNS = 300
REFERENCE_RUNS = 10_000
Z = 4.5  # standard errors allowed: 7e-6 for each of some hundred comparisons to fail by chance


@pytest.mark.parametrize(
    ("body", "speed_mm_s", "mean", "sd", "median", "p95", "p99", "at_detection", "shares_over"),
    REFERENCE_ROWS,
)
def test_reference_rows(body, speed_mm_s, mean, sd, median, p95, p99, at_detection, shares_over):
    stiffness, limits = body
    settings = sia5d((0, 0, -speed_mm_s / 1000), stiffness_N_m=stiffness)
    offsets = half_normal_offsets(settings, RUNS, np.random.default_rng(speed_mm_s))
    runs = simulate_seeded(settings, offsets, seed=speed_mm_s)
    force = runs.max_force_N
    assert runs.detected.all()

    # Both sides are samples; the reference is rounded to 0.01 N.
    both = math.sqrt(1 / RUNS + 1 / REFERENCE_RUNS)
    rounding = 0.005
    assert force.mean() == pytest.approx(mean, abs=Z * sd * both + rounding)
    assert force.std() == pytest.approx(sd, abs=Z * sd * both / math.sqrt(2) + rounding)
    at_alarm = runs.force_at_detection_N
    assert at_alarm.mean() == pytest.approx(at_detection, abs=Z * at_alarm.std() * both + rounding)

    # A quantile is right when its share of the runs lies above it. Shares are binomial, also near 0 and 1,
    # where the normal approximation is too narrow by a run or two.
    levels = [(median, 0.5), (p95, 0.05), (p99, 0.01), *zip(limits, shares_over, strict=True)]
    for level, share in levels:
        allowed = Z * math.sqrt(share * (1 - share)) * both + 3 / RUNS
        assert np.mean(force > level) == pytest.approx(share, abs=allowed)


def test_lateral_motion_is_felt_by_joints_1_and_3():
    # About equally often by either, by both at once in 15 % of runs at 10 mm/s.
    settings = sia5d((0, 0.010, 0))
    offsets = half_normal_offsets(settings, RUNS, np.random.default_rng(6))
    runs = simulate_seeded(settings, offsets, seed=6)
    first, third = runs.triggered(0), runs.triggered(2)
    assert np.mean(first | third) > 0.97
    assert np.mean(first & third) == pytest.approx(0.15, abs=Z * math.sqrt(0.15 * 0.85 / RUNS) + 0.005)
    assert np.mean(first) == pytest.approx(np.mean(third), abs=0.15)
