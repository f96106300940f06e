"""The discretisation error of a load factor: what it owes to the length of hinges, and the rest.

At collapse blocks turn about single nodes. The force there presses a node in by an amount that
grows like log(1/h). Where the load factor depends on how joint forces share the load, it changes
like 1 / log(1/h): comparing meshes shows little of it. So the nodes of hinges get the compliance
of m further halvings of the elements there (`hinge_nodes`). The state found on the given mesh is
followed to larger m; each state may have new hinges. In the limit of point hinges

    lambda(m) = lambda_0 + c / m,    m large.

Joints that slide while they are closed over a length have an error that is algebraic in h: that is
the change of the load factor to the other degree of the displacements (`other_degree`).
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.analysis.contact_lengths import ContactLengths
from fenics_contact.analysis.determinate import is_determinate
from fenics_contact.analysis.joint_values import Contact, JointValues
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.analysis.mesh_error import MeshError, StateChange
from fenics_contact.analysis.nearby import Softened, collapse_next_to, on_mesh, rates, same_mode
from fenics_contact.analysis.other_degree import with_other_degree
from fenics_contact.analysis.result import Collapse
from fenics_contact.analysis.strategy import COULOMB
from fenics_contact.discretization.joints import Joints
from fenics_contact.errors import SolverError
from fenics_contact.mesh import Indices

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class ErrorOptions:
    """Numbers of the estimate.

    Attributes:
        halvings: m, rising: with an incomplete set of hinges a large m leads to other states.
        unchanged: The load factor does not depend on hinges any more if it changes by less than
            this up to the next m, relative, or than the tolerance.
        dearest: The estimate ends before it takes more than so many times the factorisations of the
            collapse, each in proportion to its number of displacements.
        second_solve: Factorisations of the state with the other degree, about.
        rough: Changes of the load factor to the other degree below this are none, relative.
        displacements: Of the other degree, about, in units of those of degrees 1 and 2.
        error_of_degree: Error of the load factor of a degree, in units of the difference between
            degrees 1 and 2; measured.
        lengths: Solves at most for the lengths of hinges by the compressive strength.
        settled: They end where the load factor changes by less than this, relative.
    """

    halvings: tuple[float, ...] = (4.0, 30.0, 1000.0)
    unchanged: float = 1e-6
    dearest: float = 6.0
    second_solve: float = 10.0
    rough: float = 1e-5
    displacements: tuple[float, float] = (4.0, 0.25)
    error_of_degree: tuple[float, float] = (1.15, 0.15)
    lengths: int = 6
    settled: float = 1e-5


OPTIONS = ErrorOptions()


def with_mesh_error(case: LoadCase, end: Collapse, tolerance: float) -> Collapse:
    """A collapse with what its load factor owes to the mesh, and that with point hinges.

    Args:
        case: The load case.
        end: Its collapse, with status "limit".
        tolerance: On the load factor, relative.
    """
    if end.joints is None:
        return replace(end, mesh_error=MeshError(math.nan, math.nan, math.nan))
    whole = case.discretization
    joints, values = whole.joints, end.joints
    lengths = ContactLengths.of(whole)
    points = hinges(joints, values)
    length = lengths.of_mesh(points, values.normal_force)
    determinate = not case.problem.coulomb or is_determinate(joints, values, whole.bodies)
    if case.problem.comm.bcast(determinate):
        error = MeshError(length, end.load_factor, 0.0, 0.0)
        error = _with_lengths(case, _Way((end,), (points,), ()), error, lengths)
        return replace(end, mesh_error=error)
    before = whole.factorizations()
    way = _to_point_hinges(case, end, points, max(tolerance, OPTIONS.unchanged))
    if way is None:
        error = MeshError(length, math.nan, math.nan)
        error = _with_lengths(case, _Way((end,), (points,), ()), error, lengths)
        return replace(end, mesh_error=error)
    error = replace(_hinge_error(way, end), hinge_length=length)
    spent = whole.factorizations() - before
    error = _with_algebraic_error(case, way, error, max(tolerance, OPTIONS.rough), spent)
    error = _with_lengths(case, way, error, lengths)
    return replace(end, mesh_error=error, at_point_hinges=_at_point_hinges(case, way, error))


def hinges(joints: Joints, values: JointValues) -> Indices:
    """Closed joint points whose neighbours along the joint all open in the collapse mode."""
    opens = values.opens
    has_neighbour, alone = np.zeros(len(opens), dtype=bool), np.ones(len(opens), dtype=bool)
    for ends in (joints.neighbours, joints.neighbours[:, ::-1]):
        has_neighbour[ends[:, 0]] = True
        alone[ends[~opens[ends[:, 1]], 0]] = False
    return np.flatnonzero(has_neighbour & alone & (values.contact != Contact.OPEN))


@dataclass(frozen=True)
class _Way:
    """Collapse states on the way to point hinges.

    Attributes:
        states: That of the mesh first.
        points: Hinges found up to each of them.
        changes: Changes of state.
        halvings: m of each state.
    """

    states: tuple[Collapse, ...]
    points: tuple[Indices, ...]
    changes: tuple[StateChange, ...]
    halvings: tuple[float, ...] = (0.0,)

    def grown(self, new: Collapse, found: Indices, halvings: float, size: float) -> _Way:
        """With one more state."""
        last = self.states[-1]
        changes = self.changes
        if not _alike(last, new) or _turns_back(self.states, new, size):
            between = self.halvings[-1], halvings
            changes = (*changes, StateChange(between, last.load_factor, new.load_factor))
        points = np.union1d(self.points[-1], found)
        states = (*self.states, new)
        return _Way(states, (*self.points, points), changes, (*self.halvings, halvings))


def _size(end: Collapse) -> float:
    """Size by which errors are divided."""
    return abs(end.load_factor) if end.certificate is None else end.certificate.size


def _cost(end: Collapse) -> float:
    """Factorisations that a collapse took."""
    return sum(step.factorizations for history in end.history for step in history.steps)


def _to_point_hinges(
    case: LoadCase, end: Collapse, points: Indices, unchanged: float
) -> _Way | None:
    """States with more and more compliant hinges, as long as they change the load factor.

    None where one is not found, or where they take too long.
    """
    joints, count, size = case.discretization.joints, case.discretization.factorizations, _size(end)
    way, most = _Way((end,), (points,), ()), count() + OPTIONS.dearest * _cost(end)
    from_afar = COULOMB["auto"].attempts[:1]
    for halvings in OPTIONS.halvings if len(points) else ():
        if count() > most:
            _log.info("  hinges: given up at %g halvings, too dear", halvings)
            return None
        soft = Softened(way.points[-1], halvings)
        new = collapse_next_to(case, way.states[-1], soft, from_afar)
        _log.info("  hinges of %g halvings: load factor %.8g", halvings, new.load_factor)
        if new.status != "limit" or new.joints is None:
            _log.info("  hinges: no state after %g halvings", halvings)
            return None
        change = abs(new.load_factor - way.states[-1].load_factor)
        if change <= unchanged * size:
            break
        way = way.grown(new, hinges(joints, new.joints), halvings, size)
        # Where the state is lost a second time, there is little hope, at the price of a solve.
        from_afar = () if way.changes else from_afar
    return way


def _hinge_error(way: _Way, end: Collapse) -> MeshError:
    """The hinge part of the error."""
    limit, size = way.states[-1].load_factor, _size(end)
    if len(way.states) == 1:
        return MeshError(math.nan, end.load_factor, 0.0)
    before, last = way.halvings[-2:]
    at_the_end = last == OPTIONS.halvings[-1]
    if at_the_end and (not way.changes or way.changes[-1].halvings[1] < last):
        limit += (limit - way.states[-2].load_factor) * before / (last - before)
    jumps = sum(change.after - change.before for change in way.changes)
    error = abs(limit - end.load_factor - jumps) / size
    return MeshError(math.nan, limit, error, state_changes=way.changes)


def _with_algebraic_error(
    case: LoadCase, way: _Way, error: MeshError, negligible: float, spent: int
) -> MeshError:
    """With the error of joints that slide while they are closed over a length.

    Not so where that is too dear after as many factorisations as are `spent`.
    """
    last, points, halvings = way.states[-1], way.points[-1], way.halvings[-1]
    size, degree = _size(way.states[0]), case.discretization.scene.degree
    if last.joints is None:
        return error
    slides = last.joints.contact == Contact.SLIP
    slides[points] = False
    if not np.any(slides):
        return replace(error, algebraic_error=0.0)
    dear = OPTIONS.second_solve * OPTIONS.displacements[degree - 1]
    if spent + dear > OPTIONS.dearest * _cost(way.states[0]):
        _log.info("  other degree: too dear")
        return error
    try:
        other = with_other_degree(case, last, Softened(points, halvings))
    except SolverError as problem:
        _log.info("  other degree: %s", problem)
        return error
    _log.info("  degree %d: load factor %.8g", 3 - degree, other.load_factor)
    change = abs(other.load_factor - last.load_factor) / size
    if change <= negligible:
        return replace(error, algebraic_error=0.0)
    if not other.same_state:
        jump = StateChange((halvings, halvings), last.load_factor, other.load_factor)
        return replace(error, state_changes=(*error.state_changes, jump))
    return replace(error, algebraic_error=OPTIONS.error_of_degree[degree - 1] * change)


def _at_point_hinges(case: LoadCase, way: _Way, error: MeshError) -> Collapse | None:
    """The last state of the way, with the error that is left; None where hinges change nothing."""
    if len(way.states) == 1:
        return None
    found = on_mesh(case, way.states[-1], Softened(way.points[-2], way.halvings[-1]))
    left = abs(error.load_factor_point_hinges - found.load_factor) / _size(way.states[0])
    return replace(found, mesh_error=replace(error, hinge_length=0.0, hinge_error=left))


def _with_lengths(
    case: LoadCase, way: _Way, error: MeshError, lengths: ContactLengths
) -> MeshError:
    """With the load factor for hinges of the lengths that their compressive strength leaves."""
    end = way.states[0]
    if not lengths.given or end.joints is None:
        return error
    if math.isnan(error.load_factor_point_hinges):
        return replace(error, warnings=lengths.warnings(end.joints, way.points[0]))
    state, points = end, way.points[0]
    if len(way.states) > 1:
        state, points = _with_strength(case, way, lengths)
    values = state.joints or end.joints
    length = lengths.by_strength(points, values.normal_force)
    factor = state.load_factor
    warnings = lengths.warnings(values, points)
    return replace(error, contact_length=length, load_factor_hinges=factor, warnings=warnings)


def _with_strength(case: LoadCase, way: _Way, lengths: ContactLengths) -> tuple[Collapse, Indices]:
    """The collapse with lengths of hinges that its own forces give, and its hinges."""
    end, size = way.states[0], _size(way.states[0])
    if end.joints is None:
        return end, way.points[0]
    halvings = lengths.halvings(way.points[-1], end.joints.normal_force)
    # Start from the stiffest hinges that are not stiffer than most of them.
    start = np.searchsorted(way.halvings, np.median(halvings), side="right") - 1
    state, points = way.states[start], way.points[start]
    for _ in range(OPTIONS.lengths):
        force = (state.joints or end.joints).normal_force
        soft = Softened(points, lengths.halvings(points, force))
        new = collapse_next_to(case, state, soft)
        _log.info("  hinges by strength: load factor %.8g", new.load_factor)
        if new.status != "limit" or new.joints is None:
            return replace(state, load_factor=math.nan), points
        settled = abs(new.load_factor - state.load_factor) <= OPTIONS.settled * size
        found = np.union1d(points, hinges(case.discretization.joints, new.joints))
        settled &= len(found) == len(points)
        state, points = new, found
        if settled:
            break
    return state, points


def _alike(one: Collapse, other: Collapse) -> bool:
    """Whether the joints of two collapse states move alike."""
    if one.joints is None or other.joints is None:
        return False
    return same_mode(rates(one.joints), rates(other.joints))


def _turns_back(found: tuple[Collapse, ...], new: Collapse, size: float) -> bool:
    """Whether the load factor, which one state changes one way, goes back further than it came."""
    if len(found) < 2:
        return False
    before, last = (one.load_factor for one in found[-2:])
    came, goes = last - before, new.load_factor - last
    return came * goes < 0.0 and abs(goes) > max(abs(came), OPTIONS.unchanged * size)
