"""The collapse in three views: from the front, from the side, and from above a corner.

A wall has one, in which its motion is seen. From the front and the side, what is far behind other
blocks is left out: through openings it would be taken for a part of the front.

Blocks are drawn from the farthest to the nearest. Of two convex bodies one lies beyond a plane of
a side of the other; which side of this plane the eye is on tells their order.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.output.figures import Figure, draw_figures, figures_of, picture_paths
from fenics_contact.output.folder import drawing, going_on
from fenics_contact.output.plotting import (
    BLACK,
    DEAD,
    DPI,
    FORCE,
    HELD,
    MARKS,
    QUIET,
    TIES,
    legend,
    save_figure,
    shades,
)
from fenics_contact.output.view import caption_of, planar
from fenics_contact.results.block_view import LIVE, BlockView, ContactState
from fenics_contact.results.values import TieState
from fenics_contact.scene.scene import ALL, OutputOptions
from fenics_contact.spatial.result import SpatialLimit
from fenics_contact.spatial.view import views_of

#: Where the eye of every view is, by name, by dimension.
VIEWS = {
    2: {"": (0.0, -1.0, 0.0)},
    3: {
        "front (x, z)": (0.0, -1.0, 0.0),
        "right side (y, z)": (1.0, 0.0, 0.0),
        "oblique": (0.62, -1.0, 0.62),
    },
}
#: Where light comes from, in a view's axes.
LIGHT = np.array([-0.35, 0.55, 0.76])
#: What a side that the light does not reach keeps.
AMBIENT = 0.62
#: How much ground before what moves covers.
GLASS = 0.4
#: Two bodies overlap by less than this, over the structure's size.
TOUCH = 2e-3
#: Edges of contacts lie on a side within this, over the structure's size.
ON_SIDE = 1e-4
#: Sides whose normals are nearer to a right angle with the line of sight are not seen.
EDGEWISE = 1e-6
#: Free around the structure, over its size.
MARGIN = 0.06
#: Width and height of all views together, inches.
PAGE = 8.0, 4.6
#: A wall is thinner than this part of its other sides; it moves by less than this part across.
THIN, IN_PLANE = 0.35, 0.05
#: What begins behind this part of a structure's depth is far.
FAR = 0.4
#: Colours of loads; others are grey.
LOADS = {"thrust of floors": HELD, **dict.fromkeys(LIVE, BLACK)}
#: Cosine between a side and the line of sight from which it has marks.
MARKED = 0.05


def draw_collapse(result: SpatialLimit, folder: Path, output: OutputOptions) -> list[str]:
    """Draw collapse.png of all directions; in the plane what is drawn of a meshed scene.

    Args:
        result: What was found.
        folder: Where to, which is there.
        output: Which pictures, and in which formats.

    Returns:
        Which could not be drawn, and why.

    Raises:
        OSError: If a file cannot be written.
    """
    lost: list[str] = []
    figures: list[Figure] = []
    for name, view in views_of(result).items():
        if view.bodies.dimension == 3:
            with going_on(lost), drawing(f"collapse{view.suffix}"):
                save_view(view, picture_paths(folder / f"collapse{view.suffix}", output.formats))
            continue
        end = result.ends[name]
        more = {"thickness": result.scene.thickness, "caption": caption_of(end)}
        flat = planar(view, known=end.force is not None, **more)
        figures += figures_of(flat)
    if output.pictures != ALL and not output.report:
        figures = [one for one in figures if one.kind in ("collapse", "marked")]
    return lost + draw_figures(figures, folder, output.formats)


def save_view(view: BlockView, paths: Sequence[Path | BinaryIO]) -> None:
    """Draw the blocks from three sides into files."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    turns = {name: axes_to(eye) for name, eye in _eyes(view).items()}
    sizes = {name: np.ptp(_window(view, turn), axis=0) for name, turn in turns.items()}
    names = list(turns)
    choices = [[names], [names[:2], names[2:]]][: len(names)]
    scale, rows = max(((PAGE / _extent(sizes, rows)).min(), rows) for rows in choices)
    shape = scale * _extent(sizes, rows) + [0.3, 1.5]
    figure = Figure(figsize=shape.tolist(), dpi=DPI, layout="constrained")
    high = [_extent(sizes, [row])[1] for row in rows]
    ratios = {"width_ratios": [sizes[name][0] for name in rows[0]], "height_ratios": [*high, 0.01]}
    places = [row * (len(rows[0]) // len(row)) for row in [*rows, ["legend"]]]
    panels = figure.subplot_mosaic(places, gridspec_kw=ratios)
    for name, turn in turns.items():
        draw_view(panels[name], view, turn)
        panels[name].set_title(name, fontsize=9)
    panels["legend"].set_axis_off()
    does = {*view.contacts.state, *[ContactState.CRUSHES] * bool(view.touching.crushes.any())}
    told = [mark for kind, mark in MARKS.items() if kind in does.difference(QUIET)]
    ties = [TIES[state] for state in sorted(set(_tie_states(view)), reverse=True)]
    told += [(style["color"], label) for label, style in ties]
    told += [(LOADS.get(name, DEAD), name) for name in view.loads]
    legend(panels["legend"], [(label, Line2D([], [], color=c, lw=2.0)) for c, label in told])
    save_figure(figure, view.whole_title, paths)


def _extent(sizes: Mapping[str, Array], rows: Sequence[list[str]]) -> Array:
    """Width and height of views in rows, m."""
    wide = max(sum(sizes[name][0] for name in row) for row in rows)
    return np.array([wide, sum(max(sizes[name][1] for name in row) for row in rows)])


def _eyes(view: BlockView) -> dict[str, tuple[float, float, float]]:
    """Where the eye of every view is, by name: of the one that says most, of a wall."""
    size = np.ptp(view.box, axis=0)
    across = int(np.argmin(size))
    if across == 2 or size[across] > THIN * np.sort(size)[1]:
        return VIEWS[3]
    most = np.abs(view.displacement).max(axis=0)
    in_plane = view.motion.any() and most[across] < IN_PLANE * most.max()
    name = list(VIEWS[3])[1 - across] if in_plane else "oblique"
    return {name: VIEWS[3][name]}


def axes_to(eye: Sequence[float]) -> Array:
    """Axes to the right, up, and to the eye, shape (3, 3)."""
    towards = np.array(eye) / np.linalg.norm(eye)
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])


