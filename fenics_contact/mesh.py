"""Meshes of blocks: read from gmsh on one rank, split into bodies, distributed body by body."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.errors import InputError, raised_together

#: Largest load of a rank over the mean load at which bodies are still kept whole.
BODY_IMBALANCE = 1.3

_LINE = 1  # gmsh element type of a straight facet


@dataclass(frozen=True)
class GmshMesh:
    """The planar cells and tagged facets of a gmsh model, on one rank.

    Attributes:
        cell_name: "triangle" or "quadrilateral".
        points: Coordinates of the nodes the cells use, shape (points, 2), in the unit of the file.
        cells: Node indices in gmsh order, shape (cells, nodes of a cell).
        cell_groups: Physical groups of every cell, as an index into `cell_sets`.
        facets: Node indices of the tagged facets, smaller first, shape (facets, 2), each once.
        facet_groups: Physical groups of every facet, as an index into `facet_sets`.
        cell_sets: The sets of group names that occur on cells.
        facet_sets: The sets of group names that occur on facets.
        cell_names: Names of all two-dimensional groups.
        facet_names: Names of all one-dimensional groups.
    """

    cell_name: str
    points: npt.NDArray[np.float64]
    cells: npt.NDArray[np.int64]
    cell_groups: npt.NDArray[np.int32]
    facets: npt.NDArray[np.int64]
    facet_groups: npt.NDArray[np.int32]
    cell_sets: tuple[frozenset[str], ...]
    facet_sets: tuple[frozenset[str], ...]
    cell_names: tuple[str, ...]
    facet_names: tuple[str, ...]


@dataclass(frozen=True)
class BlockMesh:
    """A distributed mesh whose bodies (connected sets of cells) share no node.

    Attributes:
        domain: The dolfinx mesh.
        source: Where it came from, for messages.
        body: Body of every local cell, shape (local cells,); bodies are numbered by first cell.
        body_count: Number of bodies on all ranks.
        cell_groups: Physical groups of every local cell, as an index into `cell_sets`.
        facets: Input node indices of all tagged facets, smaller first, shape (facets, 2), on all
            ranks.
        facet_groups: Physical groups of those facets, as an index into `facet_sets`; on all ranks.
        cell_sets: The sets of group names that occur on cells.
        facet_sets: The sets of group names that occur on facets.
        cell_names: Names of all two-dimensional groups.
        facet_names: Names of all one-dimensional groups.
    """

    domain: Any
    source: str
    body: npt.NDArray[np.int32]
    body_count: int
    cell_groups: npt.NDArray[np.int32]
    facets: npt.NDArray[np.int64]
    facet_groups: npt.NDArray[np.int32]
    cell_sets: tuple[frozenset[str], ...]
    facet_sets: tuple[frozenset[str], ...]
    cell_names: tuple[str, ...]
    facet_names: tuple[str, ...]

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the mesh."""
        return self.domain.comm

    @classmethod
    def from_file(cls, path: str | Path, comm: MPI.Comm | None = None) -> BlockMesh:
        """Read a gmsh file on rank 0 and distribute it.

        Args:
            path: A .msh file, planar in x and y, with named physical groups.
            comm: Communicator; the one PETSc was started with when not given.

        Raises:
            InputError: On all ranks, if the file is missing, not gmsh's, or not a mesh of blocks.
        """
        comm = compat.default_comm() if comm is None else comm
        mesh = None
        with raised_together(comm):
            if comm.rank == 0:
                mesh = _read(Path(path))
        return cls._distribute(mesh, comm, str(path))

    @classmethod
    def from_model(cls, model: Any, comm: MPI.Comm | None = None) -> BlockMesh:
        """Distribute the current gmsh model of rank 0 (the other ranks' models are not looked at).

        Args:
            model: `gmsh.model` with a mesh, as the builders of `fenics_contact.meshing` return it.
            comm: Communicator; the one PETSc was started with when not given.

        Raises:
            InputError: On all ranks, if the model is not a mesh of blocks.
        """
        comm = compat.default_comm() if comm is None else comm
        mesh = None
        with raised_together(comm):
            if comm.rank == 0:
                mesh = extract(model, "the gmsh model")
        return cls._distribute(mesh, comm, "the gmsh model")

    @classmethod
    def _distribute(cls, mesh: GmshMesh | None, comm: MPI.Comm, source: str) -> BlockMesh:
        body: npt.NDArray[np.int32] = np.empty(0, dtype=np.int32)
        with raised_together(comm):
            if mesh is not None:
                _check_cells(mesh, source)
                body = _bodies(mesh, source)
        destinations = None if mesh is None else _ranks_of_bodies(mesh, body, comm.size)
        whole = comm.bcast(destinations is not None)
        name, width = comm.bcast(None if mesh is None else (mesh.cell_name, mesh.cells.shape[1]))
        if mesh is None:
            cells, points = np.empty((0, width), dtype=np.int64), np.empty((0, 2))
            destinations = np.empty(0, dtype=np.int32) if whole else None
        else:
            cells, points = mesh.cells, mesh.points
        domain = compat.create_mesh(comm, name, cells, points, destinations)
        per_cell = None if mesh is None else np.column_stack([body, mesh.cell_groups])
        mine = _send_to_cells(comm, domain, per_cell)
        shared = comm.bcast(
            None
            if mesh is None
            else {
                "body_count": int(body.max()) + 1,
                "facets": mesh.facets,
                "facet_groups": mesh.facet_groups,
                "cell_sets": mesh.cell_sets,
                "facet_sets": mesh.facet_sets,
                "cell_names": mesh.cell_names,
                "facet_names": mesh.facet_names,
            }
        )
        return cls(domain=domain, source=source, body=mine[:, 0], cell_groups=mine[:, 1], **shared)


