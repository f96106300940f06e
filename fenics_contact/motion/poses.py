"""Poses of rigid blocks that move far, and the loads that move with them.

A pose is the place c of a block's centroid and a rotation R from the block as drawn. A motion
(u, w) kept for unit time moves a block by the exponential of its twist (R.M. Murray, Z. Li, S.S.
Sastry, A mathematical introduction to robotic manipulation (1994), section 2.3):

    R -> exp(w) R,   c -> c + (I + (1 - cos a) / a^2 W + (a - sin a) / a^3 W^2) u,   a = |w|,

W the matrix of w x. Weights and forces keep their direction, their places move with the block: the
moment of forces F_i at places r_i is that of the tensor T = sum r_i F_i^T, turned by R.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.spatial.loads import Acting, Bar
from fenics_contact.spatial.structure import Structure

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

    def turned(self, block: Indices, vectors: Array) -> Array:
        """Vectors fixed to blocks, as these are turned now, shape (., 3)."""
        return np.asarray(np.einsum("nij,nj->ni", self.rotation[block], vectors))

    def placed(self, block: Indices, arms: Array) -> Array:
        """Places fixed to blocks, m, from their arms about centroids as drawn."""
        return np.asarray(self.centroid[block] + self.turned(block, arms))

    def local(self, block: Indices, places: Array) -> Array:
        """The reverse of `placed`: arms of present places, as drawn."""
        return np.asarray(
            np.einsum("nji,nj->ni", self.rotation[block], places - self.centroid[block])
        )

    def moved(self, motions: Array) -> Poses:
        """Poses after motions, m and rad, shape (blocks, 6)."""
        from scipy.spatial.transform import Rotation

        shift, turn = np.vstack([motions, np.zeros(6)]).reshape(-1, 2, 3).transpose(1, 0, 2)
        angle = np.linalg.norm(turn, axis=1)
        safe = np.maximum(angle, SMALL)
        small = angle < SMALL
        first = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)
        second = np.where(small, 1.0 / 6.0, (safe - np.sin(safe)) / safe**3)
        across = np.cross(turn, shift)
        shift = shift + first[:, None] * across + second[:, None] * np.cross(turn, across)
        turned = Rotation.from_rotvec(turn).as_matrix() @ self.rotation
        return Poses(self.centroid + shift, turned)


@dataclass(frozen=True)
class MovedLoad:
    """Forces that keep their direction, at places that move with blocks.

    Attributes:
        force: Their sums, N, shape (blocks, 3).
        moment: T = sum r F^T about the centroids as drawn, N m, shape (blocks, 3, 3).
    """

    force: Array
    moment: Array

    @classmethod
    def of(cls, structure: Structure, acting: Iterable[Acting]) -> MovedLoad:
        """The load of some forces at places."""
        centroid = np.array([block.centroid for block in structure.blocks])
        force = np.zeros((len(centroid), 3))
        moment = np.zeros((len(centroid), 3, 3))
        for one in acting:
            arm = one.place - centroid[one.block]
            np.add.at(force, one.block, one.force)
            np.add.at(moment, one.block, arm[:, :, None] * one.force[:, None, :])
        return cls(force, moment)

    def at(self, poses: Poses) -> Array:
        """Forces and moments about the centroids, N and N m, shape (blocks, 6)."""
        turned = poses.rotation[:-1] @ self.moment
        about = [turned[:, j, k] - turned[:, k, j] for j, k in ((1, 2), (2, 0), (0, 1))]
        return np.column_stack([self.force, *about])

    def work(self, start: Poses, end: Poses) -> float:
        """Between two poses, J."""
        shift = end.centroid[:-1] - start.centroid[:-1]
        turn = end.rotation[:-1] - start.rotation[:-1]
        return float(np.vdot(self.force, shift) + np.einsum("nij,nji->", turn, self.moment))


def loads_of(structure: Structure, sign: float = 1.0) -> Mapping[str, MovedLoad]:
    """The dead load, and the live load or the reverse of it, from all forces of a structure."""
    parts: dict[str, list[Acting]] = {"dead": [], "live": []}
    for key, acting in structure.acting.items():
        parts["live" if key.startswith("loads.live") else "dead"].append(acting)
    found = {name: MovedLoad.of(structure, part) for name, part in parts.items()}
    live = found["live"]
    return found | {"live": MovedLoad(sign * live.force, sign * live.moment)}


class TurningTies:
    """Bars whose lines turn with their ends.

    Those with a stiffness have the tension prestress + k e, from 0 to the yield, e their present
    elongation: they are loads. Those without stretch at their yield alone: they are units of the
    programs, without force where they are shorter than they were.
    """

    def __init__(self, bars: tuple[Bar, ...], start: Poses) -> None:
        self.block = np.array([bar.blocks for bar in bars], dtype=int).reshape(-1, 2)
        ends = np.array([bar.ends for bar in bars]).reshape(-1, 2, 3)
        self.arm = np.stack([ends[:, k] - start.centroid[self.block[:, k]] for k in (0, 1)], axis=1)
        self.length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        self.stiffness = np.array([bar.tie.stiffness or 0.0 for bar in bars])
        self.prestress = np.array([bar.tie.prestress for bar in bars])
        self.yields = np.array([bar.tie.yield_ for bar in bars])

    @property
    def plastic(self) -> Indices:
        """Numbers of those without a stiffness."""
        return np.flatnonzero(self.stiffness == 0.0)

    def lines(self, poses: Poses) -> tuple[Array, Array, Array]:
        """Unit vectors from first to second ends, lengths, m, and arms, shape (ties, 2, 3)."""
        arms = np.stack([poses.turned(self.block[:, k], self.arm[:, k]) for k in (0, 1)], axis=1)
        places = poses.centroid[self.block] + arms
        line = places[:, 1] - places[:, 0]
        length = np.linalg.norm(line, axis=1)
        return line / length[:, None], length, arms

    def tension(self, length: Array) -> Array:
        """Of ties with a stiffness, N; of the others 0."""
        elastic = self.prestress + self.stiffness * (length - self.length)
        return np.where(self.stiffness > 0.0, np.clip(elastic, 0.0, self.yields), 0.0)

    def load(self, poses: Poses) -> Array:
        """Forces and moments of ties with a stiffness about centroids, shape (blocks, 6)."""
        line, length, arms = self.lines(poses)
        pull = self.tension(length)[:, None] * line
        found = np.zeros((len(poses.centroid), 6))
        for end, sign in ((0, 1.0), (1, -1.0)):
            force = np.hstack([sign * pull, np.cross(arms[:, end], sign * pull)])
            np.add.at(found, self.block[:, end], force)
        return found[:-1]

    def energy(self, poses: Poses) -> float:
        """What ties with a stiffness took up, J: the integral of tension over elongation."""
        _, length, _ = self.lines(poses)
        total = 0.0
        for k in np.flatnonzero(self.stiffness):
            taken = [self._taken(k, at) for at in (self.length[k], length[k])]
            total += taken[1] - taken[0]
        return total

    def _taken(self, k: int, length: float) -> float:
        """T^2 / 2 k up to the yield, and Y times what is stretched beyond."""
        force = self.prestress[k] + self.stiffness[k] * (length - self.length[k])
        up_to = np.clip(force, 0.0, self.yields[k])
        beyond = max(force - self.yields[k], 0.0)
        return float((0.5 * up_to**2 + self.yields[k] * beyond) / self.stiffness[k])
