"""UFL forms of linear elasticity.

    int_Omega sigma(u) : eps(v) dx = int_Omega rho b . v dx + int_Gamma t . v ds,
    sigma(u) = 2 mu eps(u) + lambda tr(eps(u)) I,

in plane strain, or in plane stress with lambda replaced by 2 lambda mu / (lambda + 2 mu)
(O.C. Zienkiewicz, R.L. Taylor, The Finite Element Method, vol. 1, 5th ed., section 4.2).
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from petsc4py import PETSc

from fenics_contact import compat
from fenics_contact.geometry.mesh import Labels

#: Lame's lambda (of the plane state) and mu by cell, Pa, or D by cell, row after row.
Law: TypeAlias = tuple[fem.Function, fem.Function] | fem.Function


def strain(u: Any) -> Any:
    """eps(u) = sym grad u."""
    return ufl.sym(ufl.grad(u))


def stress(u: Any, lame_lambda: Any, lame_mu: Any) -> Any:
    """sigma(u) in the plane, Pa."""
    return 2.0 * lame_mu * strain(u) + lame_lambda * ufl.tr(strain(u)) * ufl.Identity(2)


def stress_of(u: Any, law: Law) -> Any:
    """sigma(u) of a law, Pa."""
    if isinstance(law, tuple):
        return stress(u, *law)
    e = strain(u)
    parts = e[0, 0], e[1, 1], 2.0 * e[0, 1]
    xx, yy, xy = (sum(law[3 * i + j] * parts[j] for j in range(3)) for i in range(3))
    return ufl.as_matrix([[xx, xy], [xy, yy]])


def stiffness(space: Any, law: Law) -> fem.Form:
    """Form of K."""
    u = ufl.TrialFunction(space)
    v = ufl.TestFunction(space)
    return fem.form(ufl.inner(stress_of(u, law), strain(v)) * ufl.dx)


def internal_forces(displacement: fem.Function, law: Law) -> fem.Form:
    """Form of the nodal forces K u of a displacement field."""
    v = ufl.TestFunction(displacement.function_space)
    return fem.form(ufl.inner(stress_of(displacement, law), strain(v)) * ufl.dx)


class BodyLoad:
    """Nodal forces of accelerations times a density: one form for all of them.

    Attributes:
        density: By cell, kg/m3.
    """

    def __init__(self, space: Any, density: fem.Function) -> None:
        """Make the form."""
        self.density = density
        self._force = fem.Constant(space.mesh, PETSc.ScalarType((0.0, 0.0)))
        v = ufl.TestFunction(space)
        self._form = fem.form(density * ufl.inner(self._force, v) * ufl.dx)

    def form(self, acceleration: tuple[float, float]) -> fem.Form:
        """The form with an acceleration, m/s2, until it is asked for another one."""
        self._force.value = acceleration
        return self._form


def edge_load(space: Any, facets: Labels, traction: tuple[float, float]) -> fem.Form:
    """Form of the nodal forces of a traction, Pa, on rising local facets."""
    tags = dolfinx_mesh.meshtags(space.mesh, 1, facets, np.ones(len(facets), dtype=np.int32))
    ds = ufl.Measure("ds", domain=space.mesh, subdomain_data=tags)
    force = fem.Constant(space.mesh, PETSc.ScalarType(traction))
    return fem.form(ufl.inner(force, ufl.TestFunction(space)) * ds(1))


def stress_expression(
    displacement: fem.Function, law: Law, plane: str
) -> tuple[fem.Expression, Any]:
    """sigma_xx, sigma_yy, sigma_xy and von Mises stress at the cells' centres, Pa; their space.

    Von Mises is with the stress out of the plane, nu (sigma_x + sigma_y) in plane strain and zero
    in plane stress. A law of the user does not know it: there is no von Mises stress then.
    """
    sigma = stress_of(displacement, law)
    domain = displacement.function_space.mesh
    xx = sigma[0, 0]
    yy = sigma[1, 1]
    xy = sigma[0, 1]
    if not isinstance(law, tuple):
        space = compat.function_space(domain, "DG", 0, (3,))
        in_plane = ufl.as_vector([xx, yy, xy])
        return fem.Expression(in_plane, compat.interpolation_points(space)), space
    out_of_plane = ufl.as_ufl(0.0)
    if plane == "strain":
        out_of_plane = law[0] / (2.0 * (law[0] + law[1])) * ufl.tr(sigma)
    deviator = ufl.dev(ufl.as_matrix([[xx, xy, 0.0], [xy, yy, 0.0], [0.0, 0.0, out_of_plane]]))
    components = ufl.as_vector([xx, yy, xy, ufl.sqrt(1.5 * ufl.inner(deviator, deviator))])
    space = compat.function_space(domain, "DG", 0, (4,))
    return fem.Expression(components, compat.interpolation_points(space)), space
