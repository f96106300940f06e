"""Damaged scenes, meshes and drawings: every run must end in time, with an exit code, no traceback.

    python3 benchmarks/fuzz.py --minutes 20 --seed 0
    python3 benchmarks/fuzz.py drawings --cases 200

Case number n is made from the seed n alone; `--only n` runs one again and keeps its files. A
drawing is meshed with a picture, and what was made of it is checked as a scene. A DXF file is a
list of tags, each a group code and a value on two lines; an entity begins with the code 0.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from itertools import count, product
from pathlib import Path
from typing import Any

import ezdxf
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


# ---- drawings

Tag = tuple[bytes, bytes]


def sound_drawings() -> list[bytes]:
    """Blocks as closed polylines with arcs and inserts, and as faces between lines and curves."""
    makers = (closed_polylines, lines_and_curves)
    drawings = []
    with tempfile.TemporaryDirectory() as folder:
        for version, maker in product(("R12", "R2010"), makers):
            document = ezdxf.new(version, units=4)
            maker(document)
            document.saveas(f"{folder}/wall.dxf")
            drawings.append(Path(folder, "wall.dxf").read_bytes())
    return drawings


def closed_polylines(document: Any) -> None:
    """Two courses of stones, an arch of two quarters, an insert in another and an array."""
    space = document.modelspace()
    for x, y in ((0, 0), (500, 0), (-250, 250), (250, 250), (750, 250)):
        corners = [(x, y), (x + 500, y), (x + 500, y + 250), (x, y + 250)]
        space.add_polyline2d(corners, close=True, dxfattribs={"layer": "STONE"})
    bulge = math.tan(math.pi / 8.0)
    for turn in (1.0, -1.0):
        rows = [(turn * 400, 500, turn * bulge), (0, 900, 0), (0, 800, -turn * bulge)]
        rows = [*rows, (turn * 300, 500, 0)]
        space.add_polyline2d(rows, format="xyb", close=True, dxfattribs={"layer": "VOUSSOIR"})
    brick = document.blocks.new("BRICK")
    brick.add_polyline2d([(0, 0), (100, 0), (100, 50), (0, 50)], close=True)
    pair = document.blocks.new("PAIR")
    pair.add_blockref("BRICK", (0, 0))
    pair.add_blockref("BRICK", (100, 0))
    array = {"layer": "BRICKS", "column_count": 2, "column_spacing": 200, "row_count": 2}
    space.add_blockref("PAIR", (450, 500), dxfattribs=array | {"row_spacing": 50})
    space.add_line((0, 0), (1000, 0), dxfattribs={"layer": "base"})
    space.add_text("wall", dxfattribs={"layer": "TEXT", "height": 100})


def lines_and_curves(document: Any) -> None:
    """A wall between lines with a window, below an arc, an ellipse and a spline."""
    space = document.modelspace()
    rows = [((0, y), (1200, y)) for y in (0, 300, 600)]
    rows += [((x, 0), (x, 300)) for x in (0, 400, 800, 1200)]
    rows += [((x, 300), (x, 600)) for x in (0, 200, 600, 1000, 1200)]
    rows += [((200, 450), (600, 450))]
    for start, end in rows:
        space.add_line(start, end, dxfattribs={"layer": "JOINTS"})
    space.add_arc((300, 600), 300, 0, 180, dxfattribs={"layer": "JOINTS"})
    if document.dxfversion > "AC1009":
        half = {"start_param": 0.0, "end_param": math.pi, "dxfattribs": {"layer": "JOINTS"}}
        space.add_ellipse((900, 600), (300, 0), 0.5, **half)
        points = [(0, 600), (-100, 400), (-50, 200), (0, 0)]
        space.add_spline(points, dxfattribs={"layer": "JOINTS"})
    window = [(250, 350), (350, 350), (350, 550), (250, 550)]
    space.add_polyline2d(window, close=True, dxfattribs={"layer": "WINDOW"})
    space.add_line((-500, 0), (1700, 0), dxfattribs={"layer": "GROUND"})


def damaged_drawing(dice: random.Random, data: bytes) -> bytes:
    """A DXF file with entities, coordinates, layers, group codes or bytes changed."""
    kind = dice.choice((None, drop, double, stretch, put, rename, recode))
    if kind is None:
        return damaged(dice, data)
    lines = data.replace(b"\r", b"").split(b"\n")
    tags = list(zip(lines[::2], lines[1::2], strict=False))
    for _ in range(dice.choice((1, 1, 3, 20))):
        kind(dice, tags)
    return b"\n".join(line for tag in tags for line in tag) + b"\n"


def entity(dice: random.Random, tags: list[Tag]) -> slice:
    """Tags of an entity; nine times of ten one of the entities and blocks."""
    starts = [k for k, (code, _) in enumerate(tags) if code.strip() == b"0"]
    heads = [k for k, tag in enumerate(tags) if tag[1] == b"BLOCKS"]
    late = [k for k in starts if heads and k > heads[0]] if dice.random() < 0.9 else starts
    start = dice.choice(late or starts or [0])
    return slice(start, next((k for k in starts if k > start), len(tags)))


def drop(dice: random.Random, tags: list[Tag]) -> None:
    """Leave an entity out."""
    del tags[entity(dice, tags)]


def double(dice: random.Random, tags: list[Tag]) -> None:
    """Write an entity twice."""
    some = entity(dice, tags)
    tags[some] = 2 * tags[some]


def changed(
    dice: random.Random, tags: list[Tag], codes: range, value: Callable[[bytes], bytes]
) -> None:
    """Change the values of some group codes, at one place of an entity or at all."""
    some = entity(dice, tags)
    places = [k for k in range(*some.indices(len(tags))) if number_of(tags[k][0]) in codes]
    places = dice.sample(places, min(len(places), dice.choice((1, 100))))
    for k in places:
        tags[k] = tags[k][0], value(tags[k][1])


def number_of(code: bytes) -> int:
    """Group code of a tag, -1 if it is none."""
    return int(code) if code.strip().isdigit() else -1


def stretch(dice: random.Random, tags: list[Tag]) -> None:
    """Multiply coordinates, radii and angles."""
    factor = dice.choice((-1.0, 0.0, 1e-9, 1.0 + 1e-7, 1.001, 1.5, 1e3, 1e9, 1e150))

    def multiplied(value: bytes) -> bytes:
        try:
            return repr(float(value) * factor).encode()
        except ValueError:
            return value

    changed(dice, tags, range(10, 60), multiplied)


def put(dice: random.Random, tags: list[Tag]) -> None:
    """Strange numbers as coordinates, counts or flags."""
    changed(dice, tags, range(10, 80), lambda _: dice.choice(STRANGE))


def rename(dice: random.Random, tags: list[Tag]) -> None:
    """Other names of layers, blocks and kinds of entities."""
    names = [value for code, value in tags if number_of(code) in (0, 2, 8)]
    strange = (b"", b"0", b"FRAME", b"WINDOW", b"\xff\xfe", b"*", "\u00f6".encode(), 300 * b"x")
    name = dice.choice((*strange, dice.choice(names)))
    changed(dice, tags, dice.choice((range(9), range(2, 3), range(8, 9))), lambda _: name)


def recode(dice: random.Random, tags: list[Tag]) -> None:
    """Another group code of a tag."""
    k = dice.randrange(*entity(dice, tags).indices(len(tags))[:2])
    code = dice.choice((b"0", b"2", b"8", b"10", b"41", b"66", b"70", b"90", b"1001", b"-5", b"x"))
    tags[k] = code, tags[k][1]


# ---- runs


def run_scene(seed: int, meshes: list[bytes], folder: Path) -> str:
    """What became of a scene with its mesh: its exit code, or what is wrong with its end."""
    dice = random.Random(seed)
    scene = SCENE
    mesh = dice.choice(meshes)
    if dice.random() < 0.4:
        scene = damaged(dice, scene)
    else:
        mesh = damaged(dice, mesh)
    (folder / "scene.toml").write_bytes(scene)
    (folder / "wall.msh").write_bytes(mesh)
    return outcome(["solve", "scene.toml", "-o", "out"], folder, {"out"})


def run_drawing(seed: int, drawings: list[bytes], folder: Path) -> str:
    """What became of a drawing, likewise; a mesh that was made of it is checked."""
    dice = random.Random(seed)
    (folder / "wall.dxf").write_bytes(damaged_drawing(dice, dice.choice(drawings)))
    found = outcome(
        ["mesh", "wall.dxf", "--unit", "mm", "--picture", "wall.png"], folder, {"wall.msh"}
    )
    if found != "exit code 0":
        return found
    (folder / "scene.toml").write_bytes(SCENE)
    checked = outcome(["check", "scene.toml"], folder, set())
    return f"{found}, check: {checked}" if checked.startswith("exit code") else checked


def outcome(arguments: list[str], folder: Path, written: set[str]) -> str:
    """Exit code of a run, or what is wrong; `written` must not be there after exit code 2."""
    command = [sys.executable, "-m", "fenics_contact", *arguments]
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
    if done.returncode == 2 and (
        done.stderr.count(b"\n") != 1 or any((folder / name).exists() for name in written)
    ):
        return "more than one line"
    return f"exit code {done.returncode}"


def main() -> None:
    """Run cases until the time or their number is over; exit with 1 if one failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="?", choices=("scenes", "drawings"), default="scenes")
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--cases", type=int, help="most cases")
    parser.add_argument("--seed", type=int, default=0, help="of the first case")
    parser.add_argument("--only", type=int, help="the one case to run")
    options = parser.parse_args()
    run, sound = {
        "scenes": (run_scene, sound_meshes),
        "drawings": (run_drawing, sound_drawings),
    }[options.what]
    files = sound()
    if options.only is not None:
        kept = Path(tempfile.mkdtemp())
        print(kept, run(options.only, files, kept))
        return
    counts = Counter[str]()
    end = time.monotonic() + 60.0 * options.minutes
    for seed in count(options.seed):
        if time.monotonic() > end or seed - options.seed == options.cases:
            break
        with tempfile.TemporaryDirectory() as name:
            found = run(seed, files, Path(name))
        counts[found] += 1
        if not found.startswith("exit code"):
            print(f"seed {seed}: {found}", flush=True)
    print(f"{counts.total()} cases: " + ", ".join(f"{n} {k}" for k, n in counts.items()))
    sys.exit(any(not found.startswith("exit code") for found in counts))


if __name__ == "__main__":
    main()
