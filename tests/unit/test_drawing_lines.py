"""DXF drawings: faces between lines, layers as roles, inserts, and what looks wrong in them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from fenics_contact import InputError
from fenics_contact.drawing import read_dxf
from tests.drawing import rectangle

ezdxf = pytest.importorskip("ezdxf")


from tests.sheet import Sheet, areas, said  # noqa: E402 (needs ezdxf)


@pytest.fixture
def sheet(tmp_path):
    return Sheet(tmp_path / "drawing.dxf")


# ---- faces between lines


def test_faces_between_lines_are_blocks(sheet):
    sheet.grid([0, 1, 3], [0, 1, 2])
    contents = sheet.read()
    assert areas(contents) == pytest.approx([1.0, 1.0, 2.0, 2.0])
    assert contents.drawing.lengths() == pytest.approx({"JOINTS": 20.0, "base": 3.0})
    assert said(contents, "lines between blocks: layers JOINTS", "4 blocks, 0 openings")
    assert not contents.marks


def test_lines_that_cross_overlap_and_are_drawn_twice(sheet):
    sheet.grid([0, 1, 2], [0, 1])
    sheet.lines(((1, -0.5), (1, 1.5)), ((0, 0), (1.5, 0)), ((1, 0), (1, 0.5)))
    assert areas(sheet.read()) == pytest.approx([1.0, 1.0])


def test_stones_of_one_layer_as_closed_polylines_and_as_lines(sheet):
    """Those of lines that miss each other are told of, and taken with the layer as their group."""
    sheet.box(0, 0, 1, 1)
    sheet.box(2.02, 0, 3, 1)
    corners = [(1.01, 0), (2.01, 0), (2.01, 1), (1.01, 1), (1.01, 0.01)]
    sheet.lines(*pairwise(corners), layer="STONE")
    contents = sheet.read()
    assert len(contents.drawing.blocks) == 2
    assert contents.slips == (
        "1 outline of lines on layer STONE left out, beside closed polylines there: if they are"
        " stones, --blocks STONE --snap 0.01 takes them"
    )
    contents = sheet.read(snap=0.01, blocks="STONE")
    assert contents.drawing.names == ["STONE"] * 3 and not contents.slips


def test_outlines_of_openings_beside_lines_leave_no_slivers(sheet):
    """The line above the door ends beside its corner, whose outline is 2 mm inside the stones."""
    sheet.lines(((0, 0), (1, 0)), ((2, 0), (3, 0)), ((0, 1), (3, 1)), ((0, 2), (3, 2)))
    sheet.lines(*(((x, 0), (x, 0.998)) for x in (1, 2)), *(((x, 0), (x, 2)) for x in (0, 3)))
    sheet.box(1.002, 0, 1.999, 0.999, layer="DOOR")
    contents = sheet.read(snap=0.003)
    assert areas(contents) == pytest.approx([1.0, 1.0, 3.0])
    assert len(contents.voids) == 1 and not contents.marks


def test_faces_below_arcs_ellipses_and_splines_are_blocks(sheet):
    sheet.lines(((0, 0), (6, 0)))
    layer = {"layer": "JOINTS"}
    sheet.space.add_arc((1, 0), 1, 0, 180, dxfattribs=layer)
    sheet.space.add_ellipse((3, 0), (1, 0), 0.5, 0, math.pi, dxfattribs=layer)
    sheet.space.add_spline([(4, 0), (4.5, 1), (5, 0.5), (6, 0)], dxfattribs=layer)
    found = areas(sheet.read())
    assert len(found) == 3
    assert found[0] == pytest.approx(math.pi / 4, rel=3e-3)
    assert found[2] == pytest.approx(math.pi / 2, rel=3e-3)


def test_spline_through_points_of_equal_distances(sheet):
    sheet.space.add_spline([(0, 1), (-1, 0.7), (-0.5, 0.3), (0, 0)], dxfattribs={"layer": "a"})
    sheet.lines(((0, 0), (0, 1)), layer="a")
    sheet.lines(((0, 0), (1, 0)), ((1, 0), (1, 1)), ((1, 1), (0, 1)), layer="a")
    assert len(areas(sheet.read())) == 2


def test_blocks_have_the_same_chords_where_they_share_an_arc(sheet):
    """A quarter of a disc under stones that end anywhere on its arc; bulges of few digits."""
    quarter = math.tan(math.pi / 8)
    rows = [(1, 0, round(quarter, 4)), (0, 1, 0), (0, 0, 0)]
    sheet.space.add_lwpolyline(rows, format="xyb", close=True, dxfattribs={"layer": "ARCH"})
    ends = np.radians([0.0, 23.7, 61.3, 90.0])
    for a, b in pairwise(ends):
        bulge = -math.tan((b - a) / 4)
        (x0, y0), (x1, y1) = ((math.cos(c), math.sin(c)) for c in (a, b))
        rows = [(x1, y1, bulge), (x0, y0, 0), (2 * x0, 2 * y0, 0), (2 * x1, 2 * y1, 0)]
        sheet.space.add_lwpolyline(rows, format="xyb", close=True, dxfattribs={"layer": "STONE"})
    contents = sheet.read()
    assert len(contents.drawing.gaps()) == 0
    drawing = contents.drawing.with_group("base", ((0, 0), (1, 0)))
    arch = contents.drawing.blocks[0]
    on_arc = arch[np.abs(np.hypot(*arch.T) - 1.0) < 1e-3]
    for block in contents.drawing.blocks[1:]:
        inner = block[np.abs(np.hypot(*block.T) - 1.0) < 1e-3]
        nearest = np.linalg.norm(inner[:, None] - on_arc, axis=2).min(axis=1)
        assert nearest.max() < 1e-6 * 2.0
    assert drawing.lengths()["base"] == pytest.approx(1.0)


def test_openings_between_lines_are_left_out(sheet):
    """A window, and a door that is open at the ground."""
    sheet.grid([0, 1, 2, 3, 4], [0, 1, 2, 3])
    sheet.box(2, 1, 3, 2, layer="Fenster EG")
    sheet.lines(((1, 0), (1, 2)), ((1, 2), (1.6, 2)), ((1.6, 2), (1.6, 0)), layer="DOOR")
    contents = sheet.read()
    assert said(contents, "openings by its name: layer 'DOOR'", "layer 'Fenster EG'")
    assert len(contents.voids) == 2
    assert sum(areas(contents)) == pytest.approx(12.0 - 1.0 - 1.2)


def test_line_within_a_block_is_marked(sheet):
    """One ends in the air, one 1 mm short of the next."""
    sheet.grid([0, 2], [0, 1])
    sheet.lines(((0.5, 0), (0.5, 0.4)), ((1.5, 0), (1.5, 0.999)))
    contents = sheet.read()
    assert len(areas(contents)) == 1
    assert said(contents, "(0.5, 0.4) m a line ends within", "(1.5, 0.999) m a line ends short")
    assert {(mark.x, mark.y) for mark in contents.marks} == {(0.5, 0.4), (1.5, 0.999)}


def test_block_with_a_hole_is_refused(sheet):
    sheet.grid([0, 3], [0, 3])
    sheet.box(1, 1, 2, 2, layer="JOINTS")
    with pytest.raises(InputError, match=r"would be a block with a hole; draw a joint from there"):
        sheet.read(lines="JOINTS")


# ---- layers as roles


def framed(sheet) -> None:
    """Four stones around a hole with the closed outline of a window, in a frame."""
    for x, y in ((0, 0), (2, 0), (0, 2), (2, 2)):
        sheet.box(x, y, x + 2, y + 2 if x or y else 1)
    sheet.box(0, 1, 2, 2, layer="A-1")
    sheet.box(-1, -1, 5, 5, layer="0")


def test_frame_around_all_else_is_left_out(sheet):
    framed(sheet)
    contents = sheet.read()
    assert said(contents, "left out as a frame around all else", "on layer '0', 6 x 6 m")
    assert said(contents, "closed curves are blocks on layers STONE, A-1; name those")
    assert contents.drawing.names == ["STONE"] * 4 + ["A-1"]


@pytest.mark.parametrize(
    ("roles", "text"),
    [
        ({"voids": "A-*"}, ""),
        ({"ignore": "a-1"}, ""),
        ({"blocks": "stone"}, "closed curves on layers A-1 are no blocks, as --blocks says"),
    ],
)
def test_window_is_no_stone_if_its_layer_has_a_role(roles, text, sheet):
    framed(sheet)
    contents = sheet.read(**roles)
    assert contents.drawing.names == ["STONE"] * 4
    assert said(contents, text)
    assert contents.drawing.lengths()["base"] == pytest.approx(4.0)
    assert len(contents.voids) == ("voids" in roles)


def test_layers_of_roles_are_checked(sheet):
    framed(sheet)
    with pytest.raises(InputError, match="no lines on a layer 'NOPE'; it has 0, A-1, STONE"):
        sheet.read(lines="NOPE")
    with pytest.raises(InputError, match="layer 'A-1' is given as blocks and as voids"):
        sheet.read(blocks="A-1", voids="a-1")


def test_closed_curve_divided_by_lines(sheet):
    sheet.box(0, 0, 4, 2, layer="WALL")
    sheet.lines(((0, 1), (4, 1)), ((2, 0), (2, 1)), ((1, 1), (1, 2)), ((3, 1), (3, 2)))
    contents = sheet.read()
    assert contents.drawing.names == ["WALL"] * 5
    assert said(contents, "layer 'JOINTS', whose lines run through closed curves")


# ---- inserts and numbers


def test_arrays_of_inserts_are_all_their_copies(sheet):
    block = sheet.document.blocks.new("B")
    block.add_lwpolyline(rectangle(0, 0, 1, 0.5), close=True)
    array = {"layer": "W", "column_count": 3, "row_count": 2}
    array |= {"column_spacing": 1.0, "row_spacing": 0.5, "rotation": 90.0}
    sheet.space.add_blockref("B", (0, 0), dxfattribs=array)
    contents = sheet.read()
    assert contents.drawing.names == ["W"] * 6
    assert np.ptp(np.concatenate(contents.drawing.blocks), axis=0) == pytest.approx([1.0, 3.0])


def test_inserts_that_are_missing_in_themselves_or_too_deep_are_told(sheet):
    sheet.box(0, 0, 1, 1)
    sheet.document.blocks.new("SELF").add_blockref("SELF", (0, 0))
    for k in range(30):
        sheet.document.blocks.new(f"N{k}").add_blockref(f"N{k + 1}", (0, 0))
    for name in ("SELF", "NOPE", "N0"):
        sheet.space.add_blockref(name, (0, 0))
    contents = sheet.read()
    assert len(contents.drawing.blocks) == 1
    assert said(contents, "1 insert of 'NOPE', a block that the drawing lacks")
    assert said(contents, "1 insert of 'SELF' in itself", "1 insert of 'N16' in 16 others")


def test_too_many_entities_are_refused_at_once(sheet):
    sheet.document.blocks.new("B").add_lwpolyline(rectangle(0, 0, 1, 1), close=True)
    array = {"column_count": 30_000, "row_count": 30_000, "column_spacing": 1, "row_spacing": 1}
    sheet.space.add_blockref("B", (0, 0), dxfattribs=array)
    with pytest.raises(InputError, match="more than 200000 entities with its inserted blocks"):
        sheet.read()


def test_map_coordinates_are_moved(sheet):
    sheet.box(691000, 5334000, 691001, 5334001)
    sheet.box(691001, 5334000, 691002, 5334001)
    contents = sheet.read()
    assert contents.origin == pytest.approx([691000.0, 5334000.0])
    corners = np.concatenate(contents.drawing.blocks)
    assert (corners.min(axis=0), corners.max(axis=0)) == (
        pytest.approx([0.0, 0.0]),
        pytest.approx([2.0, 1.0]),
    )
    assert said(contents, "moved: map coordinates, the new origin is (691000, 5334000) m")


def test_line_that_ends_nowhere_is_left_out(sheet):
    sheet.box(0, 0, 1, 1)
    sheet.lines(((0, 0), (1e300, 0)), layer="base")
    assert said(sheet.read(), "left out: 1 LINE on layer 'base' with a coordinate of 1e+300 m")


@pytest.mark.parametrize(
    ("x", "message"),
    [
        (1e300, "'STONE' has a coordinate of 1e\\+300 m; delete it"),
        (1e9, r"'STONE' at \(1000000000, 0\.5\) m is .* away from the others; delete it"),
    ],
)
def test_block_that_is_far_away_is_refused(x, message, sheet):
    for k in range(8):
        sheet.box(k, 0, k + 1, 1)
    sheet.box(x, 0, x + 1, 1)
    with pytest.raises(InputError, match=message):
        sheet.read()


def test_drawing_that_stands_on_nothing(sheet):
    sheet.space.add_circle((0, 0.5), 0.5, dxfattribs={"layer": "STONE"})
    with pytest.raises(InputError, match="no side of a block lies on the lowest level"):
        sheet.read(blocks="STONE")


def test_line_named_base_that_no_block_touches(sheet):
    sheet.box(0, 0, 1, 1)
    sheet.lines(((0, -1), (1, -1)), layer="base")
    contents = sheet.read()
    assert contents.lengths == pytest.approx({"base": 1.0})
    assert said(
        contents, "lines on layer 'base', as no side of a block lies on them", "lowest level"
    )


def test_bytes_that_are_no_text_are_replaced(sheet):
    sheet.box(0, 0, 1, 1, layer="STEINö")
    sheet.read()
    sheet.path.write_bytes(sheet.path.read_bytes().replace("ö".encode(), b"\xff\xfe"))
    (name,) = read_dxf(sheet.path).drawing.names
    assert name.startswith("STEIN")
