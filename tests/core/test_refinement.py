"""Refined meshes: areas, groups, bodies and joints stay; joints still match; angles stay wide."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import BlockMesh, Scene, compat, limit_load
from fenics_contact.geometry.refinement import refine
from tests.bank import coulomb, wall_recipe

pytestmark = pytest.mark.mpi


def corners(mesh: BlockMesh) -> np.ndarray:
    """Corners of this rank's cells, one after the other, shape (cells, corners of a cell, 2)."""
    around = [0, 1, 3, 2] if mesh.domain.topology.cell_type.name == "quadrilateral" else [0, 1, 2]
    return mesh.domain.geometry.x[compat.geometry_dofs(mesh.domain)[:, around]][:, :, :2]


def near(mesh: BlockMesh, x: float, y: float, radius: float) -> np.ndarray:
    """Cells with their centre next to a point."""
    centre = corners(mesh).mean(axis=1)
    return np.hypot(centre[:, 0] - x, centre[:, 1] - y) < radius


def refined(scene: Scene, x: float, y: float, times: int) -> Scene:
    """The scene on a mesh refined towards a point."""
    for k in range(times):
        mesh = scene.mesh
        scene = replace(scene, mesh=refine(mesh, near(mesh, x, y, 0.8 * 0.5**k)))
    return scene


@pytest.mark.parametrize("degree", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_load_factor_of_a_refined_wall_on_any_ranks(degree):
    """That of W1 does not depend on the mesh, that of W4 does."""
    scene = wall_recipe("W1", coulomb(0.65)).scene(2)
    finer = replace(refined(scene, 0.4, 0.175, 3), degree=degree)
    assert limit_load(finer).load_factor == pytest.approx(limit_load(scene).load_factor, rel=1e-7)
    alone = wall_recipe("W4", coulomb(0.65)).scene(2, comm=MPI.COMM_SELF)
    whole = wall_recipe("W4", coulomb(0.65)).scene(2)
    factors = [limit_load(refined(one, 0.6, 0.9, 2)).load_factor for one in (alone, whole)]
    assert math.isfinite(factors[0])
    assert factors[1] == pytest.approx(factors[0], rel=1e-7)
