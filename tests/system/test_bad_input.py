"""Wrong input: exit code 2, one message that names the thing, nothing written, on any ranks."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from mpi4py import MPI

from fenics_contact import BlockMesh, InputError
from tests.quick import slow
from tests.system.bad_input_cases import (
    ALL,
    CUT_SHORT,
    TWO_BEDS,
    TWO_SURFACES,
    Wrong,
    msh,
    only_mesh,
)
from tests.system.program import BLOCK, Run, files, result, run, run_here, toml, write_scene


def prepare(wrong: Wrong, folder: Path) -> list[str]:
    """Write the files of a case, once; returns the arguments."""
    if MPI.COMM_WORLD.rank == 0:
        write_scene(folder, wrong.changes, wrong.mesh)
        for name, text in wrong.files.items():
            if not isinstance(text, (str, bytes)):
                (folder / name).unlink(missing_ok=True)
            if isinstance(text, dict):
                (folder / name).mkdir()
            elif text is not None:
                data = text.encode() if isinstance(text, str) else text
                (folder / name).write_bytes(data)
    MPI.COMM_WORLD.barrier()
    return ["solve", "scene.toml", *wrong.arguments]


def check_message(found: Run, names: tuple[str, ...]) -> None:
    messages = [line for line in found.err.splitlines() if line.startswith("fenics-contact: ")]
    assert found.code == 2, found.err
    assert "Traceback" not in found.out + found.err
    assert len(messages) == 1, found.err
    for name in names:
        assert name in messages[0]


#: Of meshes that are read in a process of their own, which takes half a second, those like others.
ALIKE = {name for name in ALL if name.startswith(("coordinate", "blocks overlap", "mesh file"))}
ALIKE |= {"cells twice, turned", "all cells twice", "cell of a node", "three cells on a facet"}
ALIKE |= {"crossed sides", "triangle for a quadrilateral", "nodes in a line"}
ALIKE -= {"coordinate nan", "coordinates times 1e+300", "coordinates times 1e-100"}
ALIKE -= {"blocks overlap by 2 mm", "blocks overlap by a corner"}
ALIKE -= {f"mesh file: {name}" for name in ("header alone", "a million nodes", "said to be binary")}


@pytest.mark.mpi
@pytest.mark.parametrize("name", [name for name in ALL if name not in ALIKE] + slow(*sorted(ALIKE)))
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


# One that rank 0 finds alone, one that all find.
@pytest.mark.parametrize(("name", "ranks"), [("missing mesh", 1), ("no facet opposite", 2)])
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
    [(["solve"], 1), (["mend", "scene.toml"], 1), (["solve", "scene.toml", "--faster"], 2)],
)
def test_wrong_arguments_are_said_once(arguments, ranks, tmp_path, capsys):
    write_scene(tmp_path)
    before = files(tmp_path)
    found = run_here(arguments, capsys) if ranks == 1 else run(arguments, tmp_path, ranks)
    assert found.code == 2 and "Traceback" not in found.out + found.err
    assert found.err.count("usage:") == found.err.count("error:") == 1
    assert files(tmp_path) == before


def test_good_mesh_is_read_after_a_broken_one(tmp_path):
    write_scene(tmp_path)
    (tmp_path / "broken.msh").write_text(CUT_SHORT)
    with pytest.raises(InputError):
        BlockMesh.from_file(tmp_path / "broken.msh")
    assert BlockMesh.from_file(tmp_path / "block.msh").cell_names == ("blocks",)


# ---- what is legal

#: Changes of a scene or its files, and what its warnings say.
DOUBTS = {
    "nothing": (Wrong(()), ()),
    "mark of byte order": (Wrong((), files={"scene.toml": "\ufeff" + toml(BLOCK)}), ()),
    "clockwise cells": (only_mesh(msh(cells=[(1, 3, 2), (1, 3, 4)])), ()),
    "angle for friction": (
        Wrong((), {"foundations.base.friction": 35.0}),
        ("foundations.base.friction = 35",),
    ),
    "large movement": (
        Wrong((), {"loads.dead.movement.base.displacement": [0.3, 0.0]}),
        ("loads.dead.movement.base moves it by up to 0.3 m",),
    ),
    "GPa": (Wrong((), {"materials.default.young": 20.0}), ("young = 20 Pa",)),
    "hardly compressible": (Wrong((), {"materials.default.poisson": 0.499}), ("poisson",)),
    "block without weight": (
        Wrong((), {"materials.high": {"young": 1e9, "poisson": 0.2}}, "stack"),
        ("loads.dead.body does not act on 1 blocks", "loads.live.body does not act on 1 blocks"),
    ),
    "traction on one side of a joint": (
        Wrong((), {"loads.dead.traction": {"bed0": [0.0, -1.0]}}, files={"block.msh": TWO_BEDS}),
        ("loads.dead.traction.bed0 also acts on 1 facets",),
    ),
    "numbers in other units": (
        Wrong(
            (),
            {
                "materials.default.density": 22.0,
                "materials.default.compressive_strength": 2.6,
                "foundations.base.compressive_strength": 1.5,
                "loads.dead.earth": {"left": {"level": 0.5, "unit_weight": 18.0}},
            },
        ),
        (
            "density = 22 kg/m3 is very light",
            "materials.default.compressive_strength = 2.6 Pa is very low",
            "foundations.base.compressive_strength = 1.5 Pa is very low",
            "loads.dead.earth.left.unit_weight = 18 N/m3 is very light",
        ),
    ),
    "surfaces that share nodes": (only_mesh(TWO_SURFACES), ("2 of the 2 surfaces drawn",)),
}


@pytest.mark.mpi
@pytest.mark.parametrize("name", DOUBTS)
def test_warnings(name, folder, capsys):
    """A line each, and in result.json; without a warning where there is no doubt."""
    wrong, parts = DOUBTS[name]
    arguments = [*prepare(wrong, folder), "--set", "output.pictures=false"]
    found = run_here(arguments, capsys)
    assert found.code in (0, 3), found.err
    if MPI.COMM_WORLD.rank == 0:
        lines = [line for line in found.out.splitlines() if line.startswith("warning: ")]
        assert len(lines) == len(parts)
        assert all(part in line for part, line in zip(parts, lines, strict=True))
        assert [f"warning: {text}" for text in result(folder / "scene")["warnings"]] == lines
    checked = run_here(["check", "scene.toml"], capsys)
    assert checked.out.count("warning: ") == len(parts) * (MPI.COMM_WORLD.rank == 0)


def test_scene_that_is_a_pipe_is_refused(folder, capsys):
    """Nobody may ever write to it."""
    os.mkfifo(folder / "pipe.toml")
    check_message(run_here(["check", folder / "pipe.toml"], capsys), ("pipe.toml", "is a pipe"))
