"""Distributions over the time of contact, mixed from values at the nodes of its quadrature."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bumpstop.collision.trajectory.onset_mixture import OnsetMixture


def mixture(order: int, panels: int) -> OnsetMixture:
    """Of panels of a quadrature, all of whose contacts are detected at tick 3."""
    times: Any = SimpleNamespace(order=order)
    contact = np.arange(order * panels)
    return OnsetMixture(times, contact, np.full(contact.size, 3))


def test_values_between_the_nodes_count() -> None:
    # 1 + x at the nodes of a panel: from 0 to 2 over it, evenly.
    node = np.polynomial.legendre.leggauss(4)
    found = mixture(4, 1).distribution(1 + node[0], node[1] / 2)
    for p in (0.1, 0.5, 0.9):
        assert found.quantile(p) == pytest.approx(2 * p, abs=1e-12)
    assert found.sd == pytest.approx(2 / math.sqrt(12), rel=1e-12)


def test_an_infinite_value_leaves_those_of_other_panels_as_they_are() -> None:
    """An arm that presses for good is in contact for ever: no polynomial goes through that."""
    node = np.polynomial.legendre.leggauss(2)
    values = np.concatenate([1 + node[0], [5.0, math.inf]])
    found = mixture(2, 2).distribution(values, np.array([0.25, 0.25, 0.2, 0.3]))
    assert found.quantile(0.25) == pytest.approx(1.0, abs=1e-12)
    assert found.quantile(0.6) == 5.0
    assert found.exceedance(1e9) == pytest.approx(0.3, abs=1e-12)
    assert math.isinf(found.mean)
    assert math.isnan(found.sd)


def test_an_infinite_value_of_no_probability_changes_nothing() -> None:
    """What is never detected may press for ever, but never happen."""
    never = np.array([math.inf]), np.array([0.0])
    found = mixture(1, 1).distribution(np.array([2.0]), np.array([1.0]), end=never)
    assert (found.mean, found.sd) == (2.0, 0.0)
