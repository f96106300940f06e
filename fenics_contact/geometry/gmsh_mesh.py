"""Meshes as gmsh has them, on one rank: cells and facets in physical groups, split into bodies.

Nothing here needs dolfinx, which takes a third of a second to import.
"""

from __future__ import annotations

import signal
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import InputError, check_like
from fenics_contact.geometry.gmsh_reader import (
    CELL_TYPES,
    GmshContents,
    Tags,
    contents,
    read,
    remark_of,
    text_contents,
)
from fenics_contact.geometry.planar_cells import (
    Array,
    Indices,
    anticlockwise,
    check_coordinates,
    connected,
    sides_of,
)
from fenics_contact.requirements import GMSH_WAYS

Labels = npt.NDArray[np.int32]
Names = frozenset[str]

#: What a block is: connected cells, or connected cells of one gmsh surface.
BLOCKS = ("connected", "surfaces")


@dataclass(frozen=True)
class TaggedMesh:
    """Physical groups of a mesh; the same on all ranks that have it.

    Attributes:
        source: Where the mesh came from, for messages.
        facets: Input nodes of the tagged facets, smaller first, each once, shape (facets, 2).
        facet_groups: Physical groups of those facets, as an index into `facet_sets`.
        cell_sets: Sets of group names that occur on cells.
        facet_sets: Sets of group names that occur on facets.
        cell_names: Names of all two-dimensional groups.
        facet_names: Names of all one-dimensional groups.
        surfaces: Number of gmsh's surfaces that have cells.
        remark: What is wrong with the drawing that it was made of; empty if nothing is known.
    """

    source: str
    facets: Indices
    facet_groups: Labels
    cell_sets: tuple[Names, ...]
    facet_sets: tuple[Names, ...]
    cell_names: tuple[str, ...]
    facet_names: tuple[str, ...]
    surfaces: int
    remark: str = field(default="", kw_only=True)


@dataclass(frozen=True)
class GmshMesh(TaggedMesh):
    """Planar cells and tagged facets of a gmsh model, on one rank.

    Attributes:
        cell_name: "triangle" or "quadrilateral".
        points: Coordinates of the nodes that cells use, shape (points, 2).
        cells: Node indices in gmsh order, shape (cells, nodes of a cell).
        cell_groups: Physical groups of every cell, as an index into `cell_sets`.
        cell_surfaces: gmsh's surface of every cell, from 0 on.
    """

    cell_name: str
    points: Array
    cells: Indices
    cell_groups: Labels
    cell_surfaces: Labels


def _check_gmsh() -> None:
    """Refuse to go on without gmsh."""
    if find_spec("gmsh") is None:
        raise InputError(f"this needs gmsh, which is not installed: {GMSH_WAYS}")


@contextmanager
def gmsh_session(**options: float) -> Iterator[Any]:
    """gmsh, started if need be, silent, without its hold on Ctrl-C, with options of meshing."""
    _check_gmsh()
    import gmsh

    handler = signal.getsignal(signal.SIGINT)
    gmsh.initialize(readConfigFiles=False)
    gmsh.option.setNumber("General.Terminal", 0)
    before = {name: gmsh.option.getNumber(f"Mesh.{name}") for name in options}
    try:
        for name, value in options.items():
            gmsh.option.setNumber(f"Mesh.{name}", value)
        yield gmsh
    finally:
        for name, value in before.items():
            gmsh.option.setNumber(f"Mesh.{name}", value)
        signal.signal(signal.SIGINT, handler)


