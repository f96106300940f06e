"""Contacts with a compressive strength, against blocks of pressure by hand."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from fenics_contact import InputError
from fenics_contact.scene.scene import SolveOptions
from fenics_contact.spatial import JointLaw, Load, Material, Scene, builders
from fenics_contact.spatial.contacts import Contact
from fenics_contact.spatial.crushing import rectangle_of
from fenics_contact.spatial.limit import limit_load
from fenics_contact.spatial.polyhedra import Block, Polyhedron

WIDTH, DEPTH, HEIGHT = 1.0, 0.6, 2.0
#: Weight of the block over its base, Pa.
PRESSURE = 2000.0 * 9.81 * HEIGHT


def scene_of(blocks, strength, push, quick=True):
    return Scene(
        blocks=tuple(blocks),
        materials={"default": Material(density=2000.0)},
        joints={"default": JointLaw(friction=2.0, compressive_strength=strength)},
        dead=Load((0.0, 0.0, -9.81)),
        live=Load((9.81 * push[0], 9.81 * push[1], 0.0)),
        solve=SolveOptions(quick=quick, fast=True),
    )


@pytest.mark.parametrize("times", [1.2, 3.0, 30.0])
@pytest.mark.parametrize("degrees", [0.0, 30.0, 45.0, 80.0])
def test_block_of_pressure(degrees, times):
    """W = f_c (b - lambda H cos) (h - lambda H sin), at the centroid's height H / 2."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    block = Block((Polyhedron.box([0.0, 0.0, 0.0], [WIDTH, DEPTH, HEIGHT]),), "stone")
    found = limit_load(scene_of([block], times * PRESSURE, (c, s)))

    def left(factor):
        return times * (1.0 - factor * HEIGHT * c / WIDTH) * (1.0 - factor * HEIGHT * s / DEPTH) - 1

    most = min(WIDTH / HEIGHT / max(c, 1e-9), DEPTH / HEIGHT / max(s, 1e-9))
    assert found.load_factor == pytest.approx(brentq(left, 0.0, most), rel=1e-6)
    assert found.collapse.residuals["crushing"] < 1e-7


def test_wall_turns_about_a_hinge_inside():
    """Out of plane lambda = (t - W / (f_c b)) / H: W / b of the wall on its foot."""
    blocks = builders.wall(length=1.2, height=0.8, thickness=0.2, brick=(0.4, 0.2))
    weight = 2000.0 * 9.81 * 0.8 * 0.2  # over the length
    strength = 20.0 * weight / 0.2
    found = limit_load(scene_of(blocks, strength, (0.0, 1.0), quick=False))
    assert found.load_factor == pytest.approx((0.2 - weight / strength) / 0.8, rel=1e-4)


@pytest.mark.parametrize("size", [1e-4, 1e6])
def test_size_of_the_live_load_and_huge_strengths_change_nothing(size):
    """A column under a force: the same force; and next to the width over the height at 1e13 Pa."""
    blocks = [
        Block((Polyhedron.box([0.0, 0.0, z], [WIDTH, DEPTH, z + 1.0]),), f"stone_{z:g}")
        for z in (0.0, 1.0)
    ]
    for strength, tall in ((3.0 * PRESSURE, 2.0 / 3.0), (1e13, 1.0)):
        scene = scene_of(blocks, strength, (1.0, 0.0))
        scene = replace(scene, live=Load(body=(9.81 * size, 0.0, 0.0)))
        found = limit_load(scene)
        assert found.status == "limit"
        expected = tall * WIDTH / HEIGHT  # lambda H = b - W / (h f_c)
        assert size * found.load_factor == pytest.approx(expected, rel=2e-4)
        assert found.collapse.residuals["crushing"] < 1e-7


def test_rectangle_in_a_polygon():
    frame = np.eye(3)[[2, 0, 1]]
    square = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]], dtype=float)
    middle, _, sides = rectangle_of(Contact(0, 1, frame, square))
    assert sorted(sides) == pytest.approx([1.0, 2.0])
    angles = np.radians(60.0 * np.arange(6))
    hexagon = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])
    middle, _, sides = rectangle_of(Contact(0, 1, frame, hexagon))
    assert middle + hexagon[0, :2] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert np.prod(sides) == pytest.approx(3.0**0.5, rel=1e-9)


def test_clarabel_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "clarabel", None)
    block = Block((Polyhedron.box([0.0, 0.0, 0.0], [WIDTH, DEPTH, HEIGHT]),), "stone")
    scene = scene_of([block], 3.0 * PRESSURE, (1.0, 0.0))
    with pytest.raises(InputError, match="pip install clarabel"):
        limit_load(replace(scene, title="without"))