def _window(view: BlockView, turn: Array) -> Array:
    """What there is room for: loads, ties, blocks that move, at rest and displaced; (2, 2)."""
    moves = ~view.bodies.fixed[view.bodies.block]
    rest = view.bodies.corner[moves]
    seen = [rest, rest + view.displacement[moves], *view.moved_ties]
    seen += [ends.reshape(-1, 3) for ends in view.arrows.values()]
    places = np.vstack(seen) @ turn[:2].T
    margin = MARGIN * view.size
    return np.array([places.min(axis=0) - margin, places.max(axis=0) + margin])


def draw_view(axes: Any, view: BlockView, turn: Array) -> None:
    """Blocks, displaced, and what their contacts do, seen along the last of three axes."""
    from matplotlib.collections import PolyCollection

    bodies = view.bodies
    place = (bodies.corner + view.displacement) @ turn.T
    normal = bodies.normal @ turn.T
    light = AMBIENT + (1.0 - AMBIENT) * np.clip(normal @ LIGHT, 0.0, 1.0)
    colours = shades(bodies.group, view.share, bodies.fixed, view.marked)
    lit = light[:, None] * colours[bodies.side_block]
    far = _far(view, turn)
    marks = _marks(view, turn)
    thin = 0.5 if len(view.motion) < 200 else 0.3
    hides = _hidden(view, place, turn)
    depth = np.add.reduceat(place[:, 2], bodies.first) / bodies.counts
    fixed = bodies.fixed[bodies.of_piece]
    veils = fixed & hides[~fixed].any(axis=0)  # ground before what moves: as of glass
    drawn: list[tuple[Any, ...]] = []  # polygons, colours of faces, of edges, widths
    for piece in drawing_order(hides, depth):
        seen = (bodies.side_piece == piece) & (normal[:, 2] > EDGEWISE) & ~far[piece]
        for side in np.flatnonzero(seen):
            face = (*lit[side], GLASS if veils[piece] else 1.0)
            drawn.append((place[bodies.sides[side], :2], face, "0.25", thin))
            drawn += [(line, "none", *style) for line, *style in marks[side]]
    polygons, faces, edges, widths = zip(*drawn, strict=True)
    style = {"facecolors": faces, "edgecolors": edges, "linewidths": widths}
    axes.add_collection(PolyCollection(polygons, joinstyle="round", **style))
    (left, low), (right, high) = _window(view, turn)
    axes.set(xlim=(left, right), ylim=(low, high))
    for ends, state in zip(view.moved_ties, _tie_states(view), strict=True):
        style = {"marker": "s", "ms": 3.0} | TIES[state][1]
        axes.plot(*(ends @ turn[:2].T).T, **style)
    far_blocks = np.append(bodies.of_piece[far], -2)
    for name, ends in view.arrows.items():
        tail, tip = ends[~np.isin(view.loads[name].block, far_blocks)].swapaxes(0, 1) @ turn[:2].T
        style = {"color": LOADS.get(name, DEAD), "width": 0.022 if name in LIVE else 0.011}
        style |= {"angles": "xy", "scale": 1.0, "scale_units": "xy", "units": "inches", "zorder": 5}
        axes.quiver(*tail.T, *(tip - tail).T, **style)
    axes.set_aspect("equal", anchor="S")
    axes.set_axis_off()


