"""Structures of rigid blocks and their collapse, as files and words show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_contact.errors import plain
from fenics_contact.geometry.mesh import Array
from fenics_contact.output.files import LONGEST_TITLE, title_of
from fenics_contact.results.block_view import (
    CRUSHES,
    LIVE,
    NOTHING,
    BlockView,
    Bodies,
    Contacts,
    Pushes,
)
from fenics_contact.results.result import Collapse
from fenics_contact.spatial.result import SpatialLimit, ties_of
from fenics_contact.spatial.structure import Structure


def view_of(structure: Structure, collapse: Collapse) -> BlockView:
    """What is seen of an answer to one direction."""
    mode = np.zeros((len(structure.blocks), 6)) if collapse.mode is None else collapse.mode
    bars = structure.bars
    sign = collapse.sign if collapse.given is None else np.sign(collapse.given)
    view = BlockView(
        bodies=_bodies(structure),
        touching=_contacts(structure, collapse.force),
        live=sign * structure.live,
        motion=mode,
        tie_ends=np.array([bar.ends for bar in bars]).reshape(-1, 2, 3),
        tie_blocks=np.array([bar.blocks for bar in bars], dtype=np.int64).reshape(-1, 2),
        ties=ties_of(structure, collapse),
        marked=collapse.falling * (collapse.mode is None),  # a collapse shows what moves
        caption=title_of(collapse),
        loads=_pushes(structure, sign),
    )
    return view.scaled()


def _pushes(structure: Structure, sign: float) -> dict[str, Pushes]:
    """Where its loads push, by what they are, and the resultant of the live body force."""
    parts: dict[str, list[Pushes]] = {}
    force = sign * structure.live[:, :3]
    least = 1e-6 * np.linalg.norm(force, axis=1).sum()
    for key, one in structure.acting.items():
        start, _, end = key.partition(".")
        if end in ("dead.body", "live.body") or (not sign and end.startswith("live")):
            continue
        pushes = Pushes(one.block, one.place, one.force)
        name = f"{end[:4]} forces" if start == "loads" else start
        if name == LIVE[1]:
            pushes = pushes._replace(force=sign * one.force)
            np.subtract.at(force, one.block, pushes.force)
        level = start == "floors" and np.any(one.force[:, :2])
        parts.setdefault("thrust of floors" if level else name, []).append(pushes)
    size, total = np.linalg.norm(force, axis=1), force.sum(axis=0)
    if np.linalg.norm(total) > least:
        centroid = np.array([block.centroid for block in structure.blocks])
        centre = size @ centroid / size.sum()
        parts[LIVE[0]] = [Pushes(np.array([-1]), centre[None], total[None])]
    return {
        name: Pushes(*(np.concatenate(columns) for columns in zip(*those, strict=True)))
        for name, those in parts.items()
    }


def _bodies(structure: Structure) -> Bodies:
    """Its blocks."""
    blocks = structure.blocks
    return Bodies(
        names=[block.name for block in blocks],
        groups=[block.group for block in blocks],
        fixed=structure.number < 0,
        centroid=np.array([block.centroid for block in blocks]),
        volume=np.array([0.0 if block.fixed else block.volume for block in blocks]),
        pieces=[piece for block in blocks for piece in block.pieces],
        of_piece=np.repeat(np.arange(len(blocks)), [len(block.pieces) for block in blocks]),
        dimension=structure.dimension,
    )


def _contacts(structure: Structure, force: Array | None) -> Contacts:
    """Its contacts, with forces of points along their axes, N, shape (points, 3)."""
    points = structure.points
    force = np.zeros((len(points.area), 3)) if force is None else force
    limited = structure.limited.copy()
    if structure.pressed is not None:
        limited[limited] = structure.pressed.at_strength(force[:, 0], CRUSHES, NOTHING)
    laws = structure.laws
    return Contacts(
        pairs=np.array([(one.first, one.second) for one in structure.contacts]),
        corners=[contact.corners for contact in structure.contacts],
        normal=np.array([contact.axes[0] for contact in structure.contacts]),
        position=points.position,
        area=points.area,
        of_point=points.contact,
        force=np.einsum("pa,pad->pd", force, structure.axes[: len(force)]),
        friction=np.array([law.friction for law in laws]),
        strength=np.bincount(points.contact, structure.shear_strength, len(laws)).astype(float),
        crushes=limited,
    )


def views_of(result: SpatialLimit) -> dict[str, BlockView]:
    """Views of all directions."""
    title = plain(getattr(result.scene, "title", "") or "", LONGEST_TITLE)
    views = {}
    for name, collapse in result.ends.items():
        view = view_of(result.structure, collapse)
        view = replace(view, title=title, suffix=result.suffix(name))
        for answer in collapse.told:
            view = answer.seen(view)
        views[name] = view
    return views
