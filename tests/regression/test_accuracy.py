"""An accuracy that is wished: reached by hinges of other lengths, degree and refinement."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import InputError, LimitLoad, Load, SolveOptions, limit_load, sweep
from fenics_contact.console import summary
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.output.files import result_record, strict
from tests.bank import BANK, Variant, coulomb, wall_recipe
from tests.helpers import numbers
from tests.quick import slow, slow_rows

W4 = wall_recipe("W4", coulomb(0.65))
#: Pushed from the left, and from both sides; two refined meshes of 125 000 displacements.
PUSHED = replace(W4, parts={"live": Load(traction={"left": (1e3, 0.0)})}), 4.96588
SQUEEZED = replace(W4, parts={"live": Load(traction={"left": (1e3, 0.0), "right": (-1e3, 0.0)})})


@cache
def accurate() -> LimitLoad:
    return limit_load(W4.scene(2, direction="both", accuracy=1e-3))


@pytest.mark.mpi
def test_point_hinges_are_accurate_on_two_meshes():
    result = accurate()
    assert result.status == "limit" and not result.inaccurate
    assert result.load_factor == pytest.approx(0.279514, rel=2e-4)
    rows = [row for row in result.passes if row.direction == "positive"]
    assert [(row.degree, row.hinges) for row in rows] == [*product((1, 2), ("mesh", "points"))]
    assert (rows[0].displacements, rows[1].displacements) == (1410, 1410)
    assert rows[0].load_factor == pytest.approx(0.263736, rel=1e-5)
    assert rows[0].hinge_error == pytest.approx(0.06, rel=0.05)
    assert np.isnan(rows[1].estimate)  # one mesh alone does not tell
    assert rows[-1].estimate < 1e-3


@pytest.mark.slow
def test_ten_times_fewer_displacements_than_uniform_meshes():
    """W4 to 1e-3 with 1 410; seven times as many on uniform meshes are 2 % off and more."""
    result = limit_load(W4.scene(1, accuracy=1e-3))
    assert result.load_factor == pytest.approx(0.279515, rel=1e-4)
    assert [row.displacements for row in result.passes] == [580, 580, 1410, 1410]
    for elements, degree in ((8, 1), (4, 2)):
        uniform = limit_load(W4.scene(elements, variant=Variant(degree=degree), error=False))
        assert uniform.layout.size > 10000
        assert abs(uniform.load_factor / 0.279515 - 1.0) > 2e-2


def test_sweeps_have_the_accuracy_too():
    scene = W4.scene(1, comm=MPI.COMM_SELF, accuracy=1e-3)
    found = sweep(scene, {"joints.default.friction": [0.65]})
    assert found[0].load_factor == pytest.approx(0.279515, rel=1e-3)


@pytest.mark.parametrize(
    ("wished", "quadrilaterals"),
    [pytest.param(4e-3, False, marks=pytest.mark.mpi), *slow_rows((1e-3, False), (1e-3, True))],
)
def test_refinement_where_joints_slide(wished, quadrilaterals):
    recipe, exact = PUSHED
    scene = recipe.scene(1, accuracy=wished, variant=Variant(quadrilaterals=quadrilaterals))
    result = limit_load(scene)
    assert not result.inaccurate
    assert result.load_factor == pytest.approx(exact, rel=wished)
    rows = result.passes
    assert [row.degree for row in rows[:3]] == [1, 2, 2] and np.isnan(rows[0].estimate)
    assert all(abs(row.load_factor / exact - 1.0) < row.estimate for row in rows[1:])
    assert np.all(np.diff([row.displacements for row in rows]) > 0)
    assert rows[-1].estimate <= wished < rows[-2].estimate
    assert rows[-1].displacements < 30000


def test_state_of_hinges_is_in_equilibrium_on_the_mesh():
    """Its displacements are those of the mesh, without the indentation of the hinges."""
    result = accurate()
    state = result.positive.state
    with Discretization(result.scene) as whole:
        kkt = whole.problem
        inner = kkt.stiffness @ state.elastic
        outer = kkt.dead + state.load_factor * kkt.live
        outer = outer + kkt.joint_forces(state.pressure, state.shear)
    # It was found with much softer nodes, to 1e-9 of typical forces.
    assert np.abs(inner - outer).max() < 1e-7 * np.abs(outer).max()


def test_both_directions_and_record():
    result = accurate()
    factors = [result.load_factor, result.load_factor_negative]
    assert factors == pytest.approx([0.279514, -0.279514], rel=2e-4)
    record = json.loads(json.dumps(strict(result_record(result))))
    for direction, sign in (("positive", 1.0), ("negative", -1.0)):
        rows = [row for row in record["passes"] if row["direction"] == direction]
        assert [row["hinges"] for row in rows] == 2 * ["mesh", "points"]
        assert rows[1]["estimate"] is None
        assert rows[-1]["load_factor"] == pytest.approx(sign * 0.279514, rel=2e-4)
        assert 0.0 < rows[-1]["estimate"] < 1e-4
    assert "point hinges: load factor 0.27951" in summary(result, verbose=True)
    assert f"{result.load_factor:.4f} with points" in summary(result, verbose=True)


@pytest.mark.slow
def test_another_state_on_finer_meshes_is_the_one_reported():
    result = limit_load(wall_recipe("W3", coulomb(0.65)).scene(2, accuracy=1e-3))
    assert result.load_factor == pytest.approx(0.36195, rel=1e-3)
    assert result.positive.hinges.load_factor == pytest.approx(0.35582, rel=1e-4)


def test_an_accuracy_that_is_not_reached_is_said():
    with numbers(meshes=2):
        result = limit_load(SQUEEZED.scene(1, accuracy=1e-4))
    assert result.status == "limit"
    assert "2 meshes" in result.inaccurate
    assert len(result.passes) == 2
    assert any("2 meshes" in text for text in result_record(result)["warnings"])
    assert "NOT REACHED" in summary(result, verbose=True)


@pytest.mark.parametrize("name", ["W1 tresca 2 kPa", *slow("arch 15 0.15")])
def test_one_pass_where_nothing_depends_on_the_mesh(name):
    plain, result = (limit_load(BANK[name].scene(accuracy=wished)) for wished in (None, 1e-4))
    assert result.load_factor == plain.load_factor
    assert plain.passes == ()
    assert len(result.passes) == 1


@pytest.mark.parametrize(
    "options",
    [{"accuracy": 0.0}, {"accuracy": 1.0}, {"error": False}, {"control": "load"}],
)
def test_options_that_do_not_fit(options):
    with pytest.raises(InputError, match="accuracy"):
        SolveOptions(**{"accuracy": 1e-3, **options})
