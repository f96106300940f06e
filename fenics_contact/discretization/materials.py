"""Materials by cell: densities, Lame's numbers, stress laws of users; the displacement space.

A law of a user is sigma = D eps, with a matrix D for every material or for every cell. It is asked
at three unit strains, and at a fourth whether it is linear. From D follow what else depends on
elasticity: the mean shear modulus, and the compliance of hinges. In a wedge under a force F at its
apex the stress is radial in every homogeneous material (S.G. Lekhnitskii, Anisotropic Plates
(1968)),

    sigma_r = E(t) a . n(t) / r,   F = -G a,   G = int E(t) n n^T dt over the wedge,

with n(t) along the radius and 1 / E(t) = q^T D^-1 q, q = (n_x^2, n_y^2, n_x n_y). The energy
between two radii of ratio 2 is 1/2 ln 2 F^T G^-1 F: a halving has the compliance C = ln 2 G^-1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.discretization.forms import Law, symmetric, voigt
from fenics_contact.errors import InputError, raised_together
from fenics_contact.geometry.mesh import Array, Labels
from fenics_contact.lazily import fem, ufl
from fenics_contact.parallel import MPI
from fenics_contact.scene.scene import Material, Scene, StressLaw

#: Points of Gauss' rule over a wedge: E(t) may change a hundredfold.
POINTS = 96
#: By how much a law may miss linearity and symmetry, relative: rounding.
ROUNDING = 1e-9
#: Strains at which a law is asked, by dimension: those of 1 alone, and one of all components.
MIXED = (1.0, -2.0, 3.0, -4.0, 5.0, -6.0)
STRAINS = {d: np.vstack([np.eye(n), MIXED[:n]]) for d, n in ((2, 3), (3, 6))}
#: Of messages: whose law it is.
OF = "stress: the law of material '{}'"
#: Of messages: what a function must give.
FAILS = (
    "fails: it must give a symmetric {0} x {0} UFL tensor of (strain, material), or of (strain,"
    " material, x) where it depends on the place x"
)


def asked(law: StressLaw, material: Material, name: str, place: Any, dimension: int = 2) -> Any:
    """Stresses of a material at `STRAINS` as a UFL vector, tensor after tensor, row after row.

    Args:
        law: That of the user; one with a third parameter gets the place.
        material: What it is asked for.
        name: The material's, for messages.
        place: The place in the blocks as UFL has it, m; None: the law must not ask for it.
        dimension: 2 or 3.

    Raises:
        InputError: If the law fails, or gives no tensors.
    """
    try:
        more = () if place is None or compat.arguments_of(law) < 3 else (place,)
        shape = dimension, dimension
        halved = [1.0 if i == j else 0.5 for i, j in voigt(dimension)]
        strains = [symmetric((halved * parts).tolist(), dimension) for parts in STRAINS[dimension]]
        tensors = [law(strain, material, *more) for strain in strains]
        for sigma in tensors:
            if ufl.shape(sigma) != shape:
                raise ValueError(f"it has the shape {ufl.shape(sigma)}")
        return ufl.as_vector([sigma[place] for sigma in tensors for place in np.ndindex(shape)])
    except Exception as error:  # of a function of the user
        fails = FAILS.format(dimension)
        raise InputError(f"{OF.format(name)} {fails} ({type(error).__name__}: {error})") from error


def checked_matrices(stresses: Array, name: str, places: Array | None = None) -> Array:
    """D, Pa, from values of `asked`: (s_xx, s_yy, s_xy) = D (e_xx, e_yy, 2 e_xy), see `voigt`.

    Args:
        stresses: Shape (cells, 16); in space (cells, 63).
        name: The material's, for messages.
        places: The cells' centres, m, shape (cells, d); None where the law is one for all.

    Returns:
        Shape (cells, 3, 3); in space (cells, 6, 6).

    Raises:
        InputError: If the law is not that of a linear elastic material.
    """

    def refuse(wrong: Array, words: str, told: Array | None = None) -> None:
        if not np.any(wrong):
            return
        cell = int(np.argmax(wrong))
        matrix = "" if told is None else f": {told[cell].tolist()}"
        here = "" if places is None else f" at ({', '.join(f'{x:.6g}' for x in places[cell])})"
        raise InputError(f"{OF.format(name)} {words}{here}{matrix}")

    d = 2 if stresses.shape[1] == 16 else 3
    tensors = stresses.reshape(-1, len(STRAINS[d]), d, d)
    size = np.abs(tensors).max(axis=(1, 2, 3))
    refuse(~np.isfinite(size), "is not linear in the strain: it gives what is no finite number")
    apart = np.abs(tensors - np.swapaxes(tensors, 2, 3)).max(axis=(1, 2, 3))
    refuse(apart > ROUNDING * size, f"{FAILS.format(d)}, and it is not symmetric")
    stress = np.stack([tensors[..., i, j] for i, j in voigt(d)], axis=2)
    matrix = np.swapaxes(stress[:, :-1], 1, 2)
    apart = np.abs(stress[:, -1] - matrix @ STRAINS[d][-1]).max(axis=1)
    refuse(apart > ROUNDING * size, "is not linear in the strain")
    apart = np.abs(matrix - np.swapaxes(matrix, 1, 2)).max(axis=(1, 2))
    refuse(apart > ROUNDING * size, "has no energy: its matrix is not symmetric", matrix)
    least = np.linalg.eigvalsh(matrix)[:, 0]
    refuse(least <= ROUNDING * size, "is not stiff in every direction", matrix)
    return matrix


def mean_shear_modulus(matrix: Array) -> Array:
    """Shear modulus, mean over all directions, Pa, of matrices of shape (..., 3, 3)."""
    stretch = matrix[..., 0, 0] + matrix[..., 1, 1] - 2.0 * matrix[..., 0, 1]
    return np.asarray(0.125 * (stretch + 4.0 * matrix[..., 2, 2]))


def wedge_compliance(matrix: Array, angle: Array, bisector: Array) -> Array:
    """C of one halving at the apex of wedges, m per N/m, shape (wedges, 2, 2).

    Args:
        matrix: D, Pa, shape (wedges, 3, 3).
        angle: Interior angle, shape (wedges,).
        bisector: Unit vectors, shape (wedges, 2).
    """
    abscissa, weight = np.polynomial.legendre.leggauss(POINTS)
    middle = np.arctan2(bisector[:, 1], bisector[:, 0])
    direction = middle[:, None] + 0.5 * angle[:, None] * abscissa
    x = np.cos(direction)
    y = np.sin(direction)
    q = np.stack([x**2, y**2, x * y], axis=2)
    modulus = 1.0 / np.einsum("wti,wij,wtj->wt", q, np.linalg.inv(matrix), q)
    n = np.stack([x, y], axis=2)
    stiffness = np.einsum("w,t,wt,wti,wtj->wij", 0.5 * angle, weight, modulus, n, n)
    return np.asarray(np.log(2.0) * np.linalg.inv(stiffness))


def displacement_space(scene: Scene) -> Any:
    """Continuous displacements inside every block, of the scene's degree."""
    return compat.function_space(scene.mesh.domain, "Lagrange", scene.degree, (2,))


