"""Stresses in 1 000 blocks of ten shapes: processor time, s, and memory, GB.

python3 benchmarks/stresses.py

A dome of 10 rings of 100 blocks under its weight: 1.1e5 points, 2.6e5 tetrahedra of degree 2, in
16.6 s and 0.65 GB; a wall of bricks of ten lengths 11.9 s and 0.27 GB.
"""

from __future__ import annotations

import resource
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fenics_contact.elastic.stresses import sorted_blocks, stressed_blocks
from fenics_contact.scene.scene import JointLaw
from fenics_contact.spatial import Load, Material, Scene, builders, standing

blocks = builders.dome(radius=5.0, thickness=0.5, meridians=100, rings=10)
scene = Scene(
    blocks=tuple(blocks),
    materials={"default": Material(young=1e10, density=2000.0)},
    joints={"default": JointLaw(friction=0.7)},
    dead=Load(body=(0.0, 0.0, -9.81)),
)
result = standing(scene)
start = time.process_time()
shapes = sorted_blocks(scene, result.structure)
found = stressed_blocks(scene, result.structure, result.ends["positive"], shapes)
seconds = time.process_time() - start
memory = 1e-6 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
points = sum(len(one.points) for one in found.blocks)
print(f"{len(found.blocks)} blocks of {len(shapes)} shapes, {points} points: {seconds:.1f} s")
print(f"{memory:.2f} GB; left out: {len(found.missed)}")
