"""Polyhedra, their contacts, and the points of these: hand values, and what is refused or told."""

from __future__ import annotations

import re
from itertools import pairwise, product

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from shapely.geometry import Polygon

from fenics_contact.errors import InputError
from fenics_contact.spatial.contacts import Contact, checked_contacts, clipped
from fenics_contact.spatial.points import points_of, polygon_centroid
from fenics_contact.spatial.polyhedra import HEXAHEDRON, Block, Polyhedron

CUBE = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)
TURN = Rotation.from_euler("xyz", [31.0, -17.0, 58.0], degrees=True).as_matrix()
TRIANGLES = [t for a, b, c, d in HEXAHEDRON for t in ((a, b, c), (a, c, d))]


def box(low, high, name="", fixed=False):
    return Block((Polyhedron.box(low, high),), name, fixed=fixed)


def turned(block, turn=TURN, shift=(3.0, -2.0, 1.0)):
    pieces = [Polyhedron(piece.corners @ turn.T + shift, piece.sides) for piece in block.pieces]
    return Block(tuple(pieces), block.name, block.group, block.fixed)


def regular(count, scale=(1.0, 1.0)):
    angles = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack([np.cos(angles), np.sin(angles)]) * scale


def prism(polygon, low, high):
    count = len(polygon)
    corners = np.vstack([np.column_stack([polygon, np.full(count, z)]) for z in (low, high)])
    around = [(k, (k + 1) % count, count + (k + 1) % count, count + k) for k in range(count)]
    return Polyhedron(corners, (tuple(range(count))[::-1], tuple(range(count, 2 * count)), *around))


GROUND = box([-2.0, -2.0, -1.0], [3.0, 3.0, 0.0], "ground", fixed=True)

# ---- polyhedra

GRID = np.array(list(product((0, 1, 2), repeat=3)))
ROOF = (CUBE - [0.5, 0.5, 0.0]) * np.where(CUBE[:, 2:] > 0.0, [1, 1, 3], [2, 2, 3])
ANY_TURN = [side[:: (-1) ** k] for k, side in enumerate(HEXAHEDRON)]
SPLIT = CUBE[np.ravel(TRIANGLES)]
MIDDLE = [0.5, 0.5, 0.5]
BODIES = {
    "box": (Polyhedron.box([1, 2, 3], [3, 3, 7]), 8.0, [2.0, 2.5, 5.0], 6),
    "box from its highest corner": (Polyhedron.box([3, 3, 7], [1, 2, 3]), 8.0, [2.0, 2.5, 5.0], 6),
    "wedge": (Polyhedron.hexahedron(CUBE[[0, 1, 2, 3, 4, 4, 7, 7]]), 0.5, [1 / 3, 0.5, 1 / 3], 5),
    "pyramid": (
        Polyhedron.hexahedron(CUBE[[0, 1, 2, 3, *[4] * 4]]),
        1 / 3,
        [0.375, 0.375, 0.25],
        5,
    ),
    "cut pyramid": (Polyhedron.hexahedron(ROOF), 7.0, [0.0, 0.0, 33.0 / 28.0], 6),
    "hexagon": (prism(regular(6), 0, 2), 3.0 * 3.0**0.5, [0.0, 0.0, 1.0], 8),
    "octahedron": (Polyhedron.hull(np.vstack([np.eye(3), -np.eye(3)])), 4 / 3, [0, 0, 0], 8),
    "tetrahedron": (Polyhedron.hull(np.vstack([np.zeros(3), np.eye(3)])), 1 / 6, [0.25] * 3, 4),
    "hull of a grid": (Polyhedron.hull(GRID), 8.0, [1, 1, 1], 6),
    "triangles": (Polyhedron(CUBE, TRIANGLES), 1.0, MIDDLE, 6),
    "triangles apart": (Polyhedron(SPLIT, np.arange(36).reshape(12, 3)), 1.0, MIDDLE, 6),
    "sides of any turn": (Polyhedron(CUBE, ANY_TURN), 1.0, MIDDLE, 6),
}


