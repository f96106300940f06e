"""The motion that follows a state, its collapse mode, and the certificate of both.

As the work T of the live load grows, du/dT = A^-1 f_L / (f_L . A^-1 f_L) with A as in `kkt`. At the
limit load it is the collapse mode. Where it is not, with slow elastic motions mixed in, or singular
in its sliding joints, the rigid-block program with the friction forces of the state has one.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace

import numpy as np

from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.errors import SolverError
from fenics_contact.results.certificate import (
    Certificate,
    certify,
    kinematic_factor,
    state_residuals,
    tolerances,
)
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.kkt import PerturbedKKT
from fenics_contact.solvers.problem import Array, Scales, State

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class Verified:
    """A state, its mode v with f_L.v = 1 in the supports' coordinates, and their certificate."""

    state: State
    mode: Array
    certificate: Certificate


def is_collapse(case: LoadCase, state: State, scales: Scales, tolerance: float, gap: float) -> bool:
    """Whether a state passes its certificate, with its elastic mode and no more than a gap.

    A state of equilibrium that misses the joint laws has no mode looked for.
    """
    allowed = tolerances()
    missed = state_residuals(case.problem, state, scales)
    if not all(value <= allowed[name] for name, value in missed.items()):
        return False
    try:
        certificate = _by_elastic_mode(case, state, scales, tolerance).certificate
    except SolverError:
        return False
    return certificate.passed and certificate.gap <= gap


def _certified(
    case: LoadCase, state: State, mode: Array, scales: Scales, rigid_limit: float, tolerance: float
) -> Verified:
    points = case.discretization.operators.points
    certificate = certify(case.problem, state, mode, scales, rigid_limit, points)
    return Verified(state, mode, replace(certificate, tolerance=tolerance))


def _by_elastic_mode(case: LoadCase, state: State, scales: Scales, tolerance: float) -> Verified:
    """The certificate with the motion that follows; `SolverError` where there is none."""
    kkt = case.coulomb(state.work, scales)
    mode = rates(kkt, state)[0]
    # It bounds the limit for the state's friction from above, the state's forces from below.
    limit = kinematic_factor(case.problem, state, mode)
    return _certified(case, state, mode, scales, limit, tolerance)


def verify(case: LoadCase, state: State, scales: Scales, tolerance: float, gap: float) -> Verified:
    """The collapse mode of a state, and their certificate.

    The tolerance is that on the load factor, relative. Up to `gap` between load factor and
    rigid-block program an elastic mode is enough.
    """

    def certified(mode: Array, rigid_limit: float) -> Verified:
        return _certified(case, state, mode, scales, rigid_limit, tolerance)

    best: Verified | None = None
    try:
        best = _by_elastic_mode(case, state, scales, tolerance)
    except SolverError as error:
        _log.info("  no elastic mode: %s", error)
    passed = best is not None and best.certificate.mode_passed
    if best is not None and passed and best.certificate.gap <= gap:
        confirmed = replace(best.certificate, static_factor=state.load_factor)
        return replace(best, certificate=confirmed)
    strength = case.discretization.all_points(case.problem.law.given(state.pressure))
    limit, motion = None, None
    try:
        limit, motion = case.blocks.collapse(strength)
    except SolverError as error:
        _log.info("  no rigid mode: %s", error)
        if best is not None and passed:
            return best
    rigid_limit = np.nan if limit is None else limit
    if best is not None:
        best = certified(best.mode, rigid_limit)
        if best.certificate.mode_passed or motion is None:
            return best
    if motion is None:
        motion = np.zeros((case.block_count, 3))  # certifies nothing
    return certified(case.discretization.rigid_motion(motion), rigid_limit)


def rates(kkt: PerturbedKKT, state: State) -> tuple[Array, float]:
    """du/dT, with f_L . du/dT = 1, and d(lambda)/dT = 1 / (f_L . A^-1 f_L) at a state.

    By the conditions `kkt`, with or without given bound.

    Raises:
        SolverError: If A is singular.
    """
    near = kkt.on_central_path(state, SEARCH.mode_products, SEARCH.digits)
    # No forces arise in a mechanism: a moderate cap lets nothing penetrate and keeps digits.
    spring = SEARCH.mode_products
    options = replace(SEARCH, largest_spring=SEARCH.mode_spring, sliding_spring=spring)
    linear = replace(kkt, options=options).linearize(near)
    return linear.live_response / linear.flexibility, 1.0 / linear.flexibility
