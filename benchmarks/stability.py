"""Numerical stress tests: scenes that are easy to state and hard on the arithmetic.

    python3 benchmarks/stability.py [--quick] [--only PATTERN] [--method all] [--csv FILE]

One row per case and method, compared with a closed form, with the linear program of rigid blocks,
or with the scene that it is a variant of. The verdict "WRONG", a limit load that is claimed and is
not the limit load, is the one that must never occur.

Closed forms are those of rigid blocks on plane joints with all resultants known from statics: a
block slides at F and tips at width / height, a stack of n at width / (n height), an incline of
angle a takes cos a (F - tan a) of the weight down the slope. Elasticity does not enter where a
mechanism of rigid blocks decides (R.K. Livesley, Int. J. Numer. Meth. Eng. 12 (1978) 1853). Walls:
M.C. Ferris, F. Tin-Loi, Int. J. Mech. Sci. 43 (2001) 209.
"""

from __future__ import annotations

import argparse
import csv
import fnmatch
import gc
import math
import multiprocessing
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields, replace
from functools import cache, partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fenics_contact import (
    BlockMesh,
    JointLaw,
    LimitLoad,
    Load,
    Material,
    Scene,
    SolveOptions,
    limit_load,
)
from fenics_contact.analysis.certificate import TOLERANCES
from fenics_contact.meshing import model_from_arrays, polygons, wall, wedge
from fenics_contact.scene import METHODS
from tests.regression.scenes import (
    DENSITY,
    GRAVITY,
    Variant,
    arrays,
    rectangle,
    wall_model,
    wall_scene,
)

Array = npt.NDArray[np.float64]
Tables = Mapping[str, npt.NDArray[np.int64]]

STONE = Material(1e9, 0.2, DENSITY)
WEIGHT, PUSH = Load((0.0, -GRAVITY)), Load((GRAVITY, 0.0))

#: References that are computed with the case.
LINEAR_PROGRAM, BRACKET = "linear program", "bracket"

#: Seconds that one case may take.
TIME_OUT = 60.0

#: Verdicts, the worst first.
VERDICTS = ("WRONG", "not converged", "unstable", "ok")


@dataclass(frozen=True)
class Case:
    """A scene, or several that must give the same, and what is known of the load factor.

    Attributes:
        name: Topic and values.
        scenes: Make the scenes; the row shows the worst of them.
        reference: Load factor, `LINEAR_PROGRAM` (upper end of the bracket, exact without Coulomb
            friction) or `BRACKET` (anything verified between both ends).
        like: Name of the case that this one is a variant of; takes the place of `reference`.
        status: What `limit_load` must say.
        tolerance: On the load factor, relative to the reference or `size`, whichever is larger.
        size: Typical load factor of cases whose reference nearly vanishes.
        quick: Whether the case is in the quick subset.
    """

    name: str
    scenes: Sequence[Callable[[], Scene]]
    reference: float | str = BRACKET
    like: str = ""
    status: str = "limit"
    tolerance: float = 1e-6
    size: float = 0.0
    quick: bool = False


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    name: str
    method: str
    status: str
    load_factor: float = math.nan
    reference: str = "-"
    error: float = math.nan
    residual: str = "-"
    iterations: int = 0
    factorizations: int = 0
    seconds: float = 0.0
    verdict: str = "not converged"


# Scenes


def coulomb(friction: float) -> JointLaw:
    """Coulomb's law."""
    return JointLaw("coulomb", friction)


TRESCA = JointLaw("tresca", bound=2000.0)


def turned(points: npt.ArrayLike, angle: float) -> Array:
    """Points turned about the origin, angle in degrees."""
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    return np.asarray(points, dtype=float) @ np.array([[c, s], [-s, c]])


def turned_load(load: Load, angle: float) -> Load:
    """A load turned with the scene."""
    x, y = turned(load.body, angle).tolist()
    return replace(load, body=(x, y))


