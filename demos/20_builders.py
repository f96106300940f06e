"""Structures in space by builders: their load factors when they are pushed.

The push is the weight of every block times the load factor. Every builder draws its blocks from a
few lengths; the ground is among them. The wall turns about its foot, at half its thickness over the
height of its centroid. Pictures show how each structure collapses.
"""

from pathlib import Path

import numpy as np

from fenics_contact.spatial import JointLaw, Load, Material, Scene, builders
from fenics_contact.spatial.limit import limit_load

FOLDER = Path(__file__).parent / "output" / "builders"
GRAVITY = 9.81  # m/s2
ALONG, ACROSS = (GRAVITY, 0.0, 0.0), (0.0, GRAVITY, 0.0)
THICKNESS = 0.2  # m
WINDOW = [1.2, 2.0, 0.8, 1.6]  # from, to, bottom, top, m
DOOR = [0.8, 1.6, 0.0, 1.6]

wall = builders.wall(length=3.2, height=2.4, thickness=THICKNESS, openings=[WINDOW])
house = builders.house(
    length=3.2,
    width=2.4,
    height=2.4,
    thickness=THICKNESS,
    openings={"south": [WINDOW], "east": [DOOR]},
    floors=[2.2],
    floor_strips=4,
)
corner = builders.corner(length_x=2.4, length_y=2.0, height=2.0, thickness=THICKNESS)
tower = builders.tower(width=3.0, height=8.0, thickness=0.5, top_width=2.0, brick=(1.0, 0.5))
barrel = builders.barrel_vault(
    span=3.0, rise=1.2, thickness=0.3, length=2.0, voussoirs=15, strips=4
)
cross = builders.cross_vault(span=3.0, thickness=0.3, length=4.0, voussoirs=12)
dome = builders.dome(radius=3.0, thickness=0.4, meridians=12, rings=8, oculus=0.4)
bridge = builders.bridge(span=6.0, rise=1.5, thickness=0.4, width=2.4, height=2.3, voussoirs=15)

moving = [block for block in wall if not block.fixed]
volumes = [block.volume for block in moving]
height = np.average([block.centroid[2] for block in moving], weights=volumes)

for name, blocks, push in (
    ("wall", wall, ACROSS),
    ("corner", corner, ALONG),
    ("house", house, ALONG),
    ("tower", tower, ALONG),
    ("barrel_vault", barrel, ALONG),
    ("cross_vault", cross, ALONG),
    ("dome", dome, ALONG),
    ("bridge", bridge, ACROSS),
):
    scene = Scene(
        blocks=blocks,
        materials={"default": Material(density=2000.0)},
        joints={"default": JointLaw(friction=0.6)},
        dead=Load(body=(0.0, 0.0, -GRAVITY)),
        live=Load(body=push),
        title=name.replace("_", " "),
    )
    result = limit_load(scene)
    result.write(FOLDER / name)
    print(f"{name}: {len(blocks)} blocks, {result.status}, load factor {result.load_factor:.4f}")
    by_hand = 0.5 * THICKNESS / height
    if name == "wall" and not abs(result.load_factor - by_hand) < 1e-3 * by_hand:
        raise SystemExit(f"wall: should be {by_hand}")

print(f"pictures: {FOLDER}/*/collapse.png")
