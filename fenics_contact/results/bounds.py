"""The bracket of a load factor, by the linear programs of rigid blocks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

#: Relative difference up to which the ends of a bracket are one load factor.
MEET = 1e-6


def meet(lower: float, upper: float) -> bool:
    """Whether the ends of a bracket are so close that they are one load factor."""
    size = max(abs(lower), abs(upper))
    return math.isfinite(size) and upper - lower <= MEET * size


def rounded(number: float, size: float) -> float:
    """A load factor, 0 where it cannot be told from it; `size` is what others are relative to."""
    return 0.0 if abs(number) <= MEET * size < math.inf else number


@dataclass(frozen=True)
class LimitBounds:
    """Values of the linear programs for one direction of the live load.

    Attributes:
        lower: No collapse state is below; None if nothing is known.
        upper: Associative: nothing beyond is carried; infinite if nothing limits the load, None if
            it is not known.
        frictionless: Carried without friction, not below 0; None if the dead load needs friction
            to stand.
    """

    lower: float | None
    upper: float | None
    frictionless: float | None = None

    @property
    def meet(self) -> bool:
        """Whether the ends are so close that all collapse states have one load factor."""
        return self.lower is not None and self.upper is not None and meet(self.lower, self.upper)

    def opposite(self) -> LimitBounds:
        """The bounds in the opposite sign of the live load."""
        values = self.upper, self.lower, self.frictionless
        return LimitBounds(*(None if b is None else -b + 0.0 for b in values))

    def rounded(self, size: float) -> LimitBounds:
        """The bounds, 0 where they cannot be told from it."""
        values = self.lower, self.upper, self.frictionless
        return LimitBounds(*(None if b is None else rounded(b, size) for b in values))

    def told(self, number: Callable[[float], str]) -> str:
        """The bounds in words, with a form for numbers."""
        if self.lower is None:
            return "with unknown bounds" if self.upper is None else f"at most {number(self.upper)}"
        if self.upper is None:
            return f"at least {number(self.lower)}"
        return f"between {number(self.lower)} and {number(self.upper)}"

    def __str__(self) -> str:
        return self.told("{:.6g}".format)
