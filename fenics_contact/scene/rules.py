"""Rules for values of a scene: refused values, and the base of the dataclasses that keep them."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from itertools import pairwise
from typing import Any, get_args

from fenics_contact.errors import (
    IN_PLANE,
    IN_SPACE,
    InputError,
    check_type,
    check_types,
    key_of,
    kind_of,
    require,
    types_of,
)

#: Heights of a profile: cells are cut there.
MOST_HEIGHTS = 100
#: Degrees by which supports can turn: displacements are small.
MOST_TILT = 5.0
#: Smallest and largest size of a number that is not 0, in SI units.
SIZES = 1e-30, 1e30
VECTORS = {IN_PLANE, IN_SPACE}
#: Kinds of scenes that take a key, in words.
OF = {
    "mesh": "of scenes with a mesh",
    "blocks": "of scenes of rigid blocks ([blocks] in place of [mesh] takes the same file)",
    "plane": "of scenes in the plane",
    "space": "of scenes in space",
    "elastic": "of scenes with a mesh, or in space",
}


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
DIRECTION = rule(any, "must be a direction, not zero", require_vector)


def ruled(keeps_to: Rule, default: Any = MISSING, of: str = "") -> Any:
    """A field whose values, if not None, keep to a rule; `of`: see `only`."""
    return field(default=default, metadata={"rule": keeps_to, "of": of})


def only(of: str, default: Any = None) -> Any:
    """A field of scenes of one kind, see `OF`."""
    return field(default=default, metadata={"of": of})


def is_of(item: Field[Any], scene: Collection[str]) -> bool:
    """Whether a field is one of scenes of some kinds."""
    return item.metadata.get("of", "") in ("", *scene)


def named(keeps_to: Rule | None = None, of: str = "") -> Any:
    """A field that is a table of any names, by default empty, whose values keep to a rule."""
    return field(default_factory=dict, metadata={"rule": keeps_to, "of": of})


def one_of(*known: str, of: str = "") -> Any:
    """A field with one of these texts, by default the first."""
    return ruled(lambda name, value: require_choice(name, value, known), known[0], of)


@dataclass(frozen=True)
class Checked:
    """Base of what a scene is made of: types and rules of the fields hold, numbers are floats."""

    def __post_init__(self) -> None:
        check_types(self)
        for item in fields(self):
            value = getattr(self, item.name)
            key = key_of(item.name)
            if value is not None and (rule := item.metadata.get("rule")):
                table = value if isinstance(value, Mapping) else {}
                for name, one in table.items():
                    rule(f"{key}.{name}", one)
                if value is not table:
                    rule(key, value)


def require_fit(key: str, value: Any, kind: Any, scene: Collection[str]) -> None:
    """Refuse what a scene does not take: keys of other kinds, vectors of another dimension.

    Args:
        key: Of the value in a scene file.
        value: A part of a scene.
        kind: Its type. One that is a number or a tuple is a number in the plane.
        scene: Kinds that the scene is of, see `OF`.

    Raises:
        InputError: The message names the key.
    """
    several = get_args(kind)
    in_plane = "plane" in scene
    if is_dataclass(value):
        for item in sorted(fields(value), key=lambda item: is_of(item, scene)):
            inner = f"{key}.{key_of(item.name)}"
            given = getattr(value, item.name)
            if is_of(item, scene) and given != item.default:
                require_fit(inner, given, types_of(type(value))[item.name], scene)
            elif given and given != item.default:
                cure = {"z": "give y", "y": "give z"}.get(item.name, "leave it out")
                raise InputError(f"{inner} is {OF[item.metadata['of']]}; {cure}")
    elif isinstance(value, Mapping):
        for name, one in value.items():
            require_fit(f"{key}.{name}", one, several[1], scene)
    elif float in several and (longer := [one for one in several if get_args(one)]):
        if value:
            check_type(key, value, float if in_plane else longer[0])
    elif isinstance(value, tuple) and VECTORS <= set(several):
        check_type(key, value, IN_PLANE if in_plane else IN_SPACE)
    elif isinstance(value, tuple):
        inner_kind = get_args(kind_of(value, kind))[0]
        for number, one in enumerate(value):
            require_fit(f"{key}[{number}]", one, inner_kind, scene)


def listed(names: Iterable[str]) -> str:
    """Names for people."""
    return ", ".join(f"'{name}'" for name in names) or "none"
