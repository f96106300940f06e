"""Types of arguments and fields, held against their annotations; messages name the argument.

Annotations of the public functions and dataclasses say what is accepted. numpy's numbers and arrays
stand for numbers and sequences of numbers. A truth value is no number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from functools import cache, wraps
from types import UnionType
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
import numpy.typing as npt

from fenics_contact.errors.exceptions import InputError

F = TypeVar("F", bound=Callable[..., Any])

#: Names of the types that a value must have exactly.
EXACT = {int: "a whole number", bool: "true or false", str: "a string"}
#: What sequences are of, in words.
_SEVERAL: dict[Any, str] = {
    float: "numbers",
    int: "whole numbers",
    str: "strings",
    tuple[float, float]: "pairs of numbers",
}
#: Whole numbers are counts: of blocks, elements, steps, points.
LARGEST_COUNT = 1_000_000
#: Characters of a value that a message has room for.
LONGEST_VALUE = 80


def checked(function: F) -> F:
    """A function that refuses arguments of other types than its annotations say.

    Numbers must be finite.

    Raises:
        InputError: On all ranks that call it, before anything else is done.
    """
    code = function.__code__
    positional = code.co_varnames[: code.co_argcount]

    @wraps(function)
    def inner(*arguments: Any, **named: Any) -> Any:
        kinds = _kinds(function)
        for name, value in [*zip(positional, arguments, strict=False), *named.items()]:
            if name in kinds:
                check_type(key_of(name), value, kinds[name])
                _check_finite(key_of(name), value)
        return function(*arguments, **named)

    return cast(F, inner)


@cache
def _kinds(owner: Any) -> dict[str, Any]:
    """Annotations of a function or dataclass."""
    return get_type_hints(owner)


def check_types(item: Any) -> None:
    """Refuse fields of a dataclass that are of other types than their annotations say.

    Numbers of fields that are of floats become floats: that of a whole number is the number.

    Raises:
        InputError: The message names the field.
    """
    for name, kind in _kinds(cast(Hashable, type(item))).items():
        value = getattr(item, name)
        check_type(key_of(name), value, kind)
        object.__setattr__(item, name, with_floats(value, kind))


def with_floats(value: Any, kind: Any) -> Any:
    """A value of a type, in which numbers of type float are that, and pairs are tuples."""
    kind = kind_of(value, kind)
    if kind is float:
        return float(value)
    if get_origin(kind) is tuple:
        return tuple(with_floats(item, get_args(kind)[0]) for item in value)
    if get_origin(kind) is Mapping:
        return {name: with_floats(item, get_args(kind)[1]) for name, item in value.items()}
    return value


def key_of(name: str) -> str:
    """Key of a field: its name, without the underscore after a keyword of Python (`from_`)."""
    return name.removesuffix("_")


def check_like(key: str, value: Any, attribute: str, what: str) -> None:
    """Refuse an object of another package that lacks what it is used for.

    Raises:
        InputError: The message says what it must be.
    """
    if getattr(value, attribute, None) is None:
        raise InputError(f"{key} = {shown(value)} must be {what}")


def kind_of(value: Any, kind: Any) -> Any:
    """Type that a value should have of several: the first that it is of, else the first of all."""
    if not _is_union(kind):
        return kind
    kinds = get_args(kind)
    return next((one for one in kinds if _is_of(value, one)), kinds[0])


def check_type(key: str, value: Any, kind: Any) -> None:
    """Refuse a value of another type.

    Raises:
        InputError: The message has the key and what it must be.
    """
    if kind == npt.ArrayLike or get_origin(kind) is np.ndarray:
        _check_array(key, value)
        return
    if isinstance(value, np.generic):
        value = value.item()
    if _is_union(kind):
        kinds = get_args(kind)
        if any(_is_of(value, one) for one in kinds):
            return
        kind = kinds[0]
    origin = get_origin(kind)
    if kind is Any or isinstance(kind, TypeVar) or kind is type(value) is type(None):
        return
    if kind is float:
        _check_number(key, value)
    elif kind in EXACT:
        if type(value) is not kind:  # a truth value is no whole number
            raise InputError(f"{key} = {shown(value)} must be {EXACT[kind]}")
        if kind is int and abs(value) > LARGEST_COUNT:
            raise InputError(f"{key} must be at most {LARGEST_COUNT} in size")
    elif origin is Mapping:
        _check_mapping(key, value, get_args(kind))
    elif origin is tuple and ... not in get_args(kind):
        _check_pair(key, value)
    elif origin in (Sequence, list, tuple):
        _check_sequence(key, value, get_args(kind)[0])
    elif origin is Iterable or kind is Iterable:
        if not isinstance(value, Iterable):
            raise InputError(f"{key} = {shown(value)} must be a list")
    elif origin is Callable or kind is Callable:
        if not callable(value):
            raise InputError(f"{key} = {shown(value)} must be a function, given in Python")
    elif not _is_instance(value, kind):
        raise InputError(f"{key} = {shown(value)} must be a {kind.__name__}")


def shown(value: Any) -> str:
    """A value as text, as far as there is room for it."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    try:
        text = repr(list(value) if isinstance(value, tuple) else value)
    except ValueError:  # a whole number too long for Python
        return "a number"
    return text if len(text) <= LONGEST_VALUE else f"{text[:60]} ..."


