"""Joint forces of least size: they load the nodes as those of the solver, and obey all laws."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import JointLaw, limit_load
from fenics_contact.discretization.discretization import Discretization
from tests.bank import Variant, coulomb, tresca, wall_recipe
from tests.helpers import dense

COHESIVE = JointLaw(friction=0.5, cohesion=2e3)
SCENES = {
    "W3": ("W3", coulomb(0.65), Variant()),
    "W4, degree 2": ("W4", coulomb(0.65), Variant(degree=2)),
    "W4, one by one": ("W4", coulomb(0.5), Variant(one_by_one=1)),
    "W2, cohesion": ("W2", COHESIVE, Variant()),
    "W1, Tresca": ("W1", tresca(2e3), Variant()),
}


@pytest.fixture(scope="module", params=SCENES)
def solved(request):
    """A result, its matrices, and the solver's joint forces at all points, shape (points, 2)."""
    name, law, variant = SCENES[request.param]
    result = limit_load(wall_recipe(name, law).scene(2, variant=variant))
    assert result.status == "limit"
    state = result.positive.state
    with Discretization(result.scene) as whole:
        raw = np.column_stack([whole.all_points(r) for r in (state.pressure, state.shear)])
        yield result, whole, raw


def least(result) -> np.ndarray:
    values = result.positive.joints
    return np.column_stack([values.normal_force, values.shear_force])


def size(forces, joints) -> float:
    """The sum of force^2 / length."""
    return float(np.sum(forces**2 / joints.length[:, None]))


def nodal_rows(whole) -> np.ndarray:
    """B_N and B_T of all joint points on all ranks, shape (points, 2, displacements)."""
    order = np.argsort(np.concatenate(whole.scene.comm.allgather(whole.operators.points)))
    operators = whole.operators.normal, whole.operators.tangential
    return np.stack([dense(operator)[order] for operator in operators], axis=1)


@pytest.mark.mpi
def test_nodes_are_loaded_alike_by_less(solved):
    result, whole, raw = solved
    changed = least(result) - raw
    nodal = np.einsum("pcd,pc->d", nodal_rows(whole), changed)
    assert np.abs(nodal).max() <= 1e-10 * np.abs(raw).max()
    assert np.abs(changed).max() > 1e-3 * np.abs(raw).max()
    assert size(least(result), whole.joints) < size(raw, whole.joints)


def moved(result):
    """Points that have opened or slipped, or do so in the collapse mode."""
    values = result.positive.joints
    so_far = np.maximum(values.gap, np.abs(values.slip))
    return (so_far > 1e-6 * so_far.max()) | values.opens | values.slips


def test_laws_hold_and_bounds_stay(solved):
    result, whole, raw = solved
    joints, (normal, shear) = whole.joints, least(result).T
    largest = np.abs(raw).max()
    bound = joints.friction * normal + joints.shear_strength
    assert normal.min() >= 0.0
    assert np.max(np.abs(shear) - bound) <= 1e-10 * largest
    strict = joints.friction * raw[:, 0] + joints.shear_strength - np.abs(raw[:, 1])
    at_bound = (raw[:, 0] < 1e-8 * largest) | (strict < 1e-8 * largest)
    assert np.array_equal(least(result)[at_bound], raw[at_bound])
    moves = result.positive.joints.opens | result.positive.joints.slips | moved(result)
    assert np.array_equal(least(result)[moves], raw[moves])
