"""Contacts in edges and corners, and rigid ground: values by hand, and what is told."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from fenics_contact.errors import InputError
from fenics_contact.spatial import Scene, limit_load, standing
from fenics_contact.spatial.contacts import checked_contacts
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from fenics_contact.spatial.vtu import write_fields

WEIGHT = 2000.0 * 9.81
FLOOR = {"floor": {}}


def box(low, high, **more):
    return {"box": [list(map(float, low)), list(map(float, high))], **more}


def prism(polygon, **more):
    """A body 1 m long along y, by its corners in x and z."""
    return {"vertices": [[x, y, z] for y in (0.0, 1.0) for x, z in polygon], **more}


def scene(blocks, friction, live=(1.0, 0.0, 0.0), at=None, dead=(0.0, 0.0, -9.81), **more):
    """Blocks of 2 t/m3 under their weight; the live load is a force of 10 kN `at` a place of
    "beam", or a body force."""
    push = {"direction": list(live)}
    if at is not None:
        force = {"block": "beam", "at": list(at), "force": [1e4 * x for x in live]}
        push = {"force": {"a": force}}
    if "foundations" in more:
        more["foundations"] = {
            k: {"friction": friction} | v for k, v in more["foundations"].items()
        }
    tables = {
        "dimension": 3,
        "blocks": blocks,
        "materials": {"default": {"density": 2000.0}},
        "joints": {"default": {"friction": friction}},
        "loads": {"dead": {"body": list(dead)}, "live": push},
        "solve": {"quick": True},
    }
    return Scene.from_tables({**tables, **more}, Path())


def status(given):
    return standing(given).ends["positive"].status


def limit(given):
    found = limit_load(given).ends["positive"]
    return found.load_factor if found.status == "limit" else found.status


def shapes(given):
    """How many corners the contacts of a scene have."""
    return sorted(len(contact.corners) for contact in given.structure().contacts)


# ---- edges on sides


def leaning(degrees, length, thick, right=None, mirrored=False):
    """A plank whose lower edge is on z = 0, and whose right one is at x = `right`."""
    turn = np.radians(degrees)
    c, s = np.cos(turn), np.sin(turn)
    corners = np.array([(0, 0), (length, 0), (length, thick), (0, thick)]) @ [[c, s], [-s, c]]
    if right is not None:
        corners[:, 0] += right - corners[:, 0].max()
    if mirrored:
        corners = corners * [-1.0, 1.0]
    return prism(corners.tolist())


def arm(degrees, length, thick):
    """Distance across of the middle of a plank from its lower edge."""
    turn = np.radians(degrees)
    return 0.5 * (length * np.cos(turn) - thick * np.sin(turn))


@pytest.mark.parametrize(
    ("degrees", "length", "thick"), [(60.0, 2.0, 0.1), (50.0, 3.0, 0.3), (72.0, 1.0, 0.02)]
)
def test_a_plank_leans_on_a_wall(degrees, length, thick):
    """It needs friction F at both ends: G = F L (sin a + F cos a) / (1 + F^2), G its arm."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    need = brentq(
        lambda f: arm(degrees, length, thick) - f * length * (s + f * c) / (1.0 + f * f), 0.0, 1.0
    )
    wall = box((2, -1, 0), (2.3, 2, 4), fixed=True)
    blocks = {"wall": wall, "plank": leaning(degrees, length, thick, 2.0)}
    given = [scene(blocks, part * need, foundations=FLOOR) for part in (1.01, 0.8)]
    assert shapes(given[0]) == [2, 2]
    assert status(given[0]) == "equilibrium"
    assert status(given[1]) != "equilibrium"


