"""Files of stresses in blocks: for ParaView, and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fenics_contact.elastic.body import surface_of
from fenics_contact.elastic.stresses import BlockStresses, StressedBlock
from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.output.figures import picture_paths
from fenics_contact.output.folder import drawing
from fenics_contact.output.plotting import DPI, save_figure
from fenics_contact.output.vtu import grid_of, write_grid
from fenics_contact.results.block_view import BlockView
from fenics_contact.spatial.picture import VIEWS, axes_to

#: VTK's number of a tetrahedron.
TETRAHEDRON = 10
#: Of stresses, the part that has the darkest colour: single points are higher.
DARKEST = 99.5
#: Cosine of the angle between facets of one side of a block.
FLAT = 0.999
#: Inches.
PANEL, BAR, TITLE = 4.0, 1.2, 0.6


def write_stresses(stresses: BlockStresses, path: Path) -> None:
    """Write the meshes of all blocks with their stresses, Pa, and displacements by strains, m.

    Raises:
        OSError: If the file cannot be written.
    """
    blocks = stresses.blocks
    points = [len(one.points) for one in blocks]
    start = np.cumsum(points) - points
    cells = np.vstack([one.cells + first for one, first in zip(blocks, start, strict=True)])
    number = np.repeat(np.arange(len(blocks)), [len(one.cells) for one in blocks])
    places = np.vstack([one.points for one in blocks])
    grid = grid_of(TETRAHEDRON, places, np.full(len(cells), 4), {"block": number})
    grid["Cells"]["connectivity"] = cells.ravel()
    least, _, most = np.vstack([one.principal for one in blocks]).T
    grid["PointData"] = {
        "displacement": np.vstack([one.displacement for one in blocks]),
        "stress": np.vstack([one.stress.reshape(-1, 9) for one in blocks]),
        "tension": np.maximum(most, 0.0),
        "pressure": np.maximum(-least, 0.0),
    }
    grid["FieldData"] = {"blocks": tuple(one.name for one in blocks)}
    write_grid(path, grid, "stresses, Pa, of the forces in points.npz")


def draw_stresses(
    stresses: BlockStresses, view: BlockView, folder: Path, formats: Sequence[str]
) -> None:
    """Draw the largest pressures and tensions on the sides of blocks, seen from above a corner.

    Raises:
        OSError: If a file cannot be written.
        DrawingError: If matplotlib fails.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import Normalize, to_rgba
    from matplotlib.figure import Figure

    turn = axes_to(VIEWS[3]["oblique"])
    corners, values, bends = (
        np.concatenate(parts) for parts in zip(*map(_surface, stresses.blocks), strict=True)
    )
    flat = corners @ turn.T
    a, b, c = flat.transpose(1, 2, 0)
    seen = (b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0] > 0.0
    order = np.flatnonzero(seen)[np.argsort(flat[seen, :, 2].mean(axis=1))]
    # Each triangle, then those of its edges that are the block's; the next ones may hide them.
    drawn: list[tuple[int, Array]] = []
    for facet in order:
        sides = flat[facet][[[0, 1], [1, 2], [2, 0]]][bends[facet]]
        drawn += [(facet, flat[facet, :, :2]), *((-1, side[:, :2]) for side in sides)]
    facets, polygons = zip(*drawn, strict=True)
    wide, high, _ = np.ptp(flat, axis=(0, 1))
    with drawing("stresses"):
        shape = 2.0 * (PANEL * min(wide / high, 2.0) + BAR), PANEL + TITLE
        figure = Figure(figsize=shape, dpi=DPI, layout="constrained")
        shades = {"pressure": "Blues", "tension": "Oranges"}
        panels = zip(figure.subplots(1, 2), shades.items(), values.T, strict=True)
        for axes, (name, shade), parts in panels:
            most = float(np.percentile(parts, DARKEST)) or 1.0
            scale = ScalarMappable(Normalize(0.0, 1e-6 * most), shade)
            colours = scale.to_rgba(1e-6 * np.append(parts, 0.0)[list(facets)])
            lines = np.where(np.less(facets, 0)[:, None], to_rgba("0.35"), colours)
            style = {"facecolors": colours, "edgecolors": lines, "linewidths": 0.4}
            axes.add_collection(PolyCollection(polygons, **style))
            axes.autoscale_view()
            axes.set_aspect("equal")
            axes.set_axis_off()
            figure.colorbar(scale, ax=axes, shrink=0.7, label=f"largest {name} (MPa)")
        title = "\n".join(filter(None, (view.title, "stresses under the forces of this state")))
        save_figure(figure, title, picture_paths(folder / f"stresses{view.suffix}", formats))


def _surface(one: StressedBlock) -> tuple[Array, Array, Flags]:
    """Outer facets of a block, m, shape (facets, 3, 3), pressure and tension, Pa, (facets, 2).

    Corners are counterclockwise from outside. The last are their edges at which the surface bends,
    shape (facets, 3).
    """
    facets, _ = surface_of(one.points, one.cells)
    least, _, most = one.principal[facets].mean(axis=1).T
    corners = one.points[facets]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    ends = np.sort(facets[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    both = np.lexsort(ends.T).reshape(-1, 2)  # an edge is of two facets
    bends = np.zeros(len(ends), dtype=bool)
    first, second = normal[both.T // 3]
    bends[both[np.sum(first * second, axis=1) < FLAT]] = True
    values = np.maximum(np.column_stack([-least, most]), 0.0)
    return corners, values, bends.reshape(-1, 3)
