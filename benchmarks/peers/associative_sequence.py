"""Sequence of associative programs for rigid blocks in space, by Clarabel.

    python3 benchmarks/peers/associative_sequence.py

Coulomb's friction without dilatancy is approached by programs with a part a of the friction that
dilates, and a given strength of points,

    |t| <= (1 - a) F N_k + a F n,    N_k the pressing forces of the programs before,

a = 0.3 at first and 0.7 times as large from program to program. The strength moves by 0.6 of what
it should. After M. Gilbert, C. Casapulla, H.M. Ahmed, Comput. Struct. 84 (2006) 873; F. Portioli et
al., Comput. Struct. 142 (2014) 216, whose parameters are others.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csc_matrix, hstack, vstack

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from fenics_contact.faces.model import FaceModel

Array = npt.NDArray[np.float64]

#: Part of friction that dilates at first, its factor, relaxation, and programs at most.
PART, SHRINKS, RELAXED, PROGRAMS = 0.3, 0.7, 0.6, 30
SCENES = (
    *("facade 4x2x6 0.7", "facade 6x3x10 0.6", "facade 8x4x15 0.6"),
    *("dome 16x8", "house 8x6x12 0"),
)


def sequence(model: FaceModel) -> Iterator[float]:
    """Load factors of the programs, from the associative one; settled at 1e-4 twice."""
    factor, pressed = solved(model, model.strength, model.friction)
    yield factor
    part = PART
    settled = 0
    for _ in range(PROGRAMS):
        strength = model.strength + (1.0 - part) * model.friction * pressed
        before = factor
        factor, own = solved(model, strength, part * model.friction)
        yield factor
        settled = settled + 1 if abs(factor - before) < 1e-4 * abs(factor) else 0
        if settled == 2:
            break
        pressed = RELAXED * own + (1.0 - RELAXED) * pressed
        part *= SHRINKS


def solved(model: FaceModel, strength: Array, friction: Array) -> tuple[float, Array]:
    """The largest load factor, nan if there is none, and pressing forces of all points."""
    found = cone_program(model, strength, friction)
    if str(found.status) not in ("Solved", "AlmostSolved"):
        return np.nan, np.zeros(model.shape[0])
    force = model.force * np.array(found.x[1:]).reshape(model.shape)
    return found.x[0] * model.force / model.load, force[:, 0]


def cone_program(model: FaceModel, strength: Array, friction: Array, sign: float = 1.0) -> Any:
    """Clarabel's solution of the largest load factor with |t| <= strength + friction n.

    Its unknowns are that factor times `sign`, in units of force / load, and forces of all points.
    """
    import clarabel

    points = model.shape[0]
    point = np.arange(points)
    width = 1 + 3 * points
    live = csc_matrix(sign * model.live[:, None] / model.load)
    equilibrium = hstack([live, model.transposed])
    pressed = csc_matrix((-np.ones(points), (point, 1 + 3 * point)), (points, width))
    rows = np.concatenate([3 * point, 3 * point + 1, 3 * point + 2])
    columns = np.concatenate([1 + 3 * point, 2 + 3 * point, 3 + 3 * point])
    values = np.concatenate([-friction, -np.ones(2 * points)])
    discs = csc_matrix((values, (rows, columns)), (3 * points, width))
    given = np.zeros((points, 3))
    given[:, 0] = strength / model.force
    right = np.concatenate([-model.dead / model.force, np.zeros(points), given.ravel()])
    cones = [clarabel.ZeroConeT(len(model.dead)), clarabel.NonnegativeConeT(points)]
    cones += [clarabel.SecondOrderConeT(3)] * points
    cost = np.zeros(width)
    cost[0] = -1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    table = vstack([equilibrium, pressed, discs]).tocsc()
    empty = csc_matrix((width, width))
    return clarabel.DefaultSolver(empty, cost, table, right, cones, settings).solve()


def main() -> None:
    """Both on five scenes: load factors, gap, CPU seconds."""
    from benchmarks.spatial import named_scenes
    from fenics_contact.faces.limit import FaceSearch
    from fenics_contact.spatial.limit import NEAR

    scenes = {name: scene for _, name, scene in named_scenes()}
    for name in SCENES:
        model = scenes[name].structure(quick=True).face_model()
        start = time.process_time()
        search = FaceSearch(model, 1e-3, near=NEAR)
        state = search.run()
        here = time.process_time() - start
        start = time.process_time()
        factors = list(sequence(model))
        spent = time.process_time() - start
        least, most = min(factors[-5:]), max(factors[-5:])
        ends = len(factors) <= PROGRAMS
        told = f"{factors[-1]:.5f}" if ends else f"no end, {least:.5f} to {most:.5f}"
        ours = "none" if state is None else f"{state.load_factor:.5f}, gap {state.gap:.0e}"
        print(
            f"{name:22} here {ours}, {here:.1f} s | sequence {told}, {len(factors)} programs,"
            f" {spent:.1f} s, associative {factors[0]:.5f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
