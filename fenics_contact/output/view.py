"""What pictures show, as arrays that all ranks have: blocks, joints, motion, where loads act."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

from fenics_contact.discretization.facets import Boundary
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.layout import Layout
from fenics_contact.discretization.loads import forces_on_facets
from fenics_contact.discretization.profiles import weights_of_floors
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.output.fields import (
    at_nodes,
    at_sides,
    material_numbers,
    middle,
    mode_scale,
)
from fenics_contact.results.joint_values import JointValues
from fenics_contact.results.tie_values import TieValues, tie_values
from fenics_contact.scene.scene import Load

#: Arrows along an edge have at least this distance, over the structure's size.
APART = 1.0 / 15.0


@dataclass(frozen=True)
class Arrows:
    """Where a load acts.

    Attributes:
        place: m, shape (arrows, 2).
        vector: Traction, Pa, or force, N per metre of thickness, shape (arrows, 2).
        pushes: Whether an arrow points into the block that it acts on.
    """

    place: Array
    vector: Array
    pushes: Array


@dataclass(frozen=True)
class Caption:
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
    """Of a collapse with this status, found by this engine."""
    verified = BY_FACES if engine == "faces" else COLLAPSE
    return verified if status == "limit" else UNVERIFIED


@dataclass(frozen=True)
class View:
    """What pictures of a structure show, alike on all ranks.

    Attributes:
        boundary: Facets of the blocks.
        joints: Joint points.
        values: Forces, openings and slips of a collapse; None where there is none.
        motion: Displacements of the facets' ends in the mode, scaled, m, shape (facets, 2, 2).
        joint_motion: Those of the joint points, mean of both sides, shape (points, 2).
        centre: Centre of area of every block, m, shape (blocks, 2).
        area: Of all blocks, m2.
        material: Number of the material of every block, as an index into `materials`.
        materials: Names.
        tractions: Live tractions and earth pressure, as they act.
        forces: Live forces at places.
        ties: Ties with their forces; None where there are none, or no values.
        tie_motion: Displacements of their ends in the mode, scaled, m, shape (bars, 2, 2).
        body: Resultant of the live body force on its line of action; no arrow if there is none.
        dead: Dead tractions, earth pressure and floors, forces at places, resultant of the body
            force.
        scale: Displacements that are drawn, over those of the mode.
        caption: What titles say of motion and forces.
        marked: Blocks that are shaded in place of all else; None where all is drawn.
    """

    boundary: Boundary
    joints: Joints
    values: JointValues | None
    motion: Array
    joint_motion: Array
    centre: Array
    area: float
    material: Indices
    materials: tuple[str, ...]
    tractions: Arrows
    forces: Arrows
    body: Arrows
    ties: TieValues | None
    tie_motion: Array
    dead: tuple[Arrows, Arrows, Arrows]
    scale: float = 1.0
    caption: Caption = COLLAPSE
    marked: Indices | None = None

    def scaled(self, factor: float) -> View:
        """The view with displacements so many times as large."""
        return replace(
            self,
            motion=factor * self.motion,
            joint_motion=factor * self.joint_motion,
            tie_motion=factor * self.tie_motion,
            scale=factor * self.scale,
        )

    def without_live_load(self) -> View:
        """The view without arrows of the live load."""
        none = _joined([])
        return replace(self, tractions=none, forces=none, body=none)

    @property
    def size(self) -> float:
        """Width or height of the structure, whichever is larger, m."""
        return float(np.ptp(self.boundary.points.reshape(-1, 2), axis=0).max())

    @property
    def rest(self) -> Array:
        """Ends of the facets at rest, m, shape (facets, 2, 2)."""
        return self.boundary.points[:, :2]

    @property
    def moved(self) -> Array:
        """Ends of the facets, displaced by the mode, m, shape (facets, 2, 2)."""
        return self.rest + self.motion

    @property
    def moved_ties(self) -> Array:
        """Ends of the ties, displaced by the mode, m, shape (bars, 2, 2)."""
        return self.tie_motion if self.ties is None else self.ties.bars.sides + self.tie_motion

    @property
    def block_size(self) -> float:
        """Side of a square with the mean area of the blocks, m."""
        return float(np.sqrt(self.area / len(self.centre)))


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
    motion = np.zeros((len(boundary.nodes), 2, 2))
    at_points = np.zeros((len(joints.nodes), 2))
    scale = 1.0
    at_ties = np.zeros((len(layout.joints.nodes) - len(joints.nodes), 2, 2))
    if mode is not None:
        scale = mode_scale(layout, mode)
        motion = scale * at_nodes(layout, mode, boundary.nodes[:, :2])
        sides = scale * at_sides(layout, mode)
        at_points = middle(joints, sides[: len(at_points)])
        at_ties = sides[len(at_points) :]
    scene = layout.scene
    tractions, forces, body = _arrows(layout, "live", sign)
    return View(
        boundary=boundary,
        joints=joints,
        values=values and values.first(len(joints.nodes)),
        motion=motion,
        joint_motion=at_points,
        centre=layout.centroid,
        area=layout.bodies_area(),
        material=_materials(layout),
        materials=tuple(scene.materials),
        tractions=tractions,
        forces=forces,
        body=body,
        ties=None if values is None else tie_values(layout.joints, values),
        tie_motion=at_ties,
        dead=_arrows(layout, "dead", 1.0),
        scale=scale,
    )


def _materials(layout: Layout) -> Indices:
    """Material of every block: the first in the scene's order, if it has several."""
    mesh = layout.scene.mesh
    number = np.full(mesh.body_count, len(layout.scene.materials), dtype=np.int64)
    np.minimum.at(number, mesh.body, material_numbers(layout)[mesh.cell_groups])
    mesh.comm.Allreduce(MPI.IN_PLACE, number, MPI.MIN)
    return number


