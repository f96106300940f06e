"""Problems with known answers: what docs/verification.md shows.

    python3 benchmarks/verification.py                      # tables, as on the page: minutes
    python3 benchmarks/verification.py --pictures docs      # and its pictures

Units are SI. The problems but public examples are planar; forces are per metre of thickness.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Picture

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.curved_bodies import (
    CGS1,
    EQUAL,
    cattaneo,
    cattaneo_figures,
    cattaneo_shear,
    hertz,
    hertz_figures,
)
from benchmarks.known_answers import Array, Figure, Profile, mesh_of
from benchmarks.manufactured import THEORY, errors
from benchmarks.public_cases import rows as public_rows
from fenics_contact import JointLaw, Load, Material, Scene, equilibrium, limit_load
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import polygons, wall

# ---- contact patch test


#: On top of the blocks, Pa.
PRESSURE = 1e6
SMOOTH = JointLaw("frictionless")
#: Blocks of two courses in running bond, and sizes of their elements if meshed one by one, m.
BOND = [(0.0, 0.0, 0.4), (0.4, 0.0, 0.8), (0.0, 0.2, 0.2), (0.2, 0.2, 0.6), (0.6, 0.2, 0.8)]
SIZES = [0.1, 0.067, 0.05, 0.077, 0.029]


def patch(
    degree: int = 1, size: float | Sequence[float] = 0.1, law: JointLaw = SMOOTH, side: float = 5e5
) -> Scene:
    """Blocks in running bond pressed from above, 1 MPa, and from the side.

    `size` of elements, one for all or one for every block.
    """
    blocks = [[(x, y), (end, y), (end, y + 0.2), (x, y + 0.2)] for x, y, end in BOND]
    corners = np.array([(0.0, 0.0), (0.8, 0.0), (0.8, 0.4), (0.0, 0.4), (0.0, 0.0)])
    names = ("base", "right", "top", "left")
    sides = {name: [ends] for name, ends in zip(names, pairwise(corners), strict=True)}
    return Scene(
        mesh_of(polygons(blocks, size, None, sides)),
        {"default": Material(1e9, 0.2)},
        live=Load(traction={"top": (0.0, -PRESSURE), "right": (-side, 0.0)}),
        joints={"default": law},
        supports={"base": "roller", "left": "roller"},
        degree=degree,
    )


def patch_errors(scene: Scene) -> tuple[float, float]:
    """What uniform stress misses of a state of the scene, and the error of the joint pressure.

    The first is the largest nodal force or opening of the exact state, relative; the second is that
    of the state found, in L2.
    """
    material, loads = scene.materials["default"], scene.live.traction
    stress = np.array([loads["right"][0], loads["top"][1]])
    nu = material.poisson
    strain = (1.0 + nu) / material.young * (stress - nu * stress.sum())
    with Discretization(scene) as made:
        problem, joints = made.problem, made.joints
        place = made.elasticity.arm + made.elasticity.centre[made.elasticity.node_body]
        u = made.supports.to_supports(
            (strain * place).ravel(), made.elasticity.space.dofmap.index_map.local_range[0]
        )
        exact = np.abs(joints.normal) @ -stress
        force = (exact * joints.length)[made.operators.points]
        rest = problem.stiffness @ u - problem.live - problem.normal.T @ force
        largest = problem.max(np.abs(problem.live))
        opened = problem.max(np.abs(problem.normal @ u)) / problem.max(np.abs(u))
        missed = max(problem.max(np.abs(rest)) / largest, opened)
    found = equilibrium(scene).joints["pressure"]
    weight = joints.length
    return missed, float(np.sqrt(np.sum(weight * (found - exact) ** 2) / np.sum(weight * exact**2)))


def loop_errors(size: float | Sequence[float], degree: int) -> tuple[float, float]:
    """Errors of joint pressures of rough blocks that are pressed from above alone.

    The largest pressure on head joints, which carry none, and the error in beds in L2, relative.
    """
    joints = equilibrium(patch(degree, size, JointLaw(friction=0.6), 0.0)).joints
    head = np.abs(joints["normal"][:, 0]) > 0.5
    pressure, weight = joints["pressure"] / PRESSURE, joints["length"][~head]
    bed = float(np.sqrt(np.sum(weight * (pressure[~head] - 1.0) ** 2) / weight.sum()))
    return float(pressure[head].max()), bed


def patch_figures() -> list[Figure]:
    """Errors of the patch test with nodes that match and with others."""
    figures = []
    for name, size in {"nodes match": 0.1, "blocks meshed one by one": SIZES}.items():
        for degree in (1, 2):
            exact, found = patch_errors(patch(degree, size))
            where = f"{name}, degree {degree}"
            figures.append(Figure(f"{where}: exact state", 0.0, exact, 1e-10, True))
            figures.append(Figure(f"{where}: pressure found", 0.0, found, 1e-8, True))
            head, bed = loop_errors(size, degree)
            figures.append(Figure(f"{where}, friction 0.6: head joints", 0.0, head, 1e-5, True))
            figures.append(Figure(f"{where}, friction 0.6: beds", 0.0, bed, 1e-5, True))
    return figures


# ---- block pushed up an incline (NAFEMS CGS-4)


def incline(friction: float = 0.3, slope: float = 0.1) -> list[Figure]:
    """Horizontal force that pushes a block up, over its weight; axes along the incline."""
    angle = math.atan(slope)
    along, across = 9.81 * np.cos(angle), 9.81 * np.sin(angle)
    mesh = mesh_of(polygons([[(0, 0), (1, 0), (1, 0.2), (0, 0.2)]], 0.1))
    scene = Scene(
        mesh,
        {"default": Material(206e9, 0.3, 7800.0)},
        dead=Load((-across, -along)),
        live=Load((along, -across)),
        foundations={"base": JointLaw(friction=friction)},
    )
    exact = (slope + friction) / (1.0 - friction * slope)
    return [Figure("force / weight", exact, limit_load(scene).load_factor, 1e-6)]


# ---- elastic rod on a Coulomb bed

ROD = {"length": 1.0, "height": 0.002, "young": 5e9, "friction": 0.5, "bed": 1e5, "pull": 2.5e4}


def rod(elements: int = 400) -> Profile:
    """A rod pressed on its bed by `bed` N/m per metre and pulled at its right end."""
    length, height, pressure = ROD["length"], ROD["height"], ROD["bed"]
    mesh = mesh_of(wall([[1.0]], (length, height), elements // 2))
    scene = Scene(
        mesh,
        {"default": Material(ROD["young"], 0.0)},
        dead=Load(traction={"top": (0.0, -pressure)}),
        live=Load(traction={"right": (ROD["pull"] / height, 0.0)}),
        foundations={"base": JointLaw(friction=ROD["friction"])},
        plane="stress",
        degree=2,
    )
    return Profile.of(equilibrium(scene))


def rod_slip(x: Array) -> Array:
    """Slip of a rod without height, m."""
    drag, stiffness = ROD["bed"] * ROD["friction"], ROD["young"] * ROD["height"]
    start = ROD["length"] - ROD["pull"] / drag
    return drag / (2.0 * stiffness) * np.maximum(x - start, 0.0) ** 2


def rod_figures(profile: Profile) -> list[Figure]:
    """Slip length and displacement of the rod's end."""
    drag, stiffness = ROD["bed"] * ROD["friction"], ROD["young"] * ROD["height"]
    length = ROD["length"] - profile.x[profile.sticks].max()
    end = ROD["pull"] ** 2 / (2.0 * stiffness * drag)
    return [
        Figure("slip length, m", ROD["pull"] / drag, length, 0.01),
        Figure("displacement of the end, m", end, profile.values["slip"][-1], 0.01),
    ]


