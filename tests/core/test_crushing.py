"""Joints that crush: closed forms, the strength of a face, what the verification refuses."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fenics_contact import JointLaw, Load, Material, Scene, equilibrium, limit_load
from fenics_contact.collapse.crushed import Brackets, CrushedJoints, certified
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.collapse.strategy import strategy_of
from fenics_contact.collapse.work_control import find_collapse
from fenics_contact.console import summary
from fenics_contact.discretization.crushing import CrushedEnds, Crushing
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import arch, wall
from fenics_contact.output.files import result_record
from tests.bank import coulomb, wall_recipe
from tests.helpers import mesh_of
from tests.property.crushing import crushing_blocks, voussoirs

#: Unit weight, N/m3, in the closed forms.
WEIGHT = 1e4


def scene(
    model: Any, strength: float | None, weight: float = WEIGHT, friction: float = 5.0, **parts: Any
) -> Scene:
    """Blocks on ground that is named "base" or "springings", pushed by their weight."""
    law, mesh = JointLaw(friction=friction), mesh_of(model)
    ground = next(name for name in ("base", "springings") if name in mesh.facet_names)
    given = {
        "materials": {"default": Material(1e9, 0.2, weight / 10.0, strength)},
        "dead": Load((0.0, -10.0)),
        "live": Load((10.0, 0.0)),
        "joints": {"default": law},
        "foundations": {ground: law},
    }
    return Scene(mesh, **{**given, **parts})


def block(elements: int = 2, degree: int = 1, strength: float | None = 1e5, **parts: Any) -> Scene:
    """A column of 0.4 x 0.8 m."""
    return scene(wall([[1.0]], (0.4, 0.8), elements), strength, 19.6e3, degree=degree, **parts)


@pytest.mark.mpi
@pytest.mark.parametrize("elements", [1, 2, 5, 16])
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("strength", [2e4, 1e5, 1e6, 1e9])
def test_rocking_block_on_any_mesh(elements, degree, strength):
    """(b - N / f_c) / h: the resultant stays half the block of pressure inside the toe."""
    if elements == 16 and degree == 2:
        return
    force = 19.6e3 * 0.4 * 0.8
    result = limit_load(block(elements, degree, strength))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx((0.4 - force / strength) / 0.8, rel=1e-6)
    (place,) = result.positive.crushed
    assert place.position == pytest.approx((0.4, 0.0))
    assert place.length == pytest.approx(force / strength, rel=1e-6)


def test_block_that_is_pushed_to_the_other_side_and_in_other_units():
    left = block(live=Load((-10.0, 0.0)))
    soft = block(materials={"default": Material(1e7, 0.3, 1960.0, 1e5)})
    both = limit_load(block(solve=replace(block().solve, direction="both")))
    for factor in (limit_load(left).load_factor, limit_load(soft).load_factor, both.load_factor):
        assert factor == pytest.approx(0.4216, rel=1e-6)
    assert both.load_factor_negative == pytest.approx(-0.4216, rel=1e-6)
    assert both.negative.crushed[0].position == pytest.approx((0.0, 0.0))


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("count", "thickness", "radius", "embrace", "strength", "factor"),
    [
        (7, 0.15, 1.0, 157.5, 1e5, 0.30976),
        (7, 0.15, 1.0, 157.5, 1e6, 0.36687),
        (11, 0.5, 2.0, 180.0, 1e5, 0.26620),
        (11, 0.5, 2.0, 180.0, 1e6, 0.39445),
        (9, 0.25, 1.125, 180.0, 2e5, 0.31691),
    ],
)
def test_arches(count, thickness, radius, embrace, strength, factor):
    """Against a program of resultants with many tangents at every joint."""
    model = arch(count, thickness, radius, embrace, 3)
    result = limit_load(scene(model, strength))
    independent = crushing_blocks(*voussoirs(count, thickness, radius, embrace), strength, WEIGHT)
    assert result.load_factor == pytest.approx(factor, abs=1e-5)
    assert result.load_factor == pytest.approx(independent, rel=1e-5)
    assert result.bounds.upper == pytest.approx(result.load_factor, rel=1e-6)


def test_without_a_strength_nothing_is_done_for_it():
    result = limit_load(block(strength=None))
    assert result.load_factor == pytest.approx(0.5, rel=1e-6)
    assert result.positive.crushed_ends is None
    assert result_record(result)["crushing"] is None
    assert "crushing" not in result.positive.certificate.residuals


def test_what_people_read():
    result = limit_load(block())
    assert "base crushes over 62.7 mm at (0.4, 0)" in summary(result)
    (place,) = result_record(result)["crushing"]
    assert place["length"] == pytest.approx(0.06272) and place["group"] == "base"
    assert result.positive.joints.normal_force.sum() == pytest.approx(6272.0, rel=1e-6)
    assert result.joints["pressure"].max() <= 1e5 * (1.0 + 1e-6)


def test_pressure_is_the_strength_where_a_fine_mesh_crushes():
    result = limit_load(block(16))
    x, pressure = result.joints["position"][:, 0], result.joints["pressure"]
    assert pressure[x > 0.4 - 0.06272 + 0.0125] == pytest.approx(1e5, rel=1e-6)
    assert pressure[x < 0.4 - 0.06272 - 0.0125] == pytest.approx(0.0, abs=1.0)


def test_column_that_crushes_under_its_own_weight_does_not_stand():
    assert limit_load(block(strength=1.5e4)).status == "unstable"
    assert limit_load(block(strength=1.6e4)).status == "limit"


@pytest.mark.parametrize("factor", [0.2, 0.42])
def test_equilibrium_below_the_limit(factor):
    found = equilibrium(block(), factor)
    assert found.status == "equilibrium"
    assert found.residuals["crushing"] <= 1e-6


def test_no_equilibrium_between_the_limits_with_and_without_crushing():
    assert equilibrium(block(), 0.43).status == "no_equilibrium"


@contextmanager
def cases(of: Scene) -> Iterator[tuple[LoadCase, Crushing]]:
    """The load case of a scene and the strengths of its faces."""
    with Discretization(of) as made:
        kind = strategy_of(of).kind
        case = LoadCase.of(made, made.bonded(kind), 1.0, kind, lambda step: None)
        assert case.blocks.crushing is not None
        yield case, case.blocks.crushing


def test_a_state_with_the_resultant_at_the_edge_is_refused():
    with cases(block()) as (case, crushing):
        end = find_collapse(case, strategy_of(block()), 1e-6)
        assert end.status == "limit" and end.load_factor == pytest.approx(0.5, rel=1e-6)
        whole = CrushedJoints.of(case, crushing, CrushedEnds.none(crushing))
        refused = certified(crushing, whole, end)
        assert refused.status == "not_converged" and "crush" in refused.reason
        assert "crushing" in refused.certificate.failures
        # Beyond by N^2 / (2 f_c), in units of N L.
        assert refused.certificate.residuals["crushing"] == pytest.approx(0.0784, rel=1e-4)


@pytest.mark.parametrize("force", [5e3, 7e3])
def test_tangents_at_another_force_are_refused(force):
    """They are above the strength, and give a larger load factor."""
    with cases(block()) as (case, crushing):
        toe = CrushedEnds(-np.ones(1), np.array([force]))  # the tangent of the base points to -x
        crushed = CrushedJoints.of(case, crushing, toe)
        end = find_collapse(crushed.case, strategy_of(block()), 1e-6)
        assert end.load_factor > 0.4216 + 1e-4
        assert certified(crushing, crushed, end).status == "not_converged"
        crushed.close()


def face(*pieces: tuple[float, float], strength: float = 2.0) -> Crushing:
    """One face with contact over some lengths."""
    ends = np.array(pieces)
    of_piece = np.zeros(len(pieces), dtype=np.int64)
    of_point, place = np.zeros(2, dtype=np.int64), ends.ravel()[[0, -1]]
    return Crushing(of_point, place, np.array([strength]), of_piece, ends)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("force", [0.0, 0.3, 1.0, 3.9])
def test_strength_of_one_length(side, force):
    moment, place = face((-1.0, 1.0)).largest(np.array([force]), np.array([side]))
    assert moment == pytest.approx(force * (2.0 - force / 2.0) / 2.0)
    assert place == pytest.approx(side * (1.0 - force / 2.0))


def test_strength_of_a_face_with_a_hole():
    """The block of pressure goes on behind the hole."""
    moment, place = face((-1.0, -0.5), (0.5, 1.0)).largest(np.array([1.5]), np.array([1.0]))
    assert moment == pytest.approx(2.0 * (0.5 * 0.75 - 0.25 * 0.625))
    assert place == pytest.approx(-0.75)


def test_tangent_is_above_the_strength():
    one, force, side = face((-1.0, 1.0)), np.linspace(0.0, 4.0, 41), np.array([1.0])
    couple, place = one.tangent(np.array([1.3]), side)
    above = couple + force * place
    strength = np.array([one.largest(np.array([n]), side)[0][0] for n in force])
    assert np.all(above >= strength - 1e-12)
    assert above[13] == pytest.approx(strength[13])


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: block(strength=1e5, friction=0.3), 0.3),  # slides before it crushes
        (lambda: scene(wall([[1.0], [1.0]], (0.4, 0.4), 2), 16e3), 0.25),
        (lambda: block(live=Load((0.0, -10.0))), 5.377551),  # f_c L = N (1 + lambda)
    ],
)
def test_programs(make: Callable[[], Scene], expected: float):
    with Discretization(make()) as made:
        assert RigidBlocks.of(made).limit() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "factor", "associative"), [("W3", 0.349545, 0.396327), ("W4", 0.259429, 0.325331)]
)
def test_walls_that_slide_and_crush(name, factor, associative):
    """1 MPa. `associative`: `crushing_blocks` with 160 tangents, 0.396328 and 0.325332.

    That the load factor is the limit load for the friction of the state the program says, which
    knows the strength itself and collects tangents of its own.
    """
    law = replace(coulomb(0.65), compressive_strength=1e6)
    result = limit_load(wall_recipe(name, law).scene(error=False))
    end = result.positive
    assert end.load_factor == pytest.approx(factor, rel=1e-5)
    assert end.bounds.upper == pytest.approx(associative, rel=5e-6)
    friction = result.layout.joints.friction * end.joints.normal_force
    with Discretization(result.scene) as made:
        factor, _ = RigidBlocks.of(made).collapse(friction)
    assert factor == pytest.approx(end.load_factor, rel=1e-5)
    assert end.peak.status == end.lowest.status == "not_known"


def test_joint_forces_are_within_the_strength():
    """Forces at the joint points obey the strength of their faces, whatever the mesh shows."""
    result = limit_load(scene(arch(7, 0.15, 1.0, 157.5, 4), 1e5))
    with cases(result.scene) as (_, crushing):
        force, moment = crushing.resultants(result.positive.joints.normal_force)
    beyond, _ = crushing.excess(force, moment)
    assert np.all(beyond <= 1e-6 * force.max() * crushing.length)
    assert np.sum(beyond > -1e-6 * force.max() * crushing.length) == 4  # hinges


def renewals(force_at: Callable[[float], float], count: int) -> list[float]:
    """N0 of one face after another state, from N0 = 1000, where N depends on N0."""
    brackets = Brackets(1)
    now = [1000.0]
    for _ in range(count):
        at = np.array([now[-1]])
        now.append(float(brackets.renewed(at, np.array([force_at(now[-1])]), np.array([True]))[0]))
    return now


def test_force_of_a_corner_that_opens_at_a_small_force_is_enclosed():
    """The face carries 2000 without a block of pressure, and nothing from N0 = 20 on."""
    found = renewals(lambda force: 2000.0 * max(1.0 - force / 20.0, 0.0), 15)
    assert found[-1] == pytest.approx(2000.0 / 101.0, rel=5e-2)


def test_force_that_hardly_depends_on_that_of_the_tangent_settles_at_once():
    found = renewals(lambda force: 700.0 - 1e-3 * force, 3)
    assert found[-1] == pytest.approx(700.0 / 1.001, rel=1e-8)


def test_force_that_other_faces_have_changed_leaves_its_bracket():
    """What was found at either side of N0 = 500 is forgotten where it no longer holds."""
    brackets = Brackets(1)
    for at, force in [(400.0, 600.0), (600.0, 400.0)]:
        brackets.renewed(np.array([at]), np.array([force]), np.array([True]))
    now = 500.0
    for _ in range(4):
        now = float(brackets.renewed(np.array([now]), np.array([900.0]), np.array([True]))[0])
    assert now == pytest.approx(900.0)
