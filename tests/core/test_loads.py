"""Forces at places, earth pressure, tilted weight and cohesion: resultants and closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import EarthPressure, EdgeForce, InputError, JointLaw, Load, Scene, limit_load
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import arch, polygons, running_bond
from tests.bank import GRAVITY, coulomb
from tests.helpers import on_ground

WIDTH, HEIGHT = 0.6, 2.0
BLOCK = [(0.0, 0.0), (WIDTH, 0.0), (WIDTH, HEIGHT), (0.0, HEIGHT)]
WEIGHT = 2000.0 * GRAVITY * WIDTH * HEIGHT
BACK = {"base": [((0.0, 0.0), (WIDTH, 0.0))], "back": [((0.0, 0.0), (0.0, HEIGHT))]}


def block(live: Load, friction: float = 5.0, size: float = 0.23, **options) -> Scene:
    """A block on the ground, with its left side as group "back"."""
    return on_ground(polygons([BLOCK], size, groups=BACK), coulomb(friction), live=live, **options)


def resultant(scene: Scene) -> tuple[np.ndarray, float]:
    """Force and moment about the origin of the live load."""
    with Discretization(scene) as whole:
        force = whole.bodies.live * np.array([1.0, 1.0, whole.bodies.size])
        centre = whole.bodies.centre
    moment = centre[:, 0] * force[:, 1] - centre[:, 1] * force[:, 0] + force[:, 2]
    return force[:, :2].sum(axis=0), float(moment.sum())


def factor(scene: Scene) -> float:
    result = limit_load(scene)
    assert result.status == "limit"
    return result.load_factor


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("width", [0.0, 0.05, 0.7])
def test_force_at_a_place_keeps_force_and_moment(width, degree):
    force, place = (3e3, -1e3), (0.0, 1.234)
    live = Load(force={"jack": EdgeForce(force, *place, width=width)})
    total, moment = resultant(block(live, degree=degree))
    assert total == pytest.approx(force, rel=1e-12)
    assert moment == pytest.approx(place[0] * force[1] - place[1] * force[0], rel=1e-12)


def test_force_over_several_blocks_and_a_curved_edge_keeps_its_resultant():
    axle = EdgeForce((0.0, -1e4), x=0.91, width=0.55)
    wall = on_ground(running_bond(4, 3), coulomb(0.5), live=Load(force={"axle": axle}))
    total, moment = resultant(wall)
    assert total == pytest.approx((0.0, -1e4), abs=1e-8)
    assert moment == pytest.approx(-0.91e4, rel=1e-12)
    ring = EdgeForce((0.0, -1e4), x=0.1, width=0.4)
    law = coulomb(0.7)
    arch_scene = on_ground(arch(9, 0.2), law, live=Load(force={"axle": ring}),
                           foundations={"springings": law})  # fmt: skip
    total, moment = resultant(arch_scene)
    assert total == pytest.approx((0.0, -1e4), abs=1e-8)
    # The edge is a polygon: the strip is measured along the facet it meets.
    assert moment == pytest.approx(-1e3, rel=0.02)


@pytest.mark.parametrize("height", [0.5, 1.37, 2.0])
def test_block_pushed_at_a_height_tips(height):
    """F h = W b / 2, the moments about the toe."""
    push = Load(force={"jack": EdgeForce((1e3, 0.0), 0.0, height)})
    assert factor(block(push)) == pytest.approx(WEIGHT * WIDTH / 2.0 / (1e3 * height), rel=1e-9)


@pytest.mark.parametrize("level", [HEIGHT, 1.15, 3.0])
def test_earth_pressure_keeps_force_and_moment(level):
    """Integrals of k (q + gamma depth) over the back, with the shear of a rough wall."""
    k, gamma, q, angle = 0.3, 18e3, 5e3, 20.0
    live = Load(earth={"back": EarthPressure(level, gamma, k, q, angle)})
    total, moment = resultant(block(live))
    top = min(level, HEIGHT)
    # Of a polynomial of degree 2 in y: exact.
    abscissa, weight = np.polynomial.legendre.leggauss(3)
    y, weight = 0.5 * top * (1.0 + abscissa), 0.5 * top * weight
    pressure = k * (q + gamma * (level - y))
    push = weight @ pressure
    assert total == pytest.approx((push, -push * np.tan(np.radians(angle))), rel=1e-9)
    assert moment == pytest.approx(-weight @ (pressure * y), rel=1e-9)


def test_tilted_weight_leaves_less_friction():
    """On a table tilted by a, the push s W with s + sin a = F cos a makes the block slide."""
    angle = np.radians(5.0)
    dead = Load((0.0, -GRAVITY), tilt=5.0)
    push = Load((GRAVITY, 0.0))
    friction = 0.2
    exact = friction * np.cos(angle) - np.sin(angle)
    assert factor(block(push, friction, dead=dead)) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("cohesion", [1e3, 4e3])
def test_cohesion_adds_to_friction(cohesion):
    """F W + c b = lambda W where the block slides."""
    law = JointLaw(friction=0.1, cohesion=cohesion)
    scene = on_ground(polygons([BLOCK], 0.23, groups=BACK), law)
    assert factor(scene) == pytest.approx(0.1 + cohesion * WIDTH / WEIGHT, rel=1e-9)


@pytest.mark.parametrize(
    ("load", "named"),
    [
        (EdgeForce((0.0, -1.0), x=5.0), "no edge looks up at x = 5"),
        (EdgeForce((0.0, -1.0), x=5.0, y=1.0), "no free edge"),
        (EdgeForce((0.0, -1.0), x=0.1, width=0.5), "of its width of 0.5 m lie on an edge"),
    ],
)
def test_force_beside_the_structure_is_refused(load, named):
    with pytest.raises(InputError, match=named) as caught:
        Discretization(block(Load(force={"axle": load})))
    assert "loads.live.force.axle" in str(caught.value)


def test_loads_check_their_values():
    for wrong, named in (
        (lambda: EdgeForce((0.0, np.inf), 0.0), "force"),
        (lambda: EdgeForce((0.0, 1.0), 0.0, width=-1.0), "width"),
        (lambda: EarthPressure(np.nan, 1.0), "level"),
        (lambda: EarthPressure(1.0, -1.0), "unit_weight"),
        (lambda: EarthPressure(1.0, 1.0, wall_friction=90.0), "wall_friction"),
        (lambda: Load(tilt=1e3), "tilt"),
        (lambda: JointLaw("tresca", bound=1.0, cohesion=1.0), "cohesion"),
        (lambda: JointLaw(friction=0.5, cohesion=-1.0), "cohesion"),
    ):
        with pytest.raises(InputError, match=named):
            wrong()
    with pytest.raises(InputError, match=r"loads\.live\.earth\.side"):
        block(Load(earth={"side": EarthPressure(1.0, 1.0)}))


@pytest.mark.parametrize("kind", ["live", "dead"])
def test_a_load_that_cancels_on_every_block_is_refused(kind):
    """What presses both sides of a block moves it nowhere."""
    sides = {**BACK, "face": [((WIDTH, 0.0), (WIDTH, HEIGHT))]}
    squeezed = Load(traction={"back": (1e3, 0.0), "face": (-1e3, 0.0)})
    loads = {"live": Load((1.0, 0.0)), kind: squeezed}
    scene = on_ground(polygons([BLOCK], 0.23, groups=sides), coulomb(0.5), **loads)
    with pytest.raises(InputError, match=f"loads.{kind}: what is given cancels"):
        limit_load(scene)
    more = replace(squeezed, body=(0.0, -9.81) if kind == "dead" else (1.0, 0.0))
    assert limit_load(replace(scene, **{kind: more})).status == "limit"


def test_a_load_by_its_direction():
    load = Load(direction=(-3.0, 4.0))
    assert load.body == pytest.approx((-0.6 * 9.81, 0.8 * 9.81))
    assert load == Load(body=load.body)
