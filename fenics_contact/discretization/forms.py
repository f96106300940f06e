"""UFL forms: of linear elasticity, of the loads that users give; their compilation.

    int_Omega sigma(u) : eps(v) dx = int_Omega rho b . v dx + int_Gamma t . v ds,
    sigma(u) = 2 mu eps(u) + lambda tr(eps(u)) I,

in plane strain, or in plane stress with lambda replaced by 2 lambda mu / (lambda + 2 mu)
(O.C. Zienkiewicz, R.L. Taylor, The Finite Element Method, vol. 1, 5th ed., section 4.2).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from fenics_contact import compat
from fenics_contact.discretization.facets import Boundary
from fenics_contact.errors import InputError, Vector, raised_together
from fenics_contact.geometry.mesh import BlockMesh, Labels, Names
from fenics_contact.lazily import dolfinx_mesh, fem, ufl
from fenics_contact.parallel import MPI, PETSc
from fenics_contact.scene.scene import LoadForm, Scene
from fenics_contact.solvers import compiled

#: Lame's lambda (of the plane state) and mu by cell, Pa, or D by cell, row after row.
Law: TypeAlias = Any  # fem.Function, or two of them


def strain(u: Any) -> Any:
    """eps(u) = sym grad u."""
    return ufl.sym(ufl.grad(u))


def stress(u: Any, lame_lambda: Any, lame_mu: Any) -> Any:
    """sigma(u) of displacements with two or three components, Pa."""
    return 2.0 * lame_mu * strain(u) + lame_lambda * ufl.tr(strain(u)) * ufl.Identity(len(u))


def voigt(dimension: int) -> list[tuple[int, int]]:
    """Places in a symmetric tensor of its components in a vector: the diagonal, then the others."""
    every = range(dimension)
    return [(i, i) for i in every] + [(i, j) for i in every for j in every if i < j]


def symmetric(parts: Sequence[Any], dimension: int) -> Any:
    """Symmetric tensor of UFL from its components in a vector, see `voigt`."""
    every = range(dimension)
    known = dict(zip(voigt(dimension), parts, strict=True))
    return ufl.as_matrix([[known[min(i, j), max(i, j)] for j in every] for i in every])


def stress_of(u: Any, law: Law) -> Any:
    """sigma(u) of a law, Pa."""
    if isinstance(law, tuple):
        return stress(u, *law)
    e = strain(u)
    parts = [(1.0 if i == j else 2.0) * e[i, j] for i, j in voigt(len(u))]
    count = len(parts)
    sums = [sum(law[count * k + n] * parts[n] for n in range(count)) for k in range(count)]
    return symmetric(sums, len(u))


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
        self._force = fem.Constant(space.mesh, PETSc.ScalarType((0.0,) * space.mesh.geometry.dim))
        v = ufl.TestFunction(space)
        self._form = fem.form(density * ufl.inner(self._force, v) * ufl.dx)

    def form(self, acceleration: Vector) -> fem.Form:
        """The form with an acceleration, m/s2, until it is asked for another one."""
        self._force.value = acceleration
        return self._form


def edge_load(space: Any, facets: Labels, traction: Vector) -> fem.Form:
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


#: What nothing is solved without.
NO_COMPILER = (
    "the forms of dolfinx and the laws of joints cannot be compiled; install a C compiler, for"
    " instance by apt install gcc python3-dev or conda install c-compiler"
)

#: Corners of a cell in gmsh's order, by the cell's name.
_CORNERS = {"triangle": [(0, 0), (1, 0), (0, 1)], "quadrilateral": [(0, 0), (1, 0), (1, 1), (0, 1)]}


def compile_all(scene: Scene) -> None:
    """Compile all forms and the laws, so that later work finds them in the cache; on all ranks.

    The compiler prints nothing. What an earlier run compiled is only looked up.

    Raises:
        InputError: On all ranks, if one of them cannot compile them.
    """
    cell = scene.mesh.domain.topology.cell_type.name
    special = bool(scene.dead.movement), scene.stress is not None
    in_turns(scene.comm, lambda: _compile(cell, scene.degree, scene.plane, special))


def in_turns(comm: MPI.Comm, compile_here: Callable[[], None]) -> None:
    """Compile on rank 0, then on the others: ranks that share a cache do not write it together.

    Raises:
        InputError: On all ranks, with the reason of the first that failed.
    """
    with raised_together(comm):
        reason = ""
        for turn in (True, False):
            if turn == (comm.rank == 0):
                try:
                    compile_here()
                except Exception as error:  # compilers and what is around them fail in many ways
                    reason = " ".join(str(error).split()) or type(error).__name__
            comm.barrier()
        if reason:
            raise InputError(f"{NO_COMPILER} ({reason})")


@cache
def _compile(cell: str, degree: int, plane: str, special: tuple[bool, bool]) -> None:
    """Compile laws, and forms for a mesh of one cell: code does not depend on the mesh.

    `special` is whether supports move, and whether the stress law is the user's.
    """
    moved, given = special
    corners = np.array(_CORNERS[cell], dtype=float)
    cells = np.arange(len(corners))[None, :]
    here = compat.Partition.to(np.zeros(1, dtype=np.int32))
    with compat.quiet_compiler(), compat.form_cache() as folder:
        compiled.load(folder)
        domain, _ = compat.create_mesh(MPI.COMM_SELF, cell, cells, corners, here)
        domain.topology.create_connectivity(1, 2)
        space = compat.function_space(domain, "Lagrange", degree, (2,))
        by_cell = compat.function_space(domain, "DG", 0)
        density, first, second = (fem.Function(by_cell) for _ in range(3))
        law: Law = first, second
        if given:
            law = fem.Function(compat.function_space(domain, "DG", 0, (9,)))
        stiffness(space, law)
        if moved:
            internal_forces(fem.Function(space), law)
        BodyLoad(space, density)
        edge_load(space, np.zeros(1, dtype=np.int32), (0.0, 0.0))
        stress_expression(fem.Function(space), law, plane)


@dataclass(frozen=True)
class Groups:
    """Groups that a measure knows by name.

    Attributes:
        measure: "dx" or "ds".
        sets: Sets of group names; the measure's numbers are indices into them.
        names: All names.
        interior: Number of facets inside blocks, by name.
    """

    measure: str
    sets: tuple[Names, ...]
    names: tuple[str, ...]
    interior: Mapping[str, int]

    def numbers(self, name: Any) -> set[int]:
        """The measure's numbers of a group.

        Raises:
            InputError: If there is no such group, or facets of it are inside blocks.
        """
        place = f"{self.measure}({name!r})"
        if name not in self.names:
            known = ", ".join(map(repr, self.names)) or "none"
            raise InputError(f"{place} is over no group; give one of the names {known}")
        if name in self.interior:
            count = self.interior[name]
            raise InputError(f"{place}: {count} facets of the group lie inside a block, not at one")
        return {number for number, names in enumerate(self.sets) if name in names}


def measures(mesh: BlockMesh, boundary: Boundary) -> tuple[Any, Any]:
    """Dx over the blocks and ds over their edges, joints among these, with names of groups."""
    from fenics_contact.discretization.group_measure import GroupMeasure

    domain = mesh.domain
    cells = np.arange(len(mesh.cell_groups), dtype=np.int32)
    order = np.argsort(boundary.local_facets)
    groups = boundary.groups[boundary.local][order]
    facets = boundary.local_facets[order][groups >= 0]

    def measure(kind: str, dim: int, entities: Labels, numbers: Labels, groups: Groups) -> Any:
        tags = dolfinx_mesh.meshtags(domain, dim, entities, numbers)
        return GroupMeasure(ufl.Measure(kind, domain=domain, subdomain_data=tags), groups)

    of_cells = Groups("dx", mesh.cell_sets, mesh.cell_names, {})
    of_facets = Groups("ds", mesh.facet_sets, mesh.facet_names, boundary.interior)
    dx = measure("dx", 2, cells, mesh.cell_groups, of_cells)
    return dx, measure("ds", 1, facets, groups[groups >= 0], of_facets)


def given_load(
    mesh: BlockMesh, space: Any, boundary: Boundary, give: LoadForm, key: str
) -> fem.Form | None:
    """Compiled form of a load; None if it is zero. Collective.

    Raises:
        InputError: On all ranks, if the function fails, or its form is no load of these blocks;
            `key` names the load.
    """
    form: Any = None
    with raised_together(mesh.comm):
        v = ufl.TestFunction(space)
        dx, ds = measures(mesh, boundary)
        try:
            form = give(v, dx, ds)
        except Exception as error:  # of a function of the user
            raise InputError(f"{key}: {_told(error)}") from error
        form = _checked(form, v, (dx, ds), key)
    if form.empty():
        return None
    # dolfinx compiles on rank 0, while the others wait.
    cache = compat.form_cache() if mesh.comm.rank == 0 else nullcontext()
    try:
        with compat.quiet_compiler(), cache:
            return fem.form(form)
    except RuntimeError as error:
        raise InputError(f"{key}: the form cannot be compiled: {error}") from error


def _told(error: Exception) -> str:
    """An error with the line of the user's function that it came from."""
    trace = error.__traceback__ and error.__traceback__.tb_next
    if isinstance(error, InputError) or trace is None:
        return str(error)
    file = Path(trace.tb_frame.f_code.co_filename).name
    return f"{type(error).__name__} in line {trace.tb_lineno} of {file}: {error}"