def stress_law(scene: Scene) -> Law:
    """Stress by strain in every cell, by the materials: Lame's numbers, or D. Collective."""
    if scene.stress:
        mesh = scene.mesh
        names = np.array([scene.material_name(groups) for groups in mesh.cell_sets])
        parts = mesh.domain, names, mesh.cell_groups, scene.materials
        return given_law(scene.stress, *parts, scene.comm)
    first = material_field(scene, lambda material: lame_numbers(material, scene.plane)[0])
    return first, material_field(scene, lambda m: lame_numbers(m, scene.plane)[1], first)


def lame_numbers(material: Material, plane: str = "strain") -> tuple[float, float]:
    """Lame's lambda, of the plane state, and mu, Pa; those of plane strain are those of space."""
    nu = material.poisson
    nus = 2.0 if plane == "strain" else 1.0
    first = material.young * nu / ((1.0 + nu) * (1.0 - nus * nu))
    return first, material.young / (2.0 * (1.0 + nu))


def given_law(
    law: StressLaw,
    domain: Any,
    names: Any,
    of_cell: Labels,
    materials: Mapping[str, Material],
    comm: MPI.Comm,
) -> fem.Function:
    """D of cells by a law of the user. Collective.

    Args:
        law: That of the user.
        domain: Mesh.
        names: Names of materials, all that any rank has, shape (names,).
        of_cell: Numbers of these in this rank's cells, shape (cells,).
        materials: By name.
        comm: Ranks of the mesh.

    Raises:
        InputError: On all ranks, if the law is not that of linear elastic materials.
    """
    d = domain.geometry.dim
    place = ufl.SpatialCoordinate(domain)
    with raised_together(comm):
        stresses = {str(n): asked(law, materials[n], n, place, d) for n in np.unique(names)}
        varies = {}
        for name, given in stresses.items():
            domains: set[Any] = set()
            for terminal in ufl.corealg.traversal.traverse_unique_terminals(given):
                domains.update(ufl.domain.extract_domains(terminal))
            if domains - {place.ufl_domain()}:
                raise InputError(
                    f"{OF.format(name)} uses another mesh than that of its blocks,"
                    " scene.mesh.domain; take the place from a third parameter,"
                    " (strain, material, x)"
                )
            varies[name] = bool(domains)
    size = len(voigt(d)) ** 2
    space = compat.function_space(domain, "DG", 0, (size,))
    rows = np.zeros((len(of_cell), size))
    for name, given in stresses.items():
        cells = names[of_cell] == name
        # The cells' centres tell where a law is refused.
        found = _in_cells(domain, comm, [*given, *place])[cells] if varies[name] else None
        with raised_together(comm):
            if found is not None:
                matrices = checked_matrices(found[:, :-d], name, found[:, -d:])
            else:
                try:
                    values = [float(part(())) for part in given]
                except Exception as error:  # of UFL, for what a user gave
                    told = f"{type(error).__name__}: {error}"
                    fails = FAILS.format(d)
                    raise InputError(f"{OF.format(name)} {fails} ({told})") from error
                matrices = checked_matrices(np.array([values]), name)
            rows[cells] = matrices.reshape(-1, size)
    field = fem.Function(space, name="law")
    field.x.array.reshape(-1, size)[compat.cell_dofs(space)[:, 0]] = rows
    return field


