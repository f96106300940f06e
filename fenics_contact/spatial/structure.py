"""Blocks, contacts, laws and loads as the arrays that the engine of `faces` solves for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from fenics_contact.faces.model import FaceModel
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.scene.scene import JointLaw
from fenics_contact.spatial.contacts import Contact
from fenics_contact.spatial.loads import GROUND, Bar
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

    @classmethod
    def of(cls, key: str, law: JointLaw, compressive_strength: float) -> ContactLaw:
        """That of a joint."""
        return cls(
            law.friction or 0.0,
            law.cohesion + (law.bound or 0.0),
            law.dilation,
            law.tensile_strength,
            compressive_strength,
            key,
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


@dataclass(frozen=True)
class Structure:
    """Rigid blocks in space with their contacts and loads.

    Units of the engine are the points of contacts, with forces along their contact's axes, and then
    the bars, with a shear force along the bar.

    Attributes:
        blocks: All blocks; those that are fixed are ground.
        contacts: Where they touch.
        laws: One for every contact.
        dead: Forces and moments about the centroids, N and N m, shape (blocks, 6).
        live: The same, to be multiplied by the load factor.
        quick: Whether contacts have forces at their corners alone.
        bars: Ties and anchors.
        moved: Motions of the ground with the dead load, m and rad about centroids, shape (blocks,
            6).
        young: Young's modulus of joints, Pa.
        warnings: Of its geometry.
    """

    blocks: tuple[Block, ...]
    contacts: tuple[Contact, ...]
    laws: tuple[ContactLaw, ...]
    dead: Array
    live: Array
    quick: bool = False
    bars: tuple[Bar, ...] = ()
    moved: Array | None = None
    young: float = 1.0
    warnings: tuple[str, ...] = ()

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
        """H: motions of blocks, m and rad times `size`, to those of units along their axes.

        Sparse, shape (3 units, 6 moving blocks); opening is positive.
        """
        return self._motions[:, np.flatnonzero(np.repeat(self.number >= 0, 6))]

    @cached_property
    def _motions(self) -> Any:
        """H of all blocks, those of the ground, too."""
        from scipy.sparse import csr_matrix

        contact = self.points.contact
        pairs = np.array([(contact.first, contact.second) for contact in self.contacts])[contact]
        blocks = np.vstack([pairs, *(bar.blocks for bar in self.bars)])
        axes = np.array([contact.axes for contact in self.contacts])[contact]
        along = np.zeros((len(self.bars), 3, 3))
        for k, bar in enumerate(self.bars):
            line = bar.tie.ends[1] - bar.tie.ends[0]
            along[k, 1] = line / np.linalg.norm(line)
        axes = np.concatenate([axes, along])
        centroids = np.array([block.centroid for block in self.blocks])
        values = []
        for end, sign in enumerate((-1.0, 1.0)):
            place = np.vstack([self.points.position, *(bar.tie.ends[end] for bar in self.bars)])
            arm = (place - centroids[blocks[:, end]]) / self.size
            turned = np.cross(arm[:, None, :], axes)  # axis . (w x arm) = w . (arm x axis)
            held = blocks[:, end, None, None] != GROUND
            values.append(sign * held * np.concatenate([axes, turned], axis=2))
        local = np.array(values)
        row = np.broadcast_to(np.arange(3 * len(axes)).reshape(-1, 3, 1), local.shape)
        column = np.broadcast_to(
            6 * np.maximum(blocks.T[:, :, None, None], 0) + np.arange(6), local.shape
        )
        shape = (3 * len(axes), 6 * len(self.blocks))
        return csr_matrix((local.ravel(), (row.ravel(), column.ravel())), shape)

    def generalised(self, load: Array) -> Array:
        """Forces that go with the motions, from a load of all blocks, shape (6 moving blocks,)."""
        moving = load[self.number >= 0].copy()
        moving[:, 3:] /= self.size
        return moving.ravel()

    @cached_property
    def given_force(self) -> Array:
        """The part of the units' forces that the engine counts to the dead load, N, (units, 3).

        Points that carry tension up to f_t A have N' = N + f_t A >= 0; a bar that yields at Y has
        the tension Y / 2 - t with |t| <= Y / 2.
        """
        points = self.points
        given = np.zeros((len(points.area) + len(self.bars), 3))
        given[: len(points.area), 0] = -points.area * self._of_points("tensile_strength")
        given[len(points.area) :, 1] = [-0.5 * bar.tie.yield_ for bar in self.bars]
        return given

    def _of_points(self, name: str) -> Array:
        """A value of the laws at all points."""
        return np.array([getattr(law, name) for law in self.laws])[self.points.contact]

    def point_forces(self, force: Array) -> Array:
        """Forces of points along their contact's axes, N, shape (points, 3), from the engine's."""
        return np.asarray((force + self.given_force)[: len(self.points.area)])

    def tensions(self, force: Array) -> Array:
        """Of the bars, N, shape (bars,), from the engine's forces."""
        return np.asarray(-(force + self.given_force)[len(self.points.area) :, 1])

    def face_model(self, sign: float = 1.0) -> FaceModel:
        """What the engine sees, with the live load or the reverse of it (sign -1)."""
        points = self.points
        count = len(points.area)
        none = np.zeros(len(self.bars))
        area = np.maximum(points.area, 1e-6 * points.area.max())
        compliance = np.outer(self.size / area, [1.0, 1.0 / SHEAR, 1.0 / SHEAR])
        typical = np.median(compliance, axis=0)
        compliance = np.vstack([compliance, *(typical for _ in self.bars)])
        friction = np.append(self._of_points("friction"), none)
        cohesion = self._of_points("cohesion") * points.area
        strength = np.append(cohesion, [0.5 * bar.tie.yield_ for bar in self.bars])
        strength += friction * self.given_force[:, 0]
        # Springs have no force as drawn, but the prestress of bars, before the ground moves.
        rest = self.given_force.copy()
        for k, bar in enumerate(self.bars, count):
            rest[k, 1] += bar.tie.prestress
            compliance[k, 1] = self.young / bar.tie.stiffness if bar.tie.stiffness else typical[1]
        offset = compliance * rest
        if self.moved is not None:
            motion = self.young * self.moved * np.repeat([1.0, self.size], 3)
            offset += np.asarray(self._motions @ motion.ravel()).reshape(offset.shape)
        motion = self.relative_motion()
        given = np.asarray(motion.T @ self.given_force.ravel())
        return FaceModel(
            motion=motion,
            pressing=1,
            dead=self.generalised(self.dead) + given,
            live=sign * self.generalised(self.live),
            strength=np.maximum(strength, 0.0),
            friction=friction,
            dilatancy=np.append(self._of_points("dilatancy"), none),
            compliance=compliance,
            kappa=np.zeros(len(compliance)),
            offset=offset if np.any(offset) else None,
            components=3,
        )
