"""Least squares by sums of products against least squares of the rows."""

from __future__ import annotations

import numpy as np
import pytest

from bumpstop.identification.statistics.normal_equations import NormalEquations

N, JOINTS, COLUMNS = 400, 3, 7
PARTS = [slice(start, start + 40) for start in range(0, N, 40)]


def problem(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns of unlike size, one of which two others make up and one nobody sees, and two sets of sums."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(N, JOINTS, COLUMNS)) * 10.0 ** rng.uniform(-3, 3, size=COLUMNS)
    columns[:, :, 5] = columns[:, :, 1] / columns[:, :, 1].std() - columns[:, :, 2] / columns[:, :, 2].std()
    columns[:, :, 6] = 0.0
    noise = rng.normal(size=(N, JOINTS)) * np.array([0.1, 1.0, 5.0])
    scale = np.sqrt((columns**2).mean(axis=(0, 1)))
    same = np.divide(rng.normal(size=COLUMNS), scale, out=np.zeros(COLUMNS), where=scale > 0)
    return columns, columns @ same + noise, noise


def predicted(columns: np.ndarray, wanted: np.ndarray, rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """What the values of some rows predict at all of them."""
    length = np.sqrt((columns**2).sum(axis=(0, 1)))
    length[length == 0] = np.inf
    matrix, target = (columns[rows] / length) * weight[:, None], wanted[rows] * weight
    values = np.linalg.lstsq(matrix.reshape(-1, COLUMNS), target.ravel(), rcond=1e-8)[0] / length
    return columns @ values


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("left_out", [(), (3,), (0, 4, 9)])
def test_one_set_of_values_for_all_joints(seed: int, left_out: tuple[int, ...]) -> None:
    columns, wanted, noise = problem(seed)
    counts = np.full(JOINTS, float(N))
    found = NormalEquations.of(columns, wanted, PARTS, counts, apart=False).values(left_out)
    rows = np.ones(N, dtype=bool)
    for number in left_out:
        rows[PARTS[number]] = False
    # Weights are those of what all rows leave: nearly the noise, which the values hardly depend on.
    expected = predicted(columns, wanted, rows, 1 / np.sqrt((noise**2).mean(axis=0)))
    np.testing.assert_allclose(np.einsum("tjp,jp->tj", columns, found), expected, atol=2e-3 * np.abs(wanted).max())
    assert np.all(found == found[0])
    assert np.all(found[:, 6] == 0)


@pytest.mark.parametrize("seed", range(5))
def test_values_of_each_joint(seed: int) -> None:
    columns, wanted, _ = problem(seed)
    found = NormalEquations.of(columns, wanted, PARTS, np.full(JOINTS, float(N)), apart=True).values((2, 5))
    rows = np.ones(N, dtype=bool)
    rows[80:120] = rows[200:240] = False
    for j in range(JOINTS):
        own = columns[:, j : j + 1], wanted[:, j : j + 1]
        expected = predicted(*own, rows, np.ones(1))[:, 0]
        np.testing.assert_allclose(columns[:, j] @ found[j], expected, atol=1e-6 * np.abs(wanted).max())


def test_a_column_that_the_part_left_out_shows_alone_has_no_value() -> None:
    columns, wanted, _ = problem(1)
    columns[np.r_[:40, 80:N], :, 3] = 0.0
    found = NormalEquations.of(columns, wanted, PARTS, np.full(JOINTS, float(N)), apart=False)
    assert np.abs(found.values((1,))[:, 3]).max() < 1e-9 * np.abs(found.values()[:, 3]).max()


def test_products_that_are_known_change_nothing() -> None:
    columns, wanted, _ = problem(2)
    counts = np.full(JOINTS, float(N))
    whole = NormalEquations.of(columns, wanted, PARTS, counts, apart=False)
    known = NormalEquations.of(columns[:, :, :4], wanted, PARTS, counts, apart=False).products[:, :, :4, :4]
    again = NormalEquations.of(columns, wanted, PARTS, counts, apart=False, known=known)
    np.testing.assert_allclose(again.products, whole.products, rtol=1e-12, atol=0)
    taken = NormalEquations.of(columns, wanted, PARTS, counts, apart=False, known=2 * known).products
    np.testing.assert_array_equal(taken[:, :, :4, :4], 2 * known)
