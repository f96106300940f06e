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


def jordan(cone: object, v: np.ndarray, w: np.ndarray) -> np.ndarray:
    """The product v o w."""
    if isinstance(cone, Positive):
        return v * w
    first = np.sum(v * w, axis=1, keepdims=True)
    return np.hstack([first, v[:, :1] * w[:, 1:] + w[:, :1] * v[:, 1:]])


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
def test_products_are_those_of_the_scaled_point(cone, size):
    """Summed, or in the first component of a disc, they are s . z."""
    slack, dual = inside(cone, size, 5), inside(cone, size, 6)
    products = cone.scaled(slack, dual).products
    expected = np.sum(slack * dual, axis=1)
    found = products.sum(axis=1) if isinstance(cone, Positive) else products[:, 0]
    assert found == pytest.approx(expected, rel=1e-7)


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


@cones
def test_second_order_of_products(cone, size):
    """(W^-1 ds) o (W dz) for ds = s and dz = z is l o l."""
    slack, dual = inside(cone, size, 10), inside(cone, size, 11)
    scaled = cone.scaled(slack, dual)
    assert scaled.cross(slack, dual) == pytest.approx(scaled.products, rel=1e-6, abs=1e-8)


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


@cones
def test_margin_is_zero_on_the_boundary(cone, size):
    places = inside(cone, size, 14)
    assert np.all(cone.margin(places) > 0.0)
    edge = places.copy()
    edge[:, 0] = 0.0 if isinstance(cone, Positive) else np.linalg.norm(places[:, 1:], axis=1)
    assert cone.margin(edge) == pytest.approx(np.zeros(UNITS), abs=1e-12)


@cones
def test_raised_multipliers_are_inside_with_large_products(cone, size):
    slack, dual = inside(cone, size, 15), 1e-6 * inside(cone, size, 16)
    raised = cone.raised(slack, dual, 1e-2)
    assert np.all(cone.margin(raised) > 0.0)
    assert cone.margin(jordan(cone, slack, raised)).min() >= 1e-2 * (1.0 - 1e-6)
    assert cone.raised(slack, 1e6 * dual, 0.0) == pytest.approx(1e6 * dual)
