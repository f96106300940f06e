"""A scene file to begin with, for the mesh of a drawing: the keys that most scenes need, explained.

It is complete: what a drawing does not say has a usual value, and a comment that says so. Its
groups are guessed to be joints, free edges, or the ground on which it stands.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.errors import require
from fenics_contact.geometry.dxf.blocks import LEVEL, DxfContents
from fenics_contact.geometry.meshing import ground_level
from fenics_contact.geometry.outlines import (
    divided_outlines,
    sides_of_outlines,
    sides_on,
    undirected,
)

#: Words in names of layers on which a structure stands.
GROUND = frozenset(
    "base ground foundation foundations support supports springing springings abutment abutments"
    " terreno fondazione fondazioni appoggio appoggi imposta imposte boden fundament auflager"
    " kämpfer widerlager sol fondation fondations appui appuis suelo cimiento cimientos apoyo"
    " apoyos".split()
)


#: Usual values: Pa, 1, kg/m3 of stone masonry; friction of dry joints, tan 31 degrees.
YOUNG = "5.0e9"
POISSON = "0.2"
DENSITY = "2000.0"
FRICTION = "0.6"


@dataclass(frozen=True)
class GroupRoles:
    """Groups of a drawing by what their sides are.

    Attributes:
        ground: Groups on which the structure stands.
        why: How they were guessed.
        joints: Groups whose sides all lie between two blocks.
        edges: Groups whose sides all have one block alone, but for the ground.
    """

    ground: Sequence[str]
    why: str
    joints: Sequence[str]
    edges: Sequence[str]


def with_ground(read: DxfContents) -> tuple[DxfContents, GroupRoles]:
    """A drawing with a group for the ground, which is "base" if none was drawn; its groups' roles.

    The ground is the layers with such a name along which no two blocks touch; else those that lie
    on the ground level as a whole; else "base" is the ground level. Of layers that share sides the
    first is taken.

    Raises:
        InputError: If no layer has the name of a ground, and no side lies on that level.
    """
    drawing = read.drawing
    blocks, near = divided_outlines(list(drawing.blocks), drawing.groups)
    sides = sides_of_outlines(blocks)
    low = np.all(sides[:, :, 1] <= sides[:, :, 1].min() + near, axis=1)
    _, label, count = np.unique(undirected(sides), axis=0, return_inverse=True, return_counts=True)
    shared = count[label.reshape(-1)] > 1
    on = sides_on(blocks, drawing.groups, near)
    free = [name for name in on if not shared[on[name]].any()]
    named = [name for name in free if GROUND & set(re.findall(r"[^\W\d_]+", name.lower()))]
    level = [name for name in free if low[on[name]].all()]
    taken = np.zeros(len(sides), dtype=bool)
    ground = []
    for name in sorted(named or level):
        if not taken[on[name]].any():
            ground.append(name)
            taken |= on[name]
    why = LEVEL if set(ground) <= set(level) else "by its name"
    joints = [name for name in on if shared[on[name]].all()]
    edges = [name for name in free if not taken[on[name]].any()]
    if not ground:
        ground = ["base"]
        drawing = drawing.with_group("base", *ground_level(list(drawing.blocks))["base"])
        length = drawing.lengths()["base"]
        text = "no layer is the ground on which the structure stands: draw lines there on a layer"
        require("base" not in on and length > 0.0, f"{text} 'ground'")
        read = replace(read, drawing=drawing, lengths={**read.lengths, "base": length})
    return read, GroupRoles(ground, why, joints, edges)


def starter_text(
    title: str, mesh: str, read: DxfContents, roles: GroupRoles, gap: str, mortar: str
) -> str:
    """A scene file, TOML.

    Args:
        title: For pictures.
        mesh: Path of the mesh, relative to the scene file.
        read: The drawing.
        roles: Of its groups.
        gap: Of mortar joints, m, as text; empty where blocks touch.
        mortar: Their thickness, for people; empty where `mesh --close` finds none.
    """

    def quoted(text: str) -> str:
        """A string of TOML, which has JSON's escapes and one more."""
        return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007F")

    def key(name: str) -> str:
        """A key of TOML: bare if it can be."""
        return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else quoted(name)

    sides = {name: f"{length:g} m of sides" for name, length in read.lengths.items()}
    friction = f"friction = {FRICTION}"
    rows: list[str | tuple[str, str]] = [  # lines, and lines with a comment
        "# A scene to begin with. What is called a guess is not in the drawing: set it right.",
        "# Units are SI: m, N, Pa, kg/m3. All keys: the scene reference, docs/scene.md.",
        *([f"# warning: in the drawing {read.slips}"] if read.slips else ()),
        f"title = {quoted(title)}",
        f"mesh.file = {quoted(mesh)}",
        ("# plane.thickness = 0.5", "m; forces are printed for the whole thickness then"),
        "",
        "# ---- Materials, by layer of the blocks. All values are guesses.",
    ]
    for name, count in Counter(read.drawing.names).items():
        rows += [
            "",
            (f"[materials.{key(name)}]", f"{count} blocks"),
            (f"young = {YOUNG}", "Pa; matters little for the load factor"),
            f"poisson = {POISSON}",
            (f"density = {DENSITY}", "kg/m3"),
            ("# compressive_strength = 5.0e6", "Pa; joints crush then"),
        ]
    rows += ["", "# ---- Joints. All frictions are guesses.", ""]
    rows += [("[joints.default]", "wherever two blocks touch"), friction]
    if gap:
        rows.append((f"gap = {gap}", "m; gaps between blocks, which must close first"))
    if mortar:
        rows.append(f"# If they are mortar, {mortar}, mesh with --close, and delete this line:")
        rows.append("# mortar has a height, and blocks with a gap fall until they touch.")
    for name in roles.joints:
        if name != "default":
            rows += ["", (f"[joints.{key(name)}]", sides[name]), friction]
    rows += ["", f"# ---- Where the structure stands. A guess: {roles.why}."]
    for name in roles.ground:
        rows += ["", (f"[foundations.{key(name)}]", f"rigid ground, {sides[name]}"), friction]
    rows += [
        "",
        "# ---- Loads",
        "",
        ("[loads.dead]", "acts first, and stays"),
        ("body = [0.0, -9.81]", "m/s2, times density: the weight"),
        "",
        ("[loads.live]", "times the load factor. A guess:"),
        ("body = [9.81, 0.0]", "the weight acting sideways: the load factor is in g"),
    ]
    for name in roles.edges:
        load = f"# traction.{key(name)} = [0.0, -1.0e4]"
        rows.append((load, f"Pa, in place of it: on {sides[name]}"))
    rows += [
        "",
        "[solve]",
        ('# direction = "both"', "the live load as given, and reversed"),
        "",
        "[output]",
        ('units = "m"', "kN, MPa and m on the console and in the report"),
    ]
    lines = [row if isinstance(row, str) else f"{row[0].ljust(29)} # {row[1]}" for row in rows]
    return "\n".join(lines) + "\n"
