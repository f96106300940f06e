"""Damaged scene and mesh files: every run must end in time, with an exit code and no traceback.

    python3 benchmarks/fuzz.py --minutes 20 --seed 0

Case number n is made from the seed n alone; `--only n` runs one again and keeps its files.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import gmsh

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fenics_contact.meshing import running_bond

#: Time that a run may take, s; the scenes take one or two.
TIME_LIMIT = 120.0
#: Exit codes of runs that ended as they should.
EXPECTED = (0, 2, 3, 4)
SCENE = b"""title = "Wall"
output = {paraview = true, pictures = false, capacity = 0}
mesh = {file = "wall.msh", degree = 1}
plane.state = "strain"
solve = {method = "auto", direction = "positive", tolerance = 1e-6, control = "work"}
[materials.default]
young = 1.0e9
poisson = 0.2
density = 2000.0
[joints.default]
friction = 0.65
[foundations.base]
friction = 0.65
[loads.dead]
body = [0.0, -9.81]
[loads.live]
body = [9.81, 0.0]
"""
NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
STRANGE = (b"0", b"-1", b"1", b"2", b"1e308", b"-1e308", b"1e-320", b"nan", b"inf", b"1e100", b"x",
           b"99999999999999999999", b"4294967296", b"-2147483649", b"0.5", b"")  # fmt: skip


def damaged(dice: random.Random, data: bytes) -> bytes:
    """A file with other bits, bytes, lines or numbers at a place or two."""
    kind = dice.choice(("flip", "cut", "copy", "end", "line", "swap", "number", "number", "number"))
    start, length = dice.randrange(len(data)), dice.choice((1, 4, 8, 50))
    before, piece, after = data[:start], data[start : start + length], data[start + length :]
    if kind == "flip":
        return before + bytes(byte ^ 1 << dice.randrange(8) for byte in piece) + after
    if kind in ("cut", "copy", "end"):
        return before + {"cut": after, "copy": 2 * piece + after, "end": b""}[kind]
    if kind == "line":
        lines = data.split(b"\n")
        one, two = dice.randrange(len(lines)), dice.randrange(len(lines))
        lines[one : one + dice.randrange(2)] = [lines[two]]
        return b"\n".join(lines)
    numbers = list(NUMBER.finditer(data))
    one, two = dice.choice(numbers), dice.choice(numbers)
    new = two.group() if kind == "swap" else dice.choice(STRANGE)
    return data[: one.start()] + new + data[one.end() :]


def sound_meshes() -> list[bytes]:
    """One wall as text and binary, in the formats that gmsh writes."""
    running_bond(2, 2)
    meshes = []
    with tempfile.TemporaryDirectory() as folder:
        for version, binary in ((4.1, 0), (4.1, 1), (2.2, 0), (2.2, 1)):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.write(f"{folder}/wall.msh")
            meshes.append(Path(folder, "wall.msh").read_bytes())
    return meshes


def run(seed: int, meshes: list[bytes], folder: Path) -> str:
    """What became of a case: its exit code, or what is wrong with how it ended."""
    dice = random.Random(seed)
    scene, mesh = SCENE, dice.choice(meshes)
    if dice.random() < 0.4:
        scene = damaged(dice, scene)
    else:
        mesh = damaged(dice, mesh)
    (folder / "scene.toml").write_bytes(scene)
    (folder / "wall.msh").write_bytes(mesh)
    command = [sys.executable, "-m", "fenics_contact", "solve", "scene.toml", "-o", "out"]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": sys.path[0]}
    try:
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, timeout=TIME_LIMIT
        )
    except subprocess.TimeoutExpired:
        return "hangs"
    if b"Traceback" in done.stdout + done.stderr:
        return "traceback"
    if done.returncode not in EXPECTED:
        return f"dead (exit code {done.returncode})"
    if done.returncode == 2 and (done.stderr.count(b"\n") != 1 or (folder / "out").exists()):
        return "more than one line"
    return f"exit code {done.returncode}"


def main() -> None:
    """Run cases until the time is over; exit with 1 if one failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0, help="of the first case")
    parser.add_argument("--only", type=int, help="the one case to run")
    options = parser.parse_args()
    meshes, counts, failed = sound_meshes(), Counter[str](), []
    if options.only is not None:
        folder = Path(tempfile.mkdtemp())
        print(folder, run(options.only, meshes, folder))
        return
    seed, end = options.seed, time.monotonic() + 60.0 * options.minutes
    while time.monotonic() < end:
        with tempfile.TemporaryDirectory() as name:
            found = run(seed, meshes, Path(name))
        counts[found] += 1
        if not found.startswith("exit code"):
            failed.append(seed)
            print(f"seed {seed}: {found}", flush=True)
        seed += 1
    print(f"{seed - options.seed} cases: " + ", ".join(f"{n} {k}" for k, n in counts.items()))
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