@pytest.mark.parametrize("name", BODIES)
def test_volume_and_centroid(name):
    body, volume, centroid, sides = BODIES[name]
    block = Block((body,), name)
    for one, turn in ((block, np.eye(3)), (turned(block, TURN, 0.0), TURN)):
        assert one.volume == pytest.approx(volume, rel=1e-12)
        assert one.centroid == pytest.approx(turn @ centroid, abs=1e-12)
        assert len(one.pieces[0].sides) == sides
        piece = one.pieces[0]
        middles = np.array([piece.corners[list(side)].mean(axis=0) for side in piece.sides])
        assert np.all(np.einsum("sk,sk->s", piece.normals, middles - one.centroid) > 0.0)


def test_a_block_of_several_pieces():
    block = Block((Polyhedron.box([0, 0, 0], [2, 1, 1]), Polyhedron.box([0, 0, 1], [1, 1, 2])), "L")
    assert block.volume == pytest.approx(3.0)
    assert block.centroid == pytest.approx([5 / 6, 0.5, 5 / 6])
    assert np.array(block.extent) == pytest.approx(np.array([[0, 0, 0], [2, 1, 2]]))


def moved(corner, by):
    corners = CUBE.copy()
    corners[corner] += by
    return corners


L_PROFILE = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]])
WRONG = {
    "not closed: the edge between (0, 0, 0) and (1, 0, 0) is in 1 sides": Polyhedron(
        CUBE, HEXAHEDRON[1:]
    ),
    "not closed: the edge between (0, 0, 0) and (0, 1, 0) is in 3 sides": Polyhedron(
        CUBE, (*HEXAHEDRON, HEXAHEDRON[0])
    ),
    "it has 2 sides with an area; give 4 to 2000": Polyhedron.hexahedron(CUBE * [1, 1, 0]),
    "it has a volume of 0 m3: its corners lie in a plane": Polyhedron(
        CUBE[:4], ((0, 1, 2), (0, 2, 3), (0, 1, 3), (1, 2, 3))
    ),
    "it has 0 sides with an area": Polyhedron.hull(CUBE * [1, 1, 0]),
    "lies 0.0734 m off the side about (0.5, 0.5, 1.075), above 0.01 m": Polyhedron.hexahedron(
        moved(6, [0, 0, 0.3])
    ),
    "not convex: corner (2, 0, 0) lies 1 m off the side about (1, 1.5, 0.5), above 0.013 m": prism(
        L_PROFILE, 0, 1
    ),
    "crosses itself": Polyhedron.hexahedron(CUBE[[0, 1, 3, 2, 4, 5, 6, 7]]),
    "must be numbers of corners, 0 to 7": Polyhedron(CUBE, ((0, 1, 9), *HEXAHEDRON)),
    "corners must be 4 to 6000 finite points [x, y, z]": Polyhedron(CUBE[:, :2], HEXAHEDRON),
    "corners must be 4 to 6000 finite points": Polyhedron(moved(2, [np.nan, 0, 0]), HEXAHEDRON),
    "must be an array of numbers": Polyhedron([["a", 0, 1]] * 8, HEXAHEDRON),
}


@pytest.mark.parametrize("message", WRONG)
def test_what_is_no_convex_body_makes_no_block(message):
    with pytest.raises(InputError, match=rf"^block 'lintel': .*{re.escape(message)}"):
        Block((WRONG[message],), "lintel")
    with pytest.raises(InputError, match=r"^block 'lintel', piece 1: "):
        Block((Polyhedron.box([0, 0, 0], [1, 1, 1]), WRONG[message]), "lintel")


def test_a_block_has_pieces():
    with pytest.raises(InputError, match=r"block 'x' has no pieces"):
        Block((), "x")


def test_sides_that_are_a_little_warped_are_taken_as_plane():
    middle = moved(6, [0, 0, 0.005])
    upper = np.vstack([middle[4:], np.add(CUBE[4:], [0, 0, 1])])
    blocks = [GROUND]
    blocks += [Block((Polyhedron.hexahedron(x),), n) for x, n in ((middle, "a"), (upper, "b"))]
    contacts, (warning,) = checked_contacts(blocks)
    assert [contact.area for contact in contacts] == pytest.approx([1.0, 1.0], rel=1e-4)
    assert "warped by 0.00125 m (and 1 more): they are taken as plane" in warning


