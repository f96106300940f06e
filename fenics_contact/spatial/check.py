"""What is in a scene of rigid blocks, in lines for people."""

from __future__ import annotations

from collections import Counter

from fenics_contact.console import scene_lines
from fenics_contact.geometry.mesh import Array
from fenics_contact.results.bounds import counted
from fenics_contact.spatial.scene import BlockScene
from fenics_contact.spatial.structure import Structure
from fenics_contact.spatial.ties import GROUND


def description(scene: BlockScene, structure: Structure) -> str:
    """Blocks, contacts, ties, floors and sums of loads, in lines."""
    units = scene.units

    def resultant(force: Array) -> list[float]:
        return structure.told(force.sum(axis=0)).tolist()

    moving = [block for block in structure.blocks if not block.fixed]
    volume = sum(block.volume for block in moving)
    mass = sum(block.volume * scene.material(block).density for block in moving)
    groups = Counter(block.group for block in scene.blocks)
    blocks = [
        *([f"file {scene.read}"] if scene.read else []),
        f"{counted(len(moving), 'block')} and {len(structure.blocks) - len(moving)} of ground,"
        f" volume {volume:.6g} m3, mass {units.mass(mass)}",
    ]
    if len(groups) > 1:
        blocks += [f"group {name}: {counted(n, 'block')}" for name, n in groups.items()]
    areas = {key: structure.areas_of(key) for key in scene.laws()}
    touching = {
        key: f"{counted(len(some), 'contact')}, area {sum(some):.6g} m2"
        for key, some in areas.items()
    }
    on = {
        key: f"on {one.on}, resultant {units.forces(resultant(one.force))}"
        for key, one in structure.acting.items()
        if one.on
    }
    lies = {name: on.pop(f"floors.{name}") for name in scene.floors}
    loads = {"dead": structure.dead, "live": structure.live}
    resultants = {name: resultant(load[:, :3]) for name, load in loads.items()}
    more = [f"{key}: {text}" for key, text in on.items()]
    held: dict[str, list[str]] = {}
    for bar in structure.bars:
        names = [structure.blocks[k].name for k in bar.blocks if k != GROUND]
        held.setdefault(bar.key.partition("[")[0], []).extend(names)
    more += [f"{key} holds {', '.join(dict.fromkeys(names))}" for key, names in held.items()]
    return "\n".join(scene_lines(scene, units, blocks, touching, lies, more, resultants))
