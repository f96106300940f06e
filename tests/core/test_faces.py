"""The face engine in any number of dimensions d: nothing of it knows that d is 2.

Walls of boxes in the plane, and the same walls as deep as a block is long. All faces have a force
at each corner (`tests.boxes`); states and modes are judged by other programs (`second_solver`).
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.faces.model import FaceModel
from tests.boxes import box_model, box_wall
from tests.second_solver import misses, own_limit

GAP = 1e-3
#: Friction of the walls.
FRICTION = {"W1": 0.65, "W2": 0.65, "W3": 0.65, "W4": 0.65, "20x20": 0.75}
SMALL = [name for name in FRICTION if name != "20x20"]
WALLS = [*[(name, d) for name in SMALL for d in (2, 3)], ("20x20", 2)]


@cache
def wall(name: str, d: int) -> FaceModel:
    return box_wall(name, FRICTION[name], d)


@cache
def state(name: str, d: int) -> FaceState:
    found = FaceSearch(wall(name, d), GAP).run()
    assert found is not None
    return found


def load_factor(model: FaceModel) -> float:
    """That of a certified state."""
    found = FaceSearch(model, 1e-5).run()
    assert found is not None and found.gap <= 1e-5
    assert max(misses(model, found).values()) <= 1e-8
    return found.load_factor


@pytest.mark.parametrize(("name", "d"), WALLS)
def test_walls_have_certified_states(name, d):
    model, found = wall(name, d), state(name, d)
    assert model.shape[1] == d and model.motion.shape[1] % (d * (d + 1) // 2) == 0
    assert 0.0 <= found.gap <= GAP and found.missing <= 1e-8 and found.closing <= 1e-8
    assert max(misses(model, found).values()) <= 1e-8
    assert found.upper - found.load_factor == pytest.approx(found.gap * found.load_factor)


@pytest.mark.parametrize(("name", "d"), WALLS)
def test_nothing_with_the_strengths_of_a_state_carries_more(name, d):
    """HiGHS in the plane, Clarabel in space."""
    found = state(name, d)
    own = own_limit(wall(name, d), found)
    assert own == pytest.approx(found.upper, rel=1e-6)
    assert found.load_factor <= own * (1.0 + 1e-6)


def block(base: tuple[float, ...], height: float, friction: float, degrees: float) -> FaceModel:
    """One block of some base on ground, pushed at an angle from the first axis."""
    low, high = np.zeros(len(base) + 1), np.array([*base, height])
    under = np.array([[low - [*[1.0] * len(base), 1.0], [*(high[:-1] + 1.0), 0.0]]])
    angle = np.radians(degrees)
    push = np.zeros(len(high))
    push[: len(base)] = [np.cos(angle), np.sin(angle)][: len(base)]
    return box_model([[low, high]], under, friction, push)


DIRECTIONS = [(2, 0.0), (3, 0.0), (3, 30.0), (3, 45.0), (3, 90.0)]


@pytest.mark.parametrize(("d", "degrees"), DIRECTIONS)
def test_block_slides(d, degrees):
    """Over the friction's coefficient, in every direction."""
    found = load_factor(block((1.0, 0.8)[: d - 1], 0.5, 0.37, degrees))
    assert found == pytest.approx(0.37, rel=1e-5)


@pytest.mark.parametrize(("d", "degrees"), DIRECTIONS)
def test_block_tilts(d, degrees):
    """Once the resultant, at half the height, leaves the base."""
    angle = np.radians(degrees)
    reach = min(0.4 / max(np.cos(angle), 1e-9), 0.3 / max(np.sin(angle), 1e-9))
    found = load_factor(block((0.4, 0.3)[: d - 1], 1.0, 5.0, degrees))
    assert found == pytest.approx(reach, rel=1e-5)
