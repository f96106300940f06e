"""Draw docs/path.png: the way to a collapse state, in the plane of T and mu and as load factors.

Run `python3 docs/draw_method.py` from anywhere; it takes about 10 s. The continuation logs every
point of its path; the points are taken from there.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.collapse.strategy import Task, along_block_modes
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import running_bond
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.arclength import (
    FALLING_PRODUCTS,
    RISING_WORK,
    Continuation,
)
from fenics_contact.solvers.joint_stiffness import GENERAL, Tally
from fenics_contact.solvers.kkt import PerturbedKKT

HERE = Path(__file__).parent
BLUE, ORANGE, GREEN, RED, GREY = "#0b62a4", "#e67300", "#2a8a3e", "#c0392b", "#666666"

#: Short steps, so that the points show the curve; the program itself takes longer ones.
FINE = replace(SEARCH, path_change=0.25, allowed_distance=0.05)

#: Work at the end, in units of that on the bonded structure: of W3, and of the wall of 410 blocks.
WORK_W3, WORK_LARGE = 420.0, 400.0


@dataclass(frozen=True)
class Points:
    """Points of one path: load factor, mu (forces times elastic displacements), T (bonded work)."""

    load_factor: Any
    mu: Any
    work: Any


class _Recorder(logging.Handler):
    """Keeps the points that the continuation logs, path by path."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.paths: list[list[tuple[int, float, float, float]]] = []

    def emit(self, record: logging.LogRecord) -> None:
        if "mu %.2e, T %.4e" not in str(record.msg) or not isinstance(record.args, tuple):
            return
        step, load_factor, mu, work = record.args
        if step == 0 or not self.paths:
            self.paths.append([])
        path = self.paths[-1]
        if path and step != path[-1][0] + 1:
            path.pop()  # the last step led too far and was made again
        path.append((step, load_factor, mu, work))  # type: ignore[arg-type]

    def points(self, mu_unit: float, work_unit: float) -> list[Points]:
        """All paths so far."""
        columns = [np.array(path).T[1:] for path in self.paths]
        return [Points(value, mu / mu_unit, work / work_unit) for value, mu, work in columns]


@contextmanager
def recorded() -> Iterator[_Recorder]:
    """Record what the package logs."""
    log, recorder = logging.getLogger("fenics_contact"), _Recorder()
    level, log.propagate = log.level, False
    log.addHandler(recorder)
    log.setLevel(logging.DEBUG)
    try:
        yield recorder
    finally:
        log.removeHandler(recorder)
        log.setLevel(level)
        log.propagate = True


@contextmanager
def tasks(mesh: BlockMesh, friction: float, ratio: float) -> Iterator[Task]:
    """The task of a wall that is pushed sideways by a part of its weight."""
    law = JointLaw("coulomb", friction)
    scene = Scene(
        mesh=mesh,
        materials={"default": Material(young=1.0e9, poisson=0.2, density=1019.368)},
        dead=Load(body=(0.0, -9.81)),
        live=Load(body=(9.81, 0.0)),
        joints={"default": law},
        foundations={"base": law},
    )
    with Discretization(scene) as blocks:
        case = LoadCase.of(blocks, blocks.bonded(GENERAL), 1.0, GENERAL, lambda step: None)
        work = ratio * case.bonded_work
        yield Task(case, work, case.scales_at(work), 1e-6)


def whole_way(task: Task) -> tuple[list[Points], float]:
    """All paths of the program's first attempt, and the load factor that it ends with."""
    with recorded() as recorder:
        solution, _ = along_block_modes(task)
    units = task.scales.elastic_part, task.case.bonded_work
    return recorder.points(*units), solution.state.load_factor


def in_block_modes(task: Task, mu: float) -> tuple[Points, Points]:
    """Rising work with given products, and falling products under the whole work, short steps."""
    case, part = task.case, task.scales.elastic_part
    modes = case.discretization.block_modes.changed(case.problem)
    with recorded() as recorder, modes.stiffness(GENERAL, Tally()) as stiffness:
        kkt = PerturbedKKT.coulomb(modes.reduced, stiffness, task.scales, task.work)
        rising = Continuation(kkt, RISING_WORK, FINE)
        start = modes.restricted(case.bonded_state(case.bonded_work))
        rising.follow(rising.begin(start, mu * part), task.work)
        falling = Continuation(kkt, FALLING_PRODUCTS, FINE)
        start = modes.restricted(case.bonded_state(task.work))
        falling.follow(falling.begin(start, 1.0), 3e-3 * part)
    first, second = recorder.points(part, case.bonded_work)
    return first, second


