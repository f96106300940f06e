"""Why a limit load was not found, in words, from the record of what was tried."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.results.certificate import Certificate
from fenics_contact.results.history import Trial
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
        parts = [end.reason, *_came_to(end, case.sign), _reached(end, case.sign)]
        cures = "more time"
    else:
        limit = record.exhausted
        ended = [f"the search ended at its limit of {limit:g} factorisations"] if limit else []
        parts = [*ended, end.reason or _reached(end, case.sign), *_tried(end.attempts)]
        cures = _either(_cures(whole))
    return replace(end, reason="; ".join([*parts, f"try {cures}"]))


def _came_to(end: Collapse, sign: float) -> Iterator[str]:
    """Where the path ended."""
    if end.trace:
        last = end.trace[-1]
        factor = sign * last.load_factor
        moved = 1e3 * last.displacement
        yield f"the path ({last.phase}) had come to load factor {factor:.4g} at {moved:.3g} mm"


def _reached(end: Collapse, sign: float) -> str:
    """The best state found, and what it misses."""
    if end.state is None or end.certificate is None:
        return "no state was found"
    if not end.history:
        return "no state was verified: the one given is the last point of the path"
    state = f"no state was verified: the best one, with load factor {sign * end.load_factor:.6g},"
    if not end.certificate.passed:
        return f"{state} misses {missed(end.certificate)}"
    last = end.history[-1]
    if not last.steps:
        return f"{state} did not settle"
    change = f"{last.steps[-1].bound_change:.1e}"
    return f"{state} still changes its friction by {change} after {len(last.steps)} iterations"


def missed(certificate: Certificate) -> str:
    """Residuals above their tolerances, in words."""
    allowed = certificate.tolerances
    return ", ".join(
        f"{name.replace('_', ' ')} ({value:.1e}, allowed {allowed[name]:.0e})"
        for name, value in certificate.failures.items()
    )


def _tried(attempts: Sequence[Trial]) -> Iterator[str]:
    """Attempts that found nothing, those of one kind together."""
    lost = [trial for trial in attempts if not trial.found]
    for name in dict.fromkeys(trial.name for trial in lost):
        trials = [trial for trial in lost if trial.name == name]
        times = f"{len(trials)} times, the last one: " if len(trials) > 1 else ""
        yield f"{ATTEMPTS.get(name, name)} found no state ({times}{trials[-1].outcome})"


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


def _either(cures: Iterator[str]) -> str:
    """A list of alternatives."""
    *first, last = cures
    return f"{', '.join(first)} or {last}" if first else last
