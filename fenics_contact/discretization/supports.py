"""Fixed supports and rollers: which displacements are held, by how much, in which coordinates.

At a node on one straight roller the displacement along the normal is held, at a node on a fixed
support, or on rollers of two directions, all of it. Where the normal of a roller is not an axis,
the node's displacements are expressed along normal and tangent: u = Q u', with Q block diagonal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_contact.discretization.facets import Boundary
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array, Flags, Indices, Labels
from fenics_contact.geometry.planar_cells import SMOOTH_ANGLE
from fenics_contact.parallel import PETSc
from fenics_contact.scene.scene import Movement, Scene

#: Largest part of a movement by which supports that meet may contradict each other.
PRECISION = 1e-9


@dataclass(frozen=True)
class Supports:
    """Held displacements; on all ranks.

    Displacements and forces are this rank's part; `first` is the number of its first node.

    Attributes:
        nodes: Nodes with something held, ascending, shape (nodes,).
        frame: Q of those nodes, shape (nodes, 2, 2); columns are the new directions.
        held: Which of the new coordinates are held, shape (nodes, 2).
        body: Their bodies.
        points: Their coordinates, m, shape (nodes, 2).
        motion: Held displacements in x and y, m, zero along rollers, shape (nodes, 2).
    """

    nodes: Indices
    frame: Array
    held: Flags
    body: Labels
    points: Array
    motion: Array

    @property
    def _free_frame(self) -> Array:
        return self.frame * ~self.held[:, None, :]

    def free_directions(self, nodes: Indices) -> Array:
        """Derivatives du / du' at given nodes, zero for what is held, shape (nodes, 2, 2)."""
        return self._at(nodes, self._free_frame)

    def to_cartesian(self, values: Array, first: int) -> Array:
        """Displacements u = Q u'."""
        return self._times(self.frame, values, first)

    def to_supports(self, values: Array, first: int) -> Array:
        """Displacements u' = Q^T u."""
        return self._times(np.swapaxes(self.frame, 1, 2), values, first)

    def spread(self, motion: Array, owned: range) -> Array:
        """The displacements that a rank owns, of those of all held nodes, zero elsewhere, m."""
        first = owned.start // 2
        values = np.zeros((len(owned) // 2, 2))
        mine = (self.nodes >= first) & (self.nodes < first + len(values))
        values[self.nodes[mine] - first] = motion[mine]
        return self.to_supports(values.ravel(), first)

    def constrain_vector(self, values: Array, first: int) -> Array:
        """Forces Q^T f, with held entries zero."""
        return self._times(np.swapaxes(self._free_frame, 1, 2), values, first)

    def constrain_matrix(self, stiffness: PETSc.Mat) -> PETSc.Mat:
        """Q^T K Q, with held rows and columns set to the mean diagonal; uses up K."""
        start, end = stiffness.getOwnershipRange()
        if np.any(self.frame != np.eye(2)):  # some node's coordinates are turned
            nodes = np.arange(start // 2, end // 2, dtype=PETSc.IntType)
            csr = np.arange(len(nodes) + 1, dtype=PETSc.IntType), nodes, self._at(nodes, self.frame)
            turn = PETSc.Mat().createBAIJ(stiffness.getSizes(), 2, csr=csr, comm=stiffness.comm)
            cartesian = stiffness
            stiffness = stiffness.ptap(turn.convert("aij"))
            for matrix in (cartesian, turn):
                matrix.destroy()
        dofs = (2 * self.nodes[:, None] + np.arange(2))[self.held]
        mine = dofs[(dofs >= start) & (dofs < end)].astype(PETSc.IntType)
        diagonal = stiffness.getDiagonal()
        mean = diagonal.sum() / diagonal.getSize()
        diagonal.destroy()
        stiffness.zeroRowsColumns(mine, diag=mean)
        return stiffness

    def _times(self, blocks: Array, values: Array, first: int) -> Array:
        """Product with a block diagonal matrix that has given blocks at the supports' nodes."""
        u = values.reshape(-1, 2)
        at = self._at(first + np.arange(len(u)), blocks)
        return np.einsum("nij,nj->ni", at, u).ravel()

    def _at(self, nodes: Indices, blocks: Array) -> Array:
        """Blocks at given nodes, the unit matrix where there is no support."""
        found = np.tile(np.eye(2), (len(nodes), 1, 1))
        if len(self.nodes):
            where = np.minimum(np.searchsorted(self.nodes, nodes), len(self.nodes) - 1)
            here = self.nodes[where] == nodes
            found[here] = blocks[where[here]]
        return found


def find_supports(scene: Scene, boundary: Boundary) -> Supports:
    """What the scene's supports hold, at the nodes of their facets.

    Raises:
        InputError: If a facet belongs to two supports, or supports that meet move apart.
    """
    role = boundary.role(scene.supports)
    rows = np.flatnonzero(role >= 0)
    fixed = np.array([kind == "fixed" for kind in scene.supports.values()], bool)[role[rows]]
    normal = boundary.normal[rows]
    # Sum of n n^T over the facets of a node; a fixed support counts as all directions.
    gram = np.where(fixed[:, None, None], np.eye(2), normal[:, :, None] * normal[:, None, :])
    nodes, first, index = np.unique(boundary.nodes[rows], return_index=True, return_inverse=True)
    index = index.ravel()
    per_facet = boundary.nodes.shape[1]
    gram = np.repeat(gram, per_facet, axis=0)
    total = np.zeros((len(nodes), 2, 2))
    np.add.at(total, index, gram)
    body = np.repeat(boundary.body[rows], per_facet)[first]
    points = boundary.points[rows].reshape(-1, 2)[first]
    # The displacement of every node that all supports there agree with.
    motion = facet_motion(scene, boundary)[rows].reshape(-1, 2)
    force = np.zeros(points.shape)
    np.add.at(force, index, np.einsum("nij,nj->ni", gram, motion))
    common = np.einsum("nij,nj->ni", np.linalg.pinv(total, rcond=1e-12, hermitian=True), force)
    missed = np.abs(np.einsum("nij,nj->ni", gram, motion - common[index])).max(axis=1, initial=0.0)
    if missed.max(initial=0.0) > PRECISION * np.abs(motion).max(initial=0.0):
        x, y = np.round(points[index[np.argmax(missed)]], 9) + 0.0
        raise InputError(
            f"loads.dead.movement: supports that meet at ({x:g}, {y:g}) move apart; move them"
            " alike there, or leave an edge between them"
        )
    # Frames along the normals of nodes, and what is held in them.
    size, direction = np.linalg.eigh(total)
    # Two normals at an angle give the sizes 1 -+ cos(angle), ascending.
    both = size[:, 0] > np.tan(0.5 * SMOOTH_ANGLE) ** 2 * size[:, 1]
    normal = direction[:, :, 1]
    frame = np.stack([normal, np.column_stack([-normal[:, 1], normal[:, 0]])], axis=2)
    straight = both | (np.abs(normal).max(axis=1) > 1.0 - 1e-14)
    frame[straight] = np.eye(2)
    # In a turned frame the first direction is held, in x and y that of the normal.
    axis = np.where(straight, np.argmax(np.abs(normal), axis=1), 0)
    held = both[:, None] | (axis[:, None] == np.arange(2))
    in_frame = np.einsum("nji,nj->ni", frame, common) * held
    return Supports(nodes, frame, held, body, points, np.einsum("nij,nj->ni", frame, in_frame))


def facet_motion(scene: Scene, boundary: Boundary) -> Array:
    """Displacements of the nodes of facets with what supports them, m, shape of their points."""
    motion = np.zeros(boundary.points.shape)
    for name, movement in scene.dead.movement.items():
        mine = boundary.in_group(name)
        motion[mine] = displacements(movement, boundary, mine, boundary.points[mine])
    return motion


def displacements(movement: Movement, boundary: Boundary, edges: Flags, points: Array) -> Array:
    """Displacements of points that move with some facets, m, shape of the points."""
    middle = boundary.points[edges, :2].mean(axis=1)
    length = boundary.length[edges]
    arm = points - np.average(middle, axis=0, weights=length)
    turn = np.stack([-arm[..., 1], arm[..., 0]], axis=-1)
    return np.asarray(movement.displacement + np.radians(movement.rotation) * turn)
