"""What pictures show, as arrays that all ranks have: blocks, joints, motion, where loads act."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from fenics_contact.discretization.facets import Boundary
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.layout import Layout, straight_faces
from fenics_contact.discretization.loads import (
    floor_strips,
    forces_of_soil,
    forces_on_facets,
    weights_of_floors,
)
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.output.fields import (
    StressRaster,
    at_nodes,
    at_sides,
    material_numbers,
    middle,
    mode_scale,
)
from fenics_contact.results.block_view import CRUSHES, NOTHING, BlockView, Bodies, Contacts
from fenics_contact.results.values import JointValues, TieValues, tie_arrays, tie_values
from fenics_contact.scene.scene import Load

#: Arrows along an edge have at least this distance, over the structure's size.
APART = 1.0 / 15.0
#: Corners that leave a straight line by less than this part of the structure's size are none.
STRAIGHT = 1e-5


class Arrows(NamedTuple):
    """Where forces act.

    Attributes:
        place: m, shape (arrows, 2).
        vector: Traction, Pa, or force, N per metre of thickness, shape (arrows, 2).
        pushes: Whether an arrow points into the block that it acts on.
    """

    place: Array
    vector: Array
    pushes: Array


class Loads(NamedTuple):
    """Where a load acts.

    Attributes:
        tractions: Tractions, earth pressure and floors.
        forces: Forces at places.
        body: Resultant of the body force on its line of action; no arrow if there is none.
    """

    tractions: Arrows
    forces: Arrows
    body: Arrows


NOWHERE = Arrows(np.empty((0, 2)), np.empty((0, 2)), np.empty(0, dtype=bool))
NO_LOAD = Loads(NOWHERE, NOWHERE, NOWHERE)


class BlockLabels(NamedTuple):
    """Names of the groups and places that a load acts on.

    Attributes:
        names: Of groups and floors, then of places.
        place: Where a name stands but for a distance, m, shape (names, 2).
        away: Direction of that distance, shape (names, 2).
    """

    names: tuple[str, ...]
    place: Array
    away: Array


class Roles(NamedTuple):
    """What a scene calls its parts.

    Attributes:
        held: Groups that do not move, and what holds them.
        ties: Names of ties.
        live: Where the live load acts.
        dead: Where the dead load acts.
    """

    held: tuple[tuple[str, str], ...]
    ties: tuple[str, ...]
    live: BlockLabels
    dead: BlockLabels


class Caption(NamedTuple):
    """What titles of pictures say.

    Attributes:
        motion: What the motion of the blocks is; "{}" stands for its scale.
        state: To which state the joint forces belong.
        stress: To which state the stresses belong, where more is to be said of it.
    """

    motion: str
    state: str
    stress: str = ""


COLLAPSE = Caption("collapse mode", "at collapse")
UNVERIFIED = Caption("motion, not verified", "of a state that is not verified")
BY_FACES = Caption("collapse mode", "of the certified state", "under the certified joint forces")


def caption_of(status: str, engine: str) -> Caption:
    """Titles for a collapse with this status, found by this engine."""
    verified = BY_FACES if engine == "faces" else COLLAPSE
    return verified if status == "limit" else UNVERIFIED


@dataclass(frozen=True)
class View:
    """What pictures of a structure show, alike on all ranks.

    Attributes:
        boundary: Facets of the blocks.
        joints: Joint points.
        values: Forces, openings and slips of a collapse; None where there is none.
        rest: Ends of the facets at rest, m, shape (facets, 2, 2).
        motion: Displacements of the facets' ends in the mode, scaled, m, shape (facets, 2, 2).
        joint_motion: Those of the joint points, mean of both sides, shape (points, 2).
        centre: Centre of area of every block, m, shape (blocks, 2).
        block_size: Side of a square with the mean area of the blocks, m.
        material: Number of the material of every block, as an index into `materials`.
        materials: Names.
        live: Live load, as it acts.
        dead: Dead load.
        ties: Ties with their forces; None where there are none, or no values.
        tie_motion: Displacements of their ends in the mode, scaled, m, shape (bars, 2, 2).
        roles: Names of what has a role in the scene.
        mode: What moves the blocks, this rank's part in the supports' coordinates; None: nothing.
        scale: Displacements that are drawn, over those of the mode.
        caption: What titles say of motion and forces.
        marked: Blocks that are shaded in place of all else; None where all is drawn.
        stress: Mean stresses in squares; None where they are not known.
        thickness: Of the structure, m; None where forces are told per metre of it.
    """

    boundary: Boundary
    joints: Joints
    values: JointValues | None
    rest: Array
    motion: Array
    joint_motion: Array
    centre: Array
    block_size: float
    material: Indices
    materials: tuple[str, ...]
    live: Loads
    dead: Loads
    ties: TieValues | None
    tie_motion: Array
    roles: Roles
    mode: Array | None = None
    scale: float = 1.0
    caption: Caption = COLLAPSE
    marked: Indices | None = None
    stress: StressRaster | None = None
    thickness: float | None = None

    def scaled(self, factor: float) -> View:
        """The view with displacements so many times as large."""
        moving = ("motion", "joint_motion", "tie_motion", "scale")
        return replace(self, **{name: factor * getattr(self, name) for name in moving})

    @cached_property
    def size(self) -> float:
        """Width or height of the structure, whichever is larger, m."""
        return float(np.ptp(self.boundary.points.reshape(-1, 2), axis=0).max())

    @property
    def moved(self) -> Array:
        """Ends of the facets, displaced by the mode, m, shape (facets, 2, 2)."""
        return self.rest + self.motion


def view_of(
    layout: Layout,
    mode: Array | None = None,
    values: JointValues | None = None,
    sign: float = 1.0,
) -> View:
    """What pictures show of a structure, of a mode of it and of its joint values. Collective.

    `mode` is this rank's part in the supports' coordinates; `sign` is -1 where the live load is
    reversed.
    """
    boundary = layout.boundary
    joints = layout.joints.without_ties()
    count = len(joints.nodes)
    scale = 1.0
    motion = np.zeros((len(boundary.nodes), 2, 2))
    sides = np.zeros((len(layout.joints.nodes), 2, 2))
    if mode is not None:
        scale = mode_scale(layout, mode)
        motion = scale * at_nodes(layout, mode, boundary.nodes[:, :2])
        sides = scale * at_sides(layout, mode)
    scene = layout.scene
    live = _loads(layout, "live", sign)
    dead = _loads(layout, "dead", 1.0)
    held = [(name, "foundation") for name in scene.foundations]
    held += [(name, f"support ({kind})") for name, kind in scene.supports.items()]
    labels = _labels(layout, "live", live), _labels(layout, "dead", dead)
    ties = None if values is None else tie_values(layout.joints, values)
    return View(
        boundary=boundary,
        joints=joints,
        values=values and values.first(count),
        rest=boundary.points[:, :2],
        motion=motion,
        joint_motion=middle(joints, sides[:count]),
        centre=layout.centroid,
        block_size=float(np.sqrt(layout.bodies_area() / len(layout.centroid))),
        material=body_materials(layout),
        materials=tuple(scene.materials),
        live=live,
        dead=dead,
        ties=ties,
        tie_motion=sides[count:][: 0 if ties is None else len(ties.force)],
        roles=Roles(tuple(held), tuple(scene.ties), *labels),
        mode=mode,
        scale=scale,
        thickness=scene.thickness,
    )


def body_materials(layout: Layout) -> Indices:
    """Number of the material of every body, the first in the scene's order. Collective."""
    scene = layout.scene
    material = np.full(scene.mesh.body_count, len(scene.materials), dtype=np.int64)
    np.minimum.at(material, scene.mesh.body, material_numbers(layout)[scene.mesh.cell_groups])
    scene.comm.Allreduce(MPI.IN_PLACE, material, MPI.MIN)
    return material


