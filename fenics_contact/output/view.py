"""What pictures show, as arrays that all ranks have: blocks, joints, motion, where loads act."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fenics_contact.discretization.facets import Boundary
from fenics_contact.discretization.joints import GROUND, Joints
from fenics_contact.discretization.layout import Layout, straight_faces
from fenics_contact.discretization.loads import (
    floor_strips,
    forces_of_soil,
    forces_on_facets,
    weights_of_floors,
)
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.output.fields import (
    StressRaster,
    at_nodes,
    at_sides,
    facet_contact,
    material_numbers,
    middle,
    mode_scale,
)
from fenics_contact.output.thrust import Resultants, face_resultants
from fenics_contact.parallel import MPI
from fenics_contact.results.block_view import (
    CRUSHES,
    LIVE,
    NOTHING,
    BlockView,
    Bodies,
    Contacts,
    ContactState,
    Pushes,
)
from fenics_contact.results.result import Collapse
from fenics_contact.results.values import JointValues, falling_blocks, tie_arrays
from fenics_contact.results.wording import DEAD
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


#: State of a joint facet that is open at rest, and opens no further.
AT_REST = -1
NONE = np.empty(0, dtype=np.int64)
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


NO_NAMES = BlockLabels((), np.empty((0, 2)), np.empty((0, 2)))


class Lines(NamedTuple):
    """Where blocks meet, in straight pieces.

    Attributes:
        ends: At rest, m, shape (lines, 2, 2).
        motion: Displacements of these, mean of both sides, scaled, m, shape (lines, 2, 2).
        state: A `ContactState`, or `AT_REST`, shape (lines,).
        group: Of the law, as an index into `groups`; below 0 on the ground; none: not known.
        groups: Names.
        crushes: Numbers of lines at their compressive strength.
    """

    ends: Array
    motion: Array
    state: Indices
    group: Indices = NONE
    groups: tuple[str, ...] = ()
    crushes: Indices = NONE


class Held(NamedTuple):
    """Edges that do not move.

    Attributes:
        name: Of their group.
        kind: What holds them.
        ends: m, shape (edges, 2, 2).
        normal: Out of the blocks, shape (edges, 2).
    """

    name: str
    kind: str
    ends: Array
    normal: Array


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


FALL, WEDGE = Caption("these blocks fall", ""), Caption("these blocks wedge", "")
COLLAPSE = Caption("collapse mode", "at collapse")
UNVERIFIED = Caption("motion, not verified", "of a state that is not verified")
BY_FACES = Caption("collapse mode", "of the certified state", "under the certified joint forces")


@dataclass(frozen=True, kw_only=True)
class View:
    """What pictures of a structure in the plane show, alike on all ranks.

    Attributes:
        blocks: What moves, and the forces of contacts; files of pictures do not have it.
        rest: Corners of the blocks at rest, m, shape (corners, 2).
        motion: Displacements of these, scaled, m, shape (corners, 2).
        loop: Number of the closed loop that a corner is on, ascending, shape (corners,).
        block: Number of a corner's block, ascending, shape (corners,).
        fixed: Whether a block is ground, shape (blocks,).
        centre: Centre of area of every block, m, shape (blocks, 2).
        block_size: Side of a square with the mean area of the blocks, m.
        material: Number of the material of every block, as an index into `materials`.
        materials: Names.
        lines: Where blocks meet.
        hinges: Places at rest, and displacements, m, shape (hinges, 2, 2).
        faces: Resultants of the forces there; None where none are known.
        ties: Ends, (bars, 2, 2), their displacements, names; with forces these and states, too.
        live: Live load, as it acts.
        dead: Dead load.
        live_names: What the live load acts on.
        dead_names: What the dead load acts on.
        held: What does not move.
        scale: Displacements that are drawn, over those of the mode.
        caption: What titles say of motion and forces.
        marked: Blocks that are shaded in place of all else; None where all is drawn.
        stress: Mean stresses in squares; None where they are not known.
        thickness: Of the structure, m; None where forces are told per metre of it.
    """

    blocks: BlockView
    rest: Array
    motion: Array
    loop: Indices
    block: Indices
    fixed: Flags
    centre: Array
    block_size: float
    material: Indices
    materials: tuple[str, ...]
    lines: Lines
    hinges: Array
    faces: Resultants | None
    ties: Mapping[str, Any]
    live: Loads
    dead: Loads = NO_LOAD
    live_names: BlockLabels = NO_NAMES
    dead_names: BlockLabels = NO_NAMES
    held: tuple[Held, ...] = ()
    scale: float = 1.0
    caption: Caption = COLLAPSE
    marked: Indices | None = None
    stress: StressRaster | None = None
    thickness: float | None = None

    def scaled(self, factor: float) -> View:
        """The view with displacements so many times as large."""
        return replace(
            self,
            blocks=replace(self.blocks, motion=factor * self.blocks.motion),
            motion=factor * self.motion,
            lines=self.lines._replace(motion=factor * self.lines.motion),
            hinges=self.hinges * [[1.0], [factor]],
            ties={**self.ties, "motion": factor * self.ties["motion"]},
            scale=factor * self.scale,
        )

    def told(self, **changes: Any) -> View:
        """The view with other titles, suffix or marked blocks (`BlockView`)."""
        marked = np.array(changes["marked"]) if "marked" in changes else self.marked
        return replace(self, blocks=replace(self.blocks, **changes), marked=marked)

    @cached_property
    def size(self) -> float:
        """Width or height of the structure, whichever is larger, m."""
        return float(np.ptp(self.rest[~self.fixed[self.block]], axis=0).max())

    @property
    def moved(self) -> Array:
        """Corners, displaced by the mode, m, shape (corners, 2)."""
        return self.rest + self.motion


def planar(blocks: BlockView, known: bool, **more: Any) -> View:
    """What pictures show of blocks in the plane, whose contact forces may be known.

    What is known better than by rigid blocks and their contacts comes as attributes of a `View`.
    """
    bodies = blocks.bodies
    at = blocks.touching
    loops = [bodies.sides[side] for side in np.flatnonzero(bodies.normal[:, 1] < -0.5)]  # in front
    corners = np.concatenate(loops)
    ends = _lifted(at.ends)
    sides = [blocks.displacements(ends, side[:, None].repeat(2, axis=1)) for side in at.pairs.T]
    motion = 0.5 * np.sum(sides, axis=0)
    body, forces = (_flat(blocks.loads.get(name)) for name in LIVE)
    lines = Lines(at.ends, motion[..., ::2], blocks.contacts.state)
    lines = lines._replace(crushes=np.flatnonzero(at.crushes))
    rocks = np.flatnonzero(blocks.contacts.state == ContactState.ROCKS)
    closed = np.argmin(np.linalg.norm(sides[1] - sides[0], axis=2), axis=1)[rocks]
    given: dict[str, Any] = {
        "motion": blocks.displacement[corners, ::2],
        "materials": bodies.group_names,
        "material": bodies.group,
        "lines": lines,
        "hinges": np.stack([at.ends, motion[..., ::2]], axis=2)[rocks, closed],
        "live": Loads(NOWHERE, forces, body),
        "marked": np.array(blocks.marked, dtype=np.int64) if blocks.marked else None,
    }
    return View(
        blocks=blocks,
        rest=bodies.corner[corners, ::2],
        loop=np.repeat(np.arange(len(loops)), list(map(len, loops))),
        block=bodies.block[corners],
        fixed=bodies.fixed,
        centre=bodies.centroid[:, ::2],
        block_size=float(np.sqrt(bodies.volume[~bodies.fixed].mean())),
        faces=face_resultants(blocks) if known else None,
        ties={
            "ends": blocks.tie_ends[..., ::2],
            "motion": (blocks.moved_ties - blocks.tie_ends)[..., ::2],
            **blocks.ties,
        },
        **(given | more),
    )


def _flat(pushes: Pushes | None) -> Arrows:
    """Arrows in the plane, none for nothing."""
    if pushes is None:
        return NOWHERE
    _, place, force = pushes
    return Arrows(place[:, ::2], force[:, ::2], np.ones(len(place), dtype=bool))


def view_of(
    layout: Layout,
    mode: Array | None = None,
    values: JointValues | None = None,
    sign: float = 1.0,
) -> View:
    """What pictures show of a meshed structure, of a mode of it and of its joint values.

    Collective. `mode` is this rank's part in the supports' coordinates; `sign` is -1 where the live
    load is reversed.
    """
    scene = layout.scene
    boundary = layout.boundary
    joints = layout.joints.without_ties()
    mode = np.zeros(layout.imposed.shape) if mode is None else mode
    scale = mode_scale(layout, mode)
    rest = boundary.points[:, :2]
    moved = rest + scale * at_nodes(layout, mode, boundary.nodes[:, :2])
    # Corners at rest, and displaced, m, shape (corners, 4), by block and loop.
    flat = STRAIGHT * float(np.ptp(rest.reshape(-1, 2), axis=0).max())
    loops = [
        [_corners(loop, flat) for loop in of_body]
        for of_body in outlines(boundary, np.concatenate([rest, moved], axis=2))
    ]
    corners = np.vstack([loop for of_body in loops for loop in of_body])
    joint_motion = middle(joints, scale * at_sides(layout, mode)[: joints.joint_count])
    points = NONE if values is None else values.first(len(joints.law)).hinges(joints.neighbours)
    material = body_materials(layout)
    materials = tuple(scene.materials)
    live = _loads(layout, "live", sign)
    dead = _loads(layout, "dead", 1.0)
    kinds = dict.fromkeys(scene.foundations, "foundation")
    kinds |= {name: f"support ({kind})" for name, kind in scene.supports.items()}
    edges = {name: boundary.in_group(name) for name in kinds}
    ties = {name: np.asarray(array) for name, array in tie_arrays(layout, values).items()}
    blocks = BlockView(
        bodies=Bodies(
            names=[""] * len(material),
            groups=[materials[number] for number in material],
            fixed=np.zeros(len(material), dtype=bool),
            centroid=_lifted(layout.centroid),
            volume=boundary.areas(layout.bodies.centre),
            pieces=[_outline(of_body) for of_body in loops],
            of_piece=np.arange(len(material)),
            dimension=2,
        ),
        touching=_contacts(joints, values),
        live=sign * _about(layout, layout.bodies.live) @ LIFTED,
        motion=scale * layout.centroid_motions(mode) @ LIFTED,
        tie_ends=_lifted(ties.get("ends", np.empty((0, 2, 2)))),
        tie_blocks=ties.get("blocks", np.empty((0, 2), dtype=np.int64)),
        ties=ties,
    )
    return planar(
        blocks,
        known=values is not None,
        motion=corners[:, 2:] - corners[:, :2],
        material=material,
        materials=materials,
        lines=_lines(joints, values, joint_motion),
        hinges=np.stack([joints.position[points], joint_motion[points]], axis=1),
        live=live,
        dead=dead,
        live_names=_labels(layout, "live", live),
        dead_names=_labels(layout, "dead", dead),
        held=tuple(
            Held(name, kinds[name], rest[mine], boundary.normal[mine])
            for name, mine in edges.items()
            if np.any(mine)
        ),
        scale=scale,
        thickness=scene.thickness,
    )


def view_of_collapse(layout: Layout, end: Collapse) -> View:
    """What pictures show of a collapse. Collective."""
    view = view_of(layout, end.mode, end.joints, end.sign)
    return replace(view, caption=caption_of(end))


def caption_of(end: Collapse) -> Caption:
    """What titles of pictures say of a collapse, or of a state."""
    if end.given is not None:
        return FALL if end.falling else Caption("blocks at rest", end.under)
    if end.status == "unbounded":
        return WEDGE
    verified = BY_FACES if end.engine == "faces" else COLLAPSE
    return verified if end.status == "limit" else UNVERIFIED


def view_of_fall(layout: Layout, fall: Array) -> View:
    """What pictures show of the rigid motions (a, b, c) by which blocks fall. Collective."""
    blocks = tuple(falling_blocks(layout, fall).tolist())
    view = replace(view_of(layout, layout.rigid_motion(fall)), caption=FALL)
    return view.told(marked=blocks, caption=f"does not stand {DEAD}")


def _lines(joints: Joints, values: JointValues | None, motion: Array) -> Lines:
    """Facets of joints; those that open along with all of their straight face are `OPEN`."""
    segments = joints.segments
    state = np.full(len(segments), ContactState.STICK)
    if values is not None:
        values = values.first(joints.joint_count)
        face = straight_faces(joints).of_point
        whole = np.bincount(face, ~values.opens) == 0
        opens = np.any(values.opens[segments], axis=1)
        does = np.where(whole[face[segments[:, 0]]], ContactState.OPEN, ContactState.ROCKS)
        state = facet_contact(values, segments)
        state = np.where(state == ContactState.OPEN, np.where(opens, does, AT_REST), state)
    first = segments[:, 0]
    group = np.where(joints.bodies[first, 0] == GROUND, -1, joints.law[first])
    return Lines(joints.position[segments], motion[segments], state, group, joints.names)


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


def _about(layout: Layout, load: Array) -> Array:
    """A load of bodies about their reference points, over their size, as one about centroids."""
    bodies = layout.bodies
    arm = bodies.centre - layout.centroid
    moment = bodies.size * load[:, 2] + arm[:, 0] * load[:, 1] - arm[:, 1] * load[:, 0]
    return np.column_stack([load[:, :2], moment])


def _lifted(places: npt.NDArray[Any]) -> Array:
    """Places or directions (x, y) as (x, 0, y)."""
    return np.insert(places, 1, 0.0, axis=-1)


def _outline(loops: list[Array]) -> _Outline:
    """A block from its loops, of which the first two columns are places."""
    counts = list(map(len, loops))
    sides = np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])
    normals = np.tile([0.0, -1.0, 0.0], (len(loops), 1))
    return _Outline(_lifted(np.vstack(loops)[:, :2]), sides, normals)


def _corners(loop: Array, flat: float) -> Array:
    """Corners of a loop, shape (., 4), where it turns by more than `flat`, m, at rest or moved."""
    before = (loop - np.roll(loop, 1, axis=0)).reshape(-1, 2, 2)
    after = (np.roll(loop, -1, axis=0) - loop).reshape(-1, 2, 2)
    cross = np.abs(before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0])
    length = np.maximum(np.linalg.norm(before + after, axis=2), flat)
    turns = np.any(cross > flat * length, axis=1)
    return loop[turns] if turns.sum() >= 3 else loop


def _contacts(joints: Joints, values: JointValues | None) -> Contacts:
    """Straight faces with the forces at their points."""
    faces = straight_faces(joints)
    order = np.argsort(faces.of_point, kind="stable")
    of_point = faces.of_point[order]
    count = len(faces.ends)
    position = joints.position[order]
    pressing = np.zeros(len(order))
    force = np.zeros((len(order), 2))
    if values is not None:
        values = values.first(joints.joint_count)
        pressing = values.normal_force[order]
        force = values.force(joints.normal, joints.tangent)[order]

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
        force=_lifted(force),
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
