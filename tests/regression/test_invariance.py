"""What must not change a load factor: stiffness, units, numbering, orientation, cells, degree."""

from __future__ import annotations

from functools import cache
from itertools import product

import pytest

from fenics_contact import limit_load
from tests.bank import BANK, Known, Variant, known
from tests.quick import each_once, slow

WALLS = ("W1 tresca 2 kPa", "W1 coulomb 0.65", "W3 coulomb 0.65")

#: Asked for, and how well load factors must agree then; both relative.
EXACT, AGREED = 1e-9, 1e-8

#: Nothing but the way the scene is written.
SAME = {
    "1000 times as stiff": Variant(young=1e3),
    "1000 times as soft": Variant(young=1e-3),
    "millimetres": Variant(length=1e-3),
    "micrometres": Variant(length=1e-6),
    "kilometres and giganewtons": Variant(length=1e3, force=1e9),
    "renumbered": Variant(seed=1),
    "renumbered otherwise": Variant(seed=2),
    "mirrored": Variant(mirrored=True),
    "turned": Variant(angle=17.0),
    "turned, mirrored, in millimetres": Variant(angle=123.0, mirrored=True, length=1e-3),
}

#: Other elastic blocks with the same rigid ones: the load factor may depend on them, but not much.
ELASTIC = {
    "plane stress": Variant(plane="stress"),
    "nearly incompressible": Variant(poisson=0.4999),
    "moved nodes": Variant(shaken=1),
    "quadrilaterals": Variant(quadrilaterals=True),
    "quadratic triangles": Variant(degree=2),
    "quadratic quadrilaterals": Variant(degree=2, quadrilaterals=True),
    "meshed one by one": Variant(one_by_one=1),
    "meshed one by one, quadratic": Variant(one_by_one=2, degree=2, quadrilaterals=True),
}


@cache
def plain(name: str) -> float:
    return limit_load(BANK[name].scene(tolerance=EXACT)).load_factor


@pytest.mark.parametrize(("name", "variant"), each_once(WALLS, [*SAME]))
def test_load_factor_is_invariant(name, variant):
    result = limit_load(BANK[name].scene(variant=SAME[variant], tolerance=EXACT))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(plain(name), rel=AGREED)


def test_reversed_load_on_mirrored_wall_is_the_same():
    """The negative direction of a wall is the positive one of its mirror image, with its sign."""
    wall = BANK["W3 coulomb 0.65"]
    result = limit_load(wall.scene(direction="both", tolerance=EXACT))
    assert result.load_factor == pytest.approx(plain(wall.name), rel=AGREED)
    mirrored = Variant(mirrored=True)
    opposite = limit_load(wall.scene(variant=mirrored, direction="negative", tolerance=EXACT))
    assert opposite.load_factor_negative == pytest.approx(result.load_factor_negative, rel=AGREED)
    assert result.load_factor_negative < 0.0


@pytest.mark.parametrize(
    ("name", "variant"),
    each_once(
        ["W3 tresca 2 kPa", "stack of 5 0.7", "block 0.2", "wedge 0.3", "W4 tresca 2 kPa"],
        [*ELASTIC],
    ),
)
def test_elasticity_does_not_change_exact_load_factors(name, variant):
    entry = BANK[name]
    result = limit_load(entry.scene(variant=ELASTIC[variant]))
    assert entry.right(result.status, result.load_factor), result.load_factor


@pytest.mark.parametrize(
    ("name", "variant"),
    [
        pytest.param(
            f"{wall} coulomb 0.65",
            variant,
            marks=[] if wall == "W1" and k % 2 == 0 else pytest.mark.slow,
        )
        for wall, (k, variant) in product(("W1", "W2", "W3"), enumerate(ELASTIC))
        if (wall, variant) != ("W3", "nearly incompressible")
    ],
)
def test_elasticity_hardly_changes_those_of_walls(name, variant):
    result = limit_load(BANK[name].scene(variant=ELASTIC[variant]))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(BANK[name].expected, rel=5e-3)


@pytest.mark.parametrize("name", [*slow("W1 coulomb 0.65", "W2 coulomb 0.65"), "W3 coulomb 0.65"])
def test_walls_without_common_nodes_have_the_same_load_factor(name):
    one_by_one = BANK[name].scene(variant=Variant(one_by_one=1), tolerance=1e-8)
    matching = BANK[name].scene(tolerance=1e-8)
    found = limit_load(one_by_one)
    assert found.status == "limit"
    assert found.load_factor == pytest.approx(limit_load(matching).load_factor, rel=1e-6)


@pytest.mark.parametrize(
    "entry",
    [
        pytest.param(entry, id=entry.name, marks=[pytest.mark.slow] * (k % 4 != 0))
        for k, entry in enumerate(known("arch", without=("slow",)))
    ],
)
def test_arches_without_common_nodes(entry):
    """Of degree 2, too, among the slow tests below."""
    scene = entry.scene(variant=Variant(one_by_one=1))
    result = limit_load(scene)
    assert entry.right(result.status, result.load_factor), result.load_factor


UNLIKE = [
    Variant(one_by_one=seed, degree=degree, quadrilaterals=quadrilaterals)
    for seed, (degree, quadrilaterals) in enumerate(product((1, 2), (False, True)))
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("entry", "variant"),
    [
        *product([*known("tresca"), *known("arch", without=("least",))], UNLIKE),
        *product(known("coulomb", without=("slow",)), UNLIKE),
        *product(known("coulomb", "slow"), UNLIKE[:1]),
    ],
    ids=lambda one: one.name if isinstance(one, Known) else f"{one.degree}{one.quadrilaterals}",
)
def test_walls_and_arches_without_common_nodes_verify(entry, variant):
    result = limit_load(entry.scene(variant=variant))
    assert result.status == "limit"
    if {"tresca", "arch"} & entry.tags:  # elasticity has no part in these
        assert entry.right(result.status, result.load_factor), result.load_factor
