"""Who may import whom, and who may know what: MPI, dolfinx's versions, the console."""

from __future__ import annotations

import ast
import functools
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import fenics_contact

PACKAGE = Path(fenics_contact.__file__).parent
FILES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts): path
    for path in sorted(PACKAGE.rglob("*.py"))
    if path.name != "__init__.py"  # a package's face only hands on what others define
}

#: Floors from the ground up: a module or folder imports its own floor and those below.
FLOORS = (
    {"errors", "compat", "lazily", "parallel", "requirements"}
    | {"search_options", "version", "workers"},
    {"geometry"},
    {"scene"},
    {"discretization"},
    {"faces"},
    {"results"},
    {"collapse", "output", "console"},
    {"answers", "accuracy"},
    {"elastic", "equilibrium", "limit_load", "motion", "spatial"},
    {"sweeps"},
    {"cli"},
    {"__main__"},
)

#: Short ways to modules of `geometry`, for users: nothing in the package imports them.
SHORT = {"mesh", "meshing", "builders", "drawing"}

#: Beside the floors: PETSc and numpy only, used by these.
SOLVERS = "solvers"
SOLVERS_USERS = {"discretization", "faces", "results", "collapse", "answers"}
IN_SOLVERS = {name for name in FILES if name.startswith(f"{SOLVERS}.")}
ON_FLOORS = set(FILES) - IN_SOLVERS - SHORT

#: Modules that talk to people.
CONSOLE = {"cli.command_line", "cli.commands", "__main__"}

#: Modules that are slow to import or not always needed.
LATE = {"ezdxf", "gmsh", "matplotlib", "scipy", "shapely", "weasyprint"}

#: What finds out which dolfinx there is.
PROBES = ("hasattr(", "inspect.", "dolfinx.__version__", "._mesh", "_cpp_object")

#: What not all versions have.
ONE_VERSION = {"dolfinx.cpp", "basix.ufl", "inspect", "importlib.metadata"}


@functools.cache
def tree_of(name: str) -> ast.Module:
    """A module of the package, parsed."""
    return ast.parse(FILES[name].read_text())


@functools.cache
def nodes_of(name: str) -> list[ast.AST]:
    """All nodes of a module."""
    return list(ast.walk(tree_of(name)))


def imported(nodes: Iterable[ast.AST]) -> set[str]:
    """Full names of the modules imported by statements among nodes."""
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
    return names


def at_import(tree: ast.AST) -> Iterator[ast.AST]:
    """Nodes that run when a module is imported: all but the bodies of functions."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            continue
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        yield node
        yield from at_import(node)


@functools.cache
def own_imports(name: str) -> set[str]:
    """Modules of the package that a module imports anywhere, for type checkers too."""
    names = {n.removeprefix("fenics_contact.") for n in imported(nodes_of(name))}
    return (names & set(FILES)) - {name}


def roots(names: Iterable[str]) -> set[str]:
    return {name.split(".")[0] for name in names}


def floor(name: str) -> int:
    (number,) = (k for k, names in enumerate(FLOORS) if name.split(".")[0] in names)
    return number


def test_every_module_has_its_floor():
    assert roots(FILES) == set().union(*FLOORS, {SOLVERS}, SHORT)
    assert len(IN_SOLVERS) >= 5


def test_imports_run_downstairs():
    pairs = {(name, other) for name in ON_FLOORS for other in own_imports(name) & ON_FLOORS}
    assert {(name, other) for name, other in pairs if floor(other) > floor(name)} == set()


def test_what_is_shown_is_data():
    shown = {name for name in FILES if roots([name]) & {"output", "console", "results"}}
    others = {name: roots(own_imports(name)) & {"collapse", "answers"} for name in shown}
    assert {name: found for name, found in others.items() if found} == {}


def test_short_ways_are_for_users():
    assert {name for name in FILES if own_imports(name) & SHORT} == set()


def test_solvers_are_used_by_few_folders():
    users = {name for name in ON_FLOORS if own_imports(name) & IN_SOLVERS}
    assert roots(users) <= SOLVERS_USERS


def test_solvers_import_each_other_and_errors():
    others = {
        name: roots(own_imports(name)) - {SOLVERS, "errors", "parallel", "search_options"}
        for name in IN_SOLVERS
    }
    assert {name: found for name, found in others.items() if found} == {}
    known = roots(name for solver in IN_SOLVERS for name in imported(nodes_of(solver)))
    assert not known & {"dolfinx", "ufl", "basix", "gmsh"}


def test_imports_have_no_circle():
    sorter = TopologicalSorter({name: own_imports(name) for name in FILES})
    try:
        sorter.prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


SOLVERS_ALONE = """
import importlib, sys, types
package = types.ModuleType("fenics_contact")  # its face imports everything
package.__path__ = [sys.argv[1]]
sys.modules |= {"fenics_contact": package}
sys.modules |= {name: None for name in ("dolfinx", "ufl", "basix", "ffcx", "gmsh")}
for name in sys.argv[2:]:
    importlib.import_module(f"fenics_contact.{name}")
