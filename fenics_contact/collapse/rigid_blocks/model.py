"""Rigid blocks with straight faces as arrays, and the linear programs that these make.

    E x + f_D + lambda f_L = 0,   l <= x <= u          (every body, in its free motions).

On a straight face between two bodies only the resultants matter: the normal forces at its two ends,
with their friction, and one shear force by given strengths are enough, whatever the mesh. So x are,
at both ends of every face, multiples of the edges (1, F) and (1, -F) of Coulomb's cone, one of them
where F = 0; then the shear forces that the strengths bound. Each side of a face carries them where
its nodes are: across a gap these are two lines, as far apart all along.

Programs are solved by HiGHS. Where it leaves open whether there is an x with A x = b, the least
missing forces s, A x + s = b, tell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.geometry.mesh import Indices
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.highs import solved
from fenics_contact.solvers.problem import Array


@dataclass(frozen=True)
class LinearProgram:
    """min c.x subject to A x = b, l <= x <= u.

    Attributes:
        cost: c, shape (unknowns,).
        columns: A, sparse, shape (equations, unknowns).
        right: b, shape (equations,).
        ends: l and u, infinite where there is none, shape (unknowns, 2).
    """

    cost: Array
    columns: Any
    right: Array
    ends: Array

    def arguments(self, method: str, options: dict[str, Any] | None = None) -> tuple[Any, ...]:
        """Arguments of scipy's `linprog`."""
        names = "primal_feasibility_tolerance", "dual_feasibility_tolerance"
        steps = SEARCH.program_iterations * sum(self.columns.shape)
        options = dict.fromkeys(names, SEARCH.feasibility) | {"maxiter": steps} | (options or {})
        equations = self.columns, self.right
        return self.cost, None, None, *equations, self.ends, method, None, options

    def answer(self, method: str, options: dict[str, Any] | None = None) -> Any:
        """HiGHS' answer with the least cost; its status is 0 where it has one."""
        return solved(*self.arguments(method, options))

    def least_missing(self) -> tuple[float, Array, Array]:
        """Least sum of forces missing to the equilibrium, its multipliers, and unknowns.

        Raises:
            SolverError: If HiGHS finds no answer.
        """
        from scipy.sparse import eye, hstack

        rows, unknowns = self.columns.shape
        missing = eye(rows, format="csr")
        cost = np.repeat([0.0, 1.0], [unknowns, 2 * rows])
        ends = np.vstack([self.ends, np.tile([0.0, np.inf], (2 * rows, 1))])
        whole = LinearProgram(cost, hstack([self.columns, missing, -missing]), self.right, ends)
        for method in ("highs-ds", "highs-ipm"):
            answer = whole.answer(method)
            if answer.status == 0:
                return float(answer.fun), answer.eqlin.marginals, answer.x[:unknowns]
        raise SolverError(f"rigid-block linear program failed: {answer.message}")


