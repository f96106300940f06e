"""Hinges: where they are, what wedges give way, and the problem with more compliant nodes."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.joints import GROUND
from fenics_contact.discretization.materials import wedge_compliance
from fenics_contact.mesh_error.soft_hinges import hinge_compliance
from tests.core.problems import THREE_BLOCKS

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


def some_nodes(whole: Discretization) -> np.ndarray:
    """Nodes of blocks at a few joint points."""
    nodes = np.unique(whole.joints.nodes[::3])
    return nodes[nodes != GROUND]


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