@contextmanager
def gmsh_session() -> Iterator[Any]:
    """gmsh, started if need be, silent, and without its hold on Ctrl-C; yields the module."""
    import gmsh

    handler = signal.getsignal(signal.SIGINT)
    gmsh.initialize(readConfigFiles=False)
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        yield gmsh
    finally:
        signal.signal(signal.SIGINT, handler)


def _read(path: Path) -> GmshMesh:
    if not path.is_file():
        raise InputError(f"mesh file '{path}' does not exist; give the path of a gmsh .msh file")
    with path.open("rb") as file:
        start = file.read(16)
    if not start.startswith((b"$MeshFormat", b"$Comments")):
        raise InputError(f"'{path}' is not a gmsh mesh file; save the mesh from gmsh as .msh")
    with gmsh_session() as gmsh:
        try:
            gmsh.open(str(path))
        except Exception as error:
            gmsh.finalize()  # or every later file would be found empty
            raise InputError(f"gmsh cannot read '{path}': {error}; save it again as .msh") from None
        try:
            return extract(gmsh.model, f"'{path}'")
        finally:
            gmsh.model.remove()


def extract(model: Any, source: str) -> GmshMesh:
    """Take cells, tagged facets and group names out of the current gmsh model.

    Args:
        model: `gmsh.model`.
        source: What to call the model in messages.

    Raises:
        InputError: If there are no two-dimensional groups with cells, or cells of a kind we lack.
    """
    names = {(d, t): model.getPhysicalName(d, t) or str(t) for d, t in model.getPhysicalGroups()}
    cell_names = tuple(dict.fromkeys(n for (d, _), n in names.items() if d == 2))
    facet_names = tuple(dict.fromkeys(n for (d, _), n in names.items() if d == 1))
    if not cell_names:
        raise InputError(
            f"{source} has no two-dimensional physical group; put the blocks' surfaces into one"
        )
    cell_sets: dict[frozenset[str], int] = {}
    facet_sets: dict[frozenset[str], int] = {}
    cell_type, cells, cell_groups = _cells(model, names, cell_sets, source)
    facets, facet_groups = _facets(model, names, facet_sets)

    tags, coordinates, _ = model.mesh.getNodes()
    coordinates = coordinates.reshape(-1, 3)
    order = np.argsort(tags)
    tags, coordinates = tags[order], coordinates[order]
    used, flat = np.unique(cells, return_inverse=True)
    points = coordinates[np.searchsorted(tags, used)]
    spread = np.ptp(points, axis=0)
    if spread[2] > 1e-9 * spread.max():
        raise InputError(f"{source} is not planar: z varies by {spread[2]:.3g}; draw it in x and y")
    index = np.minimum(np.searchsorted(used, facets), len(used) - 1)
    known = np.all(used[index] == facets, axis=1) if len(facets) else np.zeros(0, dtype=bool)
    return GmshMesh(
        cell_name=compat.CELL_TYPES[cell_type][0],
        points=points[:, :2].copy(),
        cells=flat.reshape(cells.shape).astype(np.int64),
        cell_groups=cell_groups,
        facets=np.sort(index[known], axis=1).astype(np.int64).reshape(-1, 2),
        facet_groups=facet_groups[known],
        cell_sets=tuple(cell_sets),
        facet_sets=tuple(facet_sets),
        cell_names=cell_names,
        facet_names=facet_names,
    )


