"""What is in a scene in space, and what is probably meant otherwise, in lines for people."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from fenics_contact.console import law_text, movement_text, tie_text
from fenics_contact.discretization.warnings import unusual_values
from fenics_contact.geometry.mesh import Array
from fenics_contact.results.bounds import counted
from fenics_contact.results.values import NAMED
from fenics_contact.scene.rules import listed
from fenics_contact.scene.units import PER_METRE
from fenics_contact.spatial.scene import BlockScene
from fenics_contact.spatial.structure import Structure


def description(scene: BlockScene, structure: Structure) -> str:
    """Blocks, contacts, ties, floors and sums of loads, in lines."""
    units = scene.units

    def resultant(force: Array) -> str:
        return units.forces(structure.told(force.sum(axis=0)).tolist())

    moving = [block for block in structure.blocks if not block.fixed]
    fixed = len(structure.blocks) - len(moving)
    volume = sum(block.volume for block in moving)
    mass = sum(block.volume * scene.material(block).density for block in moving)
    lines = [
        scene.title or "(no title)",
        *([f"file {scene.read}"] if scene.read else []),
        f"{counted(len(moving), 'block')} and {fixed} of ground, volume {volume:.6g} m3, mass"
        f" {units.mass(mass)}",
    ]
    groups = Counter(block.group for block in scene.blocks)
    if len(groups) > 1:
        lines += [f"group {name}: {counted(n, 'block')}" for name, n in groups.items()]
    for key, law in scene.laws().items():
        kind, _, name = key.partition(".")
        areas = structure.areas_of(key)
        found = f"{counted(len(areas), 'contact')}, area {sum(areas):.6g} m2"
        text = f"{law_text(law, units)}, {found}" if law.acts else "off: carries nothing"
        lines.append(f"{kind[:-1]} {name}: {text}")
    force = f"N {PER_METRE}" if scene.dimension == 2 else "N"
    lines += [f"tie {name}: {tie_text(tie, units, force)}" for name, tie in scene.ties.items()]
    for name, floor in scene.floors.items():
        more = ", with its mass" if floor.mass else ""
        at = f"{floor.axis} = {units.length(floor.height or 0.0)}"
        lines.append(f"floor {name}: {units.text(floor.force, 'N/m2')} at {at}{more}")
    for name, movement in scene.dead.movement.items():
        lines.append(f"{name} {movement_text(movement, units)}")
    for key, one in structure.acting.items():
        if one.on:
            lines.append(f"{key}: on {one.on}, resultant {resultant(one.force)}")
    for name, load in (("dead", structure.dead), ("live", structure.live)):
        lines.append(f"{name} load: resultant {resultant(load[:, :3])}")
    return "\n".join(lines)


def warnings_on(scene: BlockScene, structure: Structure) -> Iterator[str]:
    """What is legal and probably meant otherwise."""
    yield from structure.warnings
    materials = {f"materials.{name}": material for name, material in scene.materials.items()}
    yield from unusual_values({**materials, **scene.laws()})
    light = [b for b in structure.blocks if not (b.fixed or scene.material(b).density)]
    if light:
        names = listed(block.name for block in light[:NAMED])
        more = ", ..." if len(light) > NAMED else ""
        what = "have no weight: their material has no density"
        yield f"{counted(len(light), 'block')} {what} ({names}{more})"
    used = {law.key for law in structure.laws}
    for key, law in scene.laws().items():
        if law.acts and key not in {*used, "joints.default"}:
            yield f"{key} is the law of no contact"
    if not np.any(structure.live):
        yield "loads.live pushes nothing"
