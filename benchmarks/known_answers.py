"""Numbers and profiles of problems with known answers, as docs/verification.md shows them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fenics_contact import BlockMesh, Equilibrium

Array = npt.NDArray[np.float64]

#: Points with less of the largest pressure are open, and those this near to their bound slide: so
#: much the solver leaves where slips are small beside the displacements of the bodies.
NEARLY = 1e-3


@dataclass(frozen=True)
class Figure:
    """A number of a problem with a known answer.

    Attributes:
        name: What it is, with its unit.
        known: The answer.
        found: What the program says.
        allowed: Difference asked for: a part of the known answer, or, if `absolute`, in its unit.
        absolute: How `allowed` is meant.
    """

    name: str
    known: float
    found: float
    allowed: float
    absolute: bool = False

    @property
    def missed(self) -> float:
        """Difference, relative or absolute as `allowed` is."""
        return abs(self.found - self.known) / (1.0 if self.absolute else abs(self.known))

    @property
    def passed(self) -> bool:
        """Whether the difference is as small as asked for."""
        return self.missed <= self.allowed

    def row(self) -> str:
        """The figure as a row of a table."""
        shown = "{:.1e}" if self.absolute or self.allowed < 1e-3 else "{:.2%}"
        missed, allowed = shown.format(self.missed), shown.format(self.allowed)
        verdict = "" if self.passed else ", **missed**"
        cells = self.name, f"{self.known:.6g}", f"{self.found:.6g}", missed + verdict, allowed
        return f"| {' | '.join(cells)} |"


@dataclass(frozen=True)
class Profile:
    """Values along a joint.

    Attributes:
        x: Positions, m, ascending.
        length: Of joint that belongs to each point, m.
        values: By name.
    """

    x: Array
    length: Array
    values: Mapping[str, Array]

    @classmethod
    def of(cls, found: Equilibrium) -> Profile:
        """Pressure, shear and slip (Pa, m) of a state, shear and slip as motions to the right."""
        if found.status != "equilibrium":
            raise RuntimeError(f"{found.status}: {found.reason}")
        joints = found.layout.joints
        order = np.argsort(joints.position[:, 0])
        towards = np.sign(joints.tangent[:, 0])  # of the second side, which the first holds
        values = {
            "pressure": found.joints["pressure"],
            "shear": towards * found.joints["shear"],
            "slip": towards * found.joints["slip"],
            "bound": joints.friction * found.joints["pressure"],
        }
        ordered = {name: value[order] for name, value in values.items()}
        return cls(joints.position[order, 0], joints.length[order], ordered)

    @property
    def closed(self) -> npt.NDArray[np.bool_]:
        """Points with a pressure."""
        pressure = self.values["pressure"]
        return pressure > NEARLY * pressure.max()

    @property
    def sticks(self) -> npt.NDArray[np.bool_]:
        """Closed points whose shear is below its bound."""
        return self.closed & (np.abs(self.values["shear"]) < (1 - NEARLY) * self.values["bound"])

    def half_width(self, points: npt.NDArray[np.bool_]) -> float:
        """Mean distance of the outermost of some points from 0; of a half, that on the right, m."""
        first, last = self.x[points].min(), self.x[points].max()
        return float(0.5 * (last - first) if first < -0.5 * last else last)

    def l2_error(self, name: str, exact: Array) -> float:
        """L2 norm of the error of a value over that of the exact one."""
        missed = np.sum(self.length * (self.values[name] - exact) ** 2)
        return float(np.sqrt(missed / np.sum(self.length * exact**2)))


def mesh_of(model: Any) -> BlockMesh:
    """Distribute the current gmsh model over all ranks."""
    return BlockMesh.from_model(model, MPI.COMM_WORLD)
