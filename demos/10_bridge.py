"""A bridge of one segmental arch under an axle: it is weakest near the quarter of the span.

The load acts on 0.3 m of the road, at three places; each is a group of its own.
"""

from pathlib import Path

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, limit_load
from fenics_contact.builders import bridge

FOLDER = Path(__file__).parent / "output" / "bridge"
SPAN, WIDTH, AXLE = 6.0, 0.3, 1.0e4  # m, m, N per metre of the bridge's width
drawing = bridge(SPAN, rise=1.5, ring=0.4)
road = max(corners[:, 1].max() for corners in drawing.blocks)
places = {"eighth": 0.125 * SPAN, "quarter": 0.25 * SPAN, "crown": 0.5 * SPAN}
for name, x in places.items():
    drawing = drawing.with_group(name, ((x - 0.5 * WIDTH, road), (x + 0.5 * WIDTH, road)))
mesh = BlockMesh.from_model(drawing.mesh(size=0.2))
law = JointLaw("coulomb", friction=0.7)

found = {}
for name in places:
    scene = Scene(
        mesh=mesh,
        materials={"default": Material(young=5e9, poisson=0.2, density=2000.0)},
        dead=Load(body=(0.0, -9.81)),
        live=Load(traction={name: (0.0, -AXLE / WIDTH)}),
        joints={"default": law},
        foundations={"base": law},
        title=f"Bridge, axle at the {name}",
    )
    result = limit_load(scene)
    result.write(FOLDER / name)
    if result.status != "limit" or result.load_factor > result.bounds.upper:
        raise SystemExit(f"{result.status} {result.load_factor}, should be {result.bounds}")
    found[name] = result.load_factor
    print(f"axle at the {name}: {found[name] * AXLE / 1e3:.1f} kN per metre of width")
if min(found, key=found.__getitem__) != "quarter":
    raise SystemExit(f"weakest at the quarter, not {found}")
print(f"pictures: {FOLDER}/*/collapse.png")
