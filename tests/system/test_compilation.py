"""Forms are compiled before all other work, in silence, and by the first run only."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests.system.program import result, run, write_scene

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
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    mesh, changes = SCENES[name]
    write_scene(tmp_path, {"output.pictures": False} | changes, mesh)
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


@pytest.mark.slow
def test_a_run_killed_while_it_compiled_does_not_stop_the_next(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    write_scene(tmp_path, {"output.pictures": False}, "block")
    command = [sys.executable, "-m", "fenics_contact", "solve", "scene.toml"]
    killed = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL)
    cache, end = tmp_path / "cache", time.monotonic() + 60.0
    while not list(cache.rglob("libffcx_*.c")) and time.monotonic() < end:
        time.sleep(0.01)
    killed.kill()
    killed.wait()
    left = [c for c in cache.rglob("libffcx_*.c") if not c.with_suffix(".c.cached").exists()]
    assert left
    found = run(["solve", "scene.toml"], tmp_path)
    assert (found.code, found.err) == (0, "")


def test_a_run_without_a_compiler_says_so_and_finds_the_same(tmp_path, monkeypatch):
    """Forms are those of an earlier run; joint laws are computed in Python."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    write_scene(tmp_path, {"output.pictures": False}, "block")
    runs, recorded = [], []
    for compiler in ("cc", "/there/is/none"):
        monkeypatch.setenv("CC", compiler)
        runs.append(run(["solve", "scene.toml"], tmp_path))
        recorded.append(result(tmp_path / "scene"))
        for path in (tmp_path / "cache").rglob("fenics_contact_laws_*"):
            path.unlink()
    assert [done.code for done in runs] == [0, 0]
    told = [done.out.count("joint laws are not compiled") for done in runs]
    assert told == [0, 1]
    assert [any("not compiled" in text for text in one["warnings"]) for one in recorded] == [0, 1]
    factors = [one["load_factor"] for one in recorded]
    assert factors[0] == factors[1]