# ---- contacts


def test_contact_of_two_boxes():
    (contact,) = checked_contacts([GROUND, box([0, 0, 0], [2, 1, 1], "a")])[0]
    assert (contact.first, contact.second) == (0, 1)
    assert contact.axes[0] == pytest.approx([0, 0, 1])
    assert contact.axes @ contact.axes.T == pytest.approx(np.eye(3))
    assert np.linalg.det(contact.axes) == pytest.approx(1.0)
    assert contact.area == pytest.approx(2.0)
    expected = {(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)}
    assert {tuple(corner) for corner in contact.corners.round(12) + 0.0} == expected


def test_contacts_of_a_wall_and_of_its_turned_copy():
    blocks = [GROUND]
    for row in range(4):
        cuts = [0.0, 0.4, 0.8, 1.2] if row % 2 else [0.0, 0.2, 0.6, 1.0, 1.2]
        for k, (a, b) in enumerate(pairwise(cuts)):
            blocks.append(box([a, 0, 0.2 * row], [b, 0.2, 0.2 * row + 0.2], f"{row}.{k}"))
    contacts, warnings = checked_contacts(blocks)
    turned_contacts, turned_warnings = checked_contacts([turned(block) for block in blocks])
    assert warnings == turned_warnings == ()
    beds = sum(contact.area for contact in contacts if abs(contact.axes[0, 2]) > 0.5)
    assert beds == pytest.approx(4 * 1.2 * 0.2)
    assert len(contacts) == 4 + 2 * 3 + 2 * 2 + 3 * 6
    for one, two in zip(contacts, turned_contacts, strict=True):
        assert (one.first, one.second) == (two.first, two.second)
        assert two.corners == pytest.approx(one.corners @ TURN.T + [3.0, -2.0, 1.0], abs=1e-9)
        assert two.axes == pytest.approx(one.axes @ TURN.T, abs=1e-9)


def test_edges_and_corners_that_touch_others_are_told_of():
    """Planes of two or three sides part such cubes: no normal is known."""
    cube = box([0, 0, 0], [1, 1, 1], "a", fixed=True)
    for low in ([1, 0, 1], [1, 1, 1], [1, 0.5, -1], [1.0 + 5e-6, 0, 1.0]):
        other = box(low, np.array(low) + 1.0, "b")
        contacts, (doubt,) = checked_contacts([cube, other])
        assert contacts == ()
        assert doubt.startswith("blocks 'a' and 'b' touch in an edge or corner where more than one")


def test_slivers_are_left_out():
    cube = box([0, 0, 0], [1, 1, 1], "a", fixed=True)
    blocks = [cube, box([0.999, 0, 1], [2, 1, 2], "b"), box([1, 0, 0], [2, 1, 1], "c")]
    contacts, warnings = checked_contacts(blocks)
    assert [(contact.first, contact.second) for contact in contacts] == [(0, 2), (1, 2)]
    assert warnings == ("the contact of blocks 'a' and 'b' is 0.001 m wide: it is left out",)


def test_gaps_are_told_and_closed_by_a_tolerance():
    blocks = [
        GROUND,
        box([0, 0, 0.002], [1, 1, 1], "a"),
        box([0, 0, 1.001], [1, 1, 2], "b"),
    ]
    contacts, warnings = checked_contacts(blocks)
    assert contacts == ()
    gap, alone = warnings
    assert gap == (
        "sides of blocks 'ground' and 'a' are 0.002 m apart (and 1 more): no force passes; if they"
        " touch, set tolerance = 0.00202"
    )
    assert alone == "block 'a' touches nothing (and 1 more): it falls, if no tie holds it"
    contacts, warnings = checked_contacts(blocks, tolerance=0.00202)
    assert [contact.area for contact in contacts] == pytest.approx([1.0, 1.0])
    assert contacts[0].corners[:, 2] == pytest.approx(0.001)
    assert warnings == ()


