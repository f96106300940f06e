"""What is known of a structure in space once its limit load was looked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from fenics_contact.answers.lowest import FOUND
from fenics_contact.answers.peak import PeakAnswer
from fenics_contact.answers.seismic import SeismicAnswer, SeismicCheck
from fenics_contact.faces.limit import FaceAttempt
from fenics_contact.geometry.mesh import Array
from fenics_contact.results.bounds import LimitBounds, counted, proof
from fenics_contact.results.history import CapacityPoint, Peak
from fenics_contact.results.result import NOT_KNOWN, ByDirection
from fenics_contact.results.values import NAMED
from fenics_contact.results.wording import DEAD, Line, Wording, meant, state_in_words
from fenics_contact.scene.units import Units
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.loads import lifted
from fenics_contact.spatial.structure import Structure

#: Collapse states that are as far apart as this are told as two, relative.
ANOTHER = 1e-2
#: What forces at the corners of contacts leave out.
QUICK = "torsion is not limited: contacts have forces at their corners alone (solve.quick)"


@dataclass(frozen=True)
class SpatialCollapse:
    """The limit of one direction of the live load.

    Attributes:
        status: "limit", "unbounded", "unstable", "not_converged", or of a state under given loads
            "equilibrium".
        load_factor: That of a state inside all laws; nan without one.
        gap: Proved distance to what its own friction forces allow, over `size`.
        size: Of the load factor, by which gaps are divided: 1 % of a typical one at least.
        upper: Nothing carries more with any friction forces; infinite where nothing is known.
        mode: Motions of all blocks in the collapse: velocities of centroids and rotations, shape
            (blocks, 6), scaled to a largest velocity of a corner of 1; None without a limit.
        force: Forces of the points along their contact's axes, N, shape (points, 3).
        tension: Of the bars, N, shape (bars,).
        lowest: Load factor of the lowest collapse state found; nan where none was looked for.
        sign: Of the live load.
        reason: Why there is no limit.
        falling: Numbers of blocks that fall, where there is none; or that can wedge, so that no
            load is excluded.
        given: Load factor of the state that was asked for; None for that of a limit.
        residuals: By how much each condition is missed, see `certificate`.
        searched: What was searched for, in words; empty for what the load leads to.
        way: How the state was reached: "follow", the loading path; "half" of Coulomb's law; "one
            shot"; "convex" programs; empty without a limit.
        states: Collapse states that were found, the first one first: load factor, gap, way.
        peak: The most that the loading path carries; None where that was not asked for.
        curve: States of the loading path at rising works.
        seismic: Spectral acceleration at which it starts; None where that was not asked for.
        attempts: What was tried.
        factorizations: Of face systems.
        stopped: Why the search was ended early; empty where it was not.
    """

    status: str = "not_converged"
    load_factor: float = np.nan
    gap: float = np.nan
    size: float = np.nan
    upper: float = np.inf
    mode: Array | None = None
    force: Array | None = None
    tension: Array | None = None
    lowest: float = np.nan
    sign: float = 1.0
    reason: str = ""
    falling: tuple[int, ...] = ()
    given: float | None = None
    residuals: dict[str, float] = field(default_factory=dict)
    searched: str = ""
    way: str = ""
    states: tuple[tuple[float, float, str], ...] = ()
    peak: Peak | None = None
    curve: tuple[CapacityPoint, ...] = ()
    seismic: SeismicCheck | None = None
    attempts: tuple[FaceAttempt, ...] = ()
    factorizations: int = 0
    stopped: str = ""

    @property
    def told(self) -> list[PeakAnswer]:
        """Answers that pictures mark."""
        return [] if self.peak is None else [PeakAnswer(self.peak)]

    @property
    def bounds(self) -> LimitBounds:
        """What is known of all collapse states."""
        known = None if math.isinf(self.upper) and self.status != "unbounded" else self.upper
        return LimitBounds(None, known) if self.sign > 0.0 else LimitBounds(known, None)

    @property
    def digits(self) -> int:
        """Digits of the load factor that say something."""
        others = [state[0] for state in self.states]
        return meant(self.load_factor, self.gap, others, self.size)

    @property
    def limit(self) -> float:
        """With the friction forces of this state nothing carries more."""
        return self.load_factor + self.sign * self.gap * self.size


@dataclass(frozen=True)
class SpatialWording(Wording):
    """How load factors of a scene in space are told.

    Attributes:
        direction: Of the live load's acceleration.
    """

    direction: tuple[float, ...] = ()

    def way(self, direction: str) -> str:
        """Where the live load pushes."""
        if self.acceleration is None:
            return super().way(direction)
        vector = np.array(self.direction) * (-1.0 if direction == "negative" else 1.0)
        axis = int(np.argmax(np.abs(vector)))
        if np.abs(vector).sum() - abs(vector[axis]) < 1e-6:
            return f"along {'+' if vector[axis] > 0.0 else '-'}{'xyz'[axis]}"
        if abs(vector[2]) < 1e-6:
            degrees = math.degrees(math.acos(vector[0]))
            return f"at {degrees:.3g} degrees from +x towards {'+' if vector[1] > 0.0 else '-'}y"
        return f"along ({', '.join(f'{part + 0.0:.3g}' for part in vector)})"


def wording_of(scene: Any, structure: Structure, both: bool) -> Wording:
    """How the load factors of a scene are told; `scene` is None for a structure alone."""
    resultant = structure.live[:, :3].sum(axis=0).tolist()
    if scene is None:
        return SpatialWording(Units("SI", 1.0), load=math.hypot(*resultant), both=both)
    push = lifted(scene.live.acceleration)
    along = push / (np.linalg.norm(push) or 1.0)
    if structure.dimension == 2:
        along = np.eye(3)[0]
    loads = {}
    for name in ("dead", "live"):  # in the upright plane of the push
        load = getattr(scene, name)
        body, *tractions = (
            (float(vector @ along), float(vector[2]))
            for vector in map(lifted, (load.acceleration, *load.traction.values()))
        )
        traction = dict(zip(load.traction, tractions, strict=True))
        loads[name] = {**vars(load), "body": body, "traction": traction}
    floors = {name: vars(floor) for name, floor in scene.floors.items()}
    asked = {name for name, value in vars(scene.solve).items() if value is True}
    more = {"both": both, "asked": asked}
    if structure.dimension == 2:
        return Wording.of(loads, floors, resultant, scene.units, **more)
    more["direction"] = tuple(along.tolist())
    return SpatialWording.of(loads, floors, resultant, scene.units, **more)


@dataclass(frozen=True, repr=False)
class SpatialLimit(ByDirection[SpatialCollapse]):
    """Limit loads of a structure in space.

    Attributes:
        scene: What was asked for.
        structure: Its blocks, contacts and loads.
        ends: Collapse by direction, "positive" first.
        seconds: By what they were spent on.
        ranks: How many ranks shared the tasks.
    """

    scene: Any
    structure: Structure
    ends: dict[str, SpatialCollapse]
    seconds: dict[str, float] = field(default_factory=dict)
    ranks: int = 1

    @property
    def factorizations(self) -> int:
        """Of face systems."""
        return sum(collapse.factorizations for collapse in self.ends.values())

    @property
    def stopped(self) -> str:
        """Why the run was ended early; empty where it was not."""
        return next((c.stopped for c in self.ends.values() if c.stopped), "")

    @property
    def wording(self) -> Wording:
        """How its load factors are told."""
        return wording_of(self.scene, self.structure, both=len(self.ends) > 1)

    def reason(self) -> str:
        """Why there is no limit load, of one direction or at all; empty where there is."""
        return "; ".join(dict.fromkeys(c.reason for c in self.ends.values() if c.reason))

    def summary(self, verbose: bool = False) -> str:
        """The answer in three to five lines; with all that is known of it, if that is wished."""
        found, more = self.answer(self.wording)
        return "\n".join([*found, *more, *(["", *self._details()] if verbose else [])])

    def answer(self, words: Wording) -> tuple[list[str], list[str]]:
        """The collapse, or why none is known; and what else was asked, in lines for people."""
        amounts: dict[str, list[str]] = {}
        told: list[tuple[str, Line]] = []
        limits = self.limits
        for name, collapse in limits.items():
            head = f"{collapse.searched}:" if collapse.searched else "it collapses at"
            amounts.setdefault(head, []).append(
                words.amount(collapse.load_factor, name, collapse.digits)
            )
            told += [(name, line) for line in _lines(collapse, words, self.structure)]
        found = [f"{head} {', '.join(parts)} (verified)" for head, parts in amounts.items()]
        others = {n: c for n, c in self.ends.items() if n not in limits}
        found += dict.fromkeys(_without_limit(n, c, words) for n, c in others.items())
        return found, words.together(told, limits) + [QUICK] * self.structure.quick

    def _details(self) -> list[str]:
        """Proofs, residuals, what was tried, and time."""
        lines = []
        for name, collapse in self.ends.items():
            lines.append(f"load factor ({name}) = {collapse.load_factor:.8g}, {collapse.status}")
            if collapse.status == "limit":
                lines.append(collapse_proof(collapse))
                told = ", ".join(f"{k} {v:.0e}" for k, v in collapse.residuals.items())
                lines.append(f"verified from blocks and contacts: {told.replace('_', ' ')}")
            for one in collapse.attempts:
                tried = f"load factor {one.load_factor:.6g}, gap {one.gap:.1e}"
                lines.append(f"tried: {one.name}: {tried}, {one.factorizations} factorisations")
        total = self.seconds.get("total", 0.0)
        return [*lines, f"{counted(self.factorizations, 'factorisation')}, {total:.2f} s"]


def _without_limit(name: str, collapse: SpatialCollapse, words: Wording) -> str:
    """What is known where no limit load was found, in a sentence."""
    if collapse.given is not None:
        at = f"at {words.at(collapse.given)}" if collapse.given else DEAD
        proved = collapse.status != "no_equilibrium"
        told = state_in_words(collapse.status, at, collapse.reason, proved)
        return f"{told}: {collapse.reason}" if not proved and collapse.reason != NOT_KNOWN else told
    way = f" {words.way(name)}".rstrip()
    if collapse.status == "unbounded":
        what, _, blocks = collapse.reason.partition(": ")
        return f"{what}{way}: {blocks}"
    most = words.amount(collapse.upper, name) if math.isfinite(collapse.upper) else ""
    return f"no collapse was found{way}: {collapse.reason}" + f"; at most {most}" * bool(most)


def collapse_proof(collapse: SpatialCollapse) -> str:
    """What is proved of a limit, in a sentence."""
    return proof(collapse.load_factor, collapse.limit, "friction", collapse.searched)


def _lines(collapse: SpatialCollapse, words: Wording, structure: Structure) -> list[Line]:
    """Other states and bounds of a limit, and its seismic check."""
    lines = []
    factor = collapse.load_factor
    if math.isfinite(collapse.lowest) and not collapse.searched:
        lower = abs(collapse.lowest) < abs(factor) * (1.0 - 2e-3)
        text = words.beside(collapse.lowest, factor, collapse.sign) if lower else "this one"
        lines.append(Line(f"{FOUND}:", text, states=True))
    for other, _, _ in collapse.states[1:]:
        if abs(other - factor) > ANOTHER * abs(factor) and not collapse.searched:
            lines.append(
                Line("also found:", words.beside(other, factor, collapse.sign), states=True)
            )
    if math.isfinite(collapse.upper):
        most = words.beside(collapse.upper, factor, collapse.sign, 1)
        lines.append(Line("nothing carries more than", most, states=True))
    elif collapse.falling:
        blocks = named(structure, collapse.falling, "wedge")
        lines.append(Line("no load is excluded:", blocks, states=True))
    beyond = collapse.residuals.get("crushing", 0.0)
    if beyond > SEARCH.verified:
        text = f"a contact exceeds its strength by {beyond:.0e} of the largest load on a block"
        lines.append(Line("crushing:", text))
    for answer in collapse.told:
        lines += answer.lines(cast(Any, collapse), words)
    if collapse.seismic is not None:
        lines += SeismicAnswer(collapse.seismic).lines(cast(Any, collapse), words)
    return [line for line in lines if not line.verbose]


def named(structure: Structure, numbers: Sequence[int], does: str) -> str:
    """Blocks by name, as far as a line has room, and what they do."""
    names = [structure.blocks[k].name or str(k) for k in numbers]
    if len(names) == 1:
        return f"block {names[0]} {does}s"
    rest = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"blocks {', '.join(names[:NAMED])}{rest} {does}"
