"""Meshes of blocks, distributed body by body; `gmsh_mesh` reads them on one rank.

A mesh is kept with the arrays that it was made of, from which it can be made again. dolfinx numbers
cells and nodes anew, in a way that depends on these arrays alone: the mesh made again has the
numbers of the first one, and so have all values by node and by cell. That is checked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact import compat
from fenics_contact.errors import InputError, checked, raised_together, require
from fenics_contact.geometry.gmsh_mesh import (
    CELL_TYPES,
    GmshContents,
    GmshMesh,
    TaggedMesh,
    bodies_of_cells,
    extract,
    mesh_of,
    read_file,
    with_blocks,
)
from fenics_contact.geometry.planar_cells import check_apart
from fenics_contact.lazily import dolfinx_mesh
from fenics_contact.parallel import MPI
from fenics_contact.requirements import check_requirements

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Labels = npt.NDArray[np.int32]
Flags = npt.NDArray[np.bool_]
Names = frozenset[str]

#: Largest load of a rank over the mean load at which bodies are still kept whole.
BODY_IMBALANCE = 1.3
#: Names by number of a tag, or by dimension and number.
TagNames = Mapping[Any, str]

#: Element type of gmsh by the cell's name, and that of a straight line.
_KINDS = {name: kind for kind, (name, _) in CELL_TYPES.items()}
_LINE = 1
#: Order of a cell's nodes round it: dolfinx numbers those of quadrilaterals row by row.
_ROUND = {"triangle": [0, 1, 2], "quadrilateral": [0, 1, 3, 2]}
_KINDS_OF_TAGS = {2: "cells", 1: "facets"}


@dataclass(frozen=True, eq=False)
class StoredMesh:
    """A dolfinx mesh that can be pickled. It never changes, so that a copy is the mesh itself.

    Attributes:
        comm: Communicator.
        cell_name: "triangle" or "quadrilateral".
        cells: Nodes of the cells that this rank gives, in gmsh order, shape (cells, nodes).
        points: Coordinates that this rank gives, m, shape (points, 2).
        partition: Ranks of these cells; None: triangles that stay where they are, and that count
            the points of all ranks.
        numbering: Input numbers of this rank's cells, then of its nodes.
    """

    comm: MPI.Comm
    cell_name: str
    cells: Indices
    points: Array
    partition: compat.Partition | None
    numbering: Indices

    @classmethod
    def of(
        cls, domain: Any, cells: Indices, points: Array, partition: compat.Partition | None = None
    ) -> StoredMesh:
        """What a dolfinx mesh was just made of, with that mesh."""
        # The mesh has a communicator of its own, which lives as long as it does.
        name = domain.topology.cell_type.name
        new = cls(domain.comm, name, cells, points, partition, _numbering(domain))
        vars(new)["domain"] = domain
        return new

    @cached_property
    def domain(self) -> Any:
        """The dolfinx mesh; collective where it is first asked for after it was stored.

        Raises:
            InputError: On all ranks, if this dolfinx numbers its cells or nodes otherwise.
        """
        if self.partition is None:
            made = compat.create_mesh_in_place(self.comm, self.cells, self.points)
        else:
            arrays = self.cells, self.points, self.partition
            made, _ = compat.create_mesh(self.comm, self.cell_name, *arrays)
        with raised_together(self.comm):
            text = "stored mesh: this dolfinx numbers it otherwise than that which stored it"
            same = np.array_equal(self.numbering, _numbering(made))
            require(same, f"{text}; solve the scene again here")
        return made

    def __getstate__(self) -> dict[str, Any]:
        """The arrays, and this rank's number and that of all, in place of objects of MPI."""
        state = {name: value for name, value in vars(self).items() if name != "domain"}
        return state | {"comm": (self.comm.rank, self.comm.size)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take the arrays, on the rank that stored them.

        Raises:
            InputError: On another rank, or one of more or fewer; one rank alone is any one.
        """
        stored = state["comm"]
        comm = compat.comm_of(stored[1])
        here = f"this is rank {comm.rank} of {comm.size}"
        text = f"stored mesh: it is of rank {stored[0]} of {stored[1]}, and {here}"
        require((comm.rank, comm.size) == stored, f"{text}; load on as many ranks, each its own")
        vars(self).update(state, comm=comm)

    def __deepcopy__(self, _: object) -> StoredMesh:
        return self


def _numbering(domain: Any) -> Indices:
    """Input numbers of this rank's cells, then of its nodes."""
    parts = domain.topology.original_cell_index, domain.geometry.input_global_indices
    return np.concatenate([np.asarray(part, dtype=np.int64) for part in parts])


@dataclass(frozen=True, repr=False)
class BlockMesh(TaggedMesh):
    """A distributed mesh whose bodies (connected sets of cells) share no node.

    Attributes:
        stored: The dolfinx mesh and what it was made of.
        body: Body of every local cell; bodies are numbered by first cell.
        body_count: Number of bodies on all ranks.
        cell_groups: Physical groups of every local cell, as an index into `cell_sets`.
        joined: Number of surfaces that are in one body with others of the same groups; 0 where
            surfaces are blocks.
        drawn: Body of every local cell as drawn, where some are glued to one; else None.
    """

    stored: StoredMesh
    body: Labels
    body_count: int
    cell_groups: Labels
    joined: int
    drawn: Labels | None = None

    @property
    def pieces(self) -> Labels:
        """Body of every local cell, whatever is glued."""
        return self.body if self.drawn is None else self.drawn

    def with_glued(self, label: Indices) -> BlockMesh:
        """The mesh in which bodies as drawn with one label are one body."""
        count = int(label.max(initial=-1)) + 1
        body = label[self.pieces].astype(self.body.dtype)
        return replace(self, body=body, body_count=count, drawn=self.pieces)

    def __repr__(self) -> str:
        return f"<BlockMesh: {self.body_count} blocks, from {self.source}>"

    @property
    def domain(self) -> Any:
        """The dolfinx mesh; of a mesh that was unpickled, made when first asked for: collective."""
        return self.stored.domain

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the mesh."""
        return self.stored.comm

    @classmethod
    @checked
    def from_file(
        cls, path: str | Path, comm: MPI.Comm | None = None, blocks: str = "connected"
    ) -> BlockMesh:
        """Read a planar gmsh file on rank 0 and distribute it, by default on PETSc's communicator.

        Args:
            path: The .msh file.
            comm: By default, the communicator that PETSc was started with.
            blocks: "connected": blocks have nodes of their own. "surfaces": every gmsh surface is a
                block, and nodes that surfaces share are split, as after gmsh's `occ.fragment`.

        Raises:
            InputError: On all ranks, if the file is missing, not gmsh's, or not a mesh of blocks.
        """
        return cls._distribute(lambda: with_blocks(read_file(Path(path)), blocks), comm)

    @classmethod
    @checked
    def from_model(
        cls, model: Any, comm: MPI.Comm | None = None, blocks: str = "connected"
    ) -> BlockMesh:
        """Distribute the current gmsh model of rank 0, as builders return it; see `from_file`."""
        source = "the gmsh model"
        return cls._distribute(lambda: with_blocks(extract(model, source), blocks), comm)

    @classmethod
    @checked
    def from_dolfinx(
        cls,
        mesh: Any,
        cell_tags: Any,
        facet_tags: Any,
        names: TagNames,
        blocks: str = "connected",
    ) -> BlockMesh:
        """Make blocks of a dolfinx mesh, serial or distributed, on its communicator. Collective.

        Rank 0 collects cells and tags, as it reads a file. The blocks get a mesh of their own,
        `domain`: nodes are split and cells distributed, and `mesh` is left as it is.

        Args:
            mesh: Straight triangles or quadrilaterals with points in the plane (gdim 2).
            cell_tags: Tag of every cell.
            facet_tags: Tags of facets that have a role: joints, foundations, supports, loads.
            names: Name of the group by the tag's number, or by (dimension, number) where cells and
                facets have the same numbers; several numbers can have one name. Tags without a
                name are called by their number.
            blocks: "connected": blocks have nodes of their own. "surfaces": cells of one tag and no
                others are a block (or several, if they are apart), and nodes that tags share are
                split; a tagged facet between two blocks is on both sides.

        Raises:
            InputError: On all ranks, if mesh, tags or names do not fit together, or are no blocks.
        """
        source = "the dolfinx mesh"
        found = _dolfinx_contents(mesh, cell_tags, facet_tags, names, source)
        return cls._distribute(lambda: with_blocks(mesh_of(found, source), blocks), mesh.comm)

    @classmethod
    def _distribute(cls, read: Callable[[], GmshMesh], comm: MPI.Comm | None) -> BlockMesh:
        """Read a mesh on rank 0, split it into bodies and send their cells to all ranks."""
        check_requirements()
        comm = compat.default_comm() if comm is None else comm
        rest: Any = None
        mesh = None
        body = np.empty(0, dtype=np.int32)
        rank = None
        joined = 0
        with raised_together(comm):
            if comm.rank == 0:
                mesh = read()
                body = bodies_of_cells(mesh)
                check_apart(mesh.points, mesh.cells, body, mesh.source)
                rank = ranks_of_bodies(mesh, body, comm.size)
                rows = np.column_stack([body, mesh.cell_groups, mesh.cell_surfaces])
                parts = np.unique(rows, axis=0)[:, :2]
                _, together = np.unique(parts, axis=0, return_counts=True)
                joined = int(together[together > 1].sum())
                of_cells = ("points", "cells", "cell_groups", "cell_surfaces")
                rest = replace(mesh, **{name: getattr(mesh, name)[:0] for name in of_cells})
        rest, whole, joined = comm.bcast((rest, rank is not None, joined))
        mesh = mesh or rest
        rank = rank if comm.rank == 0 or not whole else body
        arrays = mesh.cells, mesh.points
        wished = None if rank is None else compat.Partition.to(rank)  # else graph partitioning
        domain, partition = compat.create_mesh(comm, mesh.cell_name, *arrays, wished)
        stored = StoredMesh.of(domain, *arrays, partition)
        numbers = np.column_stack([body, mesh.cell_groups])
        input_cells = comm.gather(np.asarray(domain.topology.original_cell_index))
        body, groups = comm.scatter([numbers[cells] for cells in input_cells or ()]).T
        count = comm.allreduce(int(body.max(initial=-1)), MPI.MAX) + 1
        tags = {item.name: getattr(mesh, item.name) for item in fields(TaggedMesh)}
        of_bodies = {"body": body, "body_count": count, "joined": joined}
        return cls(**tags, **of_bodies, stored=stored, cell_groups=groups)


def ranks_of_bodies(mesh: GmshMesh, body: Labels, ranks: int) -> Labels | None:
    """Rank of every cell such that bodies stay whole, or None where that would not balance."""
    cells = np.bincount(body)
    centre = mesh.points[mesh.cells].mean(axis=1)
    position = np.column_stack([np.bincount(body, centre[:, d]) / cells for d in range(2)])
    rank = np.zeros(len(cells), dtype=np.int32)

    def bisect(members: Indices, first: int, count: int) -> None:
        """Recursive coordinate bisection of bodies onto ranks first, ..., first + count - 1."""
        if count == 1 or len(members) == 0:
            rank[members] = first
            return
        axis = int(np.argmax(np.ptp(position[members], axis=0)))
        order = members[np.lexsort((position[members, 1 - axis], position[members, axis]))]
        total = np.cumsum(cells[order])
        left = count // 2
        cut = int(np.searchsorted(total - 0.5 * cells[order], total[-1] * left / count))
        bisect(order[:cut], first, left)
        bisect(order[cut:], first + left, count - left)

    bisect(np.arange(len(cells)), 0, ranks)
    load = np.bincount(rank, cells, minlength=ranks)
    return None if load.max() > BODY_IMBALANCE * load.mean() else rank[body]


# ---- meshes of dolfinx


def _dolfinx_contents(
    domain: Any, cell_tags: Any, facet_tags: Any, names: TagNames, source: str
) -> GmshContents:
    """Nodes, tagged cells and tagged facets of all ranks, on rank 0. Collective.

    Args:
        domain: The dolfinx mesh.
        cell_tags: Number of every cell.
        facet_tags: Numbers of some facets.
        names: Names of the numbers; those without one are called by the number.
        source: For messages.

    Raises:
        InputError: On all ranks, if this is not a planar mesh, its tags or their names.
    """
    text = f"mesh = {type(domain).__name__} must be a dolfinx.mesh.Mesh"
    require(isinstance(domain, dolfinx_mesh.Mesh), text)
    topology = domain.topology
    cell = topology.cell_type.name
    dim = domain.geometry.dim
    text = f"has cells of kind {cell}; make it of cells of kind {' or '.join(_KINDS)}"
    require(cell in _KINDS, f"{source} {text}")
    text = f"has points in {dim} dimensions; make it with gdim=2, for example gmshio's"
    require(dim == 2, f"{source} {text} model_to_mesh(model, comm, 0, gdim=2)")
    degree = domain.geometry.cmap.degree
    require(degree == 1, f"{source} has curved cells of degree {degree}; make it of degree 1")
    comm = domain.comm
    with raised_together(comm):
        _check_tags(domain, cell_tags, "cell_tags", 2)
        _check_tags(domain, facet_tags, "facet_tags", 1)

    nodes = compat.geometry_dofs(domain)
    owned = topology.index_map(2).size_local
    mine = cell_tags.indices < owned
    untagged = comm.allreduce(owned - len(np.unique(cell_tags.indices[mine])))
    require(not untagged, f"cell_tags: {untagged} cells have no tag; give every cell one")
    for dims in ((1, 0), (2, 0)):
        topology.create_connectivity(*dims)
    vertices = topology.connectivity(2, 0).array.reshape(nodes.shape)
    node = np.zeros(int(vertices.max(initial=-1)) + 1, dtype=np.int32)
    node[vertices] = nodes
    ends = topology.connectivity(1, 0).array.reshape(-1, 2)[facet_tags.indices]
    index_map = domain.geometry.index_map()
    tagged = {}  # nodes, by their numbers on all ranks, and tags
    for number, some, values in (
        (2, nodes[:, _ROUND[cell]][cell_tags.indices[mine]], cell_tags.values[mine]),
        (1, node[ends], facet_tags.values),
    ):
        everywhere = index_map.local_to_global(some.ravel().astype(np.int32)).astype(np.int64)
        tagged[number] = np.reshape(everywhere, some.shape), values.astype(np.int64)

    sets = comm.allgather({dim: set(values.tolist()) for dim, (_, values) in tagged.items()})
    numbers = {dim: sorted(set().union(*(part[dim] for part in sets))) for dim in tagged}
    groups = _named(names, numbers)
    points = domain.geometry.x[: index_map.size_local]
    parts = comm.gather((tagged, points)) or [(tagged, points)]  # only rank 0 makes blocks of them
    elements = []
    for dim, of_gmsh in ((1, _LINE), (2, _KINDS[cell])):
        table, tags = (np.concatenate([part[0][dim][k] for part in parts]) for k in (0, 1))
        for number in numbers[dim]:
            flat = table[tags == number].ravel().astype(np.uint64)
            elements.append((dim, [number], of_gmsh, flat))
    coordinates = np.concatenate([part[1] for part in parts])
    count = np.arange(len(coordinates), dtype=np.uint64)
    return GmshContents(groups, count, coordinates, elements, {})


def _check_tags(domain: Any, tags: Any, name: str, dim: int) -> None:
    """Refuse tags of other entities than those of this dimension of this mesh."""
    try:
        found = tags.dim
        of_mesh = compat.same_topology(tags, domain)
    except AttributeError:
        problem = "must be dolfinx mesh tags, made by dolfinx.mesh.meshtags"
        raise InputError(f"{name} = {type(tags).__name__} {problem}") from None
    text = f"{name} has tags of dimension {found}; give the tags of {_KINDS_OF_TAGS[dim]}, {dim}"
    require(found == dim, text)
    require(of_mesh, f"{name} are those of another mesh; make them with meshtags of this one")
    kind = tags.values.dtype
    text = f"{name} has tags of type {kind}; give whole numbers (int32)"
    require(np.issubdtype(kind, np.integer), text)


def _named(names: TagNames, numbers: Mapping[int, list[int]]) -> dict[tuple[int, int], str | None]:
    """Name of every dimension and number that occurs.

    Raises:
        InputError: If a name is of no number, or of one that both cells and facets have.
    """
    found: dict[tuple[int, int], str | None] = {
        (dim, number): str(number) for dim, some in numbers.items() for number in some
    }
    there = "; ".join(f"{_KINDS_OF_TAGS[dim]} have {some}" for dim, some in numbers.items())
    for key, name in names.items():
        asked = [key] if isinstance(key, tuple) else [(dim, key) for dim in numbers]
        pairs = [pair for pair in found if pair in asked]
        given = f"names[{key}] = '{name}'"
        require(bool(pairs), f"{given} is the number of no tag: {there}")
        text = f"is of cells and of facets; give names[2, {key}] and names[1, {key}] instead"
        require(len(pairs) == 1, f"{given} {text}")
        found[pairs[0]] = name
    return found
