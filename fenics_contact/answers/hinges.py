"""What a load factor owes to the length of hinges, which is that of the mesh: down to points.

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
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from fenics_contact.answers.question import Asked, MeshQuestion
from fenics_contact.collapse.collapse_mode import rates
from fenics_contact.collapse.load_case import LoadCase, Task, falling, rising
from fenics_contact.collapse.soft_hinges import SoftHinges, soft_hinges
from fenics_contact.collapse.strategy import rising_mu
from fenics_contact.discretization.joints import GROUND
from fenics_contact.errors import EffortError, SolverError
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.results.bounds import LoadFactor, four_digits, signed
from fenics_contact.results.certificate import kinematic_factor
from fenics_contact.results.result import Answer, Collapse
from fenics_contact.results.values import JointValues
from fenics_contact.results.wording import Line, Wording
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.interior_point import Solution, Tolerances, solve_interior_point
from fenics_contact.solvers.kkt import PerturbedKKT
from fenics_contact.solvers.problem import State

_log = logging.getLogger("fenics_contact")

#: Length of a hinge in stone, about, m: what its strength leaves.
IN_STONE = 1e-3
#: Length of a hinge in units of its element side, by degree; measured.
OF_SIDE = {1: 1.0, 2: 0.2}
#: Joints settle next to a state soon or not at all,
SETTLING = replace(SEARCH, no_progress=SEARCH.hinge_corrections, points=SEARCH.hinge_points)
#: and the interior point method ends soon or not at all,
FINISHING = replace(SEARCH, interior_window=SEARCH.resting_steps)
#: at a state that is so exact.
EXACT = Tolerances(SEARCH.rounding, SEARCH.agrees)
#: A path from afar takes 1.2 to 2.3 times what that to the collapse took on block modes, measured:
#: it is begun where so much is left,
LEAST_AFAR = 1.2
#: and then ended late, in units of what is left.
MOST_AFAR = 1.3


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


def _by_load_steps(question: MeshQuestion) -> bool:
    """Whether slip is measured from the step before."""
    return question.by_rising_load() and question.options.slip == "load-steps"


class HingesAnswer(Asked):
    """Load factors for hinges of other lengths, a `HingeLengths`; None where not looked for."""

    value: HingeLengths
    name = key = "hinges"
    seconds = "error"
    place = 6
    begins = "estimate of the error"
    option = "error by the mesh estimated"
    #: With other hinges other points tear; slip that is measured from the step before is no data.
    unless = ((MeshQuestion.loses_strength, ""), (_by_load_steps, ""))

    @property
    def of_path(self) -> bool:
        """Always: joint faces have no mesh."""
        return True

    @classmethod
    def not_known(cls, reason: str) -> Self:
        """That they are not known."""
        return cls(HingeLengths("not_known", math.nan, reason=reason))

    @classmethod
    def run(cls, question: MeshQuestion) -> tuple[Self | None, Collapse]:
        """Load factors down to point hinges; joint faces have no mesh."""
        end = question.end
        if end.engine == "faces" or (end.range and end.range.is_one):
            return cls(HingeLengths.alike(end.load_factor)), end
        return cls(hinge_lengths(question.case.unrecorded, end, question.cost)), end

    def in_bracket(self, end: Collapse) -> Answer:
        """Load factors that do not leave the bracket: all collapse states are in it."""
        value = self.value
        bounds = end.bounds
        if bounds.meet and value.status == "not_known":
            return replace(self, value=HingeLengths.alike(end.load_factor))
        lower = -math.inf if bounds.lower is None else min(bounds.lower, end.load_factor)
        upper = math.inf if bounds.upper is None else max(bounds.upper, end.load_factor)
        physical, points = (float(x) for x in np.clip([value.physical, value.points], lower, upper))
        return replace(self, value=replace(value, physical=physical, points=points))

    def record(self) -> Any:
        """The three lengths with their load factors."""
        value = self.value
        lengths = {
            "mesh": (value.length, value.load_factor),
            "physical": (value.physical_length, value.physical),
            "points": (0.0, value.points),
        }
        found = {n: {"length": one[0], "load_factor": one[1]} for n, one in lengths.items()}
        return {"status": value.status, **found, "reason": value.reason or None}

    def lines(self, end: Collapse, words: Wording) -> list[Line]:
        """What hinges of other lengths do to the load factor."""
        value = self.value
        if value.status == "not_known":
            what = "what the length of hinges does to the load factor is not known"
            return [Line("mesh:", f"{what}; {value.reason}", verbose=True)]
        if value.points == value.load_factor:
            if end.range and end.range.is_one:
                return []
            none = "the load factor does not depend on the length of hinges"
            return [Line("mesh:", none, verbose=True)]
        factors = value.load_factor, value.physical, value.points
        mesh, physical, points = (four_digits(factor, value.load_factor) for factor in factors)
        small = words.units.small
        here = f"load factor {mesh}, hinges of {small(value.length)} as on this mesh"
        there = f"{physical} with {small(value.physical_length)}; {points} with points"
        found = [Line("mesh:", f"{here}; {there}", verbose=True)]
        if not (end.range and end.range.limits) and end.load_factor != value.points:
            number = words.beside(value.points, end.load_factor, end.sign)
            found.append(Line("mesh:", f"{number} with hinges that are points"))
        return found


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
    length = math.nan
    if len(points):  # of the most loaded one, which is as compliant as elements with these sides
        ends = whole.joints.position[whole.joints.segments]
        side = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        most = points[np.argmax(end.joints.normal_force[points])]
        there = np.any(whole.joints.segments == most, axis=1)
        length = float(OF_SIDE[whole.scene.degree] * side[there].min(initial=np.inf))
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
    states, dear = _followed(case, end, start, largest)
    if len(states) > 1:
        # Constants a and c through the last two; one with the mesh may be another state.
        point = states[-1].state.load_factor
        change = SEARCH.own_halvings * (load_factor - point)
        if len(states) > 2:
            few, many = (known.halvings + SEARCH.own_halvings for known in states[-2:])
            change = (states[-2].state.load_factor - point) / (1.0 / few - 1.0 / many)
            point -= change / many
        if end.range is not None and end.range.status == "known":
            lower, upper = end.range.lower, end.range.upper
            if lower <= states[-1].state.load_factor <= upper:  # the mechanism of the mesh
                point = min(max(point, lower), upper)
        if abs(point - load_factor) <= SEARCH.agrees * end.size:
            return here
        halvings = max(math.log2(length / IN_STONE), 0.0)
        own = change / (load_factor - point)  # so that no halving leaves that of the mesh
        physical = point + change / (halvings + (own if own > 0.0 else SEARCH.own_halvings))
        physical = min(max(physical, min(load_factor, point)), max(load_factor, point))
        return replace(here, physical=physical, points=point)
    reason = "no collapse state next to this one was found with shorter hinges"
    if dear:
        more = (
            "solve.accuracy sets none" if options.error else "solve.error = true sets a higher one"
        )
        reason = f"the search ended at its limit of {largest:.3g} factorisations; {more}"
    return HingeLengths("not_known", load_factor, length, reason=reason)


def _followed(
    case: LoadCase, end: Collapse, start: _Known, largest: float
) -> tuple[list[_Known], bool]:
    """The collapse, and states with more and more halvings; whether the effort ended them.

    The effort is `largest`; a path from afar that is begun within it may take a little more.
    """
    effort = case.discretization.effort
    allowed = effort.spent + largest
    few = SEARCH.few_halvings
    many = SEARCH.few_halvings / SEARCH.decade
    again = 0.0  # what the path to the collapse took on block modes
    for trial in end.attempts[-1:]:
        share = case.discretization.mode_tally.cost
        again = share / (1.0 - share) * (trial.factorizations - trial.cost)
    states = [start]
    for halvings, attempt in ((few, _next_to), (few, _from_afar), (many, _next_to)):
        last = states[-1]
        if halvings == last.halvings or (halvings == many and last is start):
            continue
        left = allowed - effort.spent
        from_afar = attempt is _from_afar
        try:
            with effort.at_most(left):
                effort.require(LEAST_AFAR * again if from_afar else 0.0)
            with effort.at_most(MOST_AFAR * left if from_afar else left):
                new = _with(case, end, last, halvings, attempt)
        except SolverError as error:
            _log.info("  %g halvings: %s", halvings, error)
            if isinstance(error, EffortError):
                return states, True
            continue
        states.append(new)
        _log.info("  %g halvings: load factor %.8g", halvings, new.state.load_factor)
        change = abs(new.state.load_factor - end.load_factor)
        if change <= SEARCH.agrees * end.size and len(new.points) == len(last.points):
            break
    return states, allowed - effort.spent < 1.0


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
    work /= SEARCH.decade if attempt is _next_to else 1.0
    scales = case.scales_at(work, abs(end.load_factor))
    task = Task(case, work, scales, SEARCH.agrees)
    with soft_hinges(case, last.points, halvings) as soft:
        problem = soft.problem
        kkt = PerturbedKKT.coulomb(problem, soft.stiffness, scales, work)
        state = attempt(task, kkt, soft, last).state
        mode = rates(replace(kkt, work=state.work), state)[0]
        factor = kinematic_factor(problem, state, mode)
        if not abs(factor - state.load_factor) <= SEARCH.agrees * abs(state.load_factor):
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
    state = last.state
    u = soft.widened(state.displacement + (task.work - state.work) * last.mode)
    start = soft.problem.state(u, state.load_factor, state.pressure, state.shear)
    give = replace(kkt.scales, displacement=SEARCH.hinge_give * kkt.scales.displacement)
    path = falling(replace(kkt, scales=give), options=SETTLING)
    mu = task.mu(SEARCH.rising_products)
    point = path.settled(path.begin(start, mu / SEARCH.hinge_give), SEARCH.decade)
    if path.distance(point) > SEARCH.allowed_distance:
        raise SolverError("joints do not settle next to the state")
    return solve_interior_point(kkt, point.state, mu, EXACT, FINISHING)


def _from_afar(task: Task, kkt: PerturbedKKT, soft: SoftHinges, _: _Known) -> Solution:
    """The state at the end of a path from the bonded structure."""
    case = task.case
    bonded = case.bonded_state(min(case.bonded_work, task.work))
    start = case.discretization.block_modes.changed(case.problem).restricted(bonded)
    u = soft.widened(start.displacement)
    start = replace(start, displacement=u, elastic=soft.widened(start.elastic))
    rise = rising(kkt)
    point = rise.follow(rise.begin(start, rising_mu(task)), task.work)
    point = falling(kkt).follow(point, task.mu(SEARCH.end_products))
    return solve_interior_point(kkt, point.state, point.mu, EXACT, FINISHING)