def read_file(path: Path) -> GmshMesh:
    """Mesh of a gmsh file.

    Raises:
        InputError: If it cannot be read, or is no mesh of triangles or quadrilaterals in groups.
    """
    try:
        if not stat.S_ISREG(path.stat().st_mode):  # to open a pipe would wait for ever
            raise InputError(f"'{path}' is a folder or device; give the path of a gmsh .msh file")
        with path.open("rb") as file:
            start = file.read(16)
    except (FileNotFoundError, NotADirectoryError, ValueError):  # a name with a NUL
        problem = "does not exist; give the path of a gmsh .msh file"
        raise InputError(f"mesh file '{path}' {problem}") from None
    except OSError as error:
        raise InputError(f"mesh file '{path}' cannot be read: {error.strerror}") from None
    if not start.startswith((b"$MeshFormat", b"$Comments")):
        raise InputError(f"'{path}' is not a gmsh mesh file; save the mesh from gmsh as .msh")
    try:
        found = text_contents(path)
        if found is None:
            _check_gmsh()
            found = read(path)
    except ValueError as error:
        raise InputError(f"gmsh cannot read '{path}': {error}; save it again as .msh") from None
    return replace(mesh_of(found, f"'{path}'"), remark=remark_of(path))


def extract(model: Any, source: str) -> GmshMesh:
    """Cells, tagged facets and group names of the current `gmsh.model`, `source` in messages.

    Raises:
        InputError: If it is not a planar mesh of triangles or quadrilaterals with area in groups.
    """
    check_like("model", model, "getPhysicalGroups", "a gmsh model, as builders return it")
    return mesh_of(contents(model), source)