"""


def run_alone(program: str, *arguments: str) -> str:
    """What a program in a process of its own, outside an MPI run of ours, prints as errors."""
    mpi = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_")
    kept = {key: value for key, value in os.environ.items() if not key.startswith(mpi)}
    path = os.pathsep.join(filter(None, [str(PACKAGE.parent), kept.get("PYTHONPATH")]))
    command = [sys.executable, "-c", program, *arguments]
    environment = kept | {"PYTHONPATH": path}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    return done.stderr


def test_solvers_load_without_dolfinx():
    assert run_alone(SOLVERS_ALONE, str(PACKAGE), *IN_SOLVERS) == ""


def test_slow_modules_are_imported_where_they_are_used():
    early = {name: roots(imported(at_import(tree_of(name)))) & LATE for name in FILES}
    assert {name: found for name, found in early.items() if found} == {}


def test_versions_of_dolfinx_are_known_to_one_module():
    for name in FILES:
        text = ast.unparse(tree_of(name))
        if name != "compat":
            assert [probe for probe in PROBES if probe in text] == [], name
            assert not imported(nodes_of(name)) & ONE_VERSION, name
        else:
            assert "hasattr(" in text, "asks for features"
            assert "__version__" not in text, "not for numbers"


def test_no_assert_statement():
    # They vanish under `python -O`; what can go wrong raises an exception of the package.
    for name in FILES:
        assert not any(isinstance(node, ast.Assert) for node in nodes_of(name)), name


def test_no_module_needs_mpi_or_petsc_to_be_imported():
    # `parallel` tries to import them; pip alone installs what rigid blocks need.
    users = {n for n in FILES if roots(imported(at_import(tree_of(n)))) & {"mpi4py", "petsc4py"}}
    assert users == set()


def test_no_world_communicator_and_no_print():
    for name in set(FILES) - CONSOLE:
        nodes = nodes_of(name)
        words = {getattr(node, "attr", getattr(node, "id", "")) for node in nodes}
        assert not {"print", "COMM_WORLD"} & words, name
        assert not any(full.endswith(".COMM_WORLD") for full in imported(nodes)), name


LATE_FACE = """
import sys
import fenics_contact, fenics_contact.cli
early = {"dolfinx", "petsc4py", "scipy", "matplotlib", "gmsh"} & set(sys.modules)
import fenics_contact.limit_load
from fenics_contact import equilibrium, limit_load, sweep
wrong = [one for one in (equilibrium, limit_load, sweep) if not callable(one)]
missing = set(fenics_contact.__all__) - set(dir(fenics_contact))
if early or wrong or missing:
    raise SystemExit(f"{early} {wrong} {missing}")
"""


def test_the_face_imports_what_is_used():
    assert run_alone(LATE_FACE) == ""


def test_the_face_has_no_other_names():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = fenics_contact.nothing
    assert [name for name in fenics_contact.__all__ if not hasattr(fenics_contact, name)] == []


def test_all_folders_are_installed():
    """With what is no Python in them."""
    tables = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text())["tool"]["setuptools"]
    folders = {path.parent.relative_to(PACKAGE.parent) for path in PACKAGE.rglob("*.py")}
    assert {".".join(path.parts) for path in folders} == set(tables["packages"])
    data = {
        PACKAGE.parent.joinpath(*k.split("."), n)
        for k, v in tables["package-data"].items()
        for n in v
    }
    others = {path for path in PACKAGE.rglob("*.*") if path.suffix not in (".py", ".pyc")}
    assert {path for path in others if path.is_file()} == data
