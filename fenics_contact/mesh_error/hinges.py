"""Collapse states with shorter and shorter hinges, up to points.

At collapse blocks turn about single nodes. The force there presses a node in by an amount that
grows like log(1/h). Where the load factor depends on how joint forces share the load, it changes
like 1 / log(1/h): comparing meshes shows little of it. So the nodes of hinges get the compliance
of m further halvings of the elements there (`hinge_nodes`). The state found on the given mesh is
followed to larger m; each state may have new hinges. The largest m stands for point hinges.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.geometry.mesh import Flags, Indices
from fenics_contact.mesh_error.determinate import is_determinate
from fenics_contact.mesh_error.nearby import (
    Softened,
    Start,
    collapse_and_rate,
    from_afar,
    rates,
    same_mode,
    softer,
)
from fenics_contact.results.joint_values import Contact
from fenics_contact.results.mesh_error import StateChange
from fenics_contact.results.result import Collapse

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class HingeOptions:
    """Numbers of the way to point hinges.

    Attributes:
        ways: Halvings m of hinges, and what looks for their state, in this order: what is done
            unasked, and where the scene asks for the estimate. Fewer, and from the start, where
            none is near.
        enough: From so many halvings on the rest of the change is extrapolated: it falls like
            1 / (m + own). The second, where the scene asks for the estimate.
        own: Halvings of a block's height that lead to a hinge of the mesh, about; measured.
        unchanged: The load factor does not depend on hinges any more if it changes by less than
            this up to the next m, relative, or than the tolerance, and if that is `enough`: up to
            less, other points may not be loaded yet.
    """

    ways: tuple[tuple[tuple[float, Start], ...], ...] = (
        ((30.0, softer),),
        (
            *((30.0, softer), (4.0, softer), (30.0, softer), (30.0, from_afar), (4.0, from_afar)),
            *((30.0, softer), (100.0, softer), (100.0, from_afar), (100.0, softer)),
            *((1000.0, softer), (1e4, softer), (1e4, from_afar), (1e4, softer)),
        ),
    )
    enough: tuple[float, float] = (30.0, 100.0)
    own: float = 2.0
    unchanged: float = 1e-5


OPTIONS = HingeOptions()


@dataclass(frozen=True)
class Way:
    """Collapse states on the way to point hinges.

    Attributes:
        states: That of the mesh first.
        points: Hinges found up to each of them.
        halvings: m of each state.
        rate: d(lambda)/dm of the last state.
        changes: Changes of state.
        ended: Whether shorter hinges change nothing any more.
        independent: Whether that is known of the last state by statics, see `independent`; False
            also where it was not asked.
    """

    states: tuple[Collapse, ...]
    points: tuple[Indices, ...]
    halvings: tuple[float, ...] = (0.0,)
    rate: float = math.nan
    changes: tuple[StateChange, ...] = ()
    ended: bool = False
    independent: bool = False

    @property
    def complete(self) -> bool:
        """Whether the limit of point hinges is known."""
        known = self.halvings[-1] >= OPTIONS.enough[0] and not math.isnan(self.rate)
        return self.ended or known

    @property
    def rest(self) -> float:
        """Change of the load factor that is left, as c / (m + own) for m halvings."""
        return 0.0 if self.ended else self.rate * (self.halvings[-1] + OPTIONS.own)

    @property
    def last(self) -> tuple[Collapse, Indices, float]:
        """Last state, hinges, m."""
        return self.states[-1], self.points[-1], self.halvings[-1]

    def leads_to(self, halvings: float) -> bool:
        """Whether the last state is of less halvings, or shows hinges that have none yet."""
        if halvings != self.halvings[-1]:
            return halvings > self.halvings[-1]
        return len(self.points[-1]) > len(self.points[-2])

    def grown(self, new: Collapse, rate: float, found: Indices, halvings: float) -> Way:
        """With one more state."""
        last = self.states[-1]
        changes = self.changes
        if not _alike(last, new) or _turns_back(self.states, new):
            between = self.halvings[-1], halvings
            changes = (*changes, StateChange(between, last.load_factor, new.load_factor))
        points = (*self.points, np.union1d(self.points[-1], found))
        return Way((*self.states, new), points, (*self.halvings, halvings), rate, changes)


def determinate(case: LoadCase, end: Collapse, loaded: Flags | None = None) -> bool:
    """Whether statics alone give the load factor of a collapse, on all ranks alike."""
    whole = case.discretization
    found = not case.problem.coulomb or (
        end.joints is not None and is_determinate(whole.joints, end.joints, whole.bodies, loaded)
    )
    return bool(case.problem.comm.bcast(found))


def independent(case: LoadCase, end: Collapse) -> bool:
    """Whether the load factor does not depend on the joint forces of a state, as long as it lasts.

    Points without force do not count here.
    """
    return end.joints is not None and determinate(case, end, end.joints.contact != Contact.OPEN)


def to_point_hinges(case: LoadCase, way: Way, unchanged: float) -> Way:
    """States with more and more compliant hinges, as long as they change the load factor.

    The last m is that from which on the rest can be extrapolated, or, where a state is to be
    reported in place of that of the mesh, the largest.
    """
    whole = case.discretization
    options = whole.scene.solve
    asked = bool(options.error) or options.accuracy is not None
    ways = OPTIONS.ways[asked]
    enough = OPTIONS.enough[asked]
    if options.accuracy is not None:
        enough = ways[-1][0]
    tried: set[tuple[float, Start, int]] = set()
    for halvings, start in ways:
        task = halvings, start, len(way.states)
        if way.ended or halvings > enough or task in tried or not way.leads_to(halvings):
            continue
        if whole.effort.left < 1.0:
            _log.info("  %g halvings: beyond the limit of the estimate", halvings)
            break
        tried.add(task)
        last, points, _ = way.last
        new, rate = collapse_and_rate(case, last, Softened(points, halvings), start)
        if new.status != "limit" or new.joints is None:
            continue
        change = abs(new.load_factor - last.load_factor)
        if halvings >= OPTIONS.enough[0] and change <= unchanged * way.states[0].size:
            return replace(way, ended=True)
        way = way.grown(new, rate, new.joints.hinges(whole.joints.neighbours), halvings)
        alone = independent(case, new)
        way = replace(way, ended=alone, independent=alone)
    return way


def _alike(one: Collapse, other: Collapse) -> bool:
    """Whether the joints of two collapse states move alike."""
    if one.joints is None or other.joints is None:
        return False
    return same_mode(rates(one.joints), rates(other.joints))


def _turns_back(found: tuple[Collapse, ...], new: Collapse) -> bool:
    """Whether the load factor, which one state changes one way, goes back further than it came."""
    if len(found) < 2:
        return False
    before, last = (one.load_factor for one in found[-2:])
    came = last - before
    goes = new.load_factor - last
    return came * goes < 0.0 and abs(goes) > max(abs(came), OPTIONS.unchanged * found[0].size)
