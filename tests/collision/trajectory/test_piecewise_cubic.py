"""Cubics through rows: scipy's splines are the other route to the same numbers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from bumpstop.collision.trajectory.piecewise_cubic import PiecewiseCubic


@pytest.mark.parametrize("rows", [2, 3, 4, 5, 50, 1000])
@pytest.mark.parametrize("given", ["positions", "velocities"])
def test_are_the_splines_of_scipy(rows: int, given: str) -> None:
    rng = np.random.default_rng(rows)
    # Neighbouring intervals differ by up to a factor of 20, which is what rounding may grow by at the last row.
    x = np.cumsum(rng.uniform(0.05, 1.0, rows))
    y, slope = rng.normal(size=(2, rows, 7))
    if given == "positions":
        ours, theirs = PiecewiseCubic.spline(x, y), CubicSpline(x, y)
    else:
        ours, theirs = PiecewiseCubic.hermite(x, y, slope), CubicHermiteSpline(x, y, slope)
    t = np.concatenate([x, rng.uniform(x[0] - 0.1, x[-1] + 0.1, 200)])
    for derivative in range(3):
        expected = theirs(t, derivative)
        assert np.abs(ours(t, derivative) - expected).max() <= 1e-11 * np.abs(expected).max()
    assert ours(float(t[-1])).shape == (7,)


def test_spline_is_the_cubic_itself_where_the_rows_lie_on_one() -> None:
    x = np.array([0.0, 0.3, 1.0, 1.1, 2.0])
    t = np.linspace(0, 2, 41)
    spline = PiecewiseCubic.spline(x, np.polyval([2.0, -3, 0.5, 1], x)[:, None])
    assert spline(t)[:, 0] == pytest.approx(np.polyval([2.0, -3, 0.5, 1], t), abs=1e-12)
    assert spline(t, 2)[:, 0] == pytest.approx(12 * t - 6, abs=1e-10)
