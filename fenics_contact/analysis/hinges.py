"""The discretisation error of a load factor: what it owes to the length of hinges, and the rest.

At collapse blocks turn about single nodes. The force there presses a node in by an amount that
grows like log(1/h). Where the load factor depends on how joint forces share the load, it changes
like 1 / log(1/h): comparing meshes shows little of it. So the nodes of hinges get the compliance
of m further halvings of the elements there (`hinge_nodes`). The state found on the given mesh is
followed to larger m; each state may have new hinges. The largest m stands for point hinges.

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
from fenics_contact.analysis.nearby import (
    Softened,
    Start,
    collapse_next_to,
    from_afar,
    near,
    on_mesh,
    rates,
    same_mode,
)
from fenics_contact.analysis.other_degree import with_other_degree
from fenics_contact.analysis.result import Collapse
from fenics_contact.discretization.joints import Joints
from fenics_contact.mesh import Flags, Indices

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class ErrorOptions:
    """Numbers of the estimate.

    Attributes:
        ways: Halvings m of hinges, and what looks for their state, in this order: fewer where none
            is near, as with an incomplete set of hinges a large m leads to other states.
        unchanged: The load factor does not depend on hinges any more if it changes by less than
            this up to the next m, relative, or than the tolerance.
        dearest: Nothing is begun that is expected to end after so many times the factorisations of
            the collapse, each in proportion to its cost.
        usual_solve: Factorisations of the collapse, at least: under load control it is near.
        near_solve: Those to a state near by, about; one from afar takes those of the collapse.
        other_cost: Of a factorisation for the other degree, in units of one for degree 1 and 2.
        rough: Changes of the load factor to the other degree below this are none, relative.
        error_of_degree: Error of the load factor of a degree, in units of the difference between
            degrees 1 and 2; measured.
        lengths: Solves at most for the lengths of hinges by the compressive strength.
        settled: They end where the load factor changes by less than this, relative.
    """

    ways: tuple[tuple[float, Start], ...] = (
        *((30.0, near), (4.0, near), (30.0, near), (30.0, from_afar), (4.0, from_afar)),
        *((30.0, near), (1e4, near), (1e4, from_afar), (1e4, near)),
    )
    unchanged: float = 1e-6
    dearest: float = 3.0
    usual_solve: float = 25.0
    near_solve: float = 12.0
    other_cost: tuple[float, float] = (3.0, 0.5)
    rough: float = 1e-5
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
    lengths = ContactLengths.of(whole)
    points = hinges(whole.joints, end.joints)
    before = whole.factorizations()
    way = _Way((end,), (points,), ended=len(points) == 0 or _determinate(case, end))
    way = _to_point_hinges(case, way, max(tolerance, OPTIONS.unchanged))
    length = lengths.of_mesh(points, end.joints.normal_force)
    error = replace(_hinge_error(way), hinge_length=length)
    if way.complete:
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
        halvings: m of each state.
        changes: Changes of state.
        ended: Whether shorter hinges change nothing any more.
    """

    states: tuple[Collapse, ...]
    points: tuple[Indices, ...]
    halvings: tuple[float, ...] = (0.0,)
    changes: tuple[StateChange, ...] = ()
    ended: bool = False

    @property
    def complete(self) -> bool:
        """Whether the limit of point hinges is known."""
        return self.ended or self.halvings[-1] == OPTIONS.ways[-1][0]

    @property
    def last(self) -> tuple[Collapse, Indices, float]:
        """Last state, hinges, m."""
        return self.states[-1], self.points[-1], self.halvings[-1]

    def leads_to(self, halvings: float) -> bool:
        """Whether the last state is of less halvings, or shows hinges that have none yet."""
        if halvings != self.halvings[-1]:
            return halvings > self.halvings[-1]
        return len(self.points[-1]) > len(self.points[-2])

    def grown(self, new: Collapse, found: Indices, halvings: float) -> _Way:
        """With one more state."""
        last, changes = self.states[-1], self.changes
        if not _alike(last, new) or _turns_back(self.states, new):
            between = self.halvings[-1], halvings
            changes = (*changes, StateChange(between, last.load_factor, new.load_factor))
        points = (*self.points, np.union1d(self.points[-1], found))
        return _Way((*self.states, new), points, (*self.halvings, halvings), changes)


def _solve_cost(end: Collapse) -> float:
    """Factorisations that a collapse took, or would have from the bonded structure."""
    found = sum(step.factorizations for history in end.history for step in history.steps)
    return max(found, OPTIONS.usual_solve)


def _determinate(case: LoadCase, end: Collapse, loaded: Flags | None = None) -> bool:
    """Whether statics alone give the load factor of a collapse, on all ranks alike."""
    whole = case.discretization
    found = not case.problem.coulomb or (
        end.joints is not None and is_determinate(whole.joints, end.joints, whole.bodies, loaded)
    )
    return bool(case.problem.comm.bcast(found))


def _independent(case: LoadCase, end: Collapse) -> bool:
    """Whether the load factor does not depend on the joint forces of a state, as long as it lasts.

    Points without force do not count here.
    """
    return end.joints is not None and _determinate(case, end, end.joints.contact != Contact.OPEN)


def _dearest(case: LoadCase) -> float:
    """`ErrorOptions.dearest`; there is no limit where an accuracy is wished."""
    return OPTIONS.dearest if case.discretization.scene.solve.accuracy is None else math.inf


