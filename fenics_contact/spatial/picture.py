"""The collapse in three views: from the front, from the side, and from above a corner.

A wall has one, in which its motion is seen. From the front and the side, what is far behind other
blocks is pale and has no marks: cracks of the back would be taken for those of the front.

Blocks are drawn from the farthest to the nearest. Of two convex bodies one lies beyond a plane of
a side of the other; which side of this plane the eye is on tells their order.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.output.figures import Figure, draw_figures, figures_of, picture_paths
from fenics_contact.output.folder import drawing, going_on
from fenics_contact.output.plotting import (
    BLACK,
    DPI,
    GREEN,
    MARKS,
    QUIET,
    TIES,
    legend,
    save_figure,
    shades,
)
from fenics_contact.output.view import planar
from fenics_contact.results.block_view import BlockView, ContactState
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
#: Two bodies overlap by less than this, over the structure's size.
TOUCH = 2e-3
#: Edges of contacts lie on a side within this, over the structure's size.
ON_SIDE = 1e-4
#: Sides whose normals are nearer to a right angle with the line of sight are not seen.
EDGEWISE = 1e-6
#: Free around the structure, over its size.
MARGIN = 0.06
#: Width and height of one of three views, and of a single one, inches.
LARGEST, SINGLE = 4.6, 7.5
#: A wall is thinner than this part of its other sides; it moves by less than this part across.
THIN, IN_PLANE = 0.35, 0.05
#: White in the colours of what is far: by more than this part of the structure's size.
PALE, NEAR = 0.55, 0.3
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
        flat = planar(view, known=end.force is not None, thickness=result.scene.thickness)
        figures += figures_of(flat)
    if output.pictures != ALL and not output.report:
        figures = [one for one in figures if one.kind in ("collapse", "marked")]
    return lost + draw_figures(figures, folder, output.formats)


def save_view(view: BlockView, paths: Sequence[Path | BinaryIO]) -> None:
    """Draw the blocks from three sides into files."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    turns = {name: axes_to(eye) for name, eye in _eyes(view).items()}
    windows = [np.ptp(_window(view, turn), axis=0) for turn in turns.values()]
    widths, heights = np.transpose(windows)
    scale = (LARGEST if len(turns) > 1 else SINGLE) / max(widths.max(), heights.max())
    shape = scale * widths.sum() + 0.6, scale * heights.max() + 1.3
    figure = Figure(figsize=shape, dpi=DPI, layout="constrained")
    panels = figure.subplots(1, len(turns), width_ratios=widths, squeeze=False)[0]
    for axes, (title, turn) in zip(panels, turns.items(), strict=True):
        draw_view(axes, view, turn)
        axes.set_title(title, fontsize=9)
    state = view.contacts.state
    told = [mark for kind, mark in MARKS.items() if np.any(state == kind) and kind not in QUIET]
    told += [(GREEN, TIES[state][0]) for state in sorted(set(_tie_states(view)), reverse=True)]
    told += [(BLACK, "live load")] * bool(view.push.any())
    legend(panels[-1], [(label, Line2D([], [], color=c, lw=2.0)) for c, label in told])
    save_figure(figure, view.whole_title, paths)


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
    """What a picture has room for: ties, blocks that move, at rest and displaced; shape (2, 2)."""
    moves = ~view.bodies.fixed[view.bodies.block]
    rest = view.bodies.corner[moves]
    seen = [rest, rest + view.displacement[moves], *view.moved_ties]
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
    lit += PALE * far[bodies.side_piece, None] * (1.0 - lit)
    marks = _marks(view, turn)
    thin = 0.5 if len(view.motion) < 200 else 0.3
    hides = _hidden(view, place, turn)
    depth = np.add.reduceat(place[:, 2], bodies.first) / bodies.counts
    fixed = bodies.fixed[bodies.of_piece]
    veils = fixed & hides[~fixed].any(axis=0)  # ground before what moves: its edges alone are drawn
    drawn: list[tuple[Array, Any, Any, float]] = []  # polygons, colours of faces, of edges, widths
    for piece in drawing_order(hides, depth):
        for side in np.flatnonzero((bodies.side_piece == piece) & (normal[:, 2] > EDGEWISE)):
            face = "none" if veils[piece] else tuple(lit[side])
            drawn.append((place[bodies.sides[side], :2], face, "0.25", thin))
            if not far[piece]:
                drawn += [(line, "none", colour, 1.6) for line, colour in marks[side]]
    polygons, faces, edges, widths = zip(*drawn, strict=True)
    style = {"facecolors": faces, "edgecolors": edges, "linewidths": widths}
    axes.add_collection(PolyCollection(polygons, joinstyle="round", **style))
    (left, low), (right, high) = _window(view, turn)
    axes.set(xlim=(left, right), ylim=(low, high))
    for ends, state in zip(view.moved_ties, _tie_states(view), strict=True):
        style = {"color": GREEN, "marker": "s", "ms": 3.0} | TIES[state][1]
        axes.plot(*(ends @ turn[:2].T).T, **style)
    start, end = view.push @ turn[:2].T
    if np.linalg.norm(end - start) > 0.2 * np.linalg.norm(view.push[1] - view.push[0]):
        axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "lw": 2.0, "color": BLACK})
    axes.set_aspect("equal", anchor="S")
    axes.set_axis_off()


def _far(view: BlockView, turn: Array) -> Flags:
    """Which pieces are far behind others, from the front or the side, shape (pieces,)."""
    bodies = view.bodies
    place = bodies.corner @ turn.T
    low = np.minimum.reduceat(place, bodies.first)
    high = np.maximum.reduceat(place, bodies.first)
    moves = ~bodies.fixed[bodies.of_piece]
    near = moves & (high[:, 2] > high[moves, 2].max() - NEAR * view.size)
    middle = 0.5 * (low + high)
    behind = (middle > low[near].min(axis=0)) & (middle < high[near].max(axis=0))
    frontal = np.abs(turn[2]).max() > 1.0 - EDGEWISE
    return np.asarray(frontal & moves & ~near & behind[:, :2].all(axis=1))


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


def _marks(view: BlockView, turn: Array) -> dict[int, list[tuple[Array, str]]]:
    """Edges of contacts on the sides that are seen, displaced, with their colours, by side.

    Those of contacts that slide are where the block is that moves more: one line, not two.
    """
    bodies = view.bodies
    seen = bodies.normal @ turn[2] > MARKED
    marks: dict[int, list[tuple[Array, str]]] = defaultdict(list)
    at = view.touching
    states = view.contacts.state.tolist()
    for pair, corners, state in zip(at.pairs.tolist(), at.corners, states, strict=True):
        moves = max(pair, key=lambda block: view.share[block])
        for block in pair if state not in QUIET else ():
            at_block = moves if state == ContactState.SLIP else block
            flat = (corners + view.displacements(corners, at_block)) @ turn[:2].T
            for side in np.flatnonzero(seen & (bodies.side_block == block)):
                away = (corners - bodies.corner[bodies.sides[side][0]]) @ bodies.normal[side]
                on = np.abs(away) < ON_SIDE * view.size
                for edge in np.flatnonzero(on & np.roll(on, -1)):
                    line = flat[[edge, (edge + 1) % len(flat)]]
                    marks[side].append((line, MARKS[state][0]))
    return marks
