"""The limit load of face forces: an elastic state with Coulomb's law, made exact by a certificate.

The elastic state, rigid blocks on the springs of their faces, under a large work W of the live
load is near a collapse state. Coulomb's law in it, |t| <= c + F N without dilatancy, is not
associated; one solve with it suffices on most structures. Else the friction bound is

    c + theta (F - D) N + (1 - theta) (F - D) N_k,   N_k the pressing forces of the step before,

and theta = 1/2 is small enough for these steps to converge. Every iterate that is near enough is
handed to the certificate; the best state with its proved gap is the result. Where none is good
enough, the best one's load factor is let free, and then the associative limit is the start.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from fenics_contact.errors import SolverError, Stopped
from fenics_contact.faces.certificate import Certifier, FaceState
from fenics_contact.faces.cones import Array
from fenics_contact.faces.follow import Followed, followed
from fenics_contact.faces.kernel import (
    FaceIterate,
    FaceTolerances,
    Program,
    elastic_response,
    solve,
)
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.programs import associative_state
from fenics_contact.faces.strained import StrainedModel
from fenics_contact.faces.system import SHIFT, Equations
from fenics_contact.search_options import SEARCH

_log = logging.getLogger("fenics_contact")

#: Names of attempts.
LOADING_PATH = "loading path"
FURTHER_LAW = "compressive strength, by power cones"
#: How a state was reached, by what the name of the attempt begins with.
LED = {LOADING_PATH: "follow", "theta": "half", "convex": "convex", "": "one shot"}


@dataclass(frozen=True)
class FaceAttempt:
    """What was tried: its name, the gap that it came to, factorisations until then."""

    name: str
    gap: float
    factorizations: int

    @property
    def outcome(self) -> str:
        """How it ended, in words."""
        return f"a state with gap {self.gap:.1e}" if np.isfinite(self.gap) else "no state"


class SearchWay(NamedTuple):
    """A row of a table of what is tried in turn.

    Attributes:
        name: What people read.
        refuses: Why it is not asked, in words; empty where it is.
        goes: Looks for a state.
    """

    name: str
    refuses: Callable[[Any], str]
    goes: Callable[[Any], Any]


def applicable(
    ways: Sequence[SearchWay], refusal: Callable[[SearchWay], str], kind: str = ""
) -> Iterator[SearchWay]:
    """Those of a table that are to be tried, in order; why others are not is logged at the end."""
    refused: dict[str, list[str]] = {}
    for way in ways:
        if why := refusal(way):
            refused.setdefault(why, []).append(way.name)
        else:
            yield way
    for why, names in refused.items():
        _log.info("  %s%s: not asked: %s", kind, ", ".join(names), why)


class FaceSearch:
    """Certified states of one model, and what was tried for them.

    Attributes:
        best: The state of least gap so far; a negative load factor only if no other is near.
        path: The loading path, if it was followed to its end.
        attempts: In order.
        hopeless: Whether to look no further.
        ended: Why nothing more is tried, in words; empty while something is.
        elastic_state: With Coulomb's law.
        elastic_work: Of the live load in it.
    """

    def __init__(
        self,
        model: FaceModel,
        asked: float,
        effort: float = SEARCH.collapse_cost,
        check_stop: Callable[[], None] = lambda: None,
        near: float = SEARCH.rough_gap,
        elastic: StrainedModel | None = None,
    ) -> None:
        """Take a model, the gap asked for, and the most factorisations.

        States are looked for beside elastic ones of a gap `near`, of the model or of an `elastic`
        one with the same units. `check_stop` is called between solves and may raise `Stopped`.
        """
        self.model = model
        self.equations = Equations(model)
        self.elastic_model: FaceModel = elastic or model
        self.elastic_equations = self.equations
        if elastic is not None:
            self.elastic_equations = Equations(self.elastic_model, self.equations)
        self.best: FaceState | None = None
        self.path: Followed | None = None
        self.attempts: list[FaceAttempt] = []
        self.hopeless: Callable[[], bool] | None = None
        self.ended = ""
        self.elastic_state: FaceIterate | None = None
        self.elastic_work = np.nan
        self._name = ""
        self._asked = asked
        self._effort = effort
        self._check_stop = check_stop
        self._near = near
        self._certifier = Certifier(model, self.equations, asked=asked)

    def run(
        self, hopeless: Callable[[], bool] | None = None, ways: Sequence[SearchWay] = ()
    ) -> FaceState | None:
        """Search until a state has the gap asked for; the best one.

        Args:
            hopeless: Whether to look no further, asked once the elastic state led to none so good.
                States beside the best one are then looked for first, as long as gaps fall.
            ways: Those that are gone, in order; by default `WAYS`.
        """
        self.hopeless = hopeless
        for way in applicable(ways or WAYS, lambda way: way.refuses(self)):
            way.goes(self)
            self.ended = "a state was found" if self._found else self.ended
        return self.best

    def tried(self, *arguments: Any, **named: Any) -> SolverError | Stopped | None:
        """Search as `run` does; what ended that early."""
        try:
            self.run(*arguments, **named)
        except (SolverError, Stopped) as error:
            _log.info("  %s", error)
            return error
        return None

    def along_path(self) -> None:
        """The state that a load which rises from rest leads to, the end of the loading path.

        Where it comes to none, elastic states with half of Coulomb's law, whose bound begins with a
        part of the forces under the dead load.
        """
        spent = self.equations.factorizations
        try:
            path = self.path = followed(
                self.elastic_model, self.elastic_equations, SEARCH.collapse_cost, self._check_stop
            )
        except SolverError as error:
            _log.debug("  loading path: %s", error)
            self._take(LOADING_PATH, None)
            self._with_given_part(SEARCH.little_friction * self.dead_forces, self.work)
        else:
            end = path.iterate.load_factor
            last = self._as_rigid(path.iterate)
            found = self._certifier.exact(last)
            found = found or self._certifier.near(last, path.work)[0]
            near = 1.01 * SEARCH.rough_gap * self.model.size(end)
            sure = found and found.gap > -SEARCH.agrees and abs(found.load_factor - end) <= near
            if path.is_whole or sure:
                self._take(LOADING_PATH, found)
            if not (path.is_whole or self._found):
                self._with_given_part(SEARCH.little_friction * self.dead_forces, self.work)
        self._effort += self.equations.factorizations - spent  # what else is tried has its own

    def by_convex_programs(self) -> None:
        """The state of the associative limit, then states beside it; the end if cost is spent."""
        self._from_associative("convex programs, ", signs=(1.0,))
        self._from_best(SEARCH.face_rounds, "convex programs, ")
        self.ended = "its cost is spent" * self.is_spent

    def by_coulomb(self) -> None:
        """The state near the elastic one with Coulomb's law; the end where there is no hope."""
        self.elastic_state, self.elastic_work = self._with_coulomb(self.work)
        if self.hopeless is not None and not self._found:
            self._from_best(SEARCH.face_rounds)
            self.ended = "nothing limits the load" * self.hopeless()

    def by_half(self) -> None:
        """States with half of Coulomb's law, from the pressing forces of the elastic one."""
        if self.elastic_state is not None:
            pressed = self.model.normal(np.maximum(self.elastic_state.force, 0.0))
            self._with_given_part(pressed, self.elastic_work)

    def beside_best(self) -> None:
        """States beside the best one."""
        self._from_best(1 if self.hopeless is None else SEARCH.face_rounds)

    def by_associative(self) -> None:
        """The states of the associative limit, of either sign of work."""
        self._from_associative()

    def by_further_law(self) -> None:
        """The state within the law that the kernel leaves out, from the best one without it.

        Where there is none the best one stays: what it misses is told.
        """
        law, best = self.model.further, self.best
        found = None if law is None else law.state(self.model, best, self._asked, self._check_stop)
        self.best = found or best
        self._note(FURTHER_LAW, found)

    def with_friction(self, most: float) -> FaceSearch:
        """A search of its own on the same units with so much friction at most."""
        friction, dilatancy = np.minimum([self.model.friction, self.model.dilatancy], most)
        less = replace(self.model, friction=friction, dilatancy=dilatancy)
        return FaceSearch(less, self._asked, self._effort, self._check_stop, self._near)

    @property
    def way(self) -> str:
        """How the best state was reached: "follow", "half", "convex" or "one shot"."""
        return next((way for name, way in LED.items() if self._name.startswith(name)), "")

    def _from_best(self, rounds: int, way: str = "") -> None:
        """States of least gap for modes of the best state, their load factors let free."""
        for _ in range(rounds):
            before = self.best
            if before is None or self._found:
                return
            self._check_stop()
            self._take(f"{way}the best state", self._certifier.of(before.force))
            best = self.best or before
            if self._found or self.is_spent or not best.gap < 0.9 * before.gap:
                return

    def _from_associative(self, way: str = "", signs: tuple[float, ...] = (1.0, -1.0)) -> None:
        """States with the strengths of the associative limit.

        The live load may do negative work there: what drives the collapse is the dead load.
        """
        self._check_stop()
        upper = associative_state(self.model, self.equations)
        if not upper.within(SEARCH.rough_gap, missing_motion=SEARCH.small_factor):
            return
        for sign in signs:
            self._check_stop()
            certifier = Certifier(self.model, self.equations, sign, self._asked)
            found = certifier.of(upper.force)
            size = self.model.size(upper.load_factor)
            least = upper.load_factor - SEARCH.rough_gap * size
            if sign < 0.0 and found is not None and found.load_factor < least:
                found = None
            self._take(f"{way}associative friction, work {sign:+g}", found)
            if self._found:
                return

    @property
    def work(self) -> float:
        """W, the first one."""
        model = self.elastic_model
        work = elastic_response(model, self.elastic_equations).work
        # Softer than the shift of the matrix is: nothing holds some block.
        if not work < float(model.live @ model.live) * model.compliance.max() / SHIFT:
            raise SolverError("the faces do not hold the blocks")
        return SEARCH.first_work * work

    @property
    def _found(self) -> bool:
        return self.best is not None and self._rank(self.best) < (False, False, self._asked)

    def _rank(self, state: FaceState) -> tuple[bool, bool, float]:
        """Order of states: those with a small gap, that need no live load to stand, come first."""
        rough = state.gap > max(self._asked, SEARCH.rough_gap)
        negative = state.load_factor < -self._asked * self.model.size(0.0)
        return rough, negative, state.gap

    @property
    def is_spent(self) -> bool:
        """Whether no more factorisations are allowed."""
        return self.equations.factorizations >= self._effort

    def _with_coulomb(self, work: float) -> tuple[FaceIterate, float]:
        """The elastic state with Coulomb's law, and its work; more work where it is too little."""
        model = self.model
        for again in range(SEARCH.works):
            work /= SEARCH.decade if again else 1.0
            state = self.elastic(1.0, np.zeros(model.shape[0]), work, self._near)
            limit = self._certified("Coulomb's law", state, work)
            below = limit - state.load_factor > SEARCH.far_apart * model.size(state.load_factor)
            near = state.gap < SEARCH.rough_gap / SEARCH.decade
            if self._found or self.is_spent or not (near and below):
                break
        return state, work

    @property
    def dead_forces(self) -> Array:
        """Pressing forces under the dead load with all faces closed, where they press."""
        response = elastic_response(self.elastic_model, self.elastic_equations)
        return self.model.normal(np.maximum(response.dead_force, 0.0))

    def _with_given_part(self, pressed: Array, work: float) -> None:
        """Steps with half of Coulomb's law, the rest of the bound given, from some forces."""
        model = self.model
        theta = 0.5
        for _ in range(SEARCH.face_rounds):
            if self.is_spent:
                break
            state = self.elastic(theta, pressed, work, SEARCH.part_gap)
            own = np.maximum(model.normal(state.force), 0.0)
            slip = np.linalg.norm(model.relative(state.motion)[:, model.pressing :], axis=1)
            # Work of friction by which the bound differs from the state's own, over lambda W.
            change = model.free_friction * np.abs(own - pressed)
            missed = (1.0 - theta) * float(np.sum(change * slip))
            missed /= work * model.size(state.load_factor)
            near = state.gap < SEARCH.rough_gap / SEARCH.decade
            pressed = own if near else 0.5 * (pressed + own)
            if near and missed < SEARCH.part_gap:
                self._certified(f"theta {theta:g}", state, work)
                if self._found or missed < SEARCH.gap:
                    break

    def elastic(self, theta: float, pressed: Array, work: float, gap: float) -> FaceIterate:
        """The elastic state under a work, with a part theta of Coulomb's law and the rest given."""
        self._check_stop()
        model = self.elastic_model
        program = Program(
            model,
            self.elastic_equations,
            model.strength + (1.0 - theta) * model.free_friction * pressed,
            model.dilatancy + theta * model.free_friction,
            model.dilatancy,
            work,
            elastic=True,
        )
        return self._as_rigid(solve(program, tolerances=FaceTolerances(gap, 1e-5, 1e-3)))

    def _as_rigid(self, state: FaceIterate) -> FaceIterate:
        model = self.elastic_model
        return model.as_rigid(state) if isinstance(model, StrainedModel) else state

    def _certified(self, name: str, state: FaceIterate, work: float) -> float:
        """Hand a state to the certificate; the limit with its strengths."""
        self._check_stop()
        found, limit = self._certifier.near(state, work)
        size = self.model.size(state.load_factor)
        if found and abs(found.load_factor - state.load_factor) > 1.01 * SEARCH.part_gap * size:
            name += ", another state"
        self._take(name, found)
        return limit

    def _take(self, name: str, found: FaceState | None) -> None:
        """Record an attempt, and keep its state if it is the best."""
        if found and (self.best is None or self._rank(found) < self._rank(self.best)):
            self.best = found
            self._name = name
        self._note(name, found)

    def _note(self, name: str, found: FaceState | None) -> None:
        """Record an attempt."""
        gap = np.nan if found is None else found.gap
        self.attempts.append(FaceAttempt(name, gap, self.equations.factorizations))
        _log.debug("  %s", self.attempts[-1])


