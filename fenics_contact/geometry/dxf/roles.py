"""Roles of the layers of a drawing: given by name, or guessed from names and shapes and said.

Roles are "blocks" (closed curves are blocks), "lines" (curves between which faces are blocks),
"voids" (openings), "sides" (lines that name sides) and "ignore". Without any layer of lines, closed
curves alone are blocks; without closed curves, all lines are lines between blocks.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from itertools import pairwise

import numpy as np

from fenics_contact.errors import check_types, require
from fenics_contact.geometry.dxf.curves import as_ring
from fenics_contact.geometry.dxf.faces import faces_between
from fenics_contact.geometry.dxf.reader import Curve, Curves
from fenics_contact.geometry.outlines import (
    inside_outlines,
    points_near_segments,
    sides_of_outlines,
)
from fenics_contact.geometry.planar_cells import Array

#: Words in names of layers that are no part of the structure, and of those of openings.
IGNORED = frozenset(
    "frame border text texts dim dims dimension dimensions title titleblock note notes anno"
    " annotation annotations hatch grid axis axes defpoints viewport legend symbol symbols"
    " squadratura testo testi quote cartiglio assi retino legenda rahmen bemassung bemaßung masse"
    " schraffur achse achsen schriftfeld cadre texte textes cotes cote cartouche hachures hachure"
    " marco texto textos cotas ejes cajetin sombreado".split()
)
OPENINGS = frozenset(
    "opening openings void voids window windows door doors hole holes aperture apertures glaz"
    " apertura vuoto vuoti finestra finestre porta porte foro fori oeffnung oeffnungen öffnung"
    " öffnungen fenster tür türen tuer tueren loch aussparung ouverture ouvertures fenetre fenetres"
    " fenêtre fenêtres baie baies vide vides hueco huecos ventana ventanas puerta puertas vano"
    " vanos".split()
)
#: Part of the length of lines that runs through blocks, from which they are lines between blocks.
THROUGH = 0.2
#: Faces of lines alone for every closed curve, from which the closed ones are no blocks.
MANY = 3.0
#: Fewest curves that a frame goes around.
FRAMED = 4
#: Closed curves of these kinds are symbols, unless their layer is given a role.
SYMBOLS = ("CIRCLE", "ELLIPSE", "SPLINE")


@dataclass(frozen=True)
class LayerRoles:
    """Layers by role, as a user gives them; names without case, with * and ?.

    Attributes:
        blocks: Layers whose closed curves are blocks.
        lines: Layers of lines between blocks.
        voids: Layers of openings.
        ignore: Layers that are left out.
    """

    blocks: Sequence[str] = ()
    lines: Sequence[str] = ()
    voids: Sequence[str] = ()
    ignore: Sequence[str] = ()

    def __post_init__(self) -> None:
        check_types(self)

    def of_layers(self, layers: Iterable[str], source: str) -> dict[str, str]:
        """Role of every layer that is named.

        Raises:
            InputError: If no layer has a name that was given, or a layer has two roles.
        """
        known = sorted(set(layers))
        roles: dict[str, str] = {}
        for role in ("blocks", "lines", "voids", "ignore"):
            for pattern in getattr(self, role):
                named = [name for name in known if fnmatchcase(name.lower(), pattern.lower())]
                text = f"has no lines on a layer '{pattern}'; it has {', '.join(known)}"
                there = bool(named) or role == "ignore"  # texts are on layers without curves
                require(there, f"{source} {text}")
                for name in named:
                    other = roles.setdefault(name, role)
                    text = f"layer '{name}' is given as {other} and as {role}; give one"
                    require(other == role, text)
        return roles


@dataclass
class CurveRoles:
    """Curves by role.

    Attributes:
        blocks: Closed curves that are blocks.
        lines: Curves between which faces are blocks.
        voids: Outlines of openings.
        sides: Lines that name sides.
        notes: What was guessed and left out.
    """

    blocks: list[int] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    voids: list[int] = field(default_factory=list)
    sides: list[int] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def layers_of_both(self, curves: Sequence[Curve]) -> list[str]:
        """Layers with closed curves that are blocks and lines that bound none."""
        lines = {curves[k].layer for k in self.sides if not curves[k].closed}
        return sorted(lines & {curves[k].layer for k in self.blocks})


def curve_roles(
    found: Curves, chains: Sequence[Array], given: LayerRoles, near: float
) -> CurveRoles:
    """Role of every curve of a drawing, by its index.

    Args:
        found: The curves.
        chains: Corners of every curve.
        given: Roles that the user gives.
        near: Distance within which points are the same.

    Raises:
        InputError: See `LayerRoles.of_layers`.
    """
    curves = found.curves
    by_layer = given.of_layers([curve.layer for curve in curves], found.source)
    named = set(by_layer)
    roles = CurveRoles()
    for layer in sorted({curve.layer for curve in curves} - named):
        words = set(re.findall(r"[^\W\d_]+", layer.lower()))
        for some, kind, text in ((IGNORED, "ignore", "left out"), (OPENINGS, "voids", "openings")):
            if words & some and layer not in by_layer:
                by_layer[layer] = kind
                roles.notes.append(
                    f"{text} by its name: layer '{layer}' (else give it with --blocks or --lines)"
                )
    kinds = Counter[str]()
    left = []
    for k, curve in enumerate(curves):
        if curve.closed and curve.kind in SYMBOLS and curve.layer not in by_layer:
            kinds[curve.kind] += 1
        elif by_layer.get(curve.layer) != "ignore":
            left.append(k)
    roles.notes += [
        f"left out: {count} closed {kind} (else give the layer with --blocks)"
        for kind, count in kinds.items()
    ]
    left = _without_frames(found, chains, left, named, roles.notes)
    may_be_blocks = ("blocks",) if given.blocks else _BLOCKS
    closed = [
        k for k in left if curves[k].closed and by_layer.get(curves[k].layer) in may_be_blocks
    ]
    layers = dict.fromkeys(curves[k].layer for k in closed)
    if not given.blocks and len(layers) > 1:
        roles.notes.append(
            f"closed curves are blocks on layers {', '.join(layers)}; name those that are no stones"
            " with --voids or --ignore"
        )
    others = {curves[k].layer for k in left if curves[k].closed} - set(layers) - named
    if given.blocks and others:
        listed = ", ".join(sorted(others))
        roles.notes.append(f"closed curves on layers {listed} are no blocks, as --blocks says")
    rest = sorted(set(left) - set(closed))
    between = {curves[k].layer for k in rest if curves[k].layer not in by_layer}
    rings = [as_ring(curves[k], chains[k]) for k in rest]
    asked = closed and between and not given.blocks and len(rings) > len(closed)
    if asked and len(faces_between(rings, near).outlines) >= MANY * len(closed):
        roles.notes.append(
            f"lines between blocks: layers {', '.join(sorted(between))}, with many more faces than"
            " there are closed curves, which name the blocks in them (else give --blocks LAYERS)"
        )
    else:
        between = _lines_between_blocks(curves, chains, left, by_layer, closed, roles.notes)
    for k in left:
        role = by_layer.get(curves[k].layer)
        if role == "voids":
            roles.voids.append(k)
        elif role == "lines" or (not curves[k].closed and curves[k].layer in between):
            roles.lines.append(k)
        elif curves[k].closed and role in may_be_blocks:
            roles.blocks.append(k)
        else:
            roles.sides.append(k)
    return roles


_BLOCKS = (None, "blocks")


def _without_frames(
    found: Curves, chains: Sequence[Array], left: list[int], named: set[str], notes: list[str]
) -> list[int]:
    """Curves but for closed ones around all others, which they do not touch."""
    low = np.array([chains[k].min(axis=0) for k in left]).reshape(-1, 2)
    high = np.array([chains[k].max(axis=0) for k in left]).reshape(-1, 2)
    kept = np.ones(len(left), dtype=bool)
    for place in np.argsort(-np.prod(high - low, axis=1)).tolist():
        curve = found.curves[left[place]]
        others = kept.copy()
        others[place] = False
        around = others.sum() >= FRAMED and (
            np.all(low[place] < low[others].min(axis=0))
            and np.all(high[place] > high[others].max(axis=0))
        )
        if not curve.closed or curve.layer in named or not around:
            break
        width, height = high[place] - low[place]
        notes.append(
            f"left out as a frame around all else: the closed {curve.kind} on layer"
            f" '{curve.layer}', {width:g} x {height:g} {found.unit}"
            f" (else give --blocks {curve.layer})"
        )
        kept[place] = False
    return [k for k, keep in zip(left, kept, strict=True) if keep]


def _lines_between_blocks(
    curves: Sequence[Curve],
    chains: Sequence[Array],
    left: list[int],
    by_layer: Mapping[str, str],
    closed: list[int],
    notes: list[str],
) -> set[str]:
    """Layers whose open curves are lines between blocks though no one said so."""
    layers: dict[str, list[int]] = {}
    for k in left:
        if not curves[k].closed and by_layer.get(curves[k].layer) in _BLOCKS:
            layers.setdefault(curves[k].layer, []).append(k)
    if not closed:
        if layers:
            notes.append(f"lines between blocks: layers {', '.join(sorted(layers))}")
        return set(layers)
    between = {layer for layer in layers if by_layer.get(layer) == "blocks"}
    outlines = [chains[k] for k in closed]
    sides = sides_of_outlines(outlines)
    near = 1e-5 * float(np.ptp(np.concatenate(outlines), axis=0).max())
    at = (np.arange(8)[:, None] + 0.5) / 8.0
    for layer, members in layers.items():
        if layer in between:
            continue
        # The part of the points along the lines that lie within blocks, not on them.
        points = np.concatenate([s + at * (e - s) for k in members for s, e in pairwise(chains[k])])
        points = points[np.linspace(0, len(points) - 1, min(len(points), 400)).astype(int)]
        inside = inside_outlines(points, outlines) >= 0
        inside[points_near_segments(points, sides, near).point] = False
        if inside.mean() < THROUGH:
            continue
        if len(members) > len(closed):
            between.add(layer)
            notes.append(
                f"lines between blocks: layer '{layer}', whose lines run through closed curves"
                f" (else give --ignore {layer})"
            )
        else:
            notes.append(
                f"warning: lines on layer '{layer}' run through blocks; give --lines {layer} if"
                f" they are joints, --ignore {layer} if not"
            )
    return between
