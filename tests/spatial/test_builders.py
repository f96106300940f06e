"""Structures by the builders: volumes by hand, bond, contacts, and messages."""

from __future__ import annotations

import functools
from functools import partial

import numpy as np
import pytest

from fenics_contact.errors import InputError
from fenics_contact.spatial import builders
from fenics_contact.spatial.contacts import checked_contacts

HOUSE = {"length": 4.8, "width": 3.2, "height": 2.4, "thickness": 0.2}
WINDOWS = {"south": [[1.2, 2.0, 0.8, 1.6], [2.8, 3.6, 0.8, 1.6]], "east": [[1.2, 2.0, 0.0, 1.6]]}
DOME = {"radius": 1.0, "thickness": 0.1, "meridians": 8, "rings": 6}


def volume(blocks, group=None):
    """Of the blocks that move, of one group or all."""
    return sum(b.volume for b in blocks if not b.fixed and group in (None, b.group))


def polygon(radius, corners):
    """Area of a regular polygon."""
    return 0.5 * corners * radius**2 * np.sin(2.0 * np.pi / corners)


#: Builders with their sizes, and the volume by hand.
MADE = {
    "wall": (
        partial(
            builders.wall, length=4.0, height=2.8, thickness=0.2, openings=[[1.0, 1.8, 0.0, 2.0]]
        ),
        0.2 * (4.0 * 2.8 - 0.8 * 2.0),
    ),
    "corner": (
        partial(builders.corner, length_x=2.4, length_y=1.9, height=2.0, thickness=0.3),
        0.3 * (2.4 + 1.9 - 0.3) * 2.0,
    ),
    "facade": (
        partial(builders.facade, length=1.6, side=1.0, height=1.2, thickness=0.2),
        0.2 * (1.6 + 2.0 * 0.8) * 1.2,
    ),
    "house": (
        partial(builders.house, **HOUSE, openings=WINDOWS),
        0.2 * ((2.0 * 4.8 + 2.0 * 2.8) * 2.4 - 2.0 * 0.64 - 0.8 * 1.6),
    ),
    "house with floors": (
        partial(builders.house, **HOUSE, floors=[1.2, 2.2], floor_strips=4),
        0.2 * (2.0 * 4.8 + 2.0 * 2.8) * 2.4 + 2.0 * 0.2 * 4.4 * 2.8,
    ),
    "wall with a gable": (
        partial(builders.wall, length=4.0, height=1.0, thickness=0.2, gable=1.2),
        0.2 * 4.0 * (1.0 + 0.5 * 1.2),
    ),
    "house with rooms": (
        partial(
            builders.house,
            **HOUSE,
            inner=[1.6, 3.0],
            openings={"inner_1": [[0.8, 1.6, 0.0, 1.6]]},
            gables={"west": 1.0, "east": 1.0, "inner_2": 1.0},
            floors=[2.2],
        ),
        0.2 * ((2.0 * 4.8 + 4.0 * 2.8) * 2.4 - 0.8 * 1.6 + 1.5 * 3.2)
        + 0.2 * (4.0 * 3.0 - 2.0 * 4.8 * 0.1 + 4.0 * 0.2 * 0.2),
    ),
    "house with rooms both ways": (
        partial(
            builders.house,
            **HOUSE,
            inner=[2.0],
            inner_x=[1.6],
            floors=[1.2],
            gables={"inner_x_1": 1.0},
        ),
        0.2 * ((2.0 * 4.8 + 3.0 * 2.8) * 2.4 + (4.4 - 0.2) * 2.2 + 0.5 * 4.8 * 1.0)
        + 0.2 * (4.2 * 3.0 - 2.0 * 4.8 * 0.1 + 3.0 * 0.2 * 0.2),
    ),
    "tower": (
        partial(
            builders.tower, width=3.0, height=6.0, thickness=0.5, top_width=2.0, brick=(1.0, 0.5)
        ),
        (9.0 - 4.0) * 6.0 * (1.0 + 4.0 / 9.0 + 2.0 / 3.0) / 3.0,
    ),
    "barrel vault": (
        partial(
            builders.barrel_vault,
            span=2.0,
            rise=1.0,
            thickness=0.2,
            length=3.0,
            voussoirs=12,
            strips=3,
        ),
        3.0 * 6.0 * (1.2**2 - 1.0) * np.sin(np.pi / 12.0),
    ),
    "cross vault": (
        partial(builders.cross_vault, span=1.85, thickness=0.15, length=2.5, voussoirs=16),
        None,
    ),
    "dome": (partial(builders.dome, **DOME), None),
    "bonded dome": (partial(builders.dome, **DOME, bonded=True, keystone=True, embrace=70.0), None),
    "bridge": (
        partial(
            builders.bridge, span=4.0, rise=1.2, thickness=0.3, width=2.0, height=2.0, voussoirs=14
        ),
        None,
    ),
}


