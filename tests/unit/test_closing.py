"""Outlines that grow to the middle of mortar joints, and what a drawing says of its joints."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, SolveOptions, limit_load
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.drawing import Drawing, read_dxf
from fenics_contact.geometry.closing import Mortar
from fenics_contact.geometry.dxf.command import MeshOrder, mesh_drawing
from fenics_contact.geometry.outlines import outline_problem, overlaps
from fenics_contact.meshing import closed_joints, polygons
from tests.drawing import rectangle, turned
from tests.mortar import Facade, rubble

ezdxf = pytest.importorskip("ezdxf")
shapely = pytest.importorskip("shapely.geometry")


def box(x: float, y: float, width: float, height: float) -> np.ndarray:
    return np.array(rectangle(x, y, x + width, y + height))


def stack(bricks: int, width: float, height: float, joint: float) -> list[np.ndarray]:
    return [box(0.0, k * (height + joint), width, height) for k in range(bricks)]


def bond(width: float, height: float, joints: tuple[float, float]) -> list[np.ndarray]:
    """Six courses in running bond; thickness of head and bed joints."""
    step = width + joints[0]
    return [
        box(step * (i - 0.5 * (k % 2)), k * (height + joints[1]), width, height)
        for k in range(6)
        for i in range(5)
    ]


BONDS = (
    bond(0.25, 0.065, (0.01, 0.01)),
    bond(0.24, 0.113, (0.012, 0.015)),
    bond(0.4, 0.2, (0.01, 0.008)),
)


def bounds(outline: np.ndarray) -> list[float]:
    return [*outline.min(axis=0), *outline.max(axis=0)]


def area(outline: np.ndarray) -> float:
    return shapely.Polygon(outline).area


def whole(outlines):
    """The union of stones."""
    from shapely.ops import unary_union

    return unary_union([shapely.Polygon(outline).buffer(1e-9) for outline in outlines])


def check_stones(drawn, grown) -> None:
    """Nothing overlaps or crosses itself, and stones keep their places."""
    assert len(grown) == len(drawn)
    assert [outline_problem(outline) for outline in grown] == [""] * len(grown)
    assert len(overlaps(grown, 1e-5)[0]) == 0
    for before, after in zip(drawn, grown, strict=True):
        kept = shapely.Polygon(before).intersection(shapely.Polygon(after)).area
        assert kept > 0.995 * area(before)


def scene_of(outlines, size: float, law: JointLaw, friction: float = 0.8) -> Scene:
    return Scene(
        BlockMesh.from_model(polygons(outlines, size)),
        {"default": Material(5e9, 0.2, 2000.0)},
        dead=Load((0.0, -9.81)),
        live=Load((9.81, 0.0)),
        joints={"default": law},
        foundations={"base": JointLaw(friction=friction)},
        solve=SolveOptions(error=False, lowest=False, peak=False),
    )


# ---- by hand


def test_bricks_on_each_other_tip_at_width_over_height_with_mortar():
    grown = closed_joints(stack(10, 0.25, 0.065, 0.01))
    assert bounds(grown[0]) == pytest.approx([0.0, 0.0, 0.25, 0.07])
    assert bounds(grown[4]) == pytest.approx([0.0, 0.295, 0.25, 0.37])
    assert bounds(grown[9]) == pytest.approx([0.0, 0.67, 0.25, 0.74])
    assert {len(outline) for outline in grown} == {4}
    found = limit_load(scene_of(grown, 0.03, JointLaw(friction=0.8)))
    assert found.load_factor == pytest.approx(0.25 / 0.74, rel=1e-4)


@pytest.mark.parametrize("degrees", [0.0, 17.0])
def test_head_and_bed_joints_of_unlike_thickness_meet_in_points(degrees):
    drawn = [turned(outline, degrees) for outline in bond(0.25, 0.065, (0.015, 0.008))]
    grown = closed_joints(drawn)
    # The third brick of the second course: half of 15 mm at its ends, of 8 mm above and below.
    left = 1.5 * 0.265
    expected = [left - 0.0075, 0.073 - 0.004, left + 0.25 + 0.0075, 0.073 + 0.065 + 0.004]
    assert bounds(turned(grown[7], -degrees)) == pytest.approx(expected, abs=1e-9)
    assert area(grown[7]) == pytest.approx(0.265 * 0.073, rel=1e-9)
    assert len(Drawing(grown, ["a"] * len(grown)).gaps()) == 0


@pytest.mark.parametrize(
    ("width", "height"),
    [(0.25, 0.065), (0.25, 0.12), (0.24, 0.071), (0.215, 0.065), (0.29, 0.06), (0.4, 0.2)],
)
@pytest.mark.parametrize("joint", [0.008, 0.01, 0.015])
def test_usual_formats_are_seen_and_closed(width, height, joint):
    drawn = bond(width, height, (joint, joint))
    assert Mortar.of(drawn).said(1e-3, "mm") == f"{1e3 * joint:.3g} mm"
    grown = closed_joints(drawn)
    check_stones(drawn, grown)
    outline = whole(grown)
    assert outline.geom_type == "Polygon" and len(outline.interiors) == 0
    assert outline.bounds == pytest.approx(whole(drawn).bounds)
    assert sum(map(area, grown)) == pytest.approx(outline.area, rel=1e-6)


def test_only_sides_that_face_a_stone_move():
    """A lintel over an opening: its lower side stays there, and the opening its width."""
    drawn = [box(0.0, 0.0, 0.4, 0.2), box(1.0, 0.0, 0.4, 0.2), box(0.0, 0.21, 1.4, 0.2)]
    left, right, lintel = closed_joints(drawn)
    assert bounds(left) == pytest.approx([0.0, 0.0, 0.4, 0.205])
    assert bounds(right) == pytest.approx([1.0, 0.0, 1.4, 0.205])
    assert area(lintel) == pytest.approx(1.4 * 0.2 + 2 * 0.4 * 0.005)
    assert bounds(lintel) == pytest.approx([0.0, 0.205, 1.4, 0.41])
    assert area(whole([left, right, lintel])) == pytest.approx(
        0.4 * 0.2 * 2 + 1.4 * 0.2 + 0.8 * 0.01
    )


def test_dry_joints_and_slits_stay():
    """Stones that touch stay, and a slit between few of them is no mortar."""
    dry = [box(0.4 * i, 0.2 * k, 0.4, 0.2) for k in range(4) for i in range(3)]
    slit = [*dry, *(box(1.25, 0.2 * k, 0.4, 0.2) for k in range(4))]
    for drawn in (dry, slit):
        assert Mortar.of(drawn).usual == 0.0
        for before, after in zip(drawn, closed_joints(drawn), strict=True):
            assert area(after) == pytest.approx(area(before), rel=1e-12)


# ---- arches and rubble


def small_facade() -> Facade:
    return Facade(8, 30, windows=((1.04, 0.6, 1.2, 0.4),), voussoirs=17)


def written(stones, path, lines=()) -> None:
    document = ezdxf.new()
    document.header["$INSUNITS"] = 4
    space = document.modelspace()
    for rows, layer in stones:
        points = (np.asarray(rows) * [1e3, 1e3, 1.0]).tolist()
        space.add_lwpolyline(points, format="xyb", close=True, dxfattribs={"layer": layer})
    for start, end, layer in lines:
        space.add_line(start, end, dxfattribs={"layer": layer})
    document.saveas(path)


def test_rings_of_voussoirs_keep_their_arcs(tmp_path):
    wall = small_facade()
    written(wall.stones(), tmp_path / "a.dxf")
    drawn = read_dxf(tmp_path / "a.dxf").drawing
    read = read_dxf(tmp_path / "a.dxf", close=True)
    assert any("joints of 10 mm closed" in note for note in read.notes)
    grown = read.drawing
    assert list(grown.names) == list(drawn.names)
    check_stones(drawn.blocks, grown.blocks)
    voussoirs = np.concatenate(
        [b for b, name in zip(grown.blocks, grown.names, strict=True) if name == "voussoir"]
    )
    radius = np.hypot(*(voussoirs - [1.04, 1.2]).T)
    inner = radius[(radius < 0.5) & (voussoirs[:, 1] > 1.21)]
    assert inner == pytest.approx(np.full(len(inner), 0.4), abs=2e-4)
    assert len(inner) > 2 * wall.voussoirs
    opening = max(whole(grown.blocks).interiors, key=lambda ring: shapely.Polygon(ring).area)
    # The window is 0.8 m wide, from the course below to the crown.
    assert shapely.Polygon(opening).bounds == pytest.approx((0.64, 0.59, 1.44, 1.6), abs=1e-3)


def test_corners_of_the_outline_beside_closed_joints_are_no_gaps(tmp_path):
    """A lower stone stands beside the wall: its joint ends at the wall's corner."""
    stones = [*bond(0.25, 0.065, (0.01, 0.01))[:5], box(1.3, 0.0, 0.25, 0.065)]
    stones.append(box(0.0, 0.075, 1.29, 0.065))
    written([(np.pad(s, ((0, 0), (0, 1))), "brick") for s in stones], tmp_path / "a.dxf")
    order = MeshOrder(tmp_path / "a.dxf", close=True, scene=tmp_path / "a.toml")
    made = mesh_drawing(order)
    assert made.closing_gap == "" and made.mortar == ""
    assert not any("warning" in line for line in made.lines)


