"""Stress laws given in Python: isotropy as the materials have it, orthotropy, what is refused.

Run on ranks, too, by `make test-mpi`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

from fenics_contact import (
    BlockMesh,
    InputError,
    Load,
    Material,
    Scene,
    SolveOptions,
    compat,
    limit_load,
)
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.materials import (
    mean_shear_modulus,
    wedge_compliance,
)
from fenics_contact.meshing import polygons, running_bond
from fenics_contact.output.fields import cell_stresses
from tests.bank import PUSH, WEIGHT, coulomb
from tests.helpers import STONE, mesh_of, on_ground


def isotropic(strain: Any, material: Material) -> Any:
    """Plane strain."""
    e, nu = material.young, material.poisson
    first = e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    return e / (1.0 + nu) * strain + first * ufl.tr(strain) * ufl.Identity(2)


#: Compliance of brickwork in plane stress: soft across its bed joints, softer in shear, 1/Pa.
E_X, E_Y, NU, G = 8e9, 2e9, 0.1, 0.7e9
COMPLIANCE = np.array([[1 / E_X, -NU / E_X, 0.0], [-NU / E_X, 1 / E_Y, 0.0], [0.0, 0.0, 1 / G]])


def orthotropic(strain: Any, material: Material) -> Any:
    (a, b, _), (_, c, _), (_, _, d) = np.linalg.inv(COMPLIANCE).tolist()
    xx, yy = a * strain[0, 0] + b * strain[1, 1], b * strain[0, 0] + c * strain[1, 1]
    xy = 2.0 * d * strain[0, 1]
    return ufl.as_matrix([[xx, xy], [xy, yy]])


def wall(**options: Any) -> Scene:
    return on_ground(running_bond(3, 3), coulomb(0.65), **options)


@pytest.mark.mpi
def test_isotropic_law_is_that_of_the_materials():
    solve = SolveOptions(tolerance=1e-9, error=True, peak=False, lowest=False)
    usual, given = (limit_load(wall(solve=solve, stress=law)) for law in (None, isotropic))
    assert usual.status == given.status == "limit"
    assert given.load_factor == pytest.approx(usual.load_factor, rel=1e-9)
    assert given.hinges.points == pytest.approx(usual.hinges.points, rel=1e-7)


def test_wedges_of_an_isotropic_law_are_those_of_michell():
    nu = STONE.poisson
    first = STONE.young / ((1.0 + nu) * (1.0 - 2.0 * nu))
    rows = [[1.0 - nu, nu, 0.0], [nu, 1.0 - nu, 0.0], [0.0, 0.0, 0.5 - nu]]
    matrix = first * np.array(rows)
    angle = np.array([0.3, 0.5 * np.pi, np.pi, 1.5 * np.pi, 1.9 * np.pi])
    at = np.array([0.0, 1.0, 2.0, 4.0, -2.0])
    bisector = np.column_stack([np.cos(at), np.sin(at)])
    modulus = STONE.young / (1.0 - STONE.poisson**2)
    found = wedge_compliance(np.tile(matrix, (len(angle), 1, 1)), angle, bisector)
    across = np.column_stack([-bisector[:, 1], bisector[:, 0]])
    along, beside = (np.einsum("ni,nj->nij", axis, axis).T for axis in (bisector, across))
    half, sine = 0.5 * angle, 0.5 * np.sin(angle)
    expected = np.log(2.0) / modulus * (along / (half + sine) + beside / (half - sine)).T
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12 * np.abs(expected).max())
    shear = STONE.young / (2.0 * (1.0 + STONE.poisson))
    assert mean_shear_modulus(matrix) == pytest.approx(shear, rel=1e-12)


@pytest.mark.parametrize("normal", [0, 1])
def test_half_plane_of_an_orthotropic_law_gives_way_as_in_closed_form(normal):
    """Displacement -P/pi sqrt(s_nn) sqrt(2 sqrt(s_nn s_tt) + 2 s_nt + s_66) log r under a force P.

    S.G. Lekhnitskii, Anisotropic Plates (1968); s is the compliance, n normal to the edge.
    """
    matrix = np.linalg.inv(COMPLIANCE)[None]
    bisector = np.eye(2)[[normal]]
    found = wedge_compliance(matrix, np.array([np.pi]), bisector)[0, normal, normal]
    across, along = COMPLIANCE[normal, normal], COMPLIANCE[1 - normal, 1 - normal]
    root = np.sqrt(2.0 * np.sqrt(across * along) + 2.0 * COMPLIANCE[0, 1] + COMPLIANCE[2, 2])
    assert found == pytest.approx(np.log(2.0) / np.pi * np.sqrt(across) * root, rel=1e-10)


def block(**options: Any) -> Scene:
    """A block, 1 m x 3 m, on the ground."""
    outline = [(0.0, 0.0), (1.0, 0.0), (1.0, 3.0), (0.0, 3.0)]
    base = {"base": [((0.0, 0.0), (1.0, 0.0))]}
    cells = {"quadrilaterals": options.pop("quadrilaterals", False)}
    return on_ground(polygons([outline], 0.5, groups=base, **cells), coulomb(5.0), **options)


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("quadrilaterals", [False, True], ids=["triangles", "quadrilaterals"])
def test_uniform_stress_strains_by_the_compliance(quadrilaterals, degree):
    """K u = f with u = (S sigma) x and the tractions sigma n: the patch test."""
    sigma = np.array([2e6, -5e6, 1e6])
    xx, yy, xy = COMPLIANCE @ sigma

    def tractions(v: Any, dx: Any, ds: Any) -> Any:
        normal = ufl.FacetNormal(ds.ufl_domain())
        stress = ufl.as_matrix([[sigma[0], sigma[2]], [sigma[2], sigma[1]]])
        return ufl.inner(ufl.dot(stress, normal), v) * ds

    live = Load(form=tractions)
    options = {"quadrilaterals": quadrilaterals, "degree": degree, "stress": orthotropic}
    with Discretization(block(live=live, **options)) as made:
        count = len(made.elasticity.arm)
        x, y = made.elasticity.space.tabulate_dof_coordinates()[:count, :2].T
        u = np.column_stack([xx * x + 0.5 * xy * y, 0.5 * xy * x + yy * y]).ravel()
        force = made.problem.stiffness @ u
        np.testing.assert_allclose(force, made.elasticity.live, atol=1e-9 * np.abs(sigma).max())
        found = cell_stresses(made, u)
        np.testing.assert_allclose(found, np.tile(sigma, (len(found), 1)), rtol=1e-9)


def softer_below(strain: Any, material: Material, x: Any) -> Any:
    """A hundredth of the stiffness below y = 1."""
    return isotropic(strain, STONE) * ufl.conditional(ufl.lt(x[1], 1.0), 0.01, 1.0)


def as_function(blocks: BlockMesh) -> Any:
    """The same by a function on the mesh of the blocks, constant in every cell."""
    part = fem.Function(compat.function_space(blocks.domain, "DG", 0))
    part.interpolate(lambda x: np.where(x[1] < 1.0, 0.01, 1.0))
    return lambda strain, material: part * isotropic(strain, STONE)


@pytest.mark.mpi
@pytest.mark.parametrize("given", ["material", "place", "function"])
def test_materials_and_places_have_laws_of_their_own(given):
    model = polygons(
        [[(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)],
         [(0.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)]],
        0.5, names=["soft", "hard"], groups={"base": [((0.0, 0.0), (1.0, 0.0))]},
    )  # fmt: skip
    soft = replace(STONE, young=0.01 * STONE.young)
    law = coulomb(0.6)
    scene = Scene(
        mesh_of(model), {"soft": soft, "hard": STONE}, PUSH, WEIGHT, joints={"default": law},
        foundations={"base": law},
    )  # fmt: skip
    laws = {"material": isotropic, "place": softer_below, "function": as_function(scene.mesh)}
    own = replace(scene, stress=laws[given])
    with Discretization(scene) as usual, Discretization(own) as made:
        u = np.random.default_rng(1).standard_normal(usual.problem.dead.size)
        expected, found = (one.problem.stiffness @ u for one in (usual, made))
        np.testing.assert_allclose(found, expected, atol=1e-12 * STONE.young)
    if given != "material":
        assert limit_load(own).load_factor == pytest.approx(limit_load(scene).load_factor, rel=1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize("accuracy", [None, 1e-3])
def test_orthotropic_block_tips_as_by_statics(accuracy, tmp_path):
    """F h / 2 = W b / 2: the load factor of the weight is b / h, whatever the law."""
    solve = SolveOptions(accuracy=accuracy)
    result = limit_load(block(stress=orthotropic, solve=solve))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(1.0 / 3.0, rel=1e-6)
    folder = MPI.COMM_WORLD.bcast(tmp_path)
    result.write(folder)
    text = "".join(path.read_text(errors="replace") for path in folder.rglob("*.pvtu"))
    assert "principal_1" in text
    assert "von_mises" not in text


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("law", "named"),
    [
        (lambda strain, material: strain[0, 0] * strain, "is not linear in the strain"),
        (lambda strain, material: 1e9 * strain + 1e6 * ufl.Identity(2), "is not linear in the"),
        (lambda strain, material: 1e9 * ufl.tr(strain) * ufl.Identity(2), "is not stiff in every"),
        (lambda strain, material: -1e9 * strain, "is not stiff in every direction"),
        (lambda strain, material: 1e9 * ufl.as_matrix(
            [[strain[0, 0] + 0.3 * strain[1, 1], strain[0, 1]], [strain[0, 1], strain[1, 1]]]),
         "has no energy: its matrix is not symmetric"),
        (lambda strain, material: 1e9 * ufl.as_matrix(
            [[strain[0, 0], strain[0, 1]], [0.0, strain[1, 1]]]), "fails: .*it is not symmetric"),
        (lambda strain, material: ufl.tr(strain), "fails: it must give a symmetric 2 x 2 UFL"),
        (lambda strain, material: material.shear * strain, "fails: .*no attribute 'shear'"),
        (lambda strain: strain, "fails: .*argument"),
        (lambda strain, material: float("nan") * strain, "is not linear"),
    ],
)  # fmt: skip
def test_what_is_no_law_is_refused(law, named):
    with pytest.raises(InputError, match=f"stress: the law of material 'default' {named}"):
        Discretization(block(stress=law))


@pytest.mark.mpi
def test_law_is_refused_where_it_is_none():
    usual = block(quadrilaterals=True)
    soft = replace(usual, stress=lambda strain, material, x: (x[1] - 1.0) * 1e9 * strain)
    named = r"the law of material 'default' is not stiff in every direction at \([\d., ]*\)"
    with pytest.raises(InputError, match=named):
        Discretization(soft)
    elsewhere = replace(usual, stress=as_function(block().mesh))
    with pytest.raises(InputError, match=r"uses another mesh .*, \(strain, material, x\)"):
        Discretization(elsewhere)


def test_what_is_no_function_is_refused():
    with pytest.raises(InputError, match=r"stress = 5\.0 must be a function, given in Python"):
        block(stress=5.0)


def test_lame_numbers_of_a_law_are_refused_by_name():
    with Discretization(block(stress=orthotropic)) as made:
        with pytest.raises(InputError, match="stress: a law of its own has no Lame's numbers"):
            _ = made.elasticity.lame
