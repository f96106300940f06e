"""Stress laws of the user, sigma = D eps with a matrix D for every material, or for every cell.

The law is asked at three unit strains, and at a fourth whether it is linear. From D follow what
else depends on elasticity: the mean shear modulus, and the compliance of hinges. In a wedge under a
force F at its apex the stress is radial in every homogeneous material (S.G. Lekhnitskii,
Anisotropic Plates (1968)),

    sigma_r = E(t) a . n(t) / r,   F = -G a,   G = int E(t) n n^T dt over the wedge,

with n(t) along the radius and 1 / E(t) = q^T D^-1 q, q = (n_x^2, n_y^2, n_x n_y). The energy
between two radii of ratio 2 is 1/2 ln 2 F^T G^-1 F: a halving has the compliance C = ln 2 G^-1.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import ufl

from fenics_contact import compat
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array
from fenics_contact.scene.scene import Material, StressLaw

#: Points of Gauss' rule over a wedge: E(t) may change a hundredfold.
POINTS = 96
#: By how much a law may miss linearity and symmetry, relative: rounding.
ROUNDING = 1e-9
#: Strains e_xx, e_yy, 2 e_xy at which a law is asked.
STRAINS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, -2.0, 3.0]])
#: Of messages: what a function must give.
FAILS = (
    "fails: it must give a symmetric 2 x 2 UFL tensor of (strain, material), or of (strain,"
    " material, x) where it depends on the place x"
)


def asked(law: StressLaw, material: Material, name: str, place: Any) -> Any:
    """Stresses of a material at `STRAINS` as a UFL vector, tensor after tensor, row after row.

    Args:
        law: That of the user; one with a third parameter gets the place.
        material: What it is asked for.
        name: The material's, for messages.
        place: The place in the blocks as UFL has it, m; None: the law must not ask for it.

    Raises:
        InputError: If the law fails, or gives no tensors.
    """
    try:
        more = () if place is None or compat.arguments_of(law) < 3 else (place,)
        tensors = [law(_tensor(strain), material, *more) for strain in STRAINS]
        for sigma in tensors:
            if ufl.shape(sigma) != (2, 2):
                raise ValueError(f"it has the shape {ufl.shape(sigma)}")
        entries = [sigma[i, j] for sigma in tensors for i in range(2) for j in range(2)]
        return ufl.as_vector(entries)
    except Exception as error:  # of a function of the user
        raise InputError(f"{_of(name)} {FAILS} ({type(error).__name__}: {error})") from error


def _tensor(strain: Array) -> Any:
    """A strain e_xx, e_yy, 2 e_xy as a UFL tensor."""
    xx, yy, xy = strain.tolist()
    return ufl.as_matrix([[xx, 0.5 * xy], [0.5 * xy, yy]])


def numbers(stresses: Any, name: str) -> Array:
    """What `asked` found where it does not depend on the place, shape (16,).

    Raises:
        InputError: If these are no numbers; `name` is the material's.
    """
    try:
        return np.array([float(stresses[k](())) for k in range(4 * len(STRAINS))])
    except Exception as error:  # of UFL, for what a user gave
        raise InputError(f"{_of(name)} {FAILS} ({type(error).__name__}: {error})") from error


def checked_matrices(stresses: Array, name: str, places: Array | None = None) -> Array:
    """D, Pa, from values of `asked`: (s_xx, s_yy, s_xy) = D (e_xx, e_yy, 2 e_xy).

    Args:
        stresses: Shape (cells, 16).
        name: The material's, for messages.
        places: The cells' centres, m, shape (cells, 2); None where the law is one for all.

    Returns:
        Shape (cells, 3, 3).

    Raises:
        InputError: If the law is not that of a linear elastic material.
    """

    def refuse(wrong: Array, words: str, told: Array | None = None) -> None:
        if not np.any(wrong):
            return
        cell = int(np.argmax(wrong))
        matrix = "" if told is None else f": {told[cell].tolist()}"
        here = "" if places is None else " at ({:.6g}, {:.6g})".format(*places[cell])
        raise InputError(f"{_of(name)} {words}{here}{matrix}")

    tensors = stresses.reshape(-1, len(STRAINS), 2, 2)
    size = np.abs(tensors).max(axis=(1, 2, 3))
    refuse(~np.isfinite(size), "is not linear in the strain: it gives what is no finite number")
    apart = np.abs(tensors[..., 0, 1] - tensors[..., 1, 0]).max(axis=1)
    refuse(apart > ROUNDING * size, f"{FAILS}, and it is not symmetric")
    stress = np.stack([tensors[..., 0, 0], tensors[..., 1, 1], tensors[..., 0, 1]], axis=2)
    matrix = np.swapaxes(stress[:, :3], 1, 2)
    apart = np.abs(stress[:, 3] - matrix @ STRAINS[3]).max(axis=1)
    refuse(apart > ROUNDING * size, "is not linear in the strain")
    apart = np.abs(matrix - np.swapaxes(matrix, 1, 2)).max(axis=(1, 2))
    refuse(apart > ROUNDING * size, "has no energy: its matrix is not symmetric", matrix)
    least = np.linalg.eigvalsh(matrix)[:, 0]
    refuse(least <= ROUNDING * size, "is not stiff in every direction", matrix)
    return matrix


def _of(name: str) -> str:
    return f"stress: the law of material '{name}'"


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
