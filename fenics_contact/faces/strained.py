"""Blocks with a stiffness of their own, beside the same blocks rigid.

Units see the motions H d of blocks and nothing else. Where d are those of the nodes of meshes and S
their stiffness, equilibrium is H^T x + f_D + lambda f_L - S d = 0. Rigid motions R of the blocks
have S R = 0, and H R is the H of rigid blocks: forces in equilibrium with meshes are so with rigid
blocks, too. Elastic states are those of meshes; what certifies a collapse is rigid.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from fenics_contact.faces.cones import Array
from fenics_contact.faces.kernel import FaceIterate
from fenics_contact.faces.model import FaceModel


@dataclass(frozen=True, kw_only=True)
class StrainedModel(FaceModel):
    """The units of a model between blocks that strain; sizes of forces are those of whole blocks.

    Attributes:
        rigid: The same blocks, rigid.
        mean: Rigid motions as means of those of nodes, sparse, shape (rigid motions, motions).
    """

    rigid: FaceModel
    mean: Any

    @classmethod
    def of(cls, rigid: FaceModel, mean: Any, **changes: Any) -> StrainedModel:
        """The model of rigid blocks with what strains change: motions, stiffness, loads."""
        same = {one.name: getattr(rigid, one.name) for one in fields(FaceModel)}
        return cls(**(same | changes), rigid=rigid, mean=mean)

    @property
    def has_many_blocks(self) -> bool:
        """Of whole blocks."""
        return self.rigid.has_many_blocks

    @cached_property
    def force(self) -> float:
        """Of whole blocks."""
        return self.rigid.force

    @cached_property
    def load(self) -> float:
        """Of whole blocks."""
        return self.rigid.load

    @cached_property
    def sizes(self) -> Array:
        """Of whole blocks, for each of their motions."""
        own = np.zeros(self.rigid.blocks)
        own[self.rigid.block] = self.rigid.sizes
        return np.asarray(own[self.block])

    def size(self, load_factor: float) -> float:
        """Of whole blocks."""
        return self.rigid.size(load_factor)

    def as_rigid(self, state: FaceIterate) -> FaceIterate:
        """A state with the mean motions of blocks."""
        missing = self.rigid.missing(state.force, state.load_factor)
        most = max(1.0, abs(state.load_factor) * self.load / self.force)
        least = float((np.abs(missing) / self.rigid.sizes).max()) / most
        return replace(state, motion=self.mean @ state.motion, missing=least)
