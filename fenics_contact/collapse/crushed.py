"""States of joints that crush, by the tangents of their strength at the states' own forces.

A face whose resultant is at its strength `m(N)` (`crushing`) is replaced by one that ends at the
inner end of its block of pressure: joint points beyond act there, between the two points next to
it, and the block less its force N0 at that place is part of the dead load. The face then obeys the
tangent of m at N0, and all solvers see a structure whose joints do not crush. A state is solved
for, N0 is replaced by its own N, and so on: Newton's method on a concave function. A tangent lies
above m(N) by (N - N0)^2 / (2 f_c), so a few states suffice.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

import numpy as np

from fenics_contact.collapse.load_case import LoadCase, joint_values
from fenics_contact.discretization.crushing import CrushedEnds, CrushedPlace, Crushing
from fenics_contact.discretization.joints import Joints
from fenics_contact.errors import SolverError
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.results.result import Collapse
from fenics_contact.solvers.problem import State

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class CrushedOptions:
    """Numbers of the search.

    Attributes:
        states: At most.
        cost: Factorisations at most of all states from one start, in units of the structure's.
        beyond: Moments beyond m(N) that count as none, in units of the largest force of a face
            times its length.
        slow: Part of the last N - N0 from which on one of the same sign is no progress: those of
            the regula falsi fall by half.
        narrow: Part of such an N - N0 below which the length of a bracket does not explain it.
        inside: A face crushes no longer whose moment is less than m(N) by this part of N L.
    """

    states: int = 15
    cost: float = 500.0
    beyond: float = 1e-7
    inside: float = 1e-4
    slow: float = 0.75
    narrow: float = 0.2


OPTIONS = CrushedOptions()


@dataclass(frozen=True)
class CrushedJoints:
    """A load case with some faces crushed at their ends.

    Attributes:
        whole: The load case with whole faces.
        case: The one with tangents in place of their strength.
        ends: Where they crush.
        shares: Shares in all joint points that the places have at which points act.
        force: Blocks of pressure less their forces N0, at all joint points, N/m.
    """

    whole: LoadCase
    case: LoadCase
    ends: CrushedEnds
    shares: Any
    force: Array

    @classmethod
    def of(cls, whole: LoadCase, crushing: Crushing, ends: CrushedEnds) -> CrushedJoints:
        """Crush a load case; `close` frees what it needs more."""
        joints = whole.discretization.joints
        points, shares, force = _tangents(joints, crushing, ends)
        if not len(points):
            return cls(whole, whole, ends, shares, force)
        made = whole.discretization.with_points_moved(points, shares, force)
        problem = replace(made.problem, live=whole.problem.live)
        stiffness = made.stiffness(whole.kind)
        blocks = whole.blocks.with_tangents(made.joints, force)
        parts = dict(discretization=made, problem=problem, stiffness=stiffness, blocks=blocks)
        case = replace(whole, crushed=ends, **parts)
        return cls(whole, case, ends, shares, force)

    def close(self) -> None:
        """Free the operators of the moved points."""
        if self.case is not self.whole:
            self.case.discretization.close()

    def forces(self, state: State) -> tuple[Array, Array]:
        """Normal and shear forces at all joint points of the whole faces, N/m."""
        gather = self.case.discretization.all_points
        pressure, shear = (gather(values) for values in (state.pressure, state.shear))
        return self.shares.T @ pressure + self.force, self.shares.T @ shear

    def missed(self, crushing: Crushing, state: State) -> float:
        """Largest moment beyond the strength of a face, in units of the largest N times L."""
        force, moment = crushing.resultants(self.forces(state)[0])
        beyond = np.maximum(crushing.excess(force, moment)[0], 0.0)
        size = force.max(initial=0.0) * np.where(crushing.given, crushing.length, 1.0)
        return float(np.max(np.divide(beyond, size, where=size > 0.0, out=np.zeros_like(beyond))))

    def mode_missed(self, crushing: Crushing, end: Collapse) -> float:
        """Power that turning faces lack of their strength's, relative to that of the live load.

        The motion is normal to m(N): a face turns at its strength only, (m(N) - |M|) |turn| = 0.
        """
        if end.state is None or end.mode is None:
            return float(np.inf)
        force, moment = crushing.resultants(self.forces(end.state)[0])
        slack = np.where(crushing.given, -crushing.excess(force, moment)[0], 0.0)
        opening = self.whole.discretization.all_points(self.whole.problem.normal @ end.mode)
        return float(np.sum(np.abs(slack * crushing.turns(opening)))) / end.size

    def places(self, crushing: Crushing) -> tuple[CrushedPlace, ...]:
        """Where the joints crush, the longest blocks of pressure first."""
        joints = self.whole.discretization.joints
        ends = self.ends
        found = []
        for face in np.flatnonzero((ends.side != 0.0) & (ends.force > 0.0)):
            points = np.flatnonzero(crushing.face == face)
            end = points[np.argmax(ends.side[face] * crushing.place[points])]
            length = float(ends.force[face] / crushing.strength[face])
            about = joints.names[joints.law[end]], length, float(ends.force[face])
            x, y = joints.position[end]
            found.append(CrushedPlace((float(x), float(y)), *about))
        return tuple(sorted(found, key=lambda one: -one.length))

    def on_joints(self, end: Collapse) -> Collapse:
        """A collapse with its forces at the joint points of the whole faces."""
        if end.state is None or end.mode is None or self.case is self.whole:
            return end
        state = self.state_on_joints(end.state)
        hinges = end.at_point_hinges
        values = joint_values(self.whole.problem, self.whole.discretization, state, end.mode)
        hinges = hinges and self.on_joints(hinges)
        return replace(end, state=state, joints=values, at_point_hinges=hinges)

    def state_on_joints(self, state: State) -> State:
        """A state with its forces at the joint points of the whole faces."""
        pressure, shear = self.forces(state)
        points = self.whole.discretization.operators.points
        return replace(state, pressure=np.maximum(pressure, 0.0)[points], shear=shear[points])


class _Found(Protocol):
    """What was found of a load case."""

    @property
    def state(self) -> State | None:
        """Its state, if there is one."""


Found = TypeVar("Found", bound=_Found)


def settle(
    case: LoadCase, first: CrushedEnds, solve: Callable[[LoadCase, Found | None], Found]
) -> tuple[Found, CrushedJoints, bool]:
    """State whose own forces are those at which its joints crush.

    Args:
        case: The load case with whole faces, some of which have a strength.
        first: Where faces are taken to crush at first.
        solve: Finds something with a state, next to what was found before if that is given.

    Returns:
        What was found last, the joints with which it was, and whether their forces are its own.
    """
    crushing = strengths(case)
    crushed = CrushedJoints.of(case, crushing, first)
    found = solve(crushed.case, None)
    renewal = _Renewal(crushing, first)
    for _ in range(OPTIONS.states):
        if found.state is None:
            return found, crushed, False
        ends = renewal.ends(crushed.ends, *crushing.resultants(crushed.forces(found.state)[0]))
        if ends is None:
            return found, crushed, True
        _log.info("  crushing: %d faces", np.sum(ends.side != 0.0))
        crushed.close()
        crushed = CrushedJoints.of(case, crushing, ends)
        found = solve(crushed.case, found)
    return found, crushed, False


class _Renewal:
    """Where faces crush, renewed by the forces of one state after another."""

    def __init__(self, crushing: Crushing, first: CrushedEnds) -> None:
        self._crushing = crushing
        self._released = np.zeros(len(first.side), dtype=bool)
        self._brackets = Brackets(len(first.side))

    def ends(self, before: CrushedEnds, force: Array, moment: Array) -> CrushedEnds | None:
        """Where faces crush by the N and M of a state; None if that is where they did before.

        Faces beyond their strength crush. Where there is none, those that are well within it crush
        no longer, each at most once.
        """
        length = self._crushing.length
        beyond, side = self._crushing.excess(force, moment)
        over = beyond > OPTIONS.beyond * force.max(initial=0.0) * length
        idle = beyond < -OPTIONS.inside * np.maximum(force, 0.0) * length
        idle &= (before.side != 0.0) & ~self._released
        if np.any(over):
            renewed = np.where(over, side, before.side)
            same = renewed == before.side
            carried = self._brackets.renewed(before.force, np.maximum(force, 0.0), same)
        elif np.any(idle):
            renewed = np.where(idle, 0.0, before.side)
            carried = before.force
            self._released = self._released | idle
        else:
            return None
        return CrushedEnds(renewed, np.where(renewed != 0.0, carried, 0.0))


class Brackets:
    """N0 of every face at which N > N0 and N < N0 was found, and N0 of the next state.

    That is N, which converges quadratically where forces change little with N0. At a stiff corner a
    small N0 lets a face open that carries much without: between two such N0 the next one is that of
    the regula falsi, with the Illinois weights (M. Dowell, P. Jarratt, BIT 11 (1971) 168).
    """

    def __init__(self, faces: int) -> None:
        """Begin without any."""
        self._ends = np.full((2, faces), np.nan)
        self._steps = np.zeros((2, faces))
        self._last = np.zeros(faces)

    def renewed(self, before: Array, force: Array, same: Flags) -> Array:
        """N0 of the next state, by that of the last one and its N; `same`: on the same side."""
        faces = np.arange(len(before))
        step = force - before
        end = (step < 0.0).astype(int)
        again = same & (step * self._last > 0.0)
        # An end at which other faces have changed the forces since is none.
        size = np.abs(step)
        slow = size >= OPTIONS.slow * np.abs(self._last)
        narrow = np.abs(self._ends[1 - end, faces] - before) < OPTIONS.narrow * size
        stale = ~same | (again & slow & narrow)
        self._ends[1 - end, faces] = np.where(stale, np.nan, self._ends[1 - end, faces])
        self._steps[1 - end, faces] *= np.where(again, 0.5, 1.0)
        self._ends[end, faces] = np.where(same, before, np.nan)
        self._steps[end, faces] = step
        self._last = np.where(same, step, 0.0)
        (low, high), (rises, falls) = self._ends, self._steps
        inside = low < high
        slope = np.where(inside, falls - rises, 1.0)
        return np.where(inside, (low * falls - high * rises) / slope, force)


def strengths(case: LoadCase) -> Crushing:
    """Strengths of the faces of a load case; raises `SolverError` where there are none."""
    if case.blocks.crushing is None:
        raise SolverError("no joint has a compressive strength")
    return case.blocks.crushing


def crushed_collapse(
    case: LoadCase, find: Callable[[LoadCase, Collapse | None], Collapse]
) -> tuple[Collapse, CrushedJoints]:
    """The collapse of a load case whose joints crush, and how they do.

    Joints crush at first as in the associative limit state of rigid blocks; where that leads to no
    collapse, nowhere. `find` finds a collapse, next to another one if that is given.
    """
    crushing = strengths(case)
    associative = _associative(case, crushing)
    whole = [CrushedEnds.none(crushing)] if np.any(associative.side) else []
    for first in (associative, *whole):
        with case.discretization.effort.at_most(OPTIONS.cost):
            found, crushed, _ = settle(case, first, find)
        end = certified(crushing, crushed, found)
        if end.status in ("limit", "unbounded"):
            return end, crushed
    return end, crushed


def certified(crushing: Crushing, crushed: CrushedJoints, end: Collapse) -> Collapse:
    """A collapse with what it misses of the strengths in its certificate, and what follows."""
    if end.state is None or end.certificate is None or end.status != "limit":
        return end
    residuals = {
        **end.certificate.residuals,
        "crushing": crushed.missed(crushing, end.state),
        "mode_crushing": crushed.mode_missed(crushing, end),
    }
    certificate = replace(end.certificate, residuals=residuals)
    end = replace(end, certificate=certificate)
    if certificate.passed:
        return replace(end, crushed=crushed.places(crushing), crushed_ends=crushed.ends)
    reason = "no state was found whose own forces are those at which its joints crush"
    return replace(end, status="not_converged", reason=reason)


@contextmanager
def crushed_like(case: LoadCase, end: Collapse) -> Iterator[LoadCase]:
    """A load case whose joints crush as in a collapse, found before on the same mesh."""
    if end.crushed_ends is None:
        yield case
        return
    crushed = CrushedJoints.of(case, strengths(case), end.crushed_ends)
    yield crushed.case
    crushed.close()


def _associative(case: LoadCase, crushing: Crushing) -> CrushedEnds:
    """Faces that turn, at their strength, in the associative limit state of rigid blocks."""
    pressure, motion = case.blocks.associative_collapse()
    if pressure is None or motion is None:
        return CrushedEnds.none(crushing)
    force, moment = crushing.resultants(pressure)
    beyond, side = crushing.excess(force, moment)
    turns = np.zeros(len(force), dtype=bool)
    turns[crushing.face] = case.blocks.turning(motion)
    crushes = turns & (force > 0.0) & (beyond > -OPTIONS.inside * force * crushing.length)
    return CrushedEnds(np.where(crushes, side, 0.0), np.where(crushes, force, 0.0))


def _tangents(joints: Joints, crushing: Crushing, ends: CrushedEnds) -> tuple[Indices, Any, Array]:
    """Points that act elsewhere, shares of all points, and the blocks of pressure less N0."""
    from scipy.sparse import coo_matrix

    count = len(joints.length)
    pairs = joints.neighbours
    face = crushing.face[pairs[:, 0]]
    among = (face == crushing.face[pairs[:, 1]]) & (ends.side != 0.0)[face]
    pairs = pairs[among]
    face = face[among]
    inner = crushing.tangent(ends.force, ends.side)[1]
    force = _block(crushing, ends, inner, pairs, face)
    number, at, share = _between(crushing, inner, pairs, face)
    carried = np.clip(ends.force, 0.0, crushing.carried)[face[number]]
    force -= np.bincount(at.ravel(), (carried[:, None] * share).ravel(), count)
    moves = ends.side[crushing.face] * (crushing.place - inner[crushing.face]) > 0.0
    points = np.flatnonzero(moves)
    stay = np.flatnonzero(~moves)
    pair = np.searchsorted(face[number], crushing.face[points])
    rows = np.concatenate([stay, np.repeat(points, 2)])
    columns = np.concatenate([stay, at[pair].ravel()])
    values = np.concatenate([np.ones(len(stay)), share[pair].ravel()])
    return points, coo_matrix((values, (rows, columns)), (count, count)).tocsr(), force


def _block(
    crushing: Crushing, ends: CrushedEnds, inner: Array, pairs: Indices, face: Indices
) -> Array:
    """Forces of the blocks of pressure on all joint points, N/m.

    They are those of the linear functions between the neighbours of every pair.
    """
    side = ends.side[face, None]
    place = crushing.place[pairs]
    covered = np.maximum(side * place, side * inner[face, None])
    length = np.ptp(covered, axis=1)
    share = _shares(ends.side[face] * covered.mean(axis=1), place)
    pressed = (crushing.strength[face] * length)[:, None] * share
    return np.bincount(pairs.ravel(), pressed.ravel(), len(crushing.face)).astype(float)


def _between(
    crushing: Crushing, inner: Array, pairs: Indices, face: Indices
) -> tuple[Indices, Indices, Array]:
    """Pair of neighbours between which every block ends, face by face; its points; their shares."""
    place = crushing.place[pairs]
    low = place.min(axis=1)
    high = place.max(axis=1)
    outside = np.maximum(np.maximum(low - inner[face], inner[face] - high), 0.0)
    order = np.lexsort((outside, face))
    number = order[np.flatnonzero(np.diff(face[order], prepend=-1))]
    return number, pairs[number], _shares(inner[face[number]], place[number])


def _shares(place: Array, ends: Array) -> Array:
    """Shares of both ends in places between them, shape (places, 2)."""
    second = (place - ends[:, 0]) / (ends[:, 1] - ends[:, 0])
    return np.column_stack([1.0 - second, second])
