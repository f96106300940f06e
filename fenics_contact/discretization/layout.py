"""Blocks, joints and supports of a scene as arrays: what values by node and by joint point mean.

A result has its scene's layout in place of a discretisation, whose matrices are gone by then.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact.discretization.facets import Boundary
from fenics_contact.discretization.forms import Law
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.materials import displacement_space, stress_law
from fenics_contact.discretization.rigid_motions import RigidBodies, motions
from fenics_contact.discretization.supports import Supports
from fenics_contact.geometry.mesh import Array, Indices, Labels
from fenics_contact.scene.scene import Scene
from fenics_contact.solvers.problem import State


@dataclass(eq=False)
class Layout:
    """Numbers of nodes and joint points of a scene, with their places; nothing changes it.

    Attributes:
        scene: What it is of.
        boundary: Facets of the blocks.
        supports: Held displacements.
        joints: Joint points.
        bodies: Rigid motions of the blocks, and resultants of the loads.
        warnings: What is legal and probably meant otherwise, for people.
        imposed: u_d of `rigid_motions`, this rank's part in the supports' coordinates, m.
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
        new = Layout(**{item.name: getattr(self, item.name) for item in fields(Layout)})
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
