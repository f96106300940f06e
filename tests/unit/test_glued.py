"""Joints that are glued, off, or chosen by their blocks: load factors of the same blocks drawn."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from fenics_contact import InputError, JointLaw, Load, Scene, SolveOptions, limit_load
from fenics_contact.console import description
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import polygons
from tests.bank import GRAVITY
from tests.drawing import rectangle
from tests.helpers import STONE, coulomb, on_ground
from tests.quick import each_once

GLUED = JointLaw(glued=True)
FRICTION = 0.7
BASE = {"base": [((0.0, 0.0), (0.5, 0.0))]}


def tower(levels: list[float], size: float = 0.2, law: JointLaw = GLUED, **options: Any) -> Scene:
    """Blocks of 0.5 m width on one another, of group "low", and "high" above 0.8 m."""
    courses = [rectangle(0.0, low, 0.5, high) for low, high in pairwise(levels)]
    names = ["low" if high <= 0.8 else "high" for high in levels[1:]]
    model = polygons(courses, size, names, BASE)
    law_of_ground = {"base": coulomb(FRICTION)}
    scene = on_ground(model, law, foundations=law_of_ground, **options)
    return replace(scene, materials={"default": STONE})


@pytest.mark.mpi
@pytest.mark.parametrize(("engine", "degree"), each_once(["path", "faces"], [1, 2]))
def test_glued_blocks_are_one(engine, degree):
    """Load factor, bracket, range and hinges of a tower of three blocks are those of one."""
    options = SolveOptions(engine=engine, direction="both", error=True)
    found = limit_load(tower([0.0, 0.4, 0.8, 1.5], solve=options, degree=degree))
    whole = limit_load(tower([0.0, 1.5], solve=options, degree=degree))
    assert found.status == whole.status == "limit"
    assert found.load_factor == pytest.approx(0.5 / 1.5, rel=1e-6)
    for end, other in zip(found.ends.values(), whole.ends.values(), strict=True):
        assert end.load_factor == pytest.approx(other.load_factor, rel=1e-6)
        assert end.bounds.upper == pytest.approx(other.bounds.upper, rel=1e-6)
        assert end.bounds.lower == pytest.approx(other.bounds.lower, rel=1e-6)
        assert end.range.upper == pytest.approx(other.range.upper, rel=1e-6)
        if engine == "path":
            assert end.hinges.points == pytest.approx(other.hinges.points, rel=1e-6)
    assert found.scene.mesh.body_count == 1


@pytest.mark.mpi
def test_glue_is_elastic_continuity_where_nodes_do_not_match():
    """A cantilever of two parts with other nodes bends as one, but for its elements."""
    model = polygons([rectangle(0.0, 0.0, 0.5, 0.9)], 0.1, groups=BASE)
    held = {"foundations": {}, "supports": {"base": "fixed"}, "live": Load((1.0, 0.0))}
    whole = Discretization(on_ground(model, coulomb(0.5), **held))
    parts = [rectangle(0.0, 0.0, 0.5, 0.5), rectangle(0.0, 0.5, 0.5, 0.9)]
    model = polygons(parts, [0.1, 0.07], groups=BASE)
    with whole, Discretization(on_ground(model, GLUED, **held)) as glued:
        energy = []
        for made in (whole, glued):
            problem = made.problem
            u = made.bonded().live
            assert problem.law.friction.size == 0
            energy.append(problem.dot(problem.live, u))
    assert energy[1] == pytest.approx(energy[0], rel=2e-2)


@pytest.mark.mpi
def test_joint_chosen_by_its_blocks():
    """Of two bed joints one is rough, by the groups and by places in the blocks."""
    levels = [0.0, 0.4, 0.8, 1.5]
    smooth = coulomb(0.2)
    for between in (("low", "high"), ((0.2, 0.5), (0.2, 1.1)), ((0.2, 1.2), "low")):
        rough = JointLaw(friction=FRICTION, between=between)
        scene = tower(levels, law=smooth)
        scene = replace(scene, joints={"default": smooth, "upper": rough})
        text = description(Discretization(scene).layout)
        assert "joint upper: Coulomb friction 0.7" in text
        assert "length 0.5 m" in text.split("joint upper")[1].splitlines()[0]
        assert limit_load(scene).load_factor == pytest.approx(0.2, rel=1e-6)
        chosen = {"default": coulomb(FRICTION), "upper": replace(rough, friction=0.1)}
        one = replace(scene, joints=chosen)
        assert limit_load(one).load_factor == pytest.approx(0.1, rel=1e-6)


def test_joint_that_is_off_carries_nothing():
    """Two blocks beside each other: pushed apart from their joint, each stands alone."""
    lines = {"base": [((0.0, 0.0), (1.5, 0.0))]}
    blocks = [rectangle(0.0, 0.0, 0.5, 1.0), rectangle(0.5, 0.0, 1.5, 1.0)]
    model = polygons(blocks, 0.25, groups=lines)
    scene = on_ground(model, coulomb(0.0), foundations={"base": coulomb(2.0)})
    together = limit_load(scene).load_factor
    apart = limit_load(replace(scene, joints={"default": JointLaw(off=True)}))
    assert apart.load_factor == pytest.approx(0.5, rel=1e-6)
    assert together > 0.6
    off = {"default": coulomb(0.0), "one": JointLaw(off=True, between=((0.2, 0.5), (0.8, 0.5)))}
    assert limit_load(replace(scene, joints=off)).load_factor == pytest.approx(0.5, rel=1e-6)
    text = description(Discretization(replace(scene, joints=off)).layout)
    assert "joint one: off: carries nothing" in text


def test_arch_with_some_joints_glued():
    """The load factor is that of blocks drawn as one, whatever the law of the glued joints."""
    width = [0.0, 0.6, 1.2, 1.8]
    lines = {"base": [((0.0, 0.0), (1.8, 0.0))]}
    blocks = [rectangle(a, 0.0, b, 0.4) for a, b in pairwise(width)]
    blocks += [rectangle(0.3, 0.4, 1.5, 0.8)]
    model = polygons(blocks, 0.2, groups=lines)
    law = coulomb(0.4)
    glue = JointLaw(glued=True, between=((0.3, 0.2), (0.9, 0.2)))
    scene = on_ground(model, law)
    found = limit_load(replace(scene, joints={"default": law, "pair": glue}))
    blocks = [rectangle(0.0, 0.0, 1.2, 0.4), *blocks[2:]]
    whole = limit_load(on_ground(polygons(blocks, 0.2, groups=lines), law))
    assert found.load_factor == pytest.approx(whole.load_factor, rel=1e-6)
    assert np.isfinite(found.load_factor)


@pytest.mark.parametrize(
    ("laws", "text"),
    [
        ({"default": {"glued": True, "gap": 1e-3}}, "a glued joint takes no gap"),
        ({"default": {"glued": True, "off": True}}, "either glued or off"),
        ({"one": {"glued": True, "between": ("low",)}}, "must be two names"),
        ({"one": {"glued": True, "between": ("low", "none")}}, "no two-dimensional group 'none'"),
        ({"default": {"glued": True, "between": ("low", "high")}}, "default takes no between"),
        ({"one": {"glued": True, "between": ("high", "high")}}, "no blocks of 'high' and 'high'"),
    ],
)
def test_messages(laws, text):
    scene = tower([0.0, 0.4, 0.8, 1.5])
    with pytest.raises(InputError, match=text):
        joints = {"default": coulomb(0.5)} | {name: JointLaw(**law) for name, law in laws.items()}
        Discretization(replace(scene, joints=joints))


def test_ground_is_not_glued():
    scene = tower([0.0, 1.5])
    with pytest.raises(InputError, match=r"foundations.base.glued: make the group a support"):
        replace(scene, foundations={"base": GLUED})


@pytest.mark.parametrize(
    ("low", "high", "decides"),
    [(1e7, 1e5, 1e7), (2e5, 1e7, 2e5), (None, 1e5, np.inf), (1e5, None, 1e5), (3e5, 3e5, 3e5)],
)
def test_the_stone_at_the_joint_crushes_not_what_is_glued_on_it(low, high, decides):
    """It rocks about the middle of what its toe crushes: lambda h = b - W / f_c."""
    scene = tower([0.0, 0.4, 0.8, 1.5], live=Load((GRAVITY, 0.0)))
    kinds = {"low": replace(STONE, compressive_strength=low)}
    kinds["high"] = replace(STONE, compressive_strength=high)
    result = limit_load(replace(scene, materials=kinds))
    weight = STONE.density * GRAVITY * 0.5 * 1.5
    assert result.status == "limit"
    assert result.load_factor == pytest.approx((0.5 - weight / decides) / 1.5, rel=1e-3)


@pytest.mark.parametrize("apart", [1e-8, 4e-8])
@pytest.mark.parametrize("softer", [1.0, 1e-2, 1e-3])
def test_faces_of_glued_blocks_whose_nodes_are_not_quite_in_one_place(apart, softer):
    """Stiff glue makes forces of their rigid rotation: the state is in equilibrium without them."""
    drawn = [(0.0, 0.0, 0.5, 0.8), (apart, 0.8, 0.5 + apart, 1.5)]
    model = polygons([rectangle(*one) for one in drawn], 0.2, ["low", "high"], BASE)
    options = SolveOptions(engine="faces")
    scene = on_ground(model, GLUED, foundations={"base": coulomb(0.7)}, solve=options, degree=2)
    kinds = {"low": STONE, "high": replace(STONE, young=softer * STONE.young)}
    result = limit_load(replace(scene, materials=kinds))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(0.5 / 1.5, rel=1e-3)
