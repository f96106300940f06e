"""Linear elasticity of a block by UFL, on tetrahedra, under forces that balance each other.

    K u = g,   R^T g = 0,

R the rigid motions, with R^T M R = 1, M the mass matrix of a density of 1. They are the kernel of
K: u is that displacement of which R^T M u = 0. What misses balance, the residual of contact forces
and what moves them onto the sides of the mesh, is spread as a body force: g - M R R^T g (inertia
relief).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.discretization import forms
from fenics_contact.faces.system import ORDERING
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.lazily import fem, fem_petsc, ufl
from fenics_contact.parallel import MPI

#: Corners of a tetrahedron that are those of its sides.
SIDES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])


class ElasticBody:
    """A meshed block with its stiffness.

    Attributes:
        points: Corners of cells, m, shape (points, 3).
        cells: Numbers of these, shape (cells, 4).
        nodes: Of displacements, m, shape (nodes, 3).
        stiffness: K, N/m, sparse, shape (3 nodes, 3 nodes).
        mass: M, m3, sparse, of this shape.
        rigid: R, rigid motions with R^T M R = 1, shape (3 nodes, 6).
    """

    def __init__(
        self, points: Array, cells: Indices, law: Callable[[Any], Any], degree: int = 2
    ) -> None:
        """Assemble K and M.

        Args:
            points: Corners of tetrahedra, m, shape (points, 3).
            cells: Numbers of these, shape (cells, 4).
            law: Gives the law of a mesh, see `forms.Law`.
            degree: Of displacements, 1 or 2.
        """
        here = compat.Partition.to(np.zeros(len(cells), dtype=np.int32))
        given = cells.astype(np.int64), points, here
        with compat.quiet_compiler(), compat.form_cache():
            domain, _ = compat.create_mesh(MPI.COMM_SELF, "tetrahedron", *given)
            space = compat.function_space(domain, "Lagrange", degree, (3,))
        self._law = law(domain)  # which may compile something, too
        with compat.quiet_compiler(), compat.form_cache():
            u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
            mass = fem.form(ufl.inner(u, v) * ufl.dx)
            self.stiffness = _assembled(forms.stiffness(space, self._law))
            self.mass = _assembled(mass)
            self._set_stresses(space)
        self.points = np.array(domain.geometry.x)
        self.cells = compat.geometry_dofs(domain).astype(np.int64)
        self.nodes = np.array(space.tabulate_dof_coordinates())
        self.cell_nodes = compat.cell_dofs(space).astype(np.int64)
        reference = compat.interpolation_points(space)
        self._at = np.column_stack([1.0 - reference.sum(axis=1), reference])  # barycentric
        corner = np.insert(self.points[self.cells], 0, 1.0, axis=2)
        self._inverse = np.linalg.inv(corner).transpose(0, 2, 1)
        weight = np.asarray(self.mass.sum(axis=1))[::3, 0]
        self.volume = float(weight.sum())
        self.centroid = weight @ self.nodes / self.volume
        self.arm = self.nodes - self.centroid
        turned = np.cross(np.eye(3), self.arm[:, None]).transpose(0, 2, 1)  # e_k x arm
        motions = np.hstack([np.tile(np.eye(3), (len(weight), 1)), turned.reshape(-1, 3)])
        gram = motions.T @ (self.mass @ motions)
        self.rigid = motions @ np.linalg.inv(np.linalg.cholesky(gram)).T

    @cached_property
    def surface(self) -> tuple[Indices, Indices, Array]:
        """Facets of the surface, counterclockwise from outside, their cells, and unit normals."""
        facets, cells = surface_of(self.points, self.cells)
        a, b, c = self.points[facets].transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        return facets, cells, normal / np.linalg.norm(normal, axis=1)[:, None]

    def shape_functions(self, cells: Indices, places: Array) -> Array:
        """Values of the shape functions of cells, also beyond these, shape (places, cell's nodes).

        Args:
            cells: One for each place.
            places: m, shape (places, 3).
        """
        part = np.einsum("pij,pj->pi", self._inverse[cells], np.insert(places, 0, 1.0, axis=1))
        first, second = self._at.argmax(axis=1), 3 - self._at[:, ::-1].argmax(axis=1)
        linear = part[:, first]  # l_a at corners; l_a (2 l_a - 1) there, 4 l_a l_b at edges
        if len(self._at) == 4:
            return np.asarray(linear)
        return np.where(first == second, 2.0 * linear - 1.0, 4.0 * part[:, second]) * linear

    def cell_at(self, place: Array) -> int:
        """The cell that a place is in, or nearest to."""
        return int(np.argmax((self._inverse @ [1.0, *place]).min(axis=1)))

    def of_body(self, moments: Array) -> Array:
        """Forces at nodes, N, shape (nodes, 3), of a body force c + y G.

        Args:
            moments: Its sum, N, and those of y F^T about the centroid, N m, shape (4, 3).
        """
        affine = np.kron(np.insert(self.arm, 0, 1.0, axis=1), np.eye(3))
        forces = self.mass @ affine
        field = np.linalg.solve(affine.T @ forces, moments.ravel())
        return np.asarray(forces @ field).reshape(-1, 3)

    def balanced(self, force: Array) -> Array:
        """Forces at nodes, shape (3 nodes, .), less the body force that balances them."""
        return np.asarray(force - self.mass @ (self.rigid @ (self.rigid.T @ force)))

    def displacements(self, force: Array) -> Array:
        """u, m, shape (3 nodes, .), under forces that balance, N, of this shape."""
        u = np.zeros_like(force)
        free, factor = self._factor
        for _ in range(2):  # the second time of what is left by rounding
            u[free] += factor.solve((force - self.stiffness @ u)[free])
        return np.asarray(u - self.rigid @ (self.rigid.T @ (self.mass @ u)))

    @cached_property
    def _factor(self) -> tuple[Indices, Any]:
        """Displacements left when six are held, which hold the body, and the factor of their K."""
        from scipy.linalg import qr
        from scipy.sparse.linalg import splu

        held = qr(self.rigid.T, mode="r", pivoting=True)[1][:6]
        free = np.setdiff1d(np.arange(len(self.rigid)), held)
        matrix = self.stiffness[free][:, free].tocsc()
        return free, splu(matrix, ORDERING, 0.0, options={"SymmetricMode": True})

    def _set_stresses(self, space: Any) -> None:
        """Prepare the stresses of a displacement, which are linear in cells at most."""
        self._u = fem.Function(space)
        sigma = forms.stress_of(self._u, self._law)
        rows = ufl.as_vector([sigma[place] for place in np.ndindex(3, 3)])
        of_cells = compat.function_space(space.mesh, "DG", 1, (9,))
        self._sigma = fem.Function(of_cells)
        self._stress = fem.Expression(rows, compat.interpolation_points(of_cells))

    def stresses(self, displacement: Array) -> Array:
        """Stresses at the points, means of those of the cells, Pa, shape (points, 3, 3).

        Args:
            displacement: u, m, shape (3 nodes,).
        """
        self._u.x.array[:] = displacement
        self._sigma.interpolate(self._stress)
        at_corners = compat.cell_dofs(self._sigma.function_space)
        values = self._sigma.x.array.reshape(-1, 9)[at_corners]
        return self.at_points(values).reshape(-1, 3, 3)

    def at_points(self, values: Array) -> Array:
        """Means of the cells' values at points, shape (points, v), from (cells, 4, v)."""
        sums = np.zeros((len(self.points), values.shape[2]))
        np.add.at(sums, self.cells, values)
        return np.asarray(sums / np.bincount(self.cells.ravel())[:, None])


def surface_of(points: Array, cells: Indices) -> tuple[Indices, Indices]:
    """Facets that are of one tetrahedron alone, counterclockwise from outside, and their cells."""
    facets = cells[:, SIDES].reshape(-1, 3)
    _, first, count = np.unique(
        np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
    )
    outer = first[count == 1]
    edges = points[facets[outer]] - points[cells.ravel()[outer]][:, None]  # from opposite corners
    turned = np.linalg.det(edges) < 0.0
    return np.where(turned[:, None], facets[outer][:, ::-1], facets[outer]), outer // 4


def _assembled(form: Any) -> Any:
    """A matrix in scipy's rows."""
    from scipy.sparse import csr_matrix

    matrix = fem_petsc.assemble_matrix(form)
    matrix.assemble()
    found = csr_matrix(matrix.getValuesCSR()[::-1], matrix.getSize())
    matrix.destroy()
    return found
