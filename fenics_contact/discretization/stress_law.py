"""Stress laws of the user, sigma = D eps with one matrix D for every material.

The law is asked at three unit strains. From D follow what else depends on elasticity: the mean
shear modulus, and the compliance of hinges. In a wedge under a force F at its apex the stress is
radial in every homogeneous material (S.G. Lekhnitskii, Anisotropic Plates (1968)),

    sigma_r = E(t) a . n(t) / r,   F = -G a,   G = int E(t) n n^T dt over the wedge,

with n(t) along the radius and 1 / E(t) = q^T D^-1 q, q = (n_x^2, n_y^2, n_x n_y). The energy
between two radii of ratio 2 is 1/2 ln 2 F^T G^-1 F: a halving has the compliance C = ln 2 G^-1.
"""

from __future__ import annotations

import numpy as np
import ufl

from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array
from fenics_contact.scene.scene import Material, StressLaw

#: Points of Gauss' rule over a wedge: E(t) may change a hundredfold.
POINTS = 96
#: By how much a law may miss linearity and symmetry, relative: rounding.
ROUNDING = 1e-9


def law_matrix(law: StressLaw, material: Material, name: str) -> Array:
    """D of a material, Pa: (s_xx, s_yy, s_xy) = D (e_xx, e_yy, 2 e_xy), shape (3, 3).

    Raises:
        InputError: If the law is not that of a linear elastic material; `name` is the material's.
    """
    problem = f"stress: the law of material '{name}'"
    units = np.eye(3)
    try:
        matrix = np.column_stack([_stress(law, unit, material) for unit in units])
        mixed = np.array([1.0, -2.0, 3.0])
        apart = _stress(law, mixed, material) - matrix @ mixed
    except Exception as error:  # of a function of the user
        hint = "it must give a symmetric 2 x 2 UFL tensor of strain and material alone"
        raise InputError(f"{problem} fails: {hint} ({type(error).__name__}: {error})") from error
    size = np.abs(matrix).max()
    if not np.all(np.isfinite(matrix)) or np.abs(apart).max() > ROUNDING * size:
        raise InputError(f"{problem} is not linear in the strain")
    if np.abs(matrix - matrix.T).max() > ROUNDING * size:
        raise InputError(f"{problem} has no energy: its matrix is not symmetric, {matrix.tolist()}")
    if np.linalg.eigvalsh(matrix)[0] <= ROUNDING * size:
        raise InputError(f"{problem} is not stiff in every direction: {matrix.tolist()}")
    return matrix


def _stress(law: StressLaw, strain: Array, material: Material) -> Array:
    """Stress s_xx, s_yy, s_xy at a strain e_xx, e_yy, 2 e_xy."""
    xx, yy, xy = strain.tolist()
    sigma = law(ufl.as_matrix([[xx, 0.5 * xy], [0.5 * xy, yy]]), material)
    if ufl.shape(sigma) != (2, 2):
        raise ValueError(f"it has the shape {ufl.shape(sigma)}")
    values = np.array([[float(sigma[i, j](())) for j in range(2)] for i in range(2)])
    if abs(values[0, 1] - values[1, 0]) > ROUNDING * np.abs(values).max():
        raise ValueError("it is not symmetric")
    return np.array([values[0, 0], values[1, 1], values[0, 1]])


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
