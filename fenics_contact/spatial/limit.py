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
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.collapse.reasons import within
from fenics_contact.errors import SolverError, Stopped, checked, require
from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.faces.lowest import STARTS, lowest_from
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.programs import associative_end, motion_under, state_alone, state_under
from fenics_contact.geometry.mesh import Array
from fenics_contact.limit_load import Monitor
from fenics_contact.results.values import large
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.certificate import missed, residuals_of
from fenics_contact.spatial.crushing import crushed_collapse
from fenics_contact.spatial.record import write_result
from fenics_contact.spatial.result import SEARCHED, SpatialCollapse, SpatialLimit
from fenics_contact.spatial.scene import Scene, SolveOptions
from fenics_contact.spatial.seismic import seismic_check
from fenics_contact.spatial.structure import Structure
from fenics_contact.workers import asked_to_stop, last_result_of, ranks_of, result_of, workers_of

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


class LimitLoad(SpatialLimit):
    """Result of `limit_load`, with its files."""

    @checked
    def write(self, folder: str | Path, hurry: Callable[[], bool] = lambda: False) -> None:
        """Write result.json and what the scene's output options say; the folder is made.

        Once `hurry` is true only result.json is written.

        Raises:
            OutputError: If a file cannot be written; the folder is then as it was.
        """
        write_result(self, Path(folder), hurry)


