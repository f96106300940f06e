"""A wall held by a tie leans on after its peak: the tie stretches, turns and yields.

The load factor follows from the balance of moments about the toe, at every angle by hand.
"""

from pathlib import Path

import numpy as np

from fenics_contact.spatial import (
    JointLaw,
    Load,
    Material,
    OutputOptions,
    Scene,
    SolveOptions,
    Tie,
    limit_load,
    prism,
)

FOLDER = Path(__file__).parent / "output" / "after_the_peak"
GRAVITY = 9.81  # m/s2
DENSITY = 1800.0  # kg/m3
THICK, HIGH = 0.5, 3.0  # m
AT, FAR = 2.7, 4.0  # height of the tie, its length, m
STIFF, YIELD = 1e5, 8e3  # N/m, N per metre

scene = Scene(
    dimension=2,
    title="Wall with a tie",
    blocks=(prism([(0, 0), (THICK, 0), (THICK, HIGH), (0, HIGH)], "wall"),),
    materials={"default": Material(density=DENSITY)},
    joints={"default": JointLaw(friction=0.8)},
    ties={"tie": Tie(from_=(0.0, AT), ground=(-FAR, AT), yield_=YIELD, stiffness=STIFF)},
    dead=Load(body=(0.0, -GRAVITY)),
    live=Load(body=(GRAVITY, 0.0)),
    solve=SolveOptions(beyond=True),
    output=OutputOptions(paraview=False),
)
result = limit_load(scene)
result.write(FOLDER)
print(result.summary())

way = result.collapse.beyond
weight = DENSITY * THICK * HIGH * GRAVITY
slender, radius = np.arctan2(THICK, HIGH), 0.5 * np.hypot(THICK, HIGH)
worst = 0.0
for point in way.fine.points:
    turn = point.poses.rotation[0]
    angle = np.arctan2(turn[0, 2], turn[0, 0])
    arm = turn @ [-THICK, 0.0, AT]  # of the tie, from the toe
    line = np.array([-FAR - THICK, 0.0, AT]) - arm
    length = np.linalg.norm(line)
    pull = np.clip(STIFF * (length - FAR), 0.0, YIELD) * line / length
    moment = weight * radius * np.sin(slender - angle) + arm[0] * pull[2] - arm[2] * pull[0]
    worst = max(
        worst, abs(point.load_factor - moment / (weight * radius * np.cos(slender - angle)))
    )
print(f"{len(way.fine.points)} points, at most {worst:.1e} off the balance of moments")
if not worst < 1e-6:
    raise SystemExit("the way after the peak should be that by hand")

print(f"pictures: {FOLDER}/beyond.png")
