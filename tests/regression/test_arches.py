"""Arches of radial voussoirs: lateral loads, and the least thickness under their own weight.

Sources: lateral loads are rigid-block linear programs of trapezoidal voussoirs with corners at
R -+ t/2; least thicknesses are those of G. Cocchetti, E. Rizzi, Frattura ed Integrita Strutturale
51 (2020) 356-375, and for other numbers of voussoirs linear programs.
"""

from __future__ import annotations

import math

import pytest

from fenics_contact import limit_load
from fenics_contact.analysis.rigid_blocks import RigidBlocks
from fenics_contact.discretization.discretization import Structure
from tests.regression.scenes import arch_scene

GRAVITY = 9.81

LATERAL = [  # voussoirs, thickness over radius, weight acting to the side over weight
    (7, 0.15, 0.17072),
    (15, 0.15, 0.15047),
    (27, 0.15, 0.14534),
    (51, 0.15, 0.14502),
    (7, 0.20, 0.30182),
    (15, 0.20, 0.28636),
    (27, 0.20, 0.28434),
]

LEAST_THICKNESS = [  # voussoirs, friction, thickness over radius
    (7, 1.0, 0.095703),
    (11, 1.0, 0.104589),
    (17, 1.0, 0.105462),
    (27, 1.0, 0.106721),
    (51, 1.0, 0.107357),
    (27, 0.36, 0.140890),
    (27, 0.34, 0.161766),
    (27, 0.32, 0.183845),
]


def stands(voussoirs: int, thickness: float, friction: float = 1.0) -> bool:
    """Whether the arch of rigid voussoirs carries its weight."""
    structure = Structure.build(arch_scene(voussoirs, thickness, friction, elements=1))
    answer = RigidBlocks(structure.joints, structure.bodies, structure.scene.comm).stands()
    structure.destroy()
    return answer


@pytest.mark.parametrize(("voussoirs", "thickness", "expected"), LATERAL)
def test_lateral_load_equals_linear_program(voussoirs, thickness, expected):
    """Hinges open where friction is 1, so that the associative program is exact."""
    result = limit_load(arch_scene(voussoirs, thickness))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(expected, abs=5.1e-6)
    assert result.load_factor == pytest.approx(result.bounds.upper, rel=1e-8)


@pytest.mark.parametrize(("voussoirs", "friction", "expected"), LEAST_THICKNESS)
def test_least_thickness_of_rigid_voussoirs(voussoirs, friction, expected):
    assert not stands(voussoirs, expected * (1.0 - 2e-5), friction)
    assert stands(voussoirs, expected * (1.0 + 2e-5), friction)


@pytest.mark.parametrize("friction", [0.396, 1.0])
def test_friction_above_0_3958_does_not_change_the_least_thickness(friction):
    assert not stands(27, 0.106719, friction)
    assert stands(27, 0.106723, friction)


def test_friction_below_0_3958_raises_the_least_thickness():
    assert not stands(27, 0.106723, 0.395)


def test_least_thickness_by_bisection():
    low, high = 0.10, 0.12
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if stands(27, middle) else (middle, high)
    assert 0.5 * (low + high) == pytest.approx(0.106721, abs=1e-6)


def test_no_thickness_stands_below_the_least_friction():
    """0.3092 for joints of any direction; one of 44 voussoirs has a joint where that one slides.

    The thrust leaves the normals of the joints by most at the springing, and 28.6 degrees from
    the crown.
    """
    assert stands(44, 0.25, 0.3093)
    assert not any(stands(44, thickness, 0.3091) for thickness in (0.2, 0.25, 0.3, 0.5, 1.0, 1.5))


@pytest.mark.parametrize("voussoirs", [9, 27])
def test_least_friction_of_some_voussoirs(voussoirs):
    """Thrust H in the crown and weight w a above an angle a: |atan(w a / H) - a| <= atan F."""
    joints = [(number + 0.5) * math.pi / voussoirs for number in range(voussoirs // 2 + 1)]

    def least(slope: float) -> float:
        return math.tan(max(abs(math.atan(slope * angle) - angle) for angle in joints))

    friction = min(least(2.0 + 1e-5 * step) for step in range(20000))
    assert friction < 0.3092
    assert stands(voussoirs, 0.25, friction + 1e-4)
    assert not any(stands(voussoirs, thickness, friction - 1e-4) for thickness in (0.25, 0.5, 1.5))


@pytest.mark.parametrize(("thickness", "status"), [(0.1065, "unstable"), (0.1069, "limit")])
def test_elastic_arch_stands_like_the_rigid_one(thickness, status):
    result = limit_load(arch_scene(27, thickness))
    assert result.status == status
    assert math.isnan(result.load_factor) == (status == "unstable")


def test_elastic_arch_at_its_least_thickness_carries_no_lateral_load():
    """The load factor goes to zero with the thickness that is left."""
    result = limit_load(arch_scene(27, 0.1069))
    assert result.load_factor == pytest.approx(result.bounds.upper, abs=1e-6)
    assert 0.0 < result.load_factor < 1e-3