@pytest.mark.parametrize("seed", range(6))
def test_rubble_is_closed_without_overlaps(seed):
    drawn = rubble(seed)
    grown = closed_joints(drawn)
    check_stones(drawn, grown)
    assert sum(map(area, grown)) > 0.985 * 3.0 * 0.995
    assert sum(map(area, drawn)) < 0.92 * 3.0


@pytest.mark.parametrize("seed", range(12))
def test_bricks_drawn_by_hand_are_closed_without_overlaps(seed):
    """Corners off by 1 mm, some bricks missing, all turned and some drawn the other way round."""
    dice = np.random.default_rng(seed)
    drawn = [turned(b + dice.normal(0.0, 1e-3, b.shape), 40.0 * seed) for b in BONDS[seed % 3]]
    drawn = [b[:: dice.choice([-1, 1])] for b in drawn if dice.random() < 0.9]
    grown = closed_joints(drawn)
    check_stones(drawn, grown)
    left = Mortar.of(grown)
    assert left.length[left.open].sum() < 0.02 * left.length.sum()


@pytest.mark.slow
def test_the_whole_facade_is_closed(tmp_path):
    wall = Facade()
    written(wall.stones(), tmp_path / "a.dxf")
    grown = read_dxf(tmp_path / "a.dxf", close=True).drawing.blocks
    drawn = read_dxf(tmp_path / "a.dxf").drawing.blocks
    check_stones(drawn, grown)
    assert len(drawn) > 1400
    outline = whole(grown)
    assert outline.geom_type == "Polygon"
    assert outline.bounds == pytest.approx((0.0, 0.0, wall.width, wall.height), abs=1e-6)
    windows = [hole for hole in outline.interiors if shapely.Polygon(hole).area > 1.0]
    assert len(windows) == len(wall.windows)


