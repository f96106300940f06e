"""What a structure in space carries along its loading path: the peak, and the capacity curve.

States of the path are elastic: rigid blocks on the springs of their contacts, whose stiffness is
that of Young's modulus over the size of a block. Each is held against blocks, contacts and laws.
"""

from __future__ import annotations

import logging
import math
from contextlib import suppress
from dataclasses import replace
from typing import Any, Self

import numpy as np

from fenics_contact.answers.peak import NO_PATH, PeakAnswer
from fenics_contact.answers.question import Asked
from fenics_contact.errors import SolverError
from fenics_contact.faces.follow import Followed
from fenics_contact.faces.kernel import FaceIterate
from fenics_contact.results.history import CapacityPoint, Peak
from fenics_contact.results.result import Collapse
from fenics_contact.scene.scene import SolveOptions
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.certificate import held_against
from fenics_contact.spatial.question import BlockQuestion
from fenics_contact.spatial.structure import Structure

#: The curve ends with so many times the work from which the path is as high as its end.
ONSET = 1.2

_log = logging.getLogger("fenics_contact")

NOT_VERIFIED = "the highest state of the path does not pass its verification"


class PathPeak(PeakAnswer):
    """The most that the path carries, if it is more than at its end."""

    asks = BlockQuestion
    begins = ""
    unless = ((lambda question: question.path is None, NO_PATH),)
    of_curve = False

    @classmethod
    def is_asked(cls, options: SolveOptions) -> bool:
        """Unless `fast` or its own option leaves it out."""
        return not options.fast and options.peak is not False

    @classmethod
    def concerns(cls, question: Any) -> bool:
        """Whether the collapse is the one that was searched for first."""
        return bool(question.end.way)

    @classmethod
    def run(cls, question: Any) -> tuple[Self | None, Collapse]:
        """The peak; of a path that was lost only if there is one."""
        structure, end = question.structure, question.end
        with np.errstate(all="ignore"):
            top = question.path.top(SEARCH.higher)
        if top is None:
            return cls(Peak("none")) if question.path.is_whole else cls.not_known(NO_PATH), end
        if not _is_verified(structure, top, end.sign):
            return cls.not_known(NOT_VERIFIED), end
        moved = _moved(question, top)
        return cls(Peak("found", end.sign * top.load_factor, math.nan, *moved)), end


class PathCurve(Asked):
    """States at rising works up to the collapse, where the path is as high as its end.

    What blocks carry as they move on is told by `motion.beyond`. Points are denser at first, where
    the path bends. Those that were not found, or are not verified, have nan.
    """

    asks = BlockQuestion
    place = 3
    with_fast = True

    @classmethod
    def concerns(cls, question: BlockQuestion) -> bool:
        """Whether the scene asks for a curve, which is that of the first direction."""
        first = question.end.sign > 0.0 or question.options.direction == "negative"
        return first and bool(question.end.way and question.scene.output.capacity)

    @classmethod
    def run(cls, question: BlockQuestion) -> tuple[Self | None, Collapse]:
        """The collapse with its curve."""
        path, structure, end = question.path, question.structure, question.end
        if path is None:
            _log.warning("warning: output.capacity: %s", NO_PATH)
            return None, end
        last = _plateau(path)
        count = question.scene.output.capacity
        points = []
        for part in (np.arange(1, count + 1) / count) ** 1.5:
            state: FaceIterate | None = None
            with np.errstate(all="ignore"), suppress(SolverError):
                state = path.state(last * part)
            if state is not None and _is_verified(structure, state, end.sign):
                work, moved = _moved(question, state)
                points.append(CapacityPoint(end.sign * state.load_factor, moved, work))
            else:
                work = float(last * part) / structure.young
                moved = work / _pushed(structure)
                points.append(CapacityPoint(math.nan, moved, work, converged=False))
        return None, replace(end, curve=tuple(points))


def _plateau(path: Followed) -> float:
    """The work from which the path is nearly as high as at its end, and a little more."""
    end = path.iterate.load_factor

    def is_away(load_factor: float) -> bool:
        return abs(load_factor - end) > SEARCH.rough_gap * abs(end)

    works = [path.path.work(place) for place in path.places]
    away = [k for k, place in enumerate(path.places) if is_away(place.load_factor)]
    flat = min(max(away, default=0) + 1, len(works) - 1)
    low, high = max(works[: flat + 1][:-1], default=0.0), max(works[: flat + 1])
    low = max(low, SEARCH.small_factor * high)
    with np.errstate(all="ignore"):
        while high > ONSET * low:  # steps of the path are long there
            middle = float(np.sqrt(low * high))
            try:
                far = is_away(path.state(middle).load_factor)
            except SolverError:
                break
            low, high = (middle, high) if far else (low, middle)
    return min(ONSET * high, works[-1])


def _moved(question: Any, state: FaceIterate) -> tuple[float, float]:
    """Work of the live load, N m, and the mean displacement along it, m."""
    work = abs(question.path.path.work(state)) / question.structure.young
    return work, work / _pushed(question.structure)


def _pushed(structure: Structure) -> float:
    """Sum of the forces of the live load, N; of its moments over a size where there are none."""
    forces = np.linalg.norm(structure.live[:, :3], axis=1).sum()
    moments = np.linalg.norm(structure.live[:, 3:], axis=1).sum() / structure.size
    return float(forces or moments)


def _is_verified(structure: Structure, state: FaceIterate, sign: float) -> bool:
    """Whether a state has next to no products, and its forces are within equilibrium and laws."""
    given = Collapse(given=sign * state.load_factor)
    held = held_against(structure, given, state.force)
    return state.gap <= SEARCH.gap and held.status == "equilibrium"