def make_scene(
    model: Any,
    law: JointLaw,
    materials: Mapping[str, Material] | None = None,
    angle: float = 0.0,
    dead: Load = WEIGHT,
    live: Load = PUSH,
    **rest: Any,
) -> Scene:
    """Blocks on the ground "base", one law everywhere, loads turned by an angle in degrees."""
    return Scene(
        BlockMesh.from_model(model, MPI.COMM_WORLD),
        materials or {"default": STONE},
        live=turned_load(live, angle),
        dead=turned_load(dead, angle),
        joints={"default": law},
        foundations={"base": law},
        **rest,
    )


def outlined(
    outlines: Sequence[npt.ArrayLike],
    friction: float,
    size: float = 0.1,
    angle: float = 0.0,
    groups: Mapping[str, Sequence[npt.ArrayLike]] | None = None,
    **rest: Any,
) -> Scene:
    """Blocks given by their corners on the ground y = 0, the whole turned by an angle."""
    corners = [np.asarray(outline, dtype=float) for outline in outlines]
    everything = np.concatenate(corners)
    segments = dict(groups or {})
    segments.setdefault("base", [[(everything[:, 0].min(), 0.0), (everything[:, 0].max(), 0.0)]])
    turned_segments = {
        name: [turned(segment, angle) for segment in group] for name, group in segments.items()
    }
    model = polygons([turned(c, angle) for c in corners], size, groups=turned_segments)
    return make_scene(model, coulomb(friction), angle=angle, **rest)


def block(
    width: float, height: float, friction: float, size: float = 0.1, angle: float = 0.0, **rest: Any
) -> Scene:
    """One block: min(F, width / height)."""
    return outlined([rectangle(0.0, 0.0, width, height)], friction, size, angle, **rest)


def stack(
    count: int,
    friction: float,
    width: float = 0.5,
    height: float = 0.2,
    angle: float = 0.0,
    **rest: Any,
) -> Scene:
    """Blocks on top of each other: min(F, width / (count height))."""
    levels = [rectangle(0.0, k * height, width, (k + 1) * height) for k in range(count)]
    return outlined(levels, friction, 0.5 * width, angle, **rest)


TRILITH = (
    rectangle(0.0, 0.0, 0.3, 1.0),
    rectangle(1.0, 0.0, 1.3, 1.0),
    rectangle(0.0, 1.0, 1.3, 1.3),
)


def shaped(
    model: Callable[[], Any],
    law: JointLaw,
    change: Callable[[Array, Tables, Tables], tuple[Array, Tables, Tables]],
    **rest: Any,
) -> Scene:
    """A model with its points, cells and facets changed."""
    return make_scene(model_from_arrays(*change(*arrays(model())), "changed"), law, **rest)


