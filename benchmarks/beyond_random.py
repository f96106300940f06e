"""Ways after the peak of random structures, proved by a second solver, turned and mirrored.

    python3 benchmarks/beyond_random.py plane | space [--first 0] [--count 60] [--second 20]
                                        [--other 0] [--seconds 60]

One line for each scene: what is told of its way. Poses of scenes below `--second` are held against
plain statics by Clarabel: weights at centroids, friction, and forces at points that touch, or close
within the step. `missing` is the largest force by which a block misses equilibrium at the load
factor told, over all weights, `above` by how much that is over the most that associative friction
carries. Scenes below `--other` are followed mirrored, in space turned about z by 30 degrees as
well: `other` is the largest difference of load factors along the ways, over the first one.
"""

from __future__ import annotations

import argparse
import sys
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import clarabel
import numpy as np
from scipy.sparse import block_diag, bmat, csc_matrix, vstack
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import spatial
from benchmarks.beyond import standing
from fenics_contact.errors import Stopped
from fenics_contact.geometry.mesh import Array
from fenics_contact.motion.beyond import Beyond, beyond
from fenics_contact.motion.path import TOUCH, BeyondPoint
from fenics_contact.motion.step import MovingBlocks
from fenics_contact.spatial import JointLaw, Load, Material, Scene, SolveOptions
from fenics_contact.spatial.limit import collapse_of
from fenics_contact.spatial.structure import Structure
from tests.motion.structures import MIRROR, TURN, seen
from tests.property.scenes import KINDS
from tests.spatial.bank import towards

GRAVITY = 9.81
#: Equilibrium is missed by this part of all weights at most.
PROVED = 1e-6
#: Blocks of a structure in space.
MOST = 45


def plane(seed: int) -> tuple[str, Scene]:
    """Blocks of a kind on level ground, or as sloped as they are drawn for."""
    random = np.random.default_rng([51, seed])
    kind = list(KINDS)[seed % len(KINDS)]
    outline = KINDS[kind](random, int(np.exp(random.uniform(np.log(2.0), np.log(40.0)))))
    scene = standing([block.tolist() for block in outline.blocks], random.uniform(0.3, 1.0))
    slope = np.radians(outline.slope)
    down = (-GRAVITY * np.sin(slope), -GRAVITY * np.cos(slope))
    push = float(random.choice([-1.0, 1.0])) * GRAVITY
    return kind, replace(scene, dead=Load(body=down), live=Load(body=(push, 0.0)))


def space(seed: int) -> tuple[str, Scene]:
    """A structure of a kind of at most `MOST` blocks, pushed to any side."""
    draw = np.random.default_rng([51, seed])
    kind = ("wall", "corner", "house", "dome", "vault")[seed % 5]
    for _ in range(100):
        blocks = getattr(spatial, f"random_{kind}")(draw, 25.0)()
        if sum(not block.fixed for block in blocks) <= MOST:
            break
    joints = {"default": JointLaw(friction=float(draw.uniform(0.3, 1.0)))}
    return kind, Scene(
        blocks=blocks,
        joints=joints,
        materials={"default": Material(density=2000.0)},
        dead=Load(body=(0.0, 0.0, -GRAVITY)),
        live=Load(direction=towards(float(draw.uniform(0.0, 360.0)))),
        solve=SolveOptions(quick=True),
    )


# ---- plain statics of a pose


@dataclass(frozen=True)
class Statics:
    """Points that touch in a pose, and the weights of blocks.

    Attributes:
        moments: Forces of points, normal first, to forces and moments of blocks over the weight.
        friction: Coefficients, shape (points,).
        dead: Forces and moments of the dead load over the weight, by blocks.
        live: Likewise.
    """

    moments: Any
    friction: Array
    dead: Array
    live: Array

    @classmethod
    def of(cls, bodies: MovingBlocks, point: BeyondPoint, sign: float, closing: bool) -> Statics:
        """Forces act in points on the blocks of these, and reversed on those of the planes."""
        structure, poses = bodies.structure, point.poses
        units = bodies.sides.near(poses, bodies.size)
        place, axes, away = units.at(poses)
        touch = away[:, 0] < TOUCH * bodies.size
        if closing:
            touch |= cKDTree(point.pressed).query(place)[0] < 1e-9 * bodies.size
        friction, place, axes = units.friction[touch], place[touch], axes[touch]
        kept = [0, 2, 4] if structure.dimension == 2 else list(range(6))
        ways = axes[:, : structure.dimension]
        number = structure.number
        matrix = np.zeros((len(place), ways.shape[1], number.max() + 1, 6))
        for side, blocks in ((1.0, units.point[touch]), (-1.0, units.plane[touch])):
            arm = (place - poses.centroid[blocks])[:, None] / bodies.size
            wrench = side * np.concatenate([ways, np.cross(arm, ways)], axis=2)
            free = np.flatnonzero(number[blocks] >= 0)
            matrix[free, :, number[blocks[free]]] += wrench[free]
        loads = [np.zeros((len(bodies.moves), 6)) for _ in range(2)]
        for load, given in zip(loads, (structure.dead, structure.live), strict=True):
            load[:, :3] = given[bodies.moves, :3]  # of body forces: at the centroids
        weight = np.linalg.norm(loads[0], axis=1).sum()
        dead, live = (load[:, kept].ravel() / weight for load in loads)
        rows = matrix[..., kept].reshape(place.shape[0] * ways.shape[1], -1).T
        return cls(csc_matrix(rows), friction, dead, sign * live)

    def missing(self, load_factor: float) -> float:
        """The least largest force that blocks miss equilibrium by, over the weight."""
        one = np.ones((len(self.dead), 1))
        rows = bmat([[self.moments, -one], [-self.moments, -one]])
        load = self.dead + load_factor * self.live
        return self._least(1.0, rows, np.append(-load, load), clarabel.NonnegativeConeT)

    def most(self) -> float:
        """The largest load factor with associative friction."""
        rows = bmat([[self.moments, self.live[:, None]]])
        return -self._least(-1.0, rows, -self.dead, clarabel.ZeroConeT)

    def _least(self, sign: float, rows: Any, right: Array, cone: Any) -> float:
        """The least of sign x, the unknown behind the forces, within friction."""
        points = len(self.friction)
        size = self.moments.shape[1] // points
        signs = block_diag([np.diag([-mu, *[-1.0] * (size - 1)]) for mu in self.friction])
        own = bmat([[signs, csc_matrix((size * points, 1))]])
        cost = np.append(np.zeros(size * points), sign)
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads = False, 1
        found = clarabel.DefaultSolver(
            csc_matrix((len(cost), len(cost))),
            cost,
            csc_matrix(vstack([rows, own])),
            np.append(right, np.zeros(size * points)),
            [cone(len(right)), *[clarabel.SecondOrderConeT(size)] * points],
            settings,
        ).solve()
        status = str(found.status)
        if status in ("Solved", "AlmostSolved"):
            return float(found.obj_val)
        return np.inf if status.startswith("PrimalInf") else -np.inf


