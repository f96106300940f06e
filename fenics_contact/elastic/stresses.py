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
from fenics_contact.elastic.tetrahedra import tetrahedra
from fenics_contact.errors import SolverError
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.parallel import MPI
from fenics_contact.results.result import Collapse
from fenics_contact.spatial.contacts import Contact
from fenics_contact.spatial.loads import Acting
from fenics_contact.spatial.polyhedra import Block
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
        stress: Pa, shape (points, 3, 3).
        missing: Forces at nodes that were spread to balance it, over all forces at nodes.
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
        return np.asarray(np.linalg.eigvalsh(self.stress))

    @property
    def pressure(self) -> tuple[float, list[float]]:
        """The largest pressure, Pa, not below 0, and where, m."""
        return self._largest(-self.principal[:, 0])

    @property
    def tension(self) -> tuple[float, list[float]]:
        """The largest tension, Pa, not below 0, and where, m."""
        return self._largest(self.principal[:, 2])

    def _largest(self, values: Array) -> tuple[float, list[float]]:
        return max(float(values.max()), 0.0), self.points[values.argmax()].tolist()


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


def _loads(structure: Structure, end: Collapse, block: int) -> Iterator[tuple[Acting, Any, Array]]:
    """Loads, which of their parts act on a block, and these, N, shape (parts, 3)."""
    for key, acting in structure.acting.items():
        factor = float(end.load_factor) if key.startswith("loads.live") else 1.0
        here = np.flatnonzero(acting.block == block)
        yield acting, here, factor * acting.force[here]


def forces_on(
    structure: Structure, end: Collapse, block: int
) -> Iterator[tuple[Surface | Array, Array]]:
    """Surfaces, or places, m, and forces there, N, shape (points, 3), but for body forces.

    Edges and corners, ties and single forces act at places.
    """
    for sign, contact, points in _signed_contacts(structure, block):
        forces = sign * np.asarray(end.force)[points] @ contact.axes
        if len(contact.corners) > 2:
            areas = structure.points.area[points]
            yield Surface(contact.corners, contact.axes, -sign, areas), forces
        else:
            yield from zip(structure.points.position[points], forces[:, None], strict=True)
    for bar, tension in zip(structure.bars, np.asarray(end.tension), strict=True):
        pull = tension * (bar.ends[1] - bar.ends[0]) / np.linalg.norm(bar.ends[1] - bar.ends[0])
        ends = zip(bar.blocks, bar.ends, (pull, -pull), strict=True)
        yield from ((place, force[None]) for of, place, force in ends if of == block)
    for acting, here, forces in _loads(structure, end, block):
        if acting.sides:
            sides = (Surface.of_side(acting.sides[k]) for k in here)
            yield from zip(sides, forces[:, None], strict=True)
        elif acting.on:
            yield from zip(acting.place[here], forces[:, None], strict=True)


def at_nodes(
    body: ElasticBody, placed: Placed, structure: Structure, end: Collapse, known: dict[bytes, Any]
) -> Array:
    """F + B^T r of a block in the axes of its shape, N, shape (nodes, 3).

    Means over surfaces are kept: other blocks of the shape have contacts at the same places.

    Raises:
        SolverError: If a contact does not lie on the mesh.
    """
    turn = placed.rotation
    moments = np.zeros((4, 3))
    for acting, here, forces in _loads(structure, end, placed.block):
        if not acting.on:
            arms = placed.inside(acting.place[here]) - body.centroid
            moments += np.insert(arms, 0, 1.0, axis=1).T @ (forces @ turn)
    total = body.of_body(moments)
    size = body.volume ** (1.0 / 3.0)
    for where, forces in forces_on(structure, end, placed.block):
        if not isinstance(where, Surface):
            cell = np.array([body.cell_at(placed.inside(where))])
            share = body.shape_functions(cell, placed.inside(where)[None])
            total[body.cell_nodes[cell[0]]] += share.T @ (forces @ turn)
            continue
        corners, axes = placed.inside(where.corners), where.axes @ turn
        parts = corners / size, where.outwards * axes, where.areas / size**2
        key = b"".join(np.round(part, DIGITS).tobytes() for part in parts)
        if key not in known:
            known[key] = means(body, where._replace(corners=corners, axes=axes))
        total += known[key].T @ (forces @ turn)
    return total


# ---- stresses


def _body(scene: BlockScene, block: Block) -> ElasticBody:
    """A block, meshed.

    Raises:
        SolverError: If gmsh does not mesh it.
    """
    material = scene.material(block)

    def law(domain: Any) -> forms.Law:
        count = domain.topology.index_map(3).size_local
        if scene.stress is not None:
            of_cell, names = np.zeros(count, dtype=np.int32), np.array([block.group])
            materials = {block.group: material}
            return given_law(scene.stress, domain, names, of_cell, materials, MPI.COMM_SELF)
        first, shear = (np.full(count, value) for value in lame_numbers(material))
        like = cell_field(domain, "material", first)
        return like, cell_field(domain, "material", shear, like)

    return ElasticBody(*tetrahedra(block, scene.mesh_size), law)


def sorted_blocks(scene: BlockScene, structure: Structure) -> list[list[Placed]]:
    """Blocks that move by their shapes and materials; by themselves where laws ask for places."""
    by_place = scene.stress is not None and compat.arguments_of(scene.stress) > 2
    moving = np.flatnonzero(structure.number >= 0).tolist()
    kinds = {k: (scene.material(structure.blocks[k]), by_place and k) for k in moving}
    return shapes_of(structure.blocks, kinds, turned=scene.stress is None)


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
            body = _body(scene, structure.blocks[shape[0].like])
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
    force = body.balanced(given)
    missing = np.linalg.norm(force - given, axis=0) / np.linalg.norm(given, axis=0)
    motions = body.displacements(force).T
    for placed, u, part in zip(forces, motions, missing.tolist(), strict=True):
        turn = placed.rotation
        yield StressedBlock(
            placed.block,
            placed.outside(body.points),
            body.cells,
            body.at_points(u.reshape(-1, 3)[body.cell_nodes[:, :4]]) @ turn.T,  # nodes at corners
            turn @ body.stresses(u) @ turn.T,
            part,
        )
