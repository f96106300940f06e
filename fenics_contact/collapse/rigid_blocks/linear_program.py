"""Linear programs of forces in equilibrium, solved by HiGHS.

    min c.x   subject to   A x = b,   l <= x <= u.

Where HiGHS leaves open whether there is such an x, the least missing forces s, A x + s = b, tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.solvers.highs import solved
from fenics_contact.solvers.problem import Array


@dataclass(frozen=True)
class HighsOptions:
    """Numbers of HiGHS.

    Attributes:
        feasibility: Its primal and dual tolerance, forces in the program's unit.
        iterations: At most, for each row and column.
    """

    feasibility: float = 1e-10
    iterations: int = 50


OPTIONS = HighsOptions()


@dataclass(frozen=True)
class LinearProgram:
    """A linear program.

    Attributes:
        cost: c, shape (unknowns,).
        columns: A, sparse, shape (equations, unknowns).
        right: b, shape (equations,).
        limits: Ends of l <= x <= u by unknown, None where there is none.
    """

    cost: Array
    columns: Any
    right: Array
    limits: list[Any]

    @property
    def ends(self) -> Array:
        """Least and largest x, infinite where there is none, shape (2, unknowns)."""
        ends = [(-np.inf if a is None else a, np.inf if b is None else b) for a, b in self.limits]
        return np.array(ends).T

    def arguments(self, method: str, options: dict[str, Any] | None = None) -> tuple[Any, ...]:
        """Arguments of scipy's `linprog`."""
        names = "primal_feasibility_tolerance", "dual_feasibility_tolerance"
        # HiGHS may go round in circles.
        steps = OPTIONS.iterations * sum(self.columns.shape)
        options = dict.fromkeys(names, OPTIONS.feasibility) | {"maxiter": steps} | (options or {})
        equations = self.columns, self.right
        return self.cost, None, None, *equations, self.limits, method, None, options

    def answer(self, method: str, options: dict[str, Any] | None = None) -> Any:
        """HiGHS' answer with the least cost; its status is 0 where it has one."""
        return solved(*self.arguments(method, options))

    def dual_values(self, costs: Array, multipliers: Array, largest: float) -> Array:
        """Values b.y + min r.x, r = c - A^T y, that costs c of any x are not less than.

        The minimum is over all x within their limits, whatever HiGHS' tolerance.

        Args:
            costs: c, shape (costs, unknowns).
            multipliers: y, shape (costs, equations).
            largest: Size of unknowns without a limit, at most.
        """
        rest = costs - multipliers @ self.columns
        least, most = np.nan_to_num(self.ends, posinf=largest, neginf=-largest)
        values = multipliers @ self.right + np.minimum(rest * least, rest * most).sum(axis=1)
        return np.asarray(values)

    def with_missing_forces(self) -> LinearProgram:
        """The program with missing forces in both senses as more unknowns, their sum the cost."""
        from scipy.sparse import eye, hstack

        rows, unknowns = self.columns.shape
        missing = eye(rows, format="csr")
        cost = np.concatenate([np.zeros(unknowns), np.ones(2 * rows)])
        limits = [*self.limits, *[(0.0, None)] * (2 * rows)]
        return LinearProgram(cost, hstack([self.columns, missing, -missing]), self.right, limits)


def least_missing(program: LinearProgram) -> tuple[float, Array, Array]:
    """Least sum of forces missing to the equilibrium of a program, its multipliers, and unknowns.

    Raises:
        SolverError: If HiGHS finds no answer.
    """
    whole = program.with_missing_forces()
    unknowns = len(program.limits)
    for method in ("highs-ds", "highs-ipm"):
        answer = whole.answer(method)
        if answer.status == 0:
            return float(answer.fun), answer.eqlin.marginals, answer.x[:unknowns]
    raise SolverError(f"rigid-block linear program failed: {answer.message}")
