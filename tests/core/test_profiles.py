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
    sweep,
)
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import polygons, running_bond
from tests.bank import GRAVITY, PUSH, WEIGHT, coulomb
from tests.drawing import Drawing, rectangle, turned
from tests.helpers import mesh_of, on_ground

pytestmark = pytest.mark.mpi

WIDTH = 0.5
LEVELS = [1.0, 1.6, 2.6, 3.2]  # the foot is not at 0
HEIGHT = LEVELS[-1] - LEVELS[0]
HEAVY, LIGHT = 2400.0, 1200.0  # kg/m3
FAST = SolveOptions(fast=True, tolerance=1e-9)
TRIANGULAR = Load((GRAVITY, 0.0), profile="triangular")
#: Factors whose slope changes inside the blocks, and at the top of the lowest one.
TABLE = ((0.0, 0.5), (0.6, 2.0), (3.0, 1.0))


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


def test_table_whose_slope_changes_between_blocks_is_exact():
    found = block_loads(stack(Load((GRAVITY, 0.0), profile=TABLE)))
    expected = integrals(lambda h: np.interp(h, *np.transpose(TABLE)))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())


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


@pytest.mark.parametrize("quadrilaterals", [False, True])
def test_nodes_have_their_parts_of_a_profile(quadrilaterals):
    """Work on quadratic displacements, which cells of degree 2 have: int rho c b u, by hand."""
    live = Load((GRAVITY, 0.0), profile=STEP)
    scene = stack(live, quadrilaterals=quadrilaterals, degree=2)
    with Discretization(scene) as made:
        first = made.first_node
        place = made.space.tabulate_dof_coordinates()[: len(made.arm), :2]
        force = made.supports.to_cartesian(made.elasticity.live, first).reshape(-1, 2)[:, 0]
        found = scene.comm.allreduce(np.array([force @ place[:, 1] ** 2, force @ place[:, 0] ** 2]))
    breaks = [h for h, _ in STEP]
    by_height = integrals(
        lambda h: np.interp(h, *np.transpose(STEP)) * (LEVELS[0] + h) ** 2, breaks
    )
    factor = integrals(lambda h: np.interp(h, *np.transpose(STEP)), breaks)
    exact = [by_height[:, 0].sum(), factor[:, 0].sum() * WIDTH**2 / 3.0]
    np.testing.assert_allclose(found, exact, rtol=1e-10)


@pytest.mark.parametrize("quadrilaterals", [False, True])
@pytest.mark.parametrize(("height", "far"), [(0.37, 0.0), (0.62, 0.0), (0.37, 1e5)])
def test_block_under_a_step_rocks(height, far, quadrilaterals):
    """lambda int c(h) h b = w b^2 / 2 with c = 2 below a height and 0 above 1 mm more."""
    model = polygons(
        [rectangle(far, far, far + 1.0, far + 1.0)], 0.5, quadrilaterals=quadrilaterals
    )
    live = Load((GRAVITY, 0.0), profile=((height, 2.0), (height + 1e-3, 0.0)))
    result = limit_load(on_ground(model, coulomb(9.0), live=live, solve=FAST))
    ramp = 2e-3 * (0.5 * height + 1e-3 / 6.0)
    exact = 0.5 / (height**2 + ramp)
    assert result.load_factor == pytest.approx(exact, rel=1e-8)
    assert result.bounds.upper == pytest.approx(exact, rel=1e-8)


