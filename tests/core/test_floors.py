"""Floors that lie on blocks: load factors by hand, where they act, their mass, what is refused.

Run on ranks, too, by `make test-mpi`.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from fenics_contact import (
    Floor,
    InputError,
    Load,
    Scene,
    SolveOptions,
    limit_load,
    stands,
)
from fenics_contact.console import description
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import polygons
from fenics_contact.output.files import scene_record
from fenics_contact.output.plotting import draw_scene
from fenics_contact.output.view import view_of
from tests.bank import GRAVITY, coulomb, sides
from tests.drawing import rectangle, turned
from tests.helpers import STONE, on_ground
from tests.quick import each_once, slow

pytestmark = pytest.mark.mpi

FAST = SolveOptions(fast=True, tolerance=1e-9)
WIDTH, HEIGHT = 0.5, 2.0
WEIGHT = STONE.density * GRAVITY * WIDTH * HEIGHT  # N/m, of the block
FLOOR = 8e3  # N/m2
LEVELS = [0.0, 0.7, 1.6, HEIGHT]


def block(floor: Floor, friction: float = 5.0, quads: bool = False, **options: Any) -> Scene:
    """One block with a floor."""
    edges = sides(base=(0, 0, WIDTH, 0), top=(0, HEIGHT, WIDTH, HEIGHT), left=(0, 0, 0, HEIGHT))
    model = polygons([rectangle(0, 0, WIDTH, HEIGHT)], 0.25, groups=edges, quadrilaterals=quads)
    return on_ground(model, coulomb(friction), floors={"first": floor}, solve=FAST, **options)


def stack(floors: dict[str, Floor], friction: float = 5.0, **options: Any) -> Scene:
    """Three blocks on one another; the group "bed" has both sides of the lower joint."""
    courses = [rectangle(0.0, low, WIDTH, high) for low, high in pairwise(LEVELS)]
    edges = sides(base=(0, 0, WIDTH, 0), bed=(0, LEVELS[1], WIDTH, LEVELS[1]))
    model = polygons(courses, 0.15, groups=edges)
    return on_ground(model, coulomb(friction), floors=floors, **{"solve": FAST, **options})


def on_blocks(scene: Scene, kind: str) -> np.ndarray:
    """Forces of a load on the blocks, and moments about the origin, in order of height."""
    with Discretization(scene) as made:
        force = getattr(made.bodies, kind) * [1.0, 1.0, made.bodies.size]
        centre = made.bodies.centre
    force[:, 2] += centre[:, 0] * force[:, 1] - centre[:, 1] * force[:, 0]
    return force[np.argsort(centre[:, 1])]


def added(floors: dict[str, Floor], kind: str, **options: Any) -> np.ndarray:
    """What floors add to a load, as `on_blocks`."""
    return on_blocks(stack(floors, **options), kind) - on_blocks(stack({}, **options), kind)


@pytest.mark.parametrize("where", [{"at": "top"}, {"y": HEIGHT, "x": (0.0, WIDTH)}])
@pytest.mark.parametrize("mass", [False, True])
@pytest.mark.parametrize(("quads", "degree"), each_once([False, True], [1, 2]))
def test_block_under_a_floor_rocks(mass, where, degree, quads):
    """Moments about the toe: (W + N) b / 2 = lambda (W h / 2 + N h), the last with mass."""
    result = limit_load(block(Floor(FLOOR, **where, mass=mass), quads=quads, degree=degree))
    load = FLOOR * WIDTH
    exact = (WEIGHT + load) * WIDTH / 2.0 / (WEIGHT * HEIGHT / 2.0 + mass * load * HEIGHT)
    assert result.load_factor == pytest.approx(exact, rel=1e-8)
    assert result.bounds.upper == pytest.approx(exact, rel=1e-8)
    assert result.bounds.lower == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize(
    ("floor", "row", "ends"),
    [
        (Floor(FLOOR, "bed"), 0, (0.0, WIDTH)),
        (Floor(FLOOR, y=LEVELS[2], x=(0.1, 0.37)), 1, (0.1, 0.37)),
        (Floor(FLOOR, y=LEVELS[1] + 2e-5, x=(-1.0, 0.2)), 0, (0.0, 0.2)),
        (Floor(FLOOR, y=HEIGHT, x=(0.05, 0.06)), 2, (0.05, 0.06)),
    ],
)
@pytest.mark.parametrize("degree", [1, *slow(2)])
def test_floor_inside_a_wall_lies_on_the_block_below(floor, row, ends, degree):
    found = added({"one": floor}, "dead", degree=degree)
    load = FLOOR * (ends[1] - ends[0])
    expected = np.zeros((3, 3))
    expected[row] = 0.0, -load, -load * sum(ends) / 2.0
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-8 * load)
    assert np.all(added({"one": floor}, "live") == 0.0)


def test_floor_lies_on_an_uneven_bed():
    """Stones that were measured: their tops are some mm above and below the floor's height."""
    tops = (0.503, 0.5, 0.4975)
    low = [rectangle(0.4 * k, 0.0, 0.4 * (k + 1), top) for k, top in enumerate(tops)]
    high = [rectangle(0.4 * k, top, 0.4 * (k + 1), 1.0) for k, top in enumerate(tops)]
    model = polygons([*low, *high], 0.1, groups=sides(base=(0, 0, 1.2, 0)))
    floors = {"first": Floor(FLOOR, y=0.5, x=(0.0, 1.1))}
    with Discretization(on_ground(model, coulomb(0.6), floors=floors, solve=FAST)) as made:
        text = (
            "floor first: 8000 N/m2 at y = 0.5 m, x from 0 m to 1.1 m, without its mass, on 1.1 m"
        )
        assert text in description(made.layout)
        assert not any("floors" in text for text in made.warnings)


