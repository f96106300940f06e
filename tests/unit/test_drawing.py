"""DXF drawings: which entities are blocks and groups, and where their corners are."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact.drawing import Drawing, LayerRoles, read_dxf
from tests.drawing import rectangle

ezdxf = pytest.importorskip("ezdxf")

SQUARE = rectangle(0, 0, 1, 1)


def read(draw, tmp_path):
    """What is read of a drawing in m."""
    document = ezdxf.new()
    draw(document.modelspace(), document)
    document.saveas(tmp_path / "drawing.dxf")
    return read_dxf(tmp_path / "drawing.dxf")


def area(corners) -> float:
    x, y = np.asarray(corners).T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def closed(corners, layer="stone"):
    """Draw a closed polyline."""
    return lambda space, _: space.add_lwpolyline(corners, close=True, dxfattribs={"layer": layer})


def open_but_ending_where_it_began(space, _):
    space.add_lwpolyline([*SQUARE, SQUARE[0]], dxfattribs={"layer": "stone"})


def old_polyline(space, _):
    space.add_polyline2d(SQUARE, close=True, dxfattribs={"layer": "stone"})


def spatial_polyline(space, _):
    space.add_polyline3d([(*p, 0) for p in SQUARE], close=True, dxfattribs={"layer": "stone"})


def mirrored(space, _):
    back = {"layer": "stone", "extrusion": (0, 0, -1)}
    space.add_lwpolyline([(-x, y) for x, y in SQUARE], close=True, dxfattribs=back)


def inserted(space, document):
    block = document.blocks.new("brick")
    block.add_lwpolyline(rectangle(0, 0, 0.5, 0.5), close=True)  # on layer 0: that of the insert
    scale = {"xscale": 2, "yscale": 2, "layer": "stone"}
    space.add_blockref("brick", (0, 0), dxfattribs=scale)


@pytest.mark.parametrize(
    "draw",
    [closed(SQUARE), open_but_ending_where_it_began, old_polyline, spatial_polyline, mirrored,
     inserted],
)  # fmt: skip
def test_closed_polylines_are_blocks(draw, tmp_path):
    drawing = read(draw, tmp_path).drawing
    (block,) = drawing.blocks
    assert sorted(map(tuple, np.round(block, 12))) == sorted(SQUARE)
    assert area(block) == pytest.approx(1.0)
    assert list(drawing.names) == ["stone"]


@pytest.mark.parametrize("mirror", [False, True])
def test_arcs_become_straight_sides_on_the_arc(mirror, tmp_path):
    def ring(space, _):
        """A quarter of a ring with radii 1 and 2 around the origin."""
        bulge = np.tan(np.pi / 8)
        rows = [(2, 0, bulge), (0, 2, 0), (0, 1, -bulge), (1, 0, 0)]
        turned = [(-x, y, -b) for x, y, b in rows]
        side = {"extrusion": (0, 0, -1)} if mirror else {}
        corners = turned if mirror else rows
        space.add_lwpolyline(corners, format="xyb", close=True, dxfattribs=side)

    (block,) = read(ring, tmp_path).drawing.blocks
    radius = np.linalg.norm(block, axis=1)
    if mirror:  # the signs of both the coordinate and the bulge change
        assert block[:, 0].min() >= -1e-12
    assert np.allclose(np.minimum(abs(radius - 1.0), abs(radius - 2.0)), 0.0, atol=1e-12)
    assert len(block) == 2 * (90 / 5 + 1)
    assert area(block) == pytest.approx(np.pi * 3 / 4, rel=2e-3)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bulge", [1e-9, 1e-30, 1e-320])
def test_arcs_that_are_straight_are_lines(bulge, tmp_path):
    def draw(space, _):
        rows = [(x, y, bulge) for x, y in SQUARE]
        space.add_lwpolyline(rows, format="xyb", close=True, dxfattribs={"layer": "lines"})
        space.add_lwpolyline([(0, 0.5, bulge), (0.999, 0.5)], format="xyb")

    document = ezdxf.new()
    draw(document.modelspace(), document)
    document.saveas(tmp_path / "drawing.dxf")
    drawing = read_dxf(tmp_path / "drawing.dxf", roles=LayerRoles(lines=["*"]), snap=0.01).drawing
    assert [area(block) for block in drawing.blocks] == pytest.approx([0.5, 0.5])


def test_lines_and_open_polylines_are_groups_and_layers_have_no_case(tmp_path):
    def draw(space, document):
        closed(SQUARE)(space, document)
        space.add_line((0, 0), (0.5, 0), dxfattribs={"layer": "Base"})
        space.add_line((0.5, 0), (1, 0), dxfattribs={"layer": "BASE"})
        space.add_lwpolyline([(0, 0), (0, 1), (1, 1)], dxfattribs={"layer": "rim"})
        document.layers.add("hidden").off()
        space.add_line((0, 0), (0, 1), dxfattribs={"layer": "hidden"})
        space.add_line((5, 0), (5, 1), dxfattribs={"layer": "far"})
        space.add_circle((0, 0), 1)

    contents = read(draw, tmp_path)
    assert contents.drawing.lengths() == pytest.approx({"Base": 1.0, "rim": 2.0})
    assert contents.notes == (
        "left out: 1 on layer 'hidden', which is off or frozen",
        "left out: 1 closed CIRCLE (else give the layer with --blocks)",
        "left out: layer 'far', on whose lines no side of a block lies",
    )


def test_lengths_count_both_sides_of_a_joint():
    blocks = [rectangle(0, 0, 2, 1), rectangle(0, 1, 1, 2)]
    drawing = Drawing([np.array(b, dtype=float) for b in blocks], ["a", "a"])
    drawing = drawing.with_group("bed", ((0, 1), (2, 1))).with_group("part", ((0, 0), (0.3, 0)))
    assert drawing.lengths() == pytest.approx({"bed": 3.0, "part": 0.3})
    assert len(drawing.gaps()) == 0