def alternate(points: Array, cells: Tables, facets: Tables) -> tuple[Array, Tables, Tables]:
    """Every second body in group "odd", the others in "even"."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    table = np.concatenate(list(cells.values()))
    first, second = np.repeat(table[:, 0], table.shape[1]), table.ravel()
    graph = coo_matrix((np.ones(len(first)), (first, second)), (len(points), len(points)))
    body = connected_components(graph, directed=False)[1][table[:, 0]]
    odd = np.unique(body, return_inverse=True)[1] % 2 == 1
    return points, {"odd": table[odd], "even": table[~odd]}, facets


def contrasted(model: Callable[[], Any], law: JointLaw, ratio: float) -> Scene:
    """Every second block `ratio` times as stiff as the others."""
    materials = {"even": STONE, "odd": replace(STONE, young=ratio * STONE.young)}
    return shaped(model, law, alternate, materials=materials)


def scaled(
    x: float, y: float, points: Array, cells: Tables, facets: Tables
) -> tuple[Array, Tables, Tables]:
    """Stretched along the axes."""
    return points * [x, y], cells, facets


def rotated(
    angle: float, points: Array, cells: Tables, facets: Tables
) -> tuple[Array, Tables, Tables]:
    """Turned by an angle in degrees."""
    return turned(points, angle), cells, facets


def shaken(seed: int, points: Array, cells: Tables, facets: Tables) -> tuple[Array, Tables, Tables]:
    """Nodes moved at random, by up to a quarter of the shortest side of a cell.

    Nodes inside blocks move in both directions; nodes on straight sides along them, those of all
    blocks at one place alike; corners of any block stay.
    """
    random = np.random.default_rng(seed)
    table = np.concatenate(list(cells.values()))
    edges = np.concatenate([table[:, [a, a - 1]] for a in range(table.shape[1])])
    along = points[edges[:, 1]] - points[edges[:, 0]]
    reach = 0.25 * np.linalg.norm(along, axis=1).min()
    _, index, count = np.unique(
        np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
    )
    outer = index[count == 1]
    place = np.unique(np.round(points / (1e-6 * reach)), axis=0, return_inverse=True)[1].ravel()
    # Sum of t t^T over the sides at a place: rank 1 where all lie on one line.
    unit = along[outer] / np.linalg.norm(along[outer], axis=1)[:, None]
    tensor = np.zeros((place.max() + 1, 2, 2))
    for end in edges[outer].T:
        np.add.at(tensor, place[end], unit[:, :, None] * unit[:, None, :])
    values, vectors = np.linalg.eigh(tensor)
    move = random.uniform(-reach, reach, (len(tensor), 2)) / math.sqrt(2.0)
    on_line = np.einsum("ni,nj,nj->ni", vectors[:, :, 1], vectors[:, :, 1], move)
    inside, straight = values[:, 1] == 0.0, values[:, 0] <= 1e-9 * values[:, 1]
    kept = np.where(inside[:, None], move, np.where(straight[:, None], on_line, 0.0))
    return points + kept[place], cells, facets


def feet(side: float, friction: float) -> Scene:
    """A unit block on two square feet under its corners."""
    outlines = [
        rectangle(0.0, 0.0, side, side),
        rectangle(1.0 - side, 0.0, 1.0, side),
        rectangle(0.0, side, 1.0, 1.0 + side),
    ]
    return outlined(outlines, friction)


def pier(side: float, friction: float) -> Scene:
    """A unit block on one square stone under its middle."""
    low, high = 0.5 * (1.0 - side), 0.5 * (1.0 + side)
    return outlined(
        [rectangle(low, 0.0, high, side), rectangle(0.0, side, 1.0, 1.0 + side)], friction
    )


def tipping(side: float, arm: float) -> float:
    """Tipping of unit block and square foot about a corner on the ground.

    Args:
        side: Of the foot that turns with the block.
        arm: Horizontal distance of the block's centre from that corner.
    """
    foot = side**2
    return (arm + 0.5 * foot * side) / (0.5 + side + 0.5 * foot * side)


def overhang(share: float) -> Scene:
    """Two slabs 1 x 0.5, the upper one moved by a share of half its length."""
    shift = 0.5 * share
    outlines = [rectangle(0.0, 0.0, 1.0, 0.5), rectangle(shift, 0.5, 1.0 + shift, 1.0)]
    groups = {"base": [[(0.0, 0.0), (1.0, 0.0)]]}
    return outlined(outlines, 1.0, 0.25, groups=groups)


def incline(angle: float, friction: float, count: int = 1, **rest: Any) -> Scene:
    """A stack on a slope that rises to the right, pushed down the slope."""
    a = math.radians(angle)
    dead = Load((-GRAVITY * math.sin(a), -GRAVITY * math.cos(a)))
    live = Load((-GRAVITY, 0.0))
    return stack(count, friction, angle=angle, dead=dead, live=live, **rest)


def wedge_scene(friction: float) -> Scene:
    """A weightless wedge of half angle 30 degrees pressed between blocks of unit weight 1.

    P / W = 2 F / (cot(30 + phi) - F) with P the force on the wedge and W the weight of a block;
    it locks at F = tan 30.
    """
    height, length = 0.5, 3.0
    half = height * math.tan(math.radians(30.0))
    weight = 1000.0 * GRAVITY * (length * height - 0.5 * half * height)
    law = coulomb(friction)
    return Scene(
        BlockMesh.from_model(wedge(30.0, height, length), MPI.COMM_WORLD),
        {"blocks": Material(1e9, 0.2, 1000.0), "wedge": Material(1e9, 0.2, 0.0)},
        live=Load((0.0, 0.0), {"top": (0.0, -0.5 * weight / half)}),
        dead=WEIGHT,
        joints={"default": law},
        foundations={"base": law},
    )


def wedge_factor(friction: float) -> float:
    """Closed form of `wedge_scene`."""
    slope = 1.0 / math.tan(math.radians(30.0) + math.atan(friction))
    return 2.0 * friction / (slope - friction) if slope > friction else math.inf


# Cases


def contrast_cases() -> Iterator[Case]:
    """Blocks of very different stiffness."""
    models = {
        "stack": partial(wall, [[1.0]] * 5, (0.5, 0.2)),
        "trilith": partial(polygons, TRILITH, 0.1),
    }
    tips = {"stack": 0.5, "trilith": 0.3}
    for ratio in (1e-6, 1e-3, 1e3, 1e6):
        for name, model in models.items():
            for friction in (0.1, 0.7):
                yield Case(
                    f"contrast {ratio:g} {name} F={friction}",
                    [partial(contrasted, model, coulomb(friction), ratio)],
                    min(friction, tips[name]),
                    quick=name == "stack" and ratio in (1e-3, 1e3),
                )
        for name in ("W1", "W3", "W4"):
            yield Case(
                f"contrast {ratio:g} {name} Tresca",
                [partial(contrasted, partial(wall_model, name), TRESCA, ratio)],
                LINEAR_PROGRAM,
                quick=name == "W1" and ratio == 1e3,
            )
        yield Case(
            f"contrast {ratio:g} W1 F=0.65",
            [partial(contrasted, partial(wall_model, "W1"), coulomb(0.65), ratio)],
        )


def _plain_wall(name: str, law: JointLaw, **rest: Any) -> Scene:
    return make_scene(wall_model(name), law, **rest)


def poisson_cases() -> Iterator[Case]:
    """Nearly incompressible blocks."""
    values = [("strain", nu) for nu in (0.0, 0.3, 0.49, 0.499, 0.4999)]
    for plane, nu in [*values, ("stress", 0.2), ("stress", 0.4999)]:
        rest = {"materials": {"default": replace(STONE, poisson=nu)}, "plane": plane}
        name = f"nu={nu:g} plane {plane}"
        for friction in (0.1, 0.7):
            scene = partial(block, 0.4, 1.0, friction, **rest)
            exact = min(friction, 0.4)
            yield Case(f"{name} block F={friction}", [scene], exact, quick=nu == 0.4999)
        yield Case(
            f"{name} W1 Tresca", [partial(_plain_wall, "W1", TRESCA, **rest)], LINEAR_PROGRAM
        )
        yield Case(f"{name} W1 F=0.65", [partial(_plain_wall, "W1", coulomb(0.65), **rest)])


def friction_cases() -> Iterator[Case]:
    """From no friction to more than walls can use."""
    for friction in (0.0, 1e-6, 0.1, 1.0, 10.0):
        # What matters of a tiny load factor is its size against tipping.
        rest: dict[str, Any] = {"size": 1e-3, "quick": True}
        label = f"F={friction:g}"
        scene = partial(block, 0.4, 1.0, friction)
        yield Case(f"friction block {label}", [scene], min(friction, 0.4), **rest)
        yield Case(
            f"friction stack {label}", [partial(stack, 5, friction)], min(friction, 0.5), **rest
        )
        for name in ("W1", "W3"):
            yield Case(
                f"friction {name} {label}",
                [partial(_plain_wall, name, coulomb(friction))],
                quick=name == "W1" and friction == 0.1,
            )
    for name, values in {"W1": (0.65,), "W2": (1.0, 10.0), "W4": (0.3, 0.5, 0.8)}.items():
        for friction in values:
            scene = partial(_plain_wall, name, coulomb(friction))
            yield Case(f"friction {name} F={friction:g}", [scene])


def aspect_cases() -> Iterator[Case]:
    """Flat slabs, slender columns, needle cells."""
    for friction in (0.5, 200.0):
        scene = partial(block, 10.0, 0.1, friction)
        yield Case(f"aspect slab 100:1 F={friction:g}", [scene], min(friction, 100.0))
    for friction in (0.005, 0.5):
        scene = partial(block, 0.1, 10.0, friction)
        yield Case(f"aspect column 1:100 F={friction:g}", [scene], min(friction, 0.01), quick=True)
    flat, tall = partial(wall, [[1.0]], (2000.0, 1.0), 1), partial(wall, [[1.0]], (1.0, 500.0), 1)
    for friction in (0.5, 4000.0):
        exact = min(friction, 2000.0)
        scene = partial(shaped, flat, coulomb(friction), partial(scaled, 1.0, 1.0))
        yield Case(
            f"aspect slab of cells 1000:1 F={friction:g}", [scene], exact, quick=friction == exact
        )
    for friction in (0.5, 2.0):
        for x, y, name in ((1.0, 2e-3, "flat"), (1e-3, 0.5, "tall")):
            law = coulomb(friction)
            base = tall if name == "flat" else partial(wall, [[1.0]], (1000.0, 2.0), 500)
            scene = partial(shaped, base, law, partial(scaled, x, y))
            yield Case(f"aspect {name} cells 1000:1 F={friction:g}", [scene], min(friction, 1.0))
    upper = partial(wall, [[1.0]] * 5, (1000.0, 1.0), 1)
    for friction in (0.1, 300.0):
        scene = partial(shaped, upper, coulomb(friction), partial(scaled, 1.0, 1.0))
        exact = min(friction, 200.0)
        yield Case(f"aspect 5 slabs 1000:1 F={friction:g}", [scene], exact, quick=True)


def small_joint_cases() -> Iterator[Case]:
    """Joints much shorter than blocks, and stones much smaller than others."""
    for side in (1e-2, 1e-3, 1e-4):
        for friction in (0.5, 2.0):
            tips = tipping(side, 0.5)
            yield Case(
                f"small feet {side:g} F={friction}",
                [partial(feet, side, friction)],
                min(friction, tips),
                quick=side == 1e-3,
            )
        tips = tipping(side, 0.5 * side)
        for friction in (0.5 * tips, 0.5):
            yield Case(
                f"small pier {side:g} F={friction:.3g}",
                [partial(pier, side, friction)],
                min(friction, tips),
            )
    for side in (1e-2, 1e-3):
        stone = rectangle(0.5, 1.0, 0.5 + side, 1.0 + 2.0 * side)
        for friction in (0.3, 0.7):
            scene = partial(outlined, [rectangle(0.0, 0.0, 1.0, 1.0), stone], friction)
            yield Case(
                f"small stone {side:g} on block F={friction}",
                [scene],
                min(friction, 0.5),
                quick=side == 1e-3,
            )


UNITS = {
    "mm, N": Variant(length=1e-3),
    "um, N": Variant(length=1e-6),
    "um, uN": Variant(length=1e-6, force=1e-6),
    "km, N": Variant(length=1e3),
    "km, GN": Variant(length=1e3, force=1e9),
    "m, GN": Variant(force=1e9),
}

PLAIN = {"W1 Tresca": ("W1", TRESCA), "W1 F=0.65": ("W1", coulomb(0.65))}


def invariance_cases() -> Iterator[Case]:
    """What must not change a load factor: units, angles, numbers, nodes."""
    for plain, (name, law) in PLAIN.items():
        reference = f"plain {plain}"
        yield Case(
            reference,
            [partial(wall_scene, name, law)],
            LINEAR_PROGRAM if law is TRESCA else BRACKET,
            quick=True,
        )
        for unit, variant in UNITS.items():
            scene = partial(wall_scene, name, law, variant=variant)
            quick = unit in ("um, N", "km, GN")
            yield Case(f"units {unit} {plain}", [scene], like=reference, quick=quick)
        for angle in (17.0, 45.0, 90.0, 123.0):
            model, change = partial(wall_model, name), partial(rotated, angle)
            scene = partial(shaped, model, law, change, angle=angle)
            quick = angle == 17.0
            yield Case(f"turned {angle:g} {plain}", [scene], like=reference, quick=quick)
        numbers = [partial(wall_scene, name, law, variant=Variant(seed=s)) for s in range(20)]
        yield Case(f"20 numberings {plain}", numbers, like=reference)
        moved = [
            partial(shaped, partial(wall_model, name), law, partial(shaken, s)) for s in range(20)
        ]
        tolerance = 1e-6 if law is TRESCA else 5e-3
        yield Case(f"20 moved nodes {plain}", moved, like=reference, tolerance=tolerance)
    for angle in (0.0, 17.0, 45.0, 90.0, 123.0):
        for friction in (0.1, 0.7):
            label, quick = f"F={friction}", angle == 17.0
            scene = partial(block, 0.4, 1.0, friction, angle=angle)
            exact = min(friction, 0.4)
            yield Case(f"turned {angle:g} block {label}", [scene], exact, quick=quick)
            scene = partial(stack, 5, friction, angle=angle)
            yield Case(f"turned {angle:g} stack {label}", [scene], min(friction, 0.5), quick=quick)


def verge_cases() -> Iterator[Case]:
    """Dead loads that barely stand or barely do not; wedges that nearly lock."""
    slope = 17.0
    a = math.radians(slope)
    for margin in (1e-3, -1e-3, 1e-6, -1e-6):
        stands = margin > 0.0
        rest: dict[str, Any] = {"status": "limit" if stands else "unstable", "size": 1e-3}
        rest["quick"] = abs(margin) == 1e-3
        friction = math.tan(a) * (1.0 + margin)
        exact = math.cos(a) * friction - math.sin(a) if stands else BRACKET
        for count in (1, 2):
            scene = partial(incline, slope, friction, count)
            yield Case(f"verge incline {count} blocks F {margin:+g}", [scene], exact, **rest)
        # Tips backwards about its lower corner: width / height = tan a.
        width = 0.4 * math.tan(a) * (1.0 + margin)
        exact = math.cos(a) * width / 0.4 - math.sin(a) if stands else BRACKET
        scene = partial(incline, slope, 0.7, 2, width=width)
        yield Case(f"verge leaning stack width {margin:+g}", [scene], exact, **rest)
        exact = 2.0 * margin if stands else BRACKET  # arm 0.5 margin, height 0.25
        scene = partial(overhang, 1.0 - margin)
        yield Case(f"verge overhang {-margin:+g}", [scene], exact, **rest)
    for friction in (0.5, 0.57, 0.577, 0.5778, 0.6):
        exact = wedge_factor(friction)
        status = "limit" if exact < math.inf else "unbounded"
        scene = partial(wedge_scene, friction)
        quick = abs(friction - math.tan(math.radians(30.0))) < 1e-3
        yield Case(f"verge wedge F={friction}", [scene], exact, status=status, quick=quick)


def arrangement_cases() -> Iterator[Case]:
    """Many blocks, blocks that meet at a point, bodies that stand apart."""
    for friction in (0.01, 0.7):
        tower = partial(make_scene_of, partial(wall, [[1.0]] * 200, (0.5, 0.2)), coulomb(friction))
        yield Case(f"tower of 200 F={friction}", [tower], min(friction, 0.0125))
    bond = partial(wall, [[1.0, 1.0]] * 2, (0.4, 0.2))
    yield Case("2 x 2 stack bond Tresca", [partial(make_scene_of, bond, TRESCA)], LINEAR_PROGRAM)
    for friction in (0.2, 0.65, 1.0, 10.0):
        scene = partial(make_scene_of, bond, coulomb(friction))
        yield Case(f"2 x 2 stack bond F={friction}", [scene], quick=friction == 0.65)
    one, other = rectangle(0.0, 0.0, 0.4, 1.0), rectangle(2.0, 0.0, 2.3, 1.0)
    for friction in (0.1, 0.7):
        groups = {"base": [[(0.0, 0.0), (0.4, 0.0)]], "held": [[(2.0, 0.0), (2.3, 0.0)]]}
        rest: dict[str, Any] = {"groups": groups, "supports": {"held": "fixed"}}
        scene = partial(outlined, [one, other], friction, **rest)
        exact = min(friction, 0.4)
        yield Case(f"held body apart F={friction}", [scene], exact, quick=True)
        scene = partial(outlined, [one, other], friction)
        exact = min(friction, 0.3)
        yield Case(f"two structures F={friction}", [scene], exact, quick=True)


def make_scene_of(model: Callable[[], Any], law: JointLaw) -> Scene:
    """`make_scene` with the model made when it is needed."""
    return make_scene(model(), law)


def all_cases() -> list[Case]:
    """Every case, in the order of the table."""
    topics = (
        contrast_cases,
        poisson_cases,
        friction_cases,
        aspect_cases,
        small_joint_cases,
        invariance_cases,
        verge_cases,
        arrangement_cases,
    )
    return [case for topic in topics for case in topic()]


# Running


class Runner:
    """Runs cases in this process and remembers those that others refer to."""

    def __init__(self, method: str = "auto") -> None:
        self.options = SolveOptions(method=method)
        self._cases = {case.name: case for case in all_cases()}
        self._factors: dict[str, float] = {}

    def run(self, case: Case) -> Row:
        """The row of a case: the worst of its scenes."""
        start = time.perf_counter()
        rows = [self._row(case, scene) for scene in case.scenes]
        worst = min(rows, key=lambda row: (VERDICTS.index(row.verdict), -row.error))
        return replace(worst, seconds=time.perf_counter() - start)

    def _row(self, case: Case, scene: Callable[[], Scene]) -> Row:
        try:
            result = limit_load(replace(scene(), solve=self.options))
        except Exception as error:  # one case must not stop the table
            print(f"{case.name}: {error}", file=sys.stderr)
            return Row(case.name, self.options.method, type(error).__name__)
        row = self._judged(case, result)
        result.structure.destroy()
        gc.collect()
        return row

    def _judged(self, case: Case, result: LimitLoad) -> Row:
        collapse, factor = result.positive, result.load_factor
        certificate = None if collapse is None else collapse.certificate
        text, reference = self._reference(case, result)
        error = relative_error(factor, reference, case.size)
        inside = True
        if result.bounds is not None and case.status == "limit":
            lower = -math.inf if result.bounds.lower is None else result.bounds.lower
            inside = lower - 1e-6 <= factor <= result.bounds.upper * (1.0 + 1e-6) + 1e-9
        right = inside and not error > case.tolerance
        return Row(
            case.name,
            self.options.method,
            result.status,
            factor,
            text,
            error,
            "-" if certificate is None else worst_residual(certificate.residuals),
            0 if collapse is None else sum(len(h.steps) for h in collapse.history),
            result.factorizations,
            verdict=verdict(case.status, result.status, right),
        )

    def _reference(self, case: Case, result: LimitLoad) -> tuple[str, float]:
        """What the table shows, and a number; nan if there is none."""
        if case.like:
            value = self._factor(case.like)
        elif isinstance(case.reference, float):
            value = case.reference
        elif result.bounds is None:
            return "-", math.nan
        elif case.reference == LINEAR_PROGRAM:
            value = result.bounds.upper
        else:
            return f"< {result.bounds.upper:.5g}", math.nan
        return f"{value:.8g}", value

    def _factor(self, name: str) -> float:
        """Load factor of another case; nan if it was not found."""
        if name not in self._factors:
            scene = replace(self._cases[name].scenes[0](), solve=self.options)
            result = limit_load(scene)
            self._factors[name] = result.load_factor if result.status == "limit" else math.nan
        return self._factors[name]


def relative_error(factor: float, reference: float, size: float) -> float:
    """Error relative to the reference, or to a typical size if that is larger."""
    if factor == reference:
        return 0.0
    return abs(factor - reference) / max(abs(reference), size, 1e-300)


def verdict(expected: str, status: str, right: bool) -> str:
    """What to think of a result; `right` is whether the number is."""
    if status == "not_converged":
        return "not converged"
    if status == "unstable" != expected:
        return "unstable"
    return "ok" if status == expected and (right or status == "unstable") else "WRONG"


def worst_residual(residuals: Mapping[str, float]) -> str:
    """The residual that is largest relative to what is tolerated."""
    name = max(residuals, key=lambda key: residuals[key] / TOLERANCES[key])
    return f"{name} {residuals[name]:.1e}"


@cache
def runner(method: str) -> Runner:
    """The runner of a method in this process."""
    return Runner(method)


def answer(task: tuple[str, str]) -> Row:
    """The row of a method and a case's name."""
    method, name = task
    return runner(method).run(next(case for case in all_cases() if case.name == name))