def _arrows(layout: Layout, kind: str, sign: float) -> tuple[Arrows, Arrows, Arrows]:
    """Tractions, forces at places, and the body force, of the "dead" or "live" load as it acts."""
    load: Load = getattr(layout.scene, kind)
    boundary = layout.boundary
    bodies = layout.bodies
    points = boundary.points
    floors = weights_of_floors(layout.scene, boundary) if kind == "dead" else []
    on_facets = [*floors, *_traction_forces(boundary, load), *forces_on_facets(boundary, load)]
    rest = getattr(bodies, kind) * [1.0, 1.0, bodies.size]
    for facets, force in on_facets:
        body = boundary.body[facets]
        arm = points[facets, : force.shape[1]] - bodies.centre[body][:, None]
        moment = arm[..., 0] * force[..., 1] - arm[..., 1] * force[..., 0]
        np.subtract.at(rest, body, np.column_stack([force.sum(axis=1), moment.sum(axis=1)]))
    if load.acceleration == (0.0, 0.0) and load.form is None:
        rest[:] = 0.0
    edges = len(floors) + len(load.traction) + len(load.earth)
    apart = APART * float(np.ptp(points.reshape(-1, 2), axis=0).max())
    arrows = [
        _along_edges(boundary, facets, sign * force.sum(axis=1), apart)
        for facets, force in on_facets[:edges]
    ]
    forces = [_resultant(boundary, facets, sign * force) for facets, force in on_facets[edges:]]
    return _joined(arrows), _joined(forces), _body_force(sign * rest, bodies.centre)


def _traction_forces(boundary: Boundary, load: Load) -> list[tuple[Indices, Array]]:
    """Facets and the forces at their two ends, N per metre of thickness, of all tractions."""
    found = []
    for name, traction in load.traction.items():
        facets = np.flatnonzero(boundary.in_group(name))
        half = np.outer(0.5 * boundary.length[facets], traction)
        found.append((facets, np.stack([half, half], axis=1)))
    return found


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
        return _joined([])
    place = size @ centre / size.sum()
    arm = centre - place
    moment = np.sum(force[:, 2] + arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0])
    place = place + np.array([total[1], -total[0]]) * moment / square
    return Arrows(place[None], total[None], np.ones(1, dtype=bool))


def _joined(parts: list[Arrows]) -> Arrows:
    """All arrows of several loads, without those of no size."""
    none = Arrows(np.empty((0, 2)), np.empty((0, 2)), np.empty(0, dtype=bool))
    columns = zip(*(vars(part).values() for part in (none, *parts)), strict=True)
    whole = Arrows(*(np.concatenate(column) for column in columns))
    size = np.linalg.norm(whole.vector, axis=1)
    acts = size > 1e-9 * size.max(initial=0.0)
    return Arrows(whole.place[acts], whole.vector[acts], whole.pushes[acts])