def _groups_of(
    model: Any, dim: int, entity: int, names: dict[tuple[int, int], str]
) -> frozenset[str]:
    tags = model.getPhysicalGroupsForEntity(dim, entity)
    return frozenset(names[(dim, int(tag))] for tag in tags)


def _cells(
    model: Any, names: dict[tuple[int, int], str], sets: dict[frozenset[str], int], source: str
) -> tuple[int, npt.NDArray[np.uint64], npt.NDArray[np.int32]]:
    kinds, cells, groups = set(), [], []
    for dim, entity in model.getEntities(2):
        group = _groups_of(model, dim, entity, names)
        if not group:
            continue
        types, _, nodes = model.mesh.getElements(dim, entity)
        for kind, flat in zip(types, nodes, strict=True):
            kinds.add(int(kind))
            width = compat.CELL_TYPES.get(int(kind), ("", 1))[1]
            cells.append(flat.reshape(-1, width))
            groups.append(np.full(len(cells[-1]), sets.setdefault(group, len(sets)), np.int32))
    if not cells:
        raise InputError(f"{source} has no cells in its two-dimensional groups; mesh it first")
    if len(kinds) > 1 or not kinds <= set(compat.CELL_TYPES):
        found = ", ".join(model.mesh.getElementProperties(kind)[0] for kind in sorted(kinds))
        raise InputError(
            f"{source} has cells of kind {found}; mesh it with straight triangles only, or with"
            " straight quadrilaterals only"
        )
    return kinds.pop(), np.concatenate(cells), np.concatenate(groups)


def _facets(
    model: Any, names: dict[tuple[int, int], str], sets: dict[frozenset[str], int]
) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.int32]]:
    """Tagged facets, each once with the union of its groups."""
    pairs, groups = [np.empty((0, 2), dtype=np.uint64)], [np.empty(0, dtype=np.int32)]
    for dim, entity in model.getEntities(1):
        group = _groups_of(model, dim, entity, names)
        if not group:
            continue
        types, _, nodes = model.mesh.getElements(dim, entity)
        for kind, flat in zip(types, nodes, strict=True):
            if kind == _LINE:
                pairs.append(np.sort(flat.reshape(-1, 2), axis=1))
                groups.append(np.full(len(pairs[-1]), sets.setdefault(group, len(sets)), np.int32))
    facets, first, inverse = np.unique(
        np.concatenate(pairs), axis=0, return_index=True, return_inverse=True
    )
    group_of = np.concatenate(groups)
    merged = group_of[first]
    known = list(sets)
    for row in np.flatnonzero(group_of != merged[inverse.ravel()]):  # tagged more than once
        facet = inverse.ravel()[row]
        union = known[merged[facet]] | known[group_of[row]]
        merged[facet] = sets.setdefault(union, len(sets))
        known = list(sets)
    return facets, merged