def _serve(pipe: Connection, work: Callable[[Any], Any]) -> None:
    """Do tasks that come through a pipe."""
    while task := pipe.recv():
        pipe.send(work(task))


class Process:
    """A process that does tasks and is replaced when one takes too long."""

    def __init__(self, work: Callable[[Any], Any]) -> None:
        self.work = work
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, there = context.Pipe()
        self.process = context.Process(target=_serve, args=(there, self.work), daemon=True)
        self.process.start()
        there.close()

    def run(self, task: Any, seconds: float) -> Any:
        """What the work makes of a task; "time-out" or "crash" if nothing."""
        self.pipe.send(task)
        try:
            if self.pipe.poll(seconds):
                return self.pipe.recv()
            status = "time-out"
        except (EOFError, ConnectionError):
            status = "crash"
        self.process.kill()
        self.process.join()
        self._start()
        return status

    def stop(self) -> None:
        """End the process."""
        self.pipe.send(None)
        self.process.join()


# Table

COLUMNS = "{:38} {:11} {:13} {:>13} {:>13} {:>8} {:24} {:>5} {:>5} {:>6} {}"


def number(value: float, form: str) -> str:
    """A number in a table; a dash where there is none."""
    return "-" if math.isnan(value) else format(value, form)


def line(row: Row) -> str:
    """A row of the table."""
    factor, error = number(row.load_factor, ".8g"), number(row.error, ".1e")
    return COLUMNS.format(
        row.name,
        row.method,
        row.status,
        factor,
        row.reference,
        error,
        row.residual,
        row.iterations,
        row.factorizations,
        f"{row.seconds:.1f}",
        row.verdict,
    )


