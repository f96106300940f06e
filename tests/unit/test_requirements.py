"""What the package says where dolfinx, petsc4py, mpi4py or gmsh is missing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fenics_contact.requirements import missing_requirements

ROOT = Path(__file__).resolve().parents[2]

#: Runs a statement as if the first argument's modules were not installed.
HIDDEN = """
import sys
sys.modules |= {name: None for name in sys.argv[1].split(",")}
statement = sys.argv[2]
sys.argv[1:] = sys.argv[3:]
exec(statement)
"""
FENICSX = "dolfinx,petsc4py,mpi4py,ufl,basix,ffcx"
COMMAND_LINE = "from fenics_contact.cli import main; sys.exit(main())"


def run_without(modules: str, statement: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """A process that has not got some modules."""
    mpi = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_")
    environment = {key: value for key, value in os.environ.items() if not key.startswith(mpi)}
    environment["PYTHONPATH"] = str(ROOT)
    command = [sys.executable, "-c", HIDDEN, modules, statement, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


def test_nothing_is_missing_here():
    assert missing_requirements() == ""


@pytest.mark.parametrize(("option", "begins"), [("--version", "fenics"), ("--help", "usage: ")])
def test_version_and_help_are_told_without_dolfinx(option, begins):
    done = run_without(FENICSX, COMMAND_LINE, option)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(begins)


@pytest.mark.parametrize("command", ["solve", "check", "stands"])
def test_commands_on_a_mesh_say_what_to_install(command):
    scene = ROOT / "demos" / "03_wall_w3.toml"
    done = run_without(f"{FENICSX},gmsh", COMMAND_LINE, command, str(scene))
    assert (done.returncode, done.stdout) == (2, "")
    first, *ways = done.stderr.splitlines()
    assert first.startswith("fenics-contact: dolfinx, petsc4py and mpi4py are not installed")
    for way in ("apt install python3-dolfinx", "WSL", "conda env create", "docker build"):
        assert any(way in line for line in ways), way


#: A block of 1 x 1 on another, which is ground: with friction 0.4 it slides at 0.4 g.
PLANE = """
[blocks.base]
polygon = [[0, 0], [1, 0], [1, 1], [0, 1]]
fixed = true
[blocks.top]
polygon = [[0, 1], [1, 1], [1, 2], [0, 2]]
[loads]
dead.body = [0.0, -9.81]
live.body = [9.81, 0.0]
"""
SPACE = """
dimension = 3
[blocks.base]
box = [[0, 0, 0], [1, 1, 1]]
fixed = true
[blocks.top]
box = [[0, 0, 1], [1, 1, 2]]
[loads]
dead.body = [0.0, 0.0, -9.81]
live.body = [9.81, 0.0, 0.0]
"""
ALL_COMMANDS = """
from fenics_contact.cli import main
for command in sys.argv[1:]:
    if code := main(command.split()):
        sys.exit(code)
"""


@pytest.mark.parametrize("scene", [PLANE, SPACE], ids=["plane", "space"])
def test_blocks_without_a_mesh_need_what_pip_installs(scene, tmp_path):
    path = tmp_path / "scene.toml"
    common = "[materials.default]\ndensity = 2000.0\n[joints.default]\nfriction = 0.4\n"
    path.write_text(f"{scene}{common}")
    done = run_without(
        f"{FENICSX},gmsh,cffi",
        ALL_COMMANDS,
        f"check {path}",
        f"stands {path} -o {tmp_path}/state",
        f"solve {path} -o {tmp_path}/out",
        f"sweep {path} -o {tmp_path}/sweep --vary joints.default.friction=0.3,0.4",
        f"report {tmp_path}/out",
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    found = json.loads((tmp_path / "out" / "result.json").read_text())
    assert found["load_factor"] == pytest.approx(0.4, abs=1e-4)
    assert (tmp_path / "out" / "report.html").exists()


def test_the_way_without_dolfinx_is_named(tmp_path):
    path = tmp_path / "scene.toml"
    common = "[materials.default]\ndensity = 2000.0\n[joints.default]\nfriction = 0.4\n"
    path.write_text(f"{SPACE}{common}compressive_strength = 1e6\n[output]\nstress = true\n")
    lost = f"{FENICSX},gmsh,clarabel"
    wall = str(ROOT / "demos" / "03_wall_w3.toml")
    done = run_without(lost, COMMAND_LINE, "check", wall)
    assert done.stderr.strip().endswith(
        '[blocks] file = "wall.msh" or "wall.dxf" in place of [mesh]'
    )
    done = run_without(lost, COMMAND_LINE, "check", str(path))
    assert done.returncode == 0 and "leave out output.stress" in done.stdout
    assert "warning: compressive_strength in space needs clarabel" in done.stdout
    done = run_without(lost, COMMAND_LINE, "solve", str(path), "-o", f"{tmp_path}/out")
    assert done.returncode == 2 and "leave out output.stress" in done.stderr


@pytest.mark.parametrize("lost", ["numpy", "scipy", "matplotlib,shapely"])
@pytest.mark.parametrize("more", ["", f",{FENICSX}"])
def test_commands_say_what_pip_installs(lost, more):
    done = run_without(lost + more, COMMAND_LINE, "solve", "scene.toml")
    assert (done.returncode, done.stdout) == (2, "")
    listed = lost.replace(",", " and ")
    assert done.stderr.startswith(f"fenics-contact: {listed} ")
    assert " not installed (pip install numpy scipy matplotlib shapely)" in done.stderr
    assert "apt install" not in done.stderr


def test_python_says_what_to_install():
    statement = "from fenics_contact import BlockMesh; BlockMesh.from_file('wall.msh')"
    done = run_without("dolfinx", statement)
    assert done.returncode == 1
    assert "fenics_contact: dolfinx is not installed (FEniCSx)" in done.stderr
    assert "apt install python3-dolfinx" in done.stderr


def test_the_package_itself_and_its_errors_need_nothing():
    statement = "import fenics_contact as f; print(f.__version__, f.InputError.__name__)"
    done = run_without(FENICSX, statement)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith("InputError\n")


def test_builders_say_that_gmsh_is_missing():
    done = run_without("gmsh", "from fenics_contact.meshing import wall; wall([[1.0]])")
    assert "InputError: this needs gmsh, which is not installed: apt install" in done.stderr
