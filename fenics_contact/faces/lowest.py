"""The lowest collapse state found: pairs of programs that go down from a certified state.

    state for a mode v:  min lambda   over states inside all cones with gap(N, v) <= eps lambda,
    mode for a state:    the limit with its own strengths, (a) of `certificate`,

in turn until the load factor stands. Self-stress of the blocks is free in these states: elastic
blocks may not reach them from rest. Not proved: that there is none lower.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_contact.faces.certificate import LEAST_GAP, Certifier, FaceState
from fenics_contact.faces.cones import Array
from fenics_contact.faces.kernel import Program, Row, elastic_response, solve
from fenics_contact.faces.limit import FaceSearch


@dataclass(frozen=True)
class LowestOptions:
    """Numbers of the search.

    Attributes:
        gap: eps, relative.
        allowed: Gap of a state at most, in units of eps.
        pairs: At most.
        stands: Change of the load factor, relative, below which it stands.
        part: Of the dead load's pressing forces, with which the bound begins, and
        theta: part of Coulomb's law in these steps, and
        steps: their number at most, until the forces change by
        settled: less than this part.
        start: Gap of the state to go down from, at most.
    """

    gap: float = 1e-4
    allowed: float = 1.5
    pairs: int = 10
    stands: float = 1e-4
    part: float = 0.3
    theta: float = 0.5
    steps: int = 6
    settled: float = 3e-2
    start: float = 1e-2


OPTIONS = LowestOptions()


def lowest_state(search: FaceSearch, options: LowestOptions = OPTIONS) -> FaceState | None:
    """The lowest state from the dead load's part of the bound; None without a start."""
    model = search.model
    response = elastic_response(model, search.equations)
    work = search.work
    pressed = options.part * np.maximum(model.normal(np.maximum(response.dead_force, 0.0)), 0.0)
    for _ in range(options.steps):
        state = search.elastic(options.theta, pressed, work, 1e-2)
        own = np.maximum(model.normal(state.force), 0.0)
        change = np.abs(own - pressed).sum() / max(own.sum(), 1e-300)
        pressed = own
        if change < options.settled:
            break
    certifier = Certifier(model, search.equations, options.start)
    start, _ = certifier.near(state, work, 2)
    return None if start is None else lowered(certifier, start, options)


def lowered(certifier: Certifier, start: FaceState, options: LowestOptions = OPTIONS) -> FaceState:
    """The lowest state that pairs of programs lead to from one."""
    model = certifier.model
    best = start
    mode = start.mode
    last = start.load_factor
    for _ in range(options.pairs):
        state = _least(certifier, mode, last, options)
        if state is None or state.gap > options.allowed * options.gap:
            break
        if state.load_factor < best.load_factor or best.gap > options.allowed * options.gap:
            best = state
        moved = abs(state.load_factor - last)
        last = state.load_factor
        if moved < options.stands * model.size(last):
            break
        next_mode = certifier.mode(state.force)
        if next_mode is None:
            break
        mode = next_mode.motion
    return best


def _least(
    certifier: Certifier, mode: Array, last: float, options: LowestOptions
) -> FaceState | None:
    """The state of least load factor with a small gap to a mode."""
    model = certifier.model
    power = model.power(mode)
    known = power.bound(model.strength)
    row = Row(-model.free_friction * power.slip, 1.0, known - options.gap * model.size(last))
    program = Program(
        model,
        certifier.equations,
        model.strength,
        model.friction,
        model.friction,
        -1.0,
        rows=(row,),
    )
    return certifier.state(solve(program, None, LEAST_GAP), mode)
