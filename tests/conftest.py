"""What all tests share: the package can be imported, and the ranks stay in step.

Tests marked `mpi` run within the ranks of `make test-mpi`. There rank 0 alone reports, and a test
fails on all ranks if it fails on one.
"""

from __future__ import annotations

import gc
import importlib
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

if importlib.util.find_spec("fenics_contact") is None:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

WORLD = MPI.COMM_WORLD


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Silence all ranks but the first."""
    if WORLD.rank > 0:
        config.pluginmanager.unregister(name="terminalreporter")


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    """Let a phase of a test fail on all ranks if it fails on one."""
    outcome: Any = yield
    report = outcome.get_result()
    failed = [f"rank {WORLD.rank}:\n{report.longrepr}"] if report.failed else []
    elsewhere = WORLD.allgather(failed)
    if any(elsewhere) and not failed:
        report.outcome = "failed"
        report.longrepr = "\n".join(text for texts in elsewhere for text in texts)


@pytest.fixture(scope="session", autouse=True)
def quick_collection() -> None:
    """Spare collections, on several ranks one after every test, a walk through all modules."""
    importlib.import_module("fenics_contact")
    gc.collect()
    gc.freeze()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for this test, the same on all ranks and the current one."""
    shared = WORLD.bcast(tmp_path)
    monkeypatch.chdir(shared)
    return shared


@pytest.fixture(autouse=True)
def ranks_in_step() -> Iterator[None]:
    """Collect what a test leaves behind on all ranks at once, as collective destructors need."""
    yield
    if WORLD.size > 1:
        gc.collect()
        WORLD.barrier()