def _check_cells(mesh: GmshMesh, source: str) -> None:
    corners = mesh.points[mesh.cells]
    # Relative to the first corner, so that far-away origins cost no digits.
    shifted = corners - corners[:, :1]
    following = np.roll(shifted, -1, axis=1)
    cross = shifted[..., 0] * following[..., 1] - shifted[..., 1] * following[..., 0]
    area = 0.5 * np.abs(cross.sum(axis=1))
    edge2 = ((following - shifted) ** 2).sum(axis=2).max(axis=1)
    flat = np.flatnonzero(area <= 1e-10 * edge2)
    if len(flat):
        x, y = corners[flat[0]].mean(axis=0)
        raise InputError(f"{source}: {len(flat)} cells have no area, the first at ({x:g}, {y:g})")


def _bodies(mesh: GmshMesh, source: str) -> npt.NDArray[np.int32]:
    """Body of every cell: sets of cells connected through facets, numbered by first cell.

    Raises:
        InputError: If a body hangs together at a single node only, which would be a hinge.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count, width = mesh.cells.shape
    cell = np.repeat(np.arange(count), width)
    shape = (count, len(mesh.points))
    at_node = coo_matrix((np.ones(cell.size, np.int8), (cell, mesh.cells.ravel())), shape).tocsr()
    by_node = connected_components(_bipartite(at_node), directed=False)[1][:count]

    sides = np.stack([mesh.cells, np.roll(mesh.cells, -1, axis=1)], axis=2).reshape(-1, 2)
    key = sides.min(axis=1) * len(mesh.points) + sides.max(axis=1)
    _, side = np.unique(key, return_inverse=True)
    at_side = coo_matrix((np.ones(cell.size, np.int8), (cell, side))).tocsr()
    by_side = connected_components(_bipartite(at_side), directed=False)[1][:count]
    if len(np.unique(by_node)) != len(np.unique(by_side)):
        raise InputError(
            f"{source}: blocks share single nodes; every block needs nodes of its own (double them)"
        )
    _, first, label = np.unique(by_side, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[label].astype(np.int32)


def _bipartite(incidence: Any) -> Any:
    from scipy.sparse import bmat

    return bmat([[None, incidence], [incidence.T, None]])


def _ranks_of_bodies(
    mesh: GmshMesh, body: npt.NDArray[np.int32], ranks: int
) -> npt.NDArray[np.int32] | None:
    """Rank of every cell such that bodies stay whole, or None where that would not balance."""
    cells = np.bincount(body)
    centre = mesh.points[mesh.cells].mean(axis=1)
    position = np.column_stack([np.bincount(body, centre[:, d]) / cells for d in range(2)])
    rank = np.zeros(len(cells), dtype=np.int32)
    _bisect(np.arange(len(cells)), cells, position, 0, ranks, rank)
    load = np.bincount(rank, cells, minlength=ranks)
    if load.max() > BODY_IMBALANCE * load.mean():
        return None
    return rank[body]


def _bisect(
    members: npt.NDArray[np.int64],
    weight: npt.NDArray[np.int64],
    position: npt.NDArray[np.float64],
    first: int,
    ranks: int,
    rank: npt.NDArray[np.int32],
) -> None:
    """Recursive coordinate bisection of bodies onto ranks first, ..., first + ranks - 1."""
    if ranks == 1 or len(members) == 0:
        rank[members] = first
        return
    axis = int(np.argmax(np.ptp(position[members], axis=0)))
    order = members[np.lexsort((position[members, 1 - axis], position[members, axis]))]
    left = ranks // 2
    total = np.cumsum(weight[order])
    cut = int(np.searchsorted(total - 0.5 * weight[order], total[-1] * left / ranks))
    _bisect(order[:cut], weight, position, first, left, rank)
    _bisect(order[cut:], weight, position, first + left, ranks - left, rank)


def _send_to_cells(
    comm: MPI.Comm, domain: Any, values: npt.NDArray[np.int32] | None
) -> npt.NDArray[np.int32]:
    """Values of the input cells (on rank 0) at the local cells that they became."""
    wanted = comm.gather(np.asarray(domain.topology.original_cell_index))
    parts: list[npt.NDArray[np.int32]] = []
    if values is not None and wanted is not None:
        parts = [values[index] for index in wanted]
    return comm.scatter(parts)
