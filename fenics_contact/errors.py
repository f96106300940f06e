"""Exceptions of the package, and checks of the types of arguments and fields.

All ranks of a communicator raise the same exception. Types are held against annotations; messages
name the argument. Annotations of the public functions and dataclasses say what is accepted. numpy's
numbers and arrays stand for numbers and sequences of numbers. A truth value is no number.
"""

from __future__ import annotations

import math
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache, wraps
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Any,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

if TYPE_CHECKING:
    from mpi4py import MPI

#: Codes with which the program ends, by status of the result, and for other ends.
EXIT_CODES = {"limit": 0, "unbounded": 0, "unstable": 3, "no_equilibrium": 3, "not_converged": 4}
FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130


class ContactError(Exception):
    """Base of every exception this package raises on purpose; the program ends with its code."""

    exit_code = EXIT_CODES["not_converged"]


class InputError(ContactError):
    """The scene or its mesh is wrong; the message names the thing and what to do."""

    exit_code = BAD_INPUT


class OutputError(ContactError):
    """A file of the result cannot be written; the message names the folder and the reason."""


class SolverError(ContactError):
    """A solver stopped without an answer; the message names its reason and residual."""


class NoEquilibriumError(SolverError):
    """No state was found under the dead load alone; the message says what is known of it."""

    exit_code = EXIT_CODES["no_equilibrium"]


class EffortError(SolverError):
    """A hard limit on the number of factorisations is reached."""


class Stopped(ContactError):
    """The run is to end: its time is over, or somebody asked for it; the message says which."""


def require(condition: bool, message: str, error: type[Exception] = InputError) -> None:
    """Raise an error with a message where a condition does not hold."""
    if not condition:
        raise error(message)


@contextmanager
def raised_together(comm: MPI.Comm) -> Iterator[None]:
    """Raise on all ranks the input or output error of the first rank that raised one inside.

    The block itself must not communicate after a place where it may raise: a rank that raises
    leaves it early.
    """
    failure = None
    try:
        yield
    except (InputError, OutputError) as error:
        failure = type(error), str(error)
    failures = [one for one in comm.allgather(failure) if one is not None]
    if failures:
        kind, message = failures[0]
        raise kind(message)


F = TypeVar("F", bound=Callable[..., Any])

#: Names of the types that a value must have exactly.
EXACT = {int: "a whole number", bool: "true or false", str: "a string"}
#: A place, direction or force: two numbers in the plane, three in space.
IN_PLANE = tuple[float, float]
IN_SPACE = tuple[float, float, float]
if TYPE_CHECKING:
    Vector = tuple[float, ...]
else:
    Vector = IN_PLANE | IN_SPACE
