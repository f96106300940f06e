"""What is in a scene of rigid blocks, in lines for people."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np
from numpy.typing import ArrayLike

from fenics_contact.console import scene_lines
from fenics_contact.geometry.mesh import Array
from fenics_contact.results.bounds import counted
from fenics_contact.spatial.scene import BlockScene
from fenics_contact.spatial.structure import Structure
from fenics_contact.spatial.ties import GROUND

#: Parts that are told to carry a floor, the most loaded ones.
SHOWN = 8


def description(scene: BlockScene, structure: Structure) -> str:
    """Blocks, contacts, ties, floors and sums of loads, in lines."""
    units = scene.units

    def resultant(force: Array) -> list[float]:
        return structure.told(force.sum(axis=0)).tolist()

    def reach(places: ArrayLike) -> str:
        """Lowest and highest coordinates of places, m, shape (..., 3)."""
        every = np.reshape(places, (-1, 3))
        ends = structure.told(np.array([every.min(axis=0), every.max(axis=0)])).tolist()
        return " to ".join(dict.fromkeys(units.place(end, 6) for end in ends))

    def carried(floor: str) -> str:
        """What parts of the structure carry of a floor."""
        one = structure.acting[f"floors.{floor}"]
        parts: Counter[str] = Counter()
        for number, force in zip(one.block, one.force, strict=True):
            parts[re.sub(r"(_\d+){1,2}$", "", structure.blocks[number].name)] -= force[2]
        known = [f"{units.force(force)} on {name}" for name, force in parts.most_common(SHOWN)]
        return ", " + ", ".join([*known, "..."] if len(parts) > SHOWN else known)

    moving = [block for block in structure.blocks if not block.fixed]
    volume = sum(block.volume for block in moving)
    mass = sum(block.volume * scene.material(block).density for block in moving)
    groups = Counter(block.group for block in scene.blocks)
    blocks = [
        *([f"file {scene.read}"] if scene.read else []),
        f"{counted(len(moving), 'block')} and {len(structure.blocks) - len(moving)} of ground,"
        f" volume {units.bulk(volume, 'm3')}, mass {units.mass(mass)}",
        f"extent {reach([block.extent for block in moving])}",
    ]
    if len(groups) > 1:
        blocks += [f"group {name}: {counted(n, 'block')}" for name, n in groups.items()]
    areas = {key: structure.areas_of(key) for key in scene.laws()}
    touching = {
        key: f"{counted(len(some), 'contact')}, area {units.bulk(sum(some), 'm2')}"
        for key, some in areas.items()
    }
    at = {
        key: "" if one.sides else f" at {reach([one.place - one.around, one.place + one.around])}"
        for key, one in structure.acting.items()
    }
    on = {
        key: f"on {one.on}{at[key]}, resultant {units.forces(resultant(one.force))}"
        for key, one in structure.acting.items()
        if one.on
    }
    lies = {name: on.pop(f"floors.{name}") + carried(name) for name in scene.floors}
    loads = {"dead": structure.dead, "live": structure.live}
    resultants = {name: resultant(load[:, :3]) for name, load in loads.items()}
    more = [f"{key}: {text}" for key, text in on.items()]
    held: dict[str, list[str]] = {}
    for bar in structure.bars:
        names = [structure.blocks[k].name for k in bar.blocks if k != GROUND]
        held.setdefault(bar.key.partition("[")[0], []).extend(names)
    more += [f"{key} holds {', '.join(dict.fromkeys(names))}" for key, names in held.items()]
    return "\n".join(scene_lines(scene, units, blocks, touching, lies, more, resultants))
