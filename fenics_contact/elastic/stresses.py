"""Stresses in blocks in space under the forces of a certified state: K u = f + B^T r.

Blocks are taken one by one: each is balanced by the forces at its points and its loads, so that its
strains need no other block. Blocks of one shape share mesh, stiffness and factor, which are dropped
before the next shape.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from fenics_contact import compat
from fenics_contact.discretization import forms
from fenics_contact.discretization.materials import given_law, lame_numbers
from fenics_contact.elastic.body import ElasticBody
from fenics_contact.elastic.means import Surface, means
from fenics_contact.elastic.shapes import Placed, shapes_of
from fenics_contact.elastic.tetrahedra import tetrahedra
from fenics_contact.errors import SolverError
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.lazily import fem
from fenics_contact.parallel import MPI, PETSc
from fenics_contact.results.result import Collapse
from fenics_contact.spatial.polyhedra import Block
from fenics_contact.spatial.scene import BlockScene
from fenics_contact.spatial.structure import Structure
from fenics_contact.spatial.ties import GROUND

#: Right sides that are solved for at once.
TOGETHER = 50
#: Digits of places by which surfaces of equal blocks are the same, in parts of the block's size.
DIGITS = 8


@dataclass(frozen=True, eq=False)
class StressedBlock:
    """Stresses in a block, at the corners of its tetrahedra: means of those of the cells.

    Attributes:
        block: Its number.
        name: What people read; its number where it has none.
        strength: Tensile strength of its stone, Pa, infinite where none is given.
        points: Corners of tetrahedra, m, shape (points, 3).
        cells: Numbers of these, shape (cells, 4).
        displacement: By strains alone, m, shape (points, 3).
        stress: Pa, shape (points, 3, 3).
        missing: Forces at nodes that were spread to balance it, over all forces at nodes.
    """

    block: int
    name: str
    strength: float
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
        missed: Why others have none, by name.
    """

    blocks: tuple[StressedBlock, ...]
    missed: Mapping[str, str] = field(default_factory=dict)

    @property
    def cracked(self) -> list[StressedBlock]:
        """Blocks with a tension over the strength of their stone."""
        return [one for one in self.blocks if one.tension[0] > one.strength]


# ---- what acts on a block


class ForcesOnBlock(NamedTuple):
    """What acts on a block.

    Attributes:
        at: Surfaces, or places, m, with forces there, N, shape (points, 3). Edges and corners, ties
            and single forces act at places.
        moments: Of body forces: their sum, N, and those of y F^T about the centroid, N m, shape
            (4, 3).
    """

    at: list[tuple[Surface | Array, Array]]
    moments: Array


class Touch(NamedTuple):
    """Where units act on a block.

    Attributes:
        where: The surface of a contact; or a place, m, of an edge, a corner or a tie.
        units: Numbers of the points, or bars after all points.
        axes: Along which their forces act on the block, shape (3, 3).
    """

    where: Surface | Array
    units: Indices
    axes: Array


def touches_of(structure: Structure) -> list[list[Touch]]:
    """Where units act on the blocks, in their order."""
    found: list[list[Touch]] = [[] for _ in structure.blocks]
    points = structure.points
    for number, contact in enumerate(structure.contacts):
        mine = np.flatnonzero(points.contact == number)
        for block, sign in ((contact.first, -1.0), (contact.second, 1.0)):
            axes = sign * contact.axes
            if len(contact.corners) > 2:
                surface = Surface(contact.corners, contact.axes, -sign, points.area[mine])
                found[block].append(Touch(surface, mine, axes))
                continue
            found[block].extend(Touch(points.position[k], mine[mine == k], axes) for k in mine)
    for unit, bar in enumerate(structure.bars, len(points.area)):
        for block, place, sign in zip(bar.blocks, bar.ends, (-1.0, 1.0), strict=True):
            if block != GROUND:
                found[block].append(Touch(place, np.array([unit]), sign * structure.axes[unit]))
    return found


def forces_on_blocks(structure: Structure, end: Collapse) -> list[ForcesOnBlock]:
    """What acts on the blocks in a state, in their order."""
    pulled = np.outer(np.asarray(end.tension), [0.0, -1.0, 0.0])
    forces = np.vstack([np.asarray(end.force), pulled])
    found = loads_on_blocks(structure, float(end.load_factor))
    for one, touches in zip(found, touches_of(structure), strict=True):
        one.at.extend((touch.where, forces[touch.units] @ touch.axes) for touch in touches)
    return found


def loads_on_blocks(structure: Structure, load_factor: float) -> list[ForcesOnBlock]:
    """The dead load and a multiple of the live load, by blocks."""
    found = [ForcesOnBlock([], np.zeros((4, 3))) for _ in structure.blocks]
    for key, acting in structure.acting.items():
        factor = load_factor if key.startswith("loads.live") else 1.0
        for k, block in enumerate(acting.block.tolist()):
            force = factor * acting.force[[k]]
            if acting.sides:
                side = Surface.of_side(acting.sides[k])
                found[block].at.append((side, np.outer(side.areas / side.areas.sum(), force)))
            elif acting.on:
                found[block].at.append((acting.place[k], force))
            else:
                arm = acting.place[k] - structure.blocks[block].centroid
                found[block].moments[:] += np.insert(arm, 0, 1.0)[:, None] * force
    return found


