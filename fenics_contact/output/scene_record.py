"""The scene of a result as plain tables, with the units of its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from fenics_contact.discretization.joints import GROUND, Joints
from fenics_contact.discretization.layout import Layout
from fenics_contact.scene.scene import function_name

#: Units by key; keys without one have numbers without unit, or words.
UNITS: Mapping[str, str] = {
    "young": "Pa",
    "density": "kg/m3",
    "bound": "Pa",
    "cohesion": "Pa",
    "gap": "m",
    "dilatancy": "degrees",
    "tensile_strength": "Pa",
    "compressive_strength": "Pa",
    "body": "m/s2",
    "traction": "Pa",
    "tilt": "degrees",
    "force": "N per metre of thickness",
    "yield": "N per metre of thickness, N with a spacing",
    "stiffness": "N/m per metre of thickness, N/m with a spacing",
    "prestress": "N per metre of thickness, N with a spacing",
    "spacing": "m",
    "x": "m",
    "y": "m",
    "level": "m",
    "unit_weight": "N/m3",
    "surcharge": "Pa",
    "wall_friction": "degrees",
    "displacement": "m",
    "rotation": "degrees",
    "length": "m",
    "width": "m",
    "height": "m",
    "area": "m2",
    "resultants": "N per metre of thickness",
}


def scene_record(layout: Layout) -> dict[str, Any]:
    """What was solved, as in a scene file, and what the mesh makes of it; the same on all ranks."""
    scene = layout.scene
    bodies = layout.bodies
    width, height = np.ptp(layout.boundary.points.reshape(-1, 2), axis=0).tolist()
    tables = {
        name: {key: asdict(value) for key, value in getattr(scene, name).items()}
        for name in ("materials", "joints", "foundations")
    }
    loads = {"dead": (scene.dead, bodies.dead), "live": (scene.live, bodies.live)}
    return {
        "plane": scene.plane,
        "thickness": scene.thickness,
        "degree": scene.degree,
        "size": {"width": width, "height": height, "area": layout.bodies_area()},
        "stress": function_name(scene.stress) or None,
        **tables,
        "supports": dict(scene.supports),
        "loads": {
            name: asdict(replace(load, form=None)) | {"form": function_name(load.form) or None}
            for name, (load, _) in loads.items()
        },
        "resultants": {
            n: (force[:, :2].sum(axis=0) + 0.0).tolist() for n, (_, force) in loads.items()
        },
        "ties": scene.tables()["ties"],
        "floors": scene.tables()["floors"],
        "seismic": scene.seismic and asdict(scene.seismic),
        "contacts": _contacts(layout.joints.without_ties()),
        "solve": asdict(scene.solve),
        "output": asdict(scene.output),
        "units": dict(UNITS),
    }


def _contacts(joints: Joints) -> list[dict[str, Any]]:
    """Where the joint laws act: joint points and length, by group."""
    rows = []
    for number, name in enumerate(joints.names):
        mine = joints.law == number
        ground = bool(np.any(joints.bodies[mine, 0] == GROUND))
        rows.append(
            {
                "group": name,
                "kind": "foundation" if ground else "joint",
                "points": int(mine.sum()),
                "length": float(joints.length[mine].sum()),
            }
        )
    return rows