def test_a_side_turned_by_little_touches_within_the_tolerance():
    corners = CUBE.copy()
    corners[[1, 2], 2] += 2e-4
    blocks = [GROUND, Block((Polyhedron.hexahedron(corners),), "a")]
    (contact,) = checked_contacts(blocks)[0]
    assert contact.area == pytest.approx(1.0)
    corners[[1, 2], 2] += 1e-3
    blocks = [GROUND, Block((Polyhedron.hexahedron(corners),), "a")]
    (edge,), (told, gap) = checked_contacts(blocks)
    assert edge.corners[:, 0] == pytest.approx(0.0)
    assert "'ground' and 'a' touch in an edge" in told
    assert "'ground' and 'a' are 0.0012 m apart" in gap
    (contact,), _ = checked_contacts(blocks, tolerance=0.00121)
    assert contact.area == pytest.approx(1.0)


def test_overlaps_are_refused():
    deep = [GROUND, box([0, 0, -0.02], [1, 1, 1], "a"), box([0.9, 0, 0], [2, 1, 1], "b")]
    with pytest.raises(InputError, match=r"'a' and 'b' overlap by 0.1 m \(and 1 more\): move them"):
        checked_contacts(deep)
    with pytest.raises(InputError, match=r"set tolerance = 0.101"):
        checked_contacts([turned(block) for block in deep])
    shallow = [GROUND, box([0, 0, -0.002], [1, 1, 1], "a")]
    with pytest.raises(InputError, match=r"'ground' and 'a' overlap by 0.002 m"):
        checked_contacts(shallow)
    (contact,), _ = checked_contacts(shallow, tolerance=0.003)
    assert contact.area == pytest.approx(1.0)
    assert contact.corners[:, 2] == pytest.approx(-0.001)


def test_a_block_inside_of_another_one():
    with pytest.raises(InputError, match=r"'ground' and 'a' overlap by"):
        checked_contacts([GROUND, box([0, 0, -0.6], [0.2, 0.2, -0.4], "a")])


def test_the_same_block_twice():
    with pytest.raises(InputError, match=r"blocks 'a' and 'b' are the same: leave one out"):
        checked_contacts([GROUND, box([0, 0, 0], [1, 1, 1], "a"), box([0, 0, 0], [1, 1, 1], "b")])


def test_pieces_may_touch_and_not_overlap():
    foot = Polyhedron.box([0, 0, 0], [2, 1, 1])
    contacts, warnings = checked_contacts(
        [GROUND, Block((foot, Polyhedron.box([0, 0, 1], [1, 1, 2])), "L")]
    )
    assert len(contacts) == 1
    assert warnings == ()
    with pytest.raises(InputError, match=r"pieces of block 'L' overlap by 0.25 m: cut them apart"):
        checked_contacts([GROUND, Block((foot, Polyhedron.box([0, 0, 0.75], [1, 1, 2])), "L")])


def test_a_contact_for_every_pair_of_pieces():
    pieces = (Polyhedron.box([0, 0, 0], [1, 1, 1]), Polyhedron.box([1, 0, 0], [2, 1, 2]))
    blocks = [GROUND, Block(pieces, "L"), box([0, 0, 1], [1, 1, 2], "in its corner")]
    contacts = checked_contacts(blocks)[0]
    assert [(one.first, one.second) for one in contacts] == [(0, 1), (0, 1), (1, 2), (1, 2)]
    assert [one.area for one in contacts] == pytest.approx([1.0, 1.0, 1.0, 1.0])


def test_boxes_whose_edges_cross_are_apart():
    """Only a plane along an edge of each separates them."""
    turn = Rotation.from_euler("x", 45.0, degrees=True).as_matrix()
    lower = turned(box([-1, -0.5, -0.5], [1, 0.5, 0.5], "a", fixed=True), turn, 0.0)
    turn = Rotation.from_euler("y", 45.0, degrees=True).as_matrix()
    for height, touches in ((2.0**0.5 + 1e-3, True), (2.0**0.5 - 1e-2, False)):
        upper = turned(box([-0.5, -1, -0.5], [0.5, 1, 0.5], "b"), turn, [0, 0, height])
        if touches:
            assert checked_contacts([lower, upper])[0] == ()
        else:
            with pytest.raises(InputError, match=r"'a' and 'b' overlap by 0.01 m"):
                checked_contacts([lower, upper])


