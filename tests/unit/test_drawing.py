"""DXF drawings: which entities are blocks and groups, and where their corners are."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact.drawing import Drawing
from tests.drawing import area, rectangle

ezdxf = pytest.importorskip("ezdxf")

from tests.sheet import Sheet  # noqa: E402 (needs ezdxf)

SQUARE = rectangle(0, 0, 1, 1)
LAYER = {"dxfattribs": {"layer": "STONE"}}


@pytest.fixture
def sheet(tmp_path):
    return Sheet(tmp_path / "drawing.dxf")


def inserted(sheet):
    block = sheet.document.blocks.new("brick")
    block.add_lwpolyline(rectangle(0, 0, 0.5, 0.5), close=True)  # on layer 0: that of the insert
    scale = {"xscale": 2, "yscale": 2, "layer": "STONE"}
    sheet.space.add_blockref("brick", (0, 0), dxfattribs=scale)


BACK = {"extrusion": (0, 0, -1)}
CLOSED = {
    "closed": lambda sheet: sheet.polyline(SQUARE),
    "ends where it began": lambda sheet: sheet.polyline([*SQUARE, SQUARE[0]], close=False),
    "old": lambda sheet: sheet.space.add_polyline2d(SQUARE, close=True, **LAYER),
    "in space": lambda sheet: sheet.space.add_polyline3d(
        [(*p, 0) for p in SQUARE], close=True, **LAYER
    ),
    "mirrored": lambda sheet: sheet.polyline([(-x, y) for x, y in SQUARE], dxfattribs=BACK),
    "inserted": inserted,
}


@pytest.mark.parametrize("kind", CLOSED)
def test_closed_polylines_are_blocks(kind, sheet):
    CLOSED[kind](sheet)
    drawing = sheet.read().drawing
    (block,) = drawing.blocks
    assert sorted(map(tuple, np.round(block, 12))) == sorted(SQUARE)
    assert area(block) == pytest.approx(1.0)
    assert list(drawing.names) == ["STONE"]


@pytest.mark.parametrize("mirror", [False, True])
def test_arcs_become_straight_sides_on_the_arc(mirror, sheet):
    """A quarter of a ring with radii 1 and 2 around the origin."""
    bulge = np.tan(np.pi / 8)
    rows = [(2, 0, bulge), (0, 2, 0), (0, 1, -bulge), (1, 0, 0)]
    turned = [(-x, y, -b) for x, y, b in rows]
    sheet.polyline(turned if mirror else rows, format="xyb", dxfattribs=BACK if mirror else {})
    (block,) = sheet.read().drawing.blocks
    radius = np.linalg.norm(block, axis=1)
    assert block[:, 0].min() >= -1e-12  # the signs of both the coordinate and the bulge change
    assert np.allclose(np.minimum(abs(radius - 1.0), abs(radius - 2.0)), 0.0, atol=1e-12)
    assert len(block) == 2 * (90 / 5 + 1)
    assert area(block) == pytest.approx(np.pi * 3 / 4, rel=2e-3)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bulge", [1e-9, 1e-30, 1e-320])
def test_arcs_that_are_straight_are_lines(bulge, sheet):
    sheet.polyline([(x, y, bulge) for x, y in SQUARE], format="xyb")
    sheet.polyline([(0, 0.5, bulge), (0.999, 0.5, 0)], close=False, format="xyb")
    blocks = sheet.read(lines="*", snap=0.01).drawing.blocks
    assert list(map(area, blocks)) == pytest.approx([0.5, 0.5])


def test_lines_and_open_polylines_are_groups_and_layers_have_no_case(sheet):
    sheet.polyline(SQUARE)
    sheet.lines(((0, 0), (0.5, 0)), layer="Base")
    sheet.lines(((0.5, 0), (1, 0)), layer="BASE")
    sheet.polyline([(0, 0), (0, 1), (1, 1)], "rim", close=False)
    sheet.document.layers.add("hidden").off()
    sheet.lines(((0, 0), (0, 1)), layer="hidden")
    sheet.lines(((5, 0), (5, 1)), layer="far")
    sheet.space.add_circle((0, 0), 1)
    contents = sheet.read()
    assert contents.drawing.lengths() == pytest.approx({"Base": 1.0, "rim": 2.0})
    assert contents.notes == (
        "left out: 1 on layer 'hidden', which is off or frozen",
        "left out: 1 closed CIRCLE (else give the layer with --blocks)",
        "left out: lines on layer 'far', as no side of a block lies on them",
    )


def test_lengths_count_both_sides_of_a_joint():
    blocks = [rectangle(0, 0, 2, 1), rectangle(0, 1, 1, 2)]
    drawing = Drawing([np.array(b, dtype=float) for b in blocks], ["a", "a"])
    drawing = drawing.with_group("bed", ((0, 1), (2, 1))).with_group("part", ((0, 0), (0.3, 0)))
    assert drawing.lengths() == pytest.approx({"bed": 3.0, "part": 0.3})
    assert len(drawing.gaps()) == 0
