"""Blocks, joints and supports of a scene as arrays: rigid motions, straight faces, `Layout`.

Supports leave some motions free, and impose others.

A body's rigid motion is (a, b, c): u(x) = (a, b) + c (-(y - y0), x - x0) about its centre.

Supports and rigid ground move by d with the dead load; joints have initial gaps g. Let u = u_d + u'
with a field u_d that is d where supports hold. Then u' is zero there, and

    K u' = (f_D - K u_d) + lambda f_L + B_N^T r_N + B_T^T r_T,
    w_N = B_N u' - o_N >= 0,   w_T = B_T u' - o_T,

with o_N = -([u_d]_N + g) and o_T = -[u_d]_T by the jumps of u_d across the joints, on ground those
against d. On every block with supports u_d is the rigid motion nearest to d, which strains nothing,
and the rest of d at the held nodes alone. Results do not depend on this choice.

A face presses with 0 <= p <= f_c. The resultant N of the largest moment M about the middle of the
face is a block of pressure f_c at its end, a = N / f_c long. So it stays a / 2 inside that end,

    |M| <= N (L - N / f_c) / 2                                               (one length L),

a convex set: the law is associative (J. Heyman, The masonry arch (1982), section 2.4; R.K.
Livesley, Int. J. Numer. Meth. Eng. 12 (1978) 1853). It is a law of the face engine (`faces.model`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.discretization.facets import GROUND, Boundary
from fenics_contact.discretization.forms import Law
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.materials import displacement_space, stress_law
from fenics_contact.discretization.supports import Supports, displacements
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array, Flags, Indices, Labels
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.parallel import MPI
from fenics_contact.scene.scene import Scene
from fenics_contact.solvers.joint_law import PointLaws
from fenics_contact.solvers.problem import State

#: Motions held less than the square root of this, relative to the best held one, are free.
FREE = 1e-13


@dataclass(frozen=True)
class RigidBodies:
    """Bodies as the rigid-block programs see them; on all ranks.

    Attributes:
        centre: Reference point of every body, m, shape (bodies, 2).
        size: Length by which rotations are scaled, m.
        free: Orthonormal motions (a, b, c size) of every body that supports leave free, as columns
            beside zero ones, shape (bodies, 3, 3).
        dead: Forces, and moment / size, of the dead load, shape (bodies, 3).
        live: Those of the live load.
    """

    centre: Array
    size: float
    free: Array
    dead: Array
    live: Array

    @property
    def floating(self) -> Flags:
        """Bodies that supports alone do not hold."""
        return np.any(self.free != 0.0, axis=(1, 2))


def motions(arm: Array, size: float) -> Array:
    """Displacement at a point per motion (a, b, c size), shape (points, 2, 3)."""
    motion = np.zeros((len(arm), 2, 3))
    motion[:, 0, 0] = motion[:, 1, 1] = 1.0
    motion[:, 0, 2], motion[:, 1, 2] = -arm[:, 1] / size, arm[:, 0] / size
    return motion


def held_motions(motion: Array, frame: Array, held: Flags, label: Labels, count: int) -> Array:
    """Gram matrices, by label, of the motions of points in the held directions."""
    rows = np.einsum("nks,nkm->nsm", frame, motion) * held[:, :, None]
    gram = np.zeros((count, 3, 3))
    np.add.at(gram, label, np.einsum("nsi,nsj->nij", rows, rows))
    return gram


def free_motions(gram: Array) -> Array:
    """Orthonormal motions that nothing holds as columns, those held zero."""
    size, direction = np.linalg.eigh(gram)
    held = size > FREE * np.maximum(size[:, -1:], 1e-300)
    return np.where(held[:, None, :], 0.0, direction)


def check_held(
    sides: Labels, position: Array, supports: Supports, bodies: RigidBodies, source: str
) -> None:
    """Check that the structure cannot move as a whole with all its joints closed.

    `sides` and `position` are `Joints.bodies` and `Joints.position`; `source` names the mesh.

    Raises:
        InputError: If some blocks touch nothing that holds them, or can move all together.
    """
    on_ground = sides[:, 0] == GROUND
    cluster = connected(sides[~on_ground], len(bodies.centre))
    stands = position[on_ground]
    points = np.concatenate([supports.points, stands])
    body = np.concatenate([supports.body, sides[on_ground, 1]])
    frame = np.concatenate([supports.frame, np.tile(np.eye(2), (len(stands), 1, 1))])
    held = np.concatenate([supports.held, np.ones((len(stands), 2), dtype=bool)])
    motion = motions(points - bodies.centre.mean(axis=0), bodies.size)
    gram = held_motions(motion, frame, held, cluster[body], int(cluster.max()) + 1)
    loose = np.flatnonzero(np.any(free_motions(gram) != 0.0, axis=(1, 2)))
    if not len(loose):
        return
    untouched = loose[~np.any(gram[loose], axis=(1, 2))]
    members = np.flatnonzero(np.isin(cluster, untouched if len(untouched) else loose))
    x, y = bodies.centre[members[0]]
    apart = f" in {len(untouched)} places" if len(untouched) > 1 else ""
    where = f"{source}: {len(members)} blocks{apart}, the first around ({x:g}, {y:g}),"
    if not len(untouched):
        raise InputError(f"{where} can move all together even with closed joints; add supports")
    raise InputError(
        f"{where} touch neither a support nor a foundation, nor blocks that do; add [supports] or"
        " [foundations], or check that the blocks touch: fenics-contact mesh --close closes mortar"
        " joints of a drawing, joints.default.gap gaps that must close first"
    )


#: Singular values of held rigid motions that count as zero, relative.
NOT_HELD = 1e-12


def ground_motion(scene: Scene, boundary: Boundary, joints: Joints) -> Array:
    """Displacements of rigid ground at all joint points, m, zero elsewhere, shape (points, 2)."""
    motion = np.zeros(joints.position.shape)
    for name, movement in scene.dead.movement.items():
        mine = joints.law == (*joints.names, name).index(name)
        edges = boundary.in_group(name)
        motion[mine] = displacements(movement, boundary, edges, joints.position[mine])
    return motion


def imposed_motions(
    supports: Supports, bodies: RigidBodies, joints: Joints, ground: Array
) -> tuple[Array, Array, Array]:
    """The field u_d by the held displacements of supports, and those of rigid ground; on all ranks.

    Returns:
        Rigid motions (a, b, c) of the bodies, shape (bodies, 3); what supports hold besides, at
        their nodes, m, shape (nodes, 2); jumps at the joint points, second side less first, m,
        shape (points, 2).
    """
    per_motion = motions(supports.points - bodies.centre[supports.body], bodies.size)
    rows = np.einsum("nks,nkm->nsm", supports.frame, per_motion) * supports.held[:, :, None]
    held = np.einsum("nks,nk->ns", supports.frame, supports.motion)
    gram = np.zeros((len(bodies.centre), 3, 3))
    right = np.zeros((len(bodies.centre), 3))
    np.add.at(gram, supports.body, np.einsum("nsi,nsj->nij", rows, rows))
    np.add.at(right, supports.body, np.einsum("nsi,ns->ni", rows, held))
    inverse = np.linalg.pinv(gram, rcond=NOT_HELD, hermitian=True)
    scaled = np.einsum("nij,nj->ni", inverse, right)
    missed = held - np.einsum("nsm,nm->ns", rows, scaled[supports.body])
    rest = np.einsum("nks,ns->nk", supports.frame, missed)
    moved = np.zeros((int(joints.stencil.nodes.max(initial=-1)) + 1, 2))
    here = supports.nodes < len(moved)
    moved[supports.nodes[here]] = rest[here]
    jump = joints.stencil.jump(moved) - ground
    # Both sides move with their bodies where their nodes are.
    for side, sign in enumerate((-1.0, 1.0)):
        body = joints.bodies[:, side]
        arm = joints.sides[:, side] - bodies.centre[body]
        turned = np.einsum("nkm,nm->nk", motions(arm, bodies.size), scaled[body])
        jump += sign * np.where(body[:, None] == GROUND, 0.0, turned)
    return scaled / [1.0, 1.0, bodies.size], rest, jump


#: Difference of direction, and of offset and gap over the structure's size, of one straight face.
COLLINEAR = 1e-6


@dataclass(frozen=True)
class Faces:
    """Straight faces between two bodies.

    Attributes:
        ends: Joint points at their two ends, shape (faces, 2); equal if there is one.
        law: Of the faces, with the strength of the whole face, N/m.
        of_point: Face of every joint point.
    """

    ends: npt.NDArray[np.int64]
    law: PointLaws
    of_point: npt.NDArray[np.int64]


def straight_faces(joints: Joints) -> Faces:
    """Faces: joint points grouped by bodies, law, strength and line."""
    law = joints.point_laws
    if len(joints.length) == 0:
        none = np.empty(0, dtype=np.int64)
        return Faces(none.reshape(0, 2), law, none)
    size = np.ptp(joints.position, axis=0).max() or 1.0
    offset = np.sum(joints.normal * (joints.position - joints.position[0]), axis=1) / size
    across = (joints.sides[:, 1] - joints.sides[:, 0]) / size
    line = np.column_stack([joints.normal, offset, across])
    line = np.round(line / COLLINEAR).astype(np.int64)
    bar = np.maximum(np.arange(len(law.strength)) - joints.joint_count, -1)  # each by itself
    crushes = np.unique(joints.crushes, return_inverse=True)[1]
    keys = np.column_stack([joints.bodies, joints.law, crushes, line, bar])
    face = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    order = np.lexsort((np.sum(joints.tangent * joints.position, axis=1), face))
    starts = np.flatnonzero(np.diff(face[order], prepend=-1))
    stops = np.append(starts[1:], len(order)) - 1
    ends = np.column_stack([order[starts], order[stops]])
    of_faces = law.at(ends[:, 0])
    strength = np.bincount(face, law.strength).astype(float)
    return Faces(ends, replace(of_faces, strength=strength), face)


def relative_motions(joints: Joints, bodies: RigidBodies, points: Indices, along: Array) -> Any:
    """Matrix that gives relative motions at joint points, second side less first, along directions.

    Each side moves where its nodes are (`Joints.sides`), as in B_N and B_T. Its transpose gives the
    generalised forces of unit forces there.

    Args:
        joints: All joint points.
        bodies: All bodies.
        points: Numbers of joint points.
        along: Directions at all joint points, shape (points, 2).

    Returns:
        Sparse, of shape (chosen points, 3 bodies); columns are the bodies' free motions.
    """
    from scipy.sparse import csr_matrix

    row, side = np.nonzero(joints.bodies[points] != GROUND)
    point = points[row]
    body = joints.bodies[point, side]
    sign = 2.0 * side - 1.0
    motion = motions(joints.sides[point, side] - bodies.centre[body], bodies.size)
    moved = sign[:, None] * np.einsum("nim,ni->nm", motion, along[point])
    moved = np.einsum("nmk,nm->nk", bodies.free[body], moved)
    columns = 3 * body[:, None] + np.arange(3)
    indices = np.repeat(row, 3), columns.ravel()
    return csr_matrix((moved.ravel(), indices), (len(points), 3 * len(bodies.centre)))


@dataclass(frozen=True)
class PlaceAtStrength:
    """End of a joint at its compressive strength.

    Attributes:
        position: m.
        group: Joint or foundation.
        length: Of the block of pressure, m.
        normal_force: N per metre of thickness.
    """

    position: tuple[float, float]
    group: str
    length: float
    normal_force: float


@dataclass(eq=False)
class Layout:
    """Numbers of nodes and joint points of a scene, with their places: what values there mean.

    A result has it in place of a discretisation, whose matrices are gone by then.

    Attributes:
        scene: What it is of.
        boundary: Facets of the blocks.
        supports: Held displacements.
        joints: Joint points.
        bodies: Rigid motions of the blocks, and resultants of the loads.
        warnings: What is legal and probably meant otherwise, for people.
        imposed: u_d, this rank's part in the supports' coordinates, m.
        node_body: Body of every node of this rank.
        arm: From the centre of its body to every node of this rank, m, shape (nodes, 2).
        points: Joint points whose values this rank has.
        first_node: Number of this rank's first node.
        size: Number of displacements on all ranks.
    """

    scene: Scene
    boundary: Boundary
    supports: Supports
    joints: Joints
    bodies: RigidBodies
    warnings: tuple[str, ...]
    imposed: Array
    node_body: Labels
    arm: Array
    points: Indices
    first_node: int
    size: int

    @property
    def layout(self) -> Layout:
        """These arrays alone."""
        new = Layout(**self.__getstate__())
        if "space" in vars(self):
            new.space = self.space
        return new

    def __getstate__(self) -> dict[str, Any]:
        """The arrays, without objects of dolfinx: these are made again when they are asked for."""
        return {item.name: getattr(self, item.name) for item in fields(Layout)}

    @cached_property
    def space(self) -> Any:
        """Displacement space; collective where it is made: when it is first asked for."""
        return displacement_space(self.scene)

    @cached_property
    def law(self) -> Law:
        """Stress by strain, as functions by cell; collective as `space`."""
        return stress_law(self.scene)

    @cached_property
    def centroid(self) -> Array:
        """Centre of area of every body, m, shape (bodies, 2): its place for people."""
        return self.boundary.centroids(self.bodies.centre)

    def centroid_motions(self, values: Array) -> Array:
        """Motions as of `block_motions`, with the displacement of the centroid. Collective."""
        motion = self.block_motions(values)
        arm = self.centroid - self.bodies.centre
        turned = motion[:, 2:] * np.column_stack([-arm[:, 1], arm[:, 0]])
        return np.column_stack([motion[:, :2] + turned, motion[:, 2]])

    def bodies_area(self) -> float:
        """Area of all bodies, m2."""
        return float(self.boundary.areas(self.bodies.centre).sum())

    def block_motions(self, values: Array) -> Array:
        """Mean displacement, m, and rotation, rad, of every body, shape (bodies, 3). Collective.

        `values` are this rank's displacements in the supports' coordinates.
        """
        u = self.cartesian(values)
        arm = self.arm
        turning = arm[:, 0] * u[:, 1] - arm[:, 1] * u[:, 0]
        columns = np.column_stack([np.ones(len(u)), np.sum(arm**2, axis=1), u, turning])
        sums = np.zeros((len(self.bodies.centre), 5))
        np.add.at(sums, self.node_body, columns)
        sums = self.scene.comm.allreduce(sums)
        return np.asarray(sums[:, 2:] / sums[:, [0, 0, 1]])

    def all_points(self, values: Array) -> Array:
        """Values of this rank's joint points (its rows) as those of all points, on all ranks."""
        everything = np.zeros(len(self.joints.length))
        everything[self.points] = values
        self.scene.comm.Allreduce(MPI.IN_PLACE, everything, MPI.SUM)
        return everything

    def with_imposed(self, state: State) -> State:
        """A state of the solvers with its displacements u in place of u - u_d, to write."""
        if not self.scene.dead.movement:
            return state
        u = state.displacement + self.imposed
        elastic = state.elastic + self.imposed
        return replace(state, displacement=u, elastic=elastic)

    def cartesian(self, values: Array) -> Array:
        """Displacements in x and y, shape (nodes, 2), of this rank's in supports' coordinates."""
        return self.supports.to_cartesian(values, self.first_node).reshape(-1, 2)

    def rigid_motion(self, motion: Array) -> Array:
        """Displacements, in supports' coordinates, of motions (a, b, c), shape (bodies, 3)."""
        per_unit = motions(self.arm, 1.0)
        u = np.einsum("nkm,nm->nk", per_unit, motion[self.node_body])
        return self.supports.to_supports(u.ravel(), self.first_node)