def _checked(form: Any, v: Any, known: tuple[ufl.Measure, ...], key: str) -> ufl.Form:
    """A linear form on the blocks, without integrals of zero; refuses what is none."""
    if not isinstance(form, ufl.Form):
        example = "ufl.inner(traction, v) * ds('back')"
        raise InputError(f"{key} returned a {type(form).__name__}; return a form such as {example}")
    form = ufl.Form(
        [one for one in form.integrals() if not isinstance(one.integrand(), ufl.constantvalue.Zero)]
    )
    # No other measures than those that are known, and no other meshes.
    tags = {measure.integral_type(): measure.subdomain_data() for measure in known}
    for integral in form.integrals():
        kind = integral.integral_type()
        data = integral.subdomain_data()
        everywhere = data is None and integral.subdomain_id() == "everywhere"
        if kind not in tags or not (everywhere or data is tags[kind]):
            raise InputError(f"{key} has a measure of its own; use dx and ds, which it is given")
        used = {integral.ufl_domain()}
        for terminal in ufl.corealg.traversal.traverse_unique_terminals(integral.integrand()):
            used.update(ufl.domain.extract_domains(terminal))
        if used != {known[0].ufl_domain()}:
            raise InputError(
                f"{key} uses another mesh than that of its blocks, scene.mesh.domain; take it from"
                " the measure, dx.ufl_domain()"
            )
    problem = f"{key} must be linear in the test function v that it is given"
    # The last one is no Exception in newer versions of UFL.
    refused = Exception, ufl.algorithms.check_arities.ArityMismatch
    try:
        arguments = form.arguments()
        if not form.empty():
            ufl.algorithms.compute_form_data(form)
    except refused as error:
        raise InputError(f"{problem}: {error}") from error
    if arguments != (v,) and not form.empty():
        raise InputError(f"{problem}, and in no other; it has {len(arguments)} arguments")
    return form
