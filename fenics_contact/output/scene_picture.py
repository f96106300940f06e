"""A picture of a scene: materials, joint groups, foundations, supports, ties and loads by name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from fenics_contact.discretization.joints import GROUND
from fenics_contact.discretization.profiles import floor_strips
from fenics_contact.errors.texts import plain
from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.output.drawing import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    VERMILLION,
    add_lines,
    arrow_ends,
    draw_length,
    draw_load,
    draw_rest,
    fineness,
    frame,
    legend,
    material_entries,
)
from fenics_contact.output.view import View
from fenics_contact.scene.scene import Load, Scene

#: Length of the strokes below what does not move, over the structure's size, and their number.
STROKE, STROKES = 0.018, 40
#: Colours of joint groups, repeated if there are more, and of loads.
GROUPS = (BLUE, ORANGE, "#56B4E9", "#CC79A7", "#009E73")
DEAD, HELD = "0.45", "#5b4636"


def draw_scene(axes: Any, view: View, scene: Scene) -> Any:
    """Blocks by material, groups with a role, ties and loads, each by its name."""
    frame(axes, view, *(end for ends in arrow_ends(view, view.dead) for end in ends), _around(view))
    draw_rest(axes, view)
    entries = [*_joint_entries(axes, view), *_held_entries(axes, view, scene)]
    if view.ties is not None:
        for ends in view.ties.bars.sides:
            (line,) = axes.plot(*ends.T, marker="s", ms=4.0, color=GREEN, lw=1.6, zorder=4)
        entries.append((_listed("tie", scene.ties), line))
    entries += draw_load(axes, view, view.dead, DEAD, "dead load")
    entries += draw_load(axes, view, (view.tractions, view.forces, view.body), BLACK, "live load")
    for load, colour in ((scene.dead, DEAD), (scene.live, BLACK)):
        _name_loads(axes, view, load, colour, scene)
    draw_length(axes, view)
    legend(axes, [*entries, *material_entries(axes, view)])
    axes.set_title("materials, groups and loads", fontsize=10)
    return axes


def _around(view: View) -> Array:
    """Corners that leave room for strokes outside the structure, shape (2, 2)."""
    points = view.rest.reshape(-1, 2)
    room = 1.5 * STROKE * view.size
    return np.stack([points.min(axis=0) - room, points.max(axis=0) + room])


def _listed(kind: str, names: Any) -> str:
    text = ", ".join(names)
    return f"{kind}{'s' * (len(names) > 1)} {text if len(text) <= 40 else text[:36] + ' ...'}"


def _joint_entries(axes: Any, view: View) -> Iterator[Any]:
    """Joints between blocks by group, drawn if there is more than one group."""
    joints = view.joints
    between = joints.bodies[joints.segments[:, 0], 0] != GROUND if len(joints.segments) else []
    segments = joints.segments[between]
    law = joints.law[segments[:, 0]]
    found = np.unique(law)
    width = max(1.8 * fineness(axes, view), 0.8)
    for rank, number in enumerate(found if len(found) > 1 else []):
        colour = GROUPS[rank % len(GROUPS)]
        add_lines(axes, joints.position[segments[law == number]], colors=colour, linewidths=width)
        line = axes.plot([], [], color=colour, lw=2.0)[0]
        yield f"joints {joints.names[number]}", line


def _held_entries(axes: Any, view: View, scene: Scene) -> Iterator[Any]:
    """Edges on foundations and supports, with strokes on the side of what does not move."""
    boundary = view.boundary
    kinds = {name: "foundation" for name in scene.foundations}
    kinds |= {name: f"support ({kind})" for name, kind in scene.supports.items()}
    for rank, (name, kind) in enumerate(kinds.items()):
        mine = boundary.in_group(name)
        if not np.any(mine):
            continue
        colour = HELD if kind == "foundation" else VERMILLION
        style: dict[str, Any] = {"colors": colour, "zorder": 3}
        dashes = ("-", (0, (5, 1)), (0, (1, 1)), (0, (4, 1, 1, 1)))[rank % 4]
        add_lines(axes, view.rest[mine], linewidths=2.8, linestyles=dashes, **style)
        add_lines(axes, _strokes(view, mine), linewidths=0.7, **style)
        yield f"{kind} {name}", axes.plot([], [], color=colour, lw=2.8, ls=dashes)[0]


def _strokes(view: View, mine: Flags) -> Array:
    """Short oblique lines on the outside of some facets, evenly spaced, shape (lines, 2, 2)."""
    boundary = view.boundary
    apart = view.size / STROKES
    found = [np.empty((0, 2, 2))]
    for (start, end), normal in zip(view.rest[mine], boundary.normal[mine], strict=True):
        count = max(round(float(np.linalg.norm(end - start)) / apart), 1)
        share = (np.arange(count) + 0.5)[:, None] / count
        foot = start + share * (end - start)
        along = np.array([-normal[1], normal[0]])
        found.append(np.stack([foot, foot + STROKE * view.size * (normal - along)], axis=1))
    return np.concatenate(found)


def _name_loads(axes: Any, view: View, load: Load, colour: str, scene: Scene) -> None:
    """Names of tractions, earth pressures, floors and forces beside where they act."""
    from matplotlib import patheffects

    boundary = view.boundary
    halo = [patheffects.withStroke(linewidth=2.5, foreground="white")]
    style = {"fontsize": 9, "color": colour, "zorder": 6, "path_effects": halo, "ha": "center"}
    edges = [(n, np.flatnonzero(boundary.in_group(n))) for n in (*load.traction, *load.earth)]
    if load is scene.dead:
        edges += [(n, strips.facets) for n, strips in floor_strips(scene, boundary).items()]
    for name, mine in edges:
        middle = view.rest[mine].mean(axis=(0, 1))
        outward = boundary.normal[mine].mean(axis=0)
        axes.text(*(middle - 0.04 * view.size * outward), plain(name), va="center", **style)
    arrows = view.forces if colour == BLACK else view.dead[1]
    for name, place, vector in zip(load.force, arrows.place, arrows.vector, strict=False):
        along = vector / (np.linalg.norm(vector) or 1.0)
        axes.text(*(place + 0.04 * view.size * along), plain(name), va="center", **style)
