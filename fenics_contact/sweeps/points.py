"""One point of a sweep: the limit load of one scene, as a row of a table."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

from fenics_contact.sweeps.parameters import Values

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

    def contradiction(self, part: float) -> str:
        """What its numbers say against its status and each other, beyond a part; else empty."""
        least = self.least
        if self.solved and not (math.isinf if self.status == "unbounded" else math.isfinite)(least):
            return f"status '{self.status}' with the load factor {least:.6g}"
        ends = ("load_factor", "lower", "upper")
        for suffix in ("", "_negative") if self.solved else ():
            factor, low, high = (getattr(self, name + suffix) for name in ends)
            known = [abs(one) for one in (factor, low, high) if math.isfinite(one)]
            miss = part * max(known, default=0.0)
            if factor < low - miss or factor > high + miss:
                return f"load factor {factor:.6g} is outside its bracket, {low:.6g} to {high:.6g}"
        return ""


def value_text(value: Any) -> str:
    """A value of a key as text: strings as they are, all else as JSON."""
    return value if isinstance(value, str) else json.dumps(value)
