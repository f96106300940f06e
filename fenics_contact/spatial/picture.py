"""The collapse in three views: from the front, from the side, and from above a corner.

Blocks are drawn from the farthest to the nearest. Of two convex bodies one lies beyond a plane of
a side of the other; which side of this plane the eye is on tells their order.
"""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heapify, heappop, heappush
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.output.figures import picture_paths
from fenics_contact.output.folder import drawing
from fenics_contact.output.plotting import (
    BLACK,
    BLUE,
    DPI,
    FORCE,
    GREEN,
    ORANGE,
    TINTS,
    VERMILLION,
    legend,
    save_figure,
)
from fenics_contact.spatial.result import SpatialLimit
from fenics_contact.spatial.view import ContactState, SpatialView, views_of

#: Axes to the right, up, and to the eye of every view, by name.
VIEWS = {
    "front (x, z)": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "right side (y, z)": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}
#: Where the eye of the oblique view is.
EYE = (0.62, -1.0, 0.62)
#: Where light comes from, in a view's axes.
LIGHT = np.array([-0.35, 0.55, 0.76])
#: What a side that the light does not reach keeps.
AMBIENT = 0.62
#: Colour of blocks that do not move, and of ground.
STAYS, GROUND = (0.93, 0.93, 0.92), (0.86, 0.85, 0.83)
FALLS = (0.93, 0.75, 0.45)
#: Colours of contacts, and what they do.
MARKS = {
    ContactState.SLIDES: (BLUE, "slides"),
    ContactState.ROCKS: (ORANGE, "opens along an edge"),
    ContactState.OPENS: (VERMILLION, "opens"),
    ContactState.CRUSHES: (FORCE, "crushes"),
}
#: Two bodies overlap by less than this, over the structure's size.
TOUCH = 2e-3
#: Edges of contacts lie on a side within this, over the structure's size.
ON_SIDE = 1e-4
#: Free around the structure, over its size.
MARGIN = 0.06
#: Width and height of a view, inches.
LARGEST = 4.6


def draw_collapse(result: SpatialLimit, folder: Path, formats: Sequence[str] = ("png",)) -> None:
    """Write pictures of the collapse of all directions: collapse.png, collapse_negative.png.

    Args:
        result: What was found.
        folder: Where to, which is there.
        formats: Endings of files.

    Raises:
        OSError: If a file cannot be written.
        DrawingError: If matplotlib fails.
    """
    from matplotlib.figure import Figure

    for suffix, view in views_of(result).items():
        with drawing(f"collapse{suffix}"):
            views = VIEWS | {"oblique": oblique()}
            spans = [np.ptp(_shown(view) @ axes[:2].T, axis=0) for axes in views.values()]
            widths, heights = np.transpose(spans) + 2.0 * MARGIN * view.size
            scale = LARGEST / max(widths.max(), heights.max())
            shape = scale * widths.sum() + 0.6, scale * heights.max() + 1.3
            figure = Figure(figsize=shape, dpi=DPI, layout="constrained")
            panels = figure.subplots(1, len(views), width_ratios=widths)
            for axes, (name, turn) in zip(panels, views.items(), strict=True):
                draw_view(axes, view, turn)
                axes.set_title(name, fontsize=9)
            legend(panels[-1], _entries(view))
            paths = picture_paths(folder / f"collapse{suffix}", formats)
            save_figure(figure, view.title, paths)


def _entries(view: SpatialView) -> list[Any]:
    """What a legend tells of contacts and the live load."""
    from matplotlib.lines import Line2D

    told = {
        colour: label
        for state, (colour, label) in MARKS.items()
        if np.any(view.contacts.state == state)
    }
    told |= {GREEN: "tie"} if view.ties else {}
    told |= {BLACK: "live load"} if view.push.any() else {}
    return [Line2D([], [], color=c, lw=2.0, label=label) for c, label in told.items()]


def oblique() -> Array:
    """Axes of the view from above a corner."""
    eye = np.array(EYE) / np.linalg.norm(EYE)
    right = np.cross([0.0, 0.0, 1.0], eye)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(eye, right), eye])


