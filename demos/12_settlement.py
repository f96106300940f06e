"""An arch whose springings spread: it stands on three hinges, with the least thrust of statics.

Of all lines of thrust in the ring, abutments that give way choose the flattest force, abutments
that close in the steepest. By statics the least thrust H passes the top of the crown and the
intrados at a joint k: H = M_k / (height of the crown above k), with the moment M_k about k of the
weights between both; the largest of these is in equilibrium everywhere.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from fenics_contact import BlockMesh, JointLaw, Load, Material, Movement, Scene, equilibrium
from fenics_contact.drawing import Drawing
from fenics_contact.output.plotting import draw_forces, draw_mode
from fenics_contact.output.view import NO_LOAD, view_of

FOLDER = Path(__file__).parent / "output" / "settlement"
VOUSSOIRS, RADIUS, RING, EMBRACE, DENSITY = 14, 3.0, 0.45, 140.0, 2000.0  # 1, m, m, degrees, kg/m3
half = np.radians(0.5 * EMBRACE)
angles = 0.5 * np.pi + np.linspace(half, -half, VOUSSOIRS + 1)
rays = np.column_stack([np.cos(angles), np.sin(angles)])
inner, outer = (RADIUS - 0.5 * RING) * rays, (RADIUS + 0.5 * RING) * rays
blocks = np.stack([inner[:-1], inner[1:], outer[1:], outer[:-1]], axis=1)
drawing = Drawing(tuple(blocks), ("ring",) * VOUSSOIRS, {})
drawing = drawing.with_group("left", (inner[0], outer[0]))
drawing = drawing.with_group("right", (inner[-1], outer[-1]))
mesh, law = BlockMesh.from_model(drawing.mesh(size=0.15)), JointLaw("coulomb", friction=0.8)


def standing(spread: float):
    """The arch under its weight with the right springing moved outwards, and its thrust."""
    scene = Scene(
        mesh=mesh,
        materials={"default": Material(young=5e9, poisson=0.2, density=DENSITY)},
        dead=Load((0.0, -9.81), movement={"right": Movement((spread, 0.0))}),
        live=Load((9.81, 0.0)),  # not acting: the load factor is 0
        joints={"default": law},
        foundations={"left": law, "right": law},
    )
    found = equilibrium(scene, 0.0)
    if found.status != "equilibrium":
        raise SystemExit(f"{found.status} {found.reason}, should be in equilibrium")
    forces = found.joints["force"][found.joints["group"] == "left"]
    return found, forces[:, 0].sum()


def least_thrust() -> float:
    """By statics of the left half, hinged at the top of the crown."""
    half, crown = blocks[: VOUSSOIRS // 2], outer[VOUSSOIRS // 2]
    x, y = half.transpose(2, 0, 1)
    cross = x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y
    area = 0.5 * cross.sum(axis=1)
    centre = ((x + np.roll(x, -1, axis=1)) * cross).sum(axis=1) / (6.0 * area)
    weight = 9.81 * DENSITY * np.abs(area)
    thrusts = [
        np.sum(weight[k:] * (centre[k:] - inner[k, 0])) / (crown[1] - inner[k, 1])
        for k in range(len(half))
    ]
    return max(thrusts)


spreads = np.sort(np.append(np.linspace(-2e-3, 2e-3, 21), [-2e-2, -1e-2, 1e-2]))
thrusts = [standing(spread)[1] for spread in spreads]
least = least_thrust()
if abs(thrusts[-1] - least) > 1e-7 * least:
    raise SystemExit(f"thrust {thrusts[-1]}, should be {least}")
if abs(thrusts[0] - thrusts[1]) > 1e-7 * thrusts[0]:
    raise SystemExit(f"springings that close in further: {thrusts[0]}, not {thrusts[1]}")
print(f"springings that spread: thrust {thrusts[-1] / 1e3:.3f} kN/m, the least of statics")
print(f"springings that close in: {thrusts[0] / 1e3:.3f} kN/m; as built: {thrusts[12] / 1e3:.3f}")

found, _ = standing(1e-2)
if mesh.comm.rank == 0:
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    left, right, below = (figure.add_subplot(2, 2, place) for place in (1, 2, (3, 4)))
view = view_of(found.layout, found.state.displacement, found.joint_values)
view = replace(view, live=NO_LOAD)
if mesh.comm.rank == 0:
    draw_mode(left, view).set_title("springings spread (grey outline: as drawn)")
    draw_forces(right, view).set_title("joint forces")
    below.plot(1e3 * spreads, np.array(thrusts) / 1e3, "o-")
    below.axhline(least / 1e3, color="0.5", linestyle="--", label="least thrust by statics")
    below.set(xlabel="spread of the springings, mm", ylabel="thrust, kN/m", xlim=(-2.1, 2.1))
    below.legend()
    FOLDER.mkdir(parents=True, exist_ok=True)
    figure.savefig(FOLDER / "spread.png", dpi=120)
    print(f"pictures: {FOLDER}/spread.png")
