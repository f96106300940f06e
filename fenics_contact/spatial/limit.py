"""The limit load of a scene in space: whether it stands, its collapse, and what is proved of it.

The dead load is asked first whether it has a state (`standing`). Then a collapse state is searched
for (`faces.limit`) and held against blocks, contacts and laws (`certificate`). Where the search
comes to no state, and where no upper end is proved, the live load alone may be carried, of any
size: forces inside the cones prove that.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from fenics_contact.answers.lowest import FOUND, MORE, LowestAnswer
from fenics_contact.answers.peak import NO_PATH, PeakAnswer
from fenics_contact.answers.seismic import SeismicAnswer
from fenics_contact.collapse.reasons import within
from fenics_contact.errors import SolverError, Stopped, checked, require
from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.follow import Followed
from fenics_contact.faces.limit import WAYS_OF_BLOCKS, FaceSearch
from fenics_contact.faces.lowest import STARTS, Start, lowest_from
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.programs import associative_end
from fenics_contact.limit_load import Monitor
from fenics_contact.results.bounds import LimitBounds, rounded
from fenics_contact.results.history import CollapseState, Lowest, Peak, Trial
from fenics_contact.results.result import Collapse, known_bounds
from fenics_contact.scene.scene import SolveOptions
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.along_path import curve_of, peak_of
from fenics_contact.spatial.certificate import certified
from fenics_contact.spatial.crushing import CrushedState, crushed_state
from fenics_contact.spatial.record import BlockLimitLoad
from fenics_contact.spatial.result import named
from fenics_contact.spatial.scene import BlockScene
from fenics_contact.spatial.seismic import seismic_check
from fenics_contact.spatial.standing import state_of, wedged_blocks
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

#: Signs of the live load.
SIGNS = {"positive": 1.0, "negative": -1.0}
UNLIMITED = "nothing limits the live load"


@checked
def limit_load(
    scene: BlockScene,
    monitor: Monitor | None = None,
    *,
    stop: Callable[[], str] = lambda: "",
    beside: Executor | None = None,
) -> BlockLimitLoad:
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
            nothing = Collapse(sign=SIGNS[name], reason=why, stopped=why)
            found[name] = last_result_of(task, beside or InPlace()) or nothing
    total = time.perf_counter() - start
    seconds = {"read": built, "solve": total - built, "total": total}
    return BlockLimitLoad(scene, structure, found, seconds, ranks_of(beside))


def solved_beside(structure: Structure, scene: BlockScene, direction: str) -> Collapse:
    """A task: the collapse in one direction."""
    return _solved(structure, scene, direction, _check(scene, asked_to_stop), lambda text: None)


def _check(scene: BlockScene, stop: Callable[[], str]) -> Callable[[], None]:
    """What raises `Stopped` once the time of a scene is over, or somebody asks to end."""
    reason = within(scene.solve.time, stop)

    def check_stop() -> None:
        if text := reason():
            raise Stopped(text)

    return check_stop


def _solved(
    structure: Structure,
    scene: BlockScene,
    direction: str,
    check_stop: Callable[[], None],
    tell: Callable[[str], None],
) -> Collapse:
    """The collapse in one direction with all that the scene asks for."""
    options = scene.solve
    sign = SIGNS[direction]
    tell("collapse" if sign > 0.0 else "collapse, live load reversed")
    first = direction in (options.direction, "positive")  # its curve is drawn
    points = scene.output.capacity if first else 0
    along = AlongPath(not options.fast and options.peak is not False, points)
    found = collapse_of(structure, sign, options.asked_gap, check_stop, along)
    if found.status not in ("limit", "not_converged"):
        return found
    model = structure.face_model(sign)
    lower = options.lowest or options.states == "lowest"
    try:
        crushes = crush_apart(structure, model)
        if lower and found.status == "limit" and not crushes:
            tell("lower collapse states")
            found = _with_lowest(structure, found, model, options, check_stop)
        another = not options.fast and options.lowest is not False
        if another and found.way == "follow" and not crushes:
            tell("another state")
            found = _with_one_shot(found, model, options.asked_gap, check_stop)
        if not options.fast and not found.stopped:
            check_stop()
            tell("what nothing exceeds")
            found = _with_upper(structure, found, model)
    except (Stopped, SolverError) as stopped:
        found = replace(found, stopped=str(stopped))
    if found.status != "limit":
        return found
    check = seismic_check(structure, found, scene)
    # It stands on this folder, and is imported where it is asked for.
    from fenics_contact.motion.answer import BeyondAnswer, asks_beyond, with_beyond

    if asks_beyond(scene) and not found.stopped:
        tell(BeyondAnswer.begins)
        found, check = with_beyond(scene, structure, found, check, check_stop)
    return found if check is None else found.with_answer(SeismicAnswer(check))


def _with_upper(structure: Structure, found: Collapse, model: FaceModel) -> Collapse:
    """A limit with what nothing exceeds, or the blocks that can wedge; none if it exceeds that."""
    end = associative_end(model)
    if end is None:
        return replace(found, falling=wedged_blocks(structure, model, stressed=True))
    found = replace(found, program=_upper_end(rounded(end, found.size)))
    above = found.sign * (found.load_factor - found.upper) / found.size
    if above <= 0.0:
        return found
    rounding = SEARCH.agrees * max(1.0, model.force / (model.load * found.size))
    if above <= (found.gap or 0.0) + rounding:
        asked = found.certificate.tolerance if found.certificate else 0.0
        return certified(structure, replace(found, load_factor=found.upper), found.size, asked)
    reason = f"the best state, {found.load_factor:.6g}, is above {found.upper:.6g}, a proved end"
    return replace(found, status="not_converged", reason=reason)


def _trials(search: FaceSearch) -> tuple[Trial, ...]:
    """What a search tried."""
    return tuple(
        Trial(one.name, np.nan, one.outcome, bool(np.isfinite(one.gap)), one.factorizations, 0.0)
        for one in search.attempts
    )


def _upper_end(limit: float) -> Callable[[], LimitBounds]:
    """The program of a bracket of which the upper end alone is known."""
    return partial(known_bounds, LimitBounds(None, limit))


def collapse_of(
    structure: Structure,
    sign: float = 1.0,
    asked: float = SEARCH.gap,
    check_stop: Callable[[], None] = lambda: None,
    along: AlongPath | None = None,
) -> Collapse:
    """The collapse under the live load, or under the reverse of it (sign -1).

    Args:
        structure: What carries the loads.
        sign: Of the live load.
        asked: Largest gap, relative.
        check_stop: May raise `Stopped` between solves: what is known by then is the result.
        along: What else is asked of the loading path.
    """
    rest = state_of(structure)
    if rest.status in ("unstable", "no_equilibrium"):
        return replace(rest, sign=sign)
    model = structure.face_model(sign)
    search = FaceSearch(model, asked, check_stop=check_stop, near=SEARCH.side_accuracy)
    crushes = crush_apart(structure, model)
    wedged = cache(lambda: wedged_blocks(structure, model))

    def unlimited() -> bool:
        none = search.best is None or search.best.gap > SEARCH.rough_gap
        return none and bool(wedged())

    stopped = ""
    wedges: tuple[int, ...] = ()
    found = Collapse(sign=sign, reason="the search found no state")
    try:
        whole: FaceState | None = None
        if not (_alike(structure, sign) and wedged()):
            whole = search.run(unlimited, WAYS_OF_BLOCKS)
        state: FaceState | CrushedState | None = whole
        if whole is not None and crushes and not unlimited():
            # Without one that does not crush, what the other one misses is told.
            state = crushed_state(structure, model, whole, asked, check_stop) or whole
        if state is not None:
            found = as_collapse(structure, model, state, sign, asked)
        if along is not None and found.status == "limit":
            path = search.path if search.way == "follow" and not crushes else None
            found = _with_path(structure, path, found, along)
        if found.status != "limit":
            wedges = wedged() or wedged_blocks(structure, model, stressed=True)
    except (Stopped, SolverError) as end:
        stopped = str(end) * isinstance(end, Stopped)
        if search.best is not None:
            found = as_collapse(structure, model, search.best, sign, asked)
        if found.status != "limit":
            found = replace(found, reason=f"{end}; {found.reason}")
    if wedges:
        limit = sign * np.inf
        why = f"{UNLIMITED}: {named(structure, wedges, 'wedge')}"
        program = _upper_end(np.inf)
        found = Collapse("unbounded", limit, program, sign=sign, reason=why, falling=wedges)
    found = replace(found, way=search.way if found.status == "limit" else "")
    return replace(
        found,
        states=(found.as_state,) if found.way else (),
        attempts=_trials(search),
        factorizations=search.equations.factorizations,
        stopped=stopped,
    )


@dataclass(frozen=True)
class AlongPath:
    """What is asked of the loading path: its peak, and so many points of the capacity curve."""

    peak: bool = False
    points: int = 0


def _with_path(
    structure: Structure,
    path: Followed | None,
    found: Collapse,
    along: AlongPath,
) -> Collapse:
    """A limit with what is asked of the path that led to it."""
    if path is None:
        if along.points:
            _log.warning("warning: output.capacity: %s", NO_PATH)
        return found.with_answer(PeakAnswer.not_known(NO_PATH)) if along.peak else found
    if along.peak:
        peak = peak_of(structure, path, found.sign)
        if peak.status == "none" and not path.is_whole:
            peak = Peak("not_known", reason=NO_PATH)
        found = found.with_answer(PeakAnswer(peak))
    return replace(found, curve=curve_of(structure, path, found.sign, along.points))


def _with_one_shot(
    found: Collapse, model: FaceModel, asked: float, check_stop: Callable[[], None]
) -> Collapse:
    """A limit by the loading path, with the state that one solve leads to beside it."""
    search = FaceSearch(model, asked, check_stop=check_stop, near=SEARCH.side_accuracy)
    state = search.run()
    spent = found.factorizations + search.equations.factorizations
    attempts = (*found.attempts, *_trials(search))
    found = replace(found, factorizations=spent, attempts=attempts)
    if state is None or state.gap > asked:
        return found
    factor = found.sign * state.load_factor
    one = CollapseState(search.way, "limit", factor, abs(state.gap))
    return replace(found, states=(*found.states, one))


def crush_apart(structure: Structure, model: FaceModel) -> bool:
    """Whether contacts crush by programs of their own (`crushing`): the model knows no strength."""
    return bool(np.any(structure.crushes)) and not np.any(model.kappa)


def _alike(structure: Structure, sign: float) -> bool:
    """Whether the dead load is a multiple of the live load, not a negative one."""
    dead, live = structure.generalised(structure.dead), sign * structure.generalised(structure.live)
    multiple = float(dead @ live) / float(live @ live)
    apart = np.linalg.norm(dead - multiple * live)
    return multiple >= 0.0 and bool(apart <= SEARCH.digits * np.linalg.norm(dead))


def as_collapse(
    structure: Structure,
    model: FaceModel,
    state: FaceState | CrushedState,
    sign: float,
    asked: float,
) -> Collapse:
    """A state in the terms of the structure, held against it; no limit where it misses much.

    Nor is one that needs the reverse of the live load: the dead load alone stands.
    """
    size = model.size(state.load_factor)
    found = Collapse(
        "limit",
        rounded(sign * state.load_factor, size),
        mode=structure.mode(state.mode),
        engine="faces",
        gap=abs(state.gap),
        inside="friction",
        sign=sign,
        force=structure.point_forces(state.force),
        tension=structure.tensions(state.force),
    )
    found = certified(structure, found, size, asked)
    missed = found.certificate.failures if found.certificate else ()
    text = f"misses {', '.join(missed).replace('_', ' ')}" if missed else ""
    if not text and state.load_factor < -asked * model.size(0.0):
        text = "is one of the reversed live load"
    reason = f"the best state, with load factor {found.load_factor:.6g}, {text}"
    return replace(found, status="not_converged", reason=reason) if text else found


def _with_lowest(
    structure: Structure,
    found: Collapse,
    model: FaceModel,
    options: SolveOptions,
    check_stop: Callable[[], None],
) -> Collapse:
    """A collapse with the lowest state that was found, which takes its place if that is asked for.

    Raises:
        Stopped: If the search is to end.
    """
    instead = options.states == "lowest"
    spent = found.factorizations
    best: FaceState | None = None
    count = 0
    corners = replace(structure, quick=True).face_model(found.sign)
    starts: list[Start] = [*list(STARTS.values())[: None if instead else 1]]
    if corners.shape != model.shape:
        starts.append(FaceSearch(corners, options.asked_gap, check_stop=check_stop))
    for start in starts:
        search = FaceSearch(model, SEARCH.side_accuracy, check_stop=check_stop)
        state = lowest_from(search, start)
        spent += search.equations.factorizations
        count += state is not None
        if state is not None and (best is None or state.load_factor < best.load_factor):
            best = state
    found = replace(found, factorizations=spent)
    if best is None:
        return found.with_answer(LowestAnswer.not_known(MORE))
    factor = found.sign * best.load_factor
    lower = best.load_factor < found.sign * found.load_factor - SEARCH.higher * found.size
    told = Lowest("none", found.load_factor, count, gap=found.gap)
    told = replace(told, status="lower", load_factor=factor, gap=best.gap) if lower else told
    if instead and best.load_factor <= found.sign * found.load_factor:
        end = as_collapse(structure, model, best, found.sign, options.asked_gap)
        if end.status == "limit":
            end = replace(end, searched=FOUND, attempts=found.attempts)
            found = replace(end, factorizations=spent)
            told = replace(told, load_factor=end.load_factor)
    return found.with_answer(LowestAnswer(told))


@checked
def standing(scene: BlockScene, load_factor: float = 0.0) -> BlockLimitLoad:
    """The state under the dead load and a multiple of the live load, or the blocks that fall."""
    start = time.perf_counter()
    structure = scene.structure()
    found = state_of(structure, load_factor)
    total = {"total": time.perf_counter() - start}
    return BlockLimitLoad(scene, structure, {"positive": found}, total)