def selected(quick: bool = False, pattern: str = "*") -> list[Case]:
    """Cases of the quick subset, or all, whose name holds a pattern of the shell."""
    match = re.compile(fnmatch.translate(f"*{pattern}*"), re.IGNORECASE).match
    return [case for case in all_cases() if (case.quick or not quick) and match(case.name)]


def main() -> int:
    """Run the table; exit code 1 if anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="about 20 s")
    parser.add_argument("--only", default="*", metavar="PATTERN", help="cases whose name holds it")
    parser.add_argument("--method", default="auto", help="as in the scene file, or all")
    parser.add_argument("--time-out", type=float, default=TIME_OUT, metavar="S", help="per case")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the table there too")
    options = parser.parse_args()
    methods = METHODS if options.method == "all" else (SolveOptions(options.method).method,)
    head = ("case", "method", "status", "load factor", "reference", "error", "worst residual")
    print(COLUMNS.format(*head, "iter", "fact", "s", "verdict"))
    process = Process(answer)
    rows = []
    for case in selected(options.quick, options.only):
        for method in methods:
            row = process.run((method, case.name), options.time_out)
            if isinstance(row, str):
                row = Row(case.name, method, row, seconds=options.time_out)
            rows.append(row)
            print(line(row), flush=True)
    process.stop()
    for method in methods:
        counts = Counter(row.verdict for row in rows if row.method == method)
        listed = ", ".join(f"{counts[name]} {name}" for name in VERDICTS)
        print(f"{method}: {listed} of {counts.total()}")
    if options.csv:
        with options.csv.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(field.name for field in fields(Row))
            writer.writerows(astuple(row) for row in rows)
    return 1 if any(row.verdict == "WRONG" for row in rows) else 0


if __name__ == "__main__":
    raise SystemExit(main())
