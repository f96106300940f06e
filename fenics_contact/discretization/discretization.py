"""A scene discretised: everything volumetric, done once."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from fenics_contact.solvers.block_modes import BlockModes, modes
from fenics_contact.discretization.facets import Boundary, collect_boundary
from fenics_contact.discretization.elasticity import Elasticity, assemble, displacement_space
from fenics_contact.errors import InputError
from fenics_contact.discretization.joints import JointOperators, Joints, find_joints, joint_operators
from fenics_contact.solvers.problem import ContactProblem
from fenics_contact.discretization.rigid_motions import (
    RigidBodies,
    check_held,
    motions,
    numbered_by_rank,
    rigid_bodies,
)
from fenics_contact.scene import Scene
from fenics_contact.solvers.joint_stiffness import JointRows, SpringStiffness
from fenics_contact.discretization.supports import Supports, find_supports

#: Springs of closed joints in the bonded structure, in units of the mean diagonal of K.
BONDED_SPRING = 1e2


@dataclass(frozen=True)
class Bonded:
    """Response of the structure with all joints closed.

    Attributes:
        dead: Displacements under the dead load, in the supports' coordinates.
        live: Displacements under the live load.
        dead_pressure: Normal forces at this rank's points under the dead load, N/m, at least 0.
        live_pressure: Likewise under the live load.
        seconds: Time to assemble, analyse, factor and solve: one bonded solve.
    """

    dead: PETSc.Vec
    live: PETSc.Vec
    dead_pressure: npt.NDArray[np.float64]
    live_pressure: npt.NDArray[np.float64]
    seconds: float


@dataclass(frozen=True)
class Structure:
    """Elasticity, joints and supports of a scene.

    Attributes:
        scene: What was discretised.
        boundary: Facets of the blocks.
        supports: What is held.
        elasticity: K, f_D, f_L.
        joints: Joint points.
        operators: B_N and B_T.
        bodies: Rigid motions of the blocks.
        problem: What the solvers see.
        springs: K with joint springs.
        seconds: Time spent assembling, s.
    """

    scene: Scene
    boundary: Boundary
    supports: Supports
    elasticity: Elasticity
    joints: Joints
    operators: JointOperators
    bodies: RigidBodies
    problem: ContactProblem
    springs: SpringStiffness
    seconds: float

    @classmethod
    def build(cls, scene: Scene) -> Structure:
        """Discretise a scene.

        Raises:
            InputError: If joints, supports or loads of the scene do not fit its mesh.
        """
        start = time.perf_counter()
        space = displacement_space(scene)
        boundary = collect_boundary(scene.mesh, space)
        supports = find_supports(scene, boundary)
        joints = find_joints(scene, boundary)
        elasticity = assemble(scene, space, boundary, supports)
        size = float(np.ptp(boundary.points.reshape(-1, 2), axis=0).max())
        bodies = rigid_bodies(
            elasticity.centre,
            elasticity.dead_resultant,
            elasticity.live_resultant,
            supports,
            size,
        )
        check_held(joints, supports, bodies, scene.mesh.source)
        _check_live_load(elasticity, bodies, scene)
        operators = joint_operators(joints, supports, elasticity.stiffness)
        problem = ContactProblem(
            elasticity.stiffness,
            _vector(elasticity, elasticity.dead),
            _vector(elasticity, elasticity.live),
            operators.normal,
            operators.tangential,
            joints.friction[operators.points],
            joints.shear_strength[operators.points],
            _rigid_motions(elasticity, bodies),
        )
        springs = SpringStiffness(elasticity.stiffness, JointRows.of(operators))
        seconds = time.perf_counter() - start
        return cls(
            scene,
            boundary,
            supports,
            elasticity,
            joints,
            operators,
            bodies,
            problem,
            springs,
            seconds,
        )

    def bonded(self, coupled: bool = False) -> Bonded:
        """Solve with all joints closed, under the dead and under the live load.

        Args:
            coupled: Whether springs with coupling follow, whose analysis then does for these too.
        """
        start = time.perf_counter()
        problem, springs = self.problem, self.springs
        spring = np.full(len(problem.friction), BONDED_SPRING * springs.mean_diagonal)
        springs.factor(spring, spring, np.zeros_like(spring) if coupled else None)
        opening = problem.normal.createVecLeft()
        responses, pressures = [], []
        for load in (problem.dead, problem.live):
            response = load.duplicate()
            springs.solve(load, response)
            problem.normal.mult(response, opening)
            responses.append(response)
            pressures.append(np.maximum(-spring * opening.array, 0.0))
        opening.destroy()
        seconds = self.seconds + time.perf_counter() - start
        return Bonded(responses[0], responses[1], pressures[0], pressures[1], seconds)

    def reversed(self) -> ContactProblem:
        """The problem with the live load reversed."""
        live = self.problem.live.copy()
        live.scale(-1.0)
        return replace(self.problem, live=live, slip_origin=np.zeros_like(self.problem.friction))

    @cached_property
    def block_modes(self) -> BlockModes:
        """The structure whose blocks only move, stretch and bend; made when first asked for."""
        nodes = self.problem.dead.getLocalSize() // 2
        first = self.problem.dead.getOwnershipRange()[0] // 2
        body = self.elasticity.node_body[:nodes]
        position = self.elasticity.space.tabulate_dof_coordinates()[:nodes, :2]
        directions = self.supports.free_directions(first + np.arange(nodes))
        shapes = np.einsum("nji,njk->nik", directions, modes(position - self.bodies.centre[body]))
        sides = self.joints.bodies[self.operators.points]
        return BlockModes.build(self.problem, shapes, body, len(self.bodies.centre), sides)

    @property
    def mode_factorizations(self) -> int:
        """Numeric factorisations of `block_modes` so far."""
        made = "block_modes" in self.__dict__
        return self.block_modes.factorizations if made else 0

    @property
    def factorizations(self) -> int:
        """Numeric factorisations so far, those of `block_modes` among them."""
        return self.springs.factorizations + self.mode_factorizations

    def bodies_area(self) -> float:
        """Area of all bodies, m2, from their boundary: 1/2 int x.n ds."""
        points = self.boundary.points[:, :2].mean(axis=1)
        flux = np.sum((points - points[0]) * self.boundary.normal, axis=1)
        return float(0.5 * np.sum(flux * self.boundary.length))

    def all_points(self, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Values of this rank's joint points (its rows) as those of all points, on all ranks."""
        everything = np.zeros(len(self.joints.length))
        everything[self.operators.points] = values
        self.scene.comm.Allreduce(MPI.IN_PLACE, everything, MPI.SUM)
        return everything

    def rigid_motion(self, motion: npt.NDArray[np.float64]) -> PETSc.Vec:
        """Displacements, in the supports' coordinates, of rigid motions (a, b, c) of the bodies.

        Args:
            motion: Shape (bodies, 3), about the bodies' centres.
        """
        vector = self.problem.dead.duplicate()
        nodes = vector.getLocalSize() // 2
        body = self.elasticity.node_body[:nodes]
        position = self.elasticity.space.tabulate_dof_coordinates()[:nodes, :2]
        arm = position - self.bodies.centre[body]
        spin = motion[body, 2:] * np.column_stack([-arm[:, 1], arm[:, 0]])
        first = vector.getOwnershipRange()[0] // 2
        vector.array[:] = self.supports.to_supports((motion[body, :2] + spin).ravel(), first)
        return vector

    def destroy(self) -> None:
        """Free the PETSc objects, which would otherwise be kept for long."""
        if "block_modes" in self.__dict__:
            self.block_modes.destroy()
        self.springs.destroy()
        problem = self.problem
        for item in (problem.stiffness, problem.normal, problem.tangential, problem.rigid):
            item.destroy()
        for vector in (problem.dead, problem.live):
            vector.destroy()