def _far(view: BlockView, turn: Array) -> Flags:
    """Which pieces are far, and inside the outline of the others, from the front or the side.

    Of shape (pieces,).
    """
    from scipy.spatial import ConvexHull

    bodies = view.bodies
    place = bodies.corner @ turn.T
    low = np.minimum.reduceat(place, bodies.first)
    high = np.maximum.reduceat(place, bodies.first)
    moves = ~bodies.fixed[bodies.of_piece]
    back, front = low[moves, 2].min(), high[moves, 2].max()
    far = moves & (high[:, 2] < front - FAR * (front - back))
    if np.abs(turn[2]).max() < 1.0 - EDGEWISE or not far.any():
        return np.zeros_like(far)
    near = (moves & ~far)[np.repeat(np.arange(len(far)), bodies.counts)]
    outline = ConvexHull(place[near, :2]).equations
    beyond = (place[:, :2] @ outline[:, :2].T + outline[:, 2]).max(axis=1)
    return np.asarray(far & (np.maximum.reduceat(beyond, bodies.first) < TOUCH * view.size))


def _tie_states(view: BlockView) -> list[int]:
    """What every tie does."""
    return list(view.ties.get("state", [TieState.ELASTIC] * len(view.tie_ends)))


def _hidden(view: BlockView, place: Array, turn: Array) -> Flags:
    """Whether the second of two bodies hides the first, shape (bodies, bodies).

    Args:
        view: What is shown.
        place: Corners in the axes of the view, shape (corners, 3).
        turn: These axes, shape (3, 3).
    """
    bodies = view.bodies
    low = np.minimum.reduceat(place, bodies.first)[:, :2]
    high = np.maximum.reduceat(place, bodies.first)[:, :2]
    near = TOUCH * view.size
    apart = (low[:, None] > high - near).any(axis=2)
    # Of every side and every other body: how far the body's nearest corner lies beyond the side.
    best = np.full(apart.shape, -np.inf)  # separation of (body of a side, other body)
    faces = np.zeros(apart.shape)  # whether the eye is beyond that side: +1, -1, or 0 for along
    for side, normal in enumerate(bodies.normal @ turn.T):
        piece = bodies.side_piece[side]
        along = place @ normal
        beyond = np.minimum.reduceat(along, bodies.first) - along[bodies.sides[side][0]]
        towards = 0.0 if abs(normal[2]) < 1e-3 else float(np.sign(normal[2]))
        # A plane along the line of sight that parts them says that neither hides the other.
        score = np.where((towards == 0.0) & (beyond > -near), np.inf, beyond)
        faces[piece] = np.where(score > best[piece], towards, faces[piece])
        best[piece] = np.maximum(score, best[piece])
    order = np.where(best.T > best, -faces.T, faces)  # +1: the second hides the first
    alone = apart | apart.T | np.eye(len(apart), dtype=bool)
    return np.asarray(~alone & (order > 0.0))


def drawing_order(hides: Flags, depth: Array) -> list[int]:
    """Numbers of bodies such that those that hide others come later, shape (bodies,).

    Where bodies hide each other in a circle the farthest comes first.

    Args:
        hides: Whether the second hides the first, shape (bodies, bodies).
        depth: The larger the nearer, shape (bodies,).
    """
    behind = hides.sum(axis=0)
    left = np.arange(len(depth))
    order: list[int] = []
    while len(left):
        ready = left[behind[left] == 0]
        if not len(ready):
            ready = left[_in_circles(hides[np.ix_(left, left)])]
        order.append(int(ready[np.argmin(depth[ready])]))
        behind -= hides[order[-1]]
        left = left[left != order[-1]]
    return order


def _in_circles(hides: Flags) -> Flags:
    """Whether bodies hide none but those that hide them, too, in a circle, shape (bodies,)."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    circle = connected_components(csr_matrix(hides), connection="strong")[1]
    behind, before = circle[np.array(np.nonzero(hides))]
    return np.asarray(~np.isin(circle, before[behind != before]))


def _marks(view: BlockView, turn: Array) -> dict[int, list[tuple[Array, str, float]]]:
    """Edges of contacts on the sides that are seen, displaced, with colours and widths, by side.

    Those of contacts that slide are where the block is that moves more: one line, not two. What
    crushes is wide, below what else it does.
    """
    bodies = view.bodies
    seen = bodies.normal @ turn[2] > MARKED
    marks: dict[int, list[tuple[Array, str, float]]] = defaultdict(list)
    at = view.touching
    states = view.contacts.state.tolist()
    for pair, corners, state, crushes in zip(
        at.pairs.tolist(), at.corners, states, at.crushes, strict=True
    ):
        moves = max(pair, key=lambda block: view.share[block])
        styles = [(MARKS[state][0], 1.6)] * (state not in QUIET)
        if crushes and state != ContactState.CRUSHES:
            styles.insert(0, (FORCE, 4.5))
        for block in pair if styles else ():
            at_block = moves if state == ContactState.SLIP else block
            flat = (corners + view.displacements(corners, at_block)) @ turn[:2].T
            for side in np.flatnonzero(seen & (bodies.side_block == block)):
                away = (corners - bodies.corner[bodies.sides[side][0]]) @ bodies.normal[side]
                on = np.abs(away) < ON_SIDE * view.size
                for edge in np.flatnonzero(on & np.roll(on, -1)):
                    line = flat[[edge, (edge + 1) % len(flat)]]
                    marks[side] += [(line, *style) for style in styles]
    return marks
