"""The only module that knows dolfinx versions: it probes for features, never for numbers."""

from __future__ import annotations

import fcntl
import inspect
import logging
import os
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from fenics_contact.lazily import Lazily, dolfinx_graph, dolfinx_mesh, fem, io, jit, la, ufl
from fenics_contact.parallel import MPI, PETSc

#: The C++ layer, which changes with versions.
cpp = Lazily("dolfinx.cpp")

#: Nodes of the straight-sided cells, by dolfinx's name.
NODES = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4}


@cache
def with_ghost_mode() -> bool:
    """Whether meshes are asked for a ghost mode; else it is the partitioner's."""
    return "ghost_mode" in inspect.signature(dolfinx_mesh.create_mesh).parameters


def versions() -> dict[str, str]:
    """Versions of Python and of the libraries that results depend on, by name; "" if not known."""
    packages = {"dolfinx": "fenics-dolfinx", "numpy": "numpy", "scipy": "scipy"}
    found = {"python": platform.python_version()}
    for name, package in packages.items():
        found[name] = ""
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(package)
    return found | {"petsc": ".".join(map(str, PETSc.Sys.getVersion()))}


def default_comm() -> MPI.Comm:
    """The communicator PETSc was started with."""
    return PETSc.Sys.getDefaultComm().tompi4py()


def comm_of(size: int) -> MPI.Comm:
    """The communicator that PETSc was started with, but this rank alone for a size of 1."""
    return MPI.COMM_SELF if size == 1 < default_comm().size else default_comm()


@dataclass(frozen=True)
class Partition:
    """Ranks to which the cells that this rank gives are sent, its own rank first.

    Attributes:
        ends: Where the ranks of every cell begin and end in `ranks`, shape (cells + 1,).
        ranks: Those of all cells in a row: the owner, then those that have the cell as a ghost.
    """

    ends: npt.NDArray[np.int32]
    ranks: npt.NDArray[np.int32]

    def __call__(self, *_: Any) -> Any:
        """The answer of a partitioner of dolfinx."""
        make = getattr(dolfinx_graph, "adjacencylist", None) or cpp.graph.AdjacencyList_int32
        found = make(self.ranks, self.ends)
        return getattr(found, "_cpp_object", found)

    @classmethod
    def to(cls, ranks: npt.NDArray[np.int32]) -> Partition:
        """Every cell to one rank."""
        return cls(np.arange(len(ranks) + 1, dtype=np.int32), ranks)


def create_mesh(
    comm: MPI.Comm,
    cell_name: str,
    cells: npt.NDArray[np.int64],
    points: npt.NDArray[np.float64],
    partition: Partition | None,
) -> tuple[dolfinx_mesh.Mesh, Partition]:
    """Distribute a mesh given on one rank (the others pass empty arrays), without ghost cells.

    Args:
        comm: Ranks.
        cell_name: "triangle", "quadrilateral" or "tetrahedron".
        cells: Points of the cells given here, in gmsh order, shape (cells, nodes).
        points: Their coordinates, shape (points, d).
        partition: Of the cells given here; None for graph partitioning.

    Returns:
        The mesh, and the partition that makes it again.
    """
    cells = cells[:, cpp.io.perm_gmsh(getattr(dolfinx_mesh.CellType, cell_name), cells.shape[1])]
    if partition is not None:
        return _created(comm, cell_name, cells, points, partition), partition
    mode = () if with_ghost_mode() else (dolfinx_mesh.GhostMode.none,)
    try:
        graph_partition = dolfinx_mesh.create_cell_partitioner(*mode)
    except TypeError:  # dolfinx 0.11 also asks for the largest number of cells at a facet
        graph_partition = dolfinx_mesh.create_cell_partitioner(*mode, 2)
    made = []

    def partitioner(*given: Any) -> Any:
        found = graph_partition(*given)
        made.append(Partition(np.array(found.offsets), np.array(found.array)))
        return found

    return _created(comm, cell_name, cells, points, partitioner), made[0]


def create_mesh_in_place(
    comm: MPI.Comm, cells: npt.NDArray[np.int64], points: npt.NDArray[np.float64]
) -> dolfinx_mesh.Mesh:
    """A mesh of triangles without ghost cells, every cell on the rank that gives it.

    `cells` count the points of all ranks, shape (cells, 3); `points` are coordinates, shape
    (points, 2).
    """
    stay = Partition.to(np.full(len(cells), comm.rank, dtype=np.int32))
    partitioner = _staying if with_ghost_mode() else stay
    return _created(comm, "triangle", cells, points, partitioner)


