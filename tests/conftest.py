"""What all tests share: the package can be imported, and the ranks stay in step."""

from __future__ import annotations

import gc
import importlib
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

if importlib.util.find_spec("fenics_contact") is None:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))


@pytest.fixture(scope="session", autouse=True)
def quick_collection() -> None:
    """Spare the collections after every test a walk through all imported modules."""
    importlib.import_module("fenics_contact")
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def ranks_in_step() -> Iterator[None]:
    """Collect what a test leaves behind on all ranks at once, as collective destructors need."""
    from mpi4py import MPI

    yield
    gc.collect()
    MPI.COMM_WORLD.barrier()