def _to_point_hinges(case: LoadCase, way: _Way, unchanged: float) -> _Way:
    """States with more and more compliant hinges, as long as they change the load factor."""
    whole, cost = case.discretization, _solve_cost(way.states[0])
    most = whole.factorizations() + _dearest(case) * cost
    tried: set[tuple[float, Start, int]] = set()
    for halvings, start in OPTIONS.ways:
        task = halvings, start, len(way.states)
        if way.ended or task in tried or not way.leads_to(halvings):
            continue
        if whole.factorizations() + (cost if start is from_afar else OPTIONS.near_solve) > most:
            _log.info("  %g halvings: too dear", halvings)
            continue
        tried.add(task)
        last, points, _ = way.last
        new = collapse_next_to(case, last, Softened(points, halvings), start)
        if new.status != "limit" or new.joints is None:
            continue
        if abs(new.load_factor - last.load_factor) <= unchanged * way.states[0].size:
            return replace(way, ended=True)
        way = way.grown(new, hinges(whole.joints, new.joints), halvings)
        way = replace(way, ended=_independent(case, new))
    return way


def _hinge_error(way: _Way) -> MeshError:
    """The hinge part of the error; nan where the limit of point hinges is not known."""
    end, limit = way.states[0], way.states[-1].load_factor
    if not way.complete:
        return MeshError(math.nan, math.nan, math.nan, state_changes=way.changes)
    jumps = sum(change.after - change.before for change in way.changes)
    error = abs(limit - end.load_factor - jumps) / end.size
    return MeshError(math.nan, limit, error, state_changes=way.changes)


def _with_algebraic_error(
    case: LoadCase, way: _Way, error: MeshError, negligible: float, spent: int
) -> MeshError:
    """With the error of joints that slide while they are closed over a length.

    Not so where that is too dear after as many factorisations as are `spent`.
    """
    (last, points, halvings), first = way.last, way.states[0]
    degree = case.discretization.scene.degree
    slides = last.joints is not None and np.delete(last.joints.contact == Contact.SLIP, points)
    if not np.any(slides) or _independent(case, last):
        return replace(error, algebraic_error=0.0)
    expected = OPTIONS.near_solve * OPTIONS.other_cost[degree - 1]
    if spent + expected > _dearest(case) * _solve_cost(first):
        _log.info("  other degree: too dear")
        return error
    other, same = with_other_degree(case, last, Softened(points, halvings), near)
    change = abs(other.load_factor - last.load_factor) / first.size
    if change <= negligible:
        return replace(error, algebraic_error=0.0)
    if not same:
        jump = StateChange((halvings, halvings), last.load_factor, other.load_factor)
        return replace(error, state_changes=(*error.state_changes, jump))
    return replace(error, algebraic_error=OPTIONS.error_of_degree[degree - 1] * change)


def _at_point_hinges(case: LoadCase, way: _Way, error: MeshError) -> Collapse | None:
    """The last state of the way, with what is left of c / m; None where hinges change nothing."""
    if not way.complete or len(way.states) == 1:
        return None
    found = on_mesh(case, way.states[-1], Softened(way.points[-2], way.halvings[-1]))
    change = abs(found.load_factor - way.states[-2].load_factor) / way.states[0].size
    left = change * way.halvings[-2] / way.halvings[-1]
    return replace(found, mesh_error=replace(error, hinge_length=0.0, hinge_error=left))


def _with_lengths(
    case: LoadCase, way: _Way, error: MeshError, lengths: ContactLengths
) -> MeshError:
    """With the load factor for hinges of the lengths that their compressive strength leaves."""
    end = way.states[0]
    if not lengths.given or end.joints is None:
        return error
    if math.isnan(error.load_factor_point_hinges):
        return replace(error, warnings=lengths.warnings(end.joints))
    state, points = end, way.points[0]
    if len(way.states) > 1:
        state, points = _with_strength(case, way, lengths)
    values = state.joints or end.joints
    length = lengths.by_strength(points, values.normal_force)
    factor = state.load_factor
    warnings = lengths.warnings(values)
    return replace(error, contact_length=length, load_factor_hinges=factor, warnings=warnings)


def _with_strength(case: LoadCase, way: _Way, lengths: ContactLengths) -> tuple[Collapse, Indices]:
    """The collapse with lengths of hinges that its own forces give, and its hinges."""
    end, size = way.states[0], way.states[0].size
    if end.joints is None:
        return end, way.points[0]
    halvings = lengths.halvings(way.points[-1], end.joints.normal_force)
    # Start from the stiffest hinges that are not stiffer than most of them.
    start = np.searchsorted(way.halvings, np.median(halvings), side="right") - 1
    state, points = way.states[start], way.points[start]
    for _ in range(OPTIONS.lengths):
        force = (state.joints or end.joints).normal_force
        soft = Softened(points, lengths.halvings(points, force))
        new = collapse_next_to(case, state, soft, near)
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


def _turns_back(found: tuple[Collapse, ...], new: Collapse) -> bool:
    """Whether the load factor, which one state changes one way, goes back further than it came."""
    if len(found) < 2:
        return False
    before, last = (one.load_factor for one in found[-2:])
    came, goes = last - before, new.load_factor - last
    return came * goes < 0.0 and abs(goes) > max(abs(came), OPTIONS.unchanged * found[0].size)