# ---- plate on a rigid plane (GRECO, Code_Aster SSNV128)

#: x, m, and displacements u_x there, m: Code_Aster with QUAD8, and the mean of several codes.
PLATE_X = np.array([0.0, 1.25, 5.0, 7.5, 11.25]) * 1e-3
PLATE_QUAD8 = np.array([2.8739, 2.7348, 2.2961, 1.9932, 1.5565]) * 1e-5
PLATE_MEAN = np.array([2.86, 2.72, 2.28, 1.98, 1.50]) * 1e-5


def plate(elements: int = 32, degree: int = 2, quadrilaterals: bool = True) -> Profile:
    """Half of a plate pressed on a rigid plane and from the side."""
    side = 0.04
    scene = Scene(
        mesh_of(wall([[1.0]], (side, side), elements // 2, quadrilaterals)),
        {"default": Material(130e9, 0.2)},
        live=Load(traction={"top": (0.0, -50e6), "left": (150e6, 0.0)}),
        foundations={"base": JointLaw(friction=1.0)},
        supports={"right": "roller"},
        degree=degree,
    )
    return Profile.of(equilibrium(scene))


def plate_figures(profile: Profile) -> list[Figure]:
    """Displacements at the five points."""
    found = np.interp(PLATE_X, profile.x, profile.values["slip"])
    names = [f"u_x at x = {1e3 * x:g} mm, m" for x in PLATE_X]
    return [Figure(*row, 0.01) for row in zip(names, PLATE_QUAD8, found, strict=True)]


# ---- orders of convergence

#: Elements along a block, by degree.
MESHES = {1: (8, 16, 32, 64), 2: (4, 8, 16, 32)}

Curves = Mapping[int, Mapping[str, Sequence[float]]]


def error_curves(matching: bool) -> Curves:
    """Errors by degree and quantity, on the meshes, whose nodes match at the joint or not."""
    rows = {degree: [errors(n, degree, matching) for n in MESHES[degree]] for degree in MESHES}
    return {d: {name: [row[name] for row in found] for name in THEORY} for d, found in rows.items()}


def order(curve: Sequence[float]) -> float:
    """Order of convergence between the last two meshes, of which one has half the elements."""
    return math.log2(curve[-2] / curve[-1])


def order_rows(matching: Curves, other: Curves) -> Iterator[str]:
    """Rows of the table of orders."""
    for degree, quantities in matching.items():
        for name, curve in quantities.items():
            theory, orders = THEORY[name](degree), [order(curve), order(other[degree][name])]
            verdict = "" if min(orders) >= 0.9 * theory else " **missed**"
            measured = " | ".join(f"{one:.2f}" for one in orders)
            numbers = f"{theory} | {measured}{verdict} | {curve[0]:.1e} | {curve[-1]:.1e}"
            yield f"| {degree} | {name} | {numbers} |"


# ---- tables and pictures

FIGURES_HEAD = "| | known | found | difference | asked |\n|---|---|---|---|---|"
PUBLIC_HEAD = "| problem | known | here |\n|---|---|---|"
ORDERS_HEAD = (
    "| degree | error of | theory | nodes match | others | coarsest | finest |"
    "\n|---|---|---|---|---|---|---|"
)


def place_of(panel: Any, title: str, x: str, y: str) -> Any:
    panel.set_title(title, fontsize=12)
    panel.set_xlabel(x, fontsize=11)
    panel.set_ylabel(y, fontsize=11)
    panel.grid(alpha=0.3)
    return panel


def draw_curved(picture: Picture, cylinder: Profile, pair: Profile) -> None:
    """Pressure of Hertz, and pressure and shear of Cattaneo and Mindlin."""
    left, right = picture.subplots(1, 2)
    dots = {"linestyle": "none", "marker": "o", "markersize": 4}
    a, x = CGS1.half_width, np.linspace(0.0, 1.3, 500)
    place_of(left, "Hertz, NAFEMS CGS-1", "x / a", "pressure (MPa)")
    left.plot(x, 1e-6 * CGS1.pressure(x * a), "k-", label="exact")
    left.plot(cylinder.x / a, 1e-6 * cylinder.values["pressure"], color="C0", label="found", **dots)
    a, x = EQUAL.half_width, np.linspace(-1.3, 1.3, 1000)
    place_of(right, "Cattaneo-Mindlin, Q = 0.5 F P", "x / a", "traction (MPa)")
    bound = 0.3 * pair.values["pressure"]
    right.plot(x, 0.3e-6 * EQUAL.pressure(x * a), "k--", label="friction x pressure, exact")
    right.plot(pair.x / a, 1e-6 * bound, color="C7", label="friction x pressure, found", **dots)
    right.plot(x, 1e-6 * cattaneo_shear(x * a), "k-", label="shear, exact")
    right.plot(pair.x / a, 1e-6 * pair.values["shear"], color="C3", label="shear, found", **dots)
    right.set_ylim(0.0, 520.0)
    left.set_xlim(0.0, 1.3)
    right.set_xlim(-1.3, 1.3)
    for panel in (left, right):
        panel.legend(fontsize=10)


def draw_friction(picture: Picture, bar: Profile, pressed: Profile) -> None:
    """Slip of the rod and of the plate."""
    left, right = picture.subplots(1, 2)
    place_of(left, "Rod on a Coulomb bed", "x (m)", "slip (mm)")
    left.plot(bar.x, 1e3 * rod_slip(bar.x), "k-", label="exact, rod without height")
    some = slice(None, None, 20)
    left.plot(bar.x[some], 1e3 * bar.values["slip"][some], "C0o", markersize=4, label="found")
    place_of(right, "Plate on a rigid plane, SSNV128", "x (mm)", "displacement $u_x$ (0.01 mm)")
    x, slip = 1e3 * pressed.x, 1e5 * pressed.values["slip"]
    right.plot(x, slip, "C0-", label="found, degree 2")
    right.plot(1e3 * PLATE_X, 1e5 * PLATE_QUAD8, "k+", markersize=11, label="Code_Aster, QUAD8")
    right.plot(1e3 * PLATE_X, 1e5 * PLATE_MEAN, "kx", markersize=8, label="mean of several codes")
    for panel in (left, right):
        panel.legend(fontsize=10)


def draw_orders(picture: Picture, curves: Curves) -> None:
    """Errors against the size of the elements, a panel per degree."""
    for panel, (degree, quantities) in zip(picture.subplots(1, 2), curves.items(), strict=True):
        place_of(panel, f"degree {degree}", "elements along a block", "relative error")
        meshes = np.array(MESHES[degree], dtype=float)
        for colour, (name, curve) in enumerate(quantities.items()):
            label = f"{name}: order {order(curve):.2f}, theory {THEORY[name](degree)}"
            panel.loglog(meshes, curve, f"C{colour}o-", markersize=5, label=label)
            slope = curve[-1] * (meshes / meshes[-1]) ** -THEORY[name](degree)
            panel.loglog(meshes, slope, f"C{colour}:")
        panel.loglog([], [], "k:", label="slope of theory")
        panel.set_xticks(meshes, [f"{n:.0f}" for n in meshes], minor=False)
        panel.minorticks_off()
        panel.legend(fontsize=9.5, loc="upper center", bbox_to_anchor=(0.5, -0.16))


def save(folder: Path, name: str, draw: Any, *what: Any, height: float = 4.4) -> None:
    picture = Picture(figsize=(10.0, height))
    draw(picture, *what)
    picture.tight_layout()
    folder.mkdir(parents=True, exist_ok=True)
    picture.savefig(folder / f"verification_{name}.png", dpi=130)


def main() -> int:
    """Print the tables and draw the pictures; exit code 1 if a figure asked for is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="draw there")
    folder = parser.parse_args().pictures
    cylinder, pair, bar, pressed = hertz(), cattaneo(), rod(), plate()
    curves, others = error_curves(matching=True), error_curves(matching=False)
    tables = {
        "Contact patch test": patch_figures(),
        "Hertz": hertz_figures(cylinder, 20),
        "Cattaneo-Mindlin": cattaneo_figures(pair, 20),
        "Plate on a rigid plane": plate_figures(pressed),
        "Rod on a Coulomb bed": rod_figures(bar),
        "Block pushed up an incline": incline(),
    }
    for title, figures in tables.items():
        print(f"\n## {title}\n\n{FIGURES_HEAD}", *(one.row() for one in figures), sep="\n")
    rows = list(order_rows(curves, others))
    print(f"\n## Orders of convergence\n\n{ORDERS_HEAD}", *rows, sep="\n")
    public = list(public_rows())
    print(f"\n## Public examples\n\n{PUBLIC_HEAD}", *public, sep="\n")
    if folder:
        save(folder, "curved", draw_curved, cylinder, pair)
        save(folder, "friction", draw_friction, bar, pressed)
        save(folder, "orders", draw_orders, curves, height=5.6)
    missed = [one for figures in tables.values() for one in figures if not one.passed]
    return int(bool(missed) or any("missed" in row for row in [*rows, *public]))


if __name__ == "__main__":
    raise SystemExit(main())
