"""Joints whose nodes do not match: rows of B_N and B_T, their lengths, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import InputError
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.facets import collect_boundary
from fenics_contact.discretization.joints import Joints, find_joints
from fenics_contact.discretization.materials import displacement_space
from fenics_contact.meshing import polygons
from tests.helpers import (
    Drawing,
    coulomb,
    grid_blocks,
    node_positions,
    on_ground,
    rotation,
)

ANGLE = 0.3
#: Elements of unlike sizes; the third block begins inside a facet of the first.
SIZES = (0.31, 0.17, 0.23)


def three_blocks(slope: float, quadrilaterals: bool, sizes=SIZES) -> Drawing:
    """A block with two on its sloping top, meshed one by one, all turned."""
    low, mid, high = 1.0, 1.0 + 0.83 * slope, 1.0 + 2.0 * slope
    outlines = [
        [(0, 0), (2, 0), (2, high), (0, low)],
        [(0, low), (0.83, mid), (0.83, 3), (0, 3)],
        [(0.83, mid), (2, high), (2, 3), (0.83, 3)],
    ]
    return Drawing.of(polygons(outlines, sizes, quadrilaterals=quadrilaterals)).turned(ANGLE)


CASES = [(d, q, s) for d in (1, 2) for q in (False, True) for s in (0.0, 0.4)]


@pytest.fixture(params=CASES, ids=lambda case: f"degree{case[0]}-quads{case[1]}-slope{case[2]}")
def jointed(request):
    degree, quadrilaterals, slope = request.param
    drawing = three_blocks(slope, quadrilaterals)
    with Discretization(on_ground(drawing.model(), coulomb(0.5), degree=degree)) as whole:
        yield whole


def test_contact_patch(jointed):
    # A uniform stress, with shear and pressure on every joint, is in equilibrium at all nodes.
    gradient = np.array([[1.0, 0.3], [0.2, -2.0]]) * 1e-3
    strain = 0.5 * (gradient + gradient.T)
    first, mu = (field.x.array[0] for field in jointed.elasticity.lame)
    stress = first * np.trace(strain) * np.eye(2) + 2.0 * mu * strain
    joints, boundary = jointed.joints, jointed.boundary
    comm = jointed.scene.comm
    own = jointed.elasticity.space.dofmap.index_map.local_range
    x = node_positions(jointed.elasticity.space)
    u = (x @ gradient.T)[slice(*own)].ravel()
    on_facets = np.zeros_like(x)  # forces of the stress on whole facets
    weight = np.array({2: [1, 1], 3: [1, 1, 4]}[boundary.nodes.shape[1]])
    for nodes, share in zip(boundary.nodes.T, weight / weight.sum(), strict=True):
        np.add.at(on_facets, nodes, share * boundary.length[:, None] * (boundary.normal @ stress))
    force = -joints.length[:, None] * (joints.normal @ stress)
    mine = jointed.operators.points
    pressure, shear = (
        np.sum(force * axis, axis=1)[mine] for axis in (joints.normal, joints.tangent)
    )
    left = (jointed.problem.stiffness @ u).reshape(-1, 2)
    left -= jointed.problem.joint_forces(pressure, shear).reshape(-1, 2)
    assert np.abs(force).max() > 0.0
    # What is left acts on the free outline: nothing inside the joints.
    middle = boundary.points[:, :2].mean(axis=1) @ rotation(ANGLE)
    free = np.any((np.abs(middle - [2, 3]) < 1e-9) | (np.abs(middle) < 1e-9), axis=1)
    outline = np.zeros(len(x), dtype=bool)
    outline[boundary.nodes[free]] = True
    inner = ~outline[slice(*own)]
    largest = np.abs(on_facets).max()
    assert comm.allreduce(int(inner.sum())) > 20
    assert np.abs(left[inner]).max(initial=0.0) < 1e-10 * largest
    between = joints.bodies[mine, 0] >= 0
    for operator in (jointed.problem.normal, jointed.problem.tangential):
        assert np.abs((operator @ u)[between]).max(initial=0.0) < 1e-12


def joints_of(drawing: Drawing, laws=None, degree: int = 1) -> Joints:
    scene = on_ground(drawing.model(), coulomb(0.5), foundations={}, degree=degree)
    scene = replace(scene, joints=laws or scene.joints)
    return find_joints(scene, collect_boundary(scene.mesh, displacement_space(scene)))


def stacked(gap: float, shift: float = 0.0, divisions: int = 3) -> Drawing:
    """A block of two elements along its top, and one of others above it."""
    lower, upper = ((0, 0), (1, 1), (2, 2)), ((shift, 1 + gap), (1, 1), (divisions, 2))
    return grid_blocks(lower, upper)


@pytest.mark.parametrize(("gap", "word"), [(1e-3, "apart"), (-5e-4, "overlap")])
def test_almost_touching_is_refused(gap, word):
    drawing = stacked(gap)
    with pytest.raises(InputError, match=rf"{word}.*\(0\.\d+, 1.*'bottom1', 'top0'.*together"):
        joints_of(drawing)


@pytest.mark.parametrize("divisions", [2, 3])
def test_thin_slabs_touch_their_neighbours_only(divisions):
    # The next but one is nearer than five thousandths of a facet.
    slabs = [((0, k), (2000, 1), (divisions if k % 2 else 2, 1)) for k in range(6)]
    joints = joints_of(grid_blocks(*slabs))
    assert joints.length.sum() == pytest.approx(5 * 2000.0, rel=1e-12)
    assert set(map(tuple, joints.bodies.tolist())) == {(k, k + 1) for k in range(5)}


def test_warning_of_a_gap():
    for gap, count in ((0.0, 0), (1e-4, 1)):
        drawing = stacked(gap)
        drawing.facets = {"base": drawing.facets["bottom0"]}
        with Discretization(on_ground(drawing.model(), coulomb(0.5))) as whole:
            found = [text for text in whole.warnings if "gaps or overlaps up to 0.0001 m" in text]
            assert len(found) == count
