"""Drawings with slips of the pen: ends of lines that miss, outlines drawn over, wrong units."""

from __future__ import annotations

import random

import numpy as np
import pytest

from fenics_contact import InputError
from fenics_contact.drawing import read_dxf
from tests.drawing import rectangle

ezdxf = pytest.importorskip("ezdxf")

from tests.mutated_drawings import Pen, wall  # noqa: E402 (needs ezdxf)
from tests.quick import some  # noqa: E402
from tests.sheet import Sheet, areas, said  # noqa: E402


@pytest.fixture
def sheet(tmp_path):
    return Sheet(tmp_path / "drawing.dxf", 4)


def count(contents) -> tuple[int, int]:
    """Blocks and openings."""
    return len(contents.drawing.blocks), len(contents.voids)


# ---- ends of lines

FRAME = [((0, 0), (1000, 0)), ((1000, 0), (1000, 500)), ((1000, 500), (0, 500)), ((0, 500), (0, 0))]
SLIPS = {
    "a joint ends short of a bed": ([((400, 0), (400, 497))], "2 stones are joined", 3),
    "a joint begins short": ([((400, 2), (400, 500))], "2 stones are joined", 2),
    "both lines are short of a corner": (
        [((400, 0), (400, 298.5)), ((0, 300), (398, 300))], "2 stones are joined", 3,
    ),
    "a level joint in two pieces": (
        [((0, 200), (500, 200)), ((502.5, 200), (1000, 200))], "2 stones are joined", 3,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SLIPS)
def test_slip_is_told_and_mended(name, sheet):
    lines, text, snap = SLIPS[name]
    sheet.lines(*FRAME, *lines)
    drawn = sheet.read()
    assert count(drawn) == (1, 0)
    assert drawn.slips == f"{text} to their neighbours: --snap {snap} mends them"
    mended = sheet.read(snap=5.0)
    assert count(mended) == (2, 0)
    assert sum(areas(mended)) == pytest.approx(0.5)
    assert mended.slips == ""


def test_corner_of_the_whole_that_is_open_loses_a_stone(sheet):
    sheet.lines(((0, 0), (998, 0)), ((1000, 2), (1000, 500)), *FRAME[2:], ((500, 0), (500, 500)))
    assert sheet.read().slips == "1 stones are lost: --snap 3 mends them"
    assert areas(sheet.read(snap=3.0)) == pytest.approx([0.25, 0.25])


def test_drawing_whose_only_stone_is_open_says_what_mends_it(sheet):
    sheet.lines(*FRAME[:3], ((0, 500), (0, 3)))
    with pytest.raises(InputError, match=r"enclose no face.*--snap 3 may mend them"):
        sheet.read()
    assert areas(sheet.read(snap=3.0)) == pytest.approx([0.5])


def test_window_that_is_open_is_no_stone_after_snap(sheet):
    sheet.lines(*FRAME)
    window = rectangle(400, 100, 600, 300)
    ends = [*zip(window, [*window[1:], (400, 103)], strict=True)]
    sheet.lines(*ends, layer="WINDOW")
    sheet.lines(((400, 300), (0, 300)), ((600, 300), (1000, 300)))
    drawn = sheet.read()
    assert "1 openings filled: --snap 3 mends them" in drawn.slips
    mended = sheet.read(snap=3.0)
    assert count(mended) == (2, 1)
    assert sum(areas(mended)) == pytest.approx(0.5 - 0.04)


def test_lines_beyond_what_they_meet_are_no_doubt_below_the_snap(sheet):
    sheet.lines(*FRAME, ((400, -3), (400, 503)), ((0, 200), (403, 200)))
    mended = sheet.read(snap=5.0)
    assert areas(mended) == pytest.approx([0.08, 0.12, 0.3])
    assert not mended.marks


@pytest.mark.parametrize("turn", [0.3, -0.2])
def test_arcs_meet_lines_and_lines_arcs(turn, sheet):
    """A half disc of radius 500 mm, cut by a radius, all ends up to 3 mm off."""
    sheet.lines(((-502, 0), (502, 0)), ((0, 2), (0, 498)))
    sheet.space.add_arc((0, 0), 500, -turn, 180 - turn, dxfattribs={"layer": "JOINTS"})
    mended = sheet.read(snap=5.0)
    assert areas(mended) == pytest.approx([np.pi / 16.0] * 2, rel=2e-3)


@pytest.mark.parametrize("snap", [-1.0, np.nan, np.inf])
def test_snap_is_a_length(snap, sheet):
    sheet.lines(*FRAME)
    with pytest.raises(InputError, match="snap"):
        sheet.read(snap=snap)


#: A wall with two windows and a doorway.
WALL = 7


@pytest.mark.parametrize("seed", some(range(6), 3))
def test_wall_with_random_slips_is_mended(seed, tmp_path):
    """A quarter of the ends of all lines and arcs is 1 to 3 mm off."""
    made = wall(random.Random(WALL))
    found = []
    for often, snap in ((0.0, 5.0), (0.25, 5.0), (0.25, 0.0)):
        pen = Pen(random.Random(seed), often)
        pen.lines(made)
        pen.document.saveas(tmp_path / "wall.dxf")
        found.append(read_dxf(tmp_path / "wall.dxf", snap=snap))
    clean, mended, drawn = found
    stones = made.stones()
    assert count(clean) == (len(stones), 2)  # and the doorway, which is open below
    assert len(mended.voids) == 2
    assert len(mended.drawing.blocks) == pytest.approx(len(stones), rel=0.01) or mended.slips
    assert sum(areas(mended)) == pytest.approx(sum(areas(clean)), rel=1e-3) or mended.slips
    assert count(drawn) == count(clean) or "mends them" in drawn.slips


# ---- polylines

OVER = {
    "over its first side": [(0, 500), (1000, 500), (1000, 900), (0, 900), (0, 500), (1000, 500)],
    "over a part of it": [(0, 500), (1000, 500), (1000, 900), (0, 900), (0, 500), (300, 500)],
    "over two sides": [
        (0, 500), (1000, 500), (1000, 900), (0, 900), (0, 500), (1000, 500), (1000, 900),
    ],
    "from the middle of a side": [
        (300, 500), (1000, 500), (1000, 900), (0, 900), (0, 500), (1000, 500),
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", OVER)
def test_polyline_ends_where_it_comes_back(name, sheet):
    sheet.polyline(rectangle(0, 0, 1000, 500))
    sheet.polyline(OVER[name], close=False)
    contents = sheet.read()
    assert areas(contents) == pytest.approx([0.4, 0.5])
    assert said(contents, "1 polylines on layer 'STONE' go around and on")
    assert set(contents.drawing.groups) == {"base"}


def test_polyline_that_goes_on_to_another_stone_is_named(sheet):
    """Around the lower stone, then up and along three sides of the upper one."""
    ring = [*rectangle(0, 0, 1000, 500), (0, 0)]
    sheet.polyline([*ring, (0, 900), (1000, 900), (1000, 500)], close=False)
    contents = sheet.read()
    assert areas(contents) == pytest.approx([0.5])
    assert said(contents, "an open polyline on layer 'STONE' is no block")


def test_every_open_polyline_on_a_layer_of_blocks_is_named(sheet):
    sheet.polyline(rectangle(0, 0, 1000, 500))
    for x in (0, 1000, 2000):
        sheet.polyline(rectangle(x, 500, x + 1000, 900), close=False)
    (text,) = [note for note in sheet.read().notes if "open polyline" in note]
    for place in ("(0, 500) mm", "(1000, 500) mm", "(2000, 500) mm"):
        assert place in text


@pytest.mark.parametrize(
    "again",
    [
        rectangle(0, 500, 1000, 900)[::-1],
        [*rectangle(0, 500, 1000, 900)[2:], *rectangle(0, 500, 1000, 900)[:2]],
        [(0, 500), (400, 500), (1000, 500), (1000, 900), (0, 900)],
    ],
)
def test_stone_drawn_twice_is_taken_once(again, sheet):
    for corners in (rectangle(0, 0, 1000, 500), rectangle(0, 500, 1000, 900), again):
        sheet.polyline(corners)
    contents = sheet.read()
    assert areas(contents) == pytest.approx([0.4, 0.5])
    assert said(contents, "a block on layer STONE is drawn twice")
    assert len(contents.marks) == 1


# ---- units


SCALES = [(1, 1.0, "m"), (4, 1.0, "m"), (6, 1000.0, "mm"), (6, 100.0, "cm")]


@pytest.mark.parametrize(("unit", "scale", "proposed"), SCALES)
def test_bricks_in_another_unit(unit, scale, proposed, tmp_path):
    """Bricks of 250 mm x 120 mm whose file says inch, or so that they are tiny or large."""
    sheet = Sheet(tmp_path / "bricks.dxf", unit)
    for k in range(4):
        brick = np.array(rectangle(0, 0.12 * k, 0.25, 0.12 * k + 0.12))
        sheet.polyline(scale * brick)
    (text,) = [note for note in sheet.read().notes if "is the unit" in note]
    assert f"--unit {proposed} makes it 0.173 m" in text
    assert not [note for note in read_dxf(sheet.path, unit=proposed).notes if "is the unit" in note]


# ---- closed polylines among lines, origins, names


def bond(sheet, left=0.0, low=0.0) -> None:
    """Five courses of ten stones of 500 mm x 200 mm."""
    for y in range(6):
        sheet.lines(((left, low + 200 * y), (left + 5000, low + 200 * y)))
    for x in range(11):
        sheet.lines(((left + 500 * x, low), (left + 500 * x, low + 1000)))


def test_closed_polyline_among_lines_names_the_blocks_in_it(sheet):
    bond(sheet)
    sheet.polyline(rectangle(0, 400, 5000, 600), layer="STOREY")
    contents = sheet.read()
    assert sorted(contents.drawing.names) == 10 * ["STOREY"] + 40 * ["blocks"]
    assert areas(contents) == pytest.approx(50 * [0.1])


def test_closed_polyline_around_lines_bounds_the_blocks_at_the_edge(sheet):
    """Without it the stones at the edge have no outer side."""
    for y in range(1, 5):
        sheet.lines(((0, 200 * y), (5000, 200 * y)))
    for x in range(1, 10):
        sheet.lines(((500 * x, 0), (500 * x, 1000)))
    sheet.polyline(rectangle(0, 0, 5000, 1000), layer="WALL")
    assert areas(sheet.read()) == pytest.approx(50 * [0.1])


def test_stone_between_lines_and_a_closed_stone_above(sheet):
    bond(sheet)
    sheet.polyline(rectangle(0, 1000, 1000, 1500), layer="MERLON")
    contents = sheet.read(snap=1.0)
    assert areas(contents) == pytest.approx([*50 * [0.1], 0.5])


@pytest.mark.parametrize("kind", ["frame", "layer"])
def test_origin_is_a_corner_of_the_blocks(kind, sheet):
    bond(sheet, 4e8, 5e9)
    layer = {"frame": "SHEET", "layer": "FRAME"}[kind]
    sheet.polyline(rectangle(4e8 - 2000, 5e9 - 3000, 4e8 + 9000, 5e9 + 4000), layer=layer)
    contents = sheet.read()
    assert contents.origin == pytest.approx([4e5, 5e6])
    assert np.concatenate(contents.drawing.blocks).min(axis=0) == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize("name", [300 * "x", 80 * "\u00e4", "the QUOTEold stone"])
def test_names_that_gmsh_does_not_keep(name, sheet):
    bond(sheet)
    for number, layer in enumerate((name, f"{name}2")):
        sheet.lines(((0, 200 * number), (5000, 200 * number)), layer=layer)
    sheet.document.saveas(sheet.path)
    text = sheet.path.read_text("utf-8").replace("QUOTE", '"')  # ezdxf refuses to write it
    sheet.path.write_text(text, "utf-8")
    contents = read_dxf(sheet.path)
    assert len(contents.drawing.groups) == 4  # two of these names, the joints and the base
    for group in contents.drawing.groups:
        assert len(group.encode()) <= 127 and '"' not in group
    assert sum("gmsh does not keep its name" in note for note in contents.notes) == 2


@pytest.mark.parametrize("far", [1e9, 3e9, 1e12])
def test_lines_to_nowhere_beside_which_all_others_are_points(far, tmp_path):
    sheet = Sheet(tmp_path / "drawing.dxf")
    w, h, base = 0.68, 0.85, "base"
    sheet.lines(((-4e-8, 0), (0, 1e20)), ((w, 0), (w, h)), ((0, 0), (w, 0)), layer=base)
    sheet.lines(((0, 0.5 * h), (w, 0.5 * h)), ((0, h), (w, h - 1e-6)), layer=base)
    sheet.lines(((0, 0), (far, 1)), layer="frame")
    with pytest.raises(InputError, match="no line is longer than the distance of points"):
        sheet.read(snap=0.001)
