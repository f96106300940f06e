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
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.collapse.coulomb import settled
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.geometry.mesh import Flags
from fenics_contact.results.bounds import LoadFactor
from fenics_contact.results.result import Answer, Collapse
from fenics_contact.results.wording import Line, Wording, four
from fenics_contact.search_options import SEARCH

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class Torn:
    """Joints that have lost their strengths on the way to a collapse.

    Attributes:
        length_m: Length of joint that is torn, m.
        load_factor_whole: Load factor of the collapse with all strengths; nan if none was found.
    """

    length_m: float
    load_factor_whole: LoadFactor


class TornAnswer(Answer):
    """How much of the joints has torn, a `Torn`; None where no joint may lose its strength."""

    value: Torn
    name = key = "torn"
    place = 2
    changes_blocks = True

    def lines(self, end: Collapse, words: Wording) -> list[Line]:
        """How much has torn, and the load factor with all strengths."""
        torn = self.value
        if torn.length_m == 0.0:
            return [Line("torn:", "no joint that may lose its strength opens in the collapse")]
        whole = four(words.number(torn.load_factor_whole, end.sign))
        length = words.units.length(torn.length_m, 3)
        return [Line("torn:", f"{length} of joints have lost their strength; {whole} with all")]


def torn_collapse(
    case: LoadCase, collapse_of: Callable[[LoadCase], Collapse]
) -> tuple[Collapse, LoadCase]:
    """The collapse of a load case whose joints tear, and the case with those torn.

    `collapse_of` finds the collapse of joints that do not tear any more.

    Raises:
        Stopped: If the run is to end; the record of the load case has no state then.
    """
    joints = case.discretization.joints
    cases = [case]
    found: list[Collapse] = []

    def with_answer(end: Collapse, torn: Flags, whole: float) -> Collapse:
        return end.with_answer(TornAnswer(Torn(float(joints.length[torn].sum()), whole)))

    def collapse(torn: Flags) -> Collapse:
        if not np.any(torn):
            end = collapse_of(case)
            return with_answer(end, torn, end.load_factor)
        now = case.with_unbonded(torn)
        cases.append(now)
        now.record.best = None  # its joints were not torn yet
        whole = found[0].load_factor
        length = joints.length[torn].sum()
        _log.info("  torn: %.4g m of joints, load factor before %.8g", length, whole)
        if now.blocks.fall() is None:
            return with_answer(collapse_of(now), torn, whole)
        reason = f"without the bonds that tear at {whole:.6g} the blocks do not stand"
        nothing = Collapse("no_equilibrium", np.nan, now.blocks.bounds, reason=reason)
        return with_answer(nothing, torn, whole)

    def with_opened(torn: Flags, end: Collapse) -> Flags | None:
        found.append(end)
        if end.status != "limit" or end.joints is None:
            return None
        opens = end.joints.opens & joints.losing & ~torn
        return torn | opens if np.any(opens) else None

    first = np.zeros(len(joints.length), dtype=bool)
    with case.discretization.effort.at_most(SEARCH.iterated_cost):
        if settled(collapse, with_opened, first, SEARCH.bound_iterations):
            return found[-1], cases[-1]
    reason = f"joints go on tearing after {SEARCH.bound_iterations} collapses"
    return replace(found[-1], status="not_converged", reason=reason), cases[-1]
