"""How much of a load factor is due to the length of hinges, which is that of the mesh.

At collapse blocks turn about single nodes. The force there presses a node in by an amount that
grows like log(1/h). Where the load factor depends on how joint forces share the load, it changes
like 1 / log(1/h): comparing meshes shows little of it. So the nodes of hinges get the compliance
of m further halvings of the elements there (`hinge_nodes`). The state found on the given mesh is
followed to larger m; each state may have new hinges. In the limit of point hinges

    lambda(m) = lambda_0 + c / m,    m large.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, field, replace

import numpy as np

from fenics_contact.analysis.joint_values import Contact, JointValues
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.analysis.mesh_error import MeshError, StateChange
from fenics_contact.analysis.result import Collapse
from fenics_contact.analysis.strategy import COULOMB, WorkOptions, next_to
from fenics_contact.analysis.work_control import find_collapse
from fenics_contact.discretization.hinge_nodes import HingeNodes
from fenics_contact.discretization.joints import GROUND, Joints
from fenics_contact.mesh import Array, Indices
from fenics_contact.solvers.joint_stiffness import GENERAL
from fenics_contact.solvers.problem import Owner

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class HingeOptions:
    """Numbers of the estimate.

    Attributes:
        halvings: m, rising: with an incomplete set of hinges a large m leads to other states.
        probes: So many of them tell whether the load factor depends on hinges.
        tolerance: On the load factor of each state, relative.
        unchanged: It does not if these differ by less than this, relative.
        same_mode: Cosine of the angle between two modes that are those of one collapse state.
        more_work: The first work grows by this for each halving: hinges store elastic energy.
        dearest: The estimate is given up from so many times the factorisations of the collapse on.
        work: How the work grows from there: where no state is near, the estimate is given up.
    """

    halvings: tuple[float, ...] = (1.0, 4.0, 30.0, 1000.0)
    probes: int = 2
    tolerance: float = 1e-6
    unchanged: float = 1e-8
    same_mode: float = 0.9999
    more_work: float = 0.1
    dearest: float = 5.0
    work: WorkOptions = field(default_factory=lambda: WorkOptions(largest=1e3, missing=2))


OPTIONS = HingeOptions()


def estimate_mesh_error(case: LoadCase, end: Collapse, tolerance: float) -> MeshError:
    """What the load factor of a collapse owes to the length of its hinges.

    Args:
        case: The load case.
        end: Its collapse, with status "limit".
        tolerance: On the load factor, relative.
    """
    unknown = MeshError(math.nan, math.nan, math.nan)
    if end.joints is None:
        return unknown
    joints, points = case.discretization.joints, hinges(case.discretization.joints, end.joints)
    length = _length(joints, points, end.joints.normal_force)
    determinate = MeshError(length, end.load_factor, 0.0)
    size = abs(end.load_factor) if end.certificate is None else end.certificate.size
    # Where nothing slides the power balance has no forces of the state. What slides without force
    # on this mesh may have some on a finer one.
    slides = bool(np.any(end.joints.slips & ~end.joints.opens))
    if not case.problem.coulomb or not slides or not len(points):
        return determinate
    count, found, changes = case.discretization.factorizations, [end], []
    steps = [step for history in end.history for step in history.steps]
    most = count() + OPTIONS.dearest * sum(step.factorizations for step in steps)
    for halvings in OPTIONS.halvings:
        if count() > most:
            _log.info("  hinges: given up at %g halvings, too dear", halvings)
            return replace(unknown, hinge_length=length)
        new = _with_compliance(case, found[-1], points, halvings)
        if new.status != "limit" or new.joints is None:
            _log.info("  hinges: no state after %g halvings", halvings)
            return replace(unknown, hinge_length=length)
        if not _same_mode(found[-1], new) or _turns_back(found, new, size):
            before = (0.0, *OPTIONS.halvings)[len(found) - 1]
            factors = found[-1].load_factor, new.load_factor
            changes.append(StateChange((before, halvings), *factors))
        found.append(new)
        points = np.union1d(points, hinges(joints, new.joints))
        if len(found) == OPTIONS.probes + 1 and _unchanged(
            found, size, max(tolerance, OPTIONS.tolerance)
        ):
            return determinate
    limit, (before, last) = found[-1].load_factor, OPTIONS.halvings[-2:]
    if not changes or changes[-1].halvings[1] < last:
        limit += (limit - found[-2].load_factor) * before / (last - before)
    jumps = sum(change.after - change.before for change in changes)
    error = abs(limit - end.load_factor - jumps) / size
    return MeshError(length, limit, error, state_changes=tuple(changes))


def hinges(joints: Joints, values: JointValues) -> Indices:
    """Closed joint points whose neighbours along the joint all open in the collapse mode."""
    opens = values.opens
    has_neighbour, alone = np.zeros(len(opens), dtype=bool), np.ones(len(opens), dtype=bool)
    for ends in (joints.segments, joints.segments[:, ::-1]):
        has_neighbour[ends[:, 0]] = True
        alone[ends[~opens[ends[:, 1]], 0]] = False
    return np.flatnonzero(has_neighbour & alone & (values.contact != Contact.OPEN))


def _length(joints: Joints, points: Indices, force: Array) -> float:
    """Length of the element side at the most loaded of some joint points, m; nan without."""
    if not len(points):
        return math.nan
    worst = points[np.argmax(force[points])]
    one, other = joints.segments[(joints.segments == worst).any(axis=1)][0]
    return float(np.linalg.norm(joints.position[one] - joints.position[other]))


def _with_compliance(case: LoadCase, last: Collapse, points: Indices, halvings: float) -> Collapse:
    """The collapse next to another one, with the compliance of so many halvings at hinges."""
    if last.state is None:
        return last
    whole = case.discretization
    nodes = whole.joints.nodes[points]
    hinge_nodes = HingeNodes.of(whole, nodes[nodes != GROUND])
    first = max(last.work_ratio, OPTIONS.work.first * (1.0 + OPTIONS.more_work * halvings))
    usual = COULOMB["auto"]
    attempts = (next_to(last.state, last.mode), usual.attempts[0])
    work = replace(OPTIONS.work, first=first, first_of_many=0.0)
    strategy = replace(usual, attempts=attempts, work=work)
    with Owner() as owner:
        problem = hinge_nodes.soften(case.problem, halvings, owner)
        stiffness = owner.enter_context(whole.stiffness_with(problem.stiffness, GENERAL))
        silent = replace(case, kind=GENERAL, monitor=lambda step: None)
        softer = replace(silent, problem=problem, stiffness=stiffness)
        found = find_collapse(softer, strategy, OPTIONS.tolerance)
    _log.info("  hinges of %g halvings: load factor %.8g", halvings, found.load_factor)
    return found


def _same_mode(one: Collapse, other: Collapse) -> bool:
    """Whether the joints of two collapse states move alike."""
    first, second = (
        np.concatenate([end.joints.opening_rate, end.joints.slip_rate])
        for end in (one, other)
        if end.joints is not None
    )
    cosine = first @ second / (np.linalg.norm(first) * np.linalg.norm(second))
    return bool(cosine > OPTIONS.same_mode)


def _turns_back(found: list[Collapse], new: Collapse, size: float) -> bool:
    """Whether the load factor, which one state changes one way, goes back further than it came."""
    if len(found) < 2:
        return False
    before, last = (one.load_factor for one in found[-2:])
    came, goes = last - before, new.load_factor - last
    return came * goes < 0.0 and abs(goes) > max(abs(came), OPTIONS.unchanged * size)


def _unchanged(found: list[Collapse], size: float, tolerance: float) -> bool:
    """Whether load factors are equal, the first one to the tolerance on it, relative to `size`."""
    given, *others = (one.load_factor for one in found)
    same = max(others) - min(others) <= OPTIONS.unchanged * size
    return same and abs(others[0] - given) <= tolerance * size