def _labels(layout: Layout, kind: str, acting: Loads) -> BlockLabels:
    """Names of what the "dead" or "live" load acts on, beside where it does."""
    scene = layout.scene
    load: Load = getattr(scene, kind)
    boundary = layout.boundary
    edges = {n: np.flatnonzero(boundary.in_group(n)) for n in (*load.traction, *load.earth)}
    if kind == "dead":
        edges |= {n: strips.facets for n, strips in floor_strips(scene, boundary).items()}
    named = [
        (name, boundary.points[mine, :2].mean(axis=(0, 1)), -boundary.normal[mine].mean(axis=0))
        for name, mine in edges.items()
    ]
    forces = acting.forces
    along = forces.vector / np.linalg.norm(forces.vector, axis=1, keepdims=True)
    named += zip(load.force, forces.place, along, strict=False)
    places = np.array([row[1:] for row in named]).reshape(-1, 2, 2)
    return BlockLabels(tuple(name for name, *_ in named), places[:, 0], places[:, 1])


def _loads(layout: Layout, kind: str, sign: float) -> Loads:
    """The "dead" or "live" load as it acts, times a sign."""
    load: Load = getattr(layout.scene, kind)
    boundary = layout.boundary
    bodies = layout.bodies
    points = boundary.points
    # Facets and the forces at their nodes, N per metre of thickness: along edges, then at places.
    on_facets = []
    if kind == "dead":
        on_facets += weights_of_floors(layout.scene, boundary)
        on_facets += forces_of_soil(layout.scene, boundary)
    for name, traction in load.traction.items():
        facets = np.flatnonzero(boundary.in_group(name))
        half = np.outer(0.5 * boundary.length[facets], traction)
        on_facets.append((facets, np.stack([half, half], axis=1)))
    edges = len(on_facets) + len(load.earth)
    on_facets += forces_on_facets(boundary, load)
    rest = getattr(bodies, kind) * [1.0, 1.0, bodies.size]
    for facets, force in on_facets:
        body = boundary.body[facets]
        arm = points[facets, : force.shape[1]] - bodies.centre[body][:, None]
        moment = arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]
        np.subtract.at(rest, body, np.column_stack([force.sum(axis=1), moment.sum(axis=1)]))
    if load.acceleration == (0.0, 0.0) and load.form is None:
        rest[:] = 0.0
    apart = APART * float(np.ptp(points.reshape(-1, 2), axis=0).max())
    return Loads(
        _joined(
            _along_edges(boundary, facets, sign * force.sum(axis=1), apart)
            for facets, force in on_facets[:edges]
        ),
        _joined(_resultant(boundary, facets, sign * force) for facets, force in on_facets[edges:]),
        _body_force(sign * rest, bodies.centre),
    )


