"""Structures of rigid blocks and their collapse, as files and words show them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_contact.errors import plain
from fenics_contact.geometry.mesh import Array
from fenics_contact.output.files import LONGEST_TITLE, title_of
from fenics_contact.results.block_view import CRUSHES, NOTHING, BlockView, Bodies, Contacts
from fenics_contact.results.result import Collapse
from fenics_contact.spatial.result import SpatialLimit, ties_of
from fenics_contact.spatial.structure import Structure


def view_of(structure: Structure, collapse: Collapse) -> BlockView:
    """What is seen of an answer to one direction."""
    mode = np.zeros((len(structure.blocks), 6)) if collapse.mode is None else collapse.mode
    bars = structure.bars
    view = BlockView(
        bodies=_bodies(structure),
        touching=_contacts(structure, collapse.force),
        live=collapse.sign * structure.live,
        motion=mode,
        tie_ends=np.array([bar.ends for bar in bars]).reshape(-1, 2, 3),
        tie_blocks=np.array([bar.blocks for bar in bars], dtype=np.int64).reshape(-1, 2),
        ties=ties_of(structure, collapse),
        marked=collapse.falling * (collapse.mode is None),  # a collapse shows what moves
        caption=title_of(collapse),
    )
    return view.scaled()


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
