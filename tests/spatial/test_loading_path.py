"""Collapse states to which a load leads that rises from rest: the plane's path, in space."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fenics_contact import Scene as PlanarScene
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.spatial import Scene, limit_load
from tests.quick import slow

ROOT = Path(__file__).parents[2]
#: Load factors of the planar path, friction 0.65.
WALLS = {"w3": 0.35582, "w4": 0.26374}


def extruded(name: str, **solve) -> Scene:
    """A wall of rectangles of a planar mesh, 0.4 m thick, on rigid ground."""
    planar = PlanarScene.from_file(
        ROOT / "demos" / "03_wall_w3.toml", overrides=[f'mesh.file="../meshes/{name}.msh"']
    )
    with Discretization(planar) as made:
        points, body = made.boundary.points[:, :, :2], made.boundary.body
    blocks = {}
    for number in np.unique(body):
        corners = points[body == number].reshape(-1, 2)
        (x, z), (far, top) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        blocks[f"b{number}"] = {"box": [[x, 0.0, z], [far, 0.4, top]]}
    tables = {
        "dimension": 3,
        "blocks": blocks,
        "materials": {"default": {"density": 2000.0}},
        "joints": {"default": {"friction": 0.65}},
        "loads": {
            "dead": {"body": [0.0, 0.0, -9.81]},
            "live": {"direction": [1.0, 0.0, 0.0]},
        },
        "solve": solve,
    }
    return Scene.from_tables(tables, Path())


@pytest.mark.parametrize("name", ["w4", *slow("w3")])
def test_wall_of_the_plane_collapses_as_there(name):
    result = limit_load(extruded(name, fast=True))
    found = result.ends["positive"]
    assert (found.status, found.way) == ("limit", "follow")
    assert found.load_factor == pytest.approx(WALLS[name], abs=1e-3)
    assert found.gap < 1e-5


def test_state_of_one_solve_is_told_beside_that_of_the_path():
    result = limit_load(extruded("w4"))
    one, two = result.ends["positive"].states
    assert (one.start, two.start) == ("follow", "one shot")
    assert one.load_factor == pytest.approx(WALLS["w4"], abs=1e-3)
    assert two.gap < 1e-3
    told = "also found:" in result.summary()
    assert told == (abs(two.load_factor - one.load_factor) > 1e-2 * one.load_factor)