def test_triangular_load_counts_the_floors():
    """The total is that of all masses, and rises from the foot: F_i = F z_i m_i / sum z_j m_j."""
    floors = {"bed": Floor(FLOOR, "bed", mass=True),
              "roof": Floor(2e4, y=HEIGHT, x=(0.0, WIDTH), mass=True)}  # fmt: skip
    found = on_blocks(stack(floors, live=Load((GRAVITY, 0.0), profile="triangular")), "live")
    weights = [STONE.density * GRAVITY * WIDTH * (high - low) for low, high in pairwise(LEVELS)]
    moments = [w * (low + high) / 2.0 for w, (low, high) in zip(weights, pairwise(LEVELS),
                                                                strict=True)]  # fmt: skip
    weights[0] += FLOOR * WIDTH
    moments[0] += FLOOR * WIDTH * LEVELS[1]
    weights[2] += 2e4 * WIDTH
    moments[2] += 2e4 * WIDTH * HEIGHT
    expected = np.array(moments) * sum(weights) / sum(moments)
    assert found[:, 0] == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("angle", [0.0, 29.0])
def test_roof_on_a_slope(angle):
    """Its weight is per metre of level width; the factor on its mass changes along the slope."""
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.6), (0.0, 1.0)])
    first, second = 1.2, 1.21  # heights of the step
    points = turned(corners, angle)
    edges = {"base": [(points[0], points[1])], "roof": [(points[2], points[3])]}
    live = Load(tuple(turned((GRAVITY, 0.0), angle)), profile=((first, 1.0), (second, 4.0)))
    found = []
    for force in (0.0, FLOOR):
        scene = on_ground(polygons([points], 0.4, groups=edges), coulomb(5.0),
                          Load(tuple(turned((0.0, -GRAVITY), angle))), live, solve=FAST,
                          floors={"roof": Floor(force, "roof", mass=True)})  # fmt: skip
        found.append([turned(on_blocks(scene, kind)[0, :2], -angle) for kind in ("dead", "live")])
    dead, live_part = np.array(found[1]) - found[0]
    assert dead == pytest.approx([0.0, -FLOOR], abs=1e-7)
    below, beyond = (first - 1.0) / 0.6, (second - 1.0) / 0.6
    mean = below + 2.5 * (beyond - below) + 4.0 * (1.0 - beyond)
    assert live_part == pytest.approx([FLOOR * GRAVITY / 9.81 * mean, 0.0], abs=1e-7)


