"""Faults from outside: signals, lost ranks, closed outputs, folders that vanish."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from matplotlib import image

from fenics_contact.output.files import SKIPPED_FILES
from tests.quick import slow, slow_rows
from tests.system.program import (
    QUIET,
    Run,
    command,
    environment,
    files,
    result,
    run,
    write_scene,
)

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")

#: Time in which a run comes to a moment, and in which it ends, s.
PATIENCE = 180.0

STATE, PARENT, SESSION = 0, 1, 3  # columns of /proc/PID/stat behind the name


@dataclass(frozen=True)
class Started:
    """A run in a session of its own, which prints into files."""

    process: subprocess.Popen[bytes]
    folder: Path

    @property
    def out(self) -> str:
        return (self.folder / "stdout").read_text()

    @property
    def output(self) -> Path:
        return self.folder / "scene"

    def members(self) -> list[int]:
        """Processes of the session that have not ended."""
        found = {pid: row for pid, row in _processes() if row[SESSION] == str(self.process.pid)}
        return [pid for pid, row in found.items() if row[STATE] != "Z"]

    def ranks(self) -> list[int]:
        """Ranks in order, of a run by mpirun."""
        parent = str(self.process.pid)
        return sorted(pid for pid, row in _processes() if row[PARENT] == parent)

    def wait_for(self, moment: Callable[[Started], bool]) -> None:
        """Wait for a moment, or for the end."""
        end = time.monotonic() + PATIENCE
        while self.process.poll() is None and not moment(self):
            assert time.monotonic() < end, self.out
            time.sleep(0.002)

    def ended(self) -> Run:
        """What is left once all processes have ended."""
        code, end = self.process.wait(PATIENCE), time.monotonic() + PATIENCE
        while left := self.members():
            assert time.monotonic() < end, f"processes {left} go on"
            time.sleep(0.02)
        return Run(code, self.out, (self.folder / "stderr").read_text())


def _processes() -> Iterator[tuple[int, list[str]]]:
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                yield int(entry.name), (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue  # ended meanwhile


@contextmanager
def started(folder: Path, ranks: int = 1) -> Iterator[Started]:
    """Start `solve scene.toml`; whatever still runs at the end is killed."""
    with (
        (folder / "stdout").open("wb") as out,
        (folder / "stderr").open("wb") as err,
        subprocess.Popen(
            command(["solve", "scene.toml", "-v"], ranks),
            cwd=folder,
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            start_new_session=True,
        ) as process,
    ):
        run = Started(process, folder)
        try:
            yield run
        finally:
            for pid in run.members():
                os.kill(pid, signal.SIGKILL)


MOMENTS: dict[str, Callable[[Started], bool]] = {
    "reading": lambda run: "reading" in run.out,
    "solving": lambda run: " blocks" in run.out,
    "writing": lambda run: any(run.output.glob(".*")),
    "writing pictures": lambda run: any(run.output.rglob("joints.vtu")),
}

moments = pytest.mark.parametrize("moment", MOMENTS)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A folder with a wall that takes about a second to solve."""
    write_scene(tmp_path, {"joints.default.friction": 0.65}, "long wall")
    return tmp_path


def complete(folder: Path) -> set[str]:
    """Names of the files of a folder, all of which must be complete.

    Hidden ones are on their way: a run that is killed cannot take them away.
    """
    names = {name for name in files(folder) if not name.startswith(".")}
    readers: dict[str, Callable[[Path], Any]] = {
        ".json": lambda path: json.loads(path.read_text()),
        ".png": lambda path: image.imread(path),
        ".csv": lambda path: path.read_text().index("\n"),
    }
    for name in names:
        path = folder / name
        if path.suffix in (".pvd", ".pvtu", ".vtu", *readers):
            readers.get(path.suffix, ElementTree.parse)(path)
    if "result.json" in names:
        said = set(result(folder)["files"])
        assert said == {name for name in names - {"result.json"} if "/" not in name}
        record = result(folder)
        if SKIPPED_FILES not in record["skipped"] and record["load_factor"] is not None:
            assert {"blocks.pvd", "joints.vtu", "collapse.png"} <= names
    return names


def known(program: Started, name: str) -> None:
    """See that what was known when a run was stopped has been written."""
    names, record = complete(program.output), result(program.output)
    assert "result.json" in names
    if not record["stopped"]:  # all was found, and some files were on their way
        assert record["status"] == "limit"
        return
    assert SKIPPED_FILES in record["skipped"]
    assert record["stopped"] == f"stopped by {name}" and record["files"] == []
    if record["status"] == "limit":
        assert record["hinges"]["points"]["load_factor"] is None
        return
    assert record["status"] == "not_converged" and record["reason"].startswith("stopped by")
    assert record["bounds"]["lower"] == 0.0 or record["load_factor"] is None
    path = record["directions"]["positive"]["path"]
    reached = path[-1]["load_factor"] if path else None
    upper = record["bounds"]["upper"]
    if reached is not None and upper is not None and reached > upper:
        reached = None  # the last point of a path may be beyond what can be carried
    assert record["load_factor"] == reached


