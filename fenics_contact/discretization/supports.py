"""Fixed supports and rollers: which displacements are held, and in which coordinates.

At a node on one straight roller the displacement along the normal is held, at a node on a fixed
support, or on rollers of two directions, all of it. Where the normal of a roller is not an axis,
the node's displacements are expressed along normal and tangent: u = Q u', with Q block diagonal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from fenics_contact.discretization.facets import Boundary
from fenics_contact.scene import Scene

#: Normals that differ by less than this angle are those of one (curved) boundary.
SMOOTH_ANGLE = np.radians(15.0)


@dataclass(frozen=True)
class Supports:
    """Held displacements; on all ranks.

    Attributes:
        nodes: Nodes with something held, ascending, shape (nodes,).
        frame: Q of those nodes: columns are the directions of the new coordinates, (nodes, 2, 2).
        held: Which of the new coordinates are held, shape (nodes, 2).
        body: Body of those nodes, shape (nodes,).
        points: Coordinates of those nodes, shape (nodes, 2), m.
    """

    nodes: npt.NDArray[np.int64]
    frame: npt.NDArray[np.float64]
    held: npt.NDArray[np.bool_]
    body: npt.NDArray[np.int32]
    points: npt.NDArray[np.float64]

    def free_directions(self, nodes: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        """Derivatives du / du' at given nodes, zero for what is held, shape (nodes, 2, 2)."""
        directions = np.tile(np.eye(2), (len(nodes), 1, 1))
        if len(self.nodes):
            where = np.minimum(np.searchsorted(self.nodes, nodes), len(self.nodes) - 1)
            found = self.nodes[where] == nodes
            directions[found] = (self.frame * ~self.held[:, None, :])[where[found]]
        return directions

    @property
    def inclined(self) -> bool:
        """Whether some node's coordinates are turned."""
        return bool(np.any(self.frame != np.eye(2)))

    def constrain_matrix(self, stiffness: PETSc.Mat) -> PETSc.Mat:
        """Q^T K Q with held rows and columns replaced by the mean diagonal of K."""
        if self.inclined:
            turn = self._turn(stiffness)
            stiffness = stiffness.ptap(turn)
            turn.destroy()
        diagonal = stiffness.getDiagonal()
        mean = diagonal.sum() / diagonal.getSize()
        diagonal.destroy()
        stiffness.zeroRowsColumns(self._held_dofs(stiffness.getOwnershipRange()), diag=mean)
        return stiffness

    def constrain_vector(self, vector: PETSc.Vec) -> None:
        """Replace f by Q^T f with held entries zero."""
        self._apply(vector, np.swapaxes(self.frame * ~self.held[:, None, :], 1, 2))

    def to_cartesian(self, vector: PETSc.Vec) -> None:
        """Replace u' by u = Q u'."""
        self._apply(vector, self.frame)

    def to_supports(self, u, first: int):
        """u' = Q^T u."""
        v = PETSc.Vec().createWithArray(u.copy(), comm=PETSc.COMM_WORLD); self._apply(v, np.swapaxes(self.frame, 1, 2)); return v.array.copy()

    def _apply(self, vector: PETSc.Vec, blocks: npt.NDArray[np.float64]) -> None:
        start, end = (bound // 2 for bound in vector.getOwnershipRange())
        mine = (self.nodes >= start) & (self.nodes < end)
        values = vector.array.reshape(-1, 2)
        rows = self.nodes[mine] - start
        values[rows] = np.einsum("nij,nj->ni", blocks[mine], values[rows])

    def _held_dofs(self, ownership: tuple[int, int]) -> npt.NDArray[np.int32]:
        dofs = (2 * self.nodes[:, None] + np.arange(2))[self.held]
        return dofs[(dofs >= ownership[0]) & (dofs < ownership[1])].astype(PETSc.IntType)

    def _turn(self, stiffness: PETSc.Mat) -> PETSc.Mat:
        start, end = stiffness.getOwnershipRange()
        blocks = np.tile(np.eye(2), ((end - start) // 2, 1, 1))
        mine = (self.nodes >= start // 2) & (self.nodes < end // 2)
        blocks[self.nodes[mine] - start // 2] = self.frame[mine]
        columns = np.repeat(np.arange(start, end).reshape(-1, 2), 2, axis=0)
        indptr = np.arange(0, 2 * (end - start) + 1, 2)
        csr = [a.astype(PETSc.IntType) for a in (indptr, columns.ravel())]
        turn = PETSc.Mat().createAIJ(
            stiffness.getSizes(), csr=(*csr, blocks.ravel()), comm=stiffness.comm
        )
        turn.assemble()
        return turn


def find_supports(scene: Scene, boundary: Boundary) -> Supports:
    """Collect what the scene's supports hold.

    Raises:
        InputError: If a facet belongs to two supports.
    """
    role = boundary.role(scene.supports)
    rows = np.flatnonzero(role >= 0)
    fixed = np.array([kind == "fixed" for kind in scene.supports.values()] + [False])[role[rows]]
    normal = boundary.normal[rows]
    # Sum of n n^T over the facets of a node; a fixed support counts as all directions.
    gram = np.where(fixed[:, None, None], np.eye(2), normal[:, :, None] * normal[:, None, :])
    per_facet = boundary.nodes.shape[1]
    nodes, first, index = np.unique(boundary.nodes[rows], return_index=True, return_inverse=True)
    total = np.zeros((len(nodes), 2, 2))
    np.add.at(total, index.ravel(), np.repeat(gram, per_facet, axis=0))
    frame, held = _principal_directions(total)
    return Supports(
        nodes=nodes,
        frame=frame,
        held=held,
        body=np.repeat(boundary.body[rows], per_facet)[first],
        points=boundary.points[rows].reshape(-1, 2)[first],
    )


def _principal_directions(
    gram: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    size, direction = np.linalg.eigh(gram)  # ascending; columns are directions
    # Two normals at an angle give the sizes 1 -+ cos(angle).
    both = size[:, 0] > np.tan(0.5 * SMOOTH_ANGLE) ** 2 * size[:, 1]
    normal = direction[:, :, 1]
    frame = np.stack([normal, np.column_stack([-normal[:, 1], normal[:, 0]])], axis=2)
    held = np.tile([True, False], (len(gram), 1))
    axis = np.argmax(np.abs(normal), axis=1)
    straight = both | (np.abs(normal).max(axis=1) > 1.0 - 1e-14)
    frame[straight] = np.eye(2)
    held[straight] = np.arange(2) == axis[straight, None]
    held[both] = True
    return frame, held
