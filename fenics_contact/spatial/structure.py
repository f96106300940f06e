"""Blocks, contacts, laws and loads as the arrays that the engine of `faces` solves for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fenics_contact.faces.model import FaceModel
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.spatial.contacts import Contact
from fenics_contact.spatial.points import points_of
from fenics_contact.spatial.polyhedra import Block

#: Shear stiffness of a face, in parts of its normal stiffness.
SHEAR = 0.4


@dataclass(frozen=True)
class ContactLaw:
    """Law of a contact.

    Attributes:
        friction: F.
        cohesion: Pa.
        dilatancy: Tangent D of the angle of dilatancy; D <= F.
        tensile_strength: f_t, Pa; F f_t <= cohesion.
        compressive_strength: f_c, Pa.
        key: What messages call it.
    """

    friction: float
    cohesion: float = 0.0
    dilatancy: float = 0.0
    tensile_strength: float = 0.0
    compressive_strength: float = np.inf
    key: str = ""


@dataclass(frozen=True)
class Structure:
    """Rigid blocks in space with their contacts and loads.

    Attributes:
        blocks: All blocks; those that are fixed are ground.
        contacts: Where they touch.
        laws: One for every contact.
        dead: Forces and moments about the centroids, N and N m, shape (blocks, 6).
        live: The same, to be multiplied by the load factor.
        quick: Whether contacts have forces at their corners alone.
    """

    blocks: tuple[Block, ...]
    contacts: tuple[Contact, ...]
    laws: tuple[ContactLaw, ...]
    dead: Array
    live: Array
    quick: bool = False

    @cached_property
    def size(self) -> float:
        """Typical length of a block, m."""
        return float(np.mean([b.volume for b in self.blocks if not b.fixed])) ** (1.0 / 3.0)

    @cached_property
    def points(self) -> ContactPoints:
        """Points of all contacts."""
        every = [points_of(contact, self.quick) for contact in self.contacts]
        contact = np.repeat(np.arange(len(every)), [len(places) for places, _ in every])
        return ContactPoints(
            np.vstack([places for places, _ in every]),
            np.concatenate([areas for _, areas in every]),
            contact,
        )

    @cached_property
    def number(self) -> Indices:
        """Place of every block among those that move, -1 for ground."""
        moves = np.array([not block.fixed for block in self.blocks])
        return np.where(moves, np.cumsum(moves) - 1, -1)

    def relative_motion(self) -> Any:
        """H: motions of blocks, m and rad times `size`, to those of points along their axes.

        Sparse, shape (3 points, 6 moving blocks); opening is positive.
        """
        from scipy.sparse import csr_matrix

        points = self.points
        axes = np.array([contact.axes for contact in self.contacts])[points.contact]
        centroids = np.array([block.centroid for block in self.blocks])
        rows, columns, values = [], [], []
        count = len(points.position)
        for sign, name in ((-1.0, "first"), (1.0, "second")):
            numbers = np.array([getattr(contact, name) for contact in self.contacts])
            block = numbers[points.contact]
            arm = (points.position - centroids[block]) / self.size
            turned = np.cross(arm[:, None, :], axes)  # axis . (w x arm) = w . (arm x axis)
            moved = self.number[block] >= 0
            local = sign * np.concatenate([axes, turned], axis=2)[moved]
            row = 3 * np.flatnonzero(moved)[:, None, None] + np.arange(3)[:, None]
            column = 6 * self.number[block][moved][:, None, None] + np.arange(6)
            values.append(local.ravel())
            rows.append(np.broadcast_to(row, local.shape).ravel())
            columns.append(np.broadcast_to(column, local.shape).ravel())
        shape = (3 * count, 6 * int(self.number.max() + 1))
        entries = (np.concatenate(rows), np.concatenate(columns))
        return csr_matrix((np.concatenate(values), entries), shape)

    def generalised(self, load: Array) -> Array:
        """Forces that go with the motions, from a load of all blocks, shape (6 moving blocks,)."""
        moving = load[self.number >= 0].copy()
        moving[:, 3:] /= self.size
        return moving.ravel()

    def face_model(self, sign: float = 1.0) -> FaceModel:
        """What the engine sees, with the live load or the reverse of it (sign -1)."""
        points = self.points
        laws = [self.laws[k] for k in points.contact]
        area = np.maximum(points.area, 1e-6 * points.area.max())
        compliance = np.outer(self.size / area, [1.0, 1.0 / SHEAR, 1.0 / SHEAR])
        return FaceModel(
            motion=self.relative_motion(),
            pressing=1,
            dead=self.generalised(self.dead),
            live=sign * self.generalised(self.live),
            strength=np.array([law.cohesion for law in laws]) * points.area,
            friction=np.array([law.friction for law in laws]),
            dilatancy=np.array([law.dilatancy for law in laws]),
            compliance=compliance,
            kappa=np.zeros(len(area)),
        )


@dataclass(frozen=True)
class ContactPoints:
    """Points of contacts.

    Attributes:
        position: m, shape (points, 3).
        area: m2, shape (points,).
        contact: Number of the contact, shape (points,).
    """

    position: Array
    area: Array
    contact: Indices
