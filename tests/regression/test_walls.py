"""Masonry walls against published values and rigid-block programs.

Sources: M.C. Ferris, F. Tin-Loi, Int. J. Mech. Sci. 43 (2001) 209-224 (W1-W4: geometry, and rigid
non-associative values 0.63982, 0.56262, and 0.35582, 0.26374 recomputed from the geometry); linear
programs solved with HiGHS; the elastic values were computed independently with linear triangles,
E = 1 GPa and nu = 0.2. Collapse states with Coulomb friction are not unique and depend a little on
the mesh, hence the tolerance of half a per cent.
"""

from __future__ import annotations

import pytest

from fenics_contact import JointLaw
from fenics_contact import limit_load
from fenics_contact.analysis import work_control as search
from fenics_contact.analysis.rigid_blocks import RigidBlocks
from fenics_contact.discretization.discretization import Structure
from tests.regression.scenes import WALLS, wall_scene

TRESCA = {  # by strength in Pa: W1, W2, W3, W4
    500.0: (0.04762, 0.02857, 0.02930, 0.02810),
    2000.0: (0.19048, 0.11429, 0.11722, 0.11241),
    8000.0: (0.76190, 0.45714, 0.44984, 0.40938),
}

ASSOCIATIVE = {  # by friction
    0.3: (0.30000, 0.30000, 0.30000, 0.26572),
    0.5: (0.50000, 0.50000, 0.37270, 0.29679),
    0.65: (0.64286, 0.58000, 0.40369, 0.33195),
    0.8: (0.70735, 0.64851, 0.45850, 0.36281),
    1.0: (1.00000, 1.00000, 0.50778, 0.40976),
    10.0: (1.90476, 1.14286, 0.68335, 0.45714),
}

COULOMB = [  # wall, friction, elements per half block, elastic load factor
    ("W1", 0.65, 2, 0.63997),
    ("W2", 0.65, 2, 0.56288),
    ("W3", 0.65, 2, 0.35582),
    ("W4", 0.65, 2, 0.26374),
    ("W1", 0.65, 4, 0.63997),
    ("W2", 0.65, 4, 0.56288),
    ("W3", 0.65, 4, 0.35582),
    ("W4", 0.65, 4, 0.26691),
    ("4x5", 0.40, 2, 0.40000),
    ("4x5", 0.75, 2, 0.60000),
    ("4x6", 0.75, 2, 11.0 / 19.0),
    ("10x10", 0.75, 2, 0.523474),
    ("10x10", 0.75, 4, 0.523384),
]


def structure(name: str, law: JointLaw) -> Structure:
    return Structure.build(wall_scene(name, law))


@pytest.mark.parametrize("name", WALLS)
@pytest.mark.parametrize("strength", TRESCA)
def test_given_friction_equals_linear_program(name, strength):
    scene = wall_scene(name, JointLaw("tresca", bound=strength))
    result = limit_load(scene)
    blocks = RigidBlocks(result.structure.joints, result.structure.bodies, scene.comm)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(blocks.limit(), rel=1e-8)
    published = dict(zip(WALLS, TRESCA[strength], strict=True))[name]
    assert result.load_factor == pytest.approx(published, abs=5.1e-6)


@pytest.mark.parametrize("name", WALLS)
@pytest.mark.parametrize("friction", ASSOCIATIVE)
def test_associative_bound(name, friction):
    built = structure(name, JointLaw("coulomb", friction))
    bounds = RigidBlocks(built.joints, built.bodies, built.scene.comm).bounds()
    published = dict(zip(WALLS, ASSOCIATIVE[friction], strict=True))[name]
    assert bounds.upper == pytest.approx(published, abs=5.1e-6)
    assert bounds.lower == pytest.approx(0.0, abs=1e-9)
    assert bounds.stands


@pytest.mark.parametrize(("name", "friction", "elements", "expected"), COULOMB)
def test_coulomb(name, friction, elements, expected):
    result = limit_load(wall_scene(name, JointLaw("coulomb", friction), elements))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(expected, rel=5e-3)
    assert result.positive.certificate.passed
    bounds = result.bounds
    assert bounds.lower <= result.load_factor <= bounds.upper * (1.0 + 1e-9)
    if elements == 2:  # the mesh the values were computed on differs in its diagonals only
        assert result.load_factor == pytest.approx(expected, rel=2e-4)


@pytest.mark.parametrize(("friction", "expected"), [(0.40, 0.3817), (0.75, 0.472)])
def test_large_wall(friction, expected):
    """410 blocks; the last digits of the elastic value depend on the collapse state found."""
    result = limit_load(wall_scene("20x20", JointLaw("coulomb", friction)))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(expected, rel=1e-2)
    assert result.positive.certificate.gap <= 1e-4
    assert result.load_factor <= result.bounds.upper


@pytest.mark.parametrize("name", ["W1", "W2", "W4"])
def test_fixed_point_alone_ends_in_the_same_state(name):
    law = JointLaw("coulomb", 0.65)
    alone = limit_load(wall_scene(name, law, method="fixed-point"))
    auto = limit_load(wall_scene(name, law))
    assert alone.status == auto.status == "limit"
    assert alone.positive.history[-1].method == "fixed-point"
    assert alone.load_factor == pytest.approx(auto.load_factor, rel=1e-6)
    contraction = alone.positive.history[0].contraction
    assert 0.0 < contraction < 1.0


@pytest.mark.parametrize("elements", [2, 4])
@pytest.mark.parametrize("name", ["W2", "W4"])
def test_load_factor_is_on_its_plateau(name, elements, monkeypatch):
    """Ten times the work of the live load must not change the load factor.

    Stopping at a tenth of the work needed is what gives limit loads a few per cent too low.
    """
    law = JointLaw("coulomb", 0.65)
    usual = limit_load(wall_scene(name, law, elements))
    monkeypatch.setattr(search, "FIRST_WORK", 10.0 * usual.positive.work_ratio)
    further = limit_load(wall_scene(name, law, elements))
    assert usual.positive.work_ratio < further.positive.work_ratio
    assert further.status == "limit"
    assert further.load_factor == pytest.approx(usual.load_factor, rel=1e-6)