def _where_few(search: FaceSearch) -> str:
    return search.ended or "there are few blocks" * (not search.model.has_many_blocks)


def _where_many(search: FaceSearch) -> str:
    return search.ended or "there are many blocks" * search.model.has_many_blocks


def _where_all_is_known(search: FaceSearch) -> str:
    if search.model.further is None:
        return "the ways before know all laws"
    none = search.best is None or (search.hopeless is not None and search.hopeless())
    return "there is no state without it" * none


_ENDED = attrgetter("ended")
#: Ways of a search, in the order in which they are gone.
WAYS = (
    SearchWay("convex programs", _where_few, FaceSearch.by_convex_programs),
    SearchWay("Coulomb's law", _ENDED, FaceSearch.by_coulomb),
    SearchWay("half of Coulomb's law", _ENDED, FaceSearch.by_half),
    SearchWay("states beside the best one", _ENDED, FaceSearch.beside_best),
    SearchWay("associative friction", _ENDED, FaceSearch.by_associative),
)
#: The loading path before them, at any size; and as blocks without a mesh are asked.
PATH_FIRST = (SearchWay(LOADING_PATH, _ENDED, FaceSearch.along_path), *WAYS)
WAYS_OF_BLOCKS = (
    SearchWay(LOADING_PATH, _where_many, FaceSearch.along_path),
    *WAYS,
    SearchWay(FURTHER_LAW, _where_all_is_known, FaceSearch.by_further_law),
)
