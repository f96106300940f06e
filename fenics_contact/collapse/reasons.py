"""Why a limit load was not found, in words; when a run is stopped, and what is known by then."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from fenics_contact.collapse.load_case import LoadCase, joint_values
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.results.certificate import Certificate, state_residuals
from fenics_contact.results.result import Collapse

#: Methods in the order in which they are recommended.
METHODS = "auto", "fixed-point", "monolithic"
#: Attempts as people know them, by name.
ATTEMPTS = {
    "along block modes": "the path on block modes",
    "further along rising work": "the path from the last state",
    "along falling products": "the path of falling products",
    "next to another state": "the search next to the last state",
    "interior point": "the interior point method",
    "fixed point": "the fixed point on friction",
    "joint forces": "the method on joint forces",
}
#: Coefficients of friction above this one are rare, and hard to solve for.
HIGH_FRICTION = 1.5
#: Tolerance on the load factor that all methods reach.
USUAL_TOLERANCE = 1e-6


def explained(case: LoadCase, end: Collapse) -> Collapse:
    """A collapse with the record of its load case, and why it is none, if it is not converged."""
    record = case.record
    whole = case.discretization
    end = replace(end, attempts=tuple(record.attempts), trace=tuple(record.trace))
    if end.status != "not_converged":
        return end
    stopped = whole.effort.watch.reason
    if stopped and end.reason.startswith(stopped):
        parts = [end.reason]
        if end.trace:
            last = end.trace[-1]
            at = f"{case.sign * last.load_factor:.4g} at {1e3 * last.displacement:.3g} mm"
            parts.append(f"the path ({last.phase}) had come to load factor {at}")
        parts.append(_reached(end, case.sign))
        return replace(end, reason="; ".join([*parts, "try more time"]))
    limit = record.exhausted
    parts = [f"the search ended at its limit of {limit:g} factorisations"] if limit else []
    parts.append(end.reason or _reached(end, case.sign))
    # Attempts that found nothing, those of one kind together.
    lost = [trial for trial in end.attempts if not trial.found]
    for name in dict.fromkeys(trial.name for trial in lost):
        trials = [trial for trial in lost if trial.name == name]
        times = f"{len(trials)} times, the last one: " if len(trials) > 1 else ""
        parts.append(f"{ATTEMPTS.get(name, name)} found no state ({times}{trials[-1].outcome})")
    *first, last_cure = _cures(whole)
    cures = f"{', '.join(first)} or {last_cure}" if first else last_cure
    return replace(end, reason="; ".join([*parts, f"try {cures}"]))


def _reached(end: Collapse, sign: float) -> str:
    """The best state found, and what it misses."""
    if end.state is None or end.certificate is None:
        return "no state was found"
    if not end.history:
        return "no state was verified: the one given is the last point of the path"
    state = f"no state was verified: the best one, with load factor {sign * end.load_factor:.6g},"
    steps = end.history[-1].steps
    changes = ""
    if steps:
        change = f"{steps[-1].bound_change:.1e}"
        changes = f"still changes its friction by {change} after {len(steps)} iterations"
    if not end.certificate.passed:
        missed = f"{state} misses {end.certificate.missed}"
        return f"{missed}, and {changes}" if len(steps) > 1 else missed
    return f"{state} {changes or 'did not settle'}"


def _cures(whole: Discretization) -> Iterator[str]:
    """What may help, the easiest first."""
    scene = whole.scene
    options = whole.scene.solve
    if whole.warnings:
        yield "what the warnings say"
    if options.control == "load":
        yield "solve.control = 'work'"
    if options.engine == "path":
        yield "solve.engine = 'auto'"
    yield from (f"solve.method = '{name}'" for name in METHODS if name != options.method)
    if options.tolerance < USUAL_TOLERANCE:
        yield f"solve.tolerance = {USUAL_TOLERANCE:g}"
    laws = [*scene.joints.values(), *scene.foundations.values()]
    if any(law.gap for law in laws):
        yield "joints without gaps"
    if max((law.friction or 0.0 for law in laws), default=0.0) > HIGH_FRICTION:
        yield f"friction of at most {HIGH_FRICTION:g}"
    yield "a finer mesh"


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
    values = mode if mode is None else joint_values(problem, case.discretization, state, mode)
    found = state, mode, values, certificate
    bounds = case.blocks.bounds
    return Collapse("not_converged", state.load_factor, bounds, *found, reason=reason)