# ---- drawings


def test_lines_on_sides_follow_them_and_lines_in_the_mortar_name_joints(tmp_path):
    bricks = [
        (np.pad(1.0 * outline, ((0, 0), (0, 1))), "brick")
        for outline in stack(3, 0.25, 0.065, 0.01)
    ]
    lines = [((0, 65), (250, 65), "first"), ((0, 145), (250, 145), "second")]
    lines.append(((0, 0), (250, 0), "base"))
    written(bricks, tmp_path / "a.dxf", lines)
    read = read_dxf(tmp_path / "a.dxf", close=True)
    assert dict(read.lengths) == pytest.approx({"base": 0.25, "first": 0.5, "second": 0.5})


def test_blocks_that_hang_in_the_air_are_warned_of():
    def warnings(outlines, gap: float) -> str:
        with Discretization(scene_of(outlines, 0.05, JointLaw(friction=0.8, gap=gap))) as made:
            return " ".join(made.warnings)

    assert "9 blocks hang in the air and fall by up to 0.09 m" in warnings(
        stack(10, 0.25, 0.065, 0.01), 0.012
    )
    assert "1 blocks hang" in warnings(stack(2, 0.25, 0.065, 0.015), 0.02)
    assert "hang" in warnings(bond(0.25, 0.065, (0.012, 0.012)), 0.013)
    assert "hang" not in warnings(stack(2, 0.25, 0.2, 0.001), 0.002)
    assert "hang" not in warnings(closed_joints(stack(10, 0.25, 0.065, 0.01)), 0.012)
