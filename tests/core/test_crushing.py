"""Joints that crush: closed forms, the strength of a face, what the verification refuses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from fenics_contact import (
    JointLaw,
    Load,
    Material,
    OutputOptions,
    Scene,
    SolveOptions,
    SolverError,
    equilibrium,
    limit_load,
)
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.console import summary
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import arch, polygons, wall
from fenics_contact.output.files import result_record
from tests.bank import coulomb, wall_recipe
from tests.helpers import mesh_of
from tests.property.crushing import crushing_blocks, voussoirs
from tests.quick import each_once, slow

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
        "solve": SolveOptions(fast=True),
    }
    return Scene(mesh, **{**given, **parts})


def block(elements: int = 2, degree: int = 1, strength: float | None = 1e5, **parts: Any) -> Scene:
    """A column of 0.4 x 0.8 m."""
    return scene(wall([[1.0]], (0.4, 0.8), elements), strength, 19.6e3, degree=degree, **parts)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("elements", "degree", "strength"), each_once([1, 2, 5, 16], [2, 1], [2e4, 1e5, 1e6, 1e9])
)
def test_rocking_block_on_any_mesh(elements, degree, strength):
    """(b - N / f_c) / h: the resultant stays half the block of pressure inside the toe."""
    force = 19.6e3 * 0.4 * 0.8
    result = limit_load(block(elements, degree, strength))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx((0.4 - force / strength) / 0.8, rel=1e-6)
    (place,) = result.positive.crushed
    assert place.position == pytest.approx((0.4, 0.0))
    assert place.length == pytest.approx(force / strength, rel=1e-6)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("count", "thickness", "radius", "embrace", "strength", "factor"),
    [
        (7, 0.15, 1.0, 157.5, 1e6, 0.36687),
        (9, 0.25, 1.125, 180.0, 2e5, 0.31691),
        *(
            pytest.param(*one, marks=pytest.mark.slow)
            for one in (
                (7, 0.15, 1.0, 157.5, 1e5, 0.30976),
                (11, 0.5, 2.0, 180.0, 1e5, 0.26620),
                (11, 0.5, 2.0, 180.0, 1e6, 0.39445),
            )
        ),
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
    assert result.positive.crushed is None
    assert result_record(result)["crushing"] is None
    assert "crushing" not in result.positive.certificate.residuals


def test_what_people_read():
    result = limit_load(block())
    assert "base crushes over 62.7 mm at (0.4, 0)" in summary(result)
    (place,) = result_record(result)["crushing"]
    assert place["length"] == pytest.approx(0.06272) and place["group"] == "base"
    assert result.positive.joints.normal_force.sum() == pytest.approx(6272.0, rel=1e-6)
    assert result.joints["pressure"].max() <= 1e5 * (1.0 + 1e-6)


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
    ("name", "associative"),
    [("W3", 0.396327), pytest.param("W4", 0.325331, marks=pytest.mark.slow)],
)
def test_walls_that_slide_and_crush(name, associative):
    """1 MPa. `associative`: `crushing_blocks` with 160 tangents, 0.396328 and 0.325332."""
    law = replace(coulomb(0.65), compressive_strength=1e6)
    result = limit_load(wall_recipe(name, law).scene())
    end = result.positive
    assert result.status == "limit" and end.engine == "faces" and end.gap < 1e-3
    assert end.bounds.upper == pytest.approx(associative, rel=5e-6)
    assert end.load_factor < limit_load(wall_recipe(name, coulomb(0.65)).scene()).bounds.upper
    assert end.load_factor < end.bounds.upper


def test_load_steps_are_skipped_where_joints_crush():
    result = limit_load(block(solve=replace(block().solve, control="load")))
    assert result.load_factor == pytest.approx(0.4216, rel=1e-6)
    assert "load steps: joints that crush have no loading path" in result.skipped


def test_without_a_loading_path_there_is_no_capacity_curve(tmp_path):
    result = limit_load(block(output=OutputOptions(capacity=3, paraview=False, pictures=False)))
    traced = result.with_capacity().with_capacity()
    assert traced.capacity == ()
    assert sum("no loading path leads to" in text for text in traced.skipped) == 1
    with pytest.raises(SolverError, match="no loading path leads to"):
        result.plot_capacity()
    result.write(tmp_path)
    assert (tmp_path / "result.json").exists() and not (tmp_path / "capacity.csv").exists()


@pytest.mark.slow
def test_blocks_whose_strains_have_no_digits_have_no_limit():
    """A bulk modulus of which floating point numbers hold nothing: faces do not know of it."""
    hopeless = {"default": Material(1e9, 0.4999999999999999, 1960.0)}
    for engine in ("auto", "faces"):
        options = replace(block().solve, engine=engine)
        result = limit_load(block(strength=None, materials=hopeless, solve=options))
        assert result.status == "not_converged"
    assert "the blocks miss equilibrium" in result.positive.reason


@pytest.mark.parametrize("base", [None, *slow(1e6)])
def test_curved_joints_that_are_pressed_beyond_their_strength_are_told(base):
    """Some 40 kPa in a joint with a kink of 10 degrees, whose points have no common side."""
    rise = float(np.tan(np.radians(5.0)))
    lower = [(-1, -1), (1, -1), (1, 0), (0, rise), (-1, 0)]
    upper = [(-1, 0), (0, rise), (1, 0), (1, 2), (-1, 2)]
    ground = {"base": [((-1.0, -1.0), (1.0, -1.0))]}
    model = polygons([np.array(one, float) for one in (lower, upper)], 3.0, groups=ground)
    found = {}
    for strength in (2e4, 1e9):
        laws = JointLaw(friction=0.5, compressive_strength=strength)
        rock = JointLaw(friction=0.5, compressive_strength=base)
        parts = {"joints": {"default": laws}, "foundations": {"base": rock}}
        found[strength] = limit_load(scene(model, None, 2e4, **parts))
        assert found[strength].status == "limit"
    pressed = found[2e4].positive.pressed
    assert "exceeded at curved joints" in pressed and not found[1e9].positive.pressed
    assert f"warning: {pressed}" in summary(found[2e4])
    assert pressed in result_record(found[2e4])["warnings"]


@pytest.mark.parametrize("strength", [2e5, 3e5, 1e6])
def test_a_toe_that_crushes_is_named(strength):
    """It crushes over W / f_c; how far its state is from the strength is within the state's gap."""
    model = polygons([[(0, 0), (1, 0), (1, 2), (0, 2)]], 0.25, groups={"base": [((0, 0), (1, 0))]})
    result = limit_load(scene(model, strength))
    (place,) = result.positive.crushed
    assert place.group == "base" and place.position == pytest.approx((1.0, 0.0))
    assert place.length == pytest.approx(2.0 * WEIGHT / strength, rel=1e-3)
