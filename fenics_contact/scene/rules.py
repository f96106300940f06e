"""Rules for values of a scene: refused values, and the base of the dataclasses that keep them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import MISSING, dataclass, field, fields
from itertools import pairwise
from typing import Any

from fenics_contact.errors import check_types, key_of, require

#: Heights of a profile: cells are cut there.
MOST_HEIGHTS = 100
#: Degrees by which supports can turn: displacements are small.
MOST_TILT = 5.0
#: Smallest and largest size of a number that is not 0, in SI units.
SIZES = 1e-30, 1e30


def require_size(name: str, value: float) -> None:
    """Refuse numbers whose squares and products floating point numbers do not hold."""
    low, high = SIZES
    problem = f"{name} = {value} must be 0, or between {low:g} and {high:g} in size (SI units)"
    require(value == 0.0 or low <= abs(value) <= high, problem)


def require_vector(name: str, value: Sequence[float] | str) -> None:
    """Refuse components that are not finite; the name of a group, in place of them, passes."""
    if isinstance(value, str):
        return
    count = "two" if len(value) == 2 else "three"
    require(
        all(map(math.isfinite, value)), f"{name} = {list(value)} must be {count} finite numbers"
    )
    for component in value:
        require_size(name, component)


def require_choice(name: str, value: str, known: Sequence[str]) -> None:
    """Refuse what is none of the known words."""
    require(value in known, f"{name} = '{value}' must be one of {', '.join(known)}")


def require_profile(name: str, value: tuple[tuple[float, float], ...] | str) -> None:
    """Refuse a profile over the height that is neither a known word nor a table."""
    if isinstance(value, str):
        require_choice(name, value, ("uniform", "triangular"))
        return
    count = len(value)
    few = f"profile has {count} pairs [height, factor]; give 2 to {MOST_HEIGHTS}"
    require(2 <= count <= MOST_HEIGHTS, few)
    for pair in value:
        require_vector(name, pair)
    for (low, *_), (high, *_) in pairwise(value):
        require(low < high, f"profile: height {high:g} must be above the one before, {low:g} (m)")


#: What refuses a value of a field, by the field's name and the value.
Rule = Callable[[str, Any], None]


def rule(good: Callable[[Any], bool], text: str, *more: Rule) -> Rule:
    """A rule for values: what is good, what a message says they must be, and rules after it."""

    def refuse(name: str, value: Any) -> None:
        require(good(value), f"{name} = {value} {text}")
        for other in more:
            other(name, value)

    return refuse


def within(low: float, high: float, text: str) -> Rule:
    """A rule for numbers between two ends."""
    return rule(lambda value: low <= value <= high, text)


NOT_NEGATIVE = rule(lambda v: 0.0 <= v < math.inf, "must be finite and >= 0", require_size)
STRENGTH = rule(lambda v: v > 0.0, "must be a positive number (Pa)", NOT_NEGATIVE)
POSITIVE = rule(lambda v: v > 0.0, "must be a positive number", NOT_NEGATIVE)
FINITE = rule(math.isfinite, "must be a finite number (m)")


def ruled(keeps_to: Rule, default: Any = MISSING) -> Any:
    """A field whose values, if not None, keep to a rule."""
    return field(default=default, metadata={"rule": keeps_to})


def one_of(*known: str) -> Any:
    """A field with one of these texts, by default the first."""
    return ruled(lambda name, value: require_choice(name, value, known), known[0])


@dataclass(frozen=True)
class Checked:
    """Base of what a scene is made of: types and rules of the fields hold, numbers are floats."""

    def __post_init__(self) -> None:
        check_types(self)
        for item in fields(self):
            value = getattr(self, item.name)
            if value is not None and "rule" in item.metadata:
                item.metadata["rule"](key_of(item.name), value)


def listed(names: Iterable[str]) -> str:
    """Names for people."""
    return ", ".join(f"'{name}'" for name in names) or "none"