@dataclass(frozen=True)
class BlockModel:
    """Equilibrium of rigid blocks with some friction and strengths of their faces.

    Attributes:
        planar: Faces, joint points and blocks, with the loads.
        friction: F of every face, shape (faces,).
        strength: Bounds on the shear forces of the faces, N/m.
        forces: E, sparse.
    """

    planar: PlanarFaces
    friction: Array
    strength: Array
    forces: Any

    @classmethod
    def of(cls, planar: PlanarFaces, friction: Array, strength: Array) -> BlockModel:
        """The faces with laws of their own."""
        from scipy.sparse import diags, hstack

        motion = planar.model.transposed.tocsc()
        shear = motion[:, 2::3]
        normal = hstack([motion[:, 0::3], motion[:, 1::3]]).tocsc()
        sliding = hstack([shear, shear]) @ diags(np.tile(friction, 2))
        rough = np.flatnonzero(np.tile(friction, 2))
        columns = [normal + sliding, (normal - sliding).tocsc()[:, rough], shear]
        return cls(planar, friction, strength, hstack(columns).tocsr())

    @cached_property
    def unit(self) -> float:
        """Force that is 1 in the programs, N/m: the largest of the dead load."""
        bodies = self.planar.bodies
        force = float(np.abs(bodies.dead).max(initial=0.0))
        strength = float(self.planar.joints.shear_strength.max(initial=0.0))
        return force or strength or float(np.abs(bodies.live).max(initial=0.0)) or 1.0

    @cached_property
    def load(self) -> float:
        """Load factor that is 1 in the programs."""
        live = float(np.abs(self.planar.bodies.live).max(initial=0.0))
        return self.unit / live if live else 1.0

    @property
    def crushes(self) -> bool:
        """Whether some face has a compressive strength."""
        return bool(np.any(self.planar.model.crushing))

    @property
    def is_large(self) -> bool:
        """Whether a program takes longer than to start a process for it."""
        return bool(self.forces.shape[1] > SEARCH.large_program)

    @property
    def units(self) -> FaceModel:
        """The faces for the face engine, with these laws."""
        laws = {"strength": self.strength, "friction": self.friction}
        dilatancy = np.minimum(self.planar.model.dilatancy, self.friction)
        return replace(self.planar.model, **laws, dilatancy=dilatancy)

    @cached_property
    def _rough(self) -> Indices:
        """Ends of faces with friction, among the first ends of all and then the second ones."""
        return np.flatnonzero(np.tile(self.friction, 2))

    def ends(self, unit: float) -> Array:
        """Least and largest x, forces in a unit, shape (unknowns, 2).

        An infinite one leaves the strengths out. Then faces that crush carry nothing.
        """
        kappa = self.planar.model.crushing
        carried = np.full(len(kappa), np.inf)
        np.divide(0.5 / unit, kappa, out=carried, where=kappa > 0.0)
        both = np.tile(carried, 2)
        pressing = np.concatenate([both, both[self._rough]])
        bound = self.strength / unit
        least = np.concatenate([np.zeros(len(pressing)), -bound])
        return np.column_stack([least, np.concatenate([pressing, bound])])

    def at_ends(self, x: Array) -> tuple[Array, Array]:
        """Normal and shear forces at the first ends of all faces, then the second ones."""
        count = len(self.friction)
        forward, edges, bound = np.split(x, [2 * count, 2 * count + len(self._rough)])
        backward = np.bincount(self._rough, edges, 2 * count).astype(float)
        shear = np.tile(self.friction, 2) * (forward - backward)
        shear[:count] += bound
        return forward + backward, shear

    def point_forces(self, x: Array) -> Array:
        """Normal and shear forces at all joint points, shape (2, points), in the unit of x."""
        ends = self.planar.faces.ends.T.ravel()
        count = len(self.planar.joints.length)
        return np.stack([np.bincount(ends, force, count) for force in self.at_ends(x)])

    def pressing(self, weights: Array) -> Array:
        """Weighted sums of the faces' normal forces, as coefficients of x, by rows."""
        ends = np.hstack([weights, weights])
        return np.hstack([ends, ends[:, self._rough], np.zeros_like(weights)])

    def standing(self, load_factor: float) -> LinearProgram:
        """Any forces in equilibrium with the loads."""
        unit = max(self.unit, abs(load_factor) * self.unit / self.load)
        loads = self.planar.model.dead + load_factor * self.planar.model.live
        ends = self.ends(unit)
        return LinearProgram(np.zeros(len(ends)), self.forces, -loads / unit, ends)

    def largest(self) -> LinearProgram:
        """The largest load factor; unknowns are (lambda, x), in units of load and force."""
        from scipy.sparse import hstack

        live = self.planar.model.live * (self.load / self.unit)
        ends = np.vstack([[-np.inf, np.inf], self.ends(self.unit)])
        columns = hstack([live[:, None], self.forces]).tocsr()
        cost = -np.eye(1, len(ends)).ravel()
        return LinearProgram(cost, columns, -self.planar.model.dead / self.unit, ends)


def wedging_forces(model: BlockModel) -> Array | None:
    """Forces at all joint points, few and small, that balance the live load alone; or None.

    Shape (2, points): normal and shear, N/m for a load factor of 1.

    Raises:
        SolverError: If HiGHS finds no answer.
    """
    unit = model.unit / model.load
    ends = model.ends(np.inf)
    right = -model.planar.model.live / unit
    balance = LinearProgram(np.ones(len(ends)), model.forces, right, ends)
    missing, _, x = balance.least_missing()
    if missing > SEARCH.rounding:
        return None
    least = balance.answer("highs-ds")
    return model.point_forces(unit * (least.x if least.status == 0 else x))