#: What sequences are of, in words.
_SEVERAL: dict[Any, str] = {
    float: "numbers",
    int: "whole numbers",
    str: "strings",
    IN_PLANE: "pairs of numbers",
    IN_SPACE: "places [x, y, z]",
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
        kinds = types_of(function)
        for name, value in [*zip(positional, arguments, strict=False), *named.items()]:
            if name in kinds:
                check_type(key_of(name), value, kinds[name])
                if isinstance(value, float) and not math.isfinite(value):
                    raise InputError(f"{key_of(name)} = {value} must be finite")
        return function(*arguments, **named)

    return cast(F, inner)


#: Annotations of a function or dataclass.
types_of: Callable[[Any], dict[str, Any]] = cache(get_type_hints)


def check_types(item: Any) -> None:
    """Refuse fields of a dataclass that are of other types than their annotations say.

    Numbers of fields that are of floats become floats: that of a whole number is the number.

    Raises:
        InputError: The message names the field.
    """
    kinds = types_of(type(item))
    for name in item.__dataclass_fields__:
        value = getattr(item, name)
        check_type(key_of(name), value, kinds[name])
        object.__setattr__(item, name, with_floats(value, kinds[name]))


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
    if not (isinstance(kind, UnionType) or get_origin(kind) is Union):
        return kind
    kinds = get_args(kind)
    for one in kinds:
        with suppress(InputError):
            check_type("", value, one)
            return one
    return kinds[0]


def check_type(key: str, value: Any, kind: Any) -> None:
    """Refuse a value of another type.

    Raises:
        InputError: The message has the key and what it must be.
    """
    import numpy as np  # not installed, perhaps, where this module is imported

    in_both = IN_SPACE in get_args(kind)
    is_array = kind == np.typing.ArrayLike or get_origin(kind) is np.ndarray
    if isinstance(value, np.generic):
        value = value.item()
    kind = kind if is_array else kind_of(value, kind)
    origin = get_origin(kind)
    inner = get_args(kind)
    is_list = isinstance(value, (Sequence, np.ndarray)) and not isinstance(value, (str, bytes))
    must = ""  # what it must be and is not
    if is_array:
        try:
            numeric = np.asarray(value).dtype.kind in "iuf"
        except ValueError:  # rows of different lengths
            numeric = False
        must = "" if numeric else "an array of numbers"
    elif kind is Any or isinstance(kind, TypeVar) or kind is type(value) is type(None):
        return
    elif kind is float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            must = "a number"
        elif isinstance(value, int) and abs(value) > sys.float_info.max:
            raise InputError(f"{key} is too large a number")
    elif kind in EXACT:
        must = "" if type(value) is kind else EXACT[kind]  # a truth value is no whole number
        if kind is int and not must and abs(value) > LARGEST_COUNT:
            raise InputError(f"{key} must be at most {LARGEST_COUNT} in size")
    elif origin is Mapping:
        for name, item in as_mapping(key, value).items():
            if inner[0] is str and not isinstance(name, str):
                raise InputError(f"{key} has the name {shown(name)}, which must be a string")
            place = f"{key}.{name}" if isinstance(name, str) else f"{key}[{name}]"
            check_type(place, item, inner[1])
    elif origin is tuple and ... not in inner:
        if is_list and len(value) == len(inner):
            for item in value:
                check_type(key, item, inner[0])
        else:
            must = "two numbers, [x, y]" if len(inner) == 2 else "three numbers, [x, y, z]"
            must += ", or three in space" * (in_both and len(inner) == 2)
    elif origin in (Sequence, list, tuple):
        if not is_list:
            must = f"a list of {_SEVERAL[inner[0]]}" if inner[0] in _SEVERAL else "a list"
        elif inner[0] is str and not all(isinstance(item, str) for item in value):
            must = "a list of strings"
        else:
            for number, item in enumerate(value):
                check_type(f"{key}[{number}]", item, inner[0])
    elif Iterable in (kind, origin):
        must = "" if isinstance(value, Iterable) else "a list"
    elif Callable in (kind, origin):
        must = "" if callable(value) else "a function, given in Python"
    elif getattr(kind, "_is_protocol", False):
        methods = [name for name in vars(kind) if not name.startswith("_")]
        has_all = all(callable(getattr(value, name, None)) for name in methods)
        must = "" if has_all else f"a {kind.__name__}"
    elif not isinstance(value, kind):
        must = f"a {kind.__name__}"
    if must:  # the message takes a hundred times as long as the check
        raise InputError(f"{key} = {shown(value)} must be {must}")


def shown(value: Any) -> str:
    """A value as text, as far as there is room for it."""
    import numpy as np

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


def plain(text: str, most: int = 0) -> str:
    r"""A text in one line, of `most` characters if given, in which dollars are no mathematics.

    Matplotlib takes what is between two dollars as a formula, draws `\$` as a dollar, and leaves
    labels that begin with an underscore out of legends.
    """
    line = "".join(c if c.isprintable() else " " for c in text)
    if most:
        line = textwrap.shorten(line, most, placeholder=" ...")
    return f"{' ' * line.startswith('_')}{line}".replace("$", r"\$")
