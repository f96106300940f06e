"""Live body forces with a profile over the height: resultants, load factors and what is refused.

Run on ranks, too, by `make test-mpi`.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import ufl

from fenics_contact import (
    EdgeForce,
    InputError,
    Load,
    Material,
    Scene,
    SolveOptions,
    limit_load,
)
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import polygons
from tests.bank import GRAVITY, PUSH, WEIGHT, coulomb
from tests.drawing import Drawing, rectangle
from tests.helpers import mesh_of, on_ground

pytestmark = pytest.mark.mpi

WIDTH = 0.5
LEVELS = [1.0, 1.6, 2.6, 3.2]  # the foot is not at 0
HEAVY, LIGHT = 2400.0, 1200.0  # kg/m3
FAST = SolveOptions(fast=True, tolerance=1e-9)
TRIANGULAR = Load((GRAVITY, 0.0), profile="triangular")


def stack(
    live: Load,
    friction: float = 5.0,
    quadrilaterals: bool = False,
    shaken: int | None = None,
    **options: Any,
) -> Scene:
    """Three blocks on one another, the middle one light; nodes moved at random with `shaken`."""
    courses = [rectangle(0.0, low, WIDTH, high) for low, high in pairwise(LEVELS)]
    model = polygons(courses, 0.3, ["heavy", "light", "heavy"], quadrilaterals=quadrilaterals)
    if shaken is not None:
        model = Drawing.of(model).shaken(shaken).model()
    law = coulomb(friction)
    materials = {
        name: Material(1e9, 0.2, rho) for name, rho in (("heavy", HEAVY), ("light", LIGHT))
    }
    laws = {"joints": {"default": law}, "foundations": {"base": law}}
    given = {"dead": WEIGHT, "solve": FAST, **laws, **options}
    return Scene(mesh_of(model), materials, live, **given)


def block_loads(scene: Scene) -> np.ndarray:
    """Forces of the live load on the blocks, and moments about the origin, in order of height."""
    with Discretization(scene) as made:
        force = made.bodies.live * [1.0, 1.0, made.bodies.size]
        centre = made.bodies.centre
    force[:, 2] += centre[:, 0] * force[:, 1] - centre[:, 1] * force[:, 0]
    return force[np.argsort(centre[:, 1])]


def integrals(factor: Any, breaks: list[float] | None = None) -> np.ndarray:
    """Forces and moments by hand: int rho b g c(h) (1, -y) dy over every block."""
    rows = []
    abscissa, weight = np.polynomial.legendre.leggauss(4)
    for number, (low, high) in enumerate(pairwise(LEVELS)):
        density = LIGHT if number == 1 else HEAVY
        cuts = sorted(
            {low, high, *(LEVELS[0] + h for h in breaks or [] if low < LEVELS[0] + h < high)}
        )
        force = moment = 0.0
        for start, end in pairwise(cuts):
            y = 0.5 * (start + end) + 0.5 * (end - start) * abscissa
            part = 0.5 * (end - start) * weight * density * GRAVITY * WIDTH * factor(y - LEVELS[0])
            force += part.sum()
            moment -= part @ y
        rows.append((force, 0.0, moment))
    return np.array(rows)


def centre_height() -> float:
    """Height of the centre of mass over the foot."""
    mass = [
        rho * (high - low)
        for rho, (low, high) in zip((HEAVY, LIGHT, HEAVY), pairwise(LEVELS), strict=True)
    ]
    middle = [0.5 * (low + high) - LEVELS[0] for low, high in pairwise(LEVELS)]
    return float(np.dot(mass, middle) / np.sum(mass))


@pytest.mark.parametrize("degree", [1, 2])
def test_triangular_load_on_every_block(degree):
    """c = h / H with the centre of mass at H: forces and moments by hand, the total as it was."""
    found = block_loads(stack(TRIANGULAR, degree=degree))
    expected = integrals(lambda h: h / centre_height())
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())
    uniform = block_loads(stack(PUSH, degree=degree))
    assert found[:, 0].sum() == pytest.approx(uniform[:, 0].sum(), rel=1e-12)


KINKS = ((0.25, 0.5), (0.9, 2.0), (1.1, 1.0))
STEP = ((0.37, 2.0), (0.371, 0.0), (1.83, 0.0), (1.8300001, 3.0))
MANY = tuple((0.021 * n, (-1.0) ** n * n) for n in range(100))


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("quadrilaterals", [False, True])
@pytest.mark.parametrize("table", [KINKS, STEP, MANY])
def test_table_whose_slope_changes_inside_cells(table, quadrilaterals, degree):
    """Forces and moments by hand, on cells of any shape; factors beyond the table are constant."""
    live = Load((GRAVITY, 0.0), profile=table)
    found = block_loads(stack(live, quadrilaterals=quadrilaterals, shaken=3, degree=degree))
    expected = integrals(lambda h: np.interp(h, *np.transpose(table)), [h for h, _ in table])
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("degree", [1, 2])
def test_profile_is_the_same_load_given_as_a_form(degree):
    """The load factor, bracket included, of the same body force course by course, to 1e-9."""

    def form(v: Any, dx: Any, ds: Any) -> Any:
        height = ufl.SpatialCoordinate(dx.ufl_domain())[1] - LEVELS[0]
        weight = GRAVITY * height / centre_height() * v[0]
        return HEAVY * weight * dx("heavy") + LIGHT * weight * dx("light")

    scenes = [stack(live, 0.6, degree=degree) for live in (TRIANGULAR, Load(form=form))]
    one, other = map(limit_load, scenes)
    assert one.status == other.status == "limit"
    assert one.load_factor == pytest.approx(other.load_factor, rel=1e-9)
    assert one.bounds.upper == pytest.approx(other.bounds.upper, rel=1e-9)
    assert one.bounds.lower == pytest.approx(other.bounds.lower, rel=1e-9)


def test_heights_are_measured_against_the_weight():
    """Turned by 90 degrees, the load of every block turns with it."""
    courses = [
        [(-y, x) for x, y in rectangle(0.0, low, WIDTH, high)] for low, high in pairwise(LEVELS)
    ]
    foot = {"base": [((-LEVELS[0], 0.0), (-LEVELS[0], WIDTH))]}
    model = polygons(courses, 0.3, groups=foot)
    live = Load((0.0, GRAVITY), profile="triangular")
    scene = on_ground(model, coulomb(0.6), Load((GRAVITY, 0.0)), live)
    with Discretization(scene) as made:
        found = made.bodies.live[np.argsort(made.bodies.centre[:, 0]), 1][::-1]
    upright = on_ground(polygons([rectangle(0.0, a, WIDTH, b) for a, b in pairwise(LEVELS)], 0.3),
                        coulomb(0.6), live=TRIANGULAR)  # fmt: skip
    assert found == pytest.approx(block_loads(upright)[:, 0], rel=1e-9)


@pytest.mark.parametrize(
    ("profile", "message"),
    [
        ("linear", "uniform, triangular"),
        (((0.0, 1.0),), "1 pairs"),
        (((0.0, 1.0), (0.0, 2.0)), "must be above"),
        (((0.0, 1.0), (1.0, np.nan)), "finite"),
        ((0.0, 1.0), "two numbers"),
        (3.0, "pairs of numbers"),
    ],
)
def test_wrong_profiles_are_refused(profile, message):
    with pytest.raises(InputError, match=message):
        Load((GRAVITY, 0.0), profile=profile)


def test_profile_belongs_to_the_body_force_of_the_live_load():
    with pytest.raises(InputError, match=r"loads\.dead\.profile"):
        stack(PUSH, dead=Load(WEIGHT.body, profile="triangular"))
    with pytest.raises(InputError, match=r"loads\.live\.body, which is zero"):
        stack(Load(profile="triangular", force={"jack": EdgeForce((1.0, 0.0), 0.0, 2.0)}))
