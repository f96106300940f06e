"""Nodal forces of a load: body force, tractions, forces at places, earth pressure, floors.

Body forces, tractions and forms of the user are assembled from UFL forms, but body forces with a
profile over the height, of blocks and of floors with mass. Forces at places, earth pressure and
floors act on parts of facets.

The acceleration is c(h) b, with c in straight lines between some heights. Cells are cut there, so
that the forces are exact. The height is measured against the dead body force, or along y where
there is none; the foot is the least height of all blocks. "triangular" is c = h / H, with the
height H of the centre of mass, so that the total is that of the uniform load:
F_i = F z_i m_i / sum(z_j m_j) of EN 1998-1:2004, (4.11), and of NTC 2018, (7.3.7). Floors with mass
are in it.

On a part of a facet, with the Lagrange functions N_k of a facet of length L,

    f_k = L int_a^b N_k(s) t(x(s)) ds,   0 <= a < b <= 1,

by Gauss' rule with three points, exact for tractions t that are linear in x.

Between two heights, of its corners or of cuts, a convex cell is a strip with two straight sides.
Gauss's rule along the height and across takes a strip: exactly in triangles, and to rounding in
quadrilaterals, whose shape functions are no polynomials of the place, but their resultant and
moment exactly. Quadrilaterals without cuts are integrated as they are.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from fenics_contact import compat
from fenics_contact.discretization import forms
from fenics_contact.discretization.contacts import facing_facets
from fenics_contact.discretization.facets import (
    CLOSED,
    Boundary,
    cell_sides,
    cross,
    lagrange,
    reference_places,
    shape_functions,
)
from fenics_contact.discretization.forms import given_load
from fenics_contact.errors import InputError, Vector, raised_together
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.lazily import fem
from fenics_contact.scene.scene import GRAVITY, EarthPressure, Force, Load, Scene, Soil


@dataclass(frozen=True)
class Strips:
    """Parts of facets.

    Attributes:
        facets: Rows of the boundary, shape (strips,).
        start: Where the part begins on the facet, 0 to 1, shape (strips,).
        end: Where it ends.
    """

    facets: Indices
    start: Array
    end: Array

    @classmethod
    def between(
        cls, boundary: Boundary, mine: Flags, axis: int, ends: tuple[float, float]
    ) -> Strips:
        """Parts of some facets between two places x (axis 0) or y (axis 1)."""
        first, second = boundary.points[:, :2, axis].T
        with np.errstate(divide="ignore", invalid="ignore"):
            places = (np.array(ends) - first[:, None]) / (second - first)[:, None]
        # A facet at one place lies between the ends all along, or not at all.
        inside = (first >= ends[0]) & (first <= ends[1])
        start, end = np.clip(np.sort(places, axis=1), 0.0, 1.0).T
        start = np.where(first == second, 0.0, start)
        end = np.where(first == second, np.where(inside, 1.0, 0.0), end)
        rows = np.flatnonzero(mine & (end - start > NOTHING))
        return cls(rows, start[rows], end[rows])

    def length(self, boundary: Boundary) -> Array:
        """m, shape (strips,)."""
        return np.asarray(boundary.length[self.facets] * (self.end - self.start))

    def forces(self, boundary: Boundary, traction: Any) -> Array:
        """Forces on the nodes of the facets, N/m, shape (strips, nodes of a facet, 2).

        `traction` gives forces per area, shape (..., 2), at positions of shape (..., 2).
        """
        abscissa, weight = np.polynomial.legendre.leggauss(3)
        s = self.start[:, None] + np.outer(self.end - self.start, 0.5 * (1.0 + abscissa))
        first, second = boundary.points[self.facets, :2].swapaxes(0, 1)
        position = first[:, None] + s[:, :, None] * (second - first)[:, None]
        values = lagrange(s, boundary.nodes.shape[1])
        length = 0.5 * self.length(boundary)
        return np.einsum("f,g,fgk,fgd->fkd", length, weight, values, traction(position))

    def cut(self, boundary: Boundary, up: Array, levels: Array) -> Strips:
        """Strips that end where they cross levels of the height up . x, m."""
        first, second = (boundary.points[self.facets, :2] @ up).T
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = (levels - first[:, None]) / (second - first)[:, None]
        crossing = np.clip(np.nan_to_num(crossing), self.start[:, None], self.end[:, None])
        ends = np.sort(np.hstack([self.start[:, None], crossing, self.end[:, None]]), axis=1)
        row, number = np.nonzero(np.diff(ends, axis=1) > 0.0)
        return Strips(self.facets[row], ends[row, number], ends[row, number + 1])


#: Parts of facets, and of normals, below this are rounding.
NOTHING = 1e-9
#: Distance from a floor's height over the length of a facet up to which beds are uneven.
UNEVEN = 0.1


def upward(body: Vector) -> Array:
    """Unit vector against a body force; along y where there is none."""
    size = math.hypot(*body)
    return -np.array(body) / size if size > 0.0 else np.array([0.0, 1.0])


def floor_strips(scene: Scene, boundary: Boundary) -> Mapping[str, Strips]:
    """The top sides that every floor lies on.

    Raises:
        InputError: If a floor lies on none, or on sides inside a block.
    """
    found = {}
    looks_up = boundary.normal @ upward(scene.dead.body) > NOTHING
    gap = max((law.gap for law in scene.joints.values()), default=0.0)
    for name, floor in scene.floors.items():
        mine = looks_up if floor.at is None else looks_up & (boundary.role([floor.at]) == 0)
        strips = Strips.between(boundary, mine, 0, floor.x or (-np.inf, np.inf))
        height = boundary.points[strips.facets, :2, 1]
        if floor.height is not None:
            # At its height, or at the highest level below it within a gap of joints.
            near = CLOSED * boundary.length[strips.facets, None]
            within = (height <= floor.height + near) & (height >= floor.height - gap - near)
            under = np.all(within, axis=1)
            top = height[under].max(initial=-np.inf)
            rows = under & np.all(height >= top - near, axis=1)
            rows = _with_uneven(boundary, strips, rows, np.abs(height - floor.height).max(axis=1))
            strips = Strips(strips.facets[rows], strips.start[rows], strips.end[rows])
        found[name] = strips
        if len(strips.facets):
            continue
        if floor.height is None:
            missed = f"at = '{floor.at}': no side of this group looks up; name top sides"
        else:
            missed = f"y = {floor.height:g}: no top side of a block is at this height there; "
            places = height.ravel()
            if len(places) == 0:
                missed += "give x where blocks are"
            else:
                nearest = places[np.argmin(np.abs(places - floor.height))]
                missed += f"the nearest is at y = {nearest:g}"
        raise InputError(f"floors.{name}.{missed}")
    return found


def _with_uneven(boundary: Boundary, strips: Strips, level: Flags, away: Array) -> Flags:
    """Which strips a floor lies on: those at its level, and beside them uneven ones near to it.

    Args:
        boundary: Of the blocks.
        strips: Of sides that look up.
        level: Which are at its level, shape (strips,).
        away: Their largest distance from its height, m.
    """
    first, second = boundary.points[strips.facets, :2, 0].T
    reach = np.stack([first + part * (second - first) for part in (strips.start, strips.end)])
    low, high = reach.min(axis=0), reach.max(axis=0)
    rows = level.copy()
    near = np.flatnonzero(~level & (away <= UNEVEN * boundary.length[strips.facets]))
    for row in near[np.argsort(away[near], kind="stable")]:
        middle = 0.5 * (low[row] + high[row])
        rows[row] = not np.any((low[rows] < middle) & (middle < high[rows]))
    return rows


#: Cells of strips; points of integration in the reference cell, shape (strips or 1, points, 2);
#: weights, m2, shape (strips, points); heights up . x there, m.
Rule = tuple[Indices, Array, Array, Array]

#: Gauss points along each side of a strip, by corners of the cell.
POINTS = {3: 3, 4: 16}
#: Strips thinner than this are none, over the height of their cell.
THIN = 1e-12
#: Cells that are cut at a time, which bounds the memory.
PORTION = 300


def rules(domain: Any, up: Array, levels: Array) -> Iterator[Rule]:
    """Rules for this rank's cells, cut at levels of the height up . x, m."""
    corners = domain.geometry.x[compat.geometry_dofs(domain)][:, :, :2]
    height = corners @ up
    low = height.min(axis=1, keepdims=True)
    part = (levels - low) / (height.max(axis=1, keepdims=True) - low)
    cut = np.any((part > THIN) & (part < 1.0 - THIN), axis=1) | (corners.shape[1] == 3)
    # Whole quadrilaterals; corners as dolfinx has them, row by row.
    abscissa, weight = np.polynomial.legendre.leggauss(POINTS[3])  # polynomials, as in triangles
    place = 0.5 * (1.0 + np.stack(np.meshgrid(abscissa, abscissa), axis=-1).reshape(1, -1, 2))
    b, c, d = cell_sides(corners[~cut])
    area = np.abs(cross(b + d * place[..., 1:], c + d * place[..., :1]))
    arm = b * place[..., :1] + c * place[..., 1:] + d * place.prod(axis=-1, keepdims=True)
    area *= 0.25 * np.outer(weight, weight).ravel()
    yield np.flatnonzero(~cut), place, area, corners[~cut][:, :1] @ up + arm @ up
    for cells in np.array_split(np.flatnonzero(cut), cut.sum() // PORTION + 1):
        yield _cut(cells, corners[cells], up, levels)


def _cut(cells: Indices, corners: Array, up: Array, levels: Array) -> Rule:
    """A rule for cells cut into strips; corners as dolfinx has them, row by row."""
    # From the first corner, so that far-away origins cost no digits.
    base = corners[:, :1] @ up
    corners = corners - corners[:, :1]
    axes = np.column_stack([up, [up[1], -up[0]]])  # along the height, and across
    outline = corners[:, [0, 1, 3, 2] if corners.shape[1] == 4 else [0, 1, 2]] @ axes
    low = outline[..., 0].min(axis=1, keepdims=True)
    high = outline[..., 0].max(axis=1, keepdims=True)
    ends = np.sort(np.hstack([outline[..., 0], np.clip(levels - base, low, high)]), axis=1)
    row, number = np.nonzero(np.diff(ends, axis=1) > THIN * (high - low))
    extent = ends[row, number + 1] - ends[row, number]
    abscissa, weight = np.polynomial.legendre.leggauss(POINTS[corners.shape[1]])
    share = 0.5 * (1.0 + abscissa)
    height = ends[row, number][:, None] + extent[:, None] * share
    # Where cells begin across at heights inside them, and how wide they are there, m.
    first = outline[row][:, :, None]
    step = np.roll(outline[row], -1, axis=1)[:, :, None] - first
    with np.errstate(divide="ignore", invalid="ignore"):
        part = (height[:, None] - first[..., 0]) / step[..., 0]
        across = first[..., 1] + part * step[..., 1]
    meets = (part >= 0.0) & (part <= 1.0)
    left = np.where(meets, across, np.inf).min(axis=1)
    width = np.where(meets, across, -np.inf).max(axis=1) - left
    across = left[..., None] + width[..., None] * share
    area = np.einsum("r,h,rh,a->rha", 0.25 * extent, weight, width, weight)
    flat = len(row), len(share) ** 2
    arm = np.stack(np.broadcast_arrays(height[..., None], across), axis=-1).reshape(*flat, 2)
    place = reference_places(corners[row], arm @ axes.T)
    return cells[row], place, area.reshape(flat), arm[..., 0] + base[row]


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
    return _of_floors(scene, boundary, scene.floors, Profile(up, np.zeros(1), np.ones(1)), -up)


def _of_floors(
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
    heavy = [name for name, floor in scene.floors.items() if floor.mass]
    floors = _of_floors(scene, boundary, heavy, profile, np.array([1.0 / GRAVITY, 0.0]))
    return float(scene.comm.allreduce(total)) + sum(float(force.sum()) for _, force in floors)


def _by_cell(field: fem.Function) -> Array:
    """Values of a function that is constant in every cell of this rank."""
    return np.asarray(field.x.array[compat.cell_dofs(field.function_space)[:, 0]])


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
    profile = profile_of(scene, load, boundary, body_load.density)
    add_body_force(forces, load, body_load, profile)
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
        on_facets += weights_of_floors(scene, boundary) + forces_of_soil(scene, boundary)
    else:
        heavy = [name for name, floor in scene.floors.items() if floor.mass or load.on_table]
        acceleration = np.array(load.acceleration)
        acceleration /= math.hypot(*acceleration) if load.on_table else GRAVITY
        on_facets += _of_floors(scene, boundary, heavy, profile, acceleration)
    for facets, force in on_facets:
        nodes = boundary.nodes[facets]
        here = (nodes >= first) & (nodes < last)
        np.add.at(mine, nodes[here] - first, force[here])
    return mine.ravel()


def soil_strips(scene: Scene, boundary: Boundary) -> dict[str, Strips]:
    """Parts of sides below the surface of soils, by their names.

    Raises:
        InputError: If soil is at a joint or a foundation, or nowhere.
    """
    found = {}
    for name, soil in scene.soil.items():
        boundary.role([soil.at])  # raises: inside a block
        mine = boundary.in_group(soil.at)
        inner = mine.copy()
        inner[:] = False
        inner[facing_facets(boundary).facets] = True
        inner |= boundary.role(scene.foundations) >= 0
        if both := np.count_nonzero(mine & inner):
            raise InputError(
                f"soil.{name}.at = '{soil.at}': {both} facets touch another block or the ground;"
                " give a group of outer sides"
            )
        found[name] = Strips.between(boundary, mine, 1, (-np.inf, soil.level))
        if not len(found[name].facets):
            text = f"no side of '{soil.at}' is below the surface"
            raise InputError(f"soil.{name}.level = {soil.level:g}: {text}")
    return found


def stress_of_soil(soil: Soil | EarthPressure, height: Array) -> Array:
    """Vertical stress in soil at heights below its surface, Pa."""
    return soil.surcharge + soil.unit_weight * (soil.level - height)


def _pressed(
    boundary: Boundary, strips: Strips, soil: Soil | EarthPressure, share: Array
) -> tuple[Indices, Array]:
    """Facets and the forces on their nodes, of tractions that are shares of the stress of soil."""

    def traction(position: Array) -> Array:
        return stress_of_soil(soil, position[..., 1])[..., None] * share[:, None]

    return strips.facets, strips.forces(boundary, traction)


def forces_of_soil(scene: Scene, boundary: Boundary) -> list[tuple[Indices, Array]]:
    """Facets and the forces on their nodes: active pressure and the weight on sides that look up.

    Forces have the shape (facets, nodes of a facet, 2), N per metre of thickness.
    """
    found = []
    for name, strips in soil_strips(scene, boundary).items():
        soil = scene.soil[name]
        across, up = boundary.normal[strips.facets].T
        down = np.maximum(up, 0.0) * soil.weight
        share = -np.column_stack([soil.coefficients[0] * across, down])
        found.append(_pressed(boundary, strips, soil, share))
    return found


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
        normal = boundary.normal[strips.facets]
        along = np.column_stack([-normal[:, 1], normal[:, 0]])
        down = np.where(along[:, 1:] > 0.0, -along, along)
        direction = down * math.tan(math.radians(earth.wall_friction)) - normal
        found.append(_pressed(boundary, strips, earth, earth.coefficient * direction))
    if load.force:
        free = np.ones(len(boundary.length), dtype=bool)
        free[facing_facets(boundary).facets] = False
        for name, force in load.force.items():
            found.append(_at_place(boundary, free, force, f"{key}.force.{name}"))
    return found


def _at_place(boundary: Boundary, free: Flags, load: Force, key: str) -> tuple[Indices, Array]:
    """Facets that a force acts on, and the forces on their nodes, as `forces_on_facets` has."""
    facet, place = _place(boundary, free, load, key)
    ends = boundary.points[facet, :2]
    along = (ends[1] - ends[0]) / boundary.length[facet]
    width = cast(float, load.width or 0.0)
    if width == 0.0:
        s = np.array([(place - ends[0]) @ along / boundary.length[facet]])
        return np.array([facet]), lagrange(s, boundary.nodes.shape[1])[:, :, None] * load.force
    # The force is spread evenly over the projection on that line of what looks the same way.
    alike = free & (boundary.normal @ boundary.normal[facet] > ALIKE)
    off = np.abs((boundary.points[:, :2].mean(axis=1) - place) @ boundary.normal[facet])
    near = np.flatnonzero(alike & (off <= 0.5 * width))
    from_place = (boundary.points[near, :2] - place) @ along
    span = from_place[:, 1] - from_place[:, 0]
    at = (0.5 * width * np.array([[-1.0, 1.0]]) - from_place[:, :1]) / span[:, None]
    start, end = np.clip(np.sort(at, axis=1), 0.0, 1.0).T
    covered = float(np.sum((end - start) * np.abs(span)))
    if abs(covered - width) > 1e-6 * width:
        raise InputError(
            f"{key}: {covered:g} m of its width of {width:g} m lie on an edge at"
            f" ({place[0]:g}, {place[1]:g}); move it or make it narrower"
        )
    strips = Strips(near[end > start], start[end > start], end[end > start])
    per_length = np.array(load.force) / width
    share = (np.abs(span) / boundary.length[near])[end > start]
    even = strips.forces(boundary, lambda x: np.broadcast_to(per_length, x.shape))
    return strips.facets, even * share[:, None, None]


def _place(boundary: Boundary, free: Flags, load: Force, key: str) -> tuple[int, Array]:
    """Facet that a force meets, and where."""
    first, second = boundary.points[:, :2].swapaxes(0, 1)
    along = second - first
    place = np.array([load.x, load.y], dtype=float)
    if load.y is None:
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (place[0] - first[:, 0]) / along[:, 0]
        above = free & (boundary.normal[:, 1] > ALIKE) & (s >= -1e-9) & (s <= 1.0 + 1e-9)
        if not np.any(above):
            raise InputError(f"{key}: no edge looks up at x = {place[0]:g}; give y as well")
        at = first[above] + s[above, None] * along[above]
        highest = int(np.argmax(at[:, 1]))
        return int(np.flatnonzero(above)[highest]), at[highest]
    at = boundary.nearest(place)
    distance = np.where(free, np.linalg.norm(at - place, axis=1), np.inf)
    facet = int(np.argmin(distance))
    if distance[facet] > boundary.length[facet]:
        raise InputError(
            f"{key}: no free edge at ({place[0]:g}, {place[1]:g}); the next is at"
            f" ({at[facet, 0]:g}, {at[facet, 1]:g})"
        )
    return facet, at[facet]