def _shown(view: SpatialView) -> Array:
    """Corners that a picture has room for: of blocks that move, at rest and displaced."""
    bodies = view.bodies
    moves = np.array([not block.fixed for block in view.structure.blocks])[bodies.block]
    return np.vstack([bodies.corner[moves], (bodies.corner + view.displacement)[moves]])


def draw_view(axes: Any, view: SpatialView, turn: Array) -> None:
    """Blocks, displaced, and what their contacts do, seen along the last of three axes."""
    from matplotlib.collections import PolyCollection

    bodies = view.bodies
    place = (bodies.corner + view.displacement) @ turn.T
    normal = bodies.normal @ turn.T
    colours = block_colours(view)
    light = AMBIENT + (1.0 - AMBIENT) * np.clip(normal @ LIGHT, 0.0, 1.0)
    marks = _marks(view, turn)
    polygons: list[Array] = []
    faces: list[Any] = []
    edges: list[Any] = []
    widths: list[float] = []
    sides: list[list[int]] = [[] for _ in range(int(bodies.piece.max()) + 1)]
    for side in np.flatnonzero(normal[:, 2] > 1e-6):
        sides[bodies.side_piece[side]].append(int(side))
    thin = 0.5 if len(view.structure.blocks) < 200 else 0.3
    hides, depth = _hidden(view, place, turn)
    fixed = np.array([block.fixed for block in view.structure.blocks])[bodies.of_piece]
    veils = fixed & hides[~fixed].any(axis=0)  # ground before what moves: its edges alone are drawn
    for piece in drawing_order(hides, depth):
        for side in sides[piece]:
            polygons.append(place[bodies.sides[side], :2])
            shade = light[side] * colours[bodies.side_block[side]]
            faces.append("none" if veils[piece] else (*shade, 1.0))
            edges.append((0.25, 0.25, 0.25, 1.0))
            widths.append(thin)
            for line, colour in marks.get(side, ()):
                polygons.append(line)
                faces.append("none")
                edges.append(colour)
                widths.append(1.6)
    axes.add_collection(
        PolyCollection(
            polygons, facecolors=faces, edgecolors=edges, linewidths=widths, joinstyle="round"
        )
    )
    low, high = (f(_shown(view) @ turn[:2].T, axis=0) for f in (np.min, np.max))
    margin = MARGIN * view.size
    axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))
    for ends in view.ties:
        axes.plot(*(ends @ turn[:2].T).T, color=GREEN, lw=1.6, ls="--", marker="s", ms=3.0)
    start, end = view.push @ turn[:2].T
    if np.linalg.norm(end - start) > 0.2 * np.linalg.norm(view.push[1] - view.push[0]):
        axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "lw": 2.0, "color": BLACK})
    axes.set_aspect("equal", anchor="S")
    axes.set_axis_off()


def block_colours(view: SpatialView) -> Array:
    """Tints of groups, the paler the less a block moves, shape (blocks, 3)."""
    from matplotlib.colors import to_rgb

    blocks = view.structure.blocks
    groups = list(dict.fromkeys(block.group for block in blocks if not block.fixed))
    colours = np.empty((len(blocks), 3))
    for number, block in enumerate(blocks):
        if block.fixed:
            colours[number] = GROUND
        elif number in view.marked:
            colours[number] = FALLS
        else:
            tint = np.array(to_rgb(TINTS[groups.index(block.group) % len(TINTS)]))
            share = view.share[number]
            amount = 0.45 + 0.55 * share if share > 1e-3 else 0.0
            colours[number] = (1.0 - amount) * np.array(STAYS) + amount * tint
    return colours


