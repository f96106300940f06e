"""Tetrahedra of a block, by gmsh."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.geometry.gmsh_mesh import gmsh_session
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.spatial.polyhedra import Block

#: Length of edges by default, over the thickness of a block: the side of a cube of as much volume
#: by surface.
SIZE = 0.5
#: Tetrahedra of a block at most, where an edge of length h has h^3 / 8: else it is a sliver.
MOST = 300_000
#: By how much the volume of the tetrahedra may miss that of the block, relative: warped sides.
VOLUME = 1e-2
#: gmsh's number of a tetrahedron.
TETRAHEDRON = 4


def tetrahedra(block: Block, size: float | None = None) -> tuple[Array, Indices]:
    """Nodes, m, shape (nodes, 3), and corners of the tetrahedra that fill a block, (cells, 4).

    Pieces of a block share nodes where they touch.

    Args:
        block: What is meshed.
        size: Length of edges, m; None: its own tetrahedra, or else by its thickness.

    Raises:
        SolverError: If gmsh does not mesh it; without the name of the block.
    """
    if block.cells is not None and size is None:
        nodes, cells = np.unique(block.cells.reshape(-1, 3), axis=0, return_inverse=True)
        return nodes, _filled(block, nodes, cells.reshape(-1, 4))
    size = size or SIZE * max(piece.thickness for piece in block.pieces)
    if 8.0 * block.volume > MOST * size**3:
        raise SolverError(f"edges of {size:.2g} m would make more than {MOST} tetrahedra")
    try:
        with gmsh_session(MeshSizeMax=size, MeshSizeMin=0.5 * size) as gmsh:
            nodes, cells = _meshed(gmsh.model, block, size)
    except Exception as error:  # gmsh has no error of its own
        raise SolverError(f"gmsh: {' '.join(str(error).split())}") from error
    return nodes, _filled(block, nodes, cells)


def _filled(block: Block, nodes: Array, cells: Indices) -> Indices:
    """Cells, if they fill a block."""
    volume = abs(np.linalg.det(nodes[cells[:, 1:]] - nodes[cells[:, :1]]).sum()) / 6.0
    if abs(volume - block.volume) > VOLUME * block.volume:
        raise SolverError(f"its tetrahedra have {volume:.4g} of {block.volume:.4g} m3")
    return cells


def _meshed(model: Any, block: Block, size: float) -> tuple[Array, Indices]:
    """As `tetrahedra`, of a model in a session."""
    model.add("block")
    try:
        kernel = model.geo if len(block.pieces) == 1 else model.occ
        volumes = []
        for piece in block.pieces:
            points = [kernel.addPoint(*corner, size) for corner in piece.corners.tolist()]
            lines: dict[tuple[int, int], int] = {}
            sides = []
            for side in piece.sides:
                loop = []
                for a, b in zip(side, (*side[1:], side[0]), strict=True):
                    if (b, a) not in lines:
                        lines[a, b] = kernel.addLine(points[a], points[b])
                    loop.append(lines[a, b] if (a, b) in lines else -lines[b, a])
                sides.append(kernel.addPlaneSurface([kernel.addCurveLoop(loop)]))
            volumes.append((3, kernel.addVolume([kernel.addSurfaceLoop(sides)])))
        if len(volumes) > 1:
            kernel.fragment(volumes[:1], volumes[1:])
        kernel.synchronize()
        model.mesh.generate(3)
        tags, coordinates, _ = model.mesh.getNodes()
        _, corners = model.mesh.getElementsByType(TETRAHEDRON)
    finally:
        model.remove()
    used, cells = np.unique(corners, return_inverse=True)
    place = np.argsort(tags)[np.searchsorted(np.sort(tags), used)]
    return coordinates.reshape(-1, 3)[place], cells.reshape(-1, 4)