def _created(comm: MPI.Comm, cell_name: str, cells: Any, points: Any, partitioner: Any) -> Any:
    if hasattr(ufl, "VectorElement"):
        # The variant is what the form compiler of dolfinx 0.5 would fill in, when it compiles a
        # form, not when it finds one compiled. Without it, every form after the first would have
        # one signature in a run that compiles and another one in the next run.
        cell = ufl.Cell(cell_name, geometric_dimension=points.shape[1])
        scalar = ufl.FiniteElement("Lagrange", cell, 1, variant="equispaced")
        domain = ufl.Mesh(ufl.VectorElement(scalar))
    else:
        import basix.ufl

        domain = ufl.Mesh(basix.ufl.element("Lagrange", cell_name, 1, shape=(points.shape[1],)))
    if with_ghost_mode():
        return dolfinx_mesh.create_mesh(
            comm, cells, points, domain, dolfinx_mesh.GhostMode.none, partitioner
        )
    given = list(inspect.signature(dolfinx_mesh.create_mesh).parameters)
    geometry = (points, domain) if given[2] == "x" else (domain, points)
    return dolfinx_mesh.create_mesh(comm, cells, *geometry, partitioner)


def _staying(comm: MPI.Comm, _ranks: int, dim: int, cells: Any, _mode: Any) -> Any:
    """Every cell to its own rank, and to those of its neighbours, as dolfinx 0.5 wants it.

    It finds the nodes that ranks share only where it has such ghosts, which it then removes.
    """
    count = cells.num_nodes
    size = comm.size
    ends = np.cumsum(comm.allgather(count))
    graph = cpp.mesh.build_dual_graph(comm, cells, dim)
    cell = np.repeat(np.arange(count), np.diff(graph.offsets))
    rank = np.searchsorted(ends, graph.array, side="right")
    away = rank != comm.rank
    ghosts = np.unique(cell[away] * size + rank[away])
    order = np.argsort(np.append(np.arange(count), ghosts // size), kind="stable")
    ranks = np.append(np.full(count, comm.rank), ghosts % size)[order].astype(np.int32)
    offsets = np.append(0, np.cumsum(1 + np.bincount(ghosts // size, minlength=count)))
    return cpp.graph.AdjacencyList_int32(ranks, offsets.astype(np.int32))


def arguments_of(function: Callable[..., Any]) -> int:
    """Number of positional arguments that a function must be given."""
    kinds = inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD
    asked = inspect.signature(function).parameters.values()
    return len([one for one in asked if one.kind in kinds and one.default is one.empty])


def function_space(
    domain: dolfinx_mesh.Mesh, family: str, degree: int, shape: tuple[int, ...] = ()
) -> Any:
    """Scalar or vector Lagrange ("Lagrange") or discontinuous ("DG") space."""
    if hasattr(fem, "functionspace"):
        return fem.functionspace(domain, (family, degree, shape) if shape else (family, degree))
    if shape:
        return fem.VectorFunctionSpace(domain, (family, degree), dim=shape[0])
    return fem.FunctionSpace(domain, (family, degree))


def cell_dofs(space: Any) -> npt.NDArray[np.int32]:
    """Local (block) dofs of every local cell, shape (cells, dofs of a cell)."""
    return _rows(space.dofmap.list, space.dofmap.dof_layout.num_dofs)


def geometry_dofs(domain: dolfinx_mesh.Mesh) -> npt.NDArray[np.int32]:
    """Local geometry nodes of every local cell, shape (cells, nodes of a cell)."""
    tables = getattr(domain.geometry, "dofmaps", None)  # of dolfinx 0.11: one per kind of cell
    table = tables[0] if isinstance(tables, list) else domain.geometry.dofmap
    return _rows(table, NODES[domain.topology.cell_type.name])


def same_topology(tags: Any, domain: dolfinx_mesh.Mesh) -> bool:
    """Whether mesh tags are those of a mesh; AttributeError where they are no mesh tags."""
    of_tags = getattr(tags, "mesh", tags).topology
    topology = domain.topology
    return getattr(of_tags, "_cpp_object", of_tags) is getattr(topology, "_cpp_object", topology)


def _rows(table: Any, width: int) -> npt.NDArray[np.int32]:
    """An adjacency list with rows of one width as an array, also where there is no row."""
    return table if isinstance(table, np.ndarray) else table.array.reshape(-1, width)


@contextmanager
def quiet_compiler() -> Iterator[None]:
    """Keep the compiler's lines off the console; dolfinx 0.5 logs them at the root."""
    root = logging.getLogger()
    disabled = root.manager.disable
    level = root.level
    handlers = root.handlers[:]
    logging.disable(max(disabled, logging.INFO))
    try:
        yield
    finally:
        logging.disable(disabled)
        root.setLevel(level)
        root.handlers[:] = handlers


@contextmanager
def form_cache() -> Iterator[Path]:
    """Keep the cache of compiled forms, a folder, to this process, and free of a killed one's.

    FFCx waits for ten seconds for a source that another process compiles, and then gives up. If
    that process was killed, the lock file still says so, and its sources are removed.
    """
    options = getattr(jit, "get_options", None) or jit.get_parameters
    folder = Path(options()["cache_dir"])
    with ExitStack() as stack:
        with suppress(OSError):  # where nothing can be written, all may be compiled already
            folder.mkdir(parents=True, exist_ok=True)
            lock = os.open(folder / "fenics_contact.lock", os.O_RDWR | os.O_CREAT, 0o644)
            stack.callback(os.close, lock)
            fcntl.flock(lock, fcntl.LOCK_EX)  # the system ends it with the process
            if os.read(lock, 1):
                for source in folder.glob("libffcx_*.c"):
                    if not source.with_suffix(".c.cached").exists():
                        source.unlink(missing_ok=True)
            os.write(lock, b"compiling")
            stack.callback(os.ftruncate, lock, 0)
        yield folder


def add_ghosts(vector: Any) -> None:
    """Add the values at ghosts to those at their owners."""
    modes = getattr(la, "InsertMode", None) or la.ScatterMode
    vector.scatter_reverse(modes.add)


def summed(index_map: Any, values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """Sums over ranks of values by entity; those at ghosts may be left out."""
    vector = la.vector(index_map, 1)
    vector.array[: len(values)] = values
    add_ghosts(vector)
    vector.scatter_forward()
    return np.array(vector.array)


def interpolation_points(space: Any) -> Any:
    """Reference points at which an expression is evaluated to be interpolated into a space."""
    points = space.element.interpolation_points
    return points() if callable(points) else points


def write_vtk(
    path: Path, comm: MPI.Comm, steps: Iterable[tuple[float, list[fem.Function]]]
) -> None:
    """Write functions of one mesh at times into ParaView files, .pvd and pieces; see `tidy_vtk`.

    Raises:
        OSError: Perhaps, if a file cannot be made; dolfinx overlooks full disks.
    """
    complete = True
    file = io.VTKFile(comm, str(path), "w")
    try:
        for time, functions in steps:
            file.write_function(functions, time)
        file.close()
    except RuntimeError:
        complete = False
    del file  # or it would make its folder again when it is collected
    if not complete:
        raise OSError(f"'{path.name}' is not complete, is there room?")


def tidy_vtk(path: Path, numbers: Sequence[Mapping[str, float]]) -> None:
    """Tidy what all ranks wrote by `write_vtk`, and add numbers of every time, on one rank.

    The numbers become field data. Every piece is listed once: dolfinx 0.5 repeats the list for
    every function written. Pieces get the number of an older format, which differs for hexahedra
    alone: meshio knows no later one.

    Raises:
        OSError: If a file is not complete.
    """
    try:
        for parallel, named in zip(_files_of(path), numbers, strict=True):
            tree = ElementTree.parse(parallel)
            for grid in tree.getroot():
                first = {piece.get("Source"): piece for piece in reversed(grid.findall("Piece"))}
                for piece in grid.findall("Piece"):
                    if piece is not first[piece.get("Source")]:
                        grid.remove(piece)
                for array in grid.iterfind(".//PDataArray[@NumberOfComponents='0']"):
                    array.set("NumberOfComponents", "1")
            tree.write(parallel, encoding="utf-8", xml_declaration=True)
            for piece in _files_of(parallel):
                _add_field_data(piece, named)
    except ElementTree.ParseError:
        raise OSError(f"'{path.name}' is not complete, is there room?") from None


def _add_field_data(path: Path, numbers: Mapping[str, float]) -> None:
    """Add numbers at the end of a .vtu file, in which order does not matter."""
    form = '<DataArray type="Float64" Name="{}" NumberOfTuples="1" format="ascii">{!r}</DataArray>'
    field = "".join(form.format(name, value) for name, value in numbers.items())
    with path.open("r+b") as file:
        head = file.read(80).replace(b'version="2.2"', b'version="1.0"')
        file.seek(0)
        file.write(head)
        file.seek(-min(path.stat().st_size, 80), 2)
        start = file.tell()
        end = file.read()
        if not end.rstrip().endswith(b"</VTKFile>"):
            raise OSError(f"'{path.name}' is not complete, is there room?")
        file.seek(start + end.index(b"</UnstructuredGrid>"))
        file.write(f"<FieldData>{field}</FieldData></UnstructuredGrid></VTKFile>\n".encode())
        file.truncate()


def _files_of(path: Path) -> list[Path]:
    """Files that a .pvd or .pvtu file lists."""
    named = (item.get("file") or item.get("Source") for item in ElementTree.parse(path).iter())
    return [path.parent / name for name in dict.fromkeys(named) if name]
