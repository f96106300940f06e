"""Eight structures as people ask about them, whose answers tests hold word for word."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.masonry import Ashlar, Opening
from fenics_contact import (
    BlockMesh,
    EarthPressure,
    EdgeForce,
    Floor,
    JointLaw,
    LimitLoad,
    Load,
    Material,
    OutputOptions,
    Scene,
    Seismic,
    SolveOptions,
    Tie,
    limit_load,
)
from fenics_contact.builders import bridge, facade, retaining_wall
from fenics_contact.meshing import arch, polygons
from tests.drawing import rectangle

STONE = Material(young=5e9, poisson=0.2, density=2000.0)
DOWN = Load(body=(0.0, -9.81))
ASIDE = Load(body=(9.81, 0.0))
MESHES = Path(__file__).resolve().parents[1] / "meshes"


def scene(mesh: Any, friction: float, ground: str = "base", **more: Any) -> Scene:
    """A scene of stone, with weight that acts sideways unless another load is given."""
    law = JointLaw("coulomb", friction)
    found = mesh if isinstance(mesh, BlockMesh) else BlockMesh.from_model(mesh)
    given = {
        "materials": {"default": STONE},
        "dead": DOWN,
        "live": ASIDE,
        "joints": {"default": law},
        "foundations": {ground: law},
        "output": OutputOptions(units="m"),
    }
    return Scene(mesh=found, **{**given, **more})


def small_facade() -> Scene:
    """Two storeys of two windows with a tie at the eaves, a floor, and the seismic check."""
    drawing = facade(2, 2, (1.0, 1.25), 1.0, (1.0, 0.5))
    height = max(float(block[:, 1].max()) for block in drawing.blocks)
    width = max(float(block[:, 0].max()) for block in drawing.blocks)
    eaves = Tie((0.2, height - 0.1), 2e3, (width - 0.2, height - 0.1))
    return scene(
        drawing.mesh(size=0.25),
        0.7,
        title="Facade",
        ties={"eaves": eaves},
        floors={"roof": Floor(5e3, at="top", mass=True)},
        seismic=Seismic(1.35),
        solve=SolveOptions(direction="both"),
    )


def gate() -> Scene:
    """The gate of the tutorial."""
    boxes = [(x, 0.6 * k, 0.6, 0.6) for x in (0.0, 2.4) for k in range(4)]
    boxes.append((0.0, 2.4, 3.0, 0.5))
    outlines = [rectangle(x, y, x + w, y + h) for x, y, w, h in boxes]
    return scene(polygons(outlines, 0.15), 0.6, title="Stone gate")


def arched_bridge() -> Scene:
    """A segmental arch with fill, and an axle at a quarter of the span."""
    axle = Load(force={"axle": EdgeForce((0.0, -1e4), x=1.5, width=0.3)})
    made = bridge(6.0, 1.5, 0.4)
    return scene(made.mesh(size=0.2), 0.7, title="Bridge under an axle", live=axle)


def earth_wall() -> Scene:
    """A wall of dry stone and the earth behind it, whose pressure grows."""
    made = retaining_wall(2.4, 1.2, 0.6, 8, 3)
    push = Load(earth={"back": EarthPressure(2.4, 17e3, coefficient=0.3)})
    return scene(made.mesh(size=0.15), 0.75, title="Retaining wall", live=push)


def round_arch() -> Scene:
    """A semicircle whose weight acts sideways."""
    return scene(arch(15, 0.15, elements=4), 1.0, "springings", title="Arch")


def small_tower() -> Scene:
    """A slender wall of large stones with two windows."""
    windows = [Opening(1.0, 1.4, (3 + 6 * k, 5 + 6 * k)) for k in range(2)]
    made = Ashlar(2.4, [0.5] * 14, (0.6, 1.0), windows).drawing(np.random.default_rng(50))
    return scene(made.mesh(size=0.25), 0.6, title="Tower")


def ring() -> Scene:
    """Sixteen stones around a hole, the lower half in the ground, with a load on the highest."""
    turn = np.pi / 8.0 * (np.arange(17) + 0.5) - np.pi / 2.0
    rays = np.column_stack([np.cos(turn), np.sin(turn)])
    sides = list(pairwise(rays))
    outlines = [np.array([0.8 * a, 1.2 * a, 1.2 * b, 0.8 * b]) for a, b in sides]
    ground = {"ground": [(1.2 * a, 1.2 * b) for a, b in sides if a[1] + b[1] < -0.1]}
    load = Load(force={"load": EdgeForce((0.0, -1e4), x=0.0, width=0.2)})
    return scene(polygons(outlines, 0.1, None, ground), 0.9, "ground", title="Ring", live=load)


def wall_with_opening() -> Scene:
    """Wall W3 with all its weight to the left, and a compressive strength."""
    mesh = BlockMesh.from_file(MESHES / "w3.msh")
    weak = {"default": replace(STONE, compressive_strength=2e5)}
    options = SolveOptions(direction="negative")
    return scene(mesh, 0.65, title="Wall with an opening", materials=weak, solve=options)


EIGHT: dict[str, Callable[[], Scene]] = {
    "facade": small_facade,
    "gate": gate,
    "bridge": arched_bridge,
    "retaining wall": earth_wall,
    "arch": round_arch,
    "tower": small_tower,
    "ring": ring,
    "wall with opening": wall_with_opening,
}


@cache
def collapse(name: str) -> LimitLoad:
    """The limit load of one of them, solved once."""
    return limit_load(EIGHT[name]())
