"""The methods against each other, against linear programs and closed forms; their residuals."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fenics_contact import JointLaw, LimitLoad, Scene, SolveOptions, limit_load
from fenics_contact.analysis.certificate import TOLERANCES
from tests.regression.scenes import arch_scene, wall_scene, wedge_scene

METHODS = ("auto", "fixed-point", "monolithic", "splitting", "active-set")
JOINT_METHODS = ("splitting", "active-set")

#: Rigid-block linear programs with given shear strength, kPa (M.C. Ferris, F. Tin-Loi's walls, Int.
#: J. Mech. Sci. 43 (2001) 209, with |T| <= tau x length): five digits.
TRESCA = {
    ("W1", 0.5): 0.04762, ("W1", 2.0): 0.19048, ("W1", 8.0): 0.76190,
    ("W2", 0.5): 0.02857, ("W2", 2.0): 0.11429, ("W2", 8.0): 0.45714,
    ("W3", 0.5): 0.02930, ("W3", 2.0): 0.11722, ("W3", 8.0): 0.44984,
    ("W4", 0.5): 0.02810, ("W4", 2.0): 0.11241, ("W4", 8.0): 0.40938,
}  # fmt: skip

#: Walls and strengths that joint forces are tried on in the tests; benchmarks/methods.py has all.
QUICK = [("W1", 0.5), ("W1", 2.0), ("W1", 8.0), ("W2", 8.0), ("W3", 8.0), ("W4", 8.0)]


def solved(scene: Scene, **options: str) -> LimitLoad:
    """Solve with some options; the answer must be verified."""
    result = limit_load(replace(scene, solve=SolveOptions(**options)))
    assert result.status == "limit"
    assert result.positive is not None and result.positive.certificate is not None
    assert result.positive.certificate.passed
    return result


def tresca(strength: float) -> JointLaw:
    """Shear strength in kPa."""
    return JointLaw("tresca", bound=1e3 * strength)


@pytest.mark.parametrize(("name", "strength"), TRESCA)
def test_given_friction_by_interior_point(name, strength):
    result = solved(wall_scene(name, tresca(strength)))
    assert result.load_factor == pytest.approx(result.bounds.upper, rel=1e-6)
    assert result.load_factor == pytest.approx(TRESCA[name, strength], abs=6e-6)


@pytest.mark.parametrize("method", JOINT_METHODS)
@pytest.mark.parametrize(("name", "strength"), QUICK)
def test_given_friction_by_joint_forces(name, strength, method):
    result = solved(wall_scene(name, tresca(strength)), method=method)
    assert result.load_factor == pytest.approx(result.bounds.upper, rel=1e-6)
    assert result.load_factor == pytest.approx(TRESCA[name, strength], abs=6e-6)


@pytest.mark.parametrize("name", ["W1", "W2", "W3", "W4"])
def test_given_friction_by_continuation(name):
    result = solved(wall_scene(name, tresca(2.0)), control="load")
    assert result.load_factor == pytest.approx(result.bounds.upper, rel=1e-6)
    path = result.positive.path
    assert path.lower <= result.load_factor * (1.0 + 1e-6)
    assert path.lower >= result.load_factor * (1.0 - 2e-4)


@pytest.mark.parametrize("strength", [0.5, 2.0, 8.0])
def test_static_and_kinematic_bounds_meet_with_given_friction(strength):
    certificate = solved(wall_scene("W1", tresca(strength))).positive.certificate
    assert certificate.static_factor == pytest.approx(certificate.kinematic_factor, rel=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_coulomb_friction_by_every_method(method):
    result = solved(wall_scene("4x5", JointLaw("coulomb", 0.75)), method=method)
    assert result.load_factor == pytest.approx(0.6, rel=1e-5)


def test_coulomb_friction_of_a_wall_by_joint_forces():
    scene = wall_scene("W1", JointLaw("coulomb", 0.65))
    usual = solved(scene).load_factor
    assert solved(scene, method="active-set").load_factor == pytest.approx(usual, rel=1e-5)


@pytest.mark.parametrize("name", ["W1", "W2", "W3", "W4"])
def test_continuation_and_work_control_agree(name):
    scene = wall_scene(name, JointLaw("coulomb", 0.65))
    usual, continued = solved(scene), solved(scene, control="load")
    assert continued.load_factor == pytest.approx(usual.load_factor, rel=1e-5)
    path = continued.positive.path
    # The limit load lies between the last load factor with equilibrium and the first without.
    assert path.lower <= continued.load_factor * (1.0 + 1e-5)
    assert path.upper >= continued.load_factor * (1.0 - 1e-5)
    assert path.upper - path.lower <= 2e-4 * path.lower


@pytest.mark.parametrize("name", ["W2", "W4"])
def test_slip_measured_by_load_steps_ends_in_a_verified_state(name):
    scene = wall_scene(name, JointLaw("coulomb", 0.65))
    usual, stepped = solved(scene), solved(scene, control="load", slip="load-steps")
    assert stepped.load_factor <= stepped.bounds.upper
    # Another path, another state perhaps, but not far away.
    assert stepped.load_factor == pytest.approx(usual.load_factor, rel=1e-3)


def test_both_directions_by_continuation():
    scene = wall_scene("W3", tresca(2.0))
    result = solved(scene, control="load", direction="both")
    assert result.load_factor == pytest.approx(result.positive.bounds.upper, rel=1e-6)
    assert result.load_factor_negative == pytest.approx(result.negative.bounds.lower, rel=1e-6)


@pytest.mark.parametrize("method", JOINT_METHODS)
@pytest.mark.parametrize(
    ("friction", "exact"), [(0.1, 0.1549061), (0.2, 0.4264946), (0.3, 0.9340306)]
)
def test_wedge_by_joint_forces(friction, exact, method):
    result = solved(wedge_scene(friction), method=method)
    assert result.load_factor == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("method", JOINT_METHODS)
def test_arch_by_joint_forces(method):
    result = solved(arch_scene(7, 0.15), method=method)
    assert result.load_factor == pytest.approx(result.bounds.upper, rel=2e-5)


def test_states_at_friction_one():
    """W1 has several collapse states; staircase rocking is at 0.64596."""
    result = solved(wall_scene("W1", JointLaw("coulomb", 1.0)), states="lowest")
    found = result.positive.states
    assert len(found) >= 4
    assert all(state.status == "limit" for state in found)
    assert result.load_factor == min(state.load_factor for state in found)
    assert result.load_factor <= 0.6857


def test_lowest_of_several_states():
    """W3 has a state at 0.3558 and, by the monolithic method, one at 0.384."""
    scene = wall_scene("W3", JointLaw("coulomb", 0.65))
    lowest = solved(scene, states="lowest")
    assert {round(state.load_factor, 3) for state in lowest.positive.states} >= {0.356, 0.384}
    assert lowest.load_factor == pytest.approx(0.35582, rel=1e-4)
    assert solved(scene, method="monolithic").load_factor == pytest.approx(0.384, rel=1e-2)


@pytest.mark.parametrize("law", [tresca(2.0), JointLaw("coulomb", 0.75)], ids=["tresca", "coulomb"])
def test_residuals_of_every_method(law, capsys):
    """Prints the table of residuals that every method leaves, and holds it."""
    names = ("equilibrium", "penetration", "complementarity", "friction", "slip_direction")
    lines = [f"{'method':12}" + "".join(f"{name:>16}" for name in names)]
    for method in METHODS:
        residuals = solved(wall_scene("4x5", law), method=method).positive.certificate.residuals
        lines.append(f"{method:12}" + "".join(f"{residuals[name]:16.1e}" for name in names))
        assert all(residuals[name] <= TOLERANCES[name] for name in names), method
    with capsys.disabled():
        print("\n" + "\n".join(lines))
