"""Scenes of the benchmarks, made of the recipes of the tests' bank."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import numpy.typing as npt

from benchmarks.peers.blocks import Blocks
from fenics_contact import JointLaw
from fenics_contact.meshing import wall
from tests import bank
from tests.bank import WALLS, Recipe, coulomb, rectangle, wall_recipe
from tests.system.program import toml

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """A scene, and its blocks for programs that do not read recipes.

    Attributes:
        recipe: How it is made.
        blocks: Outlines, friction, unit of length.
        best: Best load factor known; nan if none is.
        source: Where that comes from.
    """

    recipe: Recipe
    blocks: Callable[[], Blocks]
    best: float = float("nan")
    source: str = ""


def outlines(courses: Sequence[Sequence[float]], block: tuple[float, float]) -> list[Array]:
    """Corners of blocks laid in courses, as `fenics_contact.meshing.wall` lays them."""
    length, height = block
    found = []
    for level, row in enumerate(courses):
        ends = np.concatenate([[0.0], np.cumsum(np.abs(row))]) * length
        y = level * height
        laid = zip(row, ends[:-1], ends[1:], strict=True)
        found += [np.array(rectangle(x, y, z, y + height)) for size, x, z in laid if size > 0.0]
    return found


def wall_blocks(name: str, friction: float) -> Blocks:
    """Blocks of a wall "W1" ... "W4" or of a running bond "10x10"."""
    if name in WALLS:
        return Blocks(outlines(WALLS[name], (0.4, 0.175)), friction, 0.2)
    bricks, courses = map(int, name.split("x"))
    rows = ([1.0] * bricks, [0.5] + [1.0] * (bricks - 1) + [0.5])
    laid = [rows[level % 2] for level in range(courses)]
    return Blocks(outlines(laid, (0.4, 0.2)), friction, 0.2)


def arch_blocks(voussoirs: int, thickness: float, friction: float) -> Blocks:
    """Blocks of a semicircle of radius 1, as `fenics_contact.meshing.arch` cuts them."""
    angles = np.linspace(np.pi, 0.0, voussoirs + 1)
    ray = np.column_stack([np.cos(angles), np.sin(angles)])
    inner, outer = (1.0 - 0.5 * thickness) * ray, (1.0 + 0.5 * thickness) * ray
    corners = [[inner[k + 1], outer[k + 1], outer[k], inner[k]] for k in range(voussoirs)]
    return Blocks([np.array(outline) for outline in corners], friction, thickness)


def wall_scene(name: str, friction: float, best: float = float("nan"), source: str = "") -> Scene:
    """A wall with Coulomb friction."""
    recipe = wall_recipe(name, coulomb(friction))
    return Scene(recipe, partial(wall_blocks, name, friction), best, source)


ARCH = (15, 0.15, 1.0)  # voussoirs, thickness over radius, friction

#: Load factors on axes of errors: the best that is known, not that of the same mesh.
TIME_ERROR = {
    "W4 friction 0.65": wall_scene("W4", 0.65, 0.27952, "limit for point hinges"),
    "W1 friction 0.65": wall_scene("W1", 0.65, 0.639968555, "elastic blocks, all meshes"),
    "10 x 10 friction 0.75": wall_scene("10x10", 0.75, 0.523331, "degree 2, 16 elements"),
    "arch of 15 friction 1": Scene(
        *(bank.arch_recipe(*ARCH), partial(arch_blocks, *ARCH), 0.150465309, "rigid-block program")
    ),
}

#: Running bonds that grow.
COST_SIZE = {
    f"{n} x {n} friction {friction:g}": wall_scene(f"{n}x{n}", friction)
    for friction in (0.4, 0.75)
    for n in (10, 14, 20, 28, 40)
}

#: Scenes of files, with their elements along half a block, for the command line.
FILES = {
    **{
        f"{name} {friction:g}": (wall_recipe(name, coulomb(friction)), 4)
        for name, friction in (
            *(("2x2", 0.4), ("W3", 0.65), ("W4", 0.65), ("10x10", 0.4), ("10x10", 0.75)),
            *(("20x20", 0.75), ("40x40", 0.4)),
        )
    },
    "facade 0.4, both directions": (bank.real_recipes(0.4)["facade"], 2),
}

#: Running bonds whose states depend on the tolerance, with two elements along half a brick.
TOLERANCE = {
    f"{n} x {n} friction {friction:g}": wall_scene(f"{n}x{n}", friction)
    for n, friction in ((20, 0.4), (20, 0.9), (28, 0.78))
}

#: Structures as people draw them, pushed to the right and to the left.
REAL = {
    f"{name} {friction:g} {way}": recipe
    for friction in (0.4, 0.5, 0.6, 0.7, 0.8)
    for way, live in (("right", bank.PUSH), ("left", bank.LEFTWARDS))
    for name, recipe in bank.real_recipes(friction, live).items()
}


def opening_courses(seed: int) -> list[list[float]]:
    """Courses of a wall of random size with one or two openings at random places."""
    random = np.random.default_rng(seed)
    width, count = int(random.integers(4, 8)), int(random.integers(7, 14))
    openings: list[tuple[float, float, int, int]] = []
    for _ in range(int(random.integers(1, 3))):
        left = 0.5 * int(random.integers(2, 2 * width - 3))
        low = int(random.integers(1, count - 3))
        high = min(count - 2, low + int(random.integers(1, 5)))
        clear = (
            left >= end + 1 or left + 1 <= start - 1 or low > top + 1 or high < bottom - 1
            for start, end, bottom, top in openings
        )
        if all(clear):
            openings.append((left, left + 1.0, low, high))
    courses = []
    for level in range(count):
        voids = {(a, b) for a, b, low, high in openings if low <= level <= high}
        cuts = {0.0, float(width)} | {k + 0.5 * (level % 2) for k in range(width)}
        for a, b in voids:
            cuts = {cut for cut in cuts if not a < cut < b} | {a, b}
        ends = sorted(cuts)
        courses.append([a - b if (a, b) in voids else b - a for a, b in pairwise(ends)])
    return courses


def comparison() -> dict[str, tuple[Recipe, int]]:
    """Scenes on which two versions are compared, with their elements along half a block."""
    found: dict[str, tuple[Recipe, int]] = {}
    bonds = "4x5 5x16 6x8 10x10 12x12 14x14 20x20 24x24 30x8".split()
    for names, frictions, meshes in (
        (list(WALLS), (0.4, 0.65, 0.75, 1.0), (1, 2, 4, 8)),
        (bonds, (0.4, 0.6, 0.75, 1.0), (2,)),
        ([f"{n}x{n}" for n in (10, 20, 30, 40, 60, 80)], (0.4, 0.6, 0.75), (4,)),
    ):
        for name, friction, n in product(names, frictions, meshes):
            found[f"{name} {friction:g} {n}"] = wall_recipe(name, coulomb(friction)), n
    for count in (9, 15, 27, 51, 101):
        for thickness, friction in ((0.15, 1.0), (0.2, 1.0), (0.12, 0.6)):
            name = f"arch {count} {thickness:g} {friction:g}"
            found[name] = bank.arch_recipe(count, thickness, friction), 2
    for friction in (0.3, 0.55, 0.57):
        found[f"wedge {friction:g}"] = bank.wedge_recipe(friction), 2
    for seed in range(40):
        friction, n = (0.5, 0.65, 0.8)[seed % 3], (2, 4)[seed % 2]
        draw = partial(wall, opening_courses(seed), (0.4, 0.175))
        found[f"openings {seed} {friction:g} {n}"] = Recipe(draw, coulomb(friction)), n
    for name in WALLS:
        found[f"{name} tresca"] = wall_recipe(name, bank.tresca(2e3)), 2
        found[f"{name} frictionless"] = wall_recipe(name, JointLaw("frictionless")), 2
    return found | {name: (recipe, 2) for name, recipe in REAL.items()}


#: Forty scenes of `comparison` on which versions, and what is switched off, are compared.
MIXED = (
    "W? 0.65 4, W? 1 4, 10x10 0.4 4, 10x10 0.75 4, 5x16 0.6 2, 12x12 0.6 2, 14x14 0.75 2,"
    " 20x20 0.4 2, 20x20 0.75 4, 30x8 0.6 2, 6x8 1 2, arch 15 0.15 1, arch 27 0.2 1,"
    " arch 51 0.12 0.6, facade 0.5 left, gable 0.6 *, arch wall 0.5 right, openings ? *,"
    " openings 1[0-5] *"
)

#: Some of them that take seconds.
FEW = (
    "W? 0.65 4, W3 1 4, 10x10 0.4 4, 10x10 0.75 4, 14x14 0.75 2, arch 27 0.12 0.6, gable 0.6 left,"
    " openings 4 *"
)

#: Scenes of `comparison` that take up to minutes, left out unless a pattern names them.
LARGE = "?0x?0 * 4, facade*, rubble*"


def matching(names: Iterable[str], pattern: str) -> list[str]:
    """Names that match one of several patterns of the shell, separated by commas."""
    return [n for n in names if any(fnmatch.fnmatch(n, p.strip()) for p in pattern.split(","))]


def write_scene(recipe: Recipe, elements: int, path: Path) -> Path:
    """Write a scene and its mesh as files, in keys that all versions know."""
    scene = recipe.scene(elements)
    gmsh.write(str(path.with_suffix(".msh")))
    tables = {**scene.tables(), "mesh": {"file": path.with_suffix(".msh").name}}
    path.write_text(toml(_said({**tables, "solve": {}, "output": {}})))
    return path


def _said(table: Mapping[str, Any]) -> dict[str, Any]:
    """Tables without what is nothing, or as usual."""
    found = {n: _said(v) if isinstance(v, Mapping) else v for n, v in table.items()}
    return {n: v for n, v in found.items() if v and v not in ("uniform", "kept")}
