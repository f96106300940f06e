"""Blocks, contacts, laws and loads as the arrays that the engine of `faces` solves for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.strained import StrainedModel
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.spatial.contacts import Contact
from fenics_contact.spatial.crushing import Crushing
from fenics_contact.spatial.loads import Acting
from fenics_contact.spatial.points import ends_of, points_of
from fenics_contact.spatial.polyhedra import TINY, Block
from fenics_contact.spatial.ties import Bar

#: Shear stiffness of a face, in parts of its normal stiffness.
SHEAR = 0.4
#: Motions of a block by dimension, of three displacements and three rotations: the plane is x-z.
FREE = {2: [0, 2, 4], 3: [0, 1, 2, 3, 4, 5]}
#: Their signs for people: rotations in the plane are counterclockwise.
SENSE = {2: [1.0, 1.0, -1.0], 3: [1.0] * 6}
#: Forces of a unit, by dimension, among those along the axes of its points, three of each; of bars.
OF_POINTS = {2: [0, 3, 1], 3: [0, 1, 2]}
OF_BARS = {2: [0, 0, 1], 3: [0, 1, 2]}


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


@dataclass(frozen=True, eq=False)
class Structure:
    """Rigid blocks with their contacts and loads, in space or in the plane x-z.

    Units of the engine are the points of contacts, with forces along their contact's axes, and then
    the bars, with a shear force along the bar. In the plane contacts are faces of two points, their
    ends, and a unit is a face: a pressing force at each end, and one shear force.

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
        doubts: Those of the warnings that say what is not understood: while there are some, nothing
            is proved to fall.
        acting: All forces by their keys: weights, tractions, forces and floors.
        dimension: 2 or 3.
        law_of: Law of a contact between two blocks by their numbers, also where they do not touch
            as drawn, None where it is off; None: those that touch as drawn have one.
        strained: Makes a model whose blocks strain of a rigid one and the sign of the live load;
            None: elastic states are those of rigid blocks on springs.
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
    doubts: tuple[str, ...] = ()
    acting: Mapping[str, Acting] = field(default_factory=dict)
    dimension: int = 3
    law_of: Callable[[int, int], ContactLaw | None] | None = None
    strained: Callable[[Structure], Callable[[FaceModel, float], StrainedModel]] | None = None

    @property
    def pressing(self) -> int:
        """Pressing forces of a unit."""
        return 4 - self.dimension

    def told(self, vectors: Array) -> Array:
        """Vectors, shape (., 3), with the components that people give: x and z in the plane."""
        return np.asarray(vectors[..., :: self.pressing] + 0.0)

    def told_motions(self, mode: Array) -> Array:
        """Motions of blocks, shape (blocks, 6); in the plane (blocks, 3), counterclockwise."""
        return np.asarray(mode[:, FREE[self.dimension]] * SENSE[self.dimension] + 0.0)

    @cached_property
    def rows(self) -> Indices:
        """Which motions along axes of points and bars, three of each, are of units, (units, 3)."""
        every = np.arange(3 * len(self.axes)).reshape(-1, 3)
        points, bars = np.split(every, [len(every) - len(self.bars)])
        points = points.reshape(-1, 3 * self.pressing)
        return np.vstack([points[:, OF_POINTS[self.dimension]], bars[:, OF_BARS[self.dimension]]])

    @cached_property
    def size(self) -> float:
        """Typical length of a block, m."""
        return float(np.mean([b.volume for b in self.blocks if not b.fixed])) ** (1.0 / 3.0)

    @cached_property
    def points(self) -> ContactPoints:
        """Points of all contacts."""
        quick = self.quick
        in_plane = self.dimension == 2
        every = [ends_of(c) if in_plane else points_of(c, quick) for c in self.contacts]
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

    @cached_property
    def areas(self) -> Array:
        """Of units, m2, shape (units,): 0 for bars."""
        area = self.points.area.reshape(-1, self.pressing).sum(axis=1)
        return np.append(area, np.zeros(len(self.bars)))

    @property
    def faces(self) -> int:
        """How many units are no bars."""
        return len(self.areas) - len(self.bars)

    @cached_property
    def yields(self) -> Array:
        """Tensions at which bars yield, N, shape (bars,)."""
        return np.array([bar.tie.yield_ for bar in self.bars])

    def of_units(self, name: str) -> Array:
        """A value of the laws by units, shape (units,): 0 for bars."""
        values = self.of_points(name)[:: self.pressing]
        return np.append(values, np.zeros(len(self.bars)))

    def of_points(self, name: str) -> Array:
        """A value of the laws by points, shape (points,)."""
        return np.array([getattr(law, name) for law in self.laws])[self.points.contact]

    def areas_of(self, key: str) -> list[float]:
        """Of the contacts with one law, m2."""
        pairs = zip(self.contacts, self.laws, strict=True)
        return [contact.area for contact, law in pairs if law.key == key]

    @cached_property
    def limited(self) -> Flags:
        """Which contacts have an area and a compressive strength, shape (contacts,)."""
        plane = [len(contact.corners) > 2 for contact in self.contacts]
        return np.asarray(np.isfinite([law.compressive_strength for law in self.laws]) & plane)

    @cached_property
    def pressed(self) -> Crushing | None:
        """The law of compressive strengths; None where no contact has one."""
        return Crushing.of(self) if np.any(self.limited) else None

    @cached_property
    def axes(self) -> Array:
        """Of points and bars, shape (., 3, 3): normal and tangents; the line of bars second."""
        along = np.zeros((len(self.bars), 3, 3))
        for k, bar in enumerate(self.bars):
            line = bar.ends[1] - bar.ends[0]
            along[k, 1] = line / np.linalg.norm(line)
        axes = np.array([contact.axes for contact in self.contacts])
        return np.concatenate([axes[self.points.contact], along])

    @cached_property
    def ends(self) -> list[tuple[float, Indices, Array]]:
        """Of points and bars, the first and the second: sign, blocks, arms from centroids, m."""
        pairs = np.array([(contact.first, contact.second) for contact in self.contacts])
        blocks = np.vstack([pairs[self.points.contact], *(bar.blocks for bar in self.bars)])
        centroid = np.array([*(block.centroid for block in self.blocks), np.zeros(3)])  # of GROUND
        places = [
            np.vstack([self.points.position, *(bar.ends[end] for bar in self.bars)])
            for end in (0, 1)
        ]
        arms = [place - centroid[block] for place, block in zip(places, blocks.T, strict=True)]
        return [(-1.0, blocks[:, 0], arms[0]), (1.0, blocks[:, 1], arms[1])]

    def relative_motion(self) -> Any:
        """H: motions of blocks, m and rad times `size`, to those of units along their axes.

        Sparse, shape (3 units, motions of moving blocks); opening is positive.
        """
        moves = 6 * np.flatnonzero(self.number >= 0)[:, None] + FREE[self.dimension]
        return self._motions[self.rows.ravel()][:, moves.ravel()]

    @cached_property
    def _motions(self) -> Any:
        """H of all blocks, those of the ground, too, along all axes of points and bars."""
        from scipy.sparse import csr_matrix

        count = len(self.blocks)
        shape = (3 * len(self.axes), 6 * (count + 1))  # the last block: GROUND
        row = np.arange(shape[0]).reshape(-1, 3, 1)
        found = csr_matrix(shape)
        for sign, block, arm in self.ends:
            turned = np.cross(arm[:, None] / self.size, self.axes)  # axis . (w x arm)
            local = sign * np.concatenate([self.axes, turned], axis=2)
            column = 6 * (block[:, None, None] % (count + 1)) + np.arange(6)
            places = [np.broadcast_to(index, local.shape).ravel() for index in (row, column)]
            found += csr_matrix((local.ravel(), places), shape)
        return found[:, : 6 * count]

    def generalised(self, load: Array) -> Array:
        """Forces that go with the motions, from a load of all blocks."""
        moving = load[self.number >= 0].copy()
        moving[:, 3:] /= self.size
        return moving[:, FREE[self.dimension]].ravel()

    def mode(self, motion: Array) -> Array:
        """Motions of all blocks, shape (blocks, 6), that go with generalised ones.

        Scaled to a largest velocity of a corner of 1.
        """
        mode = np.zeros((len(self.blocks), 6))
        free = FREE[self.dimension]
        moving = np.flatnonzero(self.number >= 0)
        mode[moving[:, None], free] = motion.reshape(-1, len(free))
        mode[:, 3:] /= self.size
        fastest = TINY
        for block, (*velocity, p, q, r) in zip(self.blocks, mode.tolist(), strict=True):
            for piece in block.pieces if not block.fixed else ():
                turned = np.cross([p, q, r], piece.corners - block.centroid)
                fastest = max(fastest, float(np.linalg.norm(velocity + turned, axis=1).max()))
        return mode / fastest

    @cached_property
    def given_force(self) -> Array:
        """The part of the units' forces that the engine counts to the dead load, N, (units, 3).

        Points that carry tension up to f_t A have N' = N + f_t A >= 0; a bar that yields at Y has
        the tension Y / 2 - t with |t| <= Y / 2.
        """
        given = np.zeros((len(self.areas), 3))
        tension = self.areas * self.of_units("tensile_strength") / self.pressing
        given[:, : self.pressing] = -tension[:, None]
        given[self.faces :, self.pressing] = -0.5 * self.yields
        return given

    @cached_property
    def shear_strength(self) -> Array:
        """What points carry without pressure, c A, N, shape (points,)."""
        return self.of_points("cohesion") * self.points.area

    def point_forces(self, force: Array) -> Array:
        """Forces of points along their contact's axes, N, shape (points, 3), from the engine's.

        In the plane the ends of a face share its shear force by what they bear at most.
        """
        whole = (force + self.given_force)[: self.faces]
        normal, shear = np.split(whole, [self.pressing], axis=1)
        bound = self.of_points("friction").reshape(normal.shape) * normal
        bound += self.shear_strength.reshape(normal.shape)
        share = np.maximum(bound, TINY)
        share /= share.sum(axis=1, keepdims=True)
        shear = (share[:, :, None] * shear[:, None]).reshape(-1, 3 - self.pressing)
        found = np.zeros((normal.size, 3))
        found[:, : 1 + shear.shape[1]] = np.column_stack([normal.ravel(), shear])
        return found

    def tensions(self, force: Array) -> Array:
        """Of the bars, N, shape (bars,), from the engine's forces."""
        return np.asarray(-(force + self.given_force)[self.faces :, self.pressing])

    def springs(self, softness: float = 1.0) -> tuple[Array, Array | None]:
        """Compliance of units over `young`, shape (units, 3), and offsets, see `FaceModel`.

        Args:
            softness: Of contacts, in parts of that of rigid blocks.
        """
        count = self.faces
        pressing = self.pressing
        area = self.areas[:count]
        middle = np.median(area[area > 0.0]) if area.any() else self.size**2  # edges are as stiff
        area = np.where(area > 0.0, np.maximum(area, 1e-6 * area.max()), middle)
        springs = [float(pressing)] * pressing + [1.0 / SHEAR] * (3 - pressing)
        compliance = np.outer(softness * self.size / area, springs)
        typical = np.median(compliance, axis=0)
        compliance = np.vstack([compliance, *(typical for _ in self.bars)])
        # Springs have no force as drawn, but the prestress of bars, before the ground moves.
        rest = self.given_force.copy()
        for k, bar in enumerate(self.bars, count):
            rest[k, pressing] += bar.tie.prestress
            stiffness = bar.tie.stiffness
            compliance[k, pressing] = self.young / stiffness if stiffness else typical[pressing]
        offset = compliance * rest
        if self.moved is not None:
            moved = self.young * self.moved * np.repeat([1.0, self.size], 3)
            offset += np.asarray(self._motions @ moved.ravel())[self.rows]
        return compliance, offset if np.any(offset) else None

    def face_model(self, sign: float = 1.0) -> FaceModel:
        """What the engine sees, with the live load or the reverse of it (sign -1)."""
        friction = self.of_units("friction")
        given = self.given_force[:, : self.pressing].sum(axis=1)
        strength = self.of_units("cohesion") * self.areas + friction * given
        strength[self.faces :] = 0.5 * self.yields
        compliance, offset = self.springs()
        motion = self.relative_motion()
        weights = self.generalised(self.dead)
        free = len(FREE[self.dimension])
        return FaceModel(
            motion=motion,
            pressing=self.pressing,
            dead=weights + np.asarray(motion.T @ self.given_force.ravel()),
            live=sign * self.generalised(self.live),
            strength=np.maximum(strength, 0.0),
            friction=friction,
            dilatancy=self.of_units("dilatancy"),
            compliance=compliance,
            kappa=self._kappa,
            offset=offset,
            components=3 if self.dimension == 3 else 1,
            weights=weights,
            block=np.repeat(np.arange(motion.shape[1] // free), free),
            further=None if np.any(self._kappa) else self.pressed,
        )

    def strained_model(self, rigid: FaceModel, sign: float = 1.0) -> StrainedModel | None:
        """A model of `face_model` with blocks that strain, in elastic states; None: they do not."""
        return None if self._strained is None else self._strained(rigid, sign)

    @cached_property
    def _strained(self) -> Callable[[FaceModel, float], StrainedModel] | None:
        return None if self.strained is None else self.strained(self)

    @cached_property
    def _kappa(self) -> Array:
        """1 / (2 L f_c) of faces in the plane, see `faces.model`; 0 in space, see `crushing`."""
        kappa = np.zeros(len(self.areas))
        if self.dimension == 2:
            strength = self.of_points("compressive_strength")[::2][self.limited]
            kappa[: self.faces][self.limited] = 0.5 / (
                self.areas[: self.faces][self.limited] * strength
            )
        return kappa