@pytest.mark.parametrize(("degrees", "place"), [(60.0, 1.5), (70.0, 2.2)])
def test_a_ladder_leans_on_the_edge_of_a_wall(degrees, place):
    """F / (1 + F^2) = G sin a / d, the edge d along the ladder."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    ratio = arm(degrees, 3.0, 0.1) * s / place
    need = (1.0 - np.sqrt(1.0 - 4.0 * ratio**2)) / (2.0 * ratio)
    wall = box((place * c, -1, 0), (5, 2, place * s), fixed=True)
    blocks = {"wall": wall, "ladder": leaning(degrees, 3.0, 0.1)}
    given = [scene(blocks, part * need, foundations=FLOOR) for part in (1.01, 0.8)]
    assert shapes(given[0]) == [2, 2]
    assert status(given[0]) == "equilibrium"
    assert status(given[1]) != "equilibrium"


BEAM = prism([(0, 0.5), (4, 0.5), (4, 0.8), (0, 0.8)])
HEAVY = 1.2 * WEIGHT


def knife(x, half=0.2):
    return prism([(x - half, 0), (x + half, 0), (x, 0.5)], fixed=True)


def tip(x, y):
    foot = [[x + a, y + b, 0.0] for a in (-0.2, 0.2) for b in (-0.2, 0.2)]
    return {"vertices": [*foot, [x, y, 0.5]], "fixed": True}


def rounded(x, sides):
    """Half a drum with a corner at its top."""
    turn = np.pi * np.arange(sides + 1) / sides
    polygon = np.column_stack([x + 0.3 * np.cos(turn), 0.2 + 0.3 * np.sin(turn)])
    return prism(polygon.tolist(), fixed=True)


BED = box((0, 0, 0), (2.2, 1, 0.5), fixed=True)


@pytest.mark.parametrize(
    ("supports", "turns_about"),
    [
        ({"a": BED, "b": knife(3.5)}, 3.5),
        ({"a": BED, "b": tip(3.5, 0.5)}, 3.5),
        ({"a": BED, "b": rounded(3.2, 10)}, 3.2),
        ({"a": rounded(1.0, 30), "b": rounded(3.0, 10)}, 3.0),
        ({"a": tip(1.0, 0.5), "b": tip(2.5, 0.2), "c": tip(2.5, 0.7)}, 2.5),
        ({"a": BED, "b": box((3.3, 0, 0), (3.7, 1, 0.5), fixed=True)}, 3.7),
    ],
)
def test_a_beam_turns_about_its_last_support(supports, turns_about):
    expected = HEAVY * (turns_about - 2.0) / (3.9 - turns_about) / 1e4
    given = scene({**supports, "beam": BEAM}, 0.6, (0.0, 0.0, -1.0), at=(3.9, 0.5, 0.8))
    assert limit(given) == pytest.approx(expected, rel=1e-6)


def test_a_stool_on_three_tips_turns_about_two_of_them():
    tips = {"a": tip(1.0, 0.5), "b": tip(3.0, 0.2), "c": tip(3.0, 0.8)}
    pushed = {**tips, "beam": BEAM}
    assert shapes(scene(pushed, 0.3)) == [1, 1, 1]
    assert limit(scene(pushed, 0.3)) == pytest.approx(0.3, rel=1e-6)
    across = np.array([2.0, 0.3]) / np.hypot(2.0, 0.3)  # the edge from (1, .5) to (3, .8)
    lever = across[0] * 0.45 - across[1] * 2.0  # of a load at (3, .95)
    rest = across[1] * 1.0 - across[0] * 0.0
    given = scene(pushed, 0.6, (0.0, 0.0, -1.0), at=(3.0, 0.95, 0.8))
    assert limit(given) == pytest.approx(HEAVY * rest / lever / 1e4, rel=1e-6)


def test_beams_that_cross_with_their_edges_touch_in_a_point():
    def beam(axis, half, shift, **more):
        turn = Rotation.from_euler(axis, 45.0, degrees=True).as_matrix()
        corners = np.array(list(product((-1, 1), repeat=3))) * half @ turn.T + shift
        return {"vertices": corners.tolist(), **more}

    size = 0.25 * 2.0**0.5
    blocks = {
        "a": beam("x", (1.0, 0.25, 0.25), (0, -0.8, 0), fixed=True),
        "b": beam("x", (1.0, 0.25, 0.25), (0, 0.9, 0), fixed=True),
        "beam": beam("y", (0.25, 2.0, 0.25), (0, 0, 2 * size)),
    }
    given = scene(blocks, 0.4, (0.0, 1.0, 0.0))
    structure = given.structure()
    assert shapes(given) == [1, 1]
    assert [c.corners[0].tolist() for c in structure.contacts] == [
        pytest.approx([0.0, -0.8, size]),
        pytest.approx([0.0, 0.9, size]),
    ]
    assert all(abs(c.axes[0]) == pytest.approx([0, 0, 1]) for c in structure.contacts)
    assert limit(given) == pytest.approx(0.4, rel=1e-6)
    down = scene(blocks, 0.4, (0.0, 0.0, -1.0), at=(0.0, 1.5, 2 * size))
    assert limit(down) == pytest.approx(WEIGHT * 4 * 0.25 * 0.9 / 0.6 / 1e4, rel=1e-6)


@pytest.mark.parametrize(("degrees", "thick"), [(60.0, 0.02), (50.0, 0.05), (75.0, 0.1)])
def test_a_house_of_two_cards(degrees, thick):
    """They press each other level; the feet need friction G / (L sin a)."""
    need = arm(degrees, 1.0, thick) / np.sin(np.radians(degrees))
    cards = {
        "left": leaning(degrees, 1.0, thick, 0.0),
        "right": leaning(degrees, 1.0, thick, 0.0, mirrored=True),
    }
    given = [scene(cards, part * need) for part in (1.01, 0.8)]
    assert status(given[0]) == "equilibrium"
    assert status(given[1]) != "equilibrium"
    (doubt,) = given[0].structure().doubts
    assert doubt.startswith("blocks 'left' and 'right' touch in an edge or corner where more")


def test_a_cube_in_a_groove():
    """Pushed across a groove of 90 degrees: tan(45 + phi), F = .3."""
    half = 0.5**0.5
    blocks = {
        "left": prism([(-2, 0), (0, 0), (-2, 2)], fixed=True),
        "right": prism([(2, 0), (0, 0), (2, 2)], fixed=True),
        "cube": prism([(0, 0), (half, half), (0, 2 * half), (-half, half)]),
    }
    given = scene(blocks, 0.3)
    assert shapes(given) == [4, 4]
    assert limit(given) == pytest.approx(1.3 / 0.7, rel=1e-6)


@pytest.mark.parametrize("sides", [6, 8, 12, 48])
def test_a_prism_rolls(sides):
    turn = 2.0 * np.pi * (np.arange(sides) + 0.5) / sides - 0.5 * np.pi
    polygon = np.column_stack([np.cos(turn), np.sin(turn) + np.cos(np.pi / sides)])
    given = scene({"drum": prism(polygon.round(12).tolist())}, 1.5)
    assert shapes(given) == [4]
    assert limit(given) == pytest.approx(np.tan(np.pi / sides), rel=1e-6)


def test_a_bed_that_is_tilted_carries_in_its_edge():
    drop = np.tan(np.radians(2.5))
    blocks = {
        "bed": prism([(0, 0), (1, 0), (1, 1), (0, 1 - drop)], fixed=True),
        "flat": box((-1, 0, 0), (0, 1, 1), fixed=True),
        "beam": box((-0.9, 0, 1), (1.5, 1, 1.5)),
    }
    given = scene(blocks, 0.6, (0.0, 0.0, -1.0), at=(1.4, 0.5, 1.5))
    assert limit(given) == pytest.approx(1.2 * WEIGHT * (1.0 - 0.3) / 0.4 / 1e4, rel=1e-6)
    assert any("inclined by 2.5 degrees" in text for text in given.structure().warnings)


# ---- what is no contact, and what is told


def slices(count):
    turn = 2.0 * np.pi * np.arange(count + 1) / count
    rim = np.column_stack([np.cos(turn), np.sin(turn)])
    wedges = [[[0.0, 0.0], *rim[k : k + 2].tolist()] for k in range(count)]
    return {
        f"s{k}": {"vertices": [[*p, z] for p in w for z in (0.0, 1.0)]}
        for k, w in enumerate(wedges)
    }


@pytest.mark.parametrize(
    "blocks",
    [
        {
            f"{x}{y}{z}": box((x, y, z), (x + 1, y + 1, z + 1))
            for x, y, z in product(range(2), repeat=3)
        },
        slices(8),
        dict(list(slices(40).items())[:9]),
    ],
)
def test_stones_around_an_edge_touch_by_their_sides_alone(blocks):
    structure = scene(blocks, 0.6).structure()
    assert min(len(contact.corners) for contact in structure.contacts) > 2
    assert structure.doubts == structure.warnings == ()


def test_an_edge_beside_a_side_of_the_same_blocks_is_no_contact():
    """A foot that is cut into two pieces: the slanted one has an edge where the flat one ends."""
    flat = Polyhedron.box([0, 0, 0], [1, 1, 1])
    slanted = Polyhedron.hull([[1, y, z] for y in (0, 1) for z in (0, 1)] + [[2, 0, 1], [2, 1, 1]])
    ground = Block((Polyhedron.box([-2, -2, -1], [3, 3, 0]),), "ground", fixed=True)
    (contact,), warnings = checked_contacts([ground, Block((flat, slanted), "foot")])
    assert contact.area == pytest.approx(1.0)
    assert warnings == ()


def test_two_tips_that_touch_are_not_understood():
    def octahedron(z, **more):
        return {
            "vertices": np.add(np.vstack([np.eye(3), -np.eye(3)]) * [1, 1, 2], [0, 0, z]).tolist(),
            **more,
        }

    blocks = {"a": octahedron(0, fixed=True), "b": octahedron(4)}
    beside = {"c": box((5, 0, 0), (6, 1, 1)), "d": box((5, 0, -1), (6, 1, 0), fixed=True)}
    structure = scene({**blocks, **beside}, 0.6).structure()
    (doubt,) = structure.doubts
    assert "blocks 'a' and 'b' touch in an edge or corner where more than one plane" in doubt
    with pytest.raises(InputError, match=r"no two of them touch.*'a' and 'b' touch in an edge"):
        scene(blocks, 0.6).structure()


def test_edges_have_no_area_and_are_told_of(tmp_path):
    strong = {"default": {"friction": 0.6, "cohesion": 1e6}}
    crushes = {"default": {"density": 2000.0, "compressive_strength": 1e4}}
    blocks = {"a": knife(1.0), "b": tip(3.0, 0.5), "beam": BEAM}
    given = scene(blocks, 0.6, joints=strong, materials=crushes)
    structure = given.structure()
    assert not structure.limited.any() and not structure.points.area.any()
    (told,) = structure.warnings
    assert "' and 'beam' touch in an edge or corner (and 1 more): it carries" in told
    assert "without cohesion, tensile strength or crushing; likewise '" in told
    found = limit_load(given)
    assert found.ends["positive"].load_factor == pytest.approx(0.6, rel=1e-6)
    write_fields(found, tmp_path)
    assert (tmp_path / "contacts.vtu").stat().st_size > 0


def test_an_edge_that_is_nearly_on_a_side_is_told_of_with_its_cure():
    lifted = prism([(0, 0.503), (4, 0.503), (4, 0.8), (0, 0.8)])
    blocks = {"a": knife(1.0), "b": knife(3.0), "beam": lifted}
    with pytest.raises(InputError, match=r"is 0.003 m off .*set tolerance = 0.00303"):
        scene(blocks, 0.5).structure()
    assert limit(scene(blocks, 0.5, tolerance=0.00303)) == pytest.approx(0.5, rel=1e-6)


def test_all_overlaps_are_named_with_the_tolerance_that_cures_them():
    row = {f"b{k}": box((0.999 * k, 0, 0), (0.999 * k + 1, 1, 1)) for k in range(4)}
    message = (
        "overlap by 0.001 m (and 2 more): move them apart, or set tolerance = 0.00101; likewise"
    )
    with pytest.raises(InputError, match=re.escape(message)):
        scene(row, 0.5).structure()
    assert status(scene(row, 0.5, tolerance=0.00101)) == "equilibrium"
    row["b1"] = box((0.8, 0, 0), (2, 1, 1))
    with pytest.raises(InputError, match=r"overlap by 0.2 m \(and 2 more\): move them apart; like"):
        scene(row, 0.5).structure()


# ---- the ground


def portal(lift=0.0, degrees=0.0):
    top = lift + 0.5 * np.tan(np.radians(degrees))
    right = [(2, lift), (2.5, top), (2.5, 2), (2, 2)]
    right = {"vertices": [[x, y, z] for x, z in right for y in (0.0, 0.5)]}
    left = box((0, 0, 0), (0.5, 0.5, 2))
    return {"left": left, "right": right, "lintel": box((0, 0, 2), (2.5, 0.5, 2.4))}


def test_the_ground_has_the_tolerance_of_contacts():
    assert limit(scene(portal(1e-4), 0.6)) == pytest.approx(0.25, rel=1e-3)
    assert scene(portal(1e-4), 0.6).structure().warnings == ()
    (told,) = scene(portal(2e-3), 0.6).structure().warnings
    assert "'right' and 'ground' are 0.002 m apart" in told and "tolerance = 0.00202" in told
    cured = scene(portal(2e-3), 0.6, tolerance=0.00202)
    assert limit(cured) == pytest.approx(0.25, rel=1e-2)


@pytest.mark.parametrize(("degrees", "text"), [(1.5, "0.0131 m apart"), (6.0, "6 degrees")])
def test_feet_that_are_inclined_are_told_of(degrees, text):
    structure = scene(portal(0.0, degrees), 0.6).structure()
    assert shapes(scene(portal(0.0, degrees), 0.6)) == [2, 4, 4, 4]
    assert any("'right' and 'ground'" in told and text in told for told in structure.warnings)


def test_ground_that_nothing_touches_is_refused_with_the_cure():
    given = scene(portal(), 0.6, foundations={"ground": {"z": -0.004}})
    with pytest.raises(InputError, match=r"'left' is 0.004 m off it, or set tolerance = 0.00404"):
        given.structure()
    with pytest.raises(InputError, match=r"see its z or plane; block 'left' is 1 m off it$"):
        scene(portal(), 0.6, foundations={"ground": {"z": -1.0}}).structure()


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_ground_is_below_along_the_weight(axis, sign):
    """A tower of 1 x 1 x 2 m along an axis tilts at half of its weight."""
    dead, live, low, high = np.zeros(3), np.zeros(3), np.zeros(3), np.ones(3)
    dead[axis] = 9.81 * sign
    live[axis - 1] = 1.0
    shift = np.eye(3)[axis]
    blocks = {"a": box(low, high), "b": box(low + shift, high + shift)}
    assert limit(scene(blocks, 0.9, live, dead=dead)) == pytest.approx(0.5, rel=1e-6)


def test_a_slope_by_its_weight_keeps_the_ground_level():
    blocks = {"a": box((0, 0, 0), (1, 1, 0.3))}
    tilted = scene(blocks, 0.5, dead=(4.0, 0.0, -9.0))
    assert limit(tilted) == pytest.approx((0.5 * 9.0 - 4.0) / 9.81, rel=1e-6)


@pytest.mark.parametrize("up", ["x", "y", "z"])
def test_an_axis_of_the_blocks_that_points_upwards(up):
    axis = "xyz".index(up)
    low, high = np.zeros(3), np.ones(3)
    high[axis] = 3.0
    given = scene({"up": up, "a": box(low, high)}, 0.9)
    assert np.ptp(given.blocks[0].extent, axis=0) == pytest.approx([1.0, 1.0, 3.0])
    assert given.blocks[0].volume == pytest.approx(3.0)
    assert limit(given) == pytest.approx(1.0 / 3.0, rel=1e-6)
    with pytest.raises(InputError, match=r"blocks.up = 'w' must be one of 'x', 'y', 'z'"):
        scene({"up": "w", "a": box(low, high)}, 0.9)
