"""Collapses of joints that lose tensile strength and cohesion where they open.

A joint with `opened = "lost"` has its strengths as long as it is closed. The collapse is found with
those of all joints. Then the points that open in its mode have lost theirs, and the collapse
without them is found, and so on:

    torn <- torn + points that open in the mode v of the collapse with the points torn so far.

Points are only added, so that this ends: with a state whose mode opens nothing but torn points, all
other points being as they were. What the structure carries on the way down to it, before the first
joint tears, is not looked for: it depends on stresses that no mesh tells without the energy that
tearing takes.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.collapse.engine import collapse_by_engine
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.geometry.mesh import Flags
from fenics_contact.results.history import Torn
from fenics_contact.results.result import Collapse

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class TornOptions:
    """Numbers of the search.

    Attributes:
        states: Collapses at most: walls tear along two or three mechanisms.
        cost: Of all of them, in units of one factorisation of the structure.
    """

    states: int = 20
    cost: float = 3000.0


OPTIONS = TornOptions()


def torn_collapse(case: LoadCase) -> tuple[Collapse, LoadCase]:
    """The collapse of a load case whose joints tear, and the case with those torn.

    Raises:
        Stopped: If the run is to end; the record of the load case has no state then.
    """
    joints = case.discretization.joints
    torn = np.zeros(len(joints.length), dtype=bool)
    end = collapse_by_engine(case)
    whole = end.load_factor
    with case.discretization.effort.at_most(OPTIONS.cost):
        for _ in range(OPTIONS.states):
            if end.status != "limit" or end.joints is None:
                return replace(end, torn=_about(case, torn, whole)), case
            opens = end.joints.opens & joints.losing & ~torn
            if not np.any(opens):
                return replace(end, torn=_about(case, torn, whole)), case
            torn = torn | opens
            case = case.with_torn(torn)
            about = _about(case, torn, whole)
            _log.info("  torn: %.4g m of joints, load factor before %.8g", about.length_m, whole)
            case.record.best = None  # its joints were not torn yet
            if case.blocks.fall() is not None:
                reason = f"without the bonds that tear at {whole:.6g} the blocks do not stand"
                nothing = Collapse("no_equilibrium", np.nan, case.blocks.bounds, reason=reason)
                return replace(nothing, torn=about), case
            end = collapse_by_engine(case)
    reason = f"joints go on tearing after {OPTIONS.states} collapses"
    return replace(end, status="not_converged", reason=reason, torn=about), case


def _about(case: LoadCase, torn: Flags, whole: float) -> Torn:
    """What a collapse says of the joint points that are torn."""
    return Torn(float(case.discretization.joints.length[torn].sum()), whole)