def _along_edges(boundary: Boundary, facets: Indices, force: Array, apart: float) -> Arrows:
    """Mean tractions on stretches of edges."""
    middle = boundary.points[facets, :2].mean(axis=1)
    length = boundary.length[facets]
    turned = np.round(2.0 * boundary.normal[facets]).astype(np.int64)  # sides look different ways
    key = np.column_stack([np.floor(middle / apart).astype(np.int64), turned])
    group = np.unique(key, axis=0, return_inverse=True)[1].ravel()
    total = np.bincount(group, length)[:, None]
    columns = (length[:, None] * middle, force, force * boundary.normal[facets])
    place, traction, pressing = (
        np.column_stack([np.bincount(group, column) for column in table.T]) / total
        for table in columns
    )
    return Arrows(place, traction, pressing.sum(axis=1) <= 0.0)


def _resultant(boundary: Boundary, facets: Indices, force: Array) -> Arrows:
    """The resultant of a force at a place, from the forces on the nodes of facets."""
    size = np.linalg.norm(force, axis=2).ravel()
    place = size @ boundary.points[facets].reshape(-1, 2) / (size.sum() or 1.0)
    total = force.sum(axis=1)
    pressing = np.sum(total * boundary.normal[facets]) <= 0.0
    return Arrows(place[None], total.sum(axis=0)[None], np.array([pressing]))


def _body_force(force: Array, centre: Array) -> Arrows:
    """Resultant of forces and moments about their centres on all blocks, (blocks, 3)."""
    total = force[:, :2].sum(axis=0)
    size = np.linalg.norm(force[:, :2], axis=1)
    square = float(total @ total)
    if square <= 1e-18 * float(size.sum()) ** 2:
        return NOWHERE
    place = size @ centre / size.sum()
    arm = centre - place
    moment = np.sum(force[:, 2] + arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0])
    place = place + np.array([total[1], -total[0]]) * moment / square
    return Arrows(place[None], total[None], np.ones(1, dtype=bool))


def _joined(parts: Iterable[Arrows]) -> Arrows:
    """All arrows of several loads, without those of no size."""
    whole = Arrows(*(np.concatenate(column) for column in zip(NOWHERE, *parts, strict=True)))
    size = np.linalg.norm(whole.vector, axis=1)
    acts = size > 1e-9 * size.max(initial=0.0)
    return Arrows(*(column[acts] for column in whole))


# ---- blocks as rigid bodies


#: Motions (u_x, u_y, angle) in the plane as displacements and rotations in space.
LIFTED = np.array([[1, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 0, -1, 0]])


class _Outline(NamedTuple):
    """A block in the plane; loops around holes run the other way round."""

    corners: Array
    sides: list[Indices]
    normals: Array


def block_view(
    layout: Layout, mode: Array, values: JointValues | None = None, sign: float = 1.0
) -> BlockView:
    """Blocks, their rigid motions in a mode, and what their straight faces do. Collective.

    Arguments are as of `view_of`.
    """
    motion = layout.centroid_motions(mode)
    count = len(motion)
    materials = list(layout.scene.materials)
    groups = [materials[number] for number in body_materials(layout)]
    loops = outlines(layout.boundary, layout.boundary.points[:, :2])
    ties = tie_arrays(layout, values)
    size = float(np.ptp(layout.boundary.points.reshape(-1, 2), axis=0).max())
    view = BlockView(
        bodies=Bodies(
            names=[""] * count,
            groups=groups,
            fixed=np.zeros(count, dtype=bool),
            centroid=_lifted(layout.centroid),
            volume=layout.boundary.areas(layout.bodies.centre),
            pieces=[_outline(of_body, STRAIGHT * size) for of_body in loops],
            of_piece=np.arange(count),
            dimension=2,
        ),
        touching=_contacts(layout.joints.without_ties(), values),
        live=sign * _about(layout, layout.bodies.live) @ LIFTED,
        motion=motion @ LIFTED,
        tie_ends=_lifted(ties.get("ends", np.empty((0, 2, 2)))),
        tie_blocks=ties.get("blocks", np.empty((0, 2), dtype=np.int64)),
        ties=ties,
    )
    return view.scaled()


