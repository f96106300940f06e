"""The lowest collapse state found: pairs of programs that go down from a certified state.

    state for a mode v:  min lambda   over states inside all cones with gap(N, v) <= eps lambda,
    mode for a state:    the limit with its own strengths, (a) of `certificate`,

in turn until the load factor stands. They lead from where they start to a state near it, so that
several starts are tried. Self-stress of the blocks is free in these states: elastic blocks may not
reach them from rest. Not proved: that there is none lower.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from fenics_contact.faces.certificate import LEAST_GAP, Certifier, FaceState
from fenics_contact.faces.cones import Array
from fenics_contact.faces.kernel import Iterate, Program, Row, Tolerances, solve
from fenics_contact.faces.limit import FaceSearch


@dataclass(frozen=True)
class LowestOptions:
    """Numbers of the searches.

    Attributes:
        gap: eps, relative.
        allowed: Gap of a state at most, in units of eps.
        pairs: At most.
        stands: Change of the load factor, relative, below which it stands.
        part: Of the dead load's pressing forces, with which the bound begins, and
        theta: part of Coulomb's law in these steps, and
        less: both of another start, from below most states, and
        steps: their number at most, until the forces change by
        settled: less than this part.
        rough: Relative gap of elastic states to start from.
        start: Gap of certified states to go down from, where that can be had.
        usual: Factorisations of one start at most, after which no other program is begun, and
        asked: where the user asks for the lowest state.
        friction: Part of it with which growing friction begins, and
        stages: its steps up to the whole, with products that fall as friction to the power
        power: of minus one over this, down to
        products: these in the end, in units of force times displacement.
    """

    gap: float = 1e-4
    allowed: float = 1.5
    pairs: int = 10
    stands: float = 1e-4
    part: float = 0.3
    theta: float = 0.5
    less: tuple[float, float] = (0.1, 0.3)
    steps: int = 6
    settled: float = 3e-2
    rough: float = 1e-2
    start: float = 1e-2
    usual: int = 150
    asked: int = 600
    friction: float = 0.25
    stages: int = 16
    power: float = 0.2
    products: float = 1e-3


OPTIONS = LowestOptions()

#: A start: elastic states, from rough to settled, each of which may be gone down from.
Start = Callable[[FaceSearch], Iterator[Iterate]]


def little_friction(search: FaceSearch) -> Iterator[Iterate]:
    """From a part of the friction under the dead load: it grows with the live load's forces."""
    model = search.model
    pressed = OPTIONS.part * search.dead_forces
    for step in range(OPTIONS.steps):
        state = search.elastic(OPTIONS.theta, pressed, search.work, OPTIONS.rough)
        own = np.maximum(model.normal(state.force), 0.0)
        change = float(np.abs(own - pressed).sum())
        pressed = own
        settled = change < OPTIONS.settled * float(own.sum())
        if step == 0 or settled or step == OPTIONS.steps - 1:
            yield state
        if settled:
            return


def less_friction(search: FaceSearch) -> Iterator[Iterate]:
    """The first of these steps with less friction: it is below most states."""
    part, theta = OPTIONS.less
    yield search.elastic(theta, part * search.dead_forces, search.work, OPTIONS.rough)


def coulomb(search: FaceSearch) -> Iterator[Iterate]:
    """The elastic state with Coulomb's law."""
    none = np.zeros(search.model.shape[0])
    yield search.elastic(1.0, none, search.work, OPTIONS.rough)


def growing_friction(search: FaceSearch) -> Iterator[Iterate]:
    """Friction grows as the products fall: low states are met first."""
    model, work = search.model, search.work
    unit = model.force * work / model.load
    state: Iterate | None = None
    for part in np.geomspace(OPTIONS.friction, 1.0, OPTIONS.stages).tolist():
        goal = OPTIONS.products * part ** (-1.0 / OPTIONS.power) * unit if part < 1.0 else 0.0
        program = Program(
            model,
            search.equations,
            part * model.strength,
            model.dilatancy + part * model.free_friction,
            model.dilatancy,
            work,
            elastic=True,
        )
        state = solve(
            program,
            state,
            Tolerances(OPTIONS.rough, 1e-5, 1e-3),
            enough=lambda iterate, goal=goal: iterate.mu < goal,  # type: ignore[misc]
        )
    if state is not None:
        yield state


#: Starts by name, the usual one first.
STARTS: dict[str, Start] = {
    "little friction": little_friction,
    "Coulomb's law": coulomb,
    "growing friction": growing_friction,
    "less friction": less_friction,
}


def lowest_from(search: FaceSearch, start: Start) -> FaceState | None:
    """The lowest state that one start leads to; None if it leads to none.

    Raises:
        Stopped: If the search is to end.
    """
    certifier = Certifier(search.model, search.equations, OPTIONS.start)
    for state in start(search):
        first, _ = certifier.near(state, search.work, 2)
        if first is None:
            continue
        found = lowered(search, certifier, first)
        if found.gap <= OPTIONS.allowed * OPTIONS.gap:
            return found
        if search.is_spent:
            return None
    return None


def lowered(search: FaceSearch, certifier: Certifier, start: FaceState) -> FaceState:
    """The lowest state that pairs of programs lead to from one, as long as the search may go on."""
    model = certifier.model
    best = start
    mode = start.mode
    last = start.load_factor
    for _ in range(OPTIONS.pairs):
        if search.is_spent:
            break
        state = _least(certifier, mode, last)
        if state is None or state.gap > OPTIONS.allowed * OPTIONS.gap:
            break
        if state.load_factor < best.load_factor or best.gap > OPTIONS.allowed * OPTIONS.gap:
            best = state
        moved = abs(state.load_factor - last)
        last = state.load_factor
        if moved < OPTIONS.stands * model.size(last):
            break
        next_mode = certifier.mode(state.force)
        if next_mode is None:
            break
        mode = next_mode.motion
    return best


def _least(certifier: Certifier, mode: Array, last: float) -> FaceState | None:
    """The state of least load factor with a small gap to a mode."""
    model = certifier.model
    power = model.power(mode)
    least = power.bound(model.strength) - OPTIONS.gap * model.size(last)
    row = Row(-model.free_friction * power.slip, 1.0, least)
    laws = model.strength, model.friction, model.friction
    program = Program(model, certifier.equations, *laws, -1.0, rows=(row,))
    return certifier.state(solve(program, None, LEAST_GAP), mode)
