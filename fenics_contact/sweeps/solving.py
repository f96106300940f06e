"""Limit loads at points of a sweep, one scene after the other."""

from __future__ import annotations

import os
import pickle
import time
from contextlib import suppress
from dataclasses import replace
from typing import Any

from fenics_contact.discretization.discretization import Discretization
from fenics_contact.errors import InputError, SolverError
from fenics_contact.limit_load import LimitLoad, limit_load, limit_load_of
from fenics_contact.scene.scene import Scene
from fenics_contact.sweeps.parameters import Family, Values
from fenics_contact.sweeps.points import WRONG_INPUT, Point


class Structure:
    """The discretisation of the last scene; the next one keeps what of it is the same."""

    def __init__(self) -> None:
        self._owner: Discretization | None = None
        self._last: Discretization | None = None

    def of(self, scene: Scene) -> Discretization:
        """A scene discretised; the one before must not be used for solving any more.

        Raises:
            InputError: If joints, supports or loads of the scene do not fit its mesh.
        """
        if self._last is not None and self._last.shares_matrices(scene):
            self._last = self._last.with_(scene=scene)
        else:
            self.close()
            self._owner = self._last = Discretization(scene)
        return self._last

    def close(self) -> None:
        """Free the matrices, on all ranks together."""
        if self._owner is not None:
            self._owner.close()
        self._owner = self._last = None


def solve(scene: Scene, structure: Structure) -> LimitLoad:
    """Limit load and bracket of a scene.

    Raises:
        InputError: If joints, supports or loads of the scene do not fit its mesh.
    """
    start = time.perf_counter()
    more = {"lowest": bool(scene.solve.lowest), "peak": bool(scene.solve.peak)}
    # A table of load factors has no room for more.
    scene = replace(scene, solve=replace(scene.solve, **more))
    if scene.solve.accuracy is None:
        result = limit_load_of(structure.of(scene))
    else:
        result = limit_load(scene)  # on meshes of its own
    result = result.hold_against_brackets()
    seconds = {**result.seconds, "total": time.perf_counter() - start}
    return replace(result, seconds=seconds)


def solve_point(family: Family, structure: Structure, values: Values) -> Point:
    """Limit load with these values; what goes wrong is said in its status and reason."""
    start = time.perf_counter()
    try:
        result = solve(family.scene(values), structure)
    except (InputError, SolverError) as error:
        status = WRONG_INPUT if isinstance(error, InputError) else "not_converged"
        return Point(values, status, reason=_line(str(error)))
    found: dict[str, Any] = {}
    for name, end in result.ends.items():
        suffix = "_negative" if name == "negative" else ""
        low = end.bounds.lower
        high = end.bounds.upper
        ends = {"load_factor": end.load_factor, "lower": low, "upper": high}
        found |= {name + suffix: float(x) for name, x in ends.items() if x is not None}
    if result.collapse is not None and result.collapse.mesh_error is not None:
        hinges = result.collapse.mesh_error.load_factor_point_hinges
        found["load_factor_point_hinges"] = float(hinges)
    return Point(
        values,
        result.status,
        **found,
        factorizations=result.factorizations,
        seconds=time.perf_counter() - start,
        reason=_line(result.reason() or _failures(result)),
    )


def _failures(result: LimitLoad) -> str:
    """What keeps states from being verified."""
    if result.status != "not_converged":
        return ""
    certificates = [end.certificate for end in result.ends.values() if end.certificate]
    missed = [f"{law} {value:.1e}" for c in certificates for law, value in c.failures.items()]
    return ", ".join(missed) or "no state was found"


def _line(text: str) -> str:
    return " ".join(text.split())


def answer() -> None:
    """Read the origin of a family and then values from standard input, and answer with points."""
    with os.fdopen(os.dup(0), "rb") as asked, os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)  # what libraries have to say is no answer
        family = Family.of(pickle.load(asked))
        structure = Structure()
        with suppress(EOFError, BrokenPipeError):
            while True:
                values = pickle.load(asked)
                pickle.dump(solve_point(family, structure, values), answers)
                answers.flush()
        structure.close()
