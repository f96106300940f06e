"""What must not change the answer of the face engine: stiffness, units, numbers, mesh, side, ranks.

Collapse states fill an interval: a state with the gap g is within 2.2 g of the next exact one.
Rounding chooses among them: unique is the upper end, and the load factor where the bracket is
closed; others are alike as far as the gap that was asked for.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import product

import pytest
from mpi4py import MPI

from fenics_contact import LimitLoad, limit_load
from tests.bank import PLAIN, Recipe, Variant, coulomb, wall_recipe
from tests.property.scenes import Draw
from tests.quick import each_once, quick, slow, slow_rows

ALIKE = 2.2
#: Of load factors, relative, where the gaps are smaller: searches begin at a rough iterate.
ROUNDED = 1e-5

CRUSHING = replace(coulomb(0.65), compressive_strength=1e6)
RECIPES = {
    "W1": wall_recipe("W1", coulomb(0.65)),
    "W3": wall_recipe("W3", coulomb(0.65)),
    "W4": wall_recipe("W4", coulomb(0.65)),
    "W3 that crushes": wall_recipe("W3", CRUSHING),
    "W4 that crushes": wall_recipe("W4", CRUSHING),
    **{f"seed {seed}": Draw.of_seed(seed).recipe() for seed in (9, 15, 21, 28, 51)},
}

SAME = {
    "1000 times as stiff": Variant(young=1e3),
    "1000 times as soft": Variant(young=1e-3),
    "mm, N, t, s": Variant(length=1e-3),
    "kilometres and giganewtons": Variant(length=1e3, force=1e9),
    "renumbered": Variant(seed=1),
    "renumbered otherwise": Variant(seed=2),
    "mirrored": Variant(mirrored=True),
    "moved nodes": Variant(shaken=1),
    "quadrilaterals": Variant(quadrilaterals=True),
    "mirrored, in millimetres": Variant(mirrored=True, length=1e-3),
}


def solved(
    recipe: Recipe, variant: Variant = PLAIN, elements: int = 1, comm: MPI.Comm | None = None
) -> LimitLoad:
    return limit_load(recipe.scene(elements, comm, variant, engine="faces", fast=True))


def assert_alike(one: LimitLoad, other: LimitLoad) -> None:
    """See that two answers are the same within what their gaps leave open."""
    assert one.status == other.status == "limit"
    assert one.positive.engine == other.positive.engine == "faces"
    gap = max(one.positive.gap, other.positive.gap, 0.0)
    assert gap <= 1e-3
    ends = [result.positive.bounds for result in (one, other)]
    assert ends[0].upper == pytest.approx(ends[1].upper, rel=ROUNDED)
    alike = max(ALIKE * gap, ROUNDED) if ends[0].meet else one.positive.asked
    assert one.load_factor == pytest.approx(other.load_factor, rel=alike)


#: The quick ones.
QUICK = ("W3", "W4 that crushes", "seed 28")


@cache
def plain(name: str) -> LimitLoad:
    return solved(RECIPES[name])


@pytest.mark.parametrize(
    ("name", "variant"),
    each_once(QUICK, [*SAME]) + slow_rows(*product(sorted(RECIPES.keys() - set(QUICK)), SAME)),
)
def test_load_factor_is_invariant(name, variant):
    assert_alike(plain(name), solved(RECIPES[name], SAME[variant]))


@pytest.mark.parametrize("name", quick(RECIPES, "W4 that crushes", "seed 28"))
@pytest.mark.parametrize("elements", [2, *slow(3)])
def test_finer_meshes_have_the_same_load_factor(name, elements):
    assert_alike(plain(name), solved(RECIPES[name], elements=elements))


@pytest.mark.parametrize("variant", ["mm, N, t, s", "mirrored"])
@pytest.mark.parametrize("seed", [27, 30, 57])
def test_blocks_that_fall_do_so_however_they_are_written(seed, variant):
    assert solved(Draw.of_seed(seed).recipe(), SAME[variant]).status == "unstable"


@pytest.mark.mpi
@pytest.mark.parametrize("name", ["W1", "W4 that crushes", *slow("seed 15")])
def test_ranks_agree_with_one(name):
    together = solved(RECIPES[name])
    assert len(set(MPI.COMM_WORLD.allgather(repr(together.load_factor)))) == 1
    assert_alike(solved(RECIPES[name], comm=MPI.COMM_SELF), together)
    assert together.positive.certificate.passed