def draw_plane(axes: Any, paths: list[Points]) -> None:
    """The way in the plane of T and mu."""
    rising, falling, *_ = paths
    axes.set(xscale="log", yscale="log", xlim=(0.3, 4e3), ylim=(1.2e-5, 2.0))
    axes.plot(rising.work, rising.mu, "o-", color=BLUE, markersize=5)
    axes.plot(falling.work[[0, -1]], [1e-2, 3e-3], "o-", color=ORANGE, markersize=5)
    end = float(falling.work[-1])
    arrow = {"arrowstyle": "-|>", "lw": 2.0, "shrinkA": 2, "shrinkB": 0}
    axes.annotate("", (end, 2e-5), (end, 3e-3), arrowprops={**arrow, "color": GREEN})
    axes.annotate(
        "", (0.85, 1e-2), (0.85, 0.35), arrowprops={**arrow, "color": GREY, "linestyle": "--"}
    )
    text: dict[str, Any] = {"fontsize": 9.5}
    left, right = end / 1.15, end * 1.25
    axes.text(0.95, 0.16, "start: response of the\nbonded structure", color=GREY, **text)
    axes.text(3.0, 1.3e-2, "1  T rises, mu stays\n    (block modes)", color=BLUE, **text)
    axes.text(right, 4.0e-3, "2  mu falls\n(block modes)", color=ORANGE, **text)
    third = "3  the structure itself:\nmu falls, then the\ninterior point method"
    axes.text(left, 4e-4, third, color=GREEN, ha="right", va="center", **text)
    axes.text(left, 2.2e-5, "a state with mu = 0", color=GREEN, ha="right", **text)
    axes.annotate("", (3.4e3, 4e-5), (right, 4e-5), arrowprops={**arrow, "color": GREY})
    axes.text(right, 1.2e-4, "4  more work,\nuntil certified", color=GREY, va="center", **text)
    axes.set(xlabel="work T of the live load / work on the bonded structure")
    axes.set(ylabel="products mu / (force x elastic displacement)")
    axes.set_title("(a) The way: W3, friction 0.65", fontsize=11)


def draw_w3(axes: Any, paths: list[Points], limit: float) -> None:
    """Load factor along the rising work on W3, and at the end."""
    rising, falling, *_ = paths
    axes.plot(rising.work, rising.load_factor, "o-", color=BLUE, label="1  rising work")
    axes.plot(falling.work, falling.load_factor, "s", color=ORANGE, label="2  falling products")
    axes.axhline(limit, color=GREEN, ls="--", label=f"3  state with mu = 0: {limit:.5f}")
    axes.set(xscale="log", xlim=(0.7, 1e3), ylim=(0.0, 0.42))
    axes.set(xlabel="T / work on the bonded structure", ylabel="load factor lambda")
    axes.set_title("(b) W3, friction 0.65: one factorisation per point", fontsize=11)
    axes.legend(loc="lower right", fontsize=9.5)


def draw_folds(axes: Any, rising: Points) -> None:
    """Load factor along the rising work on a large wall, and its folds in a window."""
    axes.set(xscale="log", xlim=(0.7, 6e2), ylim=(0.0, 0.5))
    axes.set(xlabel="T / work on the bonded structure", ylabel="load factor lambda")
    axes.set_title("(c) 20 x 20 bricks, friction 0.75, rising work, short steps", fontsize=11)
    back = np.flatnonzero(np.diff(np.log(rising.work)) < 0.0)
    back = back[rising.work[back] > 5.0]
    part = slice(int(back[0]) - 6, int(back[-1]) + 8)
    window = axes.inset_axes((0.43, 0.08, 0.54, 0.56))
    window.plot(rising.work[part], rising.load_factor[part], ".-", color=BLUE, lw=1.3, ms=5)
    axes.plot(rising.work, rising.load_factor, ".-", color=BLUE, lw=1.3, ms=4)
    label = "T falls: beyond a fold"
    for k in back:
        both = rising.work[k : k + 2], rising.load_factor[k : k + 2]
        window.plot(*both, "-", color=RED, lw=2.2, label=label)
        label = ""
    window.legend(loc="lower right", fontsize=9)
    window.tick_params(labelsize=8)
    axes.indicate_inset_zoom(window, edgecolor="0.3")


def draw_falling(axes: Any, falling: Points, last: float) -> None:
    """Load factor along the falling products on the same wall."""
    axes.plot(falling.mu, falling.load_factor, ".-", color=ORANGE, lw=1.3, ms=4)
    axes.axhline(last, color=BLUE, ls="--", label=f"end of (c): {last:.4f}")
    axes.set(xscale="log", ylim=(0.0, 0.5))
    axes.invert_xaxis()
    axes.set(xlabel="mu / (force x elastic displacement), falling to the right")
    axes.set(ylabel="load factor lambda")
    axes.set_title("(d) The same wall, whole work, falling products, short steps", fontsize=11)
    axes.legend(loc="lower right", fontsize=9.5)


def main() -> None:
    """Compute both walls and draw."""
    with tasks(BlockMesh.from_file(HERE.parent / "meshes" / "w3.msh"), 0.65, WORK_W3) as task:
        paths, limit = whole_way(task)
    with tasks(BlockMesh.from_model(running_bond(20, 20, elements=2)), 0.75, WORK_LARGE) as task:
        rising, falling = in_block_modes(task, 3e-2)
    figure = Figure(figsize=(12.5, 9.0), layout="constrained")
    axes = figure.subplots(2, 2)
    draw_plane(axes[0, 0], paths)
    draw_w3(axes[0, 1], paths, limit)
    draw_folds(axes[1, 0], rising)
    draw_falling(axes[1, 1], falling, float(rising.load_factor[-1]))
    for place in axes.ravel():
        place.grid(alpha=0.3)
    figure.savefig(HERE / "path.png", dpi=100)


if __name__ == "__main__":
    main()