def mesh_of(found: GmshContents, source: str) -> GmshMesh:
    """Cells, tagged facets and group names of what was read; see `extract`."""
    names = found.groups
    for dim, tag in (group for group, name in names.items() if name is None):
        problem = f"the name of physical group {tag} of dimension {dim} is not UTF-8; rename it"
        raise InputError(f"{source}: {problem}")
    by_dim = ([str(name) for (d, _), name in names.items() if d == dim] for dim in (2, 1))
    cell_names, facet_names = (tuple(dict.fromkeys(some)) for some in by_dim)
    if not cell_names:
        problem = "has no two-dimensional physical group; put the blocks' surfaces into one"
        raise InputError(f"{source} {problem}")
    by_entity = list(_elements(found, 2))
    kinds = {kind for _, kind, _ in by_entity}
    if not kinds:
        raise InputError(f"{source} has no cells in its two-dimensional groups; mesh it first")
    if len(kinds) > 1 or not kinds <= set(CELL_TYPES):
        listed = ", ".join(found.kinds[kind] for kind in sorted(kinds))
        raise InputError(
            f"{source} has cells of kind {listed}; mesh it with straight triangles only, or with"
            " straight quadrilaterals only"
        )
    cell_name, width = CELL_TYPES[kinds.pop()]
    counts = [len(flat) // width for *_, flat in by_entity]
    surface = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    nodes = np.concatenate([flat for *_, flat in by_entity]).reshape(-1, width)
    of_entity, cell_sets = _numbered(groups for groups, *_ in by_entity)
    used, flat = np.unique(nodes, return_inverse=True)
    facets, facet_groups, facet_sets = _facets(found, used)
    if not np.all(np.isin(used, found.tags)):
        raise InputError(f"{source} has cells with nodes that it lacks; save it again as .msh")
    order = np.argsort(found.tags)
    points = found.coordinates[order[np.searchsorted(found.tags, used, sorter=order)]]
    check_coordinates(points, source)
    points = points[:, :2].copy()
    cells = anticlockwise(points, flat.reshape(nodes.shape), source)
    tags = facets, facet_groups, cell_sets, facet_sets, cell_names, facet_names
    surfaces = len(np.unique(surface))
    return GmshMesh(source, *tags, surfaces, cell_name, points, cells, of_entity[surface], surface)


def _numbered(groups: Iterable[Names]) -> tuple[Labels, tuple[Names, ...]]:
    """Every set as an index into the different ones, and these."""
    index: dict[Names, int] = {}
    labels = [index.setdefault(names, len(index)) for names in groups]
    return np.array(labels, dtype=np.int32), tuple(index)


def _elements(found: GmshContents, dim: int) -> Iterator[tuple[Names, int, Tags]]:
    """Groups, gmsh type and nodes (in a row) of the elements in physical groups, by entity."""
    for dimension, tags, kind, flat in found.elements:
        if dimension == dim:
            yield frozenset(str(found.groups[dim, tag]) for tag in tags), kind, flat


def _facets(found: GmshContents, used: Tags) -> tuple[Indices, Labels, tuple[Names, ...]]:
    """Tagged facets as indices among the nodes used, with their groups and the sets of groups."""
    groups: dict[tuple[int, int], Names] = {}
    for more, kind, flat in _elements(found, 1):
        if kind != 1:  # gmsh's number of a straight line
            continue
        for first, second in np.sort(flat.reshape(-1, 2), axis=1).tolist():
            groups[first, second] = groups.get((first, second), frozenset()) | more
    nodes = np.array(list(groups), dtype=used.dtype).reshape(-1, 2)
    index = np.minimum(np.searchsorted(used, nodes), len(used) - 1)
    known = np.all(used[index] == nodes, axis=1)
    labels, sets = _numbered(groups.values())
    return np.sort(index[known], axis=1), labels[known], sets


def with_blocks(mesh: GmshMesh, blocks: str) -> GmshMesh:
    """The mesh with blocks of a kind of `BLOCKS`: as it is, or with surfaces split.

    Every surface then has a copy of every node that it uses. A tagged facet between two surfaces
    becomes two facets, one of each, in the same groups.
    """
    if blocks not in BLOCKS:
        raise InputError(f"blocks = '{blocks}' must be one of {', '.join(BLOCKS)}")
    if blocks != "surfaces":
        return mesh
    count = len(mesh.points)
    width = mesh.cells.shape[1]
    surface = mesh.cell_surfaces.astype(np.int64)
    copies, cells = np.unique(surface[:, None] * count + mesh.cells, return_inverse=True)
    any_copy = np.zeros(count, dtype=np.int64)
    any_copy[copies % count] = np.arange(len(copies))
    ends = np.sort(sides_of(mesh.cells), axis=1)
    sides = np.column_stack([ends, np.repeat(surface, width)])
    sides = np.unique(sides, axis=0)  # once for each surface that has it
    key, tagged = (table[:, :2] @ [count, 1] for table in (sides, mesh.facets))
    order = np.argsort(tagged)
    found = np.isin(key, tagged)
    facet = order[np.searchsorted(tagged[order], key[found])]
    lost = ~np.isin(tagged, key)  # no side of a cell; kept for the message that says so
    both = np.searchsorted(copies, sides[found, 2:] * count + sides[found, :2])
    return replace(
        mesh,
        points=mesh.points[copies % count],
        cells=cells.reshape(mesh.cells.shape),
        facets=np.concatenate([both, np.sort(any_copy[mesh.facets[lost]], axis=1)]),
        facet_groups=np.concatenate([mesh.facet_groups[facet], mesh.facet_groups[lost]]),
    )


def bodies_of_cells(mesh: GmshMesh) -> Labels:
    """Body of every cell: sets of cells connected through facets, numbered by first cell.

    Raises:
        InputError: If a body hangs together at a single node only, which would be a hinge.
    """
    key = np.sort(sides_of(mesh.cells), axis=1) @ [len(mesh.points), 1]
    _, side = np.unique(key, return_inverse=True)
    count, width = mesh.cells.shape
    owner = np.repeat(np.arange(count), width)
    by_node, by_side = (  # sets of cells connected through what they share
        np.unique(
            connected(np.column_stack([owner, count + shared.ravel()]), count + shared.max() + 1)[
                :count
            ],
            return_inverse=True,
        )[1]
        for shared in (mesh.cells, side)
    )
    if by_node.max() != by_side.max():
        raise InputError(
            f"{mesh.source}: blocks share single nodes; every block needs nodes of its own"
            ' (double them, or set mesh.blocks = "surfaces")'
        )
    _, first, label = np.unique(by_side, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[label].astype(np.int32)


def joined_surfaces(mesh: GmshMesh, body: Labels) -> int:
    """Number of surfaces that are in one body with others of the same groups."""
    rows = np.column_stack([body, mesh.cell_groups, mesh.cell_surfaces])
    parts = np.unique(rows, axis=0)[:, :2]
    _, count = np.unique(parts, axis=0, return_counts=True)
    return int(count[count > 1].sum())
