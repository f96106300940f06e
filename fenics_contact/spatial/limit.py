"""The limit load of a scene in space: whether it stands, its collapse, and what is proved of it.

The dead load is asked first whether it has an equilibrium inside the cones of Coulomb friction at
all; a motion that no contact resists proves that it has none. Then a collapse state is searched for
(`faces.limit`) and held against blocks, contacts and laws (`certificate`). Where the search comes
to no state, the live load alone may be carried, of any size: forces inside the cones prove that.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np

from fenics_contact.answers.lowest import FOUND
from fenics_contact.collapse.reasons import within
from fenics_contact.errors import SolverError, Stopped, checked, require
from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.faces.lowest import STARTS, Start, lowest_from
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.programs import associative_end, motion_under, state_alone, state_under
from fenics_contact.geometry.mesh import Array
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.limit_load import Monitor
from fenics_contact.results.values import large
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.certificate import missed, residuals_of
from fenics_contact.spatial.crushing import CrushedState, crushed_state
from fenics_contact.spatial.record import LimitLoad
from fenics_contact.spatial.result import SpatialCollapse, named
from fenics_contact.spatial.scene import Scene, SolveOptions
from fenics_contact.spatial.seismic import seismic_check
from fenics_contact.spatial.structure import Structure
from fenics_contact.workers import (
    InPlace,
    asked_to_stop,
    last_result_of,
    ranks_of,
    result_of,
    workers_of,
)

_log = logging.getLogger("fenics_contact")

#: Gap of elastic states beside which collapse states are looked for. Points of a face share its
#: pressure in many ways: a twisted block carries 30 % more in a state beside one of 1e-2.
NEAR = 1e-4
#: Factorisations of a search at most.
EFFORT = 350
#: Signs of the live load.
SIGNS = {"positive": 1.0, "negative": -1.0}
NO_EQUILIBRIUM = "there is no equilibrium under the dead load alone"
UNLIMITED = "nothing limits the live load"


@checked
def limit_load(
    scene: Scene,
    monitor: Monitor | None = None,
    *,
    stop: Callable[[], str] = lambda: "",
    beside: Executor | None = None,
) -> LimitLoad:
    """Compute the limit load of a scene in space.

    Args:
        scene: What to solve.
        monitor: Told by `phase(text)` what begins.
        stop: Asked now and then who wants the run to end, in words; empty while nobody does. What
            is known by then is the result.
        beside: Does whole tasks beside this process, see `fenics_contact.workers`: the other
            direction. The answer is the same without.

    Raises:
        InputError: If laws or loads do not fit the blocks.
    """
    start = time.perf_counter()
    structure = scene.structure()
    pushed = structure.live[structure.number >= 0]
    require(bool(np.any(pushed)), "loads.live: the live load is zero on every block that moves")
    built = time.perf_counter() - start
    for text in structure.warnings:
        _log.warning("warning: %s", text)
    tell = (lambda text: None) if monitor is None else monitor.phase
    check_stop = _check(scene, stop)
    asked = scene.solve.direction
    here, *others = SIGNS if asked == "both" else (asked,)
    tasks = {}
    if beside is not None and workers_of(beside):
        tasks = {name: beside.submit(solved_beside, structure, scene, name) for name in others}
    found = {
        name: _solved(structure, scene, name, check_stop, tell)
        for name in (here, *others)
        if name not in tasks
    }
    for name, task in tasks.items():
        try:
            found[name] = result_of(task, check_stop)
        except Stopped as stopped:
            why = str(stopped)
            nothing = SpatialCollapse(sign=SIGNS[name], reason=why, stopped=why)
            found[name] = last_result_of(task, beside or InPlace()) or nothing
    total = time.perf_counter() - start
    seconds = {"read": built, "solve": total - built, "total": total}
    return LimitLoad(scene, structure, found, seconds, ranks_of(beside))


def solved_beside(structure: Structure, scene: Scene, direction: str) -> SpatialCollapse:
    """A task: the collapse in one direction."""
    return _solved(structure, scene, direction, _check(scene, asked_to_stop), lambda text: None)


def _check(scene: Scene, stop: Callable[[], str]) -> Callable[[], None]:
    """What raises `Stopped` once the time of a scene is over, or somebody asks to end."""
    reason = within(scene.solve.time, stop)

    def check_stop() -> None:
        if text := reason():
            raise Stopped(text)

    return check_stop


def _solved(
    structure: Structure,
    scene: Scene,
    direction: str,
    check_stop: Callable[[], None],
    tell: Callable[[str], None],
) -> SpatialCollapse:
    """The collapse in one direction with all that the scene asks for."""
    options = scene.solve
    sign = SIGNS[direction]
    tell("collapse" if sign > 0.0 else "collapse, live load reversed")
    found = collapse_of(structure, sign, options.gap, check_stop)
    if found.status not in ("limit", "not_converged"):
        return found
    model = structure.face_model(sign)
    lower = options.lowest or options.states == "lowest"
    try:
        if lower and found.status == "limit" and not np.any(structure.crushes):
            tell("lower collapse states")
            found = _with_lowest(structure, found, model, options, check_stop)
        if not options.fast and not found.stopped:
            check_stop()
            tell("what nothing exceeds")
            end = associative_end(model)
            found = replace(found, upper=np.inf if end is None else sign * end)
    except (Stopped, SolverError) as stopped:
        found = replace(found, stopped=str(stopped))
    check = seismic_check(structure, found, scene) if found.status == "limit" else None
    return replace(found, seismic=check)


def collapse_of(
    structure: Structure,
    sign: float = 1.0,
    asked: float = SEARCH.gap,
    check_stop: Callable[[], None] = lambda: None,
) -> SpatialCollapse:
    """The collapse under the live load, or under the reverse of it (sign -1).

    Args:
        structure: What carries the loads.
        sign: Of the live load.
        asked: Largest gap, relative.
        check_stop: May raise `Stopped` between solves: what is known by then is the result.
    """
    model = structure.face_model(sign)
    if fall := falling(structure, model):
        why = f"{NO_EQUILIBRIUM}: {named(structure, fall, 'fall')}"
        return SpatialCollapse("unstable", sign=sign, reason=why, falling=fall)
    search = FaceSearch(model, asked, EFFORT, check_stop, NEAR)
    crushes = bool(np.any(structure.crushes))
    wedged: tuple[int, ...] = ()

    def unlimited() -> bool:
        nonlocal wedged
        if search.best is None or search.best.gap > SEARCH.rough_gap:
            wedged = wedged_blocks(structure, model)
        return bool(wedged)

    stopped = ""
    why = "the search found no state"
    state: FaceState | CrushedState | None = None
    try:
        state = search.run(unlimited)
        if state is not None and crushes and not wedged:
            # Without one that does not crush, what the other one misses is told.
            state = crushed_state(structure, model, state, asked, check_stop) or state
    except (Stopped, SolverError) as end:
        why = str(end)
        stopped = why * isinstance(end, Stopped)
        state = search.best
    if wedged:
        limit = sign * np.inf
        why = f"{UNLIMITED}: {named(structure, wedged, 'wedge')}"
        return SpatialCollapse(
            "unbounded", limit, upper=limit, sign=sign, reason=why, falling=wedged
        )
    found = SpatialCollapse(sign=sign, reason=why)
    if state is not None:
        found = as_collapse(structure, state, sign, asked)
        if stopped and found.status != "limit":
            found = replace(found, reason=f"{stopped}; {found.reason}")
    return replace(
        found,
        attempts=tuple(search.attempts),
        factorizations=search.equations.factorizations,
        stopped=stopped,
    )


def falling(structure: Structure, model: FaceModel, load_factor: float = 0.0) -> tuple[int, ...]:
    """Numbers of the blocks that fall under the dead load and some live load; none if they stand.

    The motion opens all contacts and the loads do work in it: no forces inside the cones resist.
    Blocks that neither contacts nor ties join to the ground fall as they are.
    """
    count = len(structure.blocks)
    ends = np.column_stack([block for _, block, _ in structure.ends])
    held = np.where(np.append(structure.number, -1) < 0, count, np.arange(count + 1))[ends]
    parts = connected(held, count + 1)
    loose = (parts[:count] != parts[count]) & (structure.number >= 0)
    if np.any(loose):
        return tuple(np.flatnonzero(loose).tolist())
    motion = motion_under(model, load_factor)
    if motion is None:
        return ()
    loads = model.dead + load_factor * model.live
    power = replace(model, dilatancy=model.friction, dead=np.zeros_like(loads)).power(motion)
    # What forces as large as the loads, or within rounding of equilibrium, may do in it.
    doubt = power.closing.sum() * np.abs(loads).sum()
    doubt += SEARCH.exact_state * model.force * np.abs(motion).sum()
    if power.bound(model.strength) + doubt >= float(loads @ motion):
        return ()
    return _numbers(structure, np.linalg.norm(motion.reshape(-1, 6), axis=1))


def wedged_blocks(structure: Structure, model: FaceModel) -> tuple[int, ...]:
    """Numbers of blocks that wedge where contacts carry the live load alone, of any size."""
    state = state_alone(model)
    if state is None:
        return ()
    force = np.linalg.norm(state.force, axis=1)[: len(structure.points.area)]
    size = np.zeros(len(structure.blocks))
    for _, block, _ in structure.ends:
        np.maximum.at(size, block[: len(force)], force)
    return _numbers(structure, size[structure.number >= 0])


def _numbers(structure: Structure, size: Array) -> tuple[int, ...]:
    """Numbers of the moving blocks for which something is not small."""
    return tuple(np.flatnonzero(structure.number >= 0)[large(size)].tolist())


def as_collapse(
    structure: Structure, state: FaceState | CrushedState, sign: float, asked: float
) -> SpatialCollapse:
    """A state in the terms of the structure, held against it; no limit where it misses much."""
    found = SpatialCollapse(
        "limit",
        sign * state.load_factor,
        max(state.gap, 0.0),
        mode=structure.mode(state.mode),
        force=structure.point_forces(state.force),
        tension=structure.tensions(state.force),
        sign=sign,
    )
    found = replace(found, residuals=residuals_of(structure, found))
    if text := missed(found.residuals, asked):
        reason = f"the best state, with load factor {found.load_factor:.6g}, misses {text}"
        return replace(found, status="not_converged", reason=reason)
    return found


def _with_lowest(
    structure: Structure,
    found: SpatialCollapse,
    model: FaceModel,
    options: SolveOptions,
    check_stop: Callable[[], None],
) -> SpatialCollapse:
    """A collapse with the lowest state that was found, which takes its place if that is asked for.

    Raises:
        Stopped: If the search is to end.
    """
    instead = options.states == "lowest"
    spent = found.factorizations
    best: FaceState | None = None
    corners = replace(structure, quick=True).face_model(found.sign)
    starts: list[Start] = [*list(STARTS.values())[: None if instead else 1]]
    if not structure.quick:
        starts.append(FaceSearch(corners, options.gap, EFFORT, check_stop))
    for start in starts:
        search = FaceSearch(model, SEARCH.side_accuracy, EFFORT, check_stop)
        state = lowest_from(search, start)
        spent += search.equations.factorizations
        if state is not None and (best is None or state.load_factor < best.load_factor):
            best = state
    if best is None:
        return replace(found, factorizations=spent)
    least = min(best.load_factor, found.sign * found.load_factor)
    if instead and best.load_factor == least:
        lowest = as_collapse(structure, best, found.sign, options.gap)
        if lowest.status == "limit":
            found = replace(lowest, searched=FOUND, attempts=found.attempts)
    return replace(found, lowest=found.sign * least, factorizations=spent)


@checked
def standing(scene: Scene, load_factor: float = 0.0) -> LimitLoad:
    """The state under the dead load and a multiple of the live load, or the blocks that fall."""
    start = time.perf_counter()
    structure = scene.structure()
    model = structure.face_model()
    found = SpatialCollapse(reason="no state was found")
    if fall := falling(structure, model, load_factor):
        why = NO_EQUILIBRIUM if not load_factor else "there is no equilibrium under these loads"
        why = f"{why}: {named(structure, fall, 'fall')}"
        found = SpatialCollapse("unstable", reason=why, falling=fall)
    elif (state := state_under(model, load_factor)) is not None:
        force = structure.point_forces(state.force)
        tension = structure.tensions(state.force)
        found = SpatialCollapse("equilibrium", load_factor, force=force, tension=tension)
    total = {"total": time.perf_counter() - start}
    return LimitLoad(scene, structure, {"positive": found}, total)
