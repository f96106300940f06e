"""Hinges: where they are, what wedges give way, and the problem with more compliant nodes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import JointLaw
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.joints import GROUND, Joints
from fenics_contact.discretization.materials import wedge_compliance
from fenics_contact.discretization.mortar import Stencil
from fenics_contact.mesh_error.soft_hinges import hinge_compliance, soft_hinges
from fenics_contact.results.joint_values import JointValues
from tests.core.problems import THREE_BLOCKS, load_case, on_an_inclined_roller
from tests.helpers import dense

MODULUS = 2.0e9


def compliance(degrees: float, bisector: tuple[float, float] = (0.0, -1.0)) -> np.ndarray:
    """C of one wedge of an isotropic material without lateral strains."""
    angle = np.array([np.radians(degrees)])
    law = MODULUS * np.diag([1.0, 1.0, 0.5])
    return wedge_compliance(law[None], angle, np.array([bisector]))[0]


def test_half_plane_gives_way_alike_in_all_directions():
    """Flamant: u = 2 P / (pi E') log(r)."""
    flamant = 2.0 * np.log(2.0) / (np.pi * MODULUS)
    assert compliance(180.0) == pytest.approx(flamant * np.eye(2), rel=1e-12)


def test_thin_wedge_is_a_bar_along_its_axis():
    """A bar of width 2 a r gives way by P / (E' 2 a) log(2)."""
    along = compliance(1.0)[1, 1]
    assert along == pytest.approx(np.log(2.0) / (MODULUS * np.radians(1.0)), rel=1e-4)


def test_sharper_wedges_give_way_more_and_most_across():
    sizes = [np.linalg.eigvalsh(compliance(angle)) for angle in (150.0, 90.0, 45.0)]
    assert np.all(np.diff(sizes, axis=0) > 0.0)
    diagonal = compliance(90.0, (np.sqrt(0.5), np.sqrt(0.5)))
    assert diagonal[0, 1] < 0.0  # less along the bisector than across
    assert np.linalg.eigvalsh(diagonal) == pytest.approx(np.linalg.eigvalsh(compliance(90.0)))


def joints_in_a_row(count: int) -> Joints:
    """Points along one joint with a facet between neighbours."""
    places = np.arange(count)
    nodes = np.column_stack([places, places + count])
    position = np.column_stack([places, np.zeros(count)]).astype(float)
    return Joints(
        nodes=nodes,
        bodies=np.tile([0, 1], (count, 1)),
        position=position,
        sides=np.stack([position, position], axis=1),
        normal=np.tile([0.0, 1.0], (count, 1)),
        length=np.ones(count),
        law=np.zeros(count, dtype=int),
        laws=(JointLaw("coulomb", friction=0.5),),
        names=("default",),
        segments=np.column_stack([places[:-1], places[1:]]),
        middle=places[:0],
        stencil=Stencil(nodes[:, :, None], np.ones((count, 2, 1))),
        gap=np.zeros(count),
        curvature=np.zeros(count),
    )


@pytest.mark.parametrize(
    ("force", "opening_rate", "expected"),
    [
        ([0, 0, 0, 1], [3, 2, 1, 0], [3]),
        ([0, 0, 1, 1], [2, 1, 0, 0], []),  # closed over a length
        ([0, 0, 0, 0], [3, 2, 1, 0], [3]),  # shorter hinges may press it
        ([1, 0, 0, 0], [0, 0, 0, 0], []),  # nothing opens
    ],
)
def test_hinge_is_a_point_that_does_not_open_next_to_open_ones(force, opening_rate, expected):
    zero = np.zeros(4)
    values = JointValues(np.array(force, float), *[zero] * 9)
    values = replace(values, clearance_rate=np.array(opening_rate, float))
    assert values.hinges(joints_in_a_row(4).neighbours).tolist() == expected


def some_nodes(whole: Discretization) -> np.ndarray:
    """Nodes of blocks at a few joint points."""
    nodes = np.unique(whole.joints.nodes[::3])
    return nodes[nodes != GROUND]


@pytest.mark.mpi
@pytest.mark.parametrize("scene", ["on the ground", "inclined roller", "quadratic"])
def test_soft_hinges_are_springs_beside_the_modes(scene):
    """Their columns are those of the nodes in B; rigid motions and loads do not move them."""
    if scene == "inclined roller":
        made = on_an_inclined_roller(2, "fixed")
    else:
        made = THREE_BLOCKS.scene(2)
        made = replace(made, degree=2) if scene == "quadratic" else made
    with load_case(made) as case:
        whole = case.discretization
        points = np.arange(0, whole.joints.joint_count, 3)
        nodes = some_nodes(whole)
        compliance = hinge_compliance(whole, nodes)
        reduced = whole.block_modes.reduced
        with soft_hinges(case, points, 6.0) as soft:
            problem = soft.problem
            assert problem.size == reduced.size + 2 * len(nodes)
            stiffness = dense(problem.stiffness.matrix)
            springs = np.zeros((2 * len(nodes), 2 * len(nodes)))
            for k, block in enumerate(compliance):
                springs[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = np.linalg.inv(6.0 * block)
            assert stiffness[soft.modes :, soft.modes :] == pytest.approx(springs)
            assert np.all(stiffness[soft.modes :, : soft.modes] == 0.0)
            assert np.all(problem.dead[soft.modes :] == 0.0)
            dofs = (2 * nodes[:, None] + np.arange(2)).ravel()
            given = case.problem.normal, case.problem.tangential
            order = np.argsort(np.concatenate(case.problem.comm.allgather(whole.operators.points)))
            for rows, operator in zip((problem.normal, problem.tangential), given, strict=True):
                columns = dense(operator.matrix)[order][:, dofs]
                assert dense(rows.matrix)[:, soft.modes :] == pytest.approx(columns)


@pytest.mark.mpi
def test_compliance_of_corners_and_sides():
    """Angles and bisectors are those of the outlines; E over 1 - nu^2 in plane strain."""
    with Discretization(THREE_BLOCKS.scene(2)) as whole:
        nodes = some_nodes(whole)
        boundary = whole.boundary
        ends = boundary.nodes[:, :2].ravel()
        material = whole.scene.materials["default"]
        modulus = material.young / (1.0 - material.poisson**2)
        for node, found in zip(nodes, hinge_compliance(whole, nodes), strict=True):
            normals = np.repeat(boundary.normal, 2, axis=0)[ends == node]
            straight = normals[0] @ normals[1] > 0.5
            bisector = -normals.sum(axis=0) / np.linalg.norm(normals.sum(axis=0))
            wedge = compliance(180.0 if straight else 90.0, bisector) * MODULUS / modulus
            assert found == pytest.approx(wedge, rel=1e-10, abs=1e-15 / modulus)
