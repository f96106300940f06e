"""One point of a sweep: the limit load of one scene, as a row of a table."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass, replace
from typing import Any

from fenics_contact.discretization.discretization import Discretization
from fenics_contact.errors import InputError, SolverError
from fenics_contact.limit_load import LimitLoad, limit_load, limit_load_of
from fenics_contact.scene.scene import Scene
from fenics_contact.sweeps.parameters import Family, Values

#: Status of a point whose loads or joints do not fit the mesh.
WRONG_INPUT = "wrong_input"


@dataclass(frozen=True)
class Point:
    """Limit load with some values of the varied keys.

    Attributes:
        values: By key.
        status: As `LimitLoad.status`, or "wrong_input" where the scene does not fit its mesh.
        load_factor: Of the live load as given; infinite if unbounded, nan if there is none.
        lower: Lower end of its bracket; nan if not known.
        upper: Upper end.
        load_factor_negative: With the live load reversed, not above 0; nan if not asked for.
        lower_negative: Lower end of its bracket.
        upper_negative: Upper end.
        load_factor_point_hinges: Load factor with hinges of no length; nan if not known.
        factorizations: Numeric factorisations.
        seconds: Time, s.
        reason: Why there is no limit load, for people.
    """

    values: Values
    status: str
    load_factor: float = math.nan
    lower: float = math.nan
    upper: float = math.nan
    load_factor_negative: float = math.nan
    lower_negative: float = math.nan
    upper_negative: float = math.nan
    load_factor_point_hinges: float = math.nan
    factorizations: int = 0
    seconds: float = 0.0
    reason: str = ""

    @property
    def solved(self) -> bool:
        """Whether the answer is a limit load, or that there is none."""
        return self.status in ("limit", "unbounded")

    @property
    def least(self) -> float:
        """Load factor nearest to failure: the lower one of both directions; nan if not solved."""
        if not self.solved:
            return math.nan
        found = (self.load_factor, -self.load_factor_negative)
        return min((one for one in found if not math.isnan(one)), default=math.nan)


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
            self._last = self._last.changed(scene)
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
    result.hold_against_brackets()
    result.seconds["total"] = time.perf_counter() - start
    return result


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


def value_text(value: Any) -> str:
    """A value of a key as text: strings as they are, all else as JSON."""
    return value if isinstance(value, str) else json.dumps(value)


def _line(text: str) -> str:
    return " ".join(text.split())