def test_blocks_that_nothing_holds():
    blocks = [
        GROUND,
        box([0, 0, 0], [1, 1, 1], "held"),
        box([0, 0, 1.5], [1, 1, 2.5], "lower"),
        box([0, 0, 2.5], [1, 1, 3.5], "upper"),
    ]
    _, warnings = checked_contacts(blocks)
    assert warnings == (
        "block 'lower' touches others, but none of them is held by a fixed block (and 1 more)",
    )


def test_fixed_blocks_have_no_contacts_with_each_other():
    blocks = [GROUND, box([0, 0, -0.5], [1, 1, 1], "rock", fixed=True)]
    assert checked_contacts(blocks) == ((), ())


def test_drums_of_unlike_sides_touch_in_their_common_part():
    blocks = [Block((prism(regular(64), 0, 1),), "a", fixed=True)]
    blocks.append(Block((prism(regular(3, (0.5, 0.5)), 1, 2),), "b"))
    blocks.append(Block((prism(regular(6), 2, 3),), "c"))
    contacts = checked_contacts(blocks)[0]
    assert [len(one.corners) for one in contacts] == [3, 3]
    assert [one.area for one in contacts] == pytest.approx([0.75 * 3.0**0.5 / 4.0] * 2)


def halves(body, normal, level):
    """A body cut by a plane; itself where the plane misses it."""
    height = body.corners @ normal - level
    if min(height.max(), -height.min()) < 1e-3:
        return [body]
    edges = [(side[k - 1], side[k]) for side in body.sides for k in range(len(side))]
    cuts = [
        (height[b] * body.corners[a] - height[a] * body.corners[b]) / (height[b] - height[a])
        for a, b in edges
        if height[a] * height[b] < 0.0
    ]
    parts = [[*body.corners[sign * height >= 0.0], *cuts] for sign in (1.0, -1.0)]
    return [Polyhedron.hull(part) for part in parts]


@pytest.mark.parametrize("seed", range(5))
def test_a_box_cut_by_planes_is_whole_again(seed):
    """Slivers with it: all inner surface is in contact, in place and turned and far away."""
    generator = np.random.default_rng(seed)
    bodies = [Polyhedron.box([0, 0, 0], [1, 1, 1])]
    for _ in range(4):
        normal = generator.normal(size=3)
        normal /= np.linalg.norm(normal)
        level = normal @ generator.uniform(0.1, 0.9, size=3)
        bodies = [part for body in bodies for part in halves(body, normal, level)]
    assert sum(body.volume for body in bodies) == pytest.approx(1.0, rel=1e-9)
    inner = 0.5 * (sum(body.areas.sum() for body in bodies) - 6.0)
    blocks = [Block((body,), str(k), fixed=k == 0) for k, body in enumerate(bodies)]
    for some in (blocks, [turned(block, TURN, [5e5, 4.6e6, 100.0]) for block in blocks]):
        assert sum(contact.area for contact in checked_contacts(some)[0]) == pytest.approx(
            inner, rel=1e-3
        )


def random_polygon(generator, count, scale=(1.0, 1.0)):
    points = generator.normal(size=(count, 2)) * scale
    return points[ConvexHull(points).vertices]


def test_common_parts_of_random_polygons():
    generator = np.random.default_rng(1)
    for _ in range(200):
        one = random_polygon(generator, 9, (1.0, generator.choice([1.0, 0.05])))
        two = random_polygon(generator, 6) + generator.normal(size=2)
        expected = Polygon(one).intersection(Polygon(two)).area
        for first, second in ((one, two), (two, one)):
            common = clipped(first, second, 1e-9)
            area = Polygon(common).area if len(common) else 0.0
            assert area == pytest.approx(expected, rel=1e-6, abs=1e-8)