def test_trapezium_under_a_ramp_rocks():
    """Sides that lean: moments about the toe by integrals over the height; turned as well."""
    corners = np.array([(0.0, 0.0), (1.2, 0.0), (0.9, 1.0), (0.2, 1.0)])
    table = ((0.13, 0.0), (0.57, 2.5), (0.58, 0.3))
    cuts = sorted({0.0, 1.0, *(h for h, _ in table)})
    abscissa, weight = np.polynomial.legendre.leggauss(4)
    held = pushed = 0.0
    for low, high in pairwise(cuts):
        h = 0.5 * (low + high) + 0.5 * (high - low) * abscissa
        left, right = 0.2 * h, 1.2 - 0.3 * h
        part = 0.5 * (high - low) * weight * (right - left)
        held += part @ (1.2 - 0.5 * (left + right))
        pushed += part @ (np.interp(h, *np.transpose(table)) * h)
    for angle in (0.0, 37.0):
        points = turned(corners, angle)
        foot = {"base": [(points[0], points[1])]}
        weight_of = Load(tuple(turned((0.0, -GRAVITY), angle)))
        live = Load(tuple(turned((GRAVITY, 0.0), angle)), profile=table)
        model = polygons([points], 0.35, groups=foot)
        result = limit_load(on_ground(model, coulomb(9.0), weight_of, live, solve=FAST))
        assert result.load_factor == pytest.approx(held / pushed, rel=1e-8)


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


def test_stack_tips_at_its_foot():
    """lambda int w c(h) h = W b / 2, the moments about the toe."""
    result = limit_load(stack(TRIANGULAR))
    moment = -integrals(lambda h: h / centre_height())
    arm = (moment[:, 2] + LEVELS[0] * moment[:, 0]).sum()
    exact = integrals(np.ones_like)[:, 0].sum() * WIDTH / 2.0 / arm
    assert result.load_factor == pytest.approx(exact, rel=1e-8)
    assert result.bounds.upper == pytest.approx(exact, rel=1e-8)


def test_top_block_slides():
    """Friction F holds the top block up to lambda c = F, with the factor c at its middle."""
    friction = 0.1
    result = limit_load(stack(TRIANGULAR, friction))
    middle = 0.5 * (LEVELS[2] + LEVELS[3]) - LEVELS[0]
    exact = friction * centre_height() / middle
    assert result.load_factor == pytest.approx(exact, rel=1e-8)
    assert result.bounds.upper == pytest.approx(exact, rel=1e-8)
    assert np.argmax(np.abs(result.blocks["mode"][:, 0])) == np.argmax(
        result.blocks["centre"][:, 1]
    )


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


def test_heights_are_along_y_without_weight():
    """Held by friction under a force on top: only the live load has a body force."""
    dead = Load(force={"press": EdgeForce((0.0, -1e5), 0.25)})
    found, expected = (block_loads(stack(TRIANGULAR, dead=one)) for one in (dead, WEIGHT))
    assert found == pytest.approx(expected, rel=1e-12)


def test_profile_of_ones_is_uniform_and_it_can_vary_in_a_sweep():
    wall = on_ground(running_bond(3, 3), coulomb(0.65), live=PUSH, solve=FAST)
    profiles = ["uniform", [[0.0, 1.0], [9.0, 1.0]], [[0.0, 2.0], [9.0, 2.0]], "triangular"]
    if wall.comm.size > 1:  # points of a sweep are solved on one rank
        factors = [limit_load(on_ground(running_bond(3, 3), coulomb(0.65), solve=FAST,
                                        live=Load((GRAVITY, 0.0), profile=_pairs(one)))).load_factor
                   for one in profiles]  # fmt: skip
    else:
        factors = [p.load_factor for p in sweep(wall, {"loads.live.profile": profiles})]
    uniform, ones, twos, triangular = factors
    assert ones == pytest.approx(uniform, rel=1e-8)
    assert twos == pytest.approx(uniform / 2.0, rel=1e-8)
    assert triangular < 0.9 * uniform


def _pairs(profile: Any) -> Any:
    """A profile as Python has it."""
    return profile if isinstance(profile, str) else tuple(map(tuple, profile))


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


def test_profile_over_no_mass_is_no_load():
    scene = stack(TRIANGULAR)
    light = {name: Material(1e9, 0.2, 0.0) for name in scene.materials}
    with pytest.raises(InputError, match="zero"):
        limit_load(Scene(scene.mesh, light, TRIANGULAR, WEIGHT, joints=scene.joints,
                         foundations=scene.foundations))  # fmt: skip
