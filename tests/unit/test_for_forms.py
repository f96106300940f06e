"""Stresses and measures of results, for forms of the user. Run on ranks by `make test-mpi`."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

from fenics_contact import InputError, Material, Scene, equilibrium, limit_load
from fenics_contact.meshing import running_bond
from tests.helpers import STONE, coulomb, on_ground

GRAVITY = 9.81


def wall(**options: Any) -> Scene:
    return on_ground(running_bond(3, 3), coulomb(0.65), **options)


def integral(form: Any, comm: MPI.Comm) -> float:
    return float(comm.allreduce(fem.assemble_scalar(fem.form(form)), MPI.SUM))


def soft(strain: Any, material: Material) -> Any:
    return 1e9 * strain


@pytest.mark.mpi
@pytest.mark.parametrize("options", [{}, {"degree": 2}, {"plane": "stress"}, {"stress": soft}])
def test_vertical_stress_balances_the_weight(options):
    """Virtual work on the motion (0, y): int sigma_yy = -rho g int y; faces of joints cancel."""
    found = equilibrium(wall(**options), 0.2)
    assert found.status == "equilibrium"
    dx, _ = found.measures()
    y = ufl.SpatialCoordinate(dx.ufl_domain())[1]
    comm = found.layout.scene.comm
    weight = STONE.density * GRAVITY * integral(y * dx, comm)
    assert integral(found.stress[1, 1] * dx, comm) == pytest.approx(-weight, rel=1e-7)


@pytest.mark.mpi
def test_stress_of_a_limit_load_balances_the_loads():
    """The same for the collapse, and for (0, x), on which couples work: int sigma_xy."""
    result = limit_load(wall())
    for one in (result, pickle.loads(pickle.dumps(result))):
        dx, _ = one.measures()
        x, y = ufl.SpatialCoordinate(dx.ufl_domain())
        comm = one.scene.comm
        weight = STONE.density * GRAVITY
        yy, yx = (integral(one.stress[1, k] * dx, comm) for k in (1, 0))
        joints = one.joints
        ground = joints["blocks"][:, 0] == -1
        lifted = float(joints["force"][ground, 1] @ joints["position"][ground, 0])
        assert yy == pytest.approx(-weight * integral(y * dx, comm), rel=1e-6)
        assert yx == pytest.approx(lifted - weight * integral(x * dx, comm), rel=1e-5)


@pytest.mark.mpi
def test_measures_know_the_groups():
    scene = wall()
    found = equilibrium(scene, 0.0)
    dx, ds = found.measures()
    comm = scene.comm
    one = fem.Constant(dx.ufl_domain(), 1.0)
    blocks = found.blocks["area"].sum()
    base = found.joints["length"][found.joints["group"] == "base"].sum()
    assert integral(one * dx("blocks"), comm) == pytest.approx(blocks, rel=1e-12)
    assert integral(one * ds("base"), comm) == pytest.approx(base, rel=1e-12)
    with pytest.raises(InputError, match=r"ds\('bse'\) is over no group; give one of the names"):
        ds("bse")


def test_no_stress_without_a_state():
    scene = replace(wall(), foundations={"base": coulomb(0.0)}, joints={"default": coulomb(0.0)})
    found = equilibrium(scene, 0.5)
    assert found.status == "no_equilibrium" and found.stress is None
