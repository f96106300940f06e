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
from concurrent.futures import Executor, Future
from dataclasses import replace
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

from fenics_contact.answers.question import answered
from fenics_contact.collapse.directions import SIGNS, in_directions
from fenics_contact.collapse.reasons import within
from fenics_contact.errors import Stopped, checked, require
from fenics_contact.faces.limit import WAYS_OF_BLOCKS, FaceSearch
from fenics_contact.limit_load import Monitor
from fenics_contact.requirements import check_requirements
from fenics_contact.results.history import trials
from fenics_contact.results.result import Collapse, up_to
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.certificate import as_collapse
from fenics_contact.spatial.question import BlockQuestion
from fenics_contact.spatial.record import BlockLimitLoad
from fenics_contact.spatial.result import named
from fenics_contact.spatial.scene import BlockScene
from fenics_contact.spatial.standing import state_of, wedged_blocks
from fenics_contact.spatial.structure import Structure
from fenics_contact.workers import InPlace, asked_to_stop, ranks_of

_log = logging.getLogger("fenics_contact")

UNLIMITED = "nothing limits the live load"
#: Modules of answers, each of which registers its own. They stand on this one.
ANSWERS = (
    *("motion.answer", "elastic.answer", "spatial.along_path", "spatial.other_states"),
    *("spatial.upper_end", "spatial.without_ties", "elastic.rigid"),
)
#: Module that makes blocks strain; it stands on this one.
STRAINS = "fenics_contact.elastic.strains"


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
    structure = structure_of(scene)
    pushed = structure.live[structure.number >= 0]
    require(bool(np.any(pushed)), "loads.live: the live load is zero on every block that moves")
    built = time.perf_counter() - start
    for text in structure.warnings:
        _log.warning("warning: %s", text)
    tell = (lambda text: None) if monitor is None else monitor.phase
    check_stop = _check(scene, stop)

    def begin(name: str, workers: Executor) -> Future[Collapse]:
        return workers.submit(solved, structure, scene, name)

    def solve(name: str, own: Executor) -> Collapse:
        return solved(structure, scene, name, check_stop, tell, workers=own)

    found = in_directions(scene.solve.direction, beside, begin, solve, check_stop)
    total = time.perf_counter() - start
    seconds = {"read": built, "solve": total - built, "total": total}
    return BlockLimitLoad(scene, structure, found, seconds, ranks_of(beside))


def structure_of(scene: BlockScene, degree: int = 1) -> Structure:
    """The structure of a scene, with blocks that strain where it asks for it.

    Their displacements have a degree; 2, for bending, costs some ten times as much.

    Raises:
        InputError: If laws or loads do not fit the blocks.
    """
    if scene.strained:
        check_requirements(key=scene.strained)
    structure = scene.structure()
    if not scene.elastic:
        return structure
    strained: Structure = import_module(STRAINS).with_strains(scene, structure, degree)
    return strained


def _check(scene: BlockScene, stop: Callable[[], str]) -> Callable[[], None]:
    """What raises `Stopped` once the time of a scene is over, or somebody asks to end."""
    reason = within(scene.solve.time, stop)

    def check_stop() -> None:
        if text := reason():
            raise Stopped(text)

    return check_stop


def solved(
    structure: Structure,
    scene: BlockScene,
    direction: str,
    check_stop: Callable[[], None] | None = None,
    tell: Callable[[str], None] = lambda text: None,
    stands: bool = False,
    workers: Executor | None = None,
) -> Collapse:
    """A task: the collapse in one direction with all that the scene asks for.

    Whether the dead load has a state is not asked where it is known that it `stands`.
    """
    check_stop = check_stop or _check(scene, asked_to_stop)
    sign = SIGNS[direction]
    tell("collapse" if sign > 0.0 else "collapse, live load reversed")
    end, search = searched_for(structure, sign, scene.solve.asked_gap, check_stop, stands)
    if search is None:
        return end
    parts: dict[str, Any] = {"structure": structure, "search": search, "check_stop": check_stop}
    parts["workers"] = workers or InPlace()
    before = search.equations.factorizations
    end = _answered(scene, end, parts, tell)
    spent = search.equations.factorizations - before  # on the path that led to it
    return replace(end, factorizations=end.factorizations + spent)


