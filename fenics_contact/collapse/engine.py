"""Which engine finds a collapse: the loading path of elastic blocks, or the forces of their faces.

The path starts without stress and ends in an exact state. Below 100 blocks it is the answer. Where
joints crush, from 100 blocks on unless it soon comes to its end, and where it comes to none, the
face engine is: its state has a proved gap, and self-stress is free in it. From 100 blocks on the
engine is asked first, so that there is a state whenever the run is stopped.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from fenics_contact.collapse.face_collapse import face_collapse
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.results.history import alike_as_one
from fenics_contact.results.result import Collapse

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class EngineOptions:
    """When which engine is asked.

    Attributes:
        many: Blocks from which on the path has
        soon: so much, in units of one factorisation of the structure: about 20 bonded solves.
    """

    many: int = 100
    soon: float = 25.0


OPTIONS = EngineOptions()


def collapse_by_engine(case: LoadCase, by_path: Callable[[LoadCase], Collapse]) -> Collapse:
    """The collapse of a load case by the engine that its scene asks for, or that fits it.

    Raises:
        Stopped: If the run is to end; the record of the load case has what was found.
    """
    options = case.discretization.scene.solve
    crushes = case.blocks.crushes
    if options.engine == "faces" or (crushes and options.engine == "auto"):
        return face_collapse(case)
    if options.engine == "path" or options.method != "auto" or options.control != "work":
        return by_path(case)
    many = case.block_count >= OPTIONS.many
    found = face_collapse(case) if many and not options.fast else None
    if found is not None and found.status == "limit":
        case.record.best = found
    with case.discretization.effort.at_most(OPTIONS.soon if many else math.inf):
        end = by_path(case)
    if end.status == "limit" and found is not None and found.status == "limit":
        return replace(end, states=alike_as_one((end.as_state, found.as_state), end.size))
    if end.status != "not_converged":
        return end
    _log.info("  the path comes to no end; the forces of the faces are the answer")
    found = found or face_collapse(case)
    if found.status == "limit":
        return replace(found, history=end.history)
    return replace(end, reason="; ".join(filter(None, [end.reason, found.reason])))