@functools.cache
def made(name):
    """Blocks of one of `MADE`, their contacts, and the volume by hand."""
    build, by_hand = MADE[name]
    blocks = build()
    return blocks, checked_contacts(blocks)[0], by_hand


@pytest.mark.parametrize("name", MADE)
def test_builders_make_structures(name):
    """Volumes are those by hand; no joint is lost; names differ; something is ground."""
    blocks, contacts, by_hand = made(name)
    assert all(b.volume > 0.0 for b in blocks)
    assert len({b.name for b in blocks}) == len(blocks)
    assert any(b.fixed and b.group == "ground" for b in blocks)
    if by_hand is not None:
        assert volume(blocks) == pytest.approx(by_hand, rel=1e-12)
    touched = {k for contact in contacts for k in (contact.first, contact.second)}
    assert touched >= {k for k, block in enumerate(blocks) if not block.fixed}


@pytest.mark.parametrize("name", ["wall", "corner", "house with floors", "cross vault", "bridge"])
def test_blocks_rest_on_what_is_below(name):
    """Without friction on vertical joints, every block of a wall has a bed: area that bears."""
    blocks, contacts, _ = made(name)
    bears = np.zeros(len(blocks))
    for contact in contacts:
        upper, lower = (contact.second, contact.first)
        rise = contact.axes[0, 2]
        bears[upper if rise > 0.0 else lower] += contact.area * abs(rise)
    assert all(bears[k] > 0.0 for k, block in enumerate(blocks) if not block.fixed)


def test_bricks_are_in_running_bond():
    """Four whole bricks; then a half one first. A course over another has no joint in line."""
    blocks = builders.wall(length=1.6, height=0.6, thickness=0.2)
    ends = {}
    for block in blocks[1:]:
        low, high = block.extent
        ends.setdefault(round(low[2], 6), []).append(high[0])
    assert [len(row) for row in ends.values()] == [4, 5, 4]
    assert ends[0.2] == pytest.approx([0.2, 0.6, 1.0, 1.4, 1.6])


def test_courses_fill_the_height_and_lintels_bear_on_half_a_brick():
    blocks = builders.wall(length=4.0, height=2.5, thickness=0.2, openings=[[1.0, 1.8, 0.0, 2.0]])
    lintel = next(b for b in blocks if b.group == "lintels")
    low, high = lintel.extent
    assert max(b.extent[1][2] for b in blocks) == pytest.approx(2.5)
    assert (low[0], high[0]) == pytest.approx((0.8, 2.0))
    assert low[2] == pytest.approx(10.0 * 2.5 / 12.0)


def test_dome_fills_its_rings():
    """Rings of a hemisphere with 48 sides: the shell's volume from 5 degrees, less 1 %."""
    blocks = builders.dome(radius=1.0, thickness=0.1, meridians=48, rings=12)
    shell = 2.0 * np.pi / 3.0 * (1.05**3 - 0.95**3) * np.cos(np.radians(5.0))
    assert volume(blocks) == pytest.approx(shell, rel=0.01)
    closed = builders.dome(**DOME, keystone=True)[-1]
    angle = np.radians(5.0)
    areas = [polygon(radius * np.sin(angle), 8) for radius in (0.95, 1.05)]
    depth = 0.1 * np.cos(angle)
    frustum = depth * (areas[0] + areas[1] + np.sqrt(areas[0] * areas[1])) / 3.0
    assert closed.name == "keystone" and closed.volume == pytest.approx(frustum, rel=1e-12)


