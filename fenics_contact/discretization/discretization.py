"""A scene discretised, once; owner of every PETSc object."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from fenics_contact.discretization.contacts import glued_blocks
from fenics_contact.discretization.elasticity import (
    Elasticity,
    assemble,
    internal_forces,
    rigid_bodies,
    with_loads,
)
from fenics_contact.discretization.facets import collect_boundary
from fenics_contact.discretization.forms import compile_all
from fenics_contact.discretization.joints import find_joints, joint_operators
from fenics_contact.discretization.layout import (
    Layout,
    RigidBodies,
    check_held,
    ground_motion,
    imposed_motions,
    motions,
)
from fenics_contact.discretization.materials import displacement_space
from fenics_contact.discretization.soil import with_soil
from fenics_contact.discretization.supports import find_supports
from fenics_contact.discretization.ties import find_ties
from fenics_contact.discretization.warnings import warnings_on
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Flags
from fenics_contact.parallel import PETSc
from fenics_contact.scene.scene import Scene
from fenics_contact.search_options import SEARCH
from fenics_contact.solvers.block_modes import BlockModes, Blocks, modes, numbered_by_rank
from fenics_contact.solvers.effort import Effort, Tally, Watch
from fenics_contact.solvers.joint_stiffness import JointRows, JointStiffness
from fenics_contact.solvers.problem import Array, Closing, ContactProblem, Owner, Scales, SparseMap

#: Springs of closed joints in the bonded structure, in units of the mean diagonal of K.
BONDED_SPRING = 1e2

#: Springs between nodes that are glued, in the same unit.
GLUE = 1e3

#: Springs to ground at all nodes of bonded blocks that corners hold, in the same unit.
SOFT_GROUND = 1e-6

#: Cost of a factorisation of block modes, in units of one of the structure; measured.
MODE_COST = 0.2

#: Parts of a scene that no matrix depends on; of the laws the matrices know the groups.
LAWS = ("joints", "foundations")
WITHOUT_MATRICES = ("dead", "live", "floors", "title", "solve", "output")


@dataclass(frozen=True)
class Bonded:
    """Response of the structure with all joints closed.

    Attributes:
        dead: Displacements under the dead load, in the supports' coordinates.
        live: Those under the live load.
        dead_pressure: Normal forces under the dead load, N/m, at least 0.
        live_pressure: Those under the live load.
        seconds: Time to assemble, analyse, factor and solve: one bonded solve.
    """

    dead: Array
    live: Array
    dead_pressure: Array
    live_pressure: Array
    seconds: float


class Discretization(Layout, Closing):
    """Elasticity, joints and supports of a scene, and the operators made of them.

    Attributes:
        elasticity: K, f_D, f_L.
        operators: Rows of B_N and B_T.
        problem: What the solvers see; its displacements are u - u_d.
        effort: Cost of all factorisations, with its limit.
        tally: Counts factorisations of the structure.
        mode_tally: Counts those of its block modes.
        compile_seconds: Time to compile forms and laws, or to look them up, s.
        seconds: Time spent assembling, s.
    """

    def __init__(self, scene: Scene) -> None:
        """Discretise; raises `InputError` if joints, supports or loads do not fit the mesh."""
        start = time.perf_counter()
        compile_all(scene)
        self.compile_seconds = time.perf_counter() - start
        start = time.perf_counter()
        self.scene = scene
        self.space = space = displacement_space(scene)
        self.boundary = collect_boundary(scene.mesh, space)
        glued = any(law.glued for law in scene.joints.values())
        if glued:
            label = glued_blocks(scene, self.boundary)
            self.scene = scene = replace(scene, mesh=scene.mesh.with_glued(label))
            body = label[self.boundary.piece].astype(self.boundary.body.dtype)
            self.boundary = replace(self.boundary, body=body)
        self._find_joints(scene)
        self.elasticity = made = assemble(scene, space, self.boundary, self.supports)
        if glued:
            self._glue()
        self.node_body = made.node_body
        self.arm = made.arm
        self.law = made.law
        nodes = space.dofmap.index_map
        self.first_node = nodes.local_range[0]
        self.size = 2 * int(nodes.size_global)
        self.bodies = bodies = rigid_bodies(made, self.supports, self.boundary)
        closed = self.joints.without_ties()
        check_held(closed.bodies, closed.position, self.supports, bodies, scene.mesh.source)
        self.check_pushed(np.ones_like(bodies.floating))
        self.operators = rows = joint_operators(self.joints, self.supports, made.stiffness)
        self.points = rows.points
        self._owner = Owner()
        matrices = made.stiffness, rows.normal, rows.tangential, _rigid_motions(made, bodies)
        maps = [SparseMap(matrix) for matrix in matrices]
        for operator in maps:
            self._owner.callback(operator.close)
        stiffness, normal, tangential, rigid = maps
        law = self.joints.point_laws.at(self.points)
        loads = made.dead, made.live
        no_compliance = np.zeros((2, len(law.friction)))
        self.problem = ContactProblem(
            stiffness, *loads, normal, tangential, law, rigid, no_compliance
        )
        self._take_loads_and_laws()
        self.effort = Effort()
        self.tally = Tally(1.0, self.effort)
        self.mode_tally = Tally(MODE_COST, self.effort)
        self._stiffness: list[JointStiffness] = []  # shared by `with_`, once it is made
        self.seconds = time.perf_counter() - start

    def with_(self, *, scene: Scene | None = None, unbonded: Flags | None = None) -> Discretization:
        """Another structure that shares the matrices, which remain with this object.

        Args:
            scene: Another scene for which `shares_matrices`; factorisations are counted from 0.
            unbonded: Joint points that have lost their strengths.

        Raises:
            InputError: If loads do not fit the mesh.
        """
        start = time.perf_counter()
        new = Discretization.__new__(Discretization)
        vars(new).update(vars(self))
        if scene is not None:
            new.scene = scene
            new.compile_seconds = 0.0
            new._find_joints(scene)
            new.elasticity = with_loads(self.elasticity, scene, self.boundary, new.supports)
            new.bodies = rigid_bodies(new.elasticity, new.supports, self.boundary)
            new.check_pushed(np.ones_like(new.bodies.floating))
            for tally in (self.tally, self.mode_tally):
                tally.restart()
        if unbonded is not None:
            new.joints = replace(new.joints, unbonded=unbonded)
        new._take_loads_and_laws()
        if "block_modes" in vars(self):
            new.block_modes = self.block_modes.changed(new.problem)
        if scene is not None:
            new.seconds = time.perf_counter() - start
        return new

    def close(self) -> None:
        """Free the PETSc objects, on all ranks together."""
        super().close()
        # petsc4py keeps what was dropped elsewhere until all ranks free it together.
        PETSc.garbage_cleanup(self.scene.comm)

    def check_pushed(self, bodies: Flags | None = None) -> None:
        """Raise `InputError` if the live load pushes none of some bodies.

        By default none of those that supports do not hold; there no load may cancel, which strains
        blocks alone.
        """
        free = bodies is None
        bodies = self.bodies.floating if bodies is None else bodies
        for kind in ("dead", "live"):
            nodes = np.linalg.norm(getattr(self.elasticity, kind).reshape(-1, 2), axis=1)
            given = np.bincount(self.node_body, nodes, len(bodies))
            given = self.scene.comm.allreduce(given)[bodies]
            left = np.abs(getattr(self.bodies, kind)[bodies]).max(axis=1)
            if kind == "live" and not np.any(given):
                raise InputError(
                    "loads.live: the live load is zero on every free body; give it a body force on"
                    " blocks with density, or a traction"
                )
            if free and np.any(given) and np.all(left <= SEARCH.digits * given):
                raise InputError(f"loads.{kind}: what is given cancels on every free body")

    def shares_matrices(self, scene: Scene) -> bool:
        """Whether another scene differs in its laws, loads and options only."""

        def compared(name: str, value: Any) -> Any:
            if name in LAWS:  # gaps decide which facets face each other
                return [
                    (key, law.gap, law.glued, law.off, law.between) for key, law in value.items()
                ]
            if name == "ties":
                return [(key, tie.from_, tie.to, tie.ground) for key, tie in value.items()]
            return value

        names = {item.name for item in fields(scene)} - set(WITHOUT_MATRICES)
        both = {name: (getattr(self.scene, name), getattr(scene, name)) for name in names}
        return all(
            ours is other or (name != "mesh" and compared(name, ours) == compared(name, other))
            for name, (ours, other) in both.items()
        )

    def end_when(self, asked: Callable[[], str]) -> None:
        """End factorisations with `Stopped`, on all ranks, once `asked` says why on one of them."""
        self.effort.watch = Watch(self.scene.comm, asked)

    def factorizations(self) -> int:
        """Numeric factorisations so far, those of block modes among them."""
        return self.tally.count + self.mode_tally.count

    @property
    def stiffness(self) -> JointStiffness:
        """K with joint springs, made when first asked for."""
        if not self._stiffness:
            stiffness = self.stiffness_with(self.problem.stiffness)
            self._stiffness.append(self._owner.enter_context(stiffness))
        return self._stiffness[0]

    def stiffness_with(self, elastic: SparseMap) -> JointStiffness:
        """Another stiffness of the blocks with joint springs; the caller closes it."""
        made = self.operators
        # Ties may have many more nodes than joint points.
        first = int(np.searchsorted(made.points, self.joints.joint_count))
        parts = [
            JointRows.single(made.dofs[rows], made.normal_rows[rows], made.tangential_rows[rows])
            for rows in (slice(first), slice(first, None))
        ]
        return JointStiffness(elastic, parts, self.tally)

    def bonded(self) -> Bonded:
        """Solve with all joints closed, under the dead and under the live load."""
        start = time.perf_counter()
        problem = self.problem
        with ExitStack() as owner:
            stiffness = self.stiffness
            spring = np.full(problem.points, BONDED_SPRING * stiffness.mean_diagonal)
            if self.joints.corners:  # about which blocks may turn
                soft = SparseMap(problem.stiffness.matrix.copy())
                owner.callback(soft.close)
                soft.matrix.shift(SOFT_GROUND * stiffness.mean_diagonal)
                stiffness = owner.enter_context(self.stiffness_with(soft))
            factor = stiffness.factor(spring, spring / (1.0 + spring * problem.compliance[1]))
            # Movements of supports give typical sizes where they are all of the dead load.
            load = self.elasticity.dead
            origin = np.zeros_like(spring)
            if self.scene.dead.movement and problem.max(np.abs(load)) == 0.0:
                origin = problem.law.opening_origin
                slip = spring * problem.law.slip_origin
                load = problem.dead + problem.joint_forces(spring * origin, slip)
            dead, live = (factor.solve(each) for each in (load, problem.live))
        pressed = spring * (origin - problem.normal @ dead) + problem.law.bond
        of_dead = np.maximum(pressed, 0.0)
        of_live = np.maximum(-spring * (problem.normal @ live), 0.0)
        seconds = self.seconds + time.perf_counter() - start
        return Bonded(dead, live, of_dead, of_live, seconds)

    @cached_property
    def block_modes(self) -> BlockModes:
        """The structure whose blocks only move, stretch and bend; made when first asked for."""
        nodes = self.first_node + np.arange(len(self.arm))
        directions = self.supports.free_directions(nodes)
        shapes = np.einsum("nji,njk->nik", directions, modes(self.arm))
        count = len(self.bodies.centre)
        blocks = Blocks(self.node_body, self.points, self.joints.bodies, count)
        return self._owner.enter_context(BlockModes(self.problem, shapes, blocks))

    def _find_joints(self, scene: Scene) -> None:
        """Take the supports, joints and ties of a scene, and what is to be warned of."""
        self.supports = find_supports(scene, self.boundary)
        ties = with_soil(find_ties(scene, self.boundary, self.space), scene, self.boundary)
        self.joints = find_joints(scene, self.boundary, ties)
        self.warnings = warnings_on(scene, self.boundary, self.joints)

    def _glue(self) -> None:
        """Add stiff springs between the nodes of blocks that are glued to K."""
        inside = find_joints(self.scene, self.boundary, inside=True)
        held = np.isin(inside.stencil.nodes, self.supports.nodes).any(axis=(1, 2))
        if self.scene.dead.movement and np.any(held):
            x, y = np.round(inside.position[held][0], 9) + 0.0
            raise InputError(
                f"loads.dead.movement: at ({x:g}, {y:g}) a support holds a glued joint; draw the"
                " blocks there as one"
            )
        stiffness = self.elasticity.stiffness
        rows = joint_operators(inside, self.supports, stiffness)
        spring = GLUE * stiffness.getDiagonal().sum() / stiffness.getSize()[0]
        with Owner() as owner:
            for matrix in (rows.normal, rows.tangential):
                added = owner.own(owner.own(matrix).transposeMatMult(matrix))
                pattern = PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
                stiffness.axpy(spring, added, structure=pattern)

    def _take_loads_and_laws(self) -> None:
        """Take loads and laws into the problem, with initial gaps, strengths, supports that move.

        f_D' = f_D - K u_d - B_N^T t - B_T^T Y/2, and origins of openings and slips, as in
        `layout`, `joint_law` and `ties`.
        """
        joints = self.joints
        points = self.points
        law = joints.point_laws.at(points)
        dead = self.elasticity.dead
        self.imposed = np.zeros_like(dead)
        opening = -joints.gap[points]
        slip = joints.origin[points]
        if self.scene.dead.movement:
            ground = ground_motion(self.scene, self.boundary, joints)
            motion, held, jump = imposed_motions(self.supports, self.bodies, joints, ground)
            owned = range(*self.problem.stiffness.matrix.getOwnershipRange())
            rest = self.supports.spread(held, owned)
            self.imposed = self.rigid_motion(motion) + rest
            dead = dead - internal_forces(self.elasticity, self.supports, rest)
            opening = opening - np.sum(joints.normal * jump, axis=1)[points]
            slip = slip - np.sum(joints.tangent * jump, axis=1)[points]
        law = replace(law, opening_origin=opening, slip_origin=slip)
        if np.any(joints.bond > 0.0):
            dead = dead - self.problem.normal.T @ law.bond
        if joints.ties is not None:
            dead = dead - self.problem.tangential.T @ law.pull
        # Normal and tangential compliance of this rank's rows.
        give = np.stack([np.zeros(len(points)), joints.compliance[points]])
        live = self.elasticity.live
        self.problem = replace(self.problem, dead=dead, live=live, law=law, compliance=give)


def typical_sizes(problem: ContactProblem, bonded: Bonded) -> Scales:
    """Force, displacement and load factor typical of a structure.

    The load factor makes the live load's elastic energy in the bonded structure that of the dead
    load; where there is no dead load, its joint forces equal to the given strengths.
    """
    live_work = problem.dot(problem.live, bonded.live)
    dead_work = problem.dot(problem.dead, bonded.dead)
    if dead_work == 0.0:  # supports move
        dead_work = problem.dot(problem.stiffness @ bonded.dead, bonded.dead)
    live_force = problem.max(bonded.live_pressure)
    if dead_work > 0.0:
        factor = float(np.sqrt(dead_work / live_work))
        force = problem.max(bonded.dead_pressure) or factor * live_force
    else:
        force = problem.max(problem.law.bound(problem.law.bond)) or live_force
        factor = force / live_force if live_force else 1.0
    displacement = factor * live_work / problem.sum(np.abs(problem.live))
    return Scales(displacement, force or 1.0, factor, displacement)


def _rigid_motions(elasticity: Elasticity, bodies: RigidBodies) -> PETSc.Mat:
    """Orthonormal rigid motions, as columns of a matrix, of the bodies that no support touches."""
    # Those that supports leave to other bodies may be free to some digits only.
    body = elasticity.node_body
    nodes = len(elasticity.arm)
    count = len(bodies.centre)
    comm = elasticity.stiffness.comm.tompi4py()
    motion = motions(elasticity.arm, bodies.size)  # about the mean of the nodes: orthogonal
    squares = np.zeros((count, 3))
    np.add.at(squares, body, np.sum(motion**2, axis=1))
    untouched = np.all(bodies.free == np.eye(3), axis=(1, 2))
    scale = untouched[:, None] / np.sqrt(comm.allreduce(squares))
    motion *= scale[body][:, None, :]
    number, mine = numbered_by_rank(comm, body, count)
    sizes = (2 * nodes, PETSc.DETERMINE), (3 * len(mine), 3 * count)
    columns = np.repeat(3 * number[body][:, None] + np.arange(3), 2, axis=0)
    csr = [a.astype(PETSc.IntType) for a in (3 * np.arange(2 * nodes + 1), columns.ravel())]
    return PETSc.Mat().createAIJ(sizes, csr=(*csr, motion.ravel()), comm=comm)
