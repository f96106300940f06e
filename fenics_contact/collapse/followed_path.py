"""The loading path of elastic blocks, followed by its length: block modes, then the structure.

The kernel of the face engine (`faces.follow`) takes every joint point for a unit with one pressing
force, and K for the stiffness S of the blocks' motions:

    K u = f_D + lambda f_L + B^T x,   B u - u_0 + C x = openings and slips by the law.

First it follows the path of the block modes from rest. From its end, whose forces and displacements
are near the structure's at the same work, Newton's method leads to the structure itself, and there
the products fall to nothing.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from fenics_contact.collapse.load_case import Task
from fenics_contact.collapse.strategy import Strategy, monolithic
from fenics_contact.errors import EffortError, SolverError
from fenics_contact.faces.follow import FacePath, Way, followed
from fenics_contact.faces.kernel import FaceIterate, Program, solve
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.system import Equations
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.interior_point import Solution
from fenics_contact.solvers.problem import ContactProblem, SparseMap, State

#: Phase of the record, as of the path: its points are those of block modes.
ON_THE_WAY = "block modes, rising work"
#: Products with which the structure is taken up, smaller ones first.
TAKEN_UP = (1e-3, 1e-2, 1e-1)


def points_model(problem: ContactProblem) -> FaceModel:
    """The joint points as units, and K, on every rank those of all. Collective."""
    from scipy.sparse import vstack

    law = problem.law.each(problem.whole)
    count = len(law.friction)
    order = np.arange(2 * count).reshape(2, count).T.ravel()
    motion = vstack([_whole(problem.normal), _whole(problem.tangential)]).tocsr()[order]
    stiffness = _whole(problem.stiffness)
    soft = SEARCH.slight / stiffness.diagonal().mean()  # closed joints keep their digits
    return FaceModel(
        motion,
        1,
        problem.whole(problem.dead),
        problem.whole(problem.live),
        law.strength,
        law.friction,
        law.dilatancy,
        soft + problem.whole(problem.compliance).T,
        np.zeros(count),
        offset=-law.origins.T,
        stiffness=stiffness,
    )


def _whole(part: SparseMap) -> Any:
    """All rows of a distributed matrix, on every rank. Collective."""
    from scipy.sparse import csr_matrix, vstack

    columns = part.matrix.getSize()[1]
    rows = part.comm.allgather(part.matrix.getValuesCSR())
    whole = [csr_matrix((v, j, i), (len(i) - 1, columns)) for i, j, v in rows]
    return vstack(whole).tocsr()


@monolithic
def along_its_length(task: Task) -> Solution:
    """State at the end of the path of block modes, taken up by the structure at its work."""
    case = task.case
    problem, whole = case.problem, case.discretization
    modes = whole.block_modes.changed(problem)

    def prolonged(at: FaceIterate) -> State:
        return modes.prolonged(modes.reduced.state(at.motion, at.load_factor, *at.force.T))

    effort = SEARCH.collapse_cost
    model = points_model(modes.reduced)
    path = followed(
        model, Equations(model), effort, whole.mode_tally.add, task.work, FacePath.iterate
    )
    for place in path.places:
        at = path.path.iterate(place)
        work = path.path.work(place)
        case.record.passed(ON_THE_WAY, at.load_factor, work, partial(prolonged, at))
    near = prolonged(path.iterate)
    start = replace(
        path.iterate,
        motion=problem.whole(near.displacement),
        force=np.column_stack([problem.whole(force) for force in near.forces]),
    )
    end = _taken_up(points_model(problem), start, task)
    displacements, points = (
        slice(*part.matrix.getOwnershipRange()) for part in (problem.stiffness, problem.normal)
    )
    state = problem.state(end.motion[displacements], end.load_factor, *end.force[points].T)
    return Solution(state, {}, 0)


def _taken_up(model: FaceModel, start: FaceIterate, task: Task) -> FaceIterate:
    """The state of a structure at the work of a state of its block modes.

    Raises:
        SolverError: If Newton's method does not lead there.
    """
    equations = Equations(model)
    count = task.case.discretization.tally.add
    for products in TAKEN_UP:
        with np.errstate(all="ignore"):
            path = FacePath(
                model, equations, Way(products, short=0.03), SEARCH.collapse_cost, count
            )
            try:
                at = path.beside(start)
            except EffortError:
                raise
            except SolverError as error:
                failed = error
                continue
            work = path.work(at)
            end = path.iterate(path.settled(at, SEARCH.face_gap, work))
            laws = model.strength, model.friction, model.dilatancy
            program = Program(model, equations, *laws, work, elastic=True)
            return _exact(program, end, path.iterate(at))
    raise SolverError(f"the structure is not taken up from block modes: {failed}")


def _exact(program: Program, end: FaceIterate, before: FaceIterate) -> FaceIterate:
    """The end of falling products; where it has too few digits, an exact state beside it.

    Points without force and opening take these digits. The interior point method has them, from
    there or from before the products fell, but may lead to another state.
    """
    best = end
    size = program.model.size(end.load_factor)
    for start in (end, before):
        if best.missing < 10.0 * SEARCH.digits:
            break
        found = solve(program, start)
        near = abs(found.load_factor - end.load_factor) < SEARCH.gap * size
        if near and found.missing < best.missing:
            best = found
    return best


#: The path by its length; more work is tried anew where a state has too large a gap.
FOLLOW = Strategy(
    (along_its_length,),
    options=replace(SEARCH, first_work=SEARCH.follow_works, work_of_many=0.0),
)
