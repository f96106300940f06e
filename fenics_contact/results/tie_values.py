"""Tensions and elongations of ties in a state and its collapse mode."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.ties import Ties
from fenics_contact.geometry.mesh import Array
from fenics_contact.results.joint_values import JointValues

#: Tensions this close to 0, or to the yield, are there; relative to the yield.
AT_END = 1e-6


class TieState(IntEnum):
    """What a tie does."""

    SLACK = 0
    ELASTIC = 1
    YIELDS = 2


@dataclass(frozen=True)
class TieValues:
    """Values of the bars of all ties, shape (bars,); alike on all ranks.

    Attributes:
        bars: The bars.
        force: Tension, N per metre of thickness.
        elongation: m, from the structure as drawn.
        elongation_rate: In the collapse mode.
    """

    bars: Ties
    force: Array
    elongation: Array
    elongation_rate: Array

    @property
    def state(self) -> npt.NDArray[np.int64]:
        """`TieState` of every bar."""
        part = self.force / self.bars.yields
        state = np.where(part > AT_END, TieState.ELASTIC, TieState.SLACK)
        return np.where(part < 1.0 - AT_END, state, TieState.YIELDS).astype(np.int64)


def tie_values(joints: Joints, values: JointValues) -> TieValues | None:
    """Values of ties from those of all points; None where there are no ties."""
    bars = joints.ties
    if bars is None:
        return None
    count = joints.joint_count
    shear = values.shear_force[count:]
    return TieValues(
        bars=bars,
        force=np.clip(bars.tensions(shear), 0.0, bars.yields),  # rounding
        elongation=bars.elongations(values.slip[count:], shear),
        elongation_rate=values.slip_rate[count:],
    )
