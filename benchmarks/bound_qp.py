"""PETSc's solvers on the bound-constrained programs of real joints.

    python3 benchmarks/bound_qp.py [WALL ...]

The first proximal step of a cold start on the walls W1 ... W4 with a shear strength of 2 kPa: the
normal program, the tangential one, and the one for both. `splitting` takes what is sure and fast
here: "vinewtonrsls", then "bnls", for the two subproblems, "bnls", then "bntr", for both.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from statistics import median

import numpy as np
from petsc4py import PETSc

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fenics_contact import JointLaw
from fenics_contact.solvers.bound_qp import SOLVERS, BoundQP, BoundQPOptions
from fenics_contact.solvers.delassus import JointOperator
from fenics_contact.limit_load import typical_sizes
from fenics_contact.solvers.splitting import FORCE_HOLD
from fenics_contact.discretization.discretization import Structure
from tests.regression.scenes import WALLS, wall_scene

#: rho in units of the mean diagonal of K, and work in units of that of the bonded structure.
RHO, RATIO, TOLERANCE = 1e-4, 30.0, 1e-9
PROGRAMS = {"normal": (True, False), "tangential": (False, True), "both": (True, True)}


def measure(wall: str) -> None:
    """Print the rows of one wall."""
    structure = Structure.build(wall_scene(wall, JointLaw("tresca", bound=2000.0)))
    bonded, problem = structure.bonded(), structure.problem
    scales = typical_sizes(problem, bonded)
    rho = RHO * structure.springs.mean_diagonal
    operator = JointOperator(problem, structure.operators, rho)
    near = bonded.live.copy()
    near.scale(RATIO * scales.load_factor)
    right, _ = operator.right(near, problem.live.dot(near))
    hold = operator.matrix.getDiagonal()
    hold.scale(FORCE_HOLD)
    operator.matrix.setDiagonal(hold, PETSc.InsertMode.ADD_VALUES)
    none = np.full_like(problem.strength, np.inf)
    start = operator.join(bonded.dead_pressure, 0.0 * problem.strength, 0.0)
    lower = operator.join(0.0 * problem.strength, -problem.strength, -np.inf)
    upper = operator.join(none, problem.strength, np.inf)
    for name, unknowns in PROGRAMS.items():
        rows = operator.block(*unknowns)
        fixed, rest = start.copy(), right.duplicate()
        part = fixed.getSubVector(rows)
        part.zeroEntries()
        fixed.restoreSubVector(rows, part)
        operator.matrix.mult(fixed, rest)
        rest.aypx(-1.0, right)
        parts = [v.getSubVector(rows).array_r.copy() for v in (rest, lower, upper, start)]
        program = BoundQP(operator.matrix.createSubMatrix(rows, rows))
        for solver in SOLVERS:
            options, seconds = BoundQPOptions(solver, TOLERANCE), []
            for _ in range(3):
                begin = time.perf_counter()
                answer = program.attempt(*parts, options=options)
                seconds.append(time.perf_counter() - begin)
            verdict = "ok" if answer.residual <= TOLERANCE else "failed"
            print(
                f"{wall:5}{name:12}{solver:14}{answer.iterations:6d}{1e3 * median(seconds):9.1f}"
                f"{answer.residual:10.1e}{answer.reason:5d}  {verdict}"
            )


if __name__ == "__main__":
    print(f"{'wall':5}{'program':12}{'solver':14}{'steps':>6}{'ms':>9}{'residual':>10} why")
    for chosen in sys.argv[1:] or WALLS:
        measure(chosen)
