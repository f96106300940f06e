"""Body forces with a profile over the height h above the foot of the structure.

The acceleration is c(h) b, with c in straight lines between some heights. Cells are cut there, so
that the forces are exact. The height is measured against the dead body force, or along y where
there is none; the foot is the lowest corner of all blocks. "triangular" is c = h / H, with the
height H of the centre of mass, so that the total is that of the uniform load:
F_i = F z_i m_i / sum(z_j m_j) of EN 1998-1:2004, (4.11), and of NTC 2018, (7.3.7). Floors with mass
are in it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from fenics_contact import compat
from fenics_contact.discretization import forms
from fenics_contact.discretization.cut_cells import rules, shape_functions
from fenics_contact.discretization.facets import Boundary
from fenics_contact.discretization.floors import floor_strips, upward
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.scene.scene import Load, Scene

#: Weight of a mass of 1 kg, N, by which the weight of a floor gives its mass.
GRAVITY = 9.81


@dataclass(frozen=True)
class Profile:
    """Factor c on a body force.

    Attributes:
        up: Unit vector along which heights are measured.
        levels: Heights up . x at which the slope of c changes, m.
        factors: c there; it is constant below the first and above the last.
    """

    up: Array
    levels: Array
    factors: Array

    def at(self, place: Array) -> Array:
        """C at heights up . x, m."""
        return np.interp(place, self.levels, self.factors)


def profile_of(scene: Scene, load: Load, boundary: Boundary, density: fem.Function) -> Profile:
    """The profile of a load. Collective."""
    up = upward(scene.dead.acceleration)
    height = boundary.points[:, :2] @ up
    foot = float(height.min())
    even = Profile(up, np.array([foot]), np.ones(1))
    if load.profile == "uniform":
        return even
    if isinstance(load.profile, str):
        ends = np.array([foot, float(height.max())])
        rising = Profile(up, ends, ends - foot)
        mass, moment = (_total(scene, boundary, density, one) for one in (even, rising))
        return Profile(up, ends, rising.factors * (mass / moment if moment > 0.0 else 1.0))
    heights, factors = np.transpose(load.profile)
    return Profile(up, foot + heights, factors)


def add_body_force(
    forces: fem.Function, load: Load, body_load: forms.BodyLoad, profile: Profile
) -> None:
    """Add the nodal forces of a body force with its profile, those at ghosts too."""
    if load.profile == "uniform":
        fem.assemble_vector(forces.x.array, body_load.form(load.acceleration))
        return
    space = forces.function_space
    density = _by_cell(body_load.density)
    for cell, place, weight, height in rules(space.mesh, profile.up, profile.levels):
        mass = density[cell, None] * weight * profile.at(height)
        share = (mass[:, None] @ shape_functions(space, place))[:, 0]
        nodes = compat.cell_dofs(space)[cell]
        np.add.at(forces.x.array.reshape(-1, 2), nodes, share[..., None] * load.acceleration)


def weights_of_floors(scene: Scene, boundary: Boundary) -> list[tuple[Indices, Array]]:
    """Facets and the forces on their nodes, of the weight of every floor.

    Forces have the shape (facets, nodes of a facet, 2), N per metre of thickness.

    Raises:
        InputError: If a floor lies nowhere.
    """
    up = upward(scene.dead.acceleration)
    return _on_floors(scene, boundary, scene.floors, Profile(up, np.zeros(1), np.ones(1)), -up)


def inertia_of_floors(
    scene: Scene, boundary: Boundary, profile: Profile, acceleration: tuple[float, float]
) -> list[tuple[Indices, Array]]:
    """The same of an acceleration, times a profile, of the floors that have mass."""
    floors = {name: floor for name, floor in scene.floors.items() if floor.mass}
    return _on_floors(scene, boundary, floors, profile, np.array(acceleration) / GRAVITY)


def _on_floors(
    scene: Scene, boundary: Boundary, floors: Iterable[str], profile: Profile, vector: Array
) -> list[tuple[Indices, Array]]:
    """Forces of the floors' weights times a profile and a vector."""
    found = []
    strips = floor_strips(scene, boundary)
    for name in floors:
        parts = strips[name].cut(boundary, profile.up, profile.levels)
        weight = scene.floors[name].force * boundary.normal[parts.facets] @ upward(scene.dead.body)
        force = parts.forces(boundary, lambda x: profile.at(x @ profile.up)[..., None] * vector)
        found.append((parts.facets, weight[:, None, None] * force))
    return found


def _total(scene: Scene, boundary: Boundary, density: fem.Function, profile: Profile) -> float:
    """Integral of a profile over all masses, kg per metre of thickness. Collective."""
    total = 0.0
    per_cell = _by_cell(density)
    for cell, _, weight, height in rules(scene.mesh.domain, profile.up, profile.levels):
        total += float(np.sum(per_cell[cell, None] * weight * profile.at(height)))
    floors = inertia_of_floors(scene, boundary, profile, (1.0, 0.0))
    return float(scene.comm.allreduce(total)) + sum(float(force.sum()) for _, force in floors)


def _by_cell(field: fem.Function) -> Array:
    """Values of a function that is constant in every cell of this rank."""
    return np.asarray(field.x.array[compat.cell_dofs(field.function_space)[:, 0]])