def _hidden(view: SpatialView, place: Array, turn: Array) -> tuple[Array, Array]:
    """Whether the second of two bodies hides the first, (bodies, bodies), and their depths.

    Args:
        view: What is shown.
        place: Corners in the axes of the view, shape (corners, 3).
        turn: These axes, shape (3, 3).
    """
    bodies = view.bodies
    first = np.flatnonzero(np.diff(bodies.piece, prepend=-1))
    low = np.minimum.reduceat(place, first)
    high = np.maximum.reduceat(place, first)
    near = TOUCH * view.size
    apart = (low[:, None, :2] > high[None, :, :2] - near).any(axis=2)
    overlap = ~(apart | apart.T)
    count = len(first)
    # Of every side and every other body: how far the body's nearest corner lies beyond the side.
    best = np.full((count, count), -np.inf)  # separation of (body of a side, other body)
    faces = np.zeros((count, count))  # whether the eye is beyond that side: +1, -1, or 0 for along
    corner = np.array([loop[0] for loop in bodies.sides])
    ways, way = np.unique(np.round(bodies.normal, 9), axis=0, return_inverse=True)
    for number, direction in enumerate(ways @ turn.T):
        sides = np.flatnonzero(way.ravel() == number)  # one of a body at most
        along = place @ direction
        beyond = np.minimum.reduceat(along, first) - along[corner[sides], None]
        towards = 0.0 if abs(direction[2]) < 1e-3 else float(np.sign(direction[2]))
        # A plane along the line of sight that parts them says that neither hides the other.
        score = np.where((towards == 0.0) & (beyond > -near), np.inf, beyond)
        body = bodies.side_piece[sides]
        faces[body] = np.where(score > best[body], towards, faces[body])
        best[body] = np.maximum(score, best[body])
    swapped = best.T > best
    order = np.where(swapped, -faces.T, faces)  # +1: the second hides the first
    hides = overlap & (order > 0.0)
    np.fill_diagonal(hides, False)
    return hides, np.add.reduceat(place[:, 2], first) / np.bincount(bodies.piece)


def drawing_order(hides: Array, depth: Array) -> Indices:
    """Numbers of bodies such that those that hide others come later, shape (bodies,).

    Where bodies hide each other in a circle the farthest comes first.

    Args:
        hides: Whether the second hides the first, shape (bodies, bodies).
        depth: The larger the nearer, shape (bodies,).
    """
    behind = hides.sum(axis=0)
    drawn = np.zeros(len(depth), dtype=bool)
    order: list[int] = []
    ready = [(depth[body], int(body)) for body in np.flatnonzero(behind == 0)]
    heapify(ready)
    while len(order) < len(depth):
        if not ready:
            left = np.flatnonzero(~drawn)
            left = left[_in_circles(hides[np.ix_(left, left)])]
            ready = [(0.0, int(left[np.argmin(depth[left])]))]
        body = heappop(ready)[1]
        drawn[body] = True
        order.append(body)
        for other in np.flatnonzero(hides[body] & ~drawn):
            behind[other] -= 1
            if behind[other] == 0:
                heappush(ready, (depth[other], int(other)))
    return np.array(order)


def _in_circles(hides: Array) -> Array:
    """Whether bodies hide none but those that hide them, too, in a circle, shape (bodies,)."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    circle = connected_components(csr_matrix(hides), connection="strong")[1]
    behind, before = circle[np.array(np.nonzero(hides))]
    return np.asarray(~np.isin(circle, before[behind != before]))


def _marks(view: SpatialView, turn: Array) -> dict[int, list[tuple[Array, str]]]:
    """Edges of contacts on the sides that are seen, displaced, with their colours, by side."""
    bodies = view.bodies
    seen: dict[int, list[int]] = {}
    for side in np.flatnonzero(bodies.normal @ turn[2] > 1e-6):
        seen.setdefault(int(bodies.side_block[side]), []).append(int(side))
    marks: dict[int, list[tuple[Array, str]]] = {}
    for number, state in enumerate(view.contacts.state):
        contact = view.structure.contacts[number]
        for block in (contact.first, contact.second) if state in MARKS else ():
            corners = contact.corners
            flat = view.displaced(corners, block) @ turn[:2].T
            for side in seen.get(block, ()):
                away = (corners - bodies.corner[bodies.sides[side][0]]) @ bodies.normal[side]
                on = np.abs(away) < ON_SIDE * view.size
                for edge in np.flatnonzero(on & np.roll(on, -1)):
                    line = flat[[edge, (edge + 1) % len(flat)]]
                    marks.setdefault(side, []).append((line, MARKS[ContactState(state)][0]))
    return marks
