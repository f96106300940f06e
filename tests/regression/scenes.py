"""Scenes of the regression tests: walls and blocks with any unit, number or orientation."""

from __future__ import annotations

import math
import runpy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, SolveOptions
from fenics_contact.meshing import arch, model_from_arrays, running_bond, wall, wedge

GRAVITY = 9.81
DENSITY = 1.0e4 / GRAVITY  # unit weight 10 kN/m3

#: Courses of the walls W1 ... W4, from the script that makes the meshes.
WALLS: dict[str, list[list[float]]] = {
    name.upper(): courses
    for name, courses in runpy.run_path(
        str(Path(__file__).parents[2] / "meshes" / "make_meshes.py")
    )["WALLS"].items()
}


@dataclass(frozen=True)
class Variant:
    """A change of a scene that must not change its load factor.

    Attributes:
        young: Factor on the modulus of elasticity.
        length: Unit of length in m.
        force: Unit of force in N.
        seed: Renumber nodes and cells at random; None leaves the numbers.
        mirrored: Mirror the scene and its live load left to right.
    """

    young: float = 1.0
    length: float = 1.0
    force: float = 1.0
    seed: int | None = None
    mirrored: bool = False


def wall_model(name: str, elements: int = 2, quadrilaterals: bool = False):
    """gmsh model of "W1" ... "W4", or of "10x10" for a running bond of that size."""
    if name in WALLS:
        return wall(WALLS[name], elements=elements, quadrilaterals=quadrilaterals)
    bricks, courses = map(int, name.split("x"))
    return running_bond(bricks, courses, elements=elements, quadrilaterals=quadrilaterals)


def wall_scene(
    name: str,
    law: JointLaw,
    elements: int = 2,
    variant: Variant | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
    degree: int = 1,
    quadrilaterals: bool = False,
    **options,
) -> Scene:
    """A wall on rigid ground, its weight times the load factor pushing to the right."""
    variant = variant or Variant()
    model = wall_model(name, elements, quadrilaterals)
    mesh = BlockMesh.from_model(changed(model, variant), comm)
    # New units: a length of 1 m is 1 / length of them, a force of 1 N is 1 / force.
    weight = DENSITY * GRAVITY / variant.force * variant.length**3
    stress = variant.length**2 / variant.force
    push = -1.0 if variant.mirrored else 1.0
    if law.bound is not None:
        law = JointLaw("tresca", bound=law.bound * stress)
    return Scene(
        mesh,
        {"default": Material(1e9 * variant.young * stress, 0.2, weight)},
        live=Load((push, 0.0)),
        dead=Load((0.0, -1.0)),
        joints={"default": law},
        foundations={"base": law},
        degree=degree,
        solve=SolveOptions(**options),
    )


def changed(model, variant: Variant):
    """The current gmsh model with other units, numbers or orientation."""
    points, cells, facets = arrays(model)
    points = points / variant.length
    if variant.mirrored:
        points = points * [-1.0, 1.0]
    if variant.seed is not None:
        random = np.random.default_rng(variant.seed)
        order = random.permutation(len(points))
        place = np.argsort(order)
        points = points[order]
        cells = {name: random.permutation(place[table]) for name, table in cells.items()}
        facets = {name: random.permutation(place[table]) for name, table in facets.items()}
    return model_from_arrays(points, cells, facets, "changed")


def arrays(model) -> tuple[npt.NDArray[np.float64], Mapping[str, npt.NDArray], Mapping]:
    """Points, cells by group and facets by group of a gmsh model."""
    tags, coordinates, _ = model.mesh.getNodes()
    place = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    place[tags.astype(np.int64)] = np.arange(len(tags))
    tables: tuple[dict[str, npt.NDArray], dict[str, npt.NDArray]] = ({}, {})
    for dim, target in ((2, tables[0]), (1, tables[1])):
        for _, group in model.getPhysicalGroups(dim):
            parts = []
            for entity in model.getEntitiesForPhysicalGroup(dim, group):
                types, _, nodes = model.mesh.getElements(dim, entity)
                for kind, flat in zip(types, nodes, strict=True):
                    width = model.mesh.getElementProperties(kind)[3]
                    parts.append(place[flat.astype(np.int64)].reshape(-1, width))
            target[model.getPhysicalName(dim, group)] = np.concatenate(parts)
    return coordinates.reshape(-1, 3)[:, :2], *tables


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Sequence[tuple[float, float]]:
    """Corners of a block."""
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


def arch_scene(voussoirs: int, thickness: float, friction: float = 1.0, elements: int = 2) -> Scene:
    """A semicircle of radius 1 on rigid ground, its weight times the load factor to the right."""
    law = JointLaw("coulomb", friction)
    return Scene(
        BlockMesh.from_model(arch(voussoirs, thickness, elements=elements)),
        {"default": Material(1e9, 0.2, 2000.0)},
        live=Load((GRAVITY, 0.0)),
        dead=Load((0.0, -GRAVITY)),
        joints={"default": law},
        foundations={"springings": law},
    )


def wedge_scene(friction: float) -> Scene:
    """A weightless wedge of half angle 30 degrees pressed down between two blocks on the ground.

    The pressure on the wedge is the weight of one block over its width, so that the load factor is
    P / W = 2 F / (cot(30 + phi) - F); the wedge locks at F = tan 30.
    """
    height, length = 0.5, 3.0
    half = height * math.tan(math.radians(30.0))
    weight = 1000.0 * GRAVITY * (length * height - 0.5 * half * height)
    law = JointLaw("coulomb", friction)
    return Scene(
        BlockMesh.from_model(wedge(30.0, height, length)),
        {"blocks": Material(1e9, 0.2, 1000.0), "wedge": Material(1e9, 0.2, 0.0)},
        live=Load((0.0, 0.0), {"top": (0.0, -0.5 * weight / half)}),
        dead=Load((0.0, -GRAVITY)),
        joints={"default": law},
        foundations={"base": law},
    )
