"""Speed of joints whose nodes do not match, against matching ones with as many joint points.

    python3 benchmarks/nonmatching.py [--repeat 3]

Blocks are drawn by their corners and meshed by gmsh: one by one, with sizes drawn at random, and
all with one size, for which the number of joint points is the nearest. Prints a table in Markdown.
"""

from __future__ import annotations

import argparse
import gc
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fenics_contact import Scene, limit_load
from fenics_contact.discretization.discretization import Discretization
from tests.bank import Recipe, arch_recipe, coulomb, wall_recipe

#: Scenes, with 4 elements along half a block or through the arch.
RECIPES = {
    "W3": wall_recipe("W3", coulomb(0.65)),
    "W4": wall_recipe("W4", coulomb(0.65)),
    "10 x 10": wall_recipe("10x10", coulomb(0.75)),
    "arch of 27": arch_recipe(27, 0.2),
}
ELEMENTS = 4
SEEDS = (1, 2, 3)
#: Sizes of matching meshes to choose from, in mean lengths of facets.
SIZES = np.linspace(0.7, 1.1, 9)

HEAD = (
    "| scene | joint points, match / do not | factorisations | CPU time, s | ratio |"
    "\n|---|---|---|---|---|"
)


def matching(recipe: Recipe, size: float) -> Scene:
    """A scene meshed with one size."""
    drawn = replace(recipe, change=lambda old: old.meshed_again(lambda h: size * h.mean()))
    return drawn.scene(ELEMENTS, error=False)


def one_by_one(recipe: Recipe, seed: int) -> Scene:
    """A scene whose blocks are meshed one by one."""
    return replace(recipe, change=lambda old: old.one_by_one(seed)).scene(ELEMENTS, error=False)


def joint_points(scene: Scene) -> int:
    """Number of joint points."""
    with Discretization(scene) as made:
        return len(made.joints.length)


def measured(scene: Scene, repeat: int) -> tuple[float, float]:
    """Factorisations, of block modes too, and the shortest CPU time of several runs, s."""
    seconds = []
    for _ in range(repeat):
        gc.collect()
        start = time.process_time()
        result = limit_load(scene)
        seconds.append(time.process_time() - start)
        if result.status != "limit":
            raise RuntimeError(f"{result.status}: {result.reason}")
    return result.factorizations, min(seconds)


def row(name: str, recipe: Recipe, repeat: int) -> str:
    """A row of the table: means over meshes with unlike sizes."""
    unlike = [one_by_one(recipe, seed) for seed in SEEDS]
    points = np.mean([joint_points(scene) for scene in unlike])
    alike = [matching(recipe, size) for size in SIZES]
    counts = np.array([joint_points(scene) for scene in alike])
    nearest = int(np.argmin(np.abs(counts - points)))
    count, seconds = measured(alike[nearest], repeat)
    other_count, other = np.mean([measured(scene, repeat) for scene in unlike], axis=0)
    ratio = other / seconds
    return (
        f"| {name} | {counts[nearest]} / {points:.0f} | {count} / {other_count:.0f}"
        f" | {seconds:.2f} / {other:.2f} | {ratio:.2f} |"
    )


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="runs of a mesh")
    repeat = parser.parse_args().repeat
    limit_load(wall_recipe("2x2", coulomb(0.5)).scene(1))  # compiles the forms
    print(HEAD)
    for name, recipe in RECIPES.items():
        print(row(name, recipe, repeat), flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