def _vector(elasticity: Elasticity, values: npt.NDArray[np.float64]) -> PETSc.Vec:
    vector = elasticity.stiffness.createVecRight()
    vector.array[:] = values
    return vector


def _rigid_motions(elasticity: Elasticity, bodies: RigidBodies) -> PETSc.Mat:
    """Orthonormal rigid motions of the bodies that no support touches as columns of a matrix.

    Those that supports leave to others may be free to some digits only.
    """
    nodes, count = len(elasticity.dead) // 2, len(bodies.centre)
    body = elasticity.node_body[:nodes]
    comm = elasticity.stiffness.comm.tompi4py()
    arm = elasticity.space.tabulate_dof_coordinates()[:nodes, :2] - bodies.centre[body]
    motion = motions(arm, bodies.size)  # about the mean of the nodes: orthogonal
    squares = np.zeros((count, 3))
    np.add.at(squares, body, np.sum(motion**2, axis=1))
    untouched = np.all(bodies.free == np.eye(3), axis=(1, 2))
    scale = untouched[:, None] / np.sqrt(comm.allreduce(squares))
    motion *= scale[body][:, None, :]
    number, mine = numbered_by_rank(comm, body, count)
    sizes = elasticity.stiffness.getSizes()[0], (3 * len(mine), 3 * count)
    columns = np.repeat(3 * number[body][:, None] + np.arange(3), 2, axis=0)
    csr = [a.astype(PETSc.IntType) for a in (3 * np.arange(2 * nodes + 1), columns.ravel())]
    return PETSc.Mat().createAIJ(sizes, csr=(*csr, motion.ravel()), comm=comm)


def _check_live_load(elasticity: Elasticity, bodies: RigidBodies, scene: Scene) -> None:
    """The live load must push some body that supports do not hold.

    Raises:
        InputError: If it does not.
    """
    force = np.abs(elasticity.live).reshape(-1, 2).max(axis=1)
    body = elasticity.node_body[: len(force)]
    pushed = np.zeros(len(bodies.centre))
    np.maximum.at(pushed, body, force)
    scene.comm.Allreduce(MPI.IN_PLACE, pushed, MPI.MAX)
    if not np.any(pushed[bodies.floating] > 0.0):
        raise InputError(
            "loads.live: the live load is zero on every free body; give it a body force on blocks"
            " with density, or a traction"
        )
