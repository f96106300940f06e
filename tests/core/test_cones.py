"""Cones of the face engine: scalings, products, steps to the boundary, by their definitions."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact.faces.cones import Disc, Positive

CONES = [(Positive(), 3), (Disc(), 2), (Disc(), 3), (Disc(), 4)]
UNITS = 40
cones = pytest.mark.parametrize(("cone", "size"), CONES, ids=lambda one: type(one).__name__)


def inside(cone: object, size: int, seed: int) -> np.ndarray:
    """Points inside the cone, some of them near its boundary."""
    random = np.random.default_rng([seed, size])
    points = random.normal(size=(UNITS, size))
    margin = 10.0 ** random.uniform(-4.0, 1.0, UNITS)
    if isinstance(cone, Positive):
        return np.abs(points) + margin[:, None]
    points[:, 0] = np.linalg.norm(points[:, 1:], axis=1) + margin
    return points


def inverse_square(scaled: object, size: int) -> np.ndarray:
    """W^-2 by its action on the unit vectors, shape (units, size, size)."""
    units = [np.tile(axis, (UNITS, 1)) for axis in np.eye(size)]
    return np.stack([scaled.stretch(unit) for unit in units], axis=2)


@cones
def test_scaling_brings_slack_and_multiplier_to_one_point(cone, size):
    """W z = W^-1 s: so W^-2 s = z, and W^-2 is symmetric and positive."""
    slack, dual = inside(cone, size, 1), inside(cone, size, 2)
    square = inverse_square(cone.scaled(slack, dual), size)
    assert np.einsum("uij,uj->ui", square, slack) == pytest.approx(dual, rel=1e-7, abs=1e-9)
    # Of any vector to a part of the matrix's norm, as near the boundary that is large.
    norm = np.abs(square).max(axis=(1, 2))[:, None, None]
    assert square / norm == pytest.approx(square.transpose(0, 2, 1) / norm, abs=1e-9)
    assert np.linalg.eigvalsh(square / norm).min() > -1e-9


@cones
def test_scaling_is_a_sum_of_squares(cone, size):
    scaled = cone.scaled(inside(cone, size, 3), inside(cone, size, 4))
    square = inverse_square(scaled, size)
    frame = scaled.frame
    if frame is None:
        frame = np.broadcast_to(np.eye(size), (UNITS, size, size))
    summed = np.einsum("uk,ukm,ukn->umn", scaled.weights, frame, frame)
    assert np.all(scaled.weights >= 0.0)
    norm = np.abs(square).max(axis=(1, 2))[:, None, None]
    assert summed / norm == pytest.approx(square / norm, abs=1e-9)


@cones
def test_a_step_changes_the_products_as_wished(cone, size):
    """With dz = V - W^-2 ds, l o (W^-1 ds + W dz) is the change, whatever ds is."""
    scaled = cone.scaled(inside(cone, size, 7), inside(cone, size, 8))
    random = np.random.default_rng(9)
    ds, change = random.normal(size=(2, UNITS, size))
    dz = scaled.shift(change) - scaled.stretch(ds)
    scale = np.abs(scaled.stretch(ds)).max(axis=1, keepdims=True)
    missed = (scaled.linear(ds, dz) - change) / np.maximum(1.0, scale)
    assert np.abs(missed).max() < 1e-5


def is_inside(cone: object, point: np.ndarray) -> bool:
    if isinstance(cone, Positive):
        return bool(np.all(point >= 0.0))
    return bool(point[0] >= np.linalg.norm(point[1:]))


def bisected(cone: object, place: np.ndarray, step: np.ndarray) -> float:
    """The longest step that stays inside; infinite above 10^6."""
    low, high = 0.0, 1e6
    if is_inside(cone, place + high * step):
        return np.inf
    for _ in range(200):
        middle = 0.5 * (low + high)
        if is_inside(cone, place + middle * step):
            low = middle
        else:
            high = middle
    return low


@cones
def test_longest_step_against_bisection(cone, size):
    random = np.random.default_rng(12)
    places, steps = inside(cone, size, 13), random.normal(size=(UNITS, size))
    steps[0] = places[0]  # outwards
    steps[1] = -places[1]  # to the apex
    for place, step in zip(places, steps, strict=True):
        found = cone.longest(place[None], step[None])
        expected = bisected(cone, place, step)
        assert found == pytest.approx(expected, rel=1e-6)
    assert cone.longest(places[:1], steps[:1]) == np.inf
    assert cone.longest(places[1:2], steps[1:2]) == pytest.approx(1.0, rel=1e-6)
    whole = min(bisected(cone, *pair) for pair in zip(places, steps, strict=True))
    assert cone.longest(places, steps) == pytest.approx(whole, rel=1e-6)