@pytest.mark.slow
@moments
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGUSR1])
def test_signals(number, moment, scene):
    """While it reads, nothing is known yet; later, what is known is written."""
    with started(scene) as program:
        program.wait_for(MOMENTS[moment])
        os.killpg(program.process.pid, number)
        found = program.ended()
    assert found.err == ""
    if "result.json" not in complete(program.output):
        assert moment == "reading" and found.code in (-number, 128 + number)
        return
    assert found.code == 128 + number
    known(program, signal.Signals(number).name)


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("seconds", [0.0, 2.0, 4.0])
def test_ctrl_c_in_the_face_engine(tmp_path, seconds, ranks):
    """The best certified state is written, once there is one; none has the gap asked for."""
    options = {"solve.engine": "faces", "solve.gap": 1e-14, "solve.fast": True}
    write_scene(tmp_path, {"joints.default.friction": 0.65, **options}, "long wall")
    with started(tmp_path, ranks) as program:
        program.wait_for(MOMENTS["solving"])
        time.sleep(seconds)
        program.process.send_signal(signal.SIGINT)
        found = program.ended()
    assert "Traceback" not in found.err
    if "result.json" not in complete(program.output):
        assert ranks > 1  # mpirun kills its ranks after a second
        return
    record = result(program.output)
    if record["stopped"]:
        assert record["stopped"].startswith("stopped by SIG")  # mpirun hands on its own
        assert record["status"] in ("limit", "not_converged")
    if record["status"] == "limit":
        upper = record["bounds"]["upper"] or 0.65  # the friction, where it is not known yet
        assert 0.0 < record["load_factor"] <= upper * (1.0 + 1e-6)
        assert record["gap"] <= 1e-2


@pytest.mark.slow
@moments
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_to_mpirun(number, moment, scene):
    """Open MPI gives its own exit code, 1, and kills its ranks after a second."""
    with started(scene, 2) as program:
        program.wait_for(MOMENTS[moment])
        program.process.send_signal(number)
        found = program.ended()
    assert found.code in (0, 1, 128 + signal.SIGINT, 128 + signal.SIGTERM)
    assert "Traceback" not in found.err and "PETSC" not in found.err
    complete(program.output)


@pytest.mark.slow
def test_time_is_over(scene):
    write_scene(scene, {"joints.default.friction": 0.65, "solve.time": 0.01}, "long wall")
    found = run(["solve", "scene.toml"], scene)
    record = result(scene / "scene")
    assert (found.code, found.err) == (4, "")
    assert record["reason"].startswith("stopped after 0.01 s (solve.time)")
    assert found.out.startswith("stopped after 0.01 s (solve.time)")
    assert "no collapse was found to the right" in found.out
    complete(scene / "scene")


@pytest.mark.slow
@moments
def test_killed(moment, scene):
    with started(scene) as program:
        program.wait_for(MOMENTS[moment])
        program.process.send_signal(signal.SIGKILL)
        found = program.ended()
    assert (found.code, found.err) == (-signal.SIGKILL, "")
    assert "result.json" not in complete(program.output)
    again = run(["solve", "scene.toml"], scene)
    assert (again.code, again.err) == (0, "")
    complete(program.output)
    assert result(program.output)["status"] == "limit"


@pytest.mark.slow
@moments
@pytest.mark.parametrize("lost", [0, 1])
def test_a_lost_rank_ends_the_others(lost, moment, scene):
    with started(scene, 2) as program:
        program.wait_for(MOMENTS[moment])
        os.kill(program.ranks()[lost], signal.SIGKILL)
        found = program.ended()
    assert found.code == 128 + signal.SIGKILL
    assert "Traceback" not in found.err and "PETSC" not in found.err
    complete(program.output)


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("moment", ["solving", "writing", "writing pictures"])
def test_folder_removed(moment, ranks, scene):
    (scene / "scene").mkdir()
    (scene / "scene" / "old").touch()
    with started(scene, ranks) as program:
        program.wait_for(MOMENTS[moment])
        shutil.rmtree(program.output, ignore_errors=True)
        found = program.ended()
    assert "Traceback" not in found.err and "PETSC" not in found.err
    if moment == "solving":
        assert (found.code, found.err) == (0, "")
        assert result(program.output)["status"] == "limit"
    elif found.code:
        assert found.err.startswith("fenics-contact: ")


@pytest.mark.parametrize(("lines", "ranks"), [(0, 1), *slow_rows((1, 2))])
def test_output_that_nobody_reads(lines, ranks, tmp_path):
    """As `fenics-contact solve scene.toml | head -1`."""
    write_scene(tmp_path, QUIET)
    read, write = os.pipe()
    with (
        os.fdopen(read) as printed,
        subprocess.Popen(
            command(["solve", "scene.toml", "-v"], ranks),
            cwd=tmp_path,
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=write,
            stderr=subprocess.PIPE,
            text=True,
        ) as process,
    ):
        os.close(write)
        assert [printed.readline() for _ in range(lines)] == ["reading scene.toml\n"] * lines
        printed.close()
        _, err = process.communicate(timeout=PATIENCE)
    assert (process.returncode, err) == (0, "")
    assert result(tmp_path / "scene")["status"] == "limit"


@pytest.mark.parametrize("arguments", [["check", "scene.toml"], *slow(["solve", "--help"])])
def test_answers_that_nobody_reads(arguments, tmp_path):
    write_scene(tmp_path)
    line = " ".join(command(arguments)) + " | true; exit ${PIPESTATUS[0]}"
    done = subprocess.run(
        ["bash", "-c", line], cwd=tmp_path, env=environment(), capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_output_to_a_full_disk(tmp_path):
    write_scene(tmp_path, QUIET)
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            command(["solve", "scene.toml"]),
            cwd=tmp_path,
            env=environment(),
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 0
    assert done.stderr == "fenics-contact: cannot print: No space left on device\n"
    assert result(tmp_path / "scene")["status"] == "limit"


DOWN, STEEP = {"loads.live.body": [0.0, -9.81]}, {"joints": {}}
