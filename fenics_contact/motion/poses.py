"""Poses of rigid blocks that move far, and the loads that move with them.

A pose is the place c of a block's centroid and a rotation R from the block as drawn. A motion
(u, w) kept for unit time moves a block by the exponential of its twist (R.M. Murray, Z. Li, S.S.
Sastry, A mathematical introduction to robotic manipulation (1994), section 2.3):

    R -> exp(w) R,   c -> c + (I + (1 - cos a) / a^2 W + (a - sin a) / a^3 W^2) u,   a = |w|,

W the matrix of w x. Weights and forces keep their direction, their places move with the block: the
moment of forces F_i at places r_i is that of the tensor T = sum r_i F_i^T, turned by R.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.spatial.loads import Acting
from fenics_contact.spatial.structure import Structure
from fenics_contact.spatial.ties import Bar

#: Rotations below this, rad, move a centroid by their series.
SMALL = 1e-4


@dataclass(frozen=True)
class Poses:
    """Where blocks are; the last one is the ground beside all blocks, which stays.

    Attributes:
        centroid: m, shape (blocks + 1, 3).
        rotation: From the blocks as drawn, shape (blocks + 1, 3, 3).
    """

    centroid: Array
    rotation: Array

    @classmethod
    def drawn(cls, structure: Structure) -> Poses:
        """Blocks as drawn."""
        centroid = np.array([*(block.centroid for block in structure.blocks), np.zeros(3)])
        return cls(centroid, np.tile(np.eye(3), (len(centroid), 1, 1)))

    def placed(self, block: Indices, arms: Array) -> Array:
        """Places fixed to blocks, m, from their arms about centroids as drawn, shape (., 3)."""
        turned = np.einsum("nij,nj->ni", self.rotation[block], arms)
        return np.asarray(self.centroid[block] + turned)

    def local(self, block: Indices, places: Array) -> Array:
        """The reverse of `placed`: arms of present places, as drawn."""
        arms = places - self.centroid[block]
        return np.asarray(np.einsum("nji,nj->ni", self.rotation[block], arms))

    def moved(self, motions: Array) -> Poses:
        """Poses after motions, m and rad, shape (blocks + 1, 6)."""
        from scipy.spatial.transform import Rotation

        shift, turn = motions.reshape(-1, 2, 3).transpose(1, 0, 2)
        angle = np.linalg.norm(turn, axis=1)
        first = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
        safe = np.maximum(angle, SMALL)
        second = np.where(angle < SMALL, 1.0 / 6.0, (1.0 - np.sinc(safe / np.pi)) / safe**2)
        across = np.cross(turn, shift)
        shift = shift + first[:, None] * across + second[:, None] * np.cross(turn, across)
        turned = Rotation.from_rotvec(turn).as_matrix() @ self.rotation
        return Poses(self.centroid + shift, turned)


@dataclass(frozen=True)
class MovedLoad:
    """Forces that keep their direction, at places that move with blocks.

    Attributes:
        force: Their sums, N, shape (blocks + 1, 3).
        moment: T = sum r F^T about the centroids as drawn, N m, shape (blocks + 1, 3, 3).
    """

    force: Array
    moment: Array

    @classmethod
    def of(cls, structure: Structure, acting: Iterable[Acting], sign: float = 1.0) -> MovedLoad:
        """The load of some forces at places, or the reverse of it."""
        centroid = Poses.drawn(structure).centroid
        force = np.zeros((len(centroid), 3))
        moment = np.zeros((len(centroid), 3, 3))
        for one in acting:
            arm = one.place - centroid[one.block]
            np.add.at(force, one.block, sign * one.force)
            np.add.at(moment, one.block, sign * arm[:, :, None] * one.force[:, None, :])
        return cls(force, moment)

    def at(self, poses: Poses) -> Array:
        """Forces and moments about the centroids, N and N m, shape (blocks + 1, 6)."""
        turned = poses.rotation @ self.moment
        about = [turned[:, j, k] - turned[:, k, j] for j, k in ((1, 2), (2, 0), (0, 1))]
        return np.column_stack([self.force, *about])

    def work(self, start: Poses, end: Poses) -> float:
        """Between two poses, J."""
        turn = end.rotation - start.rotation
        shifted = np.vdot(self.force, end.centroid - start.centroid)
        return float(shifted + np.einsum("nij,nji->", turn, self.moment))


def loads_of(structure: Structure, sign: float = 1.0) -> tuple[MovedLoad, MovedLoad]:
    """The dead load, and the live load or the reverse of it, from all forces of a structure."""
    every = structure.acting.items()
    live = [acting for key, acting in every if key.startswith("loads.live")]
    dead = [acting for key, acting in every if not key.startswith("loads.live")]
    return MovedLoad.of(structure, dead), MovedLoad.of(structure, live, sign)


class TurningTies:
    """Bars whose lines turn with their ends.

    Those with a stiffness have the tension prestress + k e, from 0 to the yield, e their present
    elongation less what has yielded. Those without stretch at their yield alone, and have no force
    where they are shorter than they were.
    """

    def __init__(self, bars: tuple[Bar, ...], start: Poses) -> None:
        self.block = np.array([bar.blocks for bar in bars], dtype=int).reshape(-1, 2)
        ends = np.array([bar.ends for bar in bars]).reshape(-1, 2, 3)
        self._start = start
        self._arm = ends - start.centroid[self.block]
        self.drawn = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        self.stiffness = np.array([bar.tie.stiffness or 0.0 for bar in bars])
        self._prestress = np.array([bar.tie.prestress for bar in bars])
        self.yields = np.array([bar.tie.yield_ for bar in bars])
        self.elastic = self.stiffness > 0.0

    def lines(self, poses: Poses) -> tuple[Array, Array, Array]:
        """Places of both ends, m, shape (ties, 2, 3), unit vectors to the second, and lengths."""
        ends = np.stack([poses.placed(self.block[:, k], self._arm[:, k]) for k in (0, 1)], axis=1)
        line = ends[:, 1] - ends[:, 0]
        length = np.linalg.norm(line, axis=1)
        return ends, line / length[:, None], length

    def tension(self, poses: Poses, longest: Array) -> Array:
        """Of ties with a stiffness, N, by the largest lengths that they have had, m."""
        force = self._free(self.lines(poses)[2]) - self._beyond(longest)
        return np.where(self.elastic, np.clip(force, 0.0, self.yields), 0.0)

    def length(self, tension: Array, longest: Array) -> Array:
        """The reverse of `tension`, m."""
        stiffness = np.where(self.elastic, self.stiffness, np.inf)
        return self.drawn + (tension - self._prestress + self._beyond(longest)) / stiffness

    def stored(self, poses: Poses, longest: Array) -> float:
        """Work into ties with a stiffness since the start, J: T^2 / 2 k, and what yields by Y."""
        stiffness = np.where(self.elastic, self.stiffness, np.inf)
        now, then = (self.tension(*at) ** 2 for at in ((poses, longest), (self._start, self.drawn)))
        yielded = self.yields * (self._beyond(longest) - self._beyond(self.drawn))
        return float(((0.5 * (now - then) + yielded) / stiffness).sum())

    def _free(self, length: Array) -> Array:
        """Tension by a length as if nothing yields."""
        return np.asarray(self._prestress + self.stiffness * (length - self.drawn))

    def _beyond(self, longest: Array) -> Array:
        """What this is above the yield."""
        return np.maximum(self._free(longest) - self.yields, 0.0)