def as_mapping(key: str, value: Any) -> Mapping[str, Any]:
    """A table, refused if it is none."""
    if not isinstance(value, Mapping):
        raise InputError(f"{key} = {shown(value)} must be a table, [{key}], in Python a dict")
    return value


def _is_union(kind: Any) -> bool:
    return isinstance(kind, UnionType) or get_origin(kind) is Union


def _is_of(value: Any, kind: Any) -> bool:
    """Whether a value is of one type of a union."""
    try:
        check_type("", value, kind)
    except InputError:
        return False
    return True


def _is_instance(value: Any, kind: Any) -> bool:
    """Whether a value is of a class, or has all methods of a protocol."""
    if not getattr(kind, "_is_protocol", False):
        return isinstance(value, kind)
    methods = [name for name in vars(kind) if not name.startswith("_")]
    return all(callable(getattr(value, name, None)) for name in methods)


def _check_number(key: str, value: Any) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{key} = {shown(value)} must be a number")
    try:
        float(value)
    except OverflowError:
        raise InputError(f"{key} is too large a number") from None


def _check_finite(key: str, value: Any) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{key} = {value} must be finite")


def _check_array(key: str, value: Any) -> None:
    try:
        numeric = np.asarray(value).dtype.kind in "iuf"
    except ValueError:  # rows of different lengths
        numeric = False
    if not numeric:  # the message takes a hundred times as long as the check
        raise InputError(f"{key} = {shown(value)} must be an array of numbers")


def _check_pair(key: str, value: Any) -> None:
    if not isinstance(value, (Sequence, np.ndarray)) or isinstance(value, str) or len(value) != 2:
        raise InputError(f"{key} = {shown(value)} must be two numbers, [x, y]")
    for item in value:
        check_type(key, item, float)


def _check_sequence(key: str, value: Any, kind: Any) -> None:
    if not isinstance(value, (Sequence, np.ndarray)) or isinstance(value, (str, bytes)):
        of = f" of {_SEVERAL[kind]}" if kind in _SEVERAL else ""
        raise InputError(f"{key} = {shown(value)} must be a list{of}")
    if kind is str and not all(isinstance(item, str) for item in value):
        raise InputError(f"{key} = {shown(value)} must be a list of strings")
    for number, item in enumerate(value):
        check_type(f"{key}[{number}]", item, kind)


def _check_mapping(key: str, value: Any, kinds: tuple[Any, ...]) -> None:
    for name, inner in as_mapping(key, value).items():
        if kinds[0] is str and not isinstance(name, str):
            raise InputError(f"{key} has the name {shown(name)}, which must be a string")
        place = f"{key}.{name}" if isinstance(name, str) else f"{key}[{name}]"
        check_type(place, inner, kinds[1])
