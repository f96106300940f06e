"""Rigid blocks that touch at faces, as arrays: what all programs of this folder are about.

The unknowns are the forces x of units. A unit has k pressing forces n_i >= 0 and a shear force t in
R^q. With N = sum n_i, the blocks' motions d and the relative motion H d of all units,

    H^T x + f_D + lambda f_L = 0                          equilibrium,
    |t| <= c + F N                                        Coulomb's friction,
    n_i - kappa N^2 >= 0                                  compressive strength.

In the plane a unit is a straight face: a pressing force at each end (k = 2) and one shear force
(q = 1). A face of length L and strength f_c carries |M| <= N (L - N / f_c) / 2 about its middle
(J. Heyman, The masonry arch (1982), section 2.4): n_i >= kappa N^2 with kappa = 1 / (2 L f_c).
In any number of dimensions a unit may be a point of a face: k = 1, q = dimension - 1.

Motions may strain the blocks: those of a mesh's nodes, or of a few shapes of every block. With
their stiffness S equilibrium is H^T x + f_D + lambda f_L - S d = 0.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fenics_contact.faces.cones import Array, Cone, Disc, Positive
from fenics_contact.geometry.mesh import Flags, Indices
from fenics_contact.search_options import SEARCH

#: Typical forces of a block are so many times its own load at most: as many others stand on it.
CARRIED = 100.0


class FurtherLaw(ABC):
    """A law of several units at once, which the kernel does not know, with its own programs."""

    @abstractmethod
    def state(self, model: FaceModel, state: Any, asked: float, check: Callable[[], None]) -> Any:
        """The state of least gap within this law, from one without it; None if none was found.

        Args:
            model: The units.
            state: A `faces.certificate.FaceState`, as the one that is found.
            asked: Largest gap, relative.
            check: Called between programs; may raise `Stopped`.
        """


@dataclass(frozen=True)
class FaceModel:
    """Units of contact between rigid blocks.

    Attributes:
        motion: H, sparse, shape (units * m, motions), m = k + q; opening is positive.
        pressing: k.
        dead: f_D, generalised forces of the blocks, shape (motions,).
        live: f_L.
        strength: c, shape (units,).
        friction: F.
        dilatancy: D <= F: slip s opens by D |s| at least.
        compliance: Of the units' springs in the elastic state, shape (units, m).
        kappa: 1 / (2 L f_c), where pressure has a limit; else 0.
        offset: Relative motions at which the springs have no force, their signs reversed, shape
            (units, m): of ground that has moved; None for 0.
        components: Of the vectors that generalised forces consist of: their lengths, which do not
            change with the axes, are the sizes of forces.
        weights: The part of f_D that is no force given to bonds and ties, shape (motions,): it says
            which load factors are small; None: all of f_D.
        block: Number of the block of every motion, shape (motions,); None: all are as of one.
        stiffness: S, sparse, shape (motions, motions); None: all motions are rigid.
        further: Law that the kernel leaves out; None: it knows all.
    """

    motion: Any
    pressing: int
    dead: Array
    live: Array
    strength: Array
    friction: Array
    dilatancy: Array
    compliance: Array
    kappa: Array
    offset: Array | None = None
    components: int = 1
    weights: Array | None = None
    block: Indices | None = None
    stiffness: Any = None
    further: FurtherLaw | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Units, and forces of each."""
        return self.compliance.shape[0], self.compliance.shape[1]

    @property
    def blocks(self) -> int:
        """How many blocks move; 0 where that is not known."""
        return 0 if self.block is None else int(self.block.max(initial=-1)) + 1

    @property
    def has_many_blocks(self) -> bool:
        """Whether there are so many motions that convex programs come first."""
        return len(self.dead) > SEARCH.many_motions

    @cached_property
    def transposed(self) -> Any:
        """H^T."""
        return self.motion.T.tocsr()

    @cached_property
    def force(self) -> float:
        """A typical force: the largest one of the dead load, or else of the live load."""
        return self._largest(self.dead) or self.load

    @cached_property
    def load(self) -> float:
        """The largest force of the live load."""
        return self._largest(self.live) or 1.0

    def _largest(self, load: Array) -> float:
        vectors = load.reshape(-1, self.components)
        return float(np.linalg.norm(vectors, axis=1).max(initial=0.0))

    @cached_property
    def sizes(self) -> Array:
        """Typical force of every motion's block, shape (motions,): `CARRIED` of its own at most."""
        load = self.dead if np.any(self.dead) else self.live
        vectors = np.linalg.norm(load.reshape(-1, self.components), axis=1)
        block = np.zeros(len(load), dtype=int) if self.block is None else self.block
        own = np.zeros(block.max(initial=0) + 1)
        np.maximum.at(own, block, np.repeat(vectors, self.components))
        return np.where(own > 0.0, np.minimum(CARRIED * own, self.force), self.force)[block]

    @cached_property
    def unit_sizes(self) -> Array:
        """Typical force of the units, shape (units, 1): the least of their blocks."""
        moves = self.motion.tocoo()
        used = moves.data != 0.0
        size = np.full((self.shape[0], 1), self.force)
        np.minimum.at(size[:, 0], moves.row[used] // self.shape[1], self.sizes[moves.col[used]])
        return size

    def size(self, load_factor: float) -> float:
        """That of a load factor, by which gaps are divided: 1 % of a typical one at least."""
        force = self.force if self.weights is None else self._largest(self.weights) or self.load
        return max(abs(load_factor), 1e-2 * force / self.load)

    @cached_property
    def tensile(self) -> Array:
        """Units whose pressing forces move nothing, as those of ties, shape (units,)."""
        rows = np.abs(self.motion).sum(axis=1).A1.reshape(self.shape)[:, : self.pressing]
        return np.asarray(rows.sum(axis=1) == 0.0)

    @cached_property
    def free_friction(self) -> Array:
        """F - D: the part of friction that is no dilatancy."""
        return self.friction - self.dilatancy

    @cached_property
    def cones(self) -> tuple[Cone, ...]:
        """Cones of the slacks: in one dimension of shear, |t| is two bounds."""
        pressed: tuple[Cone, ...] = (Positive(),)
        return pressed if self.shears == 1 else (*pressed, Disc())

    def of_units(self, kept: Flags) -> FaceModel:
        """The model with some of its units alone."""
        names = "strength", "friction", "dilatancy", "compliance", "kappa", "offset"
        every = ((name, getattr(self, name)) for name in names)
        values: dict[str, Any] = {k: v if v is None else v[kept] for k, v in every}
        return replace(self, motion=self.motion[np.repeat(kept, self.shape[1])], **values)

    @property
    def shears(self) -> int:
        """Q."""
        return self.shape[1] - self.pressing

    def normal(self, force: Array) -> Array:
        """N of every unit."""
        return np.asarray(force[:, : self.pressing].sum(axis=1))

    def own_strength(self, force: Array) -> Array:
        """C + (F - D) N: what friction of a state adds to slip without work of its own."""
        return self.strength + self.free_friction * np.maximum(self.normal(force), 0.0)

    def relative(self, motion: Array) -> Array:
        """H d, shape (units, m)."""
        return np.asarray((self.motion @ motion).reshape(self.shape))

    def missing(self, force: Array, load_factor: float) -> Array:
        """H^T x + f_D + lambda f_L, shape (motions,)."""
        return np.asarray(self.transposed @ force.ravel() + self.dead + load_factor * self.live)

    def slacks(self, force: Array, strength: Array, friction: Array) -> tuple[Array, ...]:
        """Slacks by cones, of given strengths and coefficients of friction."""
        count = self.pressing
        normal = self.normal(force)
        pressed = force[:, :count] - (self.kappa * normal**2)[:, None]
        bound = (strength + friction * normal)[:, None]
        shear = force[:, count:]
        if self.shears == 1:
            return (np.hstack([pressed, bound - shear, bound + shear]),)
        return pressed, np.hstack([bound, shear])

    def derivatives(self, force: Array, friction: Array) -> tuple[Array, ...]:
        """Derivatives of the slacks by the forces, by cones, shape (units, r, m)."""
        count = self.pressing
        units, size = self.shape
        pressed = np.zeros((units, count, size))
        pressed[:, :, :count] = np.eye(count)
        pressed[:, :, :count] -= (2.0 * self.kappa * self.normal(force))[:, None, None]
        bound = np.zeros((units, 1, size))
        bound[:, 0, :count] = friction[:, None]
        shear = np.zeros((units, self.shears, size))
        shear[:, :, count:] = np.eye(self.shears)
        if self.shears == 1:
            return (np.hstack([pressed, bound - shear, bound + shear]),)
        return pressed, np.hstack([bound, shear])

    def curvature(self, duals: tuple[Array, ...]) -> Array:
        """Second derivative of y . (n - kappa N^2), as a weight of (sum dn_i)^2, sign reversed."""
        return np.asarray(2.0 * self.kappa * duals[0][:, : self.pressing].sum(axis=1))

    def power(self, motion: Array) -> Power:
        """What a motion of the blocks dissipates."""
        relative = self.relative(motion)
        slip = np.linalg.norm(relative[:, self.pressing :], axis=1)
        opening = relative[:, : self.pressing] - (self.dilatancy * slip)[:, None]
        limited = self.kappa > 0.0
        closing = np.where(limited[:, None], 0.0, np.maximum(-opening, 0.0))
        closing[self.tensile] = 0.0
        pressed = pressing_power(opening[limited], self.kappa[limited])
        return Power(slip, float(pressed.sum()), closing, -float(self.dead @ motion))


@dataclass(frozen=True)
class Power:
    """Dissipation of a motion v of the blocks.

    Attributes:
        slip: |v_T| of every unit, shape (units,).
        pressed: Largest work of pressing forces within the strengths, summed.
        closing: By how much units of infinite strength close, shape (units, k): 0 in a mechanism.
        dead: -f_D . v.
    """

    slip: Array
    pressed: float
    closing: Array
    dead: float

    def bound(self, strength: Array) -> float:
        """Upper end for lambda f_L . v: no state with such strengths carries more."""
        return float(strength @ self.slip) + self.pressed + self.dead


def pressing_power(opening: Array, kappa: Array) -> Array:
    """Support function of a face at its strength: the largest -n . v with n_i >= kappa N^2.

    Args:
        opening: v at both ends, shape (faces, 2).
        kappa: 1 / (2 L f_c), shape (faces,).
    """
    if not len(kappa):
        return np.zeros(0)
    turning = np.abs(opening[:, 1] - opening[:, 0])
    both = opening.sum(axis=1)
    carried = 0.5 / kappa
    safe = np.maximum(2.0 * turning, 1e-300)
    part = np.where(turning > 0.0, np.clip((turning - both) / safe, 0.0, 1.0), both < 0.0)
    pressed = part * carried
    return np.asarray(0.5 * pressed * (turning - both) - 0.5 * turning * pressed**2 / carried)