def _about(layout: Layout, load: Array) -> Array:
    """A load of bodies about their reference points, over their size, as one about centroids."""
    bodies = layout.bodies
    arm = bodies.centre - layout.centroid
    moment = bodies.size * load[:, 2] + arm[:, 0] * load[:, 1] - arm[:, 1] * load[:, 0]
    return np.column_stack([load[:, :2], moment])


def _lifted(places: npt.NDArray[Any]) -> Array:
    """Places or directions (x, y) as (x, 0, y)."""
    return np.insert(places, 1, 0.0, axis=-1)


def _outline(loops: list[Array], flat: float) -> _Outline:
    """A block from its loops, without corners that leave a straight line by less than `flat`, m."""
    kept = [_corners(loop, flat) for loop in loops]
    counts = [len(loop) for loop in kept]
    sides = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
    return _Outline(_lifted(np.vstack(kept)), sides, np.tile([0.0, -1.0, 0.0], (len(kept), 1)))


def _corners(loop: Array, flat: float) -> Array:
    """Corners of a loop where it turns."""
    before = loop - np.roll(loop, 1, axis=0)
    after = np.roll(loop, -1, axis=0) - loop
    cross = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    turns = cross > flat * np.maximum(np.linalg.norm(before + after, axis=1), flat)
    return loop[turns] if turns.sum() >= 3 else loop


def _contacts(joints: Joints, values: JointValues | None) -> Contacts:
    """Straight faces with the forces at their points."""
    faces = straight_faces(joints)
    order = np.argsort(faces.of_point, kind="stable")
    of_point = faces.of_point[order]
    count = len(faces.ends)
    position = joints.position[order]
    nothing = np.zeros(len(order))
    pressing, shear = nothing, nothing
    if values is not None:
        pressing, shear = values.normal_force[order], np.abs(values.shear_force[order])

    def sums(numbers: Array) -> Array:
        return np.bincount(of_point, numbers, count).astype(float)

    first, last = joints.position[faces.ends].swapaxes(0, 1)
    arm = position - 0.5 * (first + last)[of_point]
    moment = np.abs(sums(pressing * np.sum(arm * joints.tangent[order], axis=1)))
    normal_force = sums(pressing)
    strength = joints.crushes[faces.ends[:, 0]]
    largest = 0.5 * (sums(joints.length[order]) - normal_force / strength)
    loaded = normal_force > NOTHING * normal_force.max(initial=0.0)
    crushes = np.isfinite(strength) & loaded & (moment > CRUSHES * normal_force * largest)
    return Contacts(
        pairs=np.asarray(joints.bodies[faces.ends[:, 0]], dtype=np.int64),
        corners=[_lifted(ends) for ends in joints.position[faces.ends]],
        normal=_lifted(joints.normal[faces.ends[:, 0]]),
        position=_lifted(position),
        area=joints.length[order],
        of_point=of_point,
        pressing=pressing,
        shear=shear,
        friction=joints.friction[faces.ends[:, 0]],
        strength=sums(joints.shear_strength[order]),
        crushes=crushes,
    )


def outlines(boundary: Boundary, ends: Array) -> list[list[Array]]:
    """Closed loops around every body, for given ends of the facets, shape (facets, 2, 2).

    A body with a hole has more than one. The first corner is not repeated.
    """
    # Run along every facet with the block on the left.
    along = boundary.points[:, 1] - boundary.points[:, 0]
    forward = np.linalg.det(np.stack([boundary.normal, along], axis=1)) > 0.0
    order = np.where(forward[:, None], [0, 1], [1, 0])
    nodes = np.take_along_axis(boundary.nodes[:, :2], order, axis=1).tolist()
    points = np.take_along_axis(ends, order[:, :, None], axis=1)[:, 1]
    leaving = {first: row for row, (first, _) in enumerate(nodes)}
    loops: list[list[Array]] = [[] for _ in range(int(boundary.body.max()) + 1)]
    while leaving:
        node = next(iter(leaving))
        rows = []
        while node in leaving:
            rows.append(leaving.pop(node))
            node = nodes[rows[-1]][1]
        loops[boundary.body[rows[0]]].append(points[rows])
    return loops
