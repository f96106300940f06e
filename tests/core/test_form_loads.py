"""Loads given as UFL forms: those that keys can give as well, a varying pressure, what is refused.

Run on ranks, too, by `make test-mpi`.
"""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from mpi4py import MPI

from fenics_contact import (
    EarthPressure,
    InputError,
    Load,
    Scene,
    SolveOptions,
    limit_load,
)
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import polygons, running_bond
from tests.bank import GRAVITY, PUSH, WEIGHT, coulomb
from tests.helpers import STONE, on_ground

pytestmark = pytest.mark.mpi

WIDTH, HEIGHT = 0.6, 2.0
BLOCK = [(0.0, 0.0), (WIDTH, 0.0), (WIDTH, HEIGHT), (0.0, HEIGHT)]
WEIGHT_OF_BLOCK = STONE.density * GRAVITY * WIDTH * HEIGHT
BACK = {"base": [((0.0, 0.0), (WIDTH, 0.0))], "back": [((0.0, 0.0), (0.0, HEIGHT))],
        "top": [((0.0, HEIGHT), (WIDTH, HEIGHT))]}  # fmt: skip
FAST = SolveOptions(fast=True, tolerance=1e-9)


def block(live: Load, dead: Load = WEIGHT, **options: Any) -> Scene:
    """A block on the ground, with sides "back" and "top"."""
    model = polygons([BLOCK], 0.23, groups=BACK)
    return on_ground(model, coulomb(5.0), dead, live, **{"solve": FAST, **options})


def push(v: Any, dx: Any, ds: Any) -> Any:
    """The weight of all blocks, to the right."""
    return STONE.density * GRAVITY * v[0] * dx


def water(v: Any, dx: Any, ds: Any) -> Any:
    """Water up to the top at the back: pressure rho g (HEIGHT - y)."""
    domain = ds.ufl_domain()
    pressure = 9810.0 * (HEIGHT - ufl.SpatialCoordinate(domain)[1])
    return -pressure * ufl.inner(ufl.FacetNormal(domain), v) * ds("back")


