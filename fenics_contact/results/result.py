"""Limit loads as data: what an analysis hands on to its user, and to files and pictures.

Load factors have the user's sign: those of the live load reversed are not above zero. Arrays are
numpy's; nothing here holds a PETSc object.
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from fenics_contact.discretization.joints import GROUND
from fenics_contact.discretization.layout import Layout
from fenics_contact.geometry.mesh import Indices
from fenics_contact.results.block_view import BlockView
from fenics_contact.results.bounds import (
    WITHOUT_PATH,
    LimitBounds,
    LoadFactor,
    alike,
    bracket_rows,
    proof,
    signed,
)
from fenics_contact.results.certificate import Certificate
from fenics_contact.results.history import (
    CapacityPoint,
    CollapseState,
    CurveEnd,
    History,
    LoadPath,
    Pass,
    TracePoint,
    Trial,
)
from fenics_contact.results.values import (
    JointValues,
    NamedArrays,
    SoilForce,
    fall_reason,
    falling_blocks,
    large,
    named_blocks,
    soil_forces,
    soil_lines,
    tension_lines,
    tie_arrays,
)
from fenics_contact.results.wording import DEAD, Line, Wording, meant, wording_of
from fenics_contact.scene.scene import CRUSHING, OutputOptions, Scene, Shared
from fenics_contact.solvers.joint_forces import SplittingHistory
from fenics_contact.solvers.problem import Array, State


@dataclass(frozen=True)
class Table:
    """Rows for the report; those without a title are among those of the load factor.

    Attributes:
        rows: Cells; the first one names the row.
        title: Of a table of its own.
        head: Names of its columns.
        note: A sentence below it.
    """

    rows: Sequence[Sequence[str]]
    title: str = ""
    head: Sequence[str] = ()
    note: str = ""


@dataclass(frozen=True)
class Answer(ABC):
    """What is known of a collapse beside its load factor, in numbers and in words.

    Each kind is a class of its own, in a file of `fenics_contact.answers`. Results hold answers by
    name; console, result.json and report go through them and know none by name.

    Attributes:
        value: What was found, as data, with a status and a reason where it may be missed.
    """

    value: Any
    #: All kinds by name, in the order of their places.
    kinds: ClassVar[dict[str, type[Answer]]] = {}
    #: Where it stands among answers as they are told.
    place: ClassVar[int]
    #: Attribute of a collapse, and of a result, that is this value.
    name: ClassVar[str]
    #: Key of result.json.
    key: ClassVar[str]
    #: Said as the search begins; empty: it takes no time.
    begins: ClassVar[str] = ""
    #: Key of the time that it takes, and of the option that asks for it.
    seconds: ClassVar[str] = ""
    #: What that option is, in words.
    option: ClassVar[str] = ""
    #: Whether results hold and write the values of limits by direction.
    by_direction: ClassVar[bool] = False
    #: Whether it has changed the blocks that the bracket is of.
    changes_blocks: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        """A kind with a name is one of all kinds."""
        if "name" in vars(cls):
            known = {**Answer.kinds, cls.name: cls}
            Answer.kinds = dict(sorted(known.items(), key=lambda item: item[1].place))

    @classmethod
    def asked_by(cls, scene: Shared) -> str:
        """A line on what a scene asks of it; empty where it says nothing."""
        return ""

    def record(self) -> Any:
        """What result.json holds: the fields of the value, and null where no reason is given."""
        shown = (item.name for item in fields(self.value) if item.repr)
        found = {name: getattr(self.value, name) for name in shown}
        return found | ({"reason": found["reason"] or None} if "reason" in found else {})

    @property
    def of_path(self) -> bool:
        """Whether only a path that was not followed tells: nothing is said beside a proof."""
        return False

    @abstractmethod
    def lines(self, end: Collapse, words: Wording) -> Sequence[Line]:
        """Lines for the console, of an answer to a collapse: for everybody, or for `-v` alone."""

    def seen(self, view: BlockView) -> BlockView:
        """A view of the collapse with what it shows of this answer."""
        return view

    def table(self, end: Collapse, words: Wording) -> Table:
        """What the report holds: the lines for `-v`, or for everybody where these say all."""
        lines = self.lines(end, words)
        told = [line for line in lines if line.verbose] or lines
        return Table([(line.head.rstrip(":"), f"{line.text}{line.tail}") for line in told])

    def marks(self, end: Collapse) -> Iterator[tuple[str, float, float]]:
        """Points on a capacity curve: text, displacement (m) and load factor."""
        yield from ()

    def write(self, folder: Path, view: BlockView, output: OutputOptions) -> None:
        """Write files of its own beside result.json, of blocks without a mesh.

        Args:
            folder: Where to, which is there.
            view: Of the collapse.
            output: What is asked for.

        Raises:
            OSError: If a file cannot be written.
        """
        return

    def in_bracket(self, end: Collapse) -> Answer:
        """The answer once the bracket of its collapse is known. Collective."""
        return self


def known_bounds(bounds: LimitBounds) -> LimitBounds:
    """Bounds that were solved for, as a program."""
    return bounds


#: Collapse states that are as far apart as this are told as two, relative.
ANOTHER = 1e-2
#: The program of a bracket of which nothing is known.
UNKNOWN = partial(known_bounds, LimitBounds(None, None))


def up_to(limit: float) -> Callable[[], LimitBounds]:
    """The program of a bracket of which the upper end alone is known."""
    return partial(known_bounds, LimitBounds(None, limit))


@dataclass(frozen=True, repr=False)
class Collapse:
    """One end of the range of load factors, or a state at a given one.

    Attributes:
        status: "limit", "unbounded", "not_converged", or "no_equilibrium" if none was found under
            the dead load alone, which moves the blocks as a mechanism. Of blocks without a mesh
            "unstable" where a motion proves that, and "equilibrium" of a given load factor.
        load_factor: lambda; nan if no state was found.
        program: Solves the rigid-block programs for the bracket of this end on rank 0. Collective.
        state: State reached, in the supports' coordinates; None if there is none.
        mode: v likewise, this rank's part; f_L.v = 1 with the live load as it acts. Without a mesh
            motions of blocks: velocities of centroids and rotations, shape (blocks, 6), scaled to a
            largest velocity of a corner of 1.
        joints: Forces, openings and slips of the joints in this state and mode.
        certificate: Verification of the state.
        history: Iterations for all states, at rising T.
        work_ratio: T in units of the live load's work on the bonded structure.
        path: Load factors with equilibrium, under load control.
        states: This one and others that were found and verified, where there are any.
        reason: Why there is no limit load, for people.
        wedging: Where nothing limits the load: forces (normal, shear) at all joint points that
            balance the live load alone, N/m for a load factor of 1, shape (2, points).
        attempts: What was tried, in order.
        trace: Points of the path that was followed, in order.
        rolling: Where a block has rolled on a curved side, for people; empty where none has.
        pressed: Where curved joints are pressed beyond their strength, for people, or empty.
        engine: What found it: the loading "path" of elastic blocks, or their "faces".
        way: "follow" where the kernel of faces followed the path, "half" where that came to no end
            and half of Coulomb's law to this; without a mesh also "one shot", and "convex"
            programs; else "".
        gap: Proved distance of the load factor from what the friction forces of its own state
            allow, relative; None where the path's certificate has it: see `as_state`.
        asked: Largest gap that was asked for.
        inside: What joint forces are proved to be inside of, in words.
        searched: What was searched for, in words; empty for a collapse that a load leads to.
        answers: What is known beside the load factor, by name; the values are attributes too:
            `collapse.answers["name"].value` is `collapse.name`, None where nothing was asked.
        sign: Of the live load: load factors have it, the program's bounds do not.
        force: Without a mesh: forces of the points along their contact's axes, N, (points, 3).
        tension: Likewise of the bars, N, shape (bars,).
        falling: Likewise numbers of blocks that fall, where there is no state; or that can wedge.
        given: Load factor of the state that was asked for; None for that of a limit.
        curve: Likewise states of the loading path at rising works.
        factorizations: Likewise of face systems.
        stopped: Likewise why the search was ended early; empty where it was not.
    """

    status: str = "not_converged"
    load_factor: LoadFactor = math.nan
    program: Callable[[], LimitBounds] = UNKNOWN
    state: State | None = None
    mode: Array | None = None
    joints: JointValues | None = None
    certificate: Certificate | None = None
    history: tuple[History, ...] = ()
    work_ratio: float = 0.0
    path: LoadPath | None = None
    states: tuple[CollapseState, ...] = ()
    reason: str = ""
    wedging: Array | None = None
    attempts: tuple[Trial, ...] = ()
    trace: tuple[TracePoint, ...] = ()
    rolling: str = ""
    pressed: str = ""
    engine: str = "path"
    way: str = ""
    gap: float | None = None
    asked: float = math.inf
    inside: str = "the friction cone"
    searched: str = ""
    answers: Mapping[str, Answer] = field(default_factory=dict)
    sign: LoadFactor = 1.0
    force: Array | None = None
    tension: Array | None = None
    falling: tuple[int, ...] = ()
    given: float | None = None
    curve: tuple[CapacityPoint, ...] = ()
    factorizations: int = 0
    stopped: str = ""

    def __getattr__(self, name: str) -> Any:
        """The value of an answer."""
        if name not in Answer.kinds:
            raise AttributeError(f"a collapse has no '{name}'")
        answer = self.answers.get(name)
        return None if answer is None else answer.value

    def with_answer(self, answer: Answer) -> Collapse:
        """With one answer more, or in place of another one of its kind."""
        known = {**self.answers, answer.name: answer}
        return replace(self, answers={name: known[name] for name in Answer.kinds if name in known})

    @property
    def told(self) -> list[Answer]:
        """The answers that say something of this collapse."""
        return [one for one in self.answers.values() if not (one.of_path and self.proof)]

    @property
    def changes_blocks(self) -> bool:
        """Whether its bracket is that of blocks that have changed on the way to it."""
        return any(one.changes_blocks for one in self.answers.values())

    def table(self) -> Table:
        """Load factor, bracket, and the gap or what is proved. Collective."""
        factor = self.load_factor
        if self.given is not None:
            return Table([("load factor that was asked for", alike(self.given, self.given))])
        if self.status == "unbounded":
            return Table([("load factor", "no limit")])
        is_limit = self.status == "limit"
        name = "load factor" if is_limit else "load factor reached, not verified"
        rows = [(name, "none" if math.isnan(factor) else alike(factor, factor))]
        if self.changes_blocks:
            rows.append(("bracket of the blocks with these joints torn", f"{self.bounds}"))
        else:
            rows += bracket_rows(self.bounds, self.sign, factor)
            if self.bounds.meet and is_limit:
                rows.append(("other collapse states", "none exists: the bracket is closed"))
        if is_limit and self.proof and self.state is not None:
            rows.append(("model", WITHOUT_PATH))
        return Table(rows)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.status}, load factor {self.load_factor:.8g}>"

    @property
    def size(self) -> float:
        """Load factor by which errors are divided."""
        return abs(self.load_factor) if self.certificate is None else self.certificate.size

    @property
    def residuals(self) -> Mapping[str, float]:
        """By how much the state misses each condition, relative; empty where none was verified."""
        return {} if self.certificate is None else self.certificate.residuals

    @property
    def as_state(self) -> CollapseState:
        """This end as one of several collapse states."""
        gap = self.residuals.get("limit") if self.gap is None else self.gap
        return CollapseState(self.way or self.engine, self.status, self.load_factor, gap)

    @property
    def digits(self) -> int:
        """Digits of the load factor that say something."""
        others = [state.load_factor for state in self.states]
        return meant(self.load_factor, self.as_state.gap or 0.0, others, self.size)

    @property
    def proof(self) -> str:
        """What is proved of a load factor by the forces of joint faces, in words; else empty."""
        if self.status == "equilibrium":
            return f"stands: forces in equilibrium and within friction {self.under}"
        if self.gap is None or self.certificate is None or math.isnan(self.load_factor):
            return ""
        limit = self.certificate.kinematic_factor
        return proof(self.load_factor, limit, self.inside, self.searched)

    @property
    def under(self) -> str:
        """Under which loads a given state is."""
        return f"under {self.given:.6g} times the live load" if self.given else DEAD

    @property
    def splitting(self) -> SplittingHistory | None:
        """Counts of a method on joint forces; None for other methods."""
        return self.history[-1].splitting if self.history else None

    @property
    def bounds(self) -> LimitBounds:
        """Bracket from the rigid-block programs, solved on rank 0 when first asked for. Collective.

        It is no part of the verification: the forces of a verified state are admissible in the
        associative program, and its mode takes at least the least friction there can be, so that
        a verified load factor is in its bracket as far as its residuals are zero.
        """
        return signed(self.program(), self.sign)

    @property
    def upper(self) -> float:
        """Nothing carries more of the live load; infinite where nothing is known. Collective."""
        ends = self.bounds.upper, self.bounds.lower
        end = ends[self.sign < 0.0]
        return math.inf if end is None else end

    def with_bracket(self) -> Collapse:
        """With its bracket solved for, and what that says of it; the status stays. Collective.

        The distance of a limit load from its bracket becomes a residual of the certificate: it
        checks the programs and the other residuals. Errors by the mesh do not lead out of the
        bracket. The load factor of a state that is none of equilibrium is left out if it is beyond.
        """
        bounds = self.bounds.rounded(self.size)
        known = replace(self, program=partial(known_bounds, signed(bounds, self.sign)))
        certificate = self.certificate
        if certificate is None:
            return known
        is_limit = self.status == "limit"
        # Equilibrium without a collapse may be below the lower end.
        lower = bounds.lower if is_limit else bounds.frictionless
        lower = -np.inf if lower is None else lower
        upper = np.inf if bounds.upper is None else bounds.upper
        # The lower end is that of exact states: those found are as near as was asked for.
        lower -= certificate.tolerance * certificate.size
        outside = max(lower - self.load_factor, self.load_factor - upper, 0.0)
        # Beyond what the state's own accuracy leaves, relative.
        gap = max(np.nan_to_num(certificate.error_estimate), self.gap or 0.0)
        outside = float(max(outside - gap, 0.0) / certificate.size)
        if not is_limit:
            beyond = self.status != "unbounded" and outside > 0.0
            return replace(known, load_factor=np.nan) if beyond else known
        residuals = {**certificate.residuals, "bracket": outside}
        known = replace(known, certificate=replace(certificate, residuals=residuals))
        return known.with_errors_in_bracket() if known.in_bracket else known

    @property
    def in_bracket(self) -> bool:
        """Whether the load factor is not known to be outside its bracket."""
        return self.certificate is None or "bracket" not in self.certificate.failures

    @property
    def contradiction(self) -> str:
        """Of a load factor: outside its bracket, with blocks that roll, with a large gap."""
        if self.in_bracket:
            wide = f"the gap is {self.gap}, above the {self.asked:g} asked for (solve.gap)"
            large = wide if (self.gap or 0.0) > self.asked else ""
            return "; ".join(filter(None, [self.rolling, large]))
        outside = f"the load factor {self.load_factor:.6g} is outside its bracket ({self.bounds})"
        return f"{outside}: one of them is wrong, do not rely on it"

    def held_against_bracket(self) -> Collapse:
        """As `with_bracket`; the status of a limit load outside its bracket is "not_converged"."""
        held = self.with_bracket()
        if held.in_bracket or self.status == "not_converged":
            return held
        return replace(held, status="not_converged", reason=held.contradiction)

    def with_errors_in_bracket(self) -> Collapse:
        """With answers that know of the bracket. Collective."""
        answers = {name: one.in_bracket(self) for name, one in self.answers.items()}
        return replace(self, answers=answers)


#: The reason where the rigid-block program has an equilibrium under the dead load, and the elastic
#: structure was not found to have one.
NOT_KNOWN = (
    "no equilibrium was found under the dead load alone, though rigid blocks with associative"
    " friction stand: not known, held by self-stress if at all"
)


@dataclass(frozen=True)
class ServiceState:
    """State at a given load factor.

    Attributes:
        status: "equilibrium" if it is verified. "no_equilibrium" if rigid blocks with associative
            friction prove that there is none, or if joint faces have no elastic state under the
            dead load alone (then `proved` is false); "unstable" if they prove it of the dead
            load alone and that was asked for. Else "not_converged".
        load_factor: As asked for.
        state: State found, in the supports' coordinates; None if there is none.
        joint_values: Forces, openings and slips of the joints; its rates are those of a motion
            along the displacements.
        residuals: What the state misses of equilibrium and joint laws, by name, relative.
        reason: Why there is no verified state, for people.
        fall: With status "unstable" the proof: rigid motions (a, b, c) of the bodies about their
            centres by which they fall, shape (bodies, 3); no joint resists them.
        engine: What found the state: the "path" of elastic blocks from rest, or the forces of their
            "faces", whose blocks are strained by these forces.
    """

    status: str
    load_factor: float
    state: State | None = None
    joint_values: JointValues | None = None
    residuals: Mapping[str, float] = field(default_factory=dict)
    reason: str = ""
    fall: Array | None = None
    engine: str = "path"

    @property
    def proved(self) -> bool:
        """Whether it is known that there is a state, or that there is none."""
        return self.status != "not_converged" and self.reason != NOT_KNOWN


class Shown(NamedTuple):
    """A state of a meshed scene, this rank's part in the supports' coordinates.

    Attributes:
        values: Of its joint points; None where there is no state.
        state: Displacements.
        mode: How it moves on in a collapse.
    """

    values: JointValues | None = None
    state: State | None = None
    mode: Array | None = None


class ByDirection(ABC):
    """Limit loads in one direction of the live load or both.

    Attributes:
        ends: By direction, "positive" first; empty if the dead load has no equilibrium.
        scene: That was solved.
        seconds: Time by phase, s.
        factorizations: Numeric factorisations in all.
        capacity: Points of the capacity curve; none if it was not traced.
        stopped: Why the run was ended early, for people; empty where it was not.
        ranks: How many ranks shared the mesh, or the tasks.
    """

    ends: Mapping[str, Collapse]
    scene: Any
    seconds: Mapping[str, float]
    factorizations: int
    capacity: tuple[CapacityPoint, ...]
    stopped: str
    ranks: int

    def __repr__(self) -> str:
        title = getattr(self.scene, "title", "")
        named = [repr(title)] if title else []
        factors = (f"load factor {end.load_factor:.8g}" for end in self.ends.values())
        return f"<{type(self).__name__}: {', '.join([*named, self.status, *factors])}>"

    @property
    def status(self) -> str:
        """Status of all ends; "unstable" if it is proved that the dead load does not stand."""
        found = {end.status for end in self.ends.values()}
        if not found:
            return "unstable"
        for status in ("unstable", "not_converged", "no_equilibrium"):
            if status in found:
                return status
        return found.pop() if len(found) == 1 else "limit"

    @property
    def limits(self) -> dict[str, Collapse]:
        """The ends that are limit loads."""
        return {name: end for name, end in self.ends.items() if end.status == "limit"}

    @property
    def positive(self) -> Collapse | None:
        """Collapse with the live load as given; None if not asked for."""
        return self.ends.get("positive")

    @property
    def negative(self) -> Collapse | None:
        """Collapse with the live load reversed; None if not asked for."""
        return self.ends.get("negative")

    @property
    def collapse(self) -> Collapse | None:
        """Collapse that fields show: the positive one if there is one."""
        return self.positive or self.negative

    @property
    def load_factor(self) -> float:
        """Limit load factor; infinite if unbounded, nan if there is none."""
        return float("nan") if self.positive is None else self.positive.load_factor

    @property
    def load_factor_negative(self) -> float:
        """Limit load factor with the live load reversed, not above 0; nan if not asked for."""
        return float("nan") if self.negative is None else self.negative.load_factor

    def __getattr__(self, name: str) -> Any:
        """The value of an answer of the collapse that fields show, by its name or its key.

        None where it was not asked for. Of answers by direction those of all limits, by direction.
        """
        for kind in Answer.kinds.values():
            if name in (kind.name, kind.key):
                if kind.by_direction:
                    found = {n: end.answers.get(kind.name) for n, end in self.limits.items()}
                    return {n: one.value for n, one in found.items() if one is not None}
                return None if self.collapse is None else getattr(self.collapse, kind.name)
        of_end = f"; result.positive.{name} is there" if name in dir(Collapse) else ""
        raise AttributeError(f"a result has no '{name}'{of_end}")

    @property
    def bounds(self) -> LimitBounds | None:
        """Bracket of the rigid-block programs for the collapse that fields show. Collective.

        It is solved for when it is first asked for, which may take as long as the limit load.
        """
        return None if self.collapse is None else self.collapse.bounds

    @property
    def residuals(self) -> Mapping[str, float]:
        """By how much each condition is missed, relative; empty where nothing was verified.

        That of the bracket is among them once it was solved for: `with_brackets`.
        """
        return {} if self._certificate is None else dict(self._certificate.residuals)

    @property
    def tolerances(self) -> Mapping[str, float]:
        """What each residual may be in a limit load; empty as `residuals`."""
        return {} if self._certificate is None else dict(self._certificate.tolerances)

    @property
    def _certificate(self) -> Certificate | None:
        # Nothing is proved by the last state of a load that is not limited.
        end = self.collapse
        return None if end is None or end.status == "unbounded" else end.certificate

    @property
    def states(self) -> tuple[CollapseState, ...]:
        """Collapse states that were found with their gaps, that of the path or by faces first."""
        return () if self.collapse is None else self.collapse.states

    def suffix(self, direction: str) -> str:
        """What names of files of a direction have behind them."""
        return "_negative" if direction == "negative" and len(self.ends) == 2 else ""

    @property
    @abstractmethod
    def wording(self) -> Wording:
        """How its load factors are told."""

    @property
    def curve_end(self) -> CurveEnd | None:
        """How complete the capacity curve is; None if it was not traced."""
        if not (self.collapse and self.capacity):
            return None
        return CurveEnd.of(self.capacity, self.collapse.load_factor)

    def reason(self, end: Collapse | None = None) -> str:
        """Why there is no limit load, of one end or at all, for people; empty where there is."""
        if end is not None:
            return end.reason
        return "; ".join(filter(None, dict.fromkeys(map(self.reason, self.ends.values()))))

    def mechanisms(self) -> dict[str, str]:
        """What moves in the collapse of each direction, in a sentence. Collective."""
        return {}

    @abstractmethod
    def ties_of(self, end: Collapse) -> Mapping[str, Any]:
        """What ties carry at one end, by name as of `tie_arrays`; empty without ties or forces."""

    def own_lines(self, end: Collapse, words: Wording) -> list[Line]:
        """What is told of one end beside answers and bracket: forces of ties."""
        return tension_lines(self.ties_of(end), words.units)

    @property
    def remarks(self) -> list[str]:
        """What is told of the whole result, in lines for everybody."""
        curve = self.curve_end
        return [str(curve)] if curve and (curve.not_found or not curve.on_plateau) else []

    @property
    def details(self) -> list[str]:
        """What `-v` tells beside that."""
        curve = str(self.curve_end)
        return [curve] if self.curve_end and curve not in self.remarks else []


@dataclass(frozen=True, repr=False, eq=False)
class Result(ByDirection):
    """Limit load of a scene, in one direction of the live load or both: data, and final.

    It can be pickled and copied; on several ranks each has its part of the fields.

    Attributes:
        layout: Scene, blocks, joints and supports as arrays.
        ends: Collapse by direction, "positive" first; empty if the dead load has no equilibrium.
        skipped: What the scene did not need and why, for people.
        seconds: Time by phase, s.
        factorizations: Numeric factorisations in all.
        mode_factorizations: Those of them that were of the blocks' modes only.
        cost: Of all factorisations, in units of one of the structure.
        capacity: Points of the capacity curve; none if it was not traced.
        passes: What was found on the way to the accuracy wished.
        inaccurate: Why that accuracy was not reached, for people; empty where it was.
        stopped: Why the run was ended early, for people; empty where it was not.
        ranks: How many ranks shared the mesh, or the tasks.
        fall: Without equilibrium under the dead load: rigid motions (a, b, c) of the bodies about
            their centres by which it falls, shape (bodies, 3); no joint resists them.
    """

    layout: Layout
    ends: Mapping[str, Collapse]
    skipped: tuple[str, ...]
    seconds: Mapping[str, float]
    factorizations: int
    mode_factorizations: int = 0
    cost: float = 0.0
    capacity: tuple[CapacityPoint, ...] = ()
    fall: Array | None = None
    passes: tuple[Pass, ...] = ()
    inaccurate: str = ""
    stopped: str = ""
    ranks: int = 1

    @property
    def scene(self) -> Scene:  # type: ignore[override]
        """Scene that was solved."""
        return self.layout.scene

    @property
    def wording(self) -> Wording:
        """How its load factors are told."""
        resultant = self.layout.bodies.live[:, :2].sum(axis=0)
        return wording_of(self.scene, resultant, both=len(self.ends) > 1)

    @property
    def falling(self) -> Indices:
        """Numbers of the blocks that fall under the dead load alone."""
        return falling_blocks(self.layout, self.fall)

    def wedged(self, end: Collapse) -> Indices:
        """Numbers of the blocks that wedge where nothing limits the load of one end."""
        size = np.zeros(len(self.layout.bodies.centre))
        if end.wedging is not None:
            force = np.abs(end.wedging).max(axis=0)
            for side in self.layout.joints.bodies.T:
                np.maximum.at(size, side[side != GROUND], force[side != GROUND])
        return large(size)

    def reason(self, end: Collapse | None = None) -> str:
        """Why there is no limit load, of one end or at all, for people; empty where there is."""
        if not self.ends:
            return fall_reason(self.layout, self.fall)
        if end is None or end.status != "unbounded":
            return super().reason(end)
        blocks = named_blocks(self.wedged(end), self.layout.centroid, "wedge")
        return f"nothing limits the live load: {blocks}"

    def own_lines(self, end: Collapse, words: Wording) -> list[Line]:
        """Forces of ties and soils."""
        return [
            *super().own_lines(end, words),
            *soil_lines(soil_forces(self.layout, end.joints), words.units),
        ]

    def ties_of(self, end: Collapse) -> NamedArrays:
        """What ties carry at one end."""
        return tie_arrays(self.layout, end.joints)

    @property
    def remarks(self) -> list[str]:
        """Whether curve and accuracy are complete, and warnings."""
        limits = self.limits.values()
        warnings = [text for end in limits for text in (end.pressed, end.contradiction) if text]
        found = [*super().remarks, *self._accuracy[-1:]]
        return found + [f"warning: {text}" for text in warnings]

    @property
    def details(self) -> list[str]:
        """What is not known of the model, the curve, the way to the accuracy."""
        return [
            *([WITHOUT_PATH] if any(end.proof for end in self.ends.values()) else []),
            *super().details,
            *self._accuracy[:-1],
        ]

    @property
    def _accuracy(self) -> list[str]:
        """What was found on the way to the accuracy wished, and whether it was reached."""
        lines = []
        for one in self.passes:
            hinges = ", point hinges" if one.hinges == "points" else ""
            estimate = "not known" if np.isnan(one.estimate) else f"{one.estimate:.1e}"
            lines.append(
                f"accuracy: {one.displacements} displacements of degree {one.degree}{hinges}:"
                f" load factor {one.load_factor:.6g}, error {estimate}"
            )
        if self.inaccurate:
            lines.append(f"the accuracy wished is NOT REACHED: {self.inaccurate}")
        return lines

    @property
    def tilt_angle(self) -> float | None:
        """Angle of a tilting table at the limit load, degrees; None where the load is another."""
        return self.scene.tilt_angle(self.load_factor)

    @property
    def soil(self) -> tuple[SoilForce, ...]:
        """What soils press with at the collapse that fields show."""
        end = self.collapse
        return soil_forces(self.layout, None if end is None else end.joints)

    def with_brackets(self) -> Self:
        """The result with all brackets solved for, and what they say; no status changes.

        Collective. The programs may take as long as the limit load.
        """
        return self._timed("bounds", Collapse.with_bracket)

    def hold_against_brackets(self) -> Self:
        """As `with_brackets`, without the limit loads that are outside: "not_converged".

        No verified one is, but for an error in the programs or in the verification. The command
        line asks for it before it says anything.
        """
        return self._timed("bounds", Collapse.held_against_bracket)

    @property
    def contradictions(self) -> tuple[str, ...]:
        """What is to be thought of load factors outside their brackets, for people."""
        return tuple(filter(None, (end.contradiction for end in self.ends.values())))

    def _timed(self, phase: str, change: Callable[[Collapse], Collapse]) -> Self:
        """The result with its ends changed, and the time that it took among those of a phase."""
        start = time.perf_counter()
        ends = {name: change(end) for name, end in self.ends.items()}
        seconds = self.seconds.get(phase, 0.0) + time.perf_counter() - start
        timed = {**self.seconds, phase: seconds}
        return replace(self, ends=ends, seconds=timed)


FIXED_POINT = "fixed point on the friction bound"


def skipped(scene: Scene) -> tuple[str, ...]:
    """Parts of the analysis that a scene spares, each with its reason."""
    laws = [*scene.joints.values(), *scene.foundations.values()]
    direction = scene.solve.direction
    output = scene.output
    other = "positive" if direction == "negative" else "negative"
    reasons = {
        f"{FIXED_POINT}: no joint has Coulomb friction": not any(law.friction for law in laws),
        "shear forces: no joint has friction": not any(
            law.friction or law.bound or law.cohesion for law in laws
        ),
        "dead tractions: none given": not scene.dead.traction,
        "dead body force: none given": not any(scene.dead.body),
        "live tractions: none given": not scene.live.traction,
        "live body force: none given": not any(scene.live.body),
        f"{other} direction: solve.direction = '{direction}'": direction != "both",
        "all but the load factor and its bracket: solve.fast = true": scene.solve.fast,
        f"load steps: {CRUSHING} have no loading path": (
            scene.has_strength and scene.solve.control == "load"
        ),
        "capacity curve: output.capacity = 0": not output.capacity,
        "stress recovery and ParaView files: output.paraview = false": not output.paraview,
        "pictures: output.pictures = false": not output.pictures,
    }
    return tuple(text for text, applies in reasons.items() if applies)


def skipped_iterations(histories: Sequence[History]) -> tuple[str, ...]:
    """Iterations that turned out not to be needed, by the histories of all states found."""
    if {(history.method, len(history.steps)) for history in histories} != {("monolithic", 1)}:
        return ()
    return (f"{FIXED_POINT}: the monolithic step alone found the state",)
