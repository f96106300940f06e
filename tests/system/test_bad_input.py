"""Wrong input: exit code 2, one message that names the thing, nothing written, on any ranks."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

from tests.system.program import LEFT_OUT, Run, files, run, run_command, run_here, write_scene

NAN, INF = float("nan"), float("inf")


@dataclass(frozen=True)
class Wrong:
    """A wrong scene.

    Attributes:
        names: What the message must contain.
        changes: Of the scene, by dotted key.
        mesh: Its mesh.
        files: Texts written over or besides scene and mesh; None takes a file away.
        arguments: More arguments.
    """

    names: tuple[str, ...]
    changes: Mapping[str, Any] = field(default_factory=dict)
    mesh: str = "block"
    files: Mapping[str, str | None] = field(default_factory=dict)
    arguments: tuple[str, ...] = ()


def value(key: str, wrong: Any, *names: str) -> Wrong:
    """A wrong value, whose key the message must name."""
    return Wrong((key, *names), {key: wrong})


def no_group(table: str, wrong: Any) -> Wrong:
    """A group that the mesh lacks; the message names its table and the mesh."""
    return Wrong((f"{table}.nowhere", "block.msh"), {f"{table}.nowhere": wrong})


def law(key: str, *names: str, **table: Any) -> Wrong:
    """A wrong law of all joints, of which the message must name a key."""
    return Wrong((f"joints.default{key and '.'}{key}", *names), {"joints.default": table})


METHODS = ("auto", "monolithic", "splitting", "active-set")
STEEL = {"young": 1.0, "poisson": 0.2}
CUT_SHORT = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n"
ROUGH = {"friction": 0.5}

FILES = {
    "missing scene": Wrong(("scene.toml", "does not exist"), files={"scene.toml": None}),
    "scene not TOML": Wrong(("scene.toml", "TOML", "line 1"), files={"scene.toml": "[mesh\n"}),
    "scene not text": Wrong(("scene.toml", "TOML"), files={"scene.toml": "\x00\x01"}),
    "missing mesh": Wrong(("block.msh", "does not exist"), files={"block.msh": None}),
    "mesh not gmsh": Wrong(("block.msh", "gmsh"), files={"block.msh": "solid block\n"}),
    "no surface group": Wrong(("no_surface_group.msh", "two-dimensional"), mesh="no_surface_group"),
    "no mesh named": value("mesh.file", LEFT_OUT),
}

KEYS = {
    "unknown table": value("material", {}, "materials"),
    "unknown mesh key": value("mesh.order", 1),
    "unknown material key": value("materials.default.yung", 1.0, "young"),
    "unknown joint key": value("joints.default.fricton", 1.0, "friction"),
    "unknown load key": value("loads.live.bodyforce", [1.0, 0.0]),
    "unknown load": value("loads.wind", {}),
    "unknown solve key": value("solve.tol", 1e-6),
    "unknown output key": value("output.vtk", True),
    "no young": value("materials.default.young", LEFT_OUT),
    "no material": value("materials", LEFT_OUT),
    "no friction": law("", "friction"),
    "friction and Tresca": law("", "friction", law="tresca", bound=1.0, friction=0.5),
}

GROUPS = {
    "materials": no_group("materials", STEEL),
    "joints": no_group("joints", ROUGH),
    "foundations": no_group("foundations", ROUGH),
    "supports": no_group("supports", "fixed"),
    "dead traction": no_group("loads.dead.traction", [1.0, 0.0]),
    "live traction": no_group("loads.live.traction", [1.0, 0.0]),
    "cells without material": Wrong(("'high'",), {"materials": {"low": STEEL}}, "stack"),
    "group of two roles": Wrong(("'base'",), {"supports.base": "fixed"}),
}

VALUES = {
    **{f"young {x}": value("materials.default.young", x) for x in (0.0, -1.0e9, NAN, INF)},
    **{f"density {x}": value("materials.default.density", x) for x in (-1.0, NAN, INF)},
    **{f"poisson {x}": value("materials.default.poisson", x) for x in (0.5, -1, 0.7, NAN)},
    **{f"friction {x}": value("joints.default.friction", x) for x in (-0.1, NAN, INF)},
    **{f"friction of the ground {x}": value("foundations.base.friction", x) for x in (-0.1, NAN)},
    **{f"bound {x}": law("bound", law="tresca", bound=x) for x in (-1.0, NAN, INF)},
    **{f"tolerance {x}": value("solve.tolerance", x) for x in (0.0, -1e-6, 1e-13, 0.2, NAN)},
    **{f"degree {x}": value("mesh.degree", x) for x in (0, 3)},
    **{f"capacity {x}": value("output.capacity", x) for x in (-1, 10**6)},
    "law": law("law", "glue", law="glue"),
    "method": value("solve.method", "newton", "newton", "fixed-point"),
    **{f"method {x!r}": value("solve.method", x, f"'{x}'", *METHODS)
       for x in ("", "Splitting", "active_set", "monolithic ")},
    "direction": value("solve.direction", "up", "'up'", "both"),
    "control": value("solve.control", "speed", "'speed'", "load"),
    "slip": value("solve.slip", "zero", "'zero'", "load-steps"),
    "slip by steps under work control": value("solve.slip", "load-steps", "control"),
    "states": value("solve.states", "all", "'all'", "lowest"),
    "lowest state under load control": Wrong(
        ("solve.states", "control"), {"solve.states": "lowest", "solve.control": "load"}
    ),
    "plane": value("plane.state", "bent", "bent", "strain"),
    "support": value("supports.left", "glued", "glued", "roller"),
    "young too long": value("materials.default.young", 10**400),
}  # fmt: skip

TYPES = {
    "string for number": value("materials.default.young", "stiff"),
    "bool for number": value("materials.default.young", True),
    "bool for friction": value("joints.default.friction", False),
    "list for number": value("materials.default.poisson", [0.2]),
    "number for table": value("materials.default", 1.0),
    "string for table": value("loads.live", "wind"),
    "number for text": value("mesh.file", 3),
    "number for control": value("solve.control", 1),
    "bool for slip": value("solve.slip", True),
    "list for states": value("solve.states", ["first", "lowest"]),
    "number for support": value("supports.left", 1),
    "fraction for whole number": value("output.capacity", 2.5),
    "bool for whole number": value("output.capacity", True),
    "number for flag": value("output.paraview", 1),
    "string for flag": value("output.pictures", "no"),
}

FIXED_AND_PUSHED = {"foundations": {}, "supports.base": "fixed",
                    "loads.live": {"traction": {"side": [1000.0, 0.0]}}}  # fmt: skip
LOADS = {
    "no live load": value("loads.live", LEFT_OUT),
    "empty live load": Wrong(("loads.live", "zero"), {"loads.live": {}}),
    "live load zero": Wrong(("loads.live", "zero"), {"loads.live.body": [0.0, 0.0]}),
    "live load on no weight": Wrong(("loads.live", "zero"), {"materials.default.density": 0.0}),
    "live load on a fixed block": Wrong(("loads.live", "zero", "free"), FIXED_AND_PUSHED, "stack"),
    "dead body of three": value("loads.dead.body", [0.0, -9.81, 0.0]),
    "live body of three": value("loads.live.body", [9.81, 0.0, 0.0]),
    "body of one number": value("loads.live.body", 9.81),
    "body of strings": value("loads.live.body", ["9.81", "0"]),
    "body not finite": value("loads.live.body", [NAN, 0.0]),
    "traction of three": value("loads.live.traction.left", [1.0, 0.0, 0.0]),
    "traction not finite": value("loads.live.traction.left", [INF, 0.0]),
}

CONTACT = {
    "no facet opposite": Wrong(("'top'", "no facet opposite"), {"joints.top": ROUGH}),
    "on nothing": Wrong(("block.msh", "[supports]", "[foundations]"), {"foundations": {}}),
    "block in the air": Wrong(("apart.msh", "(0.5, 1.25)"), mesh="apart"),
    "no joint law": Wrong(("[joints.default]", "0.5)"), {"joints": {}}, "stack"),
    "nodes do not match": Wrong(("matching nodes", ", 1)"), mesh="mismatched"),
    "nodes of a group do not match": Wrong(
        ("'bed'", "same nodes"), {"joints.bed": ROUGH}, "mismatched"
    ),
    "foundation in a joint": Wrong(("'bed'",), {"foundations.bed": ROUGH}, "stack"),
}

ARGUMENTS = {
    f"set {assignment}": Wrong(names, arguments=("--set", assignment))
    for assignment, names in {
        "friction": ("--set", "friction"),
        "=3": ("--set", "=3"),
        "mesh.file.x=1": ("--set", "mesh.file.x"),
        "joints.default.mu=1": ("joints.default.mu",),
        "solve.control=force": ("solve.control", "'force'"),
        "solve.slip=load-steps": ("slip", "control"),
        "materials.default.young=soft": ("materials.default.young",),
    }.items()
}

MINE = {"occupied": "mine"}
OUTPUT = {"output is a file": Wrong(("occupied",), files=MINE, arguments=("-o", "occupied"))}

# Not within this process: see `test_good_mesh_is_read_after_a_broken_one`.
BROKEN = {"mesh cut short": Wrong(("block.msh", "gmsh"), files={"block.msh": CUT_SHORT})}

ALL = FILES | KEYS | GROUPS | VALUES | TYPES | LOADS | CONTACT | ARGUMENTS | OUTPUT | BROKEN


def prepare(wrong: Wrong, folder: Path) -> list[str]:
    """Write the files of a case, once; returns the arguments."""
    if MPI.COMM_WORLD.rank == 0:
        write_scene(folder, wrong.changes, wrong.mesh)
        for name, text in wrong.files.items():
            if text is None:
                (folder / name).unlink()
            else:
                (folder / name).write_text(text)
    MPI.COMM_WORLD.barrier()
    return ["solve", "scene.toml", *wrong.arguments]


def check_message(found: Run, names: tuple[str, ...]) -> None:
    messages = [line for line in found.err.splitlines() if line.startswith("fenics-contact: ")]
    assert found.code == 2, found.err
    assert "Traceback" not in found.out + found.err
    assert len(messages) == 1, found.err
    for name in names:
        assert name in messages[0]


@pytest.mark.mpi
@pytest.mark.parametrize("name", [name for name in ALL if name not in BROKEN])
def test_message_names_what_is_wrong(name, folder, capsys):
    """Exit code 2 on all ranks, one message on the first, nothing written."""
    arguments = prepare(ALL[name], folder)
    before = files(folder)
    MPI.COMM_WORLD.barrier()
    found = run_here(arguments, capsys)
    if MPI.COMM_WORLD.rank == 0:
        check_message(found, ALL[name].names)
        assert found.err.count("\n") == 1
    else:
        assert (found.code, found.out, found.err) == (2, "", "")
    MPI.COMM_WORLD.barrier()
    assert files(folder) == before


# One that rank 0 finds alone, one that all find, one that gmsh finds.
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("name", ["missing mesh", "no facet opposite", "mesh cut short"])
def test_exit_code_2_and_one_message(name, ranks, tmp_path):
    arguments = prepare(ALL[name], tmp_path)
    before = files(tmp_path)
    found = run(arguments, tmp_path, ranks)
    check_message(found, ALL[name].names)
    if ranks == 1:  # mpirun adds a note of its own
        assert found.err.count("\n") == 1
    assert files(tmp_path) == before


@pytest.mark.parametrize("name", ["missing mesh", "unknown material key", "no facet opposite"])
def test_check_finds_the_same(name, folder, capsys):
    _, *arguments = prepare(ALL[name], folder)
    check_message(run_here(["check", *arguments], capsys), ALL[name].names)


def test_quiet_run_still_says_what_is_wrong(folder, capsys):
    wrong = ALL["missing mesh"]
    found = run_here([*prepare(wrong, folder), "-q"], capsys)
    check_message(found, wrong.names)
    assert found.out == ""


def test_scene_without_ending_is_not_taken_for_its_output_folder(folder, capsys):
    scene = write_scene(folder, name="wall")
    text = scene.read_text()
    check_message(run_here(["solve", "wall"], capsys), ("wall",))
    assert scene.read_text() == text


@pytest.mark.parametrize(
    ("arguments", "ranks"),
    [(["solve"], 1), (["mend", "scene.toml"], 1), (["solve", "scene.toml", "--fast"], 2)],
)
def test_wrong_arguments_are_said_once(arguments, ranks, tmp_path):
    write_scene(tmp_path)
    before = files(tmp_path)
    found = run(arguments, tmp_path, ranks)
    assert found.code == 2 and "Traceback" not in found.out + found.err
    assert found.err.count("usage:") == found.err.count("error:") == 1
    assert files(tmp_path) == before


READ_BROKEN_THEN_GOOD = """
from fenics_contact import BlockMesh, InputError
try:
    BlockMesh.from_file("broken.msh")
except InputError:
    print(BlockMesh.from_file("block.msh").cell_names)
"""


def test_good_mesh_is_read_after_a_broken_one(tmp_path):
    # gmsh stays in the process, and with it what a failed read left behind.
    write_scene(tmp_path)
    (tmp_path / "broken.msh").write_text(CUT_SHORT)
    found = run_command([sys.executable, "-c", READ_BROKEN_THEN_GOOD], tmp_path)
    assert (found.code, found.out) == (0, "('blocks',)\n"), found.err
