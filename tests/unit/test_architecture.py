"""Who may know what: the solvers no mesh, one module the versions of dolfinx, few the console."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import fenics_contact

PACKAGE = Path(fenics_contact.__file__).parent
MODULES = sorted(path.stem for path in PACKAGE.glob("*.py"))
TREES = {name: ast.parse((PACKAGE / f"{name}.py").read_text()) for name in MODULES}

#: Modules that see PETSc objects and arrays only.
SOLVERS = [
    "bounds",
    "block_modes",
    "bound_qp",
    "capacity",
    "central_path",
    "certificate",
    "continuation",
    "coulomb",
    "interior_point",
    "joint_operator",
    "path_equations",
    "problem",
    "splitting",
    "springs",
]

#: Modules that are slow to import or not always needed.
LATE = {"gmsh", "matplotlib", "scipy", "tqdm"}

#: Modules that talk to people.
CONSOLE = {"cli", "__main__"}


def imported(nodes: Iterator[ast.AST]) -> set[str]:
    """Full names of the modules imported by statements among nodes."""
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def roots(names: set[str]) -> set[str]:
    return {name.split(".")[0] for name in names}


def at_import(tree: ast.AST) -> Iterator[ast.AST]:
    """Nodes that run when a module is imported: all but the bodies of functions."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        yield node
        yield from at_import(node)


def own_imports(name: str) -> set[str]:
    """Modules of the package that a module imports when it is imported."""
    names = imported(at_import(TREES[name]))
    inside = {n.split(".")[1] for n in names if n.startswith("fenics_contact.")}
    return inside & set(MODULES)


def test_all_modules_are_looked_at():
    assert {*SOLVERS, *CONSOLE, "compat"} <= set(MODULES)


@pytest.mark.parametrize("name", SOLVERS)
def test_solvers_know_no_mesh(name):
    assert not roots(imported(ast.walk(TREES[name]))) & {"dolfinx", "ufl", "basix", "gmsh"}


@pytest.mark.parametrize("name", sorted(set(MODULES) - {"compat"}))
def test_versions_of_dolfinx_are_known_to_one_module(name):
    text = (PACKAGE / f"{name}.py").read_text()
    for probe in ("hasattr(", "inspect.", "dolfinx.__version__", "._mesh", "_cpp_object"):
        assert probe not in text, probe
    names = imported(ast.walk(TREES[name]))
    assert not names & {"dolfinx.cpp", "basix.ufl", "inspect", "importlib.metadata"}


def test_the_module_of_versions_asks_for_features_not_numbers():
    text = (PACKAGE / "compat.py").read_text()
    assert "hasattr(fem" in text
    assert "__version__" not in text


@pytest.mark.parametrize("name", MODULES)
def test_no_assert_statement(name):
    # They vanish under `python -O`; what can go wrong raises an exception of the package.
    lines = [node.lineno for node in ast.walk(TREES[name]) if isinstance(node, ast.Assert)]
    assert lines == []


@pytest.mark.parametrize("name", sorted(set(MODULES) - CONSOLE))
def test_no_world_communicator_and_no_print(name):
    for node in ast.walk(TREES[name]):
        called = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        assert not (called and node.func.id == "print"), node.lineno
        word = getattr(node, "attr", getattr(node, "id", ""))
        assert word != "COMM_WORLD", node.lineno
        if isinstance(node, ast.ImportFrom):
            assert "COMM_WORLD" not in {alias.name for alias in node.names}


@pytest.mark.parametrize("name", MODULES)
def test_slow_modules_are_imported_where_they_are_used(name):
    assert not roots(imported(at_import(TREES[name]))) & LATE


def test_imports_have_no_cycle():
    graph = {name: own_imports(name) for name in MODULES}
    done: set[str] = set()
    while len(done) < len(graph):
        ready = {name for name in graph if name not in done and graph[name] <= done}
        assert ready, f"cycle among {sorted(set(graph) - done)}"
        done |= ready


def test_package_is_imported_without_gmsh_matplotlib_and_tqdm():
    code = (
        "import sys\n"
        "from unittest import mock\n"
        "with mock.patch.dict(sys.modules, {'gmsh': None, 'matplotlib': None, 'tqdm': None}):\n"
        "    import fenics_contact\n"
        "print(sorted({'gmsh', 'matplotlib.pyplot', 'tqdm'} & set(sys.modules)))\n"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env=single_process_environment(),
    )
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.strip() == "[]"


def single_process_environment() -> dict[str, str]:
    """The environment without what would make a child take part in our MPI run."""
    import os

    mpi = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_")
    kept = {key: value for key, value in os.environ.items() if not key.startswith(mpi)}
    path = [str(PACKAGE.parent), kept.get("PYTHONPATH", "")]
    return kept | {"PYTHONPATH": os.pathsep.join(filter(None, path))}
