"""What is compiled: the law of joint points, curves on it, and units of contact (`units.c`).

A step on block modes asks many times how far few points are from their laws: a hundred calls of
numpy on short arrays would take longer than the factor does. The compiled texts are kept in the
folder in which dolfinx keeps its forms. They use the BLAS and LAPACK of scipy.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.machinery
import importlib.util
import logging
import os
import re
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

_log = logging.getLogger("fenics_contact")

#: Plain IEEE arithmetic: no operation is joined with another one or moved.
FLAGS = ("-O3", "-g0", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")

SOURCES = [Path(__file__).with_name(name) for name in ("laws.c", "curve.c", "units.c")]

#: What a caller sees of them: structures and functions.
_SEEN = re.compile(
    r"^(?:typedef struct \{[^}]*\} (?:laws|linear|points|curve);|(?:void|int) [^{;]*\))", re.M
)


class _Loaded:
    """The compiled module of this process."""

    module: Any = None


@dataclass(frozen=True)
class CStructure:
    """A structure of the C texts, and the arrays that it points to."""

    address: Any
    fields: dict[str, Any]


def structure(name: str, **fields: Any) -> CStructure:
    """A structure with some fields: numbers, arrays, other structures."""
    ffi = load().ffi
    passed = {key: _passed(ffi, value) for key, value in fields.items()}
    return CStructure(ffi.new(f"{name} *", passed), fields | {"passed": passed})


def call(name: str, *arguments: Any) -> int:
    """Call a function of the C texts with numbers, contiguous arrays and structures.

    Raises:
        MemoryError: If there is not enough.
    """
    module = load()
    found = getattr(module.lib, name)(*(_passed(module.ffi, value) for value in arguments))
    if found == -1:
        raise MemoryError(name)
    return int(found or 0)


def load(folder: Path | None = None) -> Any:
    """The compiled texts, loaded once from a folder, and compiled there if they are missing.

    Processes may do so at the same time. Without a folder it is dolfinx's usual one.

    Raises:
        Exception: Any, if there is no compiler or the folder cannot be written.
    """
    if _Loaded.module is not None:
        return _Loaded.module
    cache = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    folder = folder or Path(cache).expanduser() / "fenics"
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
    module.lib.use_lapack(*(module.ffi.cast("void *", address) for address in _lapack_addresses()))
    _Loaded.module = module
    return module


@cache
def is_there() -> bool:
    """Whether the texts are compiled, or can be; what also has numpy's way asks."""
    try:
        load()
    except Exception as error:  # whatever a missing compiler leads to
        _log.info("face forces by numpy: %s", error)
        return False
    return True


def _passed(ffi: Any, value: Any) -> Any:
    """A number as it is, an array or a structure as its address."""
    if isinstance(value, CStructure):
        return value.address
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype == np.bool_:
        return ffi.from_buffer("unsigned char[]", value)
    if value.dtype == np.int32:
        return ffi.from_buffer("int[]", value)
    if value.dtype == np.int64:
        return ffi.from_buffer("long long[]", value)
    return ffi.from_buffer("double[]", np.ascontiguousarray(value, dtype=float))


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
