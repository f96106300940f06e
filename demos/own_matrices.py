"""A contact problem of one's own, from matrices: two bodies with a spring, one of them pushed.

At the first work one body slides, at the second both do: 0.5 (100 + 60) N. With Coulomb friction
the method may stall and raise SolverError; nothing here is verified: look at `found.residuals`.
"""

from contextlib import ExitStack, closing

import numpy as np
from petsc4py import PETSc

from fenics_contact.solvers.effort import Effort, Tally
from fenics_contact.solvers.interior_point import Tolerances, solve_interior_point
from fenics_contact.solvers.joint_law import PointLaws
from fenics_contact.solvers.joint_stiffness import JointRows, JointStiffness
from fenics_contact.solvers.kkt import PerturbedKKT
from fenics_contact.solvers.problem import ContactProblem, Scales, SparseMap

# Bodies of 100 N and 60 N on the ground, a spring between them; unknowns x1, y1, x2, y2.
K = 1e6 * np.array([[1, 0, -1, 0], [0, 0, 0, 0], [-1, 0, 1, 0], [0, 0, 0, 0]])  # N/m
R = np.array([[0.5**0.5, 0, 0], [0, 1, 0], [0.5**0.5, 0, 0], [0, 0, 1]])  # K R = 0, R^T R = 1
B_N, B_T = np.eye(4)[[1, 3]], np.eye(4)[[0, 2]]

with ExitStack() as stack:

    def sparse(values: np.ndarray) -> SparseMap:
        """A matrix of PETSc, freed at the end."""
        matrix = PETSc.Mat().createAIJ(values.shape, nnz=values.shape[1])
        matrix.setValues(*(np.arange(n, dtype=PETSc.IntType) for n in values.shape), values)
        matrix.assemble()
        return stack.enter_context(closing(SparseMap(matrix)))

    problem = ContactProblem(
        stiffness=sparse(K),
        dead=np.array([0.0, -100.0, 0.0, -60.0]),
        live=np.array([1.0, 0.0, 0.0, 0.0]),  # pushes the first
        normal=sparse(B_N),
        tangential=sparse(B_T),
        law=PointLaws(friction=np.full(2, 0.5), strength=np.zeros(2)),
        rigid=sparse(R),
        compliance=np.zeros((2, 2)),
    )
    # The rows of B_N and B_T again, each on its own unknowns.
    rows = JointRows.single(
        dofs=np.array([[0, 1], [2, 3]]),
        normal=np.array([[0.0, 1.0], [0.0, 1.0]]),
        tangential=np.array([[1.0, 0.0], [1.0, 0.0]]),
    )
    springs = stack.enter_context(JointStiffness(problem.stiffness, [rows], Tally(1.0, Effort())))
    scales = Scales(displacement=1e-3, force=100.0, load_factor=100.0, elastic=1e-4)
    start = problem.state(np.zeros(4), 0.0, np.array([100.0, 60.0]), np.zeros(2))
    for work in (1e-5, 0.1):  # N m, of the live load
        conditions = PerturbedKKT.coulomb(problem, springs, scales, work)
        found = solve_interior_point(conditions, start, 1.0, Tolerances())
        print(f"load factor {found.state.load_factor:.6f}, shear {found.state.shear.round(4)} N")
