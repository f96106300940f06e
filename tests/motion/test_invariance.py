"""What must not change a way after the peak: turning, mirroring, other numbers of blocks."""

from __future__ import annotations

from functools import cache, partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fenics_contact.spatial import JointLaw, Load, Material, Scene, SolveOptions, builders
from tests.motion.structures import MIRROR, box, in_plane, seen, way_down
from tests.quick import slow
from tests.spatial.bank import moved

VAULT = partial(
    builders.barrel_vault, span=2.0, rise=1.0, thickness=0.25, length=0.5, voussoirs=7, strips=1
)
PUSH = np.array([1.0, 0.0, 0.0])
UNTIL = 0.02

CHANGES = {
    "turned": Rotation.from_euler("z", 31.0, degrees=True).as_matrix(),
    "mirrored": np.diag([-1.0, 1.0, 1.0]),
}


def way(matrix, shift, renumbered=False):
    """The way of a vault that rolls on hinges, with all vectors multiplied by a matrix."""
    blocks = [moved(block, matrix, shift) for block in VAULT()]
    if renumbered:
        blocks = [blocks[k] for k in np.random.default_rng(5).permutation(len(blocks))]
    scene = Scene(
        blocks=tuple(blocks),
        joints={"default": JointLaw(friction=1.0)},
        materials={"default": Material(density=2000.0)},
        dead=Load(body=(0.0, 0.0, -9.81)),
        live=Load(body=tuple(9.81 * matrix @ PUSH)),
        solve=SolveOptions(quick=True),
    )
    return way_down(scene, until=UNTIL)


@cache
def as_it_is():
    return way(np.eye(3), np.zeros(3))


@pytest.mark.parametrize("change", ["turned", *slow("mirrored")])
def test_the_way_turns_with_the_structure(change):
    before = as_it_is()
    matrix = CHANGES[change]
    after = way(matrix, np.array([3.0, -2.0, 5.0]), renumbered=True)
    assert after.along == pytest.approx(matrix @ before.along, abs=1e-9)
    assert (after.fine.why, before.fine.why) == ("displacement",) * 2
    first = before.at(0.0)
    for place in np.linspace(0.0, UNTIL, 9):
        assert after.at(place) == pytest.approx(before.at(place), abs=1e-7 * first)


def test_the_way_is_mirrored_in_the_plane():
    stack = in_plane([box(0, 0.5 * k, 0.8 - 0.1 * k, 0.5 * (k + 1)) for k in range(3)])
    before, after = (way_down(one, until=0.1) for one in (stack, seen(stack, MIRROR)))
    assert after.along[0] == -before.along[0]
    for place in np.linspace(0.0, 0.1, 9):
        assert after.at(place) == pytest.approx(before.at(place), abs=1e-6 * before.at(0.0))
