"""Forces and motions of joint points and ties, in a state and its collapse mode."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.ties import Ties
from fenics_contact.geometry.mesh import Array
from fenics_contact.search_options import SEARCH


class Contact(IntEnum):
    """What a joint point does as the collapse begins."""

    OPEN = 0
    SLIP = 1
    STICK = 2


@dataclass(frozen=True)
class JointValues:
    """Values at all joint points, in the order of `Joints`, shape (points,); alike on all ranks.

    Attributes:
        normal_force: r_N, N per metre of thickness; below 0 where a bond is pulled.
        shear_force: r_T on the second side along the tangent, N per metre of thickness.
        pressure: r_N over the length of the point, Pa.
        shear: r_T over the length of the point, Pa.
        gap: Opening B_N u, m.
        slip: B_T u, m.
        opening_rate: Opening in the collapse mode.
        slip_rate: Slip in the collapse mode.
        clearance_rate: Opening in the collapse mode beyond that by slip, of joints that dilate.
        bond: Tensile force that is carried, N per metre of thickness.
    """

    normal_force: Array
    shear_force: Array
    pressure: Array
    shear: Array
    gap: Array
    slip: Array
    opening_rate: Array
    slip_rate: Array
    clearance_rate: Array
    bond: Array

    def first(self, count: int) -> JointValues:
        """Values at the first points: those of joints, before those of ties."""
        return JointValues(*(getattr(self, item.name)[:count] for item in fields(self)))

    @property
    def opens(self) -> npt.NDArray[np.bool_]:
        """Points that open in the collapse mode."""
        return self.clearance_rate > self._moving_rate

    @property
    def slips(self) -> npt.NDArray[np.bool_]:
        """Points that slip in the collapse mode, closed or not."""
        return np.abs(self.slip_rate) > self._moving_rate

    @property
    def contact(self) -> npt.NDArray[np.int64]:
        """`Contact` of every point."""
        contact = np.where(self.slips, Contact.SLIP, Contact.STICK)
        force = self.normal_force + self.bond
        loaded = force > SEARCH.no_force * force.max(initial=0.0)
        contact[~loaded | self.opens] = Contact.OPEN
        return contact

    def force(self, normal: Array, tangent: Array) -> Array:
        """Force on the second side in x and y, N per metre of thickness, shape (points, 2).

        `normal` and `tangent` are those of `Joints`.
        """
        return self.normal_force[:, None] * normal + self.shear_force[:, None] * tangent

    def hinges(self, neighbours: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Joint points that do not open in the collapse mode, while their neighbours all do.

        Points without force are among them: shorter hinges may press them. `neighbours` are pairs
        of points next to each other, `Joints.neighbours`.
        """
        opens = self.opens
        has_neighbour = np.zeros(len(opens), dtype=bool)
        alone = np.ones(len(opens), dtype=bool)
        for ends in (neighbours, neighbours[:, ::-1]):
            has_neighbour[ends[:, 0]] = True
            alone[ends[~opens[ends[:, 1]], 0]] = False
        return np.flatnonzero(has_neighbour & alone & ~opens)

    @property
    def _moving_rate(self) -> float:
        rates = np.abs([self.opening_rate, self.slip_rate])
        return SEARCH.moving * float(rates.max(initial=0.0))


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