@pytest.mark.parametrize(
    ("make", "changed", "message"),
    [
        ("wall", {"length": -1.0}, "length = -1 must be positive"),
        ("wall", {"height": 0.0}, "height = 0 must be positive"),
        ("wall", {"brick": [0.4]}, "brick"),
        ("wall", {"openings": [[1, 2, 0]]}, r"openings\[0\] must be \[from, to, bottom, top\]"),
        (
            "wall",
            {"openings": [[0.1, 2, 0, 1]]},
            r"between 0.2 and 3.8, half a brick from its ends",
        ),
        ("wall", {"openings": [[2, 1, 0, 1]]}, "from = 2 must be less than to = 1"),
        ("wall", {"openings": [[1, 2, 0, 2.8]]}, "between 0 and 2.6, .* a lintel lies above"),
        ("wall", {"openings": [[1, 2, 0, 1], [2.2, 3, 0, 1]]}, r"openings\[1\] is less than "),
        ("corner", {"length_y": 0.2}, "length_y = 0.2 must be more than 0.3"),
        ("house", {"thickness": 2.0}, "width = 3.2 must be more than 4"),
        ("house", {"openings": {"front": [[1, 2, 0, 1]]}}, "openings.front: the walls are south"),
        ("house", {"openings": WINDOWS, "floors": [1.2]}, "1.2 is in an opening of south"),
        ("house", {"floors": [2.4]}, "2.4 must be between 0.2 and 2.2, the last course"),
        ("house", {"inner": [2.0, 2.3]}, "inner = 2.3 must be more than 2.4"),
        ("house", {"inner_x": [0.3]}, "inner_x = 0.3 must be more than 0.4"),
        (
            "house",
            {"inner": [1.0], "openings": WINDOWS},
            "less than 0.4 m, a brick, .* an inner wall",
        ),
        ("house", {"gables": {"roof": 1.0}}, "gables.roof: the walls are south, north"),
        ("house", {"gables": {"west": -1.0}}, "gables = -1 must be positive"),
        ("wall", {"gable": 0.0}, "gable = 0 must be positive"),
        ("viaduct", {"spandrel": 1.0}, "width = 2 must be more than 2"),
        ("viaduct", {"rise": 3.0}, "rise <= span / 2"),
        ("tower", {"top_width": 4.0}, "top_width = 4 must be at most width = 3"),
        ("barrel_vault", {"rise": 1.1}, "rise = 1.1 must be at most span / 2 = 1"),
        ("barrel_vault", {"voussoirs": 0}, "voussoirs = 0 must be positive"),
        ("cross_vault", {"voussoirs": 15}, "voussoirs = 15 must be even"),
        ("cross_vault", {"length": 2.0}, "length = 2 must be more than 2.15"),
        ("dome", {"meridians": 2}, "meridians = 2 must be at least 3"),
        ("dome", {"embrace": 120.0}, "embrace = 120 must be at most 90"),
        ("dome", {"oculus": 1.0}, "oculus = 1 must be less than 1"),
        ("bridge", {"height": 1.2}, "height = 1.2 must be more than 1.5"),
        ("bridge", {"spandrel": 1.0}, "width = 2 must be more than 2"),
    ],
)
def test_impossible_sizes_are_named(make, changed, message):
    given = {
        "wall": {"length": 4.0, "height": 2.8, "thickness": 0.2},
        "corner": {"length_x": 2.4, "length_y": 1.9, "height": 2.0, "thickness": 0.3},
        "house": HOUSE,
        "tower": {"width": 3.0, "height": 6.0, "thickness": 0.5},
        "barrel_vault": {
            "span": 2.0,
            "rise": 1.0,
            "thickness": 0.2,
            "length": 3.0,
            "voussoirs": 12,
        },
        "cross_vault": {"span": 1.85, "thickness": 0.15, "length": 2.5, "voussoirs": 16},
        "dome": DOME,
        "viaduct": {"span": 4.0, "rise": 1.0, "ring": 0.4, "width": 2.0},
        "bridge": {
            "span": 4.0,
            "rise": 1.2,
            "thickness": 0.3,
            "width": 2.0,
            "height": 2.0,
            "voussoirs": 14,
        },
    }
    with pytest.raises(InputError, match=message):
        getattr(builders, make)(**{**given[make], **changed})
