"""The reference simulator's kinematics and pseudo-inverse against drawings, differences and numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from reference import forward_kinematics, jacobian, pseudo_inverse
from reference.cases import EPS, random_chain, sia5d


def homogeneous(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = translation
    return transform


def skew(u: np.ndarray) -> np.ndarray:
    return np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])


def test_tip_of_the_sia5d_is_where_its_drawings_say():
    settings = sia5d((0, 0, -0.05))
    _, zero_pose = forward_kinematics(settings, np.zeros(7))
    assert zero_pose == pytest.approx([0.500, 0, 0.640], abs=1e-12)
    rotation, tip = forward_kinematics(settings, settings.start_position)
    assert tip - [0, 0, 0.310] == pytest.approx([0.428, 0, -0.122], abs=5e-4)
    assert rotation[:, 0] == pytest.approx([0, 0, -1], abs=1e-12)  # the tool axis


@pytest.mark.parametrize("seed", range(5))
def test_forward_kinematics_is_the_product_of_homogeneous_transforms(seed):
    rng = np.random.default_rng(seed)
    settings = random_chain(rng, joints=8)
    q = rng.normal(size=8)
    point = rng.normal(size=3)
    transform = np.eye(4)
    for link, joint in enumerate(settings.joints):
        axis = np.asarray(joint.axis) / np.linalg.norm(joint.axis)
        transform = transform @ homogeneous(joint.origin_rotation, joint.origin_m)
        if joint.kind == "prismatic":
            transform = transform @ homogeneous(np.eye(3), q[link] * axis)
        else:
            # Rotation from its eigenvectors' point of view: along the axis, across it, and out of that plane.
            along = np.outer(axis, axis)
            turned = along + math.cos(q[link]) * (np.eye(3) - along) + math.sin(q[link]) * skew(axis)
            transform = transform @ homogeneous(turned, np.zeros(3))
        rotation, place = forward_kinematics(settings, q, link, point)
        np.testing.assert_allclose(rotation, transform[:3, :3], atol=100 * EPS)
        np.testing.assert_allclose(place, (transform @ [*point, 1])[:3], atol=1000 * EPS)
    np.testing.assert_allclose(
        forward_kinematics(settings, q)[1], (transform @ [*settings.tip_m, 1])[:3], atol=1000 * EPS
    )


@pytest.mark.parametrize("link", [None, 3, 0])
def test_jacobian_is_the_derivative_of_the_kinematics(link):
    rng = np.random.default_rng(7)
    settings = random_chain(rng, joints=7)
    q = rng.normal(size=7)
    point = rng.normal(size=3)
    found = jacobian(settings, q, link, point)
    # Central differences: truncation ~ h^2, rounding ~ EPS / h, both near 1e-10 for lengths near 10.
    h = 1e-5
    rotation, _ = forward_kinematics(settings, q, link, point)
    for j in range(7):
        ahead, behind = q.copy(), q.copy()
        ahead[j] += h
        behind[j] -= h
        rotation_ahead, place_ahead = forward_kinematics(settings, ahead, link, point)
        rotation_behind, place_behind = forward_kinematics(settings, behind, link, point)
        spin = (rotation_ahead - rotation_behind) / (2 * h) @ rotation.T
        np.testing.assert_allclose(found[:3, j], (place_ahead - place_behind) / (2 * h), atol=1e-8)
        np.testing.assert_allclose(skew(found[3:, j]), spin, atol=1e-8)
    if link is not None:
        assert np.all(found[:, link + 1 :] == 0)


def matrix_with(singular_values, rows: int, columns: int, rng: np.random.Generator) -> np.ndarray:
    count = len(singular_values)
    u = np.linalg.qr(rng.normal(size=(rows, count)))[0]
    v = np.linalg.qr(rng.normal(size=(columns, count)))[0]
    return u * singular_values @ v.T


@pytest.mark.parametrize("shape", [(6, 6), (6, 7), (3, 7), (6, 4), (3, 1), (1, 1), (3, 16)])
def test_pseudo_inverse_of_random_matrices_is_numpys(shape):
    rng = np.random.default_rng(shape)
    for _ in range(20):
        a = rng.normal(size=shape)
        expected = np.linalg.pinv(a, rcond=1e-7)
        # A backward-stable inverse is off by a few units in the last place times the condition number.
        error = 100 * EPS * np.linalg.cond(a) * np.linalg.norm(expected, 2)
        np.testing.assert_allclose(pseudo_inverse(a), expected, rtol=0, atol=error)


@pytest.mark.parametrize("shape", [(6, 6), (6, 7), (7, 6)])
@pytest.mark.parametrize("smallest", [1e-3, 1.1e-7, 0.9e-7, 1e-12, 0.0])
def test_pseudo_inverse_drops_singular_values_below_the_tolerance(shape, smallest):
    rng = np.random.default_rng(3)
    values = np.array([4.0, 2, 1, 0.5, 0.25, 4.0 * smallest])  # relative to the largest
    kept = values[values > 1e-7 * values.max()]
    assert len(kept) == (6 if smallest > 1e-7 else 5)
    for _ in range(10):
        a = matrix_with(values, *shape, rng)
        expected = np.linalg.pinv(a, rcond=1e-7)
        error = 100 * EPS * (kept.max() / kept.min()) / kept.min()
        np.testing.assert_allclose(pseudo_inverse(a, 1e-7), expected, rtol=0, atol=error)


def test_pseudo_inverse_of_zero_is_zero():
    assert np.all(pseudo_inverse(np.zeros((6, 7))) == 0)


@pytest.mark.parametrize("smallest", [1.0, 1e-3, 0.0])
def test_damped_pseudo_inverse_is_its_definition(smallest):
    rng = np.random.default_rng(4)
    damping = 0.05
    a = matrix_with(np.array([4.0, 2, 1, 0.5, 0.25, smallest]), 6, 7, rng)
    expected = a.T @ np.linalg.inv(a @ a.T + damping**2 * np.eye(6))
    np.testing.assert_allclose(pseudo_inverse(a, damping=damping), expected, atol=1e-10)
