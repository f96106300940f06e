"""A bridge of one segmental arch under an axle that crosses it: where is it weakest?

A sweep moves the axle, on one mesh, from an eighth of the span to the crown: the bridge is
symmetric. It is weakest with the axle near a quarter of the span.
"""

from dataclasses import replace
from pathlib import Path

from fenics_contact import BlockMesh, EdgeForce, JointLaw, Load, Material, Scene, limit_load, sweep
from fenics_contact.builders import bridge

FOLDER = Path(__file__).parent / "output" / "bridge"
SPAN, WIDTH, AXLE = 6.0, 0.3, 1.0e4  # m, m, N per metre of the bridge's width


def under(x: float) -> Load:
    """The axle at x, on the highest edge there: the road."""
    return Load(force={"axle": EdgeForce((0.0, -AXLE), x=x, width=WIDTH)})


law = JointLaw("coulomb", friction=0.7)
scene = Scene(
    mesh=BlockMesh.from_model(bridge(SPAN, rise=1.5, ring=0.4).mesh(size=0.2)),
    materials={"default": Material(young=5e9, poisson=0.2, density=2000.0)},
    dead=Load(body=(0.0, -9.81)),
    live=under(0.5 * SPAN),
    joints={"default": law},
    foundations={"base": law},
    title="Bridge under an axle",
)
found = sweep(scene, {"loads.live.force.axle.x": f"{SPAN / 8}:{SPAN / 2}:6"})
for point in found:
    x = point.values["loads.live.force.axle.x"]
    print(f"axle at {x:.2f} m: {point.load_factor * AXLE / 1e3:.1f} kN per metre of width")
FOLDER.mkdir(parents=True, exist_ok=True)
found.plot().figure.savefig(FOLDER / "places.png", dpi=150)

if any(point.status != "limit" for point in found):
    raise SystemExit("all places should have a limit load")
weakest = found.worst.values["loads.live.force.axle.x"]
if abs(weakest - 0.25 * SPAN) > 0.1 * SPAN:
    raise SystemExit(f"weakest at {weakest} m, should be near {0.25 * SPAN} m")
limit_load(replace(scene, live=under(weakest))).write(FOLDER)
print(f"weakest with the axle at {weakest} m; pictures: {FOLDER}/places.png, collapse.png")