def table_at(
    body: ElasticBody, placed: Placed, where: Surface | Array, known: dict[bytes, Any]
) -> Any:
    """Displacements at the points of a surface, or at a place, from those of nodes: sparse.

    Means over surfaces are kept: other blocks of the shape have contacts at the same places.

    Raises:
        SolverError: If a contact does not lie on the mesh.
    """
    from scipy.sparse import csr_matrix

    if not isinstance(where, Surface):
        place = placed.inside(where)
        cell = body.cell_at(place)
        share = body.shape_functions(np.array([cell]), place[None])
        nodes = body.cell_nodes[cell]
        return csr_matrix((share[0], (np.zeros_like(nodes), nodes)), (1, len(body.nodes)))
    size = body.volume ** (1.0 / 3.0)
    corners, axes = placed.inside(where.corners), where.axes @ placed.rotation
    parts = corners / size, where.outwards * axes, where.areas / size**2
    key = b"".join(np.round(part, DIGITS).tobytes() for part in parts)
    if key not in known:
        known[key] = means(body, where._replace(corners=corners, axes=axes))
    return known[key]


def at_nodes(
    body: ElasticBody, placed: Placed, given: ForcesOnBlock, known: dict[bytes, Any]
) -> Array:
    """F + B^T r of a block in the axes of its shape, N, shape (nodes, 3).

    Raises:
        SolverError: If a contact does not lie on the mesh.
    """
    turn = placed.rotation
    force, moments = given.moments[:1] @ turn, turn.T @ given.moments[1:] @ turn
    total = body.of_body(np.vstack([force, moments]))
    for where, forces in given.at:
        total += table_at(body, placed, where, known).T @ (forces @ turn)
    return total


# ---- stresses


def body_of(scene: BlockScene, block: Block, degree: int = 2) -> ElasticBody:
    """A block, meshed, with displacements of a degree.

    Raises:
        SolverError: If gmsh does not mesh it.
    """
    material = scene.material(block)

    def law(domain: Any) -> forms.Law:
        if scene.stress is None:
            numbers = lame_numbers(material)
            return tuple(fem.Constant(domain, PETSc.ScalarType(value)) for value in numbers)
        of_cell = np.zeros(domain.topology.index_map(3).size_local, dtype=np.int32)
        parts = np.array([block.group]), of_cell, {block.group: material}
        return given_law(scene.stress, domain, *parts, MPI.COMM_SELF)

    return ElasticBody(*tetrahedra(block, scene.mesh_size), law, degree)


def sorted_blocks(scene: BlockScene, structure: Structure) -> list[list[Placed]]:
    """Blocks that move by their shapes and materials.

    They are by themselves where laws ask for places, or the blocks' own tetrahedra are taken.
    """
    by_place = scene.stress is not None and compat.arguments_of(scene.stress) > 2
    blocks = structure.blocks
    kinds = {}
    for k in np.flatnonzero(structure.number >= 0).tolist():
        own = by_place or (scene.mesh_size is None and blocks[k].cells is not None)
        kinds[k] = scene.material(blocks[k]), k if own else -1
    return shapes_of(blocks, kinds, turned=scene.stress is None)


def stressed_blocks(
    scene: BlockScene, structure: Structure, end: Collapse, shapes: Sequence[Sequence[Placed]]
) -> BlockStresses:
    """A task: stresses in blocks of some shapes.

    Args:
        scene: Materials, and the length of edges.
        structure: The blocks.
        end: Forces at points, of ties, and the load factor.
        shapes: Blocks by shape.
    """
    found: list[StressedBlock] = []
    missed: dict[str, str] = {}
    acts = forces_on_blocks(structure, end)
    names = [block.name or str(k) for k, block in enumerate(structure.blocks)]
    for shape in shapes:
        first = structure.blocks[shape[0].like]
        strength = scene.material(first).tensile_strength or np.inf
        try:
            body = body_of(scene, first)
        except SolverError as error:
            missed |= {names[placed.block]: str(error) for placed in shape}
            continue
        known: dict[bytes, Any] = {}
        for start in range(0, len(shape), TOGETHER):
            forces = {}
            for placed in shape[start : start + TOGETHER]:
                try:
                    forces[placed] = at_nodes(body, placed, acts[placed.block], known).ravel()
                except SolverError as error:
                    missed[names[placed.block]] = str(error)
            for placed, *fields in _stressed(body, forces) if forces else ():
                found.append(StressedBlock(placed.block, names[placed.block], strength, *fields))
    return BlockStresses(tuple(found), missed)


def _stressed(body: ElasticBody, forces: Mapping[Placed, Array]) -> Iterator[tuple[Any, ...]]:
    """Stresses in blocks of one shape, by forces at their nodes, N, shape (3 nodes,).

    They are told as the fields of `StressedBlock` from `points` on.
    """
    given = np.array(list(forces.values())).T
    force = body.balanced(given)
    missing = np.linalg.norm(force - given, axis=0) / np.linalg.norm(given, axis=0)
    motions = body.displacements(force).T
    for placed, u, part in zip(forces, motions, missing.tolist(), strict=True):
        turn = placed.rotation
        yield (
            placed,
            placed.outside(body.points),
            body.cells,
            body.at_points(u.reshape(-1, 3)[body.cell_nodes[:, :4]]) @ turn.T,  # nodes at corners
            turn @ body.stresses(u) @ turn.T,
            part,
        )
