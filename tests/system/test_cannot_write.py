"""Results that cannot be written: exit code 4, one line, and the folder as it was before."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from mpi4py import MPI

from fenics_contact.cli import meshed
from fenics_contact.errors import OutputError
from fenics_contact.output.folder import filled_at_once
from tests.drawing import rectangle
from tests.quick import slow
from tests.system.program import (
    QUIET,
    Run,
    command,
    files,
    launcher,
    run_command,
    run_here,
    write_scene,
)

#: Run the command line, in which no file can be longer than so many bytes, as on a full disk.
ON_A_FULL_DISK = """
import resource, sys
from mpi4py import MPI  # whose own files are there before the disk is full
from fenics_contact.cli import main
sys.dont_write_bytecode = True  # Python would keep the part of a .pyc that fits
resource.setrlimit(resource.RLIMIT_FSIZE, 2 * (int(sys.argv[1]),))
sys.exit(main(sys.argv[2:]))
"""

#: Run a command where the folder "disk" is a read-only disk; root has no other right there.
ON_A_READ_ONLY_DISK = """
mount -t tmpfs tmpfs disk && cp -r given/. disk && mount -o remount,ro disk || exit 99
exec "$@"
"""


def on_a_read_only_disk(arguments: list[str], folder: Path) -> Run:
    """Run the program in a folder where what is in "given" is on a disk, too, that is read-only."""
    unshare = shutil.which("unshare")
    if unshare is None:
        pytest.skip("there is no unshare, by which a disk is made read-only")
    (folder / "disk").mkdir()
    own = [unshare, "--mount", *(["--map-root-user"] if os.getuid() else [])]
    shell = [*own, "sh", "-c", ON_A_READ_ONLY_DISK, "sh"]
    found = run_command([*shell, *command(arguments)], folder)
    if "unshare" in found.err or found.code == 99:
        pytest.skip(f"no disk can be made read-only here: {found.err}")
    return found


#: All ranks run the command, as this test does.
BY_MESH = ["--set", "solve.distribute=true"]


def file_in_place(folder: Path) -> None:
    if folder.is_dir():
        shutil.rmtree(folder)
    folder.write_text("mine")


def no_right(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    (folder / "result.json").mkdir()


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("happens", "reason"),
    [
        (file_in_place, "File exists"),
        (lambda folder: file_in_place(folder.parent), "Not a directory"),
        (no_right, "'result.json' is a folder there"),
    ],
)
def test_folder_that_changes_during_the_run(
    happens: Callable[[Path], None], reason, folder, capsys, monkeypatch
):
    solved = meshed.limit_load

    def solve(*arguments, **options):
        result = solved(*arguments, **options)
        if MPI.COMM_WORLD.rank == 0:
            Path("out").mkdir()
            happens(Path("out/here"))
        MPI.COMM_WORLD.barrier()
        before.update(files(folder))
        MPI.COMM_WORLD.barrier()
        return result

    before: set[str] = set()
    monkeypatch.setattr(meshed, "limit_load", solve)
    if MPI.COMM_WORLD.rank == 0:
        write_scene(folder)
    MPI.COMM_WORLD.barrier()
    found = run_here(["solve", "scene.toml", "-o", "out/here", *BY_MESH], capsys)
    assert found.code == 4
    if MPI.COMM_WORLD.rank == 0:
        assert found.err.count("\n") == 1
        assert f"cannot write to 'out/here': {reason}" in found.err
    MPI.COMM_WORLD.barrier()
    assert files(folder) == before


@pytest.mark.parametrize("size", [0, *slow(1000, 30000)])
def test_full_disk_leaves_nothing(size, tmp_path):
    check_full_disk(size, 1, tmp_path)


@pytest.mark.parametrize("size", slow(100, 5000))
def test_full_disk_on_two_ranks(size, tmp_path):
    check_full_disk(size, 2, tmp_path)


def check_full_disk(size: int, ranks: int, folder: Path) -> None:
    write_scene(folder)
    before = files(folder)
    program = [*launcher(ranks), sys.executable, "-c", ON_A_FULL_DISK, str(size)]
    found = run_command([*program, "solve", "scene.toml", "-o", "new/out"], folder)
    assert found.code == 4, found.err
    assert found.out.startswith("it collapses at 0.3000 g")
    assert found.err.count("fenics-contact: cannot write to 'new/out': ") == 1
    assert "Traceback" not in found.err
    assert files(folder) == before


def test_earlier_result_stays_where_a_new_one_cannot_be_written(tmp_path, capsys):
    scene = write_scene(tmp_path)
    assert run_here(["solve", scene], capsys).code == 0
    before = {path: path.read_bytes() for path in (tmp_path / "scene").iterdir()}
    program = [sys.executable, "-c", ON_A_FULL_DISK, "5000"]
    assert run_command([*program, "solve", str(scene)], tmp_path).code == 4
    assert {path: path.read_bytes() for path in (tmp_path / "scene").iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "target"),
    [
        (["report", "disk/scene"], "disk/scene/report.html"),
        pytest.param(["mesh", "disk/wall.dxf"], "disk/wall.msh", marks=pytest.mark.slow),
        (["sweep", "given/scene.toml", "--vary", "title=a,b", "-o", "disk/out"], "disk/out"),
        *(
            pytest.param(arguments, arguments[-1], marks=pytest.mark.slow)
            for arguments in (
                ["report", "given/scene", "-o", "disk/page.html"],
                ["report", "given/scene", "--pdf", "disk/page.pdf"],
                ["mesh", "given/wall.dxf", "--picture", "disk/wall.png"],
            )
        ),
    ],
)
def test_read_only_disk_is_one_message(arguments, target, tmp_path, capsys):
    given = tmp_path / "given"
    given.mkdir()
    scene = write_scene(given, QUIET)
    assert run_here(["solve", scene, "-q"], capsys).code == 0
    if arguments[0] == "mesh":
        document = pytest.importorskip("ezdxf").new("R2010", units=6)
        document.modelspace().add_lwpolyline(rectangle(0.0, 0.0, 1.0, 0.5), close=True)
        document.saveas(given / "wall.dxf")
    before = files(given)
    found = on_a_read_only_disk(arguments, tmp_path)
    assert (found.code, found.out, found.err.count("\n")) == (2, "", 1)
    assert "cannot write" in found.err and f"'{target}'" in found.err
    assert "Errno" not in found.err and files(given) == before


def test_folder_with_the_name_of_a_picture_is_refused_before_the_run(tmp_path, capsys):
    scene = write_scene(tmp_path)
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "result.json").write_text("{}")
    (folder / "collapse.png").mkdir()
    found = run_here(["solve", scene], capsys)
    assert (found.code, found.err.count("\n")) == (2, 1)
    assert "'collapse.png' is a folder; choose another with -o" in found.err
    assert (folder / "result.json").read_text() == "{}"


@pytest.mark.mpi
def test_earlier_result_stays_where_a_picture_cannot_be_written(tmp_path):
    folder = MPI.COMM_WORLD.bcast(tmp_path)
    with pytest.raises(OutputError, match=r"'one\.png' is a folder there"):
        with filled_at_once(folder, "result.json", MPI.COMM_WORLD) as hidden:
            if MPI.COMM_WORLD.rank == 0:
                (folder / "result.json").write_text("before")
                (folder / "one.png").mkdir()
                (hidden / "result.json").write_text("after")
                (hidden / "one.png").write_text("a picture")
    MPI.COMM_WORLD.barrier()
    assert (folder / "result.json").read_text() == "before"
