"""The load factor of a collapse: its bracket, its sign, and what is proved of it, in words.

A collapse under the reversed live load is found as one under a live load of its own. Once it is
made, its load factors are multiples of the live load as given: `signed` turns all fields of the
type `LoadFactor`, in whatever record they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

from fenics_contact.scene.units import rounded_alike
from fenics_contact.solvers.problem import State

#: Of what would take minutes for thousands of blocks, to say next to nothing.
NOT_AT_THIS_SIZE = "not asked at this size"
#: Relative difference up to which the ends of a bracket are one load factor.
MEET = 1e-6
#: The same for load factors of several points, which miss theirs by their tolerances.
EQUAL = 1e-5


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
        reason: Why `lower` is not known, in words; empty where nothing more is to be said.
    """

    lower: float | None
    upper: float | None
    frictionless: float | None = None
    reason: str = ""

    @property
    def meet(self) -> bool:
        """Whether the ends are so close that all collapse states have one load factor."""
        return self.lower is not None and self.upper is not None and meet(self.lower, self.upper)

    def rounded(self, size: float) -> LimitBounds:
        """The bounds, 0 where they cannot be told from it."""
        values = self.lower, self.upper, self.frictionless
        lower, upper, least = (None if b is None else rounded(b, size) for b in values)
        return LimitBounds(lower, upper, least, self.reason)

    def told(self, number: Callable[[float], str]) -> str:
        """The bounds in words, with a form for numbers."""
        if self.lower is None:
            known = "with unknown bounds" if self.upper is None else f"at most {number(self.upper)}"
            return f"{known}, the lower end is {self.reason}" if self.reason else known
        if self.upper is None:
            return f"at least {number(self.lower)}"
        return f"between {number(self.lower)} and {number(self.upper)}"

    def __str__(self) -> str:
        return self.told("{:.6g}".format)


#: A number that has the sign of the live load.
LoadFactor = float


def signed(record: Any, sign: float) -> Any:
    """A record with all its load factors times a sign."""
    if sign > 0.0:
        return record
    if isinstance(record, tuple):
        return tuple(signed(item, sign) for item in record)
    if isinstance(record, Mapping):
        return {name: signed(item, sign) for name, item in record.items()}
    if isinstance(record, LimitBounds):
        ends = record.upper, record.lower, record.frictionless
        lower, upper, least = (None if end is None else 0.0 - end for end in ends)
        return LimitBounds(lower, upper, least, record.reason)
    if isinstance(record, State):
        return replace(record, load_factor=-record.load_factor, work=-record.work)
    if not is_dataclass(record) or isinstance(record, type):
        return record
    values = {item.name: getattr(record, item.name) for item in fields(record)}
    marked = {item.name for item in fields(record) if "LoadFactor" in item.type}
    changed = {
        name: _reversed(value) if name in marked else signed(value, sign)
        for name, value in values.items()
    }
    return replace(record, **changed)


def _reversed(value: Any) -> Any:
    """A load factor, or several, under the reverse of the live load."""
    return tuple(map(_reversed, value)) if isinstance(value, tuple) else 0.0 - value


def alike(value: float | None, leading: float | None) -> str:
    """A load factor rounded to the decimals of the leading one; "not known" for none and nan."""
    if value is None or value != value:
        return "not known"
    return rounded_alike([leading if leading else value, value])[1]


def four_digits(value: float | None, leading: float) -> str:
    """A load factor with as many decimals as give the leading one four digits."""
    size = abs(leading)
    decimals = 3 - math.floor(math.log10(size)) if 0.0 < size < math.inf else 4
    return "not known" if value is None or value != value else f"{value:.{max(decimals, 0)}f}"


def equal(load_factors: Sequence[float]) -> bool:
    """Whether there are several load factors, and all are one."""
    least, most = min(load_factors, default=0.0), max(load_factors, default=0.0)
    return len(load_factors) > 1 and most - least <= EQUAL * max(abs(least), abs(most))


def counted(number: int, noun: str) -> str:
    """A number with its noun, in the plural where that is due."""
    return f"{number} {noun}{'s' * (number != 1)}"


#: What is not known of such a load factor, and need not be.
WITHOUT_PATH = (
    "rigid blocks with elastic faces: no error by a mesh; what elastic blocks carry on the way to"
    " this collapse was not followed"
)
#: Of the lowest state, wherever it is told.
SELF_STRESS = "with any self-stress in the blocks"
NOT_FROM_REST = "blocks that are loaded from rest need not reach it"
#: Significant digits of such load factors, at least and at most.
DIGITS = (4, 8)


def bracket_rows(bounds: LimitBounds, sign: float, factor: float) -> list[tuple[str, str]]:
    """What the rigid-block programs say of a load factor, for the report."""
    ends = bounds.lower, bounds.upper
    told = [alike(end, factor) if end is not None else bounds.reason or "not known" for end in ends]
    first, beyond = told if sign > 0.0 else told[::-1]
    rows = [("no collapse state below", first), ("surely not carried beyond", beyond)]
    sure = bounds.frictionless
    if sure is None:
        return rows
    return [("carried without any friction", alike(sure, factor) if sure else "nothing"), *rows]


def proof(load_factor: float, limit: float, inside: str, searched: str) -> str:
    """What is proved of a state.

    Args:
        load_factor: Its own.
        limit: That which its friction forces allow.
        inside: What joint forces are inside of.
        searched: What was searched for, in words; empty for what a load leads to.
    """
    what = f"the {searched}, is at" if searched else "collapses at"
    size = abs(load_factor) or abs(limit) or 1.0
    apart = abs(limit - load_factor) / size
    if apart <= MEET:  # rounding alone says which one is larger
        here, proved = f"{load_factor:.6g}", "that is the limit load"
    else:
        # Both with the digits that tell them apart; the limit is rounded away from the state.
        digits = min(max(1 + math.floor(-math.log10(apart)), DIGITS[0]), DIGITS[1])
        unit = 10.0 ** (math.floor(math.log10(size)) + 1 - digits)
        beyond = abs(limit) >= abs(load_factor)
        outward = (math.ceil if beyond else math.floor)(round(abs(limit) / unit, 6)) * unit
        here, end = rounded_alike([load_factor, math.copysign(outward, limit)], digits)
        # Where the dead load drives the collapse these forces need so much of the live load.
        proved = f"nothing carries {'more' if beyond else 'less'} than {end}"
    return (
        f"{what} {here}: there is an equilibrium inside {inside} at {here}, and with its friction"
        f" forces {proved}{f'; {NOT_FROM_REST}' * bool(searched)}"
    )
