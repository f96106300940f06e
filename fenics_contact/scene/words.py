"""What a scene gives, in words: laws, materials, ties, floors and movements, by their tables.

`check` has the tables of a scene, and the report those of result.json: both tell them alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from fenics_contact.scene.units import PER_METRE, Units

Given = Mapping[str, Any]


def law_text(one: Given, units: Units) -> str:
    """Friction, strengths and gaps of a joint."""
    if one.get("glued"):
        return "glued: the blocks on both sides are one"
    if one.get("off"):
        return "off: carries nothing"
    parts = ["no friction"] if one["law"] == "frictionless" else []
    if one["law"] == "coulomb":
        friction = one["friction"] or 0.0
        angle = math.degrees(math.atan(friction))
        parts.append(f"Coulomb friction {friction:g} ({angle:.3g} degrees)")
    for key in ("bound", "cohesion", "tensile_strength", "compressive_strength"):
        if one.get(key):
            name = "shear strength" if key == "bound" else key.replace("_", " ")
            parts.append(f"{name} {units.stress(one[key])}")
    if not one.get("tensile_strength"):
        parts.append("no tensile strength")
    if one.get("opened") == "lost" and (one.get("cohesion") or one.get("tensile_strength")):
        parts.append("strength lost where it opens")
    if one.get("dilatancy"):
        parts.append(f"dilatancy {one['dilatancy']:g} degrees")
    if one.get("gap"):
        parts.append(f"gaps up to {units.length(one['gap'])}")
    return ", ".join(parts)


def material_text(one: Given, gravity: float, units: Units) -> str:
    """Density and weight, stiffness, strength."""
    weight = f" ({units.text(one['density'] * gravity, 'N/m3', 4)})" if gravity else ""
    parts = [f"{one['density']:g} kg/m3{weight}"]
    if "poisson" in one:  # blocks that deform
        parts.append(f"Young's modulus {units.stress(one['young'])}")
        parts.append(f"Poisson's ratio {one['poisson']:g}")
    if one.get("compressive_strength"):
        parts.append(f"compressive strength {units.stress(one['compressive_strength'])}")
    return ", ".join(parts)


def tie_ends(one: Given, units: Units) -> str:
    """Where a tie goes from and to."""
    ends = one["from"], one.get("ground") or one["to"]
    first, last = (end if isinstance(end, str) else units.place(end, 6) for end in ends)
    return f"from {first} to {'the ground at ' if one.get('ground') else ''}{last}"


def tie_text(one: Given, units: Units) -> str:
    """Tension at which a tie yields, stiffness, prestress and spacing."""
    unit = "N" if one.get("spacing") else f"N {PER_METRE}"

    def force(value: float, per: str = "") -> str:
        if units.thickness and not one.get("spacing"):
            return f"{units.force(value)}{per}"
        return units.text(value, unit.replace("N", f"N{per}"))

    parts = [f"yields at {force(one['yield'])}"]
    if one.get("stiffness"):
        parts.append(f"stiffness {force(one['stiffness'], '/m')}")
    if one.get("prestress"):
        parts.append(f"prestress {force(one['prestress'])}")
    if one.get("plate"):
        parts.append(f"plates of {units.length(one['plate'])}")
    if one.get("spacing"):
        parts.append(f"one every {units.length(one['spacing'])}")
    return ", ".join(parts)


def floor_text(one: Given, units: Units) -> str:
    """Weight of a floor, where it lies, and whether the live load takes it along."""
    weight = units.text(one["force"], "N/m2")
    mass = f"{'with' if one.get('mass') else 'without'} its mass"
    if one.get("at"):
        where = f"on {one['at']}"
    else:
        axis = "z" if "z" in one else "y"
        where = f"at {axis} = {units.length(one[axis])}"
        for name in ("x", "y") if axis == "z" else ("x",):
            if one.get(name):
                where += ", {} from {} to {}".format(name, *map(units.length, one[name]))
    if units.thickness and "z" not in one and (one.get("at") or one.get("x")):
        weight = f"{units.text(one['force'] * units.thickness, 'N/m')} ({weight})"
    thrust = np.atleast_1d(one.get("thrust") or []).tolist()
    where += f", from wall to wall along {one['span']}" if one.get("span") else ""
    pushes = ", thrust " * bool(thrust) + " and ".join(units.text(t, "N/m") for t in thrust)
    return f"{weight} {where}, {mass}{pushes}"


def movement_text(one: Given, units: Units) -> str:
    """How far a support or ground moves and turns."""
    turn = one["rotation"]
    by = f"{turn:g}" if isinstance(turn, float) else f"({', '.join(f'{a:g}' for a in turn)})"
    return f"moves by {units.place(one['displacement'], 6)}, turns by {by} degrees"
