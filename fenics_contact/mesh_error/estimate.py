"""The discretisation error of a load factor: what it owes to the length of hinges, and the rest.

Hinges are followed to points (`hinges`). Joints that slide while they are closed over a length have
an error that is algebraic in h: that is the change of the load factor to the other degree of the
displacements (`other_degree`). The estimate has a hard limit on its cost, in units of that of the
collapse. Where a run is stopped, it is not known.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.errors import EffortError
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.mesh_error import hinges
from fenics_contact.mesh_error.hinges import Way, determinate, independent, to_point_hinges
from fenics_contact.mesh_error.nearby import Softened, on_mesh
from fenics_contact.mesh_error.other_degree import first_look_cost, with_other_degree
from fenics_contact.results.bounds import signed
from fenics_contact.results.joint_values import Contact, JointValues
from fenics_contact.results.mesh_error import MeshError, StateChange
from fenics_contact.results.result import Collapse

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class ErrorOptions:
    """Numbers of the estimate.

    Attributes:
        share: Largest cost of the estimate, in units of that of the collapse: what is done unasked.
        asked: The same where the scene asks for the estimate.
        usual_solve: Cost of the collapse, at least, in factorisations of the structure. Its
            steps on block modes take as long as factorisations do; under load control it is near.
        large: Changes of the load factor to the other degree above this are looked at closely.
        rough: Those below this are none, relative.
        error_of_degree: Error of the load factor of a degree, in units of the difference between
            degrees 1 and 2; measured. For degree 2 it is 0.3 mostly, and 1 where corners decide.
    """

    share: float = 0.6
    asked: float = 3.0
    usual_solve: float = 40.0
    large: float = 1e-3
    rough: float = 1e-5
    error_of_degree: tuple[float, float] = (1.15, 0.5)


OPTIONS = ErrorOptions()

#: Length of a hinge in units of its element side, by degree; measured.
OF_SIDE = {1: 1.0, 2: 0.2}


#: The estimate, the collapse at point hinges, and the estimate there; None where there is none.
Estimate = tuple[MeshError, Collapse | None, MeshError | None]


def estimated(case: LoadCase, end: Collapse) -> Estimate:
    """The estimate of the discretisation error of a limit load, and its collapse at point hinges.

    Raises:
        Stopped: If the run is to end.
    """
    tolerance = case.discretization.scene.solve.tolerance
    live = case.problem.live
    mode = end.mode
    if mode is not None and case.problem.dot(live, mode) < 0.0:  # the dead load does the work
        found = with_mesh_error(case.reversed(), signed(end, -1.0), tolerance)
        error, finer, at_hinges = (signed(one, -1.0) for one in found)
        return error, finer, at_hinges
    return with_mesh_error(case, end, tolerance)


def with_mesh_error(case: LoadCase, end: Collapse, tolerance: float) -> Estimate:
    """What the load factor of a collapse owes to the mesh, and the collapse with point hinges.

    Args:
        case: The load case.
        end: Its collapse, with status "limit".
        tolerance: On the load factor, relative.
    """
    if end.joints is None:
        return MeshError(math.nan, math.nan, math.nan), None, None
    effort = case.discretization.effort
    largest = _largest_cost(case, end)
    with effort.at_most(largest):
        error, finer, at_hinges = _estimated(case, end, end.joints, tolerance)
        if math.isnan(error.estimate):
            error = replace(error, unknown=_why(case, error, effort.left, largest))
    return error, finer, at_hinges


def _estimated(case: LoadCase, end: Collapse, values: JointValues, tolerance: float) -> Estimate:
    """As `with_mesh_error`, as far as the effort allows."""
    whole = case.discretization
    points = values.hinges(whole.joints.neighbours)
    way = Way((end,), (points,), ended=len(points) == 0 or determinate(case, end))
    way = to_point_hinges(case, way, max(tolerance, hinges.OPTIONS.unchanged))
    length = _length_on_mesh(whole, points, values.normal_force)
    error = replace(_hinge_error(way), hinge_length=length)
    if way.complete:
        error = _with_algebraic_error(case, way, error, max(tolerance, OPTIONS.rough))
    if not way.complete or len(way.states) == 1:
        return error, None, None
    finer = on_mesh(case, way.states[-1], Softened(way.points[-2], way.halvings[-1]))
    left = abs(way.rest) / way.states[0].size
    return error, finer, replace(error, hinge_length=0.0, hinge_error=left)


def _length_on_mesh(whole: Discretization, points: Indices, force: Array) -> float:
    """Length of the most loaded of some hinges on the mesh, m; nan without.

    With such a length it is as compliant as on elements with these sides.
    """
    if not len(points):
        return math.nan
    joints = whole.joints
    ends = joints.position[joints.segments]
    side = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    there = np.any(joints.segments == points[np.argmax(force[points])], axis=1)
    return float(OF_SIDE[whole.scene.degree] * side[there].min(initial=np.inf))


def _largest_cost(case: LoadCase, end: Collapse) -> float:
    """Cost of the estimate, at most, in factorisations of the structure."""
    options = case.discretization.scene.solve
    if options.accuracy is not None:
        return math.inf
    return (OPTIONS.asked if options.error else OPTIONS.share) * _solve_cost(end)


def _why(case: LoadCase, error: MeshError, left: float, largest: float) -> str:
    """Why an error is not known, and what to do, for people."""
    by_hinges = math.isnan(error.hinge_error)
    asked = case.discretization.scene.solve.error
    if left >= (1.0 if by_hinges else first_look_cost(case)):
        what = "shorter hinges" if by_hinges else "displacements of the other degree"
        more = "a finer mesh may tell" if asked else "solve.error = true looks farther"
        return f"no collapse state next to this one was found with {what}; {more}"
    more = "solve.accuracy sets none" if asked else "solve.error = true sets a higher one"
    return f"the estimate ended at its limit of {largest:.3g} factorisations; {more}"


def _solve_cost(end: Collapse) -> float:
    """Cost of a collapse, or what one costs from the bonded structure, in factorisations."""
    found = sum(step.factorizations for history in end.history for step in history.steps)
    return max(found, OPTIONS.usual_solve)


def _hinge_error(way: Way) -> MeshError:
    """The hinge part of the error; nan where the limit of point hinges is not known."""
    if not way.complete:
        return MeshError(math.nan, math.nan, math.nan, state_changes=way.changes)
    end = way.states[0]
    limit = way.states[-1].load_factor + way.rest
    jumps = sum(change.after - change.before for change in way.changes)
    error = abs(limit - end.load_factor - jumps) / end.size
    return MeshError(math.nan, limit, error, state_changes=way.changes)


def _with_algebraic_error(
    case: LoadCase, way: Way, error: MeshError, negligible: float
) -> MeshError:
    """With the error of joints that slide while they are closed over a length.

    It is not known where the other degree is too dear, or has no collapse state near by.
    """
    last, points, halvings = way.last
    size = way.states[0].size
    degree = case.discretization.scene.degree
    slides = last.joints is not None and np.delete(last.joints.contact == Contact.SLIP, points)
    known = len(way.states) > 1  # statics were asked of the last state on the way
    if not np.any(slides) or (way.independent if known else independent(case, last)):
        return replace(error, algebraic_error=0.0)
    try:
        other = with_other_degree(case, last, Softened(points, halvings), OPTIONS.large * size)
    except EffortError as reason:
        _log.info("  %s", reason)
        return error
    change = abs(other.load_factor - last.load_factor) / size
    if change <= negligible:
        return replace(error, algebraic_error=0.0)
    if other.another_state:
        jump = StateChange((halvings, halvings), last.load_factor, other.load_factor)
        return replace(error, state_changes=(*error.state_changes, jump))
    return replace(error, algebraic_error=OPTIONS.error_of_degree[degree - 1] * change)