def test_corners_in_line_and_corners_that_coincide_are_dropped():
    square = np.array([[0, 0], [0.5, 1e-7], [1, 0], [1, 1e-7], [1, 1], [0.2, 1], [0, 1], [0, 0.5]])
    assert len(clipped(square, square, 1e-6)) == 4
    for shift, corners in (([1e-7, -1e-7], 4), ([1.0, 0.0], 0), ([2.0, 0.0], 0)):
        assert len(clipped(square, np.add(square, shift), 1e-6)) == corners


# ---- points


def contact_of(polygon):
    corners = np.column_stack([polygon, np.zeros(len(polygon))]) @ TURN.T + 5.0
    return Contact(0, 1, np.array([TURN[:, 2], TURN[:, 0], TURN[:, 1]]), corners)


def in_plane(points):
    return (points - 5.0) @ TURN[:, :2]


SHAPES = {
    "square": regular(4),
    "triangle": regular(3),
    "hexagon": regular(6),
    "1 : 5": np.array([[0, 0], [5, 0], [5, 1], [0, 1.0]]),
    "pentagon": regular(5),
    "right triangle": np.array([[0, 0], [1, 0], [0, 1.0]]),
    "long hexagon": regular(6, (5.0, 1.0)),
    "trapezium": np.array([[0, 0], [3, 0], [1, 1], [0.5, 1.0]]),
    "sliver": np.array([[0, 0], [1, 0], [0.9, 1e-3], [0.3, 1e-3], [0.1, 5e-4]]),
    "circle": regular(40),
}


def integrated(polygon, function, places=40):
    """Integral over a polygon, by Gauss points of triangles on its centroid."""
    nodes, weights = np.polynomial.legendre.leggauss(places)
    nodes = 0.5 + 0.5 * nodes
    weights = 0.5 * weights
    centre = np.array(Polygon(polygon).centroid.coords[0])
    total = 0.0
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        twice = abs(np.linalg.det(np.array([a - centre, b - centre])))
        s, t = np.meshgrid(nodes, nodes)
        along = a + t[..., None] * (b - a) - centre
        values = function(centre + s[..., None] * along)
        total += twice * np.sum(np.outer(weights, weights) * s * values)
    return total


@pytest.mark.parametrize("quick", [False, True])
@pytest.mark.parametrize("name", SHAPES)
def test_areas_of_points(name, quick):
    polygon = SHAPES[name]
    points, areas = points_of(contact_of(polygon), quick)
    exact = Polygon(polygon)
    assert np.all(areas > 0.0)
    assert areas.sum() == pytest.approx(exact.area, rel=1e-12)
    flat = in_plane(points)
    corners = {tuple(corner) for corner in polygon.round(9) + 0.0}
    assert corners <= {tuple(place) for place in flat.round(9) + 0.0}
    if quick:
        return
    centroid = areas @ flat / areas.sum()
    assert centroid == pytest.approx(np.array(exact.centroid.coords[0]), abs=1e-9)
    assert polygon_centroid(polygon) == pytest.approx(centroid, abs=1e-9)
    for k in range(2):
        second = integrated(polygon, lambda x, k=k: x[..., k] ** 2)
        assert areas @ flat[:, k] ** 2 == pytest.approx(second, rel=1e-9)


@pytest.mark.parametrize("name", SHAPES)
def test_torque_of_friction_under_uniform_pressure(name):
    polygon = SHAPES[name]
    centre = np.array(Polygon(polygon).centroid.coords[0])
    points, areas = points_of(contact_of(polygon))
    torque = areas @ np.linalg.norm(in_plane(points) - centre, axis=1)
    exact = integrated(polygon, lambda x: np.linalg.norm(x - centre, axis=-1))
    assert torque == pytest.approx(exact, rel=0.08)


def test_torque_of_a_square():
    points, areas = points_of(contact_of(regular(4) / 2.0**0.5))
    assert areas @ np.linalg.norm(in_plane(points), axis=1) == pytest.approx(0.3914, abs=1e-4)