def _answered(
    scene: BlockScene,
    end: Collapse,
    parts: dict[str, Any],
    tell: Callable[[str], None] = lambda text: None,
) -> Collapse:
    """A state with all that the scene asks for; parts are those of a `BlockQuestion`."""
    for name in ANSWERS:
        import_module(f"fenics_contact.{name}")
    return answered(BlockQuestion(scene=scene, end=end, **parts), tell, {})


def collapse_of(
    structure: Structure,
    sign: float = 1.0,
    asked: float = SEARCH.gap,
    check_stop: Callable[[], None] = lambda: None,
) -> Collapse:
    """The collapse under the live load, or under the reverse of it (sign -1).

    Args:
        structure: What carries the loads.
        sign: Of the live load.
        asked: Largest gap, relative.
        check_stop: May raise `Stopped` between solves: what is known by then is the result.
    """
    return searched_for(structure, sign, asked, check_stop)[0]


def searched_for(
    structure: Structure,
    sign: float,
    asked: float,
    check_stop: Callable[[], None],
    stands: bool = False,
) -> tuple[Collapse, FaceSearch | None]:
    """The collapse, and the search that led to it; None where the dead load has no state."""
    rest = Collapse() if stands else state_of(structure)
    if rest.status in ("unstable", "no_equilibrium"):
        return replace(rest, sign=sign), None
    model = structure.face_model(sign)
    options: dict[str, Any] = {"near": SEARCH.side_accuracy, "check_stop": check_stop}
    search = FaceSearch(model, asked, elastic=structure.strained_model(model, sign), **options)
    wedged = cache(lambda: wedged_blocks(structure, model))

    def unlimited() -> bool:
        none = search.best is None or search.best.gap > SEARCH.rough_gap
        return none and bool(wedged())

    wedges: tuple[int, ...] = ()
    found = Collapse(sign=sign, reason="the search found no state")
    hopeless = _alike(structure, sign) and wedged()
    error = None if hopeless else search.tried(unlimited, WAYS_OF_BLOCKS)
    if search.best is not None:
        found = as_collapse(structure, model, search.best, sign, asked)
    if found.status != "limit" and error is not None:
        found = replace(found, reason=f"{error}; {found.reason}")
    elif found.status != "limit":
        wedges = wedged() or wedged_blocks(structure, model, stressed=True)
    if wedges:
        why = f"{UNLIMITED}: {named(structure, wedges, 'wedge')}"
        none: dict[str, Any] = {"sign": sign, "reason": why, "falling": wedges}
        found = Collapse("unbounded", sign * np.inf, up_to(np.inf), **none)
    found = replace(found, way=search.way if found.status == "limit" else "")
    found = replace(
        found,
        states=(found.as_state,) if found.way else (),
        attempts=trials(search.attempts),
        factorizations=search.equations.factorizations,
        stopped=str(error) * isinstance(error, Stopped),
    )
    return found, search


def _alike(structure: Structure, sign: float) -> bool:
    """Whether the dead load is a multiple of the live load, not a negative one."""
    dead, live = structure.generalised(structure.dead), sign * structure.generalised(structure.live)
    multiple = float(dead @ live) / float(live @ live)
    apart = np.linalg.norm(dead - multiple * live)
    return multiple >= 0.0 and bool(apart <= SEARCH.digits * np.linalg.norm(dead))


@checked
def standing(scene: BlockScene, load_factor: float = 0.0) -> BlockLimitLoad:
    """The state under the dead load and a multiple of the live load, or the blocks that fall."""
    start = time.perf_counter()
    structure = structure_of(scene, degree=2)
    found = state_of(structure, load_factor)
    if scene.output.stress:
        search = FaceSearch(structure.face_model(), 1.0)
        parts: dict[str, Any] = {"structure": structure, "search": search}
        found = _answered(scene, found, parts)
    total = {"total": time.perf_counter() - start}
    return BlockLimitLoad(scene, structure, {"positive": found}, total)