def loads(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodal forces f_D, f_L of this rank, and resultants of f_L on the blocks."""
    with Discretization(scene) as made:
        elastic = made.elasticity
        return elastic.dead, elastic.live, elastic.live_resultant


def assert_same_loads(one: Scene, other: Scene) -> None:
    for found, expected in zip(loads(one), loads(other), strict=True):
        size = one.comm.allreduce(np.abs(expected).max(initial=0.0), MPI.MAX)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * size)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("quadrilaterals", [False, True], ids=["triangles", "quadrilaterals"])
def test_form_gives_the_forces_of_the_keys(quadrilaterals, degree):
    scenes = []
    for live in (
        Load(body=(GRAVITY, 0.0), traction={"top": (2e3, -1e3)}),
        Load(form=lambda v, dx, ds: push(v, dx, ds) + (2e3 * v[0] - 1e3 * v[1]) * ds("top")),
        Load(body=(GRAVITY, 0.0), form=lambda v, dx, ds: (2e3 * v[0] - 1e3 * v[1]) * ds("top")),
    ):
        model = running_bond(3, 3, quadrilaterals=quadrilaterals)
        scenes.append(on_ground(model, coulomb(0.65), live=live, degree=degree))
    assert_same_loads(scenes[1], scenes[0])
    assert_same_loads(scenes[2], scenes[0])


@pytest.mark.parametrize("degree", [1, 2])
def test_block_tips_under_water(degree):
    """lambda gamma h^3 / 6 = W b / 2, the moments about the toe; earth pressure has the same."""
    exact = WEIGHT_OF_BLOCK * WIDTH / 2.0 / (9810.0 * HEIGHT**3 / 6.0)
    scene = block(Load(form=water), degree=degree)
    assert limit_load(scene).load_factor == pytest.approx(exact, rel=1e-9)
    by_key = Load(earth={"back": EarthPressure(HEIGHT, 9810.0)})
    assert_same_loads(scene, block(by_key, degree=degree))


def test_groups_of_cells_several_groups_and_options_of_measures():
    area, sides = WIDTH * HEIGHT, WIDTH + HEIGHT

    def live(v: Any, dx: Any, ds: Any) -> Any:
        of_cells = 3.0 * v[0] * dx("blocks")
        return of_cells + v[1] * ds(("back", "top")) + v[1] * ds(degree=3)("top")

    resultant = loads(block(Load(form=live)))[2]
    assert resultant[0, :2] == pytest.approx([3.0 * area, sides + WIDTH], rel=1e-12)


def other_mesh() -> Any:
    return dolfinx_mesh.create_unit_square(MPI.COMM_WORLD, 2, 2)


@pytest.mark.parametrize(
    ("form", "named"),
    [
        (lambda v, dx, ds: v[0] ** 2 * dx, "must be linear in the test function"),
        (lambda v, dx, ds: abs(v[0]) * dx, "must be linear in the test function"),
        (lambda v, dx, ds: (1.0 + v[0]) * dx, "must be linear in the test function"),
        (lambda v, dx, ds: 1.0 * dx, "must be linear in the test function v.*has 0 arguments"),
        (lambda v, dx, ds: ufl.inner(ufl.TrialFunction(v.ufl_function_space()), v) * dx,
         "linear in .* has 2 arguments"),
        (lambda v, dx, ds: v[0] * ufl.SpatialCoordinate(other_mesh())[0] * dx, "another mesh"),
        (lambda v, dx, ds: v[0] * fem.Constant(other_mesh(), 1.0) * dx, "another mesh"),
        (lambda v, dx, ds: ufl.jump(v)[0] * ufl.dS, "measure of its own"),
        (lambda v, dx, ds: v[0] * ufl.ds(3), "measure of its own; use dx and ds"),
        (lambda v, dx, ds: v[0], "returned a .*; return a form such as"),
        (lambda v, dx, ds: None, "returned a NoneType"),
        (lambda v, dx, ds: v[0] * ds("bakc"), r"ds\('bakc'\) is over no group; .*'back'"),
        (lambda v, dx, ds: v[0] * ds(3), r"ds\(3\) is over no group"),
        (lambda v, dx, ds: v[0] * dx("back"), r"dx\('back'\) is over no group; .*'blocks'"),
        (lambda v, dx, ds: v[5] * dx, r"in line \d+ of test_form_loads.py"),
        (lambda v, dx, ds: v * dx, "scalar"),
        (lambda v: v, "takes 1 positional argument"),
        (lambda v, dx, ds: v[0] / (0 * ufl.SpatialCoordinate(dx.ufl_domain())[0]) * dx, "zero"),
        (lambda v, dx, ds: v[0] / ufl.sin(ufl.SpatialCoordinate(dx.ufl_domain())[0] * 1e-320) * dx,
         "gives forces that are not finite"),
    ],
)  # fmt: skip
def test_what_is_no_load_is_refused_on_all_ranks(form, named):
    with pytest.raises(InputError, match=named) as caught:
        Discretization(block(Load(form=form)))
    assert "loads.live.form" in str(caught.value)


def test_error_of_one_rank_is_that_of_all():
    def live(v: Any, dx: Any, ds: Any) -> Any:
        if MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1:
            raise FileNotFoundError("pressure.csv")
        return v[0] * dx

    with pytest.raises(InputError, match=r"FileNotFoundError in line .*: pressure\.csv"):
        Discretization(block(Load(form=live)))


def test_what_is_no_function_is_refused():
    with pytest.raises(InputError, match="form = 'water' must be a function, given in Python"):
        Load(form="water")  # type: ignore[arg-type]


def test_loads_are_copied_and_pickled_if_their_functions_can_be():
    load = Load(PUSH.body, {"top": (1.0, 0.0)}, form=push)
    assert pickle.loads(pickle.dumps(load)) == copy.deepcopy(load) == load
    unnamed = Load(form=lambda v, dx, ds: v[0] * dx)
    assert copy.deepcopy(unnamed) == unnamed
    with pytest.raises(InputError, match=r"form: the function '.*<lambda>' cannot be pickled"):
        pickle.dumps(unnamed)