def proved(structure: Structure, way: Beyond, sign: float) -> str:
    """What poses of a way miss by plain statics: the first one, the last one, others between.

    Where points that touch do not hold a pose, those that close within the step are counted, too.
    """
    bodies = MovingBlocks(structure, None, sign)
    points = way.fine.points
    some = sorted({*range(0, len(points), max(len(points) // 8, 1)), len(points) - 1})
    missing, above, closing = [], [], 0
    for point in (points[k] for k in some):
        for more in (False, True):
            statics = Statics.of(bodies, point, sign, more)
            miss = statics.missing(point.load_factor)
            if miss < PROVED:
                break
        closing += more
        missing.append(miss)
        above.append(point.load_factor - statics.most())
    told = f"missing {max(missing):.0e} above {max(above):.0e} in {len(some)}"
    return f"{told}, {closing} of them in the step" if closing else told


def followed(scene: Scene, seconds: float) -> tuple[Structure, Any, Beyond | None]:
    """The limit of a scene and its way, within a time."""
    structure = scene.structure()
    collapse = collapse_of(structure)
    start = time.process_time()

    def check_stop() -> None:
        if time.process_time() - start > seconds:
            raise Stopped(f"{seconds:g} s")

    if collapse.status != "limit":
        return structure, collapse, None
    return structure, collapse, beyond(structure, collapse, check_stop=check_stop)


def apart(one: Beyond, other: Beyond) -> float:
    """Largest difference of load factors of two ways as far as both go, over the first one."""
    here, factor = one.fine.curve
    both = here <= min(one.end, other.end)
    there = np.array([other.at(at) for at in here[both]])
    return float(np.abs(factor[both] - there).max() / abs(factor[0]))


def row(kind: str, scene: Scene, *, second: bool, other: bool, seconds: float) -> Iterator[str]:
    """What is told of a scene, in parts."""
    start = time.process_time()
    structure, collapse, way = followed(scene, seconds)
    yield f"{kind} {int((structure.number >= 0).sum())}"
    if way is None:
        yield collapse.status
        return
    fine, coarse = way.fine, way.coarse
    first = fine.points[0].load_factor
    yield f"{collapse.load_factor:.5f}"
    yield f"{abs(first - collapse.sign * collapse.load_factor):.0e}"
    for trace in (fine, coarse):
        yield f"{trace.why} {trace.points[-1].displacement:.5g}"
    yield f"{max(point.gap for point in fine.points):.0e}"
    yield f"{fine.overlap:.0e}"
    yield f"{fine.energy:.0e}"
    yield f"{sum(point.event == 'jump' for point in fine.points)}"
    yield f"{time.process_time() - start:.0f}"
    if second:
        yield proved(structure, way, collapse.sign)
    if other:
        matrices = (MIRROR, TURN) if structure.dimension == 3 else (MIRROR,)
        for matrix in matrices:
            _, _, same = followed(seen(scene, matrix), seconds)
            yield "other none" if same is None else f"other {apart(way, same):.0e}"


def main() -> None:
    """Print a line for each scene."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("where", choices=["plane", "space"])
    for name, value in (("first", 0), ("count", 60), ("second", 20), ("other", 0), ("seconds", 60)):
        parser.add_argument(f"--{name}", type=int, default=value)
    asked = parser.parse_args()
    print(
        "| seed | blocks | load factor | first one off by | end | with longer steps | gap"
        " | overlap, m | energy | jumps | CPU, s | second solver, turned |"
    )
    print("|---" * 12 + "|")
    for seed in range(asked.first, asked.first + asked.count):
        told = [str(seed)]
        try:
            kind, scene = (plane if asked.where == "plane" else space)(seed)
            options = {"second": seed < asked.second, "other": seed < asked.other}
            told.extend(row(kind, scene, seconds=asked.seconds, **options))
        except Exception:  # what this program looks for
            traceback.print_exc(limit=-4)
            told.append("TRACEBACK")
        print(f"| {' | '.join(told)} |", flush=True)


if __name__ == "__main__":
    main()
