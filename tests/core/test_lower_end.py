"""The lower end of the bracket: closed forms, states that were found, reversed loads, limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import JointLaw, Scene, limit_load
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.console import summary
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import arch, buttress
from fenics_contact.results.bounds import LimitBounds, signed
from tests import bank
from tests.bank import BANK, Known, Recipe, arch_recipe, block_recipe, coulomb, stack_recipe, tresca
from tests.helpers import numbers
from tests.property.scenes import Draw
from tests.quick import some


def bracket(scene: Scene, sign: float = 1.0) -> LimitBounds:
    with Discretization(scene) as made:
        return RigidBlocks.of(made, sign).bounds()


def leaning(courses: int, foot: float, friction: float) -> Recipe:
    """A wall of square-edged courses 1 m wide and 0.5 m high, and its buttress."""
    draw = lambda n, quads: buttress(courses, 1.0, foot, 0.5, 0.5 / n, quads)  # noqa: E731
    return Recipe(draw, coulomb(friction))


def ring(voussoirs: int, thickness: float, radius: float, embrace: float) -> Recipe:
    """A circular arch on rigid springings, friction 0.7; lengths in m, the angle in degrees."""
    draw = lambda n, quads: arch(voussoirs, thickness, radius, embrace, n, quads)  # noqa: E731
    return Recipe(draw, coulomb(0.7), {"foundations": {"springings": coulomb(0.7)}})


@pytest.mark.parametrize(
    ("recipe", "expected"),
    [
        (block_recipe(0.5, 0.8, 0.65), 0.625),
        (block_recipe(0.5, 0.8, 0.4), 0.4),
        (stack_recipe(5, 0.3), 0.3),
        (stack_recipe(5, 0.7), 0.5),
        (BANK["trilith 0.7"].recipe, 0.3),
        (ring(7, 0.15, 1.0, 157.5), 0.37361),  # I.J. Oppenheim, Earthq. Eng. Struct. Dyn. 21 (1992)
        (ring(11, 0.5, 2.0, 180.0), 0.40938),
        (arch_recipe(7, 0.2), 0.30182),
        (arch_recipe(15, 0.15), 0.15047),
    ],
)
def test_bracket_closes_where_statics_leave_nothing_open(recipe, expected):
    bounds = bracket(recipe.scene(1))
    assert bounds.meet
    assert bounds.lower == pytest.approx(expected, rel=4e-5)
    assert bounds.lower <= bounds.upper == pytest.approx(bounds.lower, rel=1e-6)


def test_buttress_has_a_lower_end_far_above_no_friction():
    """The wall tips alone at 1 / 2.5 = 0.4: it leaves the buttress, which takes no load."""
    bounds = bracket(leaning(5, 0.5, 0.7).scene(1))
    assert bounds.frictionless == pytest.approx(0.0, abs=1e-9)
    assert bounds.lower == pytest.approx(0.4, rel=1e-6)
    assert bounds.upper == pytest.approx(0.428127, rel=1e-5)
    assert not bounds.meet


@pytest.mark.parametrize("law", [tresca(2e3), JointLaw("frictionless")])
def test_given_friction_has_one_limit_load(law):
    bounds = bracket(replace(bank.wall_recipe("W1", law), law=law).scene(1))
    assert bounds.meet
    assert bounds.lower == pytest.approx(bounds.upper, rel=1e-6, abs=1e-9)


def test_a_wall_proves_nothing_beyond_no_friction_and_soon():
    """Every face of a bond may be unloaded by its neighbours."""
    bounds = bracket(BANK["W1 coulomb 0.65"].scene(1))
    assert (bounds.lower, bounds.frictionless) == (0.0, 0.0)


@pytest.mark.parametrize("seed", some([1, 3, 8, 11, 13, 24], 2))
def test_states_that_were_found_are_in_the_bracket(seed):
    draw = Draw.of_seed(seed)
    scene = draw.recipe().scene(draw.elements)
    result = limit_load(replace(scene, solve=replace(scene.solve, direction="both", error=False)))
    for name, end in result.ends.items():
        end = end if name == "positive" else signed(end, -1.0)
        if end.status == "limit":
            slack = 1e-6 * end.size + end.certificate.error_estimate
            lower = -math.inf if end.bounds.lower is None else end.bounds.lower
            assert lower - slack <= end.load_factor <= end.bounds.upper + slack


def test_no_more_programs_than_allowed_are_solved():
    """What was proved until then is kept."""
    scene = leaning(5, 1.5, 0.4).scene(1)
    ends = []
    for programs in (1, 60, 120):
        with numbers(programs=programs):
            ends.append(bracket(scene).lower)
    assert ends[0] == 0.0 < 0.3 < ends[1] <= ends[2] <= 0.4 + 1e-9


def test_a_closed_bracket_is_said():
    result = limit_load(BANK["trilith 0.7"].scene(1))
    assert "no other collapse state exists" in result.summary()
    open_ = replace(result.positive, program=lambda: LimitBounds(0.1, 0.3, 0.0))
    assert "no other" not in summary(replace(result, ends={"positive": open_}))


@pytest.mark.mpi
def test_same_bracket_on_all_ranks():
    item: Known = BANK["trilith 0.7"]
    scene = item.scene(1)
    bounds = bracket(scene)
    everywhere = np.array(scene.comm.allgather([bounds.lower, bounds.upper]))
    assert np.all(everywhere == everywhere[0]) and bounds.lower == pytest.approx(0.3)
