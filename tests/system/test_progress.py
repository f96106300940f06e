"""Progress: lines with -v, one line written over itself on a terminal, and none elsewhere."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import termios
import time
from pathlib import Path

import pytest

from tests.quick import slow
from tests.system.program import QUIET, TIMEOUT, command, environment, run, stop, write_scene

ITERATION = re.compile(
    r"^(positive|negative): pass +(\d+)  load factor (\S+)  change of the bound", re.M
)
PERCENTAGE = re.compile(r"\r\x1b\[K *(\d+)%  load factor ")


def run_on_terminal(arguments: list[str], folder: Path, ranks: int = 1) -> tuple[int, str]:
    """Run the program on a pseudo-terminal; returns exit code and everything printed."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 160, 0, 0))
    with subprocess.Popen(
        command(arguments, ranks),
        cwd=folder,
        env=environment() | {"TERM": "xterm"},
        stdin=subprocess.DEVNULL,
        stdout=theirs,
        stderr=theirs,
    ) as process:
        os.close(theirs)
        try:
            printed = _read_all(ours)
            code = process.wait(TIMEOUT)
        except BaseException:
            stop(process)
            raise
        finally:
            os.close(ours)
    return code, printed


def _read_all(terminal: int) -> str:
    """What is printed until the last program on the terminal ends."""
    end, printed = time.monotonic() + TIMEOUT, b""
    while select.select([terminal], [], [], max(0.0, end - time.monotonic()))[0]:
        try:
            part = os.read(terminal, 65536)
        except OSError:  # Linux's way to say that nobody holds the other end any more
            part = b""
        if not part:
            return printed.decode()
        printed += part
    raise TimeoutError(printed.decode())


@pytest.mark.parametrize("ranks", [1, *slow(2)])
def test_piped_output_is_lines_printed_once(ranks, tmp_path):
    write_scene(tmp_path, QUIET | {"solve.direction": "both", "solve.method": "fixed-point"})
    found = run(["solve", "scene.toml", "-v"], tmp_path, ranks)
    assert found.code == 0
    assert not re.search(r"\r|%", found.out + found.err)
    found_steps = ITERATION.findall(found.out)
    steps = [(name, int(number)) for name, number, _ in found_steps]
    signs = {(name, float(factor) < 0.0) for name, _, factor in found_steps}
    assert signs == {("positive", False), ("negative", True)}
    for direction in ("positive", "negative"):
        numbers = [number for name, number in steps if name == direction]
        assert numbers == list(range(1, len(numbers) + 1))
        assert len(numbers) >= 2
    blocks = "1 block on 2 ranks" if ranks > 1 else "1 block"
    for once in ("reading scene.toml", blocks, "verified", "written to", "next: "):
        lines = [line for line in found.out.splitlines() if line.startswith(once)]
        assert len(lines) == (2 if once == "verified" else 1)  # a verdict for each direction


@pytest.mark.parametrize("ranks", [1, *slow(2)])
def test_piped_capacity_curve_is_a_line_per_point(ranks, tmp_path):
    write_scene(tmp_path, QUIET | {"output.capacity": 3})
    found = run(["solve", "scene.toml", "-v"], tmp_path, ranks)
    points = re.findall(r"^capacity: (\d) of 3  ", found.out, re.M)
    assert points == ["1", "2", "3"]


@pytest.mark.parametrize("ranks", [1, *slow(2)])
def test_piped_output_is_the_answer_alone(ranks, tmp_path):
    write_scene(tmp_path, QUIET | {"solve.direction": "both", "output.capacity": 3})
    found = run(["solve", "scene.toml"], tmp_path, ranks)
    assert found.out == (
        "it collapses at 0.3000 g to the right, 0.3000 g to the left (verified)\n"
        "no other collapse state exists\n"
        "next: fenics-contact report scene\n"
    )


def test_one_line_on_a_terminal(tmp_path):
    write_scene(tmp_path, QUIET, "wall")
    code, printed = run_on_terminal(["solve", "scene.toml"], tmp_path)
    percentages = [int(number) for number in PERCENTAGE.findall(printed)]
    assert code == 0 and percentages[-1] == 100
    assert printed.count("\r\x1b[K") >= 3
    # The line is written over itself and gone at the end; the answer starts where it was.
    first, _, rest = printed.partition("it collapses at ")
    assert "\n" not in first and first.endswith("\r\x1b[K") and "\r\x1b" not in rest


def test_no_line_where_mpirun_gathers_the_output(tmp_path):
    write_scene(tmp_path, QUIET)
    code, printed = run_on_terminal(["solve", "scene.toml"], tmp_path, ranks=2)
    assert code == 0 and "%" not in printed and "\x1b" not in printed
    assert printed.startswith("it collapses at 0.3000 g")


def test_quiet_on_a_terminal(tmp_path):
    write_scene(tmp_path, QUIET)
    assert run_on_terminal(["solve", "scene.toml", "-q"], tmp_path) == (0, "")
