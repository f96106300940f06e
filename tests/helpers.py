"""Small blocks, walls and structures, and PETSc objects as whole numpy arrays on every rank."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene
from fenics_contact.limit_load import typical_sizes
from fenics_contact.mesh import GmshMesh
from fenics_contact.meshing import model_from_arrays, wall
from fenics_contact.solvers.kkt import Scales, State
from fenics_contact.discretization.discretization import Bonded, Structure

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

GRAVITY = 9.81
STONE = Material(1e9, 0.2, 2000.0)
WEIGHT = Load((0.0, -GRAVITY))
PUSH = Load((GRAVITY, 0.0))  # the weight to the right


def rectangle(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float]]:
    """Corners of a block."""
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


def rotation(angle: float) -> Array:
    """Matrix that turns by an angle (radians) anticlockwise."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@dataclass
class Drawing:
    """A gmsh model as arrays.

    Attributes:
        points: Coordinates, shape (points, 2).
        cells: Point indices by two-dimensional group.
        facets: Point indices by one-dimensional group.
    """

    points: Array
    cells: dict[str, Indices]
    facets: dict[str, Indices]

    @classmethod
    def of(cls, model: Any) -> Drawing:
        """Read the current gmsh model."""
        tags, coordinates, _ = model.mesh.getNodes()
        place = np.zeros(int(tags.max()) + 1, dtype=np.int64)
        place[tags.astype(np.int64)] = np.arange(len(tags))
        tables: tuple[dict[str, Indices], dict[str, Indices]] = ({}, {})
        for dim, target in ((2, tables[0]), (1, tables[1])):
            for _, group in model.getPhysicalGroups(dim):
                parts = []
                for entity in model.getEntitiesForPhysicalGroup(dim, group):
                    types, _, nodes = model.mesh.getElements(dim, entity)
                    for kind, flat in zip(types, nodes, strict=True):
                        width = model.mesh.getElementProperties(kind)[3]
                        parts.append(place[flat.astype(np.int64)].reshape(-1, width))
                target[model.getPhysicalName(dim, group)] = np.concatenate(parts)
        return cls(coordinates.reshape(-1, 3)[:, :2].copy(), *tables)

    def model(self) -> Any:
        """A gmsh model of it."""
        return model_from_arrays(self.points, self.cells, self.facets, "drawing")

    def turned(self, angle: float) -> Drawing:
        """Turned about the origin by an angle (radians)."""
        return replace(self, points=self.points @ rotation(angle).T)

    def renumbered(self, seed: int) -> Drawing:
        """With nodes and cells in random order."""
        random = np.random.default_rng(seed)
        order = random.permutation(len(self.points))
        place = np.argsort(order)
        cells = {name: random.permutation(place[table]) for name, table in self.cells.items()}
        facets = {name: random.permutation(place[table]) for name, table in self.facets.items()}
        return Drawing(self.points[order], cells, facets)


def grid_block(
    corner: Sequence[float], size: Sequence[float], divisions: Sequence[int]
) -> tuple[Array, Indices, dict[str, Indices]]:
    """A rectangular block of quadrilaterals: points, cells and facets of its four sides."""
    nx, ny = divisions
    x = np.linspace(corner[0], corner[0] + size[0], nx + 1)
    y = np.linspace(corner[1], corner[1] + size[1], ny + 1)
    grid = np.arange((nx + 1) * (ny + 1)).reshape(ny + 1, nx + 1)
    points = np.column_stack([np.tile(x, ny + 1), np.repeat(y, nx + 1)])
    cells = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=2)
    lines = {"bottom": grid[0], "right": grid[:, -1], "top": grid[-1], "left": grid[:, 0]}
    sides = {name: np.column_stack([line[:-1], line[1:]]) for name, line in lines.items()}
    return points, cells.reshape(-1, 4), sides


def grid_blocks(*blocks: tuple[Sequence[float], Sequence[float], Sequence[int]]) -> Drawing:
    """Blocks (corner, size, divisions) next to each other, each with nodes of its own.

    The facet groups are "bottom0", "right0", "top0", "left0", "bottom1", ...
    """
    points: list[Array] = []
    cells: list[Indices] = []
    facets: dict[str, Indices] = {}
    count = 0
    for number, block in enumerate(blocks):
        own, quadrilaterals, sides = grid_block(*block)
        points.append(own)
        cells.append(quadrilaterals + count)
        facets |= {f"{name}{number}": side + count for name, side in sides.items()}
        count += len(own)
    return Drawing(np.concatenate(points), {"blocks": np.concatenate(cells)}, facets)


def cell_areas(drawn: GmshMesh) -> Array:
    """Areas of cells, positive where their nodes run anticlockwise."""
    corners = drawn.points[drawn.cells]
    following = np.roll(corners, -1, axis=1)
    cross = corners[..., 0] * following[..., 1] - corners[..., 1] * following[..., 0]
    return 0.5 * cross.sum(axis=1)


