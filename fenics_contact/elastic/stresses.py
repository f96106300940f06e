"""Stresses in blocks in space under the forces of a certified state: K u = f + B^T r.

Blocks are taken one by one: each is balanced by the forces at its points and its loads, so that its
strains need no other block. Blocks of one shape share mesh, stiffness and factor, which are dropped
before the next shape.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.discretization import forms
from fenics_contact.discretization.materials import cell_field, given_law, lame_numbers
from fenics_contact.elastic.body import ElasticBody
from fenics_contact.elastic.means import Surface, means
from fenics_contact.elastic.shapes import Placed, shapes_of
from fenics_contact.elastic.tetrahedra import size_of, tetrahedra
from fenics_contact.errors import SolverError
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.parallel import MPI
from fenics_contact.results.result import Collapse
from fenics_contact.spatial.contacts import Contact, frame, polygon_area
from fenics_contact.spatial.scene import BlockScene
from fenics_contact.spatial.structure import Structure

#: Right sides that are solved for at once.
TOGETHER = 50
#: Digits of places by which surfaces of equal blocks are the same, in parts of the block's size.
DIGITS = 8


@dataclass(frozen=True, eq=False)
class StressedBlock:
    """Stresses in a block, at the corners of its tetrahedra: means of those of the cells.

    Attributes:
        block: Its number.
        points: Corners of tetrahedra, m, shape (points, 3).
        cells: Numbers of these, shape (cells, 4).
        displacement: By strains alone, m, shape (points, 3).
        stress: xx, yy, zz, xy, xz, yz, Pa, shape (points, 6).
        missing: What was spread over the block to balance it, over the largest force on it.
    """

    block: int
    points: Array
    cells: Indices
    displacement: Array
    stress: Array
    missing: float

    @cached_property
    def principal(self) -> Array:
        """Principal stresses at the points, Pa, the least first, shape (points, 3)."""
        return np.asarray(np.linalg.eigvalsh(_tensors(self.stress)))

    @property
    def pressure(self) -> tuple[float, list[float]]:
        """The largest pressure, Pa, not below 0, and where, m."""
        at = int(self.principal[:, 0].argmin())
        return max(-float(self.principal[at, 0]), 0.0), self.points[at].tolist()

    @property
    def tension(self) -> tuple[float, list[float]]:
        """The largest tension, Pa, not below 0, and where, m."""
        at = int(self.principal[:, 2].argmax())
        return max(float(self.principal[at, 2]), 0.0), self.points[at].tolist()


def _tensors(stress: Array) -> Array:
    """Symmetric tensors, shape (., 3, 3), of their components, shape (., 6)."""
    tensor = np.zeros((len(stress), 3, 3))
    for k, (i, j) in enumerate(forms.voigt(3)):
        tensor[:, i, j] = tensor[:, j, i] = stress[:, k]
    return tensor


@dataclass(frozen=True, eq=False)
class BlockStresses:
    """Stresses in the blocks of a structure under the forces of a certified state.

    Attributes:
        blocks: Of those that were meshed.
        names: Of all blocks.
        missed: Why others have none, by name.
        exceeded: Tensions over the strength of the stone, and this, Pa, by name.
    """

    blocks: tuple[StressedBlock, ...]
    names: tuple[str, ...]
    missed: Mapping[str, str] = field(default_factory=dict)
    exceeded: Mapping[str, tuple[float, float]] = field(default_factory=dict)


# ---- what acts on a block


def _signed_contacts(structure: Structure, block: int) -> Iterator[tuple[float, Contact, Indices]]:
    """Contacts of a block with numbers of their points; 1.0 where it is the second, else -1.0."""
    for number in np.flatnonzero(np.any(structure.pairs == block, axis=1)):
        contact = structure.contacts[number]
        points = np.flatnonzero(structure.points.contact == number)
        yield (1.0 if contact.second == block else -1.0), contact, points


def _factors(structure: Structure, end: Collapse) -> Iterator[tuple[float, Any]]:
    """Loads with their factors."""
    for key, acting in structure.acting.items():
        yield (float(end.load_factor) if key.startswith("loads.live") else 1.0), acting


def on_surfaces(structure: Structure, end: Collapse, block: int) -> Iterator[tuple[Surface, Array]]:
    """Contacts and loaded sides of a block, and forces at their points, N, shape (points, 3)."""
    for sign, contact, points in _signed_contacts(structure, block):
        if len(contact.corners) > 2:
            areas = structure.points.area[points]
            forces = sign * np.asarray(end.force)[points] @ contact.axes
            yield Surface(contact.corners, contact.axes, -sign, areas), forces
    for factor, acting in _factors(structure, end):
        for k in np.flatnonzero(acting.block == block) if acting.sides else ():
            corners = acting.sides[k]
            along = corners[1] - corners[0]
            axes = frame(np.cross(along, corners[2] - corners[1]), along)
            area = polygon_area((corners - corners[0]) @ axes[1:].T)
            yield Surface(corners, axes, 1.0, np.array([area])), factor * acting.force[[k]]


def at_places(structure: Structure, end: Collapse, block: int) -> Iterator[tuple[Array, Array]]:
    """Places, m, and forces, N, of edges and corners, ties, and loads at places."""
    for sign, contact, points in _signed_contacts(structure, block):
        for point in points if len(contact.corners) < 3 else ():
            yield (
                structure.points.position[point],
                sign * np.asarray(end.force)[point] @ contact.axes,
            )
    for bar, tension in zip(structure.bars, np.asarray(end.tension), strict=True):
        pull = tension * (bar.ends[1] - bar.ends[0]) / np.linalg.norm(bar.ends[1] - bar.ends[0])
        ends = zip(bar.blocks, bar.ends, (pull, -pull), strict=True)
        yield from ((place, force) for of, place, force in ends if of == block)
    for factor, acting in _factors(structure, end):
        for k in np.flatnonzero(acting.block == block) if acting.on and not acting.sides else ():
            yield acting.place[k], factor * acting.force[k]


def of_body(structure: Structure, end: Collapse, block: int) -> tuple[Array, Array]:
    """Sums of body forces, N, and of places from the centroid times these, N m, shape (3, 3)."""
    force, moments = np.zeros(3), np.zeros((3, 3))
    for factor, acting in _factors(structure, end):
        if not acting.on:
            here = acting.block == block
            values = factor * acting.force[here]
            force += values.sum(axis=0)
            moments += (acting.place[here] - structure.blocks[block].centroid).T @ values
    return force, moments


def at_nodes(
    body: ElasticBody, placed: Placed, structure: Structure, end: Collapse, known: dict[bytes, Any]
) -> Array:
    """F + B^T r of a block in the axes of its shape, N, shape (nodes, 3).

    Means over surfaces are kept: other blocks of the shape have contacts at the same places.

    Raises:
        SolverError: If a contact does not lie on the mesh.
    """
    given = structure, end, placed.block
    turn = placed.rotation
    force, moments = of_body(*given)
    total = body.of_body(force @ turn, turn.T @ moments @ turn)
    size = body.volume ** (1.0 / 3.0)
    for surface, forces in on_surfaces(*given):
        corners, axes = placed.inside(surface.corners), surface.axes @ turn
        parts = corners / size, surface.outwards * axes, surface.areas / size**2
        key = b"".join(np.round(part, DIGITS).tobytes() for part in parts)
        if key not in known:
            known[key] = means(body, surface._replace(corners=corners, axes=axes))
        total += known[key].T @ (forces @ turn)
    for place, one in at_places(*given):
        cell = np.array([body.cell_at(placed.inside(place))])
        share = body.shape_functions(cell, placed.inside(place)[None])
        total[body.cell_nodes[cell[0]]] += share.T * (one @ turn)
    return total


# ---- stresses


def material_name(scene: BlockScene, structure: Structure, block: int) -> str:
    """Key of the material of a block."""
    group = structure.blocks[block].group
    return group if group in scene.materials else "default"


def _body(scene: BlockScene, structure: Structure, block: int) -> ElasticBody:
    """A block, meshed.

    Raises:
        SolverError: If gmsh does not mesh it.
    """
    name = material_name(scene, structure, block)
    given = structure.blocks[block]

    def law(domain: Any) -> forms.Law:
        count = domain.topology.index_map(3).size_local
        if scene.stress is not None:
            of_cell = np.zeros(count, dtype=np.int32)
            materials = np.array([name]), of_cell, scene.materials
            return given_law(scene.stress, domain, *materials, MPI.COMM_SELF)
        first, shear = (np.full(count, v) for v in lame_numbers(scene.materials[name]))
        like = cell_field(domain, "material", first)
        return like, cell_field(domain, "material", shear, like)

    return ElasticBody(*tetrahedra(given, scene.mesh_size or size_of(given)), law)


def sorted_blocks(scene: BlockScene, structure: Structure) -> list[list[Placed]]:
    """Blocks that move by their shapes and materials; by themselves where laws ask for places."""
    by_place = scene.stress is not None and compat.arguments_of(scene.stress) > 2

    def kind(number: int) -> Any:
        return material_name(scene, structure, number), number if by_place else 0

    moving = np.flatnonzero(structure.number >= 0).tolist()
    return shapes_of(structure.blocks, moving, kind, turned=scene.stress is None)


def stressed_blocks(
    scene: BlockScene, structure: Structure, end: Collapse, shapes: Sequence[Sequence[Placed]]
) -> tuple[list[StressedBlock], dict[int, str]]:
    """A task: stresses in blocks of some shapes, and why others have none, by their numbers.

    Args:
        scene: Materials, and the length of edges.
        structure: The blocks.
        end: Forces at points, of ties, and the load factor.
        shapes: Blocks by shape.
    """
    found: list[StressedBlock] = []
    missed: dict[int, str] = {}
    for shape in shapes:
        try:
            body = _body(scene, structure, shape[0].like)
        except SolverError as error:
            missed |= {placed.block: str(error) for placed in shape}
            continue
        known: dict[bytes, Any] = {}
        for start in range(0, len(shape), TOGETHER):
            forces = {}
            for placed in shape[start : start + TOGETHER]:
                try:
                    forces[placed] = at_nodes(body, placed, structure, end, known).ravel()
                except SolverError as error:
                    missed[placed.block] = str(error)
            found += _stressed(body, forces) if forces else ()
    return found, missed


def _stressed(body: ElasticBody, forces: Mapping[Placed, Array]) -> Iterator[StressedBlock]:
    """Stresses in blocks of one shape, by forces at their nodes, N, shape (3 nodes,)."""
    given = np.array(list(forces.values())).T
    largest = np.abs(given.reshape(len(body.nodes), 3, -1)).sum(axis=0).max(axis=0)
    missing = np.linalg.norm(body.rigid.T @ given, axis=0) / largest
    motions = body.displacements(body.balanced(given)).T
    for placed, u, part in zip(forces, motions, missing.tolist(), strict=True):
        turn = placed.rotation
        stress = turn @ _tensors(body.at_points(body.stresses(u))) @ turn.T
        at_corners = u.reshape(-1, 3)[body.cell_nodes[:, :4]]  # nodes at corners come first
        yield StressedBlock(
            placed.block,
            placed.outside(body.points),
            body.cells,
            body.at_points(at_corners) @ turn.T,
            np.stack([stress[:, i, j] for i, j in forms.voigt(3)], axis=1),
            part,
        )
