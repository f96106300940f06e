"""Runs that end early: when, and what is known by then."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fenics_contact.collapse.load_case import LoadCase, joint_values
from fenics_contact.results.certificate import Certificate, state_residuals
from fenics_contact.results.result import Collapse


def within(
    seconds: float | None, asked: Callable[[], str] = lambda: "", spent: float = 0.0
) -> Callable[[], str]:
    """A function that says why a run is to end; empty while it may go on.

    Args:
        seconds: Time that it may take; None for any.
        asked: Who asks to end the run, in words; empty while nobody does.
        spent: Time that it took until now, s.
    """
    start = time.monotonic() - spent

    def reason() -> str:
        if seconds is not None and time.monotonic() - start >= seconds:
            return f"stopped after {seconds:g} s (solve.time)"
        somebody = asked()
        return f"stopped by {somebody}" if somebody else ""

    return reason


def unfinished(case: LoadCase, reason: str) -> Collapse:
    """What is known of a collapse whose search was stopped.

    That is the collapse, if a verified state was found; else the best state, or the last point of
    the path that was followed, which is no state yet.

    Args:
        case: The load case, with the record of the search.
        reason: Why it was stopped.
    """
    record = case.record
    problem = case.problem
    if record.best is not None and record.best.status == "limit":
        return record.best
    if record.best is not None:
        return replace(record.best, reason=reason)
    if record.last is None:
        return Collapse("not_converged", np.nan, case.blocks.bounds, reason=reason)
    state = record.last()
    scales = case.scales_at(abs(state.work), abs(state.load_factor))
    size = max(abs(state.load_factor), case.scales.load_factor)
    certificate = Certificate(state_residuals(problem, state, scales), np.nan, size=size)
    work = problem.dot(problem.live, state.displacement)
    mode = state.displacement / work if work > 0.0 else None
    values = None
    if mode is not None:
        values = joint_values(problem, case.discretization, state, mode)
    found = state, mode, values, certificate
    factor = state.load_factor
    bounds = case.blocks.bounds
    return Collapse("not_converged", factor, bounds, *found, reason=reason)
