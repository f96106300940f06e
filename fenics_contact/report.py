"""What is in a scene, in words: blocks, joints, loads, and what will be skipped."""

from __future__ import annotations

import numpy as np

from fenics_contact.analysis.plan import make_plan
from fenics_contact.discretization.joints import GROUND
from fenics_contact.scene import JointLaw
from fenics_contact.discretization.discretization import Structure


def describe(structure: Structure) -> str:
    """Describe a structure.

    Collective, because some counts are sums over ranks.

    Args:
        structure: A discretised scene.

    Returns:
        Several lines.
    """
    scene, bodies = structure.scene, structure.bodies
    cells = scene.mesh.domain.topology.index_map(2).size_global
    floating = int(bodies.floating.sum())
    lines = [
        scene.title or "(no title)",
        f"blocks: {scene.mesh.body_count} ({floating} floating,"
        f" {scene.mesh.body_count - floating} held by supports), {cells} cells,"
        f" {structure.problem.dead.getSize()} displacements, area {structure.bodies_area():.6g} m2",
        *_joint_lines(structure),
    ]
    for name, kind in scene.supports.items():
        length = structure.boundary.length[structure.boundary.in_group(name)].sum()
        lines.append(f"support {name}: {kind}, length {length:.6g} m")
    for name, resultant in (("dead", bodies.dead), ("live", bodies.live)):
        x, y = resultant[:, :2].sum(axis=0) + 0.0
        lines.append(f"{name} load: resultant ({x:.6g}, {y:.6g}) N per metre of thickness")
    lines += [f"skipped: {item}" for item in make_plan(scene).skipped]
    return "\n".join(lines)


def _joint_lines(structure: Structure) -> list[str]:
    joints = structure.joints
    lines = []
    for number, (name, law) in enumerate(zip(joints.names, joints.laws, strict=True)):
        mine = joints.law == number
        kind = "foundation" if np.any(joints.bodies[mine, 0] == GROUND) else "joint"
        lines.append(
            f"{kind} {name}: {_law_text(law)}, {int(mine.sum())} points,"
            f" length {joints.length[mine].sum():.6g} m"
        )
    return lines


def _law_text(law: JointLaw) -> str:
    if law.law == "coulomb":
        return f"Coulomb friction {law.friction:g}"
    if law.law == "tresca":
        return f"shear strength {law.bound:g} Pa"
    return "frictionless"
