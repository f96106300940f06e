"""Load factors for hinges of other lengths than those of the mesh, down to points.

At collapse blocks turn about single nodes. The force there presses a node in by an amount that
grows like log(1/h). Where the load factor depends on how joint forces share the load, it changes
like 1 / log(1/h): comparing meshes shows little of it. So the collapse of the mesh is followed, on
block modes, to hinges with m = 30 and 300 further halvings of the elements there (`soft_hinges`);
each state may have new hinges. Through both goes

    lambda(m) = a + c / (m + 2):

a is the load factor of point hinges, which no stone has. That of hinges of a length l, at
m = log2(h / l), is between those of the mesh and of points, with a number in place of 2 that gives
that of the mesh at m = 0.

A state counts where its mode gives its load factor: the kinematic one is an upper bound for the
friction forces of the state, which are admissible.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.collapse.collapse_mode import elastic_mode
from fenics_contact.collapse.load_case import LoadCase, Task
from fenics_contact.collapse.loading_path import falling, rising
from fenics_contact.collapse.strategy import rising_mu
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.joints import GROUND
from fenics_contact.errors import EffortError, SolverError
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.mesh_error.soft_hinges import SoftHinges, soft_hinges
from fenics_contact.results.bounds import LoadFactor, signed
from fenics_contact.results.certificate import kinematic_factor
from fenics_contact.results.result import Collapse
from fenics_contact.results.values import JointValues
from fenics_contact.search_options import SEARCH, SearchOptions
from fenics_contact.solvers.interior_point import (
    Solution,
    Tolerances,
    solve_interior_point,
)
from fenics_contact.solvers.kkt import PerturbedKKT
from fenics_contact.solvers.problem import State

_log = logging.getLogger("fenics_contact")


def settling() -> SearchOptions:
    """How joints settle next to a state: it succeeds soon or not at all."""
    return replace(SEARCH, path_corrections=SEARCH.hinge_corrections, points=SEARCH.hinge_points)


def finishing() -> SearchOptions:
    """When the interior point method stops next to such a state."""
    return replace(SEARCH, interior_window=SEARCH.hinge_window)


def exact() -> Tolerances:
    """How exact a state has to be."""
    return Tolerances(SEARCH.hinge_exact, SEARCH.hinge_agrees)


#: Length of a hinge in stone, about, m: what crushing leaves.
IN_STONE = 1e-3
#: Length of a hinge in units of its element side, by degree; measured.
OF_SIDE = {1: 1.0, 2: 0.2}


@dataclass(frozen=True)
class HingeLengths:
    """Load factors for three lengths of the hinges; nan: not known.

    Attributes:
        status: "known" or "not_known".
        load_factor: For hinges as long as on this mesh.
        length: That of the most loaded one, m; nan without hinges.
        physical: For hinges of the physical length.
        physical_length: That of a hinge in stone, about, m.
        points: For hinges of no length.
        reason: Why they are not known, and what to do, for people.
    """

    status: str
    load_factor: LoadFactor
    length: float = math.nan
    physical: LoadFactor = math.nan
    physical_length: float = IN_STONE
    points: LoadFactor = math.nan
    reason: str = ""

    @classmethod
    def alike(cls, load_factor: float, length: float = math.nan) -> HingeLengths:
        """Those of a load factor that hinges do not change."""
        return cls("known", load_factor, length, load_factor, points=load_factor)


@dataclass(frozen=True)
class _Known:
    """A state with so many halvings of the elements at hinges.

    Attributes:
        halvings: m.
        state: Its unknowns are those of the modes, and of some hinges.
        mode: Likewise.
        joints: What all joint points do.
        points: Hinges that were found up to this state.
    """

    halvings: float
    state: State
    mode: Array
    joints: JointValues
    points: Indices


def hinge_lengths(case: LoadCase, end: Collapse, cost: float) -> HingeLengths:
    """What the load factor of a collapse owes to the length of hinges. Collective.

    Args:
        case: The load case.
        end: Its collapse, with status "limit".
        cost: Of the collapse, in units of one factorisation of the structure.

    Raises:
        Stopped: If the run is to end.
    """
    whole = case.discretization
    load_factor = end.load_factor
    if end.state is None or end.mode is None or end.joints is None:
        return HingeLengths("not_known", load_factor, reason="the collapse has no state")
    points = end.joints.hinges(whole.joints.neighbours)
    points = points[np.any(whole.joints.nodes[points] != GROUND, axis=1)]
    length = _length_on_mesh(whole, points, end.joints.normal_force)
    here = HingeLengths.alike(load_factor, length)
    if not len(points) or not case.problem.coulomb:
        return here
    if case.problem.dot(case.problem.live, end.mode) < 0.0:  # the dead load does the work
        found = signed(hinge_lengths(case.reversed(), signed(end, -1.0), cost), -1.0)
        return replace(found, load_factor=load_factor)
    modes = whole.block_modes.changed(case.problem)
    start = _Known(0.0, modes.restricted(end.state), modes.motion(end.mode), end.joints, points)
    options = whole.scene.solve
    share = SEARCH.hinge_asked if options.error else SEARCH.hinge_share
    largest = math.inf if options.accuracy is not None else share * (1.0 + cost)
    with whole.effort.at_most(largest):
        states = _followed(case, end, start)
        left = whole.effort.left
    if len(states) > 1:
        point, change = _extrapolated(states)
        if end.range is not None and end.range.status == "known":
            lower, upper = end.range.lower, end.range.upper
            if lower <= states[-1].state.load_factor <= upper:  # the mechanism of the mesh
                point = min(max(point, lower), upper)
        if abs(point - load_factor) <= SEARCH.hinge_agrees * end.size:
            return here
        halvings = max(math.log2(length / IN_STONE), 0.0)
        own = change / (load_factor - point)  # so that no halving leaves that of the mesh
        physical = point + change / (halvings + (own if own > 0.0 else SEARCH.own_halvings))
        physical = min(max(physical, min(load_factor, point)), max(load_factor, point))
        return replace(here, physical=physical, points=point)
    reason = "no collapse state next to this one was found with shorter hinges"
    if left < 1.0:
        more = (
            "solve.accuracy sets none" if options.error else "solve.error = true sets a higher one"
        )
        reason = f"the search ended at its limit of {largest:.3g} factorisations; {more}"
    return HingeLengths("not_known", load_factor, length, reason=reason)


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


def _followed(case: LoadCase, end: Collapse, start: _Known) -> list[_Known]:
    """The collapse, and states with more and more halvings, as far as the effort allows."""
    few, many = SEARCH.few_halvings, SEARCH.many_halvings
    states = [start]
    for halvings, attempt in ((few, _next_to), (few, _from_afar), (many, _next_to)):
        last = states[-1]
        if halvings == last.halvings or (halvings == many and last is start):
            continue
        try:
            states.append(_with(case, end, last, halvings, attempt))
        except EffortError as error:
            _log.info("  %g halvings: %s", halvings, error)
            break
        except SolverError as error:
            _log.info("  %g halvings: %s", halvings, error)
            continue
        new = states[-1]
        _log.info("  %g halvings: load factor %.8g", halvings, new.state.load_factor)
        change = abs(new.state.load_factor - end.load_factor)
        if change <= SEARCH.hinge_agrees * end.size and len(new.points) == len(last.points):
            break
    return states


def _extrapolated(states: Sequence[_Known]) -> tuple[float, float]:
    """Constants a and c of lambda(m) = a + c / (m + 2), through the last two states.

    One with the mesh is not trusted: it may be another state.
    """
    first = states[0].state.load_factor
    last = states[-1].state.load_factor
    if len(states) < 3:
        return last, SEARCH.own_halvings * (first - last)
    few, many = (known.halvings + SEARCH.own_halvings for known in states[-2:])
    change = (states[-2].state.load_factor - last) / (1.0 / few - 1.0 / many)
    return last - change / many, change


def _with(
    case: LoadCase,
    end: Collapse,
    last: _Known,
    halvings: float,
    attempt: Callable[[Task, PerturbedKKT, SoftHinges, _Known], Solution],
) -> _Known:
    """The state with so many halvings at the hinges found so far.

    Raises:
        SolverError: If there is none, or its mode does not agree.
    """
    whole = case.discretization
    more = max(1.0, halvings / SEARCH.few_halvings)
    work = more * max(end.work_ratio, 1.0) * case.bonded_work
    work *= SEARCH.work_growth if attempt is _next_to else 1.0
    scales = case.scales_at(work, abs(end.load_factor))
    task = Task(case, work, scales, SEARCH.hinge_agrees)
    with soft_hinges(case, last.points, halvings) as soft:
        problem = soft.problem
        kkt = PerturbedKKT.coulomb(problem, soft.stiffness, scales, work)
        state = attempt(task, kkt, soft, last).state
        mode = elastic_mode(replace(kkt, work=state.work), state)
        factor = kinematic_factor(problem, state, mode)
        if not abs(factor - state.load_factor) <= SEARCH.hinge_agrees * abs(state.load_factor):
            raise SolverError(f"the mode gives a load factor of {factor:.8g}")
        values = replace(
            last.joints,
            normal_force=state.pressure - problem.law.bond,
            shear_force=state.shear,
            opening_rate=problem.normal @ mode,
            slip_rate=problem.tangential @ mode,
            clearance_rate=problem.clearance_rates(mode),
        )
    hinges = np.union1d(last.points, values.hinges(whole.joints.neighbours))
    return _Known(halvings, state, mode, values, hinges)


def _next_to(task: Task, kkt: PerturbedKKT, soft: SoftHinges, last: _Known) -> Solution:
    """The state next to another one with fewer halvings: its joints settle first.

    They go to the central path with large products, a few at a time on their laws (`arclength`):
    which of them open and slide changes at once. Where one is left farther from its law than a step
    allows, no state is near.
    """
    state = soft.state(last.state)
    u = state.displacement + (task.work - state.work) * soft.widened(last.mode)
    start = soft.problem.state(u, state.load_factor, state.pressure, state.shear)
    give = replace(kkt.scales, displacement=SEARCH.hinge_give * kkt.scales.displacement)
    path = falling(replace(kkt, scales=give), options=settling())
    mu = task.mu(SEARCH.rising_products)
    point = path.settled(path.begin(start, mu / SEARCH.hinge_give), SEARCH.path_close)
    if path.distance(point) > SEARCH.allowed_distance:
        raise SolverError("joints do not settle next to the state")
    return solve_interior_point(kkt, point.state, mu, exact(), finishing())


def _from_afar(task: Task, kkt: PerturbedKKT, soft: SoftHinges, _: _Known) -> Solution:
    """The state at the end of a path from the bonded structure."""
    case = task.case
    bonded = case.bonded_state(min(case.bonded_work, task.work))
    start = soft.state(case.discretization.block_modes.changed(case.problem).restricted(bonded))
    rise = rising(kkt)
    point = rise.follow(rise.begin(start, rising_mu(task)), task.work)
    point = falling(kkt).follow(point, task.mu(SEARCH.end_products))
    return solve_interior_point(kkt, point.state, point.mu, exact(), finishing())