def test_weight_of_a_floor_makes_a_wall_stand_or_fall():
    """A cantilever of 0.6 m is held down by a floor on its tail of 0.4 m, if it is heavy enough."""
    beam = [rectangle(0, 0, 0.4, 1), rectangle(0, 1, 1.0, 1.2)]
    weight = STONE.density * GRAVITY * 0.2
    least = weight * (0.5 - 0.4) / (0.4 * 0.2)
    for part, status in ((0.98, "unstable"), (1.02, "limit")):
        floors = {"tail": Floor(part * least, y=1.2, x=(0.0, 0.4))}
        scene = on_ground(polygons(beam, 0.2), coulomb(0.9), floors=floors, solve=FAST)
        assert limit_load(scene).status == status
        assert stands(scene) == (status == "limit")


def test_floors_are_described_recorded_and_drawn():
    scene = block(Floor(FLOOR, y=HEIGHT, x=(0.0, 0.6), mass=True), thickness=2.0)
    with Discretization(scene) as made:
        text = description(made)
        record = scene_record(made.layout)
        axes = draw_scene(Figure().subplots(), view_of(made))
        weight = view_of(made).dead[0]
    assert "floor first: 16000 N/m (8000 N/m2) at y = " in text
    assert "x from 0 m to 0.6 m, with its mass, on 0.5 m" in text
    given = {"force": FLOOR, "y": HEIGHT, "x": (0.0, 0.6), "mass": True}
    assert record["floors"] == {"first": given}
    again = Scene.from_tables(scene.tables(), lambda *_: scene.mesh)
    assert again.floors == scene.floors
    assert "first" in {text.get_text() for text in axes.texts}
    assert weight.vector[:, 1] == pytest.approx(-FLOOR)
    assert weight.place[:, 1] == pytest.approx(HEIGHT)


@pytest.mark.parametrize(("end", "lies"), [(0.6, "0.5 m of its 0.6 m"), (WIDTH, None)])
def test_floor_beside_the_blocks_in_part_is_warned_of(end, lies):
    with Discretization(block(Floor(FLOOR, y=HEIGHT, x=(0.0, end)))) as made:
        texts = [text for text in made.warnings if text.startswith("floors")]
    assert [f"floors.first lies on {lies}" in text for text in texts] == [True] * (lies is not None)


@pytest.mark.parametrize(
    ("floor", "message"),
    [
        (Floor(1.0, "nowhere"), r"floors\.first\.at = 'nowhere': .* it has 'base', .*x and y"),
        (Floor(1.0, "left"), r"floors\.first\.at = 'left': no side of this group looks up"),
        (Floor(1.0, "base"), r"floors\.first\.at = 'base': no side of this group looks up"),
        (Floor(1.0, y=1.3, x=(0.0, 1.0)), r"floors\.first\.y = 1\.3: .* nearest is at y = 2"),
        (Floor(1.0, y=HEIGHT, x=(3.0, 4.0)), r"floors\.first\.y = 2: .*give x where blocks are"),
    ],
)
def test_floors_that_lie_nowhere_are_refused(floor, message):
    with pytest.raises(InputError, match=message):
        limit_load(block(floor))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"force": -1.0, "at": "top"}, "force = -1"),
        ({"force": math.nan, "at": "top"}, "force = nan"),
        ({"force": 1.0}, "either at"),
        ({"force": 1.0, "at": "top", "y": 2.0, "x": (0.0, 1.0)}, "either at"),
        ({"force": 1.0, "x": (0.0, 1.0)}, "either at"),
        ({"force": 1.0, "at": "top", "x": (0.0, 1.0)}, "either at"),
        ({"force": 1.0, "y": math.inf, "x": (0.0, 1.0)}, "y = inf"),
        ({"force": 1.0, "y": 2.0, "x": (1.0, 1.0)}, "must rise"),
        ({"force": 1.0, "y": 2.0, "x": (0.0, math.nan)}, "x = "),
        ({"force": 1.0, "at": "top", "mass": 1}, "mass = 1 must be true or false"),
    ],
)
def test_wrong_floors_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        Floor(**given)
