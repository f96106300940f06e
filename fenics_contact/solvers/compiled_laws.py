"""The laws of joint points compiled: `laws.c` and `curve.c`, the same numbers in less time.

A step on block modes asks many times how far few points are from their laws. In numpy that is a
hundred calls on short arrays, which take longer than the factor does. The C texts beside this
module say the same as the Python text of `joint_law` and `nonlinear_elimination`, which stays where
it is: tests compare both, and it runs where there is no compiler. They agree bit for bit, as both
use the same BLAS and LAPACK.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.machinery
import importlib.util
import os
import re
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

#: Plain IEEE arithmetic: no operation is joined with another one or moved.
FLAGS = ("-O3", "-g0", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")

SOURCES = [Path(__file__).with_name(name) for name in ("laws.c", "curve.c")]

#: What a caller sees of them: structures and functions.
_SEEN = re.compile(
    r"^(?:typedef struct \{[^}]*\} (?:points|curve|linear);|(?:void|int) [^{;]*\))", re.M
)


@dataclass(frozen=True)
class Structure:
    """A structure of the C texts, and the arrays that it points to."""

    address: Any
    fields: dict[str, Any]


class CompiledLaws:
    """The functions of `laws.c` and `curve.c`, on contiguous arrays."""

    def __init__(self, module: Any) -> None:
        """Take the compiled module."""
        self._lib = module.lib
        self._ffi = module.ffi
        self._lib.use_lapack(*(self._ffi.cast("void *", a) for a in _lapack_addresses()))

    def structure(self, name: str, **fields: Any) -> Structure:
        """A structure with some fields: numbers, arrays, other structures."""
        passed = {key: self._passed(value) for key, value in fields.items()}
        return Structure(self._ffi.new(f"{name} *", passed), passed)

    def distances(self, *arguments: Any) -> None:
        """Distances of points from their laws, into the last argument; see `laws.c`."""
        self._lib.distances(*map(self._passed, arguments))

    def chosen_points(self, *arguments: Any) -> None:
        """Equations of chosen points, into the last four arguments; see `laws.c`."""
        self._lib.chosen_points(*map(self._passed, arguments))

    def slacks_of(self, *arguments: Any) -> None:
        """Slacks with equal products, into the last argument; see `laws.c`."""
        self._lib.slacks_of(*map(self._passed, arguments))

    def asked_forces(self, *arguments: Any) -> None:
        """Changes of forces that a step asks for, into the last argument; see `laws.c`."""
        self._lib.asked_forces(*map(self._passed, arguments))

    def changes(self, *arguments: Any) -> None:
        """Changes of slacks, into the last argument; see `laws.c`."""
        self._lib.changes(*map(self._passed, arguments))

    def add_at(self, *arguments: Any) -> None:
        """Add values at places of the last argument; see `laws.c`."""
        self._lib.add_at(*map(self._passed, arguments))

    def trace(self, *arguments: Any) -> bool:
        """Follow a curve, of which all arrays become the end; see `curve.c`.

        Raises:
            MemoryError: If there is not enough.
        """
        bends = self._lib.trace(*map(self._passed, arguments))
        if bends < 0:
            raise MemoryError("a curve of chosen points")
        return bool(bends)

    def near(self, *arguments: Any) -> bool:
        """Whether the point of a curve next to one was found, which becomes it; see `curve.c`.

        Raises:
            MemoryError: If there is not enough.
        """
        found = self._lib.near(*map(self._passed, arguments))
        if found < 0:
            raise MemoryError("a point of a curve of chosen points")
        return bool(found)

    def _passed(self, value: Any) -> Any:
        """A number as it is, an array or a structure as its address."""
        if isinstance(value, Structure):
            return value.address
        if not isinstance(value, np.ndarray):
            return value
        if value.dtype == np.bool_:
            return self._ffi.from_buffer("unsigned char[]", value)
        if value.dtype == np.int64:
            return self._ffi.from_buffer("long long[]", value)
        return self._ffi.from_buffer("double[]", np.ascontiguousarray(value, dtype=float))


def _lapack_addresses() -> list[int]:
    """Addresses of dgemv and dgesv, those that numpy calls as well."""
    from scipy.linalg import cython_blas, cython_lapack

    name = ctypes.pythonapi.PyCapsule_GetName
    name.restype = ctypes.c_char_p
    name.argtypes = [ctypes.py_object]
    address = ctypes.pythonapi.PyCapsule_GetPointer
    address.restype = ctypes.c_void_p
    address.argtypes = [ctypes.py_object, ctypes.c_char_p]
    capsules = [cython_blas.__pyx_capi__["dgemv"], cython_lapack.__pyx_capi__["dgesv"]]
    return [address(capsule, name(capsule)) for capsule in capsules]


class _Loaded:
    """What this process has loaded; None: the Python text runs."""

    laws: CompiledLaws | None = None


def compiled_laws() -> CompiledLaws | None:
    """The compiled laws; None where they are not loaded."""
    return _Loaded.laws


def use(laws: CompiledLaws | None) -> None:
    """Let all laws of this process be computed by compiled ones, or by the Python text."""
    _Loaded.laws = laws


def load(folder: Path) -> CompiledLaws:
    """The compiled laws out of a folder, where they are compiled if they are not there.

    Raises:
        Exception: Any, if there is no compiler or the folder cannot be written.
    """
    source = "\n".join(path.read_text() for path in SOURCES)
    told = "\0".join([source, *FLAGS, sys.implementation.cache_tag or ""])
    name = f"fenics_contact_laws_{hashlib.sha256(told.encode()).hexdigest()[:16]}"
    path = folder / (name + importlib.machinery.EXTENSION_SUFFIXES[0])
    if not path.exists():
        _compile(source, name, path)
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot load {path}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return CompiledLaws(module)


def _compile(source: str, name: str, path: Path) -> None:
    """Compile into a file that is there whole or not at all."""
    import cffi

    builder = cffi.FFI()
    seen = (found.group() for found in _SEEN.finditer(source))
    builder.cdef("".join(text if text.endswith(";") else f"{text};" for text in seen))
    builder.set_source(name, source, extra_compile_args=list(FLAGS))
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=name, dir=path.parent) as folder:
        os.replace(builder.compile(tmpdir=folder), path)
