"""The strength of joints under pressure: which forces a straight face of a joint carries.

A face presses with 0 <= p <= f_c. The resultant N of the largest moment M about the middle of the
face is a block of pressure f_c at its end, a = N / f_c long. So it stays a / 2 inside that end,

    |M| <= m(N) = N (L - N / f_c) / 2                                        (one length L),

and the face turns about the other end of the block, m'(N) = L/2 - a. The set is convex and the
motion normal to it: crushing is associative (J. Heyman, The masonry arch (1982), section 2.4;
R.K. Livesley, Int. J. Numer. Meth. Eng. 12 (1978) 1853). Its tangent at a force N0,

    M <= m(N0) + (N - N0) m'(N0),

is the law of a face without crushing whose contact ends where the block does, under a couple: the
block of pressure less its force N0 at that place. A state with the tangents at its own forces is
one of the curved law (`crushed`); the linear programs collect tangents until none is missed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact.discretization.joints import Joints
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.scene.scene import Scene

#: Infinity times no length is no number at ties, which have no strength; it is left out.
_NO_STRENGTH: Any = np.errstate(invalid="ignore")


@dataclass(frozen=True)
class Crushing:
    """Strengths of straight faces, and where they are in contact; the same on all ranks.

    Attributes:
        face: Face of every joint point.
        place: Coordinate of every joint point along its face, from the face's middle, m.
        strength: f_c of every face, Pa; infinite where it has none.
        of_piece: Face of every piece of a face.
        ends: Coordinates of its ends, ascending, m, shape (pieces, 2).
    """

    face: Indices
    place: Array
    strength: Array
    of_piece: Indices
    ends: Array

    @classmethod
    def of(cls, joints: Joints, strength: Array, face: Indices) -> Crushing | None:
        """The strengths of joints by points, f_c in Pa; None where none is given.

        Points at which a joint is curved are faces of no length: they have none.
        """
        count = int(face.max(initial=-1)) + 1
        of_face = np.full(count, np.inf)
        np.minimum.at(of_face, face, strength)
        place = np.sum(joints.tangent * joints.position, axis=1)
        least = np.full(count, np.inf)
        most = np.full(count, -np.inf)
        np.minimum.at(least, face, place)
        np.maximum.at(most, face, place)
        of_face[least == most] = np.inf
        if not np.any(np.isfinite(of_face)):
            return None
        place = place - (0.5 * (least + most))[face]
        straight = joints.segments[face[joints.segments[:, 0]] == face[joints.segments[:, 1]]]
        ends = np.sort(place[straight], axis=1)
        return cls(face, place, of_face, face[straight[:, 0]], ends)

    @property
    def given(self) -> Flags:
        """Faces that have a strength."""
        return np.isfinite(self.strength)

    @property
    def length(self) -> Array:
        """Length of contact of every face, m."""
        count = len(self.strength)
        return np.bincount(self.of_piece, np.ptp(self.ends, axis=1), count).astype(float)

    @property
    def carried(self) -> Array:
        """Most N of every face, crushed as a whole, N/m; infinite without a strength."""
        return np.where(self.given, np.where(self.given, self.strength, 0.0) * self.length, np.inf)

    def resultants(self, force: Array) -> tuple[Array, Array]:
        """N and M of every face from normal forces at all joint points, N/m and N."""
        count = len(self.strength)
        moment = np.bincount(self.face, force * self.place, count).astype(float)
        return np.bincount(self.face, force, count).astype(float), moment

    def turns(self, opening: Array) -> Array:
        """By how much every face turns, from openings of its points: their linear regression."""
        count = len(self.strength)

        def mean(values: Array) -> Array:
            sums = np.bincount(self.face, values, count).astype(float)
            return np.asarray(sums / np.bincount(self.face, minlength=count))

        arm: Array = self.place - mean(self.place)[self.face]
        square = mean(arm**2)
        return np.divide(mean(arm * opening), square, out=np.zeros(count), where=square > 0.0)

    @_NO_STRENGTH
    def largest(self, force: Array, side: Array) -> tuple[Array, Array]:
        """Largest M under N, by faces, and where the face then turns.

        Args:
            force: N of every face, N/m.
            side: 1 where the block of pressure is at the end of the largest coordinate, -1 where
                it is at the other end and M is negative.

        Returns:
            m(N) of every face, N, infinite without a strength; coordinate of the inner end of the
            block, m.
        """
        ends = side[self.of_piece, None] * self.ends
        near = ends.max(axis=1)
        length = np.ptp(ends, axis=1)
        pressed = (np.maximum(force, 0.0) / self.strength)[self.of_piece]
        inside = np.clip(pressed - self._before(near, length), 0.0, length)
        count = len(self.strength)
        moment = np.bincount(self.of_piece, inside * (near - 0.5 * inside), count).astype(float)
        moment *= np.where(self.given, self.strength, 1.0)
        inner = np.full(count, -np.inf)  # without force: the end itself
        np.maximum.at(inner, self.of_piece, near)
        touched = inside > 0.0
        np.minimum.at(inner, self.of_piece[touched], (near - inside)[touched])
        return np.where(self.given, moment, np.inf), side * inner

    @_NO_STRENGTH
    def tangent(self, force: Array, side: Array) -> tuple[Array, Array]:
        """Couple c >= 0 and place x of the tangent at N, |M| <= c + N |x|, as `largest`.

        With the sign of the side: side M <= c + N side x. More force than a face carries is taken
        for what it carries.
        """
        carried = np.clip(force, 0.0, self.carried)
        most, place = self.largest(carried, side)
        return most - carried * side * place, place

    def _before(self, near: Array, length: Array) -> Array:
        """Length of contact between every piece and the end of its face."""
        order = np.lexsort((-near, self.of_piece))
        total = np.cumsum(length[order]) - length[order]
        first = np.searchsorted(self.of_piece[order], self.of_piece[order])
        before = np.empty(len(order))
        before[order] = total - total[first]
        return before

    @_NO_STRENGTH
    def excess(self, force: Array, moment: Array) -> tuple[Array, Array]:
        """By how much M, or N, of every face is beyond its strength, N, and the side of M.

        It is at most 0 where the resultant is as far inside the face as it has to be.
        """
        side = np.where(moment < 0.0, -1.0, 1.0)
        beyond = np.abs(moment) - self.largest(force, side)[0]
        beyond = np.maximum(beyond, (force - self.carried) * self.length)
        return np.where(self.given, beyond, -np.inf), side


@dataclass(frozen=True)
class CrushedEnds:
    """Ends at which faces crush, and the forces at which their strength has its tangents.

    Attributes:
        side: 1 for the end of the largest coordinate, -1 for the other one, 0 for none, by face.
        force: N0 of every face, N/m.
    """

    side: Array
    force: Array

    @classmethod
    def none(cls, crushing: Crushing) -> CrushedEnds:
        """No face crushes."""
        return cls(np.zeros(len(crushing.strength)), np.zeros(len(crushing.strength)))


@dataclass(frozen=True)
class CrushedPlace:
    """End of a joint that crushes.

    Attributes:
        position: m.
        group: Joint or foundation.
        length: Of the block of pressure, m.
        normal_force: N per metre of thickness.
    """

    position: tuple[float, float]
    group: str
    length: float
    normal_force: float


def strength_of(scene: Scene, joints: Joints) -> Array:
    """f_c at all joint points: of the joint, or else the lesser of both blocks', Pa."""
    material = [
        scene.material(groups).compressive_strength or np.inf for groups in scene.mesh.cell_sets
    ]
    of_body = np.full(scene.mesh.body_count + 1, np.inf)  # the last one is rigid ground
    np.minimum.at(of_body, scene.mesh.body, np.array(material)[scene.mesh.cell_groups])
    scene.comm.Allreduce(MPI.IN_PLACE, of_body, MPI.MIN)
    of_law = np.array([law.compressive_strength or np.nan for law in joints.laws])[joints.law]
    return np.where(np.isnan(of_law), of_body[joints.bodies].min(axis=1, initial=np.inf), of_law)
