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

from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.errors import EffortError
from fenics_contact.geometry.mesh import Flags, Indices
from fenics_contact.mesh_error.contact_lengths import ContactLengths
from fenics_contact.mesh_error.determinate import is_determinate
from fenics_contact.mesh_error.nearby import (
    Softened,
    Start,
    collapse_and_rate,
    collapse_next_to,
    from_afar,
    near,
    on_mesh,
    rates,
    same_mode,
)
from fenics_contact.mesh_error.other_degree import first_look_cost, with_other_degree
from fenics_contact.results.joint_values import Contact, JointValues
from fenics_contact.results.mesh_error import MeshError, StateChange
from fenics_contact.results.result import Collapse

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class ErrorOptions:
    """Numbers of the estimate.

    Attributes:
        ways: Halvings m of hinges, and what looks for their state, in this order: what is done
            unasked, and where the scene asks for the estimate. Fewer, and from the start, where
            none is near.
        enough: From so many halvings on the rest of the change is extrapolated: it falls like
            1 / (m + own). The second, where the scene asks for the estimate.
        own: Halvings of a block's height that lead to a hinge of the mesh, about; measured.
        unchanged: The load factor does not depend on hinges any more if it changes by less than
            this up to the next m, relative, or than the tolerance.
        share: Largest cost of the estimate, in units of that of the collapse: what is done unasked.
        asked: The same where the scene asks for the estimate.
        usual_solve: Cost of the collapse, at least, in factorisations of the structure. Its
            steps on block modes take as long as factorisations do; under load control it is near.
        large: Changes of the load factor to the other degree above this are looked at closely.
        rough: Those below this are none, relative.
        error_of_degree: Error of the load factor of a degree, in units of the difference between
            degrees 1 and 2; measured. For degree 2 it is 0.3 mostly, and 1 where corners decide.
        lengths: Solves at most for the lengths of hinges by the compressive strength.
        settled: They end where the load factor changes by less than this, relative.
    """

    ways: tuple[tuple[tuple[float, Start], ...], ...] = (
        ((30.0, near), (4.0, near), (30.0, near)),
        (
            *((30.0, near), (4.0, near), (30.0, near), (30.0, from_afar), (4.0, from_afar)),
            *((30.0, near), (100.0, near), (100.0, from_afar), (100.0, near)),
            *((1000.0, near), (1e4, near), (1e4, from_afar), (1e4, near)),
        ),
    )
    enough: tuple[float, float] = (30.0, 100.0)
    own: float = 2.0
    unchanged: float = 1e-6
    share: float = 0.6
    asked: float = 3.0
    usual_solve: float = 40.0
    large: float = 1e-3
    rough: float = 1e-5
    error_of_degree: tuple[float, float] = (1.15, 0.5)
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
    effort = case.discretization.effort
    largest = _largest_cost(case, end)
    with effort.at_most(largest):
        found = _estimated(case, end, end.joints, tolerance)
        error = found.mesh_error
        if error is not None and math.isnan(error.estimate):
            error = replace(error, unknown=_why(case, error, effort.left, largest))
    return replace(found, mesh_error=error)


def _estimated(case: LoadCase, end: Collapse, values: JointValues, tolerance: float) -> Collapse:
    """As `with_mesh_error`, as far as the effort allows."""
    whole = case.discretization
    lengths = ContactLengths.of(whole)
    points = values.hinges(whole.joints.neighbours)
    way = _Way((end,), (points,), ended=len(points) == 0 or _determinate(case, end))
    way = _to_point_hinges(case, way, max(tolerance, OPTIONS.unchanged))
    length = lengths.of_mesh(points, values.normal_force)
    error = replace(_hinge_error(way), hinge_length=length)
    if way.complete:
        error = _with_algebraic_error(case, way, error, max(tolerance, OPTIONS.rough))
    error = _with_lengths(case, way, error, lengths)
    return replace(end, mesh_error=error, at_point_hinges=_at_point_hinges(case, way, error))


def _largest_cost(case: LoadCase, end: Collapse) -> float:
    """Cost of the estimate, at most, in factorisations of the structure."""
    options = case.discretization.scene.solve
    if options.accuracy is not None:
        return math.inf
    return (OPTIONS.asked if options.error else OPTIONS.share) * _solve_cost(end)


def _why(case: LoadCase, error: MeshError, left: float, largest: float) -> str:
    """Why an error is not known, and what to do, for people."""
    by_hinges = math.isnan(error.hinge_error)
    if left >= (1.0 if by_hinges else first_look_cost(case)):
        what = "shorter hinges" if by_hinges else "displacements of the other degree"
        return f"no collapse state next to this one was found with {what}; a finer mesh may tell"
    asked = case.discretization.scene.solve.error
    more = "solve.accuracy sets none" if asked else "solve.error = true sets a higher one"
    return f"the estimate ended at its limit of {largest:.3g} factorisations; {more}"


