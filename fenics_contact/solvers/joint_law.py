"""The law of joint points: all that the program knows of opening, slip and friction.

With opening w_N = B_N u, slip w_T = B_T u and forces r_N, r_T (`problem`), a point obeys

    y = w_N - D |w_T| >= 0,   r_N >= 0,   y r_N = 0,
    |r_T| <= F r_N + c,       slip against r_T where it is at its bound, none where it is not.

F is Coulomb's coefficient of friction, c a given strength (Tresca's bound, cohesion), and D <= F
the tangent of the dilatancy angle: a joint that slides rides up on its teeth. y is its *clearance*.
With slip split into z1 towards negative and z2 towards positive values,

    y = w_N - D (z1 + z2),   w_T = z2 - z1,   s1 = F r_N + c - r_T,   s2 = F r_N + c + r_T,
    y r_N = 0,   s1 z1 = 0,   s2 z2 = 0,   all six >= 0.

The forces do the work -(r_N w_N + r_T w_T) = g |w_T| on joints, g = (F - D) r_N + c. With g given,
these are the optimality conditions of a convex problem: associative friction with the coefficient D
beside a strength g (A. Drescher, E. Detournay, Geotechnique 43 (1993) 443). With D = F the law
itself is of this kind, its slip is normal to Coulomb's cone; with D = 0 it is Coulomb's.

A joint with a tensile strength t carries r_N >= -t, and |r_T| <= F r_N + c0 with F t <= c0: the
tension cut-off of Coulomb's cone (P.B. Lourenco, J.G. Rots, J. Eng. Mech. 123 (1997) 660). With
r_N' = r_N + t that is the law above, c = c0 - F t, under forces -t on the joint that belong to the
dead load: a bond is a prestress that opening takes up. Everywhere in the solvers r_N is r_N'.

A tie is a point that slides only: its row of B_N is zero, and it is *apart* by a distance that
nothing changes, so that r_N = 0. With the yield Y its tension is Y/2 - r_T, |r_T| <= Y/2, under
forces Y/2 along B_T^T that belong to the dead load (`discretization.ties`).

Solvers, linear programs and certificates ask this module and have no law of their own. `laws.c`
has the equations of states with products mu and of Newton's springs, compiled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace

import numpy as np
import numpy.typing as npt

from fenics_contact.solvers.compiled import CStructure, call, structure

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


def _none() -> Array:
    return np.zeros(0)


@dataclass(frozen=True)
class PointLaws:
    """Constants of the law at some points, or at some straight faces; arrays (points,).

    Attributes:
        friction: Coulomb's coefficient F; 0 where the law is another.
        strength: c, N per metre of thickness.
        dilatancy: D, tangent of the dilatancy angle, at most F; zero where left out.
        bond: t, N per metre of thickness; zero where left out.
        slip_origin: B_T u from which slip is measured, m; zero: the stress-free state.
        opening_origin: B_N u from which openings are measured, m; below zero for initial gaps.
        apart: Opening of ties, m; zero at joints.
    """

    friction: Array
    strength: Array
    dilatancy: Array = field(default_factory=_none)
    bond: Array = field(default_factory=_none)
    slip_origin: Array = field(default_factory=_none)
    opening_origin: Array = field(default_factory=_none)
    apart: Array = field(default_factory=_none)

    def __post_init__(self) -> None:
        for name in ("dilatancy", "bond", "slip_origin", "opening_origin", "apart"):
            if len(getattr(self, name)) != len(self.friction):
                object.__setattr__(self, name, np.zeros(len(self.friction)))

    def bonded(self, bond: Array) -> PointLaws:
        """Laws with a tensile strength t; their strength is that at r_N = 0."""
        least = np.maximum(self.strength - self.friction * bond, 0.0)  # rounding
        return replace(self, strength=least, bond=bond)

    def each(self, of: Callable[[Array], Array]) -> PointLaws:
        """Laws with a function of every array in its place: of some points, or of all ranks."""
        return PointLaws(*(of(getattr(self, item.name)) for item in fields(self)))

    def at(self, points: npt.NDArray[np.integer]) -> PointLaws:
        """Laws of some points."""
        return self.each(lambda values: values[points])

    def homogeneous(self) -> PointLaws:
        """Laws that hold for every multiple of a state: without strengths, gaps and origins."""
        none = np.zeros_like(self.strength)
        return PointLaws(self.friction, none, self.dilatancy, apart=self.apart)

    def frictionless(self) -> PointLaws:
        """Laws by which joints carry no shear; ties stay."""
        none = np.zeros_like(self.friction)
        return replace(self, friction=none, strength=self.pull, dilatancy=none)

    @property
    def origins(self) -> Array:
        """Openings and slips at which the joints are as drawn, m, shape (2, points)."""
        return np.array([self.opening_origin, self.slip_origin])

    @property
    def pull(self) -> Array:
        """Tension Y/2 of ties that belongs to the dead load, N per metre of thickness."""
        return np.where(self.apart > 0.0, self.strength, 0.0)

    # ---- bounds

    @property
    def frictional(self) -> Flags:
        """Points that transmit shear."""
        return (self.friction > 0.0) | (self.strength > 0.0)

    @property
    def dissipative(self) -> Array:
        """Coefficient F - D of the friction that takes up power, 0 where slip is associative."""
        return self.friction - self.dilatancy

    def bound(self, pressure: Array) -> Array:
        """Bound F r_N + c on the shear forces for given normal forces."""
        return self.friction * pressure + self.strength

    def distances(self, pressure: Array, shear: Array) -> Array:
        """Distances of r_N and r_T from their bounds, r_N, F r_N + c -+ r_T, shape (3, points)."""
        bound = self.bound(pressure)
        return np.stack([pressure, bound - shear, bound + shear])

    def given(self, pressure: Array) -> Array:
        """Bound g = (F - D) r_N + c beside associative friction, for given normal forces."""
        return self.dissipative * pressure + self.strength

    def with_given(self, bound: Array) -> PointLaws:
        """Laws with associative friction D and a given bound g: those of a convex problem."""
        return replace(self, friction=self.dilatancy, strength=bound)

    # ---- kinematics

    def clearance(self, opening: Array, slip: Array) -> Array:
        """Clearance y of openings and slips, or its rate of theirs, m."""
        return opening - self.dilatancy * np.abs(slip)

    def dilation(self, lower: Array, upper: Array) -> Array:
        """Opening D (z1 + z2) by slip, m."""
        return self.dilatancy * (lower + upper)

    # ---- residuals

    def missed(
        self, opening: Array, slip: Array, pressure: Array, shear: Array
    ) -> dict[str, Array]:
        """What states miss of the law by name: forces, displacements or their products."""
        clearance = self.clearance(opening, slip)
        bound = self.bound(np.maximum(pressure, 0.0))
        return {
            "tension": -pressure,
            "penetration": -clearance,
            "complementarity": np.abs(clearance * pressure),
            "friction": np.abs(shear) - bound,
            "slip_direction": np.abs(bound * np.abs(slip) + shear * slip),
        }

    def dissipation(self, pressure: Array, slip_rate: Array) -> Array:
        """Power g |w_T| that every point takes up at given normal forces."""
        return self.given(np.maximum(pressure, 0.0)) * np.abs(slip_rate)

    def compiled(self, force: float, frictional: Flags) -> CStructure:
        """The law for `laws.c`, with the typical force and the points that transmit shear."""
        return structure(
            "laws",
            count=len(frictional),
            force=force,
            friction=self.friction,
            strength=self.strength,
            dilatancy=self.dilatancy,
            carried=frictional.astype(float),
        )


@dataclass(frozen=True)
class Slacks:
    """Variables of the law, or their changes, at this rank's points.

    Attributes:
        y: Clearances, m.
        pressure: r_N, N per metre of thickness.
        shear: r_T, likewise.
        s1: Distance of the shear force from its upper bound.
        s2: Distance from its lower bound.
        z1: Slip towards negative values, m.
        z2: Slip towards positive values, m.
    """

    y: Array
    pressure: Array
    shear: Array
    s1: Array
    s2: Array
    z1: Array
    z2: Array

    @property
    def slip(self) -> Array:
        """Slip z2 - z1, m."""
        return self.z2 - self.z1

    @property
    def positive(self) -> Array:
        """The six quantities that stay positive, shape (6 points,)."""
        return np.concatenate([self.y, self.pressure, self.s1, self.s2, self.z1, self.z2])


class LinearLaws:
    """Laws linearised at some slacks: joints as springs that the blocks feel (`laws.c`).

        dr_N = -normal (dw_N + slope dw_T),
        dr_T = -tangential dw_T - coupling (dw_N + slope dw_T)

    Attributes:
        springs: Normal, tangential and coupling, N/m, slope, and give, m per N/m, shape
            (5, points).
    """

    def __init__(
        self, law: CStructure, at: Slacks, compliance: Array, largest: float, unit: float
    ) -> None:
        """Linearise.

        Args:
            law: The law, compiled.
            at: The slacks.
            compliance: Of the points themselves, m per N/m, shape (2, points).
            largest: Cap on springs, N/m.
            unit: Typical displacement over force: above it a side slides.
        """
        count = len(at.y)
        springs = np.empty((7, count))
        shares = np.empty((3, count))
        slacks = {name: getattr(at, name) for name in ("y", "pressure", "s1", "s2", "z1", "z2")}
        given = {"law": law, "unit": unit, "compliance": compliance, "k": springs}
        self._linear = structure("linear", **given, **slacks, shares=shares)
        call("linearize", self._linear, largest)
        self.springs = springs[:5]

    def forces(self, opening: Array, slip: Array, products: Array) -> Array:
        """Changes of r_N and r_T that a step asks for where nothing moves, shape (2, points).

        Args:
            opening: Residual y + D (z1 + z2) - w_N that it is to take away, m.
            slip: Residual z2 - z1 - w_T, m.
            products: Change of y r_N, s1 z1 and s2 z2, shape (3, points).
        """
        found = np.empty((2, len(opening)))
        call("asked_forces", self._linear, opening, slip, products, found)
        return found

    def changes(
        self, opening: Array, slip: Array, products: Array, moved: tuple[Array, Array]
    ) -> Slacks:
        """Changes of the slacks for openings and slips `moved` of the blocks; else as `forces`."""
        found = np.empty((7, len(opening)))
        call("changes", self._linear, opening, slip, products, *moved, found)
        return Slacks(*found)
