"""The collapse of one load case by the face engine, with fields of its elastic blocks.

The engine (`faces`) knows rigid blocks and the forces of their joint faces. Its state is put on the
joint points, and the blocks are strained by it,

    K u = f_D + lambda f_L + B_N^T r_N + B_T^T r_T.

Every block is in equilibrium, so u exists up to rigid motions: those with the least openings and
slips are taken, as the limit of weak springs in the joints. Stresses are exact for these forces;
that blocks strained from rest would exert them is not claimed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace
from typing import Any

import numpy as np

from fenics_contact.collapse.load_case import LoadCase, joint_values
from fenics_contact.discretization.layout import PlaceAtStrength
from fenics_contact.errors import Stopped
from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.limit import PATH_FIRST, WAYS, FaceAttempt, FaceSearch, SearchWay
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.faces.programs import state_alone, state_under
from fenics_contact.results.bounds import counted
from fenics_contact.results.certificate import Certificate
from fenics_contact.results.history import trials
from fenics_contact.results.result import NOT_KNOWN, Answer, Collapse, Table
from fenics_contact.results.wording import Line, Wording
from fenics_contact.scene.units import PER_METRE
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.problem import Array, State
from fenics_contact.workers import result_of

#: Joints that crush that the report lists.
LISTED = 8


class CrushingAnswer(Answer):
    """Where joints crush, the longest places first; None where none has a compressive strength."""

    value: tuple[PlaceAtStrength, ...]
    name = "crushed"
    key = "crushing"
    place = 1

    def record(self) -> Any:
        """All places."""
        return [dict(vars(place)) for place in self.value]

    def lines(self, end: Collapse, words: Wording) -> list[Line]:
        """Where a joint crushes over the longest length, and over which."""
        if not self.value:
            return [Line("crushing:", "no joint is at its compressive strength")]
        first = self.value[0]
        count = len(self.value)
        place = words.units.place(first.position, 3).removesuffix(" m")
        rest = f", {counted(count - 1, 'other joint')} over less" if count > 1 else ""
        length = words.units.small(first.length)
        return [Line("crushing:", f"{first.group} crushes over {length} at {place}{rest}")]

    def table(self, end: Collapse, words: Wording) -> Table:
        """The first of these places."""
        units = words.units
        per = "normal force" if units.thickness else f"normal force {PER_METRE}"
        rows = [
            (
                units.place(place.position, 3),
                place.group,
                units.small(place.length),
                units.force(place.normal_force, 3),
            )
            for place in self.value[:LISTED]
        ]
        less = len(self.value) - LISTED
        note = f"{less} more crush over less." if less > 0 else ""
        if not rows:
            note = "No joint is at its compressive strength."
        head = ("end of the joint", "group", "crushes over", per)
        return Table(rows, "Joints that crush", head, note)


#: Of a search: its best state, how that was reached, what was tried, and why it was ended early.
Searched = tuple[FaceState | None, str, list[FaceAttempt], str]


def searched(
    model: FaceModel, asked: float, wait: Callable[[], None], ways: Sequence[SearchWay]
) -> Searched:
    """A task: the search for a certified state with the gap asked for."""
    search = FaceSearch(model, asked, check_stop=wait)
    error = search.tried(ways=ways)  # a SolverError: faces that do not hold the blocks
    way = search.way if search.way in ("follow", "half") else ""
    return search.best, way, search.attempts, str(error) * isinstance(error, Stopped)


def _asked_gap(case: LoadCase) -> float:
    """The gap that a state may have, as the scene asks for it or by default."""
    default = SEARCH.gap if case.block_count < 10 * SEARCH.large_wall else 5.0 * SEARCH.gap
    given = case.discretization.scene.solve.gap
    return default if given is None else given


def begun_search(case: LoadCase, ways: Sequence[SearchWay] = ()) -> Future[Searched]:
    """The search of the face engine, begun beside other work; by default as the scene asks."""
    model = case.blocks.model.planar.model
    engine = case.discretization.scene.solve.engine
    by_path = engine == "follow" or (engine == "auto" and case.blocks.has_strength)
    ways = ways or (PATH_FIRST if by_path else WAYS)
    return case.beside.submit(searched, model, _asked_gap(case), case.wait, ways)


def face_collapse(case: LoadCase, search: Future[Searched] | None = None) -> Collapse:
    """The collapse by the face engine, from a search that was begun or of its own. Collective.

    Raises:
        Stopped: If the run is to end; the record has the best certified state, if there is one.
    """
    effort = case.discretization.effort
    asked = _asked_gap(case)
    case.record.phase("face forces")
    state, way, attempts, stopped = _found(case, lambda: search or begun_search(case))
    record = case.record.attempts
    first = 0 if search is not None else len(record)  # it was begun before all others
    record[first:first] = trials(attempts, "faces: ")
    with effort.unwatched():
        if state is not None and state.gap <= max(asked, SEARCH.rough_gap):
            end = replace(collapse_of(case, state, asked), way=way)
        else:
            end = replace(_not_found(state), program=case.blocks.bounds)
    if stopped:
        if end.status == "limit":
            case.record.best = end
        effort.watch.reason = stopped
        raise Stopped(stopped)
    return end


def _found(case: LoadCase, begun: Callable[[], Future[Searched]]) -> Searched:
    """What a search found, on all ranks."""
    wait = case.discretization.effort.wait
    try:
        return case.blocks.on_root(lambda: result_of(begun(), wait))
    except Stopped as stop:
        return None, "", [], str(stop)


def _not_found(state: FaceState | None) -> Collapse:
    """That a search found no collapse."""
    best = "no state" if state is None else f"a state with a gap of {state.gap:.1e}"
    return Collapse(reason=f"the search on face forces ended with {best}", engine="faces")


def rigid_collapse(case: LoadCase, like: Collapse) -> Collapse:
    """The collapse of the rigid blocks of a load case: load factor and mode alone. Collective.

    The loading path leads to it where that led to the other one that it is `like`.

    Raises:
        Stopped: If the run is to end.
    """
    faces, ask = case.blocks.model.planar, case.blocks.on_root
    if np.any(faces.model.dead) and ask(lambda: state_under(faces.model, 0.0)) is None:
        return Collapse("no_equilibrium", reason=NOT_KNOWN)
    ways = WAYS if like.engine == "faces" and like.way != "follow" else PATH_FIRST
    state, way, _, stopped = _found(case, lambda: begun_search(case, ways))
    if stopped:
        case.discretization.effort.watch.reason = stopped
        raise Stopped(stopped)
    if state is not None and state.gap <= max(_asked_gap(case), SEARCH.rough_gap):
        mode = case.discretization.rigid_motion(faces.motions(state.mode))
        return Collapse("limit", state.load_factor, mode=mode, engine="faces", way=way)
    unlimited = ask(lambda: state_alone(faces.model)) is not None
    return Collapse("unbounded", np.inf) if unlimited else _not_found(state)


def collapse_of(case: LoadCase, state: FaceState, asked: float) -> Collapse:
    """A certified state as a collapse of the structure, if its blocks have strains. Collective."""
    problem, faces = case.problem, case.blocks.model.planar
    strained = strained_state(case, faces, state.force, state.load_factor)
    mode = case.discretization.rigid_motion(faces.motions(state.mode))
    opening = np.abs(problem.normal @ mode)
    largest = max(problem.max(opening), problem.max(np.abs(problem.tangential @ mode)), 1e-300)
    # Rates at which this rank's points close that have no compressive strength.
    limited = np.isfinite(faces.compressive_strength)[faces.faces.of_point]
    limited = limited[case.discretization.operators.points]
    closing = np.where(limited, 0.0, -problem.clearance_rates(mode))
    residuals = {
        **force_residuals(case, faces, state.force, strained),
        "mode_work": abs(state.sign * problem.dot(problem.live, mode) - 1.0),
        "mode_penetration": problem.max(closing) / largest,
        "limit": abs(state.gap),
    }
    size = faces.model.size(state.load_factor)
    allowed = max(asked, SEARCH.rough_gap)
    # The gap is no estimate of an error.
    known = np.nan, None, state.upper, state.load_factor, size, allowed
    certificate = Certificate(residuals, *known)
    misses = f"with the forces of the search on joint faces the blocks miss {certificate.missed}"
    end = Collapse(
        "limit" if certificate.passed else "not_converged",
        state.load_factor,
        case.blocks.bounds,
        strained,
        mode,
        joint_values(problem, case.discretization, strained, mode),
        certificate,
        reason="" if certificate.passed else misses,
        engine="faces",
        gap=abs(state.gap),
        asked=asked,
    )
    if not case.blocks.has_strength:
        return end
    inside = f"{end.inside} and the compressive strengths"
    return replace(end.with_answer(CrushingAnswer(_at_strength(faces, state))), inside=inside)


def strained_state(case: LoadCase, faces: PlanarFaces, force: Array, load_factor: float) -> State:
    """Displacements of the blocks under forces of the faces, shape (faces, 3). Collective."""
    problem = case.problem
    mine = case.discretization.operators.points
    pressure, shear = (forces[mine] for forces in faces.point_forces(force))
    right = problem.dead + load_factor * problem.live + problem.joint_forces(pressure, shear)
    spring = np.full(problem.points, SEARCH.sliding_spring * case.stiffness.mean_diagonal)
    factor = case.stiffness.factor(spring, spring)
    u, elastic, missing = np.zeros_like(right), np.zeros_like(right), right
    misses = [np.inf, problem.max(np.abs(right))]
    # Without the springs' forces, and without those that rounding makes where glued blocks turn.
    while SEARCH.digits * misses[1] < misses[-1] < 0.5 * misses[-2]:
        change = factor.solve(missing)
        u = u + change
        elastic = elastic + problem.elastic_part(change)
        missing = right - problem.stiffness @ elastic
        misses.append(problem.max(np.abs(missing)))
    work = problem.dot(problem.live, u)
    return State(u, elastic, load_factor, pressure, shear, work)


def force_residuals(
    case: LoadCase, faces: PlanarFaces, force: Array, state: State
) -> dict[str, float]:
    """What a state misses of equilibrium and of the strengths of joints, relative. Collective."""
    problem = case.problem
    typical = case.scales_at(case.bonded_work, abs(state.load_factor)).force
    missing = problem.stiffness @ state.elastic - problem.dead - state.load_factor * problem.live
    missing = missing - problem.joint_forces(state.pressure, state.shear)
    beyond = np.abs(state.shear) - problem.law.bound(state.pressure)
    residuals = {
        "equilibrium": problem.max(np.abs(missing)) / typical,
        "tension": problem.max(-state.pressure) / typical,
        "friction": problem.max(beyond) / typical,
    }
    if case.blocks.has_strength:
        model = faces.model
        excess = model.kappa[:, None] * model.normal(force)[:, None] ** 2 - force[:, :2]
        residuals["crushing"] = float(np.max(excess[model.kappa > 0.0], initial=0.0)) / typical
    return residuals


def _at_strength(faces: PlanarFaces, state: FaceState) -> tuple[PlaceAtStrength, ...]:
    """Ends of faces at their strength, the longest blocks of pressure first.

    The face moves in the mode and little of it is left in the state, or, within the state's gap,
    the mode closes the face there. Faces that only opened on the way to it are not told.
    """
    model, force = faces.model, state.force
    normal = model.normal(force)
    left = force[:, :2] - (model.kappa * normal**2)[:, None]
    opening = model.relative(state.mode)[:, :2]
    at_strength = (model.kappa > 0.0) & (normal > SEARCH.verified * normal.max(initial=0.0))
    # Where little is left at one end, the block of pressure is at the other one.
    crushes = left[:, ::-1] <= SEARCH.slight * normal[:, None]
    slight = SEARCH.slight * np.abs(opening).max(initial=0.0)
    crushes &= np.abs(opening).max(axis=1, keepdims=True) > slight  # of those that move
    crushes |= opening < -slight
    joints = faces.joints
    places = []
    for face, end in np.argwhere(at_strength[:, None] & crushes):
        point = faces.faces.ends[face, end]
        length = float(normal[face] / faces.compressive_strength[face])
        x, y = map(float, joints.position[point])
        group = joints.names[joints.law[point]]
        places.append(PlaceAtStrength((x, y), group, length, float(normal[face])))
    return tuple(sorted(places, key=lambda place: -place.length))
