"""Structures in space whose limit load can be found by hand."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact.spatial.contacts import checked_contacts
from fenics_contact.spatial.limit import collapse_of
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from fenics_contact.spatial.structure import ContactLaw, Structure
from tests.quick import each_once

GROUND = Block((Polyhedron.box([-3.0, -3.0, -0.2], [3.0, 3.0, 0.0]),), "ground", fixed=True)


def block_on_ground(size, friction, live, quick=False):
    """A block under its own weight of 1, with a live load of forces and moments."""
    block = Block((Polyhedron.box(-0.5 * np.array([1.0, 1.0, 0.0]) * size, size * [0.5, 0.5, 1]),))
    blocks = (GROUND, block)
    contacts = checked_contacts(blocks)[0]
    laws = (ContactLaw(friction),) * len(contacts)
    dead = np.zeros((2, 6))
    dead[1, 2] = -1.0
    return Structure(blocks, contacts, laws, dead, np.array([np.zeros(6), live]), quick)


@pytest.mark.parametrize(("degrees", "quick"), each_once([0.0, 20.0, 30.0, 45.0], [True, False]))
def test_block_slides_or_tilts(degrees, quick):
    x, y = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    live = [x, y, 0.0, 0.0, 0.0, 0.0]
    slides = collapse_of(block_on_ground(np.array([1.0, 1.0, 2.0]), 0.3, live, quick))
    assert slides.load_factor == pytest.approx(0.3, rel=1e-6)
    tilts = collapse_of(block_on_ground(np.array([1.0, 1.0, 2.0]), 0.8, live, quick))
    assert tilts.load_factor == pytest.approx(0.5 / max(x, y), rel=1e-6)


def test_torsion_is_limited_by_the_pressure():
    """A square under uniform pressure: 0.3826 F N a; discs at corners alone have 0.7071."""
    live = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    twisted = collapse_of(block_on_ground(np.ones(3), 0.5, live))
    assert twisted.load_factor / 0.5 == pytest.approx(0.3826, rel=0.08)
    corners = collapse_of(block_on_ground(np.ones(3), 0.5, live, quick=True))
    assert corners.load_factor / 0.5 == pytest.approx(0.5**0.5, rel=1e-4)
