"""Nodal forces of a load: body force, tractions, forces at places, earth pressure, floors.

Body forces, tractions and forms of the user are assembled from UFL forms, but body forces with a
profile. Forces at places, earth pressure and floors act on parts of facets.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from dolfinx import fem

from fenics_contact import compat
from fenics_contact.discretization import forms, profiles
from fenics_contact.discretization.contacts import facing_facets
from fenics_contact.discretization.facets import Boundary
from fenics_contact.discretization.forms import given_load
from fenics_contact.discretization.mortar import lagrange
from fenics_contact.discretization.profiles import Strips
from fenics_contact.errors import InputError, raised_together
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.scene.scene import EarthPressure, EdgeForce, Load, Scene

#: Facets look the same way if their normals differ by less than 60 degrees.
ALIKE = 0.5


def nodal_forces(
    scene: Scene, space: Any, boundary: Boundary, kind: str, body_load: forms.BodyLoad
) -> Array:
    """Nodal forces, this rank's part, of the "dead" or the "live" load.

    Raises:
        InputError: If a traction acts inside a block, a force or a floor where there is no edge,
            or a form is no load.
    """
    load: Load = getattr(scene, kind)
    forces = fem.Function(space)
    profile = profiles.profile_of(scene, load, boundary, body_load.density)
    profiles.add_body_force(forces, load, body_load, profile)
    for name in (*load.traction, *load.earth):
        if name in boundary.interior:
            boundary.role([name])  # raises: a traction acts on the outside of a block
    for name, traction in load.traction.items():
        facets = np.sort(boundary.local_facets[boundary.in_group(name)[boundary.local]])
        fem.assemble_vector(forces.x.array, forms.edge_load(space, facets, traction))
    if load.form is not None:
        key = f"loads.{kind}.form"
        form = given_load(scene.mesh, space, boundary, load.form, key)
        with raised_together(scene.comm):
            if form is not None:
                fem.assemble_vector(forces.x.array, form)
            if not np.all(np.isfinite(forces.x.array)):
                raise InputError(f"{key} gives forces that are not finite; it may divide by zero")
    compat.add_ghosts(forces.x)
    index_map = space.dofmap.index_map
    mine = forces.x.array[: 2 * index_map.size_local].copy().reshape(-1, 2)
    first, last = index_map.local_range
    on_facets = forces_on_facets(boundary, load, f"loads.{kind}")
    if kind == "dead":
        on_facets += profiles.weights_of_floors(scene, boundary)
    else:
        on_facets += profiles.inertia_of_floors(scene, boundary, profile, load.acceleration)
    for facets, force in on_facets:
        nodes = boundary.nodes[facets]
        here = (nodes >= first) & (nodes < last)
        np.add.at(mine, nodes[here] - first, force[here])
    return mine.ravel()


def forces_on_facets(
    boundary: Boundary, load: Load, key: str = "loads.live"
) -> list[tuple[Indices, Array]]:
    """Facets and the forces on their nodes, of each earth pressure and then each force at a place.

    Forces have the shape (facets, nodes of a facet, 2), N per metre of thickness.

    Raises:
        InputError: If a force is where there is no edge; `key` names the load.
    """
    found = []
    for name, earth in load.earth.items():
        strips = Strips.between(boundary, boundary.in_group(name), 1, (-np.inf, earth.level))
        found.append((strips, strips.forces(boundary, _earth_traction(boundary, strips, earth))))
    if load.force:
        free = np.ones(len(boundary.length), dtype=bool)
        free[facing_facets(boundary).facets] = False
        for name, force in load.force.items():
            found.append(_at_place(boundary, free, force, f"{key}.force.{name}"))
    return [(strips.facets, force) for strips, force in found]


def _earth_traction(boundary: Boundary, strips: Strips, earth: EarthPressure) -> Any:
    """Traction of earth pressure as a function of the position."""
    normal = boundary.normal[strips.facets]
    along = np.column_stack([-normal[:, 1], normal[:, 0]])
    down = np.where(along[:, 1:] > 0.0, -along, along)
    direction = down * math.tan(math.radians(earth.wall_friction)) - normal

    def traction(position: Array) -> Array:
        depth = earth.level - position[..., 1]
        pressure = earth.coefficient * (earth.surcharge + earth.unit_weight * depth)
        return pressure[..., None] * direction[:, None]

    return traction


def _at_place(boundary: Boundary, free: Flags, load: EdgeForce, key: str) -> tuple[Strips, Array]:
    """Where a force acts, and its forces on the nodes; along the line of the facet it meets."""
    facet, place = _place(boundary, free, load, key)
    ends = boundary.points[facet, :2]
    along = (ends[1] - ends[0]) / boundary.length[facet]
    if load.width == 0.0:
        s = np.array([(place - ends[0]) @ along / boundary.length[facet]])
        strips = Strips(np.array([facet]), s, s)
        return strips, lagrange(s, boundary.nodes.shape[1])[:, :, None] * load.force
    # The force is spread evenly over the projection on that line of what looks the same way.
    alike = free & (boundary.normal @ boundary.normal[facet] > ALIKE)
    off = np.abs((boundary.points[:, :2].mean(axis=1) - place) @ boundary.normal[facet])
    near = np.flatnonzero(alike & (off <= 0.5 * load.width))
    from_place = (boundary.points[near, :2] - place) @ along
    span = from_place[:, 1] - from_place[:, 0]
    at = (0.5 * load.width * np.array([[-1.0, 1.0]]) - from_place[:, :1]) / span[:, None]
    start, end = np.clip(np.sort(at, axis=1), 0.0, 1.0).T
    covered = float(np.sum((end - start) * np.abs(span)))
    if abs(covered - load.width) > 1e-6 * load.width:
        raise InputError(
            f"{key}: {covered:g} m of its width of {load.width:g} m lie on an edge at"
            f" ({place[0]:g}, {place[1]:g}); move it or make it narrower"
        )
    strips = Strips(near[end > start], start[end > start], end[end > start])
    per_length = np.array(load.force) / load.width
    share = (np.abs(span) / boundary.length[near])[end > start]
    return strips, strips.forces(boundary, lambda x: np.broadcast_to(per_length, x.shape)) * (
        share[:, None, None]
    )


def _place(boundary: Boundary, free: Flags, load: EdgeForce, key: str) -> tuple[int, Array]:
    """Facet that a force meets, and where."""
    first, second = boundary.points[:, :2].swapaxes(0, 1)
    along = second - first
    if load.y is None:
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (load.x - first[:, 0]) / along[:, 0]
        above = free & (boundary.normal[:, 1] > ALIKE) & (s >= -1e-9) & (s <= 1.0 + 1e-9)
        if not np.any(above):
            raise InputError(f"{key}: no edge looks up at x = {load.x:g}; give y as well")
        at = first[above] + s[above, None] * along[above]
        highest = int(np.argmax(at[:, 1]))
        return int(np.flatnonzero(above)[highest]), at[highest]
    place = np.array([load.x, load.y])
    at = boundary.nearest(place)
    distance = np.where(free, np.linalg.norm(at - place, axis=1), np.inf)
    facet = int(np.argmin(distance))
    if distance[facet] > boundary.length[facet]:
        raise InputError(
            f"{key}: no free edge at ({load.x:g}, {load.y:g}); the next is at"
            f" ({at[facet, 0]:g}, {at[facet, 1]:g})"
        )
    return facet, at[facet]