def group_lengths(drawn: GmshMesh) -> dict[str, float]:
    """Length of the facets of every one-dimensional group."""
    ends = drawn.points[drawn.facets]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return {
        name: float(
            sum(
                length[drawn.facet_groups == k].sum()
                for k, s in enumerate(drawn.facet_sets)
                if name in s
            )
        )
        for name in drawn.facet_names
    }


def mesh_of(model: Any) -> BlockMesh:
    """Distribute the current gmsh model over all ranks."""
    return BlockMesh.from_model(model, MPI.COMM_WORLD)


def on_ground(
    model: Any,
    law: JointLaw,
    dead: Load = WEIGHT,
    live: Load = PUSH,
    foundations: Mapping[str, JointLaw] | None = None,
    **options: Any,
) -> Scene:
    """Blocks of stone on rigid ground "base" with one law everywhere."""
    return Scene(
        mesh_of(model),
        {"default": STONE},
        dead=dead,
        live=live,
        joints={"default": law},
        foundations={"base": law} if foundations is None else foundations,
        **options,
    )


def three_blocks(stands: str, elements: int, left: str) -> Structure:
    """Three blocks on rigid "ground"; or else on a roller under 30 degrees and a held left side."""
    drawing = Drawing.of(wall([[1], [0.5, 0.5]], elements=elements))
    if stands == "ground":
        return Structure.build(on_ground(drawing.model(), coulomb(0.5)))
    scene = Scene(
        mesh_of(drawing.turned(np.radians(30.0)).model()),
        {"default": STONE},
        live=PUSH,
        joints={"default": coulomb(0.5)},
        supports={"base": "roller", "left": left},
    )
    return Structure.build(scene)


def coulomb(friction: float) -> JointLaw:
    """Coulomb's law."""
    return JointLaw("coulomb", friction=friction)


def tresca(bound: float) -> JointLaw:
    """A given shear strength, Pa."""
    return JointLaw("tresca", bound=bound)


def dense(matrix: PETSc.Mat) -> Array:
    """All rows of a matrix on every rank."""
    indptr, columns, values = matrix.getValuesCSR()
    rows = np.zeros((len(indptr) - 1, matrix.getSize()[1]))
    np.add.at(rows, (np.repeat(np.arange(len(rows)), np.diff(indptr)), columns), values)
    return np.concatenate(matrix.comm.tompi4py().allgather(rows))


def whole(vector: PETSc.Vec) -> Array:
    """All entries of a vector on every rank."""
    return np.concatenate(vector.comm.tompi4py().allgather(vector.array_r.copy()))


def vector_like(vector: PETSc.Vec, values: Array) -> PETSc.Vec:
    """A vector of the same layout with given entries, of which every rank takes its own."""
    result = vector.duplicate()
    start, end = vector.getOwnershipRange()
    result.array[:] = np.asarray(values).ravel()[start:end]
    return result


def node_positions(space: Any) -> Array:
    """Coordinates of all displacement nodes in the order of the dofs, on every rank."""
    owned = space.dofmap.index_map.size_local
    parts = space.mesh.comm.allgather(space.tabulate_dof_coordinates()[:owned, :2].copy())
    return np.concatenate(parts)


def node_bodies(structure: Structure) -> Indices:
    """Bodies of all displacement nodes in the order of the dofs, on every rank."""
    owned = structure.elasticity.space.dofmap.index_map.size_local
    return np.concatenate(structure.scene.comm.allgather(structure.elasticity.node_body[:owned]))


def joint_rows(structure: Structure) -> tuple[Array, Array]:
    """B_N and B_T with one row per joint point, in the order of `Joints`, on every rank."""
    points = np.concatenate(structure.scene.comm.allgather(structure.operators.points))
    order = np.argsort(points)
    operators = structure.operators
    return dense(operators.normal)[order], dense(operators.tangential)[order]


@dataclass(frozen=True)
class Loaded:
    """A structure ready to be pushed along its load path.

    Attributes:
        structure: The structure.
        bonded: Its response with closed joints.
        scales: Typical sizes.
    """

    structure: Structure
    bonded: Bonded
    scales: Scales

    @classmethod
    def of(cls, scene: Scene) -> Loaded:
        """Discretise a scene and close its joints."""
        structure = Structure.build(scene)
        bonded = structure.bonded()
        return cls(structure, bonded, typical_sizes(structure.problem, bonded))

    def start(self, ratio: float) -> tuple[State, Scales]:
        """A state to start from, and typical sizes, at a multiple of the bonded work."""
        live = self.structure.problem.live
        work = ratio * self.scales.load_factor * live.dot(self.bonded.live)
        displacement = self.bonded.live.copy()
        displacement.scale(ratio * self.scales.load_factor)
        pressure = self.bonded.dead_pressure
        state = State(displacement, 0.0, pressure, np.zeros_like(pressure), work)
        unit = work / live.norm(PETSc.NormType.N1)
        return state, replace(self.scales, displacement=unit, elastic=self.scales.displacement)