@checked
def limit_load(
    scene: Scene,
    monitor: Monitor | None = None,
    *,
    progress: bool = False,
    stop: Callable[[], str] = lambda: "",
    beside: Executor | None = None,
) -> LimitLoad:
    """Compute the limit load of a scene in space.

    Args:
        scene: What to solve.
        monitor: Told by `phase(text)` what begins.
        progress: Print what begins, where there is no monitor.
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
    if progress and monitor is None:
        from fenics_contact.console import Progress

        monitor = Progress(SEARCH.usual_tolerance)
    tell = (lambda text: None) if monitor is None else monitor.phase
    reason = within(scene.solve.time, stop)
    direction = scene.solve.direction
    here, *others = tuple(SIGNS) if direction == "both" else (direction,)
    tasks = {}
    if beside is not None and workers_of(beside):
        tasks = {n: beside.submit(solved_beside, structure, scene, SIGNS[n]) for n in others}
    found = {}
    for name in (here,) if tasks else (here, *others):
        found[name] = _solved(structure, scene, SIGNS[name], reason, tell)
    for name, task in tasks.items():
        try:
            found[name] = result_of(task, _check(reason))
        except Stopped as stopped:
            known = last_result_of(task, beside) if beside is not None else None
            nothing = SpatialCollapse("not_converged", sign=SIGNS[name], reason=str(stopped))
            found[name] = known or replace(nothing, stopped=str(stopped))
    total = time.perf_counter() - start
    seconds = {"read": built, "solve": total - built, "total": total}
    return LimitLoad(scene, structure, found, seconds, ranks_of(beside), structure.warnings)


def solved_beside(structure: Structure, scene: Scene, sign: float) -> SpatialCollapse:
    """A task: the collapse in one direction."""
    reason = within(scene.solve.time, asked_to_stop)
    return _solved(structure, scene, sign, reason, lambda text: None)


def _check(reason: Callable[[], str]) -> Callable[[], None]:
    """What raises `Stopped` once there is a reason to end."""

    def check_stop() -> None:
        if text := reason():
            raise Stopped(text)

    return check_stop


def _solved(
    structure: Structure,
    scene: Scene,
    sign: float,
    reason: Callable[[], str],
    tell: Callable[[str], None],
) -> SpatialCollapse:
    """The collapse in one direction with all that the scene asks for."""
    options = scene.solve
    check_stop = _check(reason)
    tell("collapse" if sign > 0.0 else "collapse, live load reversed")
    found = collapse_of(structure, sign, options.gap, check_stop)
    if found.status != "limit":
        return found
    model = structure.face_model(sign)
    try:
        if (options.lowest or options.states == "lowest") and not crushes(structure):
            tell("lower collapse states")
            found = _with_lowest(structure, found, model, options, check_stop)
        if not options.fast:
            check_stop()
            tell("what nothing exceeds")
            end = associative_end(model)
            found = replace(found, upper=np.inf if end is None else sign * end)
    except (Stopped, SolverError) as stopped:
        found = replace(found, stopped=str(stopped))
    if scene.seismic is not None:
        sizes = [float(np.linalg.norm(load.acceleration)) for load in (scene.dead, scene.live)]
        check = seismic_check(structure, found, (sizes[0], sizes[1]), scene.seismic)
        found = replace(found, seismic=check)
    return found


def crushes(structure: Structure) -> bool:
    """Whether some contact has a compressive strength."""
    return any(np.isfinite(law.compressive_strength) for law in structure.laws)


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
    nothing = SpatialCollapse("not_converged", sign=sign)
    if fall := falling(structure, model):
        return replace(nothing, status="unstable", reason=NO_EQUILIBRIUM, falling=fall)
    search = FaceSearch(model, asked, EFFORT, check_stop, NEAR)
    stopped = ""
    try:
        wedged = _searched(structure, search)
        if wedged:
            unbounded = replace(nothing, status="unbounded", load_factor=sign * np.inf)
            return replace(unbounded, upper=sign * np.inf, reason=UNLIMITED, falling=wedged)
    except Stopped as stop:
        stopped = str(stop)
    except SolverError as error:
        _log.info("  %s", error)
    known = {
        "attempts": tuple(search.attempts),
        "factorizations": search.equations.factorizations,
        "stopped": stopped,
    }
    if search.best is None:
        return replace(nothing, reason=stopped or "the search found no state", **known)
    found = as_collapse(structure, search.best, sign, asked)
    if crushes(structure):
        try:
            force = search.best.force
            found = crushed_collapse(structure, found, force, asked, check_stop)
        except Stopped as stop:
            stopped = str(stop)
            found = replace(nothing, reason=f"{stopped}; crushing is not in the state found")
        found = held_against_problem(structure, found, asked)
    if stopped and found.status != "limit":
        found = replace(found, reason=f"{stopped}; {found.reason}")
    return replace(found, **known)


def _searched(structure: Structure, search: FaceSearch) -> tuple[int, ...]:
    """Search until a state has the gap asked for; blocks that wedge where nothing limits the load.

    The state beside a good one is looked for before any other friction bound is tried.
    """
    state, work = search.with_coulomb()
    if not search.is_found:
        search.from_best()
    best = search.best
    if best is None or best.gap > SEARCH.rough_gap:
        wedged = wedged_blocks(structure, search.model)
        if wedged:
            return wedged
    if not search.is_found:
        search.with_given_part(state, work)
    if not search.is_found:
        search.from_best()
    if not search.is_found:
        search.from_associative()
    return ()


def falling(structure: Structure, model: FaceModel, load_factor: float = 0.0) -> tuple[int, ...]:
    """Numbers of the blocks that fall under the dead load and some live load; none if they stand.

    The motion opens all contacts and the loads do work in it: no forces inside the cones resist.
    """
    motion = motion_under(model, load_factor)
    if motion is None:
        return ()
    relative = np.abs(model.relative(motion)).max(initial=1e-300)
    associative = replace(model, dilatancy=model.friction).power(motion)
    if associative.closing.max(initial=0.0) > SEARCH.verified * relative:
        return ()
    return _numbers(structure, np.linalg.norm(motion.reshape(-1, 6), axis=1))


def wedged_blocks(structure: Structure, model: FaceModel) -> tuple[int, ...]:
    """Numbers of blocks that wedge where contacts carry the live load alone, of any size."""
    state = state_alone(model)
    if state is None:
        return ()
    force = np.linalg.norm(state.force, axis=1)[: len(structure.points.area)]
    size = np.zeros(len(structure.blocks))
    for name in ("first", "second"):
        numbers = np.array([getattr(contact, name) for contact in structure.contacts])
        np.maximum.at(size, numbers[structure.points.contact], force)
    return _numbers(structure, size[structure.number >= 0])


def _numbers(structure: Structure, size: Array) -> tuple[int, ...]:
    """Numbers of the moving blocks for which something is not small."""
    return tuple(np.flatnonzero(structure.number >= 0)[large(size)].tolist())


def as_collapse(
    structure: Structure, state: FaceState, sign: float, asked: float = SEARCH.gap
) -> SpatialCollapse:
    """A certified state in the terms of the structure, held against it."""
    mode = np.zeros((len(structure.blocks), 6))
    mode[structure.number >= 0] = state.mode.reshape(-1, 6)
    mode[:, 3:] /= structure.size
    mode /= np.linalg.norm(mode[:, :3], axis=1).max(initial=1e-300)
    found = SpatialCollapse(
        "limit",
        sign * state.load_factor,
        max(state.gap, 0.0),
        mode=mode,
        force=structure.point_forces(state.force),
        tension=structure.tensions(state.force),
        sign=sign,
    )
    return held_against_problem(structure, found, asked)


def held_against_problem(
    structure: Structure, found: SpatialCollapse, asked: float
) -> SpatialCollapse:
    """A collapse with its residuals; none if one of them is too large."""
    if found.force is None:
        return found
    residuals = {**residuals_of(structure, found), **found.residuals}
    text = missed(residuals, asked)
    if text:
        return replace(
            found,
            status="not_converged",
            residuals=residuals,
            reason=f"the best state, with load factor {found.load_factor:.6g}, misses {text}",
        )
    return replace(found, residuals=residuals)


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
    names = list(STARTS) if options.states == "lowest" else list(STARTS)[:1]
    best: FaceState | None = None
    spent = found.factorizations
    for name in names:
        search = FaceSearch(model, SEARCH.side_accuracy, EFFORT, check_stop)
        state = lowest_from(search, STARTS[name])
        spent += search.equations.factorizations
        if state is not None and (best is None or state.load_factor < best.load_factor):
            best = state
    found = replace(found, factorizations=spent)
    if best is None:
        return found
    lower = best.load_factor < found.sign * found.load_factor
    lowest = found.sign * best.load_factor if lower else found.load_factor
    if lower and options.states == "lowest":
        state_found = as_collapse(structure, best, found.sign, options.gap)
        if state_found.status == "limit":
            kept: dict[str, Any] = {"attempts": found.attempts, "factorizations": spent}
            found = replace(state_found, searched=SEARCHED, **kept)
    return replace(found, lowest=lowest)


@checked
def standing(scene: Scene, load_factor: float = 0.0) -> LimitLoad:
    """The state under the dead load and a multiple of the live load, or the blocks that fall."""
    start = time.perf_counter()
    structure = scene.structure()
    model = structure.face_model()
    fall = falling(structure, model, load_factor)
    if fall:
        reason = NO_EQUILIBRIUM if not load_factor else "there is no equilibrium under these loads"
        found = SpatialCollapse("unstable", reason=reason, falling=fall)
    else:
        state = state_under(model, load_factor)
        found = SpatialCollapse("not_converged", reason="no state was found")
        if state is not None:
            force = structure.point_forces(state.force)
            tension = structure.tensions(state.force)
            found = SpatialCollapse("equilibrium", load_factor, force=force, tension=tension)
    total = {"total": time.perf_counter() - start}
    return LimitLoad(scene, structure, {"positive": found}, total, 1, structure.warnings)
