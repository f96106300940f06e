"""Supports: what they hold, and in which coordinates."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import Scene
from fenics_contact.discretization.facets import collect_boundary
from fenics_contact.discretization.materials import displacement_space
from fenics_contact.discretization.supports import Supports, find_supports
from fenics_contact.meshing import polygons
from tests.helpers import PUSH, STONE, Drawing, grid_blocks, mesh_of


def square(angle: float = 0.0, divisions: tuple[int, int] = (2, 2)) -> Drawing:
    """A block from (0, 0) to (1, 1), turned; its sides are groups."""
    return grid_blocks(((0, 0), (1, 1), divisions)).turned(angle)


def scene_with(model, supports: dict[str, str]) -> Scene:
    return Scene(mesh_of(model), {"default": STONE}, live=PUSH, supports=supports)


def supports_in(scene: Scene) -> Supports:
    return find_supports(scene, collect_boundary(scene.mesh, displacement_space(scene)))


def supports_of(drawing: Drawing, supports: dict[str, str]) -> Supports:
    return supports_in(scene_with(drawing.model(), supports))


def held_at(supports: Supports, x: float, y: float) -> list[bool]:
    """What is held at the node at a place."""
    (row,) = np.flatnonzero(np.abs(supports.points - [x, y]).max(axis=1) < 1e-12)
    return supports.held[row].tolist()


@pytest.mark.parametrize("left", ["roller", "fixed"])
@pytest.mark.parametrize(
    ("degrees", "divisions"),
    [(0.0, (2, 2)), (90.0, (2, 2)), (20.0, (2, 2)), (0.0, (2, 100)), (0.0, (100, 2))],
)
def test_corner_of_two_supports_is_held_however_short_the_facets(left, degrees, divisions):
    drawing = square(np.radians(degrees), divisions)
    supports = supports_of(drawing, {"bottom0": "roller", "left0": left})
    across, along = divisions
    assert len(supports.nodes) == across + along + 1
    assert held_at(supports, 0.0, 0.0) == [True, True]
    if left == "roller":
        assert np.count_nonzero(supports.held) == across + along + 2


@pytest.mark.parametrize(
    ("kink", "both"), [(5.0, False), (14.0, False), (16.0, True), (40.0, True)]
)
def test_roller_along_a_curve_holds_the_mean_normal(kink, both):
    # Two sides of one roller group that meet at the origin, symmetric about the vertical.
    sag = np.tan(np.radians(0.5 * kink))
    outline = [(0, 0), (1, sag), (1, 2), (-1, 2), (-1, sag)]
    model = polygons([outline], 3.0, groups={"sole": [((0, 0), (1, sag)), ((-1, sag), (0, 0))]})
    supports = supports_in(scene_with(model, {"sole": "roller"}))
    assert held_at(supports, 0.0, 0.0) == ([True, True] if both else [False, True])