def _in_cells(domain: Any, comm: MPI.Comm, values: Sequence[Any]) -> Array:
    """UFL values at the centres of this rank's cells, shape (cells, values). Collective.

    Raises:
        InputError: If they cannot be compiled.
    """
    space = compat.function_space(domain, "DG", 0, (len(values),))
    field = fem.Function(space)
    # dolfinx compiles on rank 0, while the others wait.
    cache = compat.form_cache() if comm.rank == 0 else nullcontext()
    try:
        with compat.quiet_compiler(), cache:
            points = compat.interpolation_points(space)
            field.interpolate(fem.Expression(ufl.as_vector(values), points))
    except (RuntimeError, ValueError) as error:
        raise InputError(f"stress: the law cannot be compiled: {error}") from error
    rows = field.x.array.reshape(-1, len(values))
    return np.asarray(rows[compat.cell_dofs(space)[:, 0]])


def law_matrices(law: Law) -> Array:
    """D in this rank's cells, Pa, shape (cells, 3, 3)."""
    if not isinstance(law, tuple):
        given: Any = law
        rows = given.x.array.reshape(-1, 3, 3)
        return np.asarray(rows[compat.cell_dofs(given.function_space)[:, 0]])
    cells = compat.cell_dofs(law[0].function_space)[:, 0]
    first, shear = (field.x.array[cells] for field in law)
    matrices = np.zeros((len(cells), 3, 3))
    matrices[:, :2, :2] = first[:, None, None] + 2.0 * shear[:, None, None] * np.eye(2)
    matrices[:, 2, 2] = shear
    return matrices


def cell_field(
    domain: Any, name: str, values: Array, like: fem.Function | None = None
) -> fem.Function:
    """Function that is constant in every cell, from the local cells' values.

    It is on the space of another one where one is given.
    """
    space = like.function_space if like else compat.function_space(domain, "DG", 0)
    field = fem.Function(space, name=name)
    field.x.array[compat.cell_dofs(space)[:, 0]] = values
    return field


def material_field(
    scene: Scene, value: Callable[[Material], float], like: fem.Function | None = None
) -> fem.Function:
    """A value of the materials, constant by cell; see `cell_field`."""
    values = [value(scene.material(groups)) for groups in scene.mesh.cell_sets]
    return cell_field(scene.mesh.domain, "material", np.array(values)[scene.mesh.cell_groups], like)
