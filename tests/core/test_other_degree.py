"""Values carried over between displacements of degree 1 and 2 on one mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact.discretization.discretization import Discretization
from fenics_contact.mesh_error.other_degree import Counterparts
from tests.core.problems import THREE_BLOCKS, on_an_inclined_roller


def linear(whole: Discretization) -> np.ndarray:
    """A displacement that is linear in place, in the supports' coordinates."""
    space = whole.elasticity.space
    x, y = space.tabulate_dof_coordinates()[: len(whole.elasticity.arm), :2].T
    u = np.column_stack([0.3 * x - 0.2 * y, 0.1 + 0.5 * y])
    first = space.dofmap.index_map.local_range[0]
    return whole.supports.to_supports(u.ravel(), first)


@pytest.fixture(params=[(1, 2), (2, 1)], ids=["to degree 2", "to degree 1"])
def degrees(request):
    return request.param


@pytest.mark.mpi
@pytest.mark.parametrize("roller", [False, True])
def test_linear_displacements_are_kept(degrees, roller):
    scene = on_an_inclined_roller(2, "fixed") if roller else THREE_BLOCKS.scene(2)
    given, other = (Discretization(replace(scene, degree=degree)) for degree in degrees)
    with given, other:
        carried = Counterparts.of(given, other).displacement(linear(given))
        assert carried == pytest.approx(linear(other), abs=1e-12)


@pytest.mark.mpi
def test_uniform_pressure_and_resultants_are_kept(degrees):
    scene = THREE_BLOCKS.scene(2)
    given, other = (Discretization(replace(scene, degree=degree)) for degree in degrees)
    with given, other:
        counterparts = Counterparts.of(given, other)
        length = [one.joints.length[one.operators.points] for one in (given, other)]
        pressure = np.stack([3.0 * length[0], -1.0 * length[0]])
        expected = np.stack([3.0 * length[1], -1.0 * length[1]])
        assert counterparts.forces(pressure) == pytest.approx(expected, rel=1e-12)
        random = np.random.default_rng(1).random((2, len(given.joints.length)))
        found = counterparts.forces(random[:, given.operators.points])
        total = [other.scene.comm.allreduce(float(r.sum())) for r in found]
        assert total == pytest.approx(random.sum(axis=1), rel=1e-12)


def test_force_on_one_node_stays_there():
    with Discretization(THREE_BLOCKS.scene(2)) as given:
        with Discretization(replace(given.scene, degree=2)) as other:
            counterparts = Counterparts.of(given, other)
            forces = np.zeros((2, len(given.joints.length)))
            forces[:, 0] = 5.0, 2.0
            found = counterparts.forces(forces[:, given.operators.points])
            point = counterparts.points(np.array([0]))
            moved = np.zeros((2, len(other.joints.length)))
            moved[:, point] = forces[:, :1]
            assert found == pytest.approx(moved[:, other.operators.points])
            place = other.joints.position[point]
            assert place == pytest.approx(given.joints.position[:1])
