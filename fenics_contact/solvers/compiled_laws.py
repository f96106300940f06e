"""The laws of joint points compiled: `laws.c`, the same numbers bit for bit, in less time.

A step on block modes asks many times how far few points are from their laws. In numpy that is a
hundred calls on short arrays, which take longer than the factor does. The C text beside this module
says the same as the Python text of `joint_law` and `nonlinear_elimination`, which stays where it
is: tests compare both, and it runs where there is no compiler.
"""

from __future__ import annotations

import hashlib
import importlib.machinery
import importlib.util
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

#: Plain IEEE arithmetic: no operation is joined with another one or moved.
FLAGS = ("-O3", "-g0", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")

SOURCE = Path(__file__).with_name("laws.c")


class CompiledLaws:
    """The functions of `laws.c`, on contiguous arrays of double precision."""

    def __init__(self, module: Any) -> None:
        """Take the compiled module."""
        self._lib = module.lib
        self._ffi = module.ffi

    def distances(self, *arguments: Any) -> None:
        """Distances of points from their laws, into the last argument; see `laws.c`."""
        self._lib.distances(*map(self._passed, arguments))

    def chosen_points(self, *arguments: Any) -> None:
        """Equations of chosen points, into the last four arguments; see `laws.c`."""
        self._lib.chosen_points(*map(self._passed, arguments))

    def _passed(self, value: Any) -> Any:
        """A number as it is, an array as its address."""
        if not isinstance(value, np.ndarray):
            return value
        return self._ffi.from_buffer("double[]", np.ascontiguousarray(value, dtype=float))


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
    source = SOURCE.read_text()
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
    builder.cdef("".join(f"{head};\n" for head in re.findall(r"^void [^{]*\)", source, re.M)))
    builder.set_source(name, source, extra_compile_args=list(FLAGS))
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=name, dir=path.parent) as folder:
        os.replace(builder.compile(tmpdir=folder), path)
