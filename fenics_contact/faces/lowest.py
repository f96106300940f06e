"""The lowest collapse state that programs on face forces lead to.

Collapse states with Coulomb friction are not unique (M.C. Ferris, F. Tin-Loi, Int. J. Mech. Sci. 43
(2001) 209). Pairs of programs go down from certified states of several starts:

    state for a mode v:  min lambda   over states inside all cones with gap(N, v) <= eps lambda,
    mode for a state:    the limit with its own strengths, (a) of `certificate`,

in turn until the load factor stands. They lead from where they start to a state near it with a
proved gap. None proves that there is no lower one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_contact.faces.certificate import Certifier, FaceState, to_least_gap
from fenics_contact.faces.cones import Array
from fenics_contact.faces.kernel import Program, Row, solve
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.search_options import SEARCH

#: Starts, the usual one first: elastic states with a part theta of Coulomb's law, the rest of the
#: bound given by a part of the pressing forces under the dead load; and steps at most, in which
#: the state's own forces take their place where it leads to nothing.
STARTS: dict[str, tuple[float, float, int]] = {
    "little friction": (0.5, 0.3, 6),
    "Coulomb's law": (1.0, 0.0, 1),
    "less friction": (0.3, 0.1, 1),
}


#: The same, or a search with fewer points of the same blocks.
Start = tuple[float, float, int] | FaceSearch


def lowest_from(search: FaceSearch, start: Start) -> FaceState | None:
    """The lowest state that one start leads to; None if it leads to none.

    States with less friction are inside the cones, too: with much of it blocks only turn next to
    elastic states, and the modes of these allow no lower state.

    Raises:
        Stopped: If the search is to end.
    """
    certifier = Certifier(search.model, search.equations)
    if isinstance(start, FaceSearch):
        fewer = start.run()  # its mode is one of all points
        found = fewer and lowered(search, certifier, replace(fewer, gap=np.inf))
        return found if found and found.gap <= SEARCH.lower_state_gap else None
    if np.any(search.model.friction > SEARCH.start_friction):
        less = search.with_friction(SEARCH.start_friction)
        first = lowest_from(less, start)
        found = first and lowered(search, certifier, replace(first, gap=np.inf))
        search.equations.factorizations += less.equations.factorizations
        if found is not None and found.gap <= SEARCH.lower_state_gap:
            return found
    theta, part, steps = start
    pressed = part * search.dead_forces
    settled = False
    for step in range(steps):
        state = search.elastic(theta, pressed, search.work, SEARCH.rough_gap)
        own = np.maximum(search.model.normal(state.force), 0.0)
        settled = float(np.abs(own - pressed).sum()) < SEARCH.part_gap * float(own.sum())
        pressed = own
        if not (step == 0 or settled or step == steps - 1):
            continue
        first, _ = certifier.near(state, search.work)
        if first is not None and first.gap > SEARCH.rough_gap:
            again = certifier.of(first.force)
            first = again if again is not None and again.gap < first.gap else first
        found = None if first is None else lowered(search, certifier, first)
        if found is not None and found.gap <= SEARCH.lower_state_gap:
            return found
        if settled or (found is not None and search.is_spent):
            break
    return None


def lowered(search: FaceSearch, certifier: Certifier, start: FaceState) -> FaceState:
    """The lowest state that pairs of programs lead to from one, as long as the search may go on."""
    model = certifier.model
    best = start
    mode = start.mode
    last = start.load_factor
    for _ in range(SEARCH.face_rounds):
        if search.is_spent:
            break
        state = _least(certifier, mode, last)
        if state is None or state.gap > SEARCH.lower_state_gap:
            break
        if state.load_factor < best.load_factor or best.gap > SEARCH.lower_state_gap:
            best = state
        moved = abs(state.load_factor - last)
        last = state.load_factor
        if moved < SEARCH.side_accuracy * model.size(last):
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
    least = power.bound(model.strength) - SEARCH.side_accuracy * model.size(last)
    row = Row(-model.free_friction * power.slip, 1.0, least)
    laws = model.strength, model.friction, model.friction
    program = Program(model, certifier.equations, *laws, -1.0, rows=(row,))
    return certifier.state(solve(program, None, to_least_gap()), mode)
