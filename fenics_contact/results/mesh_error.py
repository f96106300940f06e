"""What a load factor owes to the mesh, as data."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from fenics_contact.results.bounds import LoadFactor, meet


@dataclass(frozen=True)
class StateChange:
    """Another collapse state that a finer mesh leads to.

    Attributes:
        halvings: Halvings of the elements at hinges before and after; equal ones: the other degree
            of the displacements leads to it.
        before: Load factor before.
        after: Load factor after.
    """

    halvings: tuple[float, float]
    before: LoadFactor
    after: LoadFactor


@dataclass(frozen=True)
class MeshError:
    """Estimate of the discretisation error of a load factor; nan: not known.

    Attributes:
        hinge_length: Length of the most loaded hinge on this mesh, m; nan without hinges.
        load_factor_point_hinges: Load factor in the limit of hinges of no length.
        hinge_error: Change of the load factor up to there, relative, without changes of state.
        algebraic_error: Error of joints that are closed over a length, relative.
        state_changes: Changes of state on the way to point hinges or to the other degree of the
            displacements: no part of the errors.
        unknown: Why an error is not known, and what to do, for people; empty where all are.
    """

    hinge_length: float
    load_factor_point_hinges: LoadFactor
    hinge_error: float
    algebraic_error: float = math.nan
    state_changes: tuple[StateChange, ...] = ()
    unknown: str = ""

    @property
    def estimate(self) -> float:
        """Sum of both errors, relative; nan if one is not known."""
        return self.hinge_error + self.algebraic_error

    def within(self, load_factor: float, size: float, ends: tuple[float, float]) -> MeshError:
        """Errors with a sum not above the distance to the farther end of the bracket.

        All collapse states are in the bracket, those of the finest mesh too. An unknown error of
        100 % and more stays unknown.

        Args:
            load_factor: On this mesh.
            size: Load factor by which errors are divided.
            ends: Of the bracket.
        """
        farthest = max(load_factor - ends[0], ends[1] - load_factor, 0.0) / size
        unknown = farthest if farthest < 1.0 else math.nan
        limit = self.load_factor_point_hinges
        hinge = self.hinge_error
        other = self.algebraic_error
        if math.isnan(limit) and meet(*ends):
            limit = load_factor
        inside = min(max(limit, ends[0]), ends[1])  # nan stays
        hinge = unknown if math.isnan(hinge) else max(hinge - abs(limit - inside) / size, 0.0)
        hinge = min(hinge, farthest)
        other = min(unknown if math.isnan(other) else other, farthest - hinge)
        return replace(
            self, hinge_error=hinge, algebraic_error=other, load_factor_point_hinges=inside
        )


@dataclass(frozen=True)
class Pass:
    """A load factor on the way to the accuracy wished; nan: not known.

    Attributes:
        direction: Of the live load, "positive" or "negative".
        displacements: Their number.
        degree: Their degree.
        hinges: Of the length of the "mesh", or almost "points".
        load_factor: lambda.
        hinge_error: See `MeshError`.
        algebraic_error: See `MeshError`; not less than the change from the mesh before,
            nor than a quarter of the error there.
        seconds: Wall time on this mesh.
    """

    direction: str
    displacements: int
    degree: int
    hinges: str
    load_factor: float
    hinge_error: float
    algebraic_error: float
    seconds: float

    @property
    def estimate(self) -> float:
        """Sum of both errors, relative; nan if one is not known."""
        return self.hinge_error + self.algebraic_error
