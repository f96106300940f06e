"""Forms are compiled before all other work, in silence, and by the first run only."""

from __future__ import annotations

import os
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

from fenics_contact import InputError
from fenics_contact.discretization.forms import in_turns
from fenics_contact.solvers.compiled import load
from tests.system.program import QUIET, result, run, write_scene

#: Meshes, with changes of the scene that need other forms.
SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    "weight": ("block", {}),
    "tractions": (
        "stack",
        {
            "mesh.degree": 2,
            "plane.state": "stress",
            "loads.live": {"traction": {"side": [1000.0, 0.0]}},
        },
    ),
}


def start_afresh(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is compiled yet, and the compiler is quick: it does not optimise."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    compiler = folder / "compiler"
    compiler.write_text(f'#!/bin/sh\nexec {os.environ.get("CC", "gcc")} "$@" -O0\n')
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))


def compiled(cache: Path) -> dict[str, int]:
    """Compiled forms and laws, and when they were made."""
    return {path.name: path.stat().st_mtime_ns for path in cache.rglob("*.so")}


@pytest.mark.parametrize(
    ("name", "ranks"),
    [
        ("weight", 1),
        pytest.param("weight", 2, marks=pytest.mark.slow),
        pytest.param("tractions", 1, marks=pytest.mark.slow),
    ],
)
def test_only_the_first_run_compiles_and_says_nothing(name, ranks, tmp_path, monkeypatch):
    start_afresh(tmp_path, monkeypatch)
    mesh, changes = SCENES[name]
    write_scene(tmp_path, QUIET | changes, mesh)
    made, seconds = [], []
    for _ in range(2):
        found = run(["solve", "scene.toml"], tmp_path, ranks)
        assert (found.code, found.err) == (0, "")
        assert not any(word in found.out for word in ("gcc", "build_ext", "INFO"))
        made.append(compiled(tmp_path / "cache"))
        seconds.append(result(tmp_path / "scene")["seconds"])
    assert made[0] and made[0] == made[1]
    assert sum(name.startswith("fenics_contact_laws_") for name in made[0]) == 1
    assert all(found["compile"] > 0.0 for found in seconds)


@pytest.mark.parametrize(
    "missing",
    [pytest.param("laws of an earlier run", marks=pytest.mark.slow), "laws and forms"],
)
def test_a_run_without_a_compiler_says_what_to_install(missing, tmp_path, monkeypatch):
    start_afresh(tmp_path, monkeypatch)
    write_scene(tmp_path, QUIET, "block")
    if missing == "laws of an earlier run":
        assert run(["solve", "scene.toml"], tmp_path).code == 0
        for path in (tmp_path / "cache").rglob("fenics_contact_laws_*"):
            path.unlink()
    monkeypatch.setenv("CC", "/there/is/none")
    done = run(["solve", "scene.toml"], tmp_path)
    assert done.code == 2
    assert done.err.count("\n") == 1 and "Traceback" not in done.out
    assert "install a C compiler, for instance by apt install gcc" in done.err
    assert "/there/is/none" in done.err


def compile_laws(folder: str) -> None:
    """Load the laws from a folder, in a process of its own."""
    load(Path(folder))


def test_processes_may_compile_at_the_same_time(tmp_path, monkeypatch):
    start_afresh(tmp_path, monkeypatch)
    context, laws = get_context("spawn"), tmp_path / "laws"
    started = [context.Process(target=compile_laws, args=(str(laws),)) for _ in range(2)]
    for process in started:
        process.start()
    for process in started:
        process.join()
    assert [process.exitcode for process in started] == [0, 0]
    assert len(list(laws.iterdir())) == 1


@pytest.mark.mpi
def test_where_one_rank_cannot_compile_all_say_so():
    comm = MPI.COMM_WORLD

    def compile_here() -> None:
        if comm.rank == comm.size - 1:
            raise OSError("no compiler")

    with pytest.raises(InputError, match=r"install a C compiler.* \(no compiler\)"):
        in_turns(comm, compile_here)