@dataclass(frozen=True)
class _Way:
    """Collapse states on the way to point hinges.

    Attributes:
        states: That of the mesh first.
        points: Hinges found up to each of them.
        halvings: m of each state.
        rate: d(lambda)/dm of the last state.
        changes: Changes of state.
        ended: Whether shorter hinges change nothing any more.
    """

    states: tuple[Collapse, ...]
    points: tuple[Indices, ...]
    halvings: tuple[float, ...] = (0.0,)
    rate: float = math.nan
    changes: tuple[StateChange, ...] = ()
    ended: bool = False

    @property
    def complete(self) -> bool:
        """Whether the limit of point hinges is known."""
        known = self.halvings[-1] >= OPTIONS.enough[0] and not math.isnan(self.rate)
        return self.ended or known

    @property
    def rest(self) -> float:
        """Change of the load factor that is left, as c / (m + own) for m halvings."""
        return 0.0 if self.ended else self.rate * (self.halvings[-1] + OPTIONS.own)

    @property
    def last(self) -> tuple[Collapse, Indices, float]:
        """Last state, hinges, m."""
        return self.states[-1], self.points[-1], self.halvings[-1]

    def leads_to(self, halvings: float) -> bool:
        """Whether the last state is of less halvings, or shows hinges that have none yet."""
        if halvings != self.halvings[-1]:
            return halvings > self.halvings[-1]
        return len(self.points[-1]) > len(self.points[-2])

    def grown(self, new: Collapse, rate: float, found: Indices, halvings: float) -> _Way:
        """With one more state."""
        last = self.states[-1]
        changes = self.changes
        if not _alike(last, new) or _turns_back(self.states, new):
            between = self.halvings[-1], halvings
            changes = (*changes, StateChange(between, last.load_factor, new.load_factor))
        points = (*self.points, np.union1d(self.points[-1], found))
        return _Way((*self.states, new), points, (*self.halvings, halvings), rate, changes)


def _solve_cost(end: Collapse) -> float:
    """Cost of a collapse, or what one costs from the bonded structure, in factorisations."""
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


def _to_point_hinges(case: LoadCase, way: _Way, unchanged: float) -> _Way:
    """States with more and more compliant hinges, as long as they change the load factor.

    The last m is that from which on the rest can be extrapolated, or, where a state is to be
    reported in place of that of the mesh, the largest.
    """
    whole = case.discretization
    options = whole.scene.solve
    asked = bool(options.error) or options.accuracy is not None
    ways = OPTIONS.ways[asked]
    enough = OPTIONS.enough[asked]
    if options.accuracy is not None:
        enough = ways[-1][0]
    tried: set[tuple[float, Start, int]] = set()
    for halvings, start in ways:
        task = halvings, start, len(way.states)
        if way.ended or halvings > enough or task in tried or not way.leads_to(halvings):
            continue
        if whole.effort.left < 1.0:
            _log.info("  %g halvings: beyond the limit of the estimate", halvings)
            break
        tried.add(task)
        last, points, _ = way.last
        new, rate = collapse_and_rate(case, last, Softened(points, halvings), start)
        if new.status != "limit" or new.joints is None:
            continue
        if abs(new.load_factor - last.load_factor) <= unchanged * way.states[0].size:
            return replace(way, ended=True)
        way = way.grown(new, rate, new.joints.hinges(whole.joints.neighbours), halvings)
        way = replace(way, ended=_independent(case, new))
    return way


def _hinge_error(way: _Way) -> MeshError:
    """The hinge part of the error; nan where the limit of point hinges is not known."""
    if not way.complete:
        return MeshError(math.nan, math.nan, math.nan, state_changes=way.changes)
    end = way.states[0]
    limit = way.states[-1].load_factor + way.rest
    jumps = sum(change.after - change.before for change in way.changes)
    error = abs(limit - end.load_factor - jumps) / end.size
    return MeshError(math.nan, limit, error, state_changes=way.changes)


def _with_algebraic_error(
    case: LoadCase, way: _Way, error: MeshError, negligible: float
) -> MeshError:
    """With the error of joints that slide while they are closed over a length.

    It is not known where the other degree is too dear, or has no collapse state near by.
    """
    last, points, halvings = way.last
    size = way.states[0].size
    degree = case.discretization.scene.degree
    slides = last.joints is not None and np.delete(last.joints.contact == Contact.SLIP, points)
    if not np.any(slides) or _independent(case, last):
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


def _at_point_hinges(case: LoadCase, way: _Way, error: MeshError) -> Collapse | None:
    """The last state of the way, with what is left of c / m; None where hinges change nothing."""
    if not way.complete or len(way.states) == 1:
        return None
    found = on_mesh(case, way.states[-1], Softened(way.points[-2], way.halvings[-1]))
    left = abs(way.rest) / way.states[0].size
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
    state = end
    points = way.points[0]
    if len(way.states) > 1:
        state, points = _with_strength(case, way, lengths)
    values = state.joints or end.joints
    length = lengths.by_strength(points, values.normal_force)
    factor = state.load_factor
    warnings = lengths.warnings(values)
    return replace(error, contact_length=length, load_factor_hinges=factor, warnings=warnings)


def _with_strength(case: LoadCase, way: _Way, lengths: ContactLengths) -> tuple[Collapse, Indices]:
    """The collapse with lengths of hinges that its own forces give, and its hinges."""
    end = way.states[0]
    size = way.states[0].size
    if end.joints is None:
        return end, way.points[0]
    halvings = lengths.halvings(way.points[-1], end.joints.normal_force)
    # Start from the stiffest hinges that are not stiffer than most of them.
    start = np.searchsorted(way.halvings, np.median(halvings), side="right") - 1
    state = way.states[start]
    points = way.points[start]
    for _ in range(OPTIONS.lengths):
        force = (state.joints or end.joints).normal_force
        soft = Softened(points, lengths.halvings(points, force))
        new = collapse_next_to(case, state, soft, near)
        if new.status != "limit" or new.joints is None:
            return replace(state, load_factor=math.nan), points
        settled = abs(new.load_factor - state.load_factor) <= OPTIONS.settled * size
        found = np.union1d(points, new.joints.hinges(case.discretization.joints.neighbours))
        settled &= len(found) == len(points)
        state = new
        points = found
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
    came = last - before
    goes = new.load_factor - last
    return came * goes < 0.0 and abs(goes) > max(abs(came), OPTIONS.unchanged * found[0].size)
