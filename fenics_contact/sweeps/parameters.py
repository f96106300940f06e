"""What varies in a sweep, and the scenes that come of it."""

from __future__ import annotations

import json
import math
import pickle
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import BlockMesh
from fenics_contact.scene.scene import Scene, function_name
from fenics_contact.scene.toml_tables import assign, read_toml, value_of

#: Significant digits of the values of a range: 0.35, not 0.35000000000000003.
DIGITS = 12
#: Points of a sweep.
MOST = 100_000
_RANGE = re.compile(r"(.+):(.+):\s*(\d+)\s*")
_HOW = "KEY=A:B:N, N values from A to B, or KEY=A,B,C"

#: Values of the keys at one point of a sweep.
Values = Mapping[str, Any]

#: Scene file and what was set on top of it, or a scene made in Python.
Origin: TypeAlias = "tuple[Path, tuple[str, ...]] | Scene"


@dataclass(frozen=True)
class Parameter:
    """Keys of a scene file that have the same value, and the values they get.

    Attributes:
        keys: For example `joints.default.friction`.
        values: As TOML has them: numbers, strings, lists.
    """

    keys: tuple[str, ...]
    values: tuple[Any, ...]

    @classmethod
    def of(cls, keys: str, values: str | Iterable[Any]) -> Parameter:
        """From keys with commas between, and values or a text for them.

        The text is `a:b:n`, n values from a to b, or `a, b, c`. Both ends of a range are numbers,
        or lists of numbers.

        Raises:
            InputError: If there is no key, or no value.
        """
        names = tuple(name.strip() for name in keys.split(","))
        if isinstance(values, str):
            found = _values_of(values)
        else:  # as TOML has them: lists for tuples and arrays, text for paths
            arrays = (np.ndarray, np.generic)
            text = json.dumps(
                list(values), default=lambda x: x.tolist() if isinstance(x, arrays) else str(x)
            )
            found = json.loads(text)
        if not found or not all(all(part.strip() for part in n.split(".")) for n in names):
            raise InputError(f"'{keys}' varies as {_HOW}; give both key and values")
        once: dict[str, Any] = {}
        for value in found:
            once.setdefault(json.dumps(value, sort_keys=True, default=str), value)
        return cls(names, tuple(once.values()))

    @classmethod
    def parse(cls, text: str) -> Parameter:
        """From KEY=A:B:N or KEY=A,B,C; see `of`."""
        keys, _, values = text.partition("=")
        return cls.of(keys, values)


def _values_of(text: str) -> list[Any]:
    """Values that a text stands for, see `Parameter.of`."""
    first = value_of(text.partition(":")[0])
    if found := _RANGE.fullmatch(text):
        start, end = (np.asarray(value_of(part)) for part in found.groups()[:2])
        if all(part.dtype.kind in "if" and part.size for part in (start, end)):
            if start.shape != end.shape:
                raise InputError(f"'{text}': both ends of a range must have as many numbers")
            count = int(found[3])
            if not 1 <= count <= MOST:
                raise InputError(
                    f"'{text}' must have 1 to {MOST} values, the last number of the range"
                )
            exact = np.linspace(start, end, count)
            short = np.array([float(f"{x:.{DIGITS}g}") for x in exact.flat]).reshape(exact.shape)
            whole = start.dtype.kind == end.dtype.kind == "i" and np.all(short == np.round(short))
            return list((short.astype(np.int64) if whole else short).tolist())
    elif ":" in text and isinstance(first, (int, float)):
        raise InputError(f"'{text}' is no range; a key varies as {_HOW}")
    try:
        return list(tomllib.loads(f"values = [{text}]")["values"])
    except (ValueError, RecursionError):
        return [value_of(part) for part in text.split(",") if part.strip()]


def grid(parameters: Sequence[Parameter]) -> list[dict[str, Any]]:
    """Values of all keys at every point, the last parameter changing fastest.

    Raises:
        InputError: If a key varies twice, nothing varies, or there are too many points.
    """
    keys = [key for parameter in parameters for key in parameter.keys]
    if not keys:
        raise InputError("nothing varies; give a key and its values")
    for key in (key for k, key in enumerate(keys) if key in keys[:k]):
        raise InputError(f"'{key}' varies twice; give all its values at once")
    if math.prod(len(parameter.values) for parameter in parameters) > MOST:
        raise InputError(f"the sweep has more than {MOST} points; give fewer values")
    return [
        {key: value for p, value in zip(parameters, point, strict=True) for key in p.keys}
        for point in product(*(parameter.values for parameter in parameters))
    ]


class Family:
    """Scenes that differ in the values of some keys; the mesh is read once.

    Attributes:
        origin: Scene file and what was set on top of it, or a scene made in Python.
        comm: Ranks of all scenes.
        tables: Of the scene without these values, as a file has them.
    """

    def __init__(self, origin: Origin, comm: MPI.Comm | None = None) -> None:
        """Read the tables of the file, on all ranks of `comm` (by default PETSc's), or scene."""
        self.origin = origin
        self._last: tuple[tuple[str, str], BlockMesh] | None = None
        if isinstance(origin, Scene):
            self.comm = origin.comm
            self.tables = origin.tables()
        else:
            self.comm = compat.default_comm() if comm is None else comm
            self.tables = read_toml(origin[0], self.comm, origin[1])

    def to_send(self) -> bytes:
        """The origin, as `Origin`, for another process.

        Raises:
            InputError: If a function of the scene is not found there.
        """
        if isinstance(self.origin, Scene):
            loads = self.origin.dead, self.origin.live
            for given in (self.origin.stress, *(load.form for load in loads)):
                if getattr(given, "__module__", "") == "__main__":
                    raise InputError(
                        f"jobs: the function '{function_name(given)}' is in the script that runs,"
                        " where other processes do not find it; put it into a module of its own"
                    )
        return pickle.dumps(self.origin)

    def scene(self, values: Values) -> Scene:
        """The scene with these values.

        Raises:
            InputError: If a key is unknown, or a value wrong.
        """

        def copied(tables: Mapping[str, Any]) -> dict[str, Any]:
            """Tables to assign to; what is in them is replaced, but never changed."""
            return {k: copied(v) if isinstance(v, Mapping) else v for k, v in tables.items()}

        tables = copied(self.tables)
        for key, value in values.items():
            assign(tables, key, value)
        return Scene.from_tables(tables, self._kept_mesh)

    def _kept_mesh(self, name: str, blocks: str) -> BlockMesh:
        """The mesh of `mesh.file` and `mesh.blocks`; the last one is kept."""
        if isinstance(self.origin, Scene):
            if name != self.origin.mesh.source:
                raise InputError("mesh.file varies for scenes of a file only; give its path")
            return self.origin.mesh
        if self._last is None or self._last[0] != (name, blocks):
            self._last = None  # frees the last one
            path = self.origin[0].parent / name
            self._last = (name, blocks), BlockMesh.from_file(path, self.comm, blocks)
        return self._last[1]
