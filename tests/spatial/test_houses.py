"""Houses and bridges: gables, inner walls, roofs that thrust, viaducts; hand values."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fenics_contact import InputError
from fenics_contact.scene.units import Units
from fenics_contact.scene.words import floor_text, tie_text
from fenics_contact.spatial import Scene, builders, limit_load
from fenics_contact.spatial.check import description
from fenics_contact.spatial.contacts import checked_contacts

BASE = {
    "materials": {"default": {"density": 2000.0}},
    "joints": {"default": {"friction": 5.0}},
    "solve": {"fast": True},
}
DEAD = {3: {"body": [0.0, 0.0, -9.81]}, 2: {"body": [0.0, -9.81]}}
LOADS = {d: {"dead": DEAD[d], "live": {"direction": [1.0, 0.0, 0.0][:d]}} for d in DEAD}


def factor_of(folder, push, **tables):
    """Load factor under the weight acting along a direction."""
    loads = {"dead": DEAD[len(push)], "live": {"direction": push}}
    given = {"dimension": len(push), "loads": loads, **tables}
    return limit_load(Scene.from_tables({**BASE, **given}, folder)).load_factor


def test_a_wall_with_a_gable_turns_about_its_foot(tmp_path):
    """t / 2 over the height of the centroid, of the wall and its triangle."""
    sizes = {"length": 4.0, "height": 0.5, "thickness": 0.3, "brick": [1.0, 0.5]}
    blocks = {"builder": "wall", "gable": 2.0, **sizes}
    centroid = (2.0 * 0.25 + 4.0 * (0.5 + 2.0 / 3.0)) / 6.0
    found = factor_of(tmp_path, [0.0, 1.0, 0.0], blocks=blocks)
    assert found == pytest.approx(0.15 / centroid, rel=1e-5)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_roof_that_thrusts(tmp_path, dimension):
    """lambda W h / 2 + T h = (W + F) t / 2: walls 2 m and a metre long."""
    if dimension == 3:
        stone = {"box": [[0.0, 0.0, 0.0], [2.0, 0.5, 3.0]]}
        roof = {"z": 3.0, "thrust": [0.0, 400.0]}
        push, length = [0.0, 1.0, 0.0], 2.0
    else:
        stone = {"polygon": [[0.0, 0.0], [0.5, 0.0], [0.5, 3.0], [0.0, 3.0]]}
        roof, push, length = {"y": 3.0, "thrust": 400.0}, [1.0, 0.0], 1.0
    weight = 2000.0 * 9.81 * length * 0.5 * 3.0
    lies, thrust = 2000.0 * 0.5 * length, 400.0 * length
    expected = ((weight + lies) * 0.25 - thrust * 3.0) / (1.5 * weight)
    tables = {"blocks": {"wall": stone}, "floors": {"roof": {"force": 2000.0, **roof}}}
    assert factor_of(tmp_path, push, **tables) == pytest.approx(expected, rel=1e-6)


def test_inner_walls_are_toothed_with_outer_ones():
    """In every second course the inner wall runs through; there it touches both stones beside."""
    blocks = builders.house(
        length=4.8, width=3.2, height=0.8, thickness=0.2, inner=[2.0], brick=(0.4, 0.2)
    )
    ends = [b for b in blocks if b.name.startswith("inner_1") and b.extent[0][1] < 0.1]
    assert [round(float(b.extent[0][2]), 3) for b in ends] == [0.2, 0.6]
    contacts, warnings = checked_contacts(blocks)
    assert warnings == ()
    number = blocks.index(ends[0])
    beside = [c for c in contacts if number in (c.first, c.second) and abs(c.axes[0, 0]) > 0.9]
    assert len(beside) == 2


@pytest.mark.slow
def test_a_viaduct_is_the_planar_bridge_with_a_width(tmp_path):
    """Two spans pushed along the bridge: one load factor in the plane and in space."""
    sizes: dict[str, Any] = {"span": 4.0, "rise": 1.0, "ring": 0.4, "voussoirs": 9, "spans": 2}
    sizes |= {"abutments": False}
    rough = {"default": {"friction": 0.6}}
    plane = factor_of(tmp_path, [1.0, 0.0], blocks={"builder": "bridge", **sizes}, joints=rough)
    viaduct = {"builder": "viaduct", "width": 2.0, "strips": 2, **sizes}
    space = factor_of(tmp_path, [1.0, 0.0, 0.0], blocks=viaduct, joints=rough)
    assert space == pytest.approx(plane, rel=1e-3)


def test_parts_of_a_viaduct(tmp_path):
    """Fill between spandrel walls, sizes, and an axle whose force is told in kN."""
    sizes = {"span": 4.0, "rise": 1.0, "ring": 0.4, "width": 2.0, "voussoirs": 9}
    blocks = {
        "builder": "viaduct",
        "spandrel": 0.5,
        "abutments": False,
        **sizes,
        "pier": [1.5, 3.0],
    }
    on_road = {"axle": {"x": 1.0, "y": 1.2, "force": [0.0, 0.0, -1e5]}}
    loads = {"dead": DEAD[3], "live": {"force": on_road}}
    rough = {"default": {"friction": 0.6}}
    tables = {"dimension": 3, "blocks": blocks, "loads": loads, "output": {"units": "m"}}
    scene = Scene.from_tables({**BASE, **tables, "joints": rough}, tmp_path)
    groups = {block.group for block in scene.blocks}
    assert groups == {"voussoirs", "skewbacks", "piers", "spandrels", "fill"}
    volume = {g: sum(b.volume for b in scene.blocks if b.group == g) for g in groups}
    assert volume["fill"] == pytest.approx(volume["spandrels"])
    low, high = np.array([b.extent for b in scene.blocks]).transpose(1, 0, 2)
    assert low.min(axis=0) == pytest.approx([-1.5, 0.0, -3.0])
    road = 1.684621  # of an odd number of voussoirs: none has a joint at the crown
    assert high.max(axis=0) == pytest.approx([5.5, 2.0, road])
    (axle,) = scene.structure().acting["loads.live.force.axle"].place
    assert axle == pytest.approx([1.0, 1.2, road])
    result = limit_load(scene)
    assert result.status == "limit"
    assert "kN" in result.summary().splitlines()[0]


def test_abutments_of_a_viaduct_do_not_move(tmp_path):
    """What carries the springings before x = 0 and behind the last arch is ground, one block each.

    Intrados of radius 2.5 about z = -1.5: the ring of 0.4 ends at z = 2.9 x 0.6 - 1.5.
    """
    sizes = {"span": 4.0, "rise": 1.0, "ring": 0.4, "width": 2.0, "voussoirs": 9, "spans": 2}
    loads = {"dead": DEAD[3], "live": {"force": {"axle": {"x": 1.0, "force": [0.0, 0.0, -1.0]}}}}
    given = {"dimension": 3, "blocks": {"builder": "viaduct", **sizes}, "loads": loads}
    scene = Scene.from_tables({**BASE, **given}, tmp_path)
    fixed = {block.name: block.extent for block in scene.blocks if block.fixed}
    assert set(fixed) == {"ground", "abutment_left", "abutment_right"}
    low, high = fixed["abutment_left"]
    assert [*low, *high] == pytest.approx([-1.5, 0.0, -2.0, 0.0, 2.0, 0.24])
    assert fixed["abutment_right"][0][0] == pytest.approx(2.0 * 4.0 + 1.5)
    assert {b.name.split("_")[0] for b in scene.blocks if b.group == "piers"} == {"pier"}
    (warning,) = [text for text in scene.structure().warnings if "crush" in text]
    assert "materials.default.compressive_strength" in warning
    strong = {"default": {"density": 2000.0, "compressive_strength": 5e6}}
    scene = Scene.from_tables({**BASE, **given, "materials": strong}, tmp_path)
    assert not any("crush" in text for text in scene.structure().warnings)


def test_a_planar_bridge_has_the_sizes_and_abutments_of_a_viaduct(tmp_path):
    """Its sizes are plain keys; what is fixed in the plane is what is fixed in space."""
    sizes: dict[str, Any] = {"span": 4.0, "rise": 1.0, "ring": 0.4, "voussoirs": 9, "spans": 2}
    sizes |= {"pier": [0.8, 3.0], "cover": 0.4}
    fixed = []
    for dimension, own in ((2, {"builder": "bridge"}), (3, {"builder": "viaduct", "width": 1.0})):
        tables = {
            "dimension": dimension,
            "blocks": sizes | own,
            "loads": LOADS[dimension],
        }
        scene = Scene.from_tables({**BASE, **tables}, tmp_path)
        assert not any("corner" in text for text in scene.structure().warnings)
        ends = {b.name: np.array(b.extent)[:, [0, 2]].ravel() for b in scene.blocks if b.fixed}
        fixed.append({name: np.round(extent, 9).tolist() for name, extent in ends.items()})
        top = max(b.extent[1][2] for b in scene.blocks)
        assert top == pytest.approx(2.9 * np.cos(np.arcsin(0.8) / 9.0) - 1.5 + 0.4)
    assert set(fixed[0]) == {"ground", "abutment_left", "abutment_right"}
    assert fixed[0] == fixed[1]
    parapets = {
        "builder": "bridge",
        "rings": 2,
        "parapet": 0.5,
        "abutments": False,
        **sizes,
        "pier": [1.5, 3.0],
    }
    tables = {"dimension": 2, "blocks": parapets, "loads": LOADS[2]}
    free = Scene.from_tables({**BASE, **tables}, tmp_path)
    assert not any(b.fixed for b in free.blocks)
    assert sum(b.group == "voussoirs" for b in free.blocks) == 2 * 2 * 9
    ends = {"fixed": ["skewbacks_1", "skewbacks_3", "piers_[1-4]", "piers_9", "piers_1[0-2]"]}
    tables["blocks"] = parapets | ends
    some = Scene.from_tables({**BASE, **tables}, tmp_path).structure().warnings
    assert not any("corner" in text for text in some)  # the fixed ones hold each other's corners
    (ground,) = [text for text in some if text.startswith("no ground")]
    assert "below 1 block ('piers_5') at the lowest level" in ground
    assert "[foundations.NAME]" in ground
    under = tables | {"foundations": {"base": {"friction": 0.6, "y": -3.0}}}
    held = Scene.from_tables({**BASE, **under}, tmp_path).structure().warnings
    assert not any("ground" in text for text in held)
    for wrong, message in ((1, "blocks.abutments"), ([1.0], "blocks.abutments")):
        tables["blocks"] = parapets | {"abutments": wrong}
        with pytest.raises(InputError, match=message):
            Scene.from_tables({**BASE, **tables}, tmp_path)


def test_an_axle_on_the_highest_side(tmp_path):
    """A stone on two others: the force is on it where it is, on those below beside it."""
    stones = {"left": (0, 2), "right": (2, 4)}
    blocks = {n: {"polygon": [[a, 0], [b, 0], [b, 1], [a, 1]]} for n, (a, b) in stones.items()}
    blocks["top"] = {"polygon": [[1, 1], [3, 1], [3, 2], [1, 2]]}

    def acting(**force):
        loads = {"dead": DEAD[2], "live": {"force": {"axle": {"force": [0.0, -1.0], **force}}}}
        scene = Scene.from_tables({**BASE, "blocks": blocks, "loads": loads}, tmp_path)
        one = scene.structure().acting["loads.live.force.axle"]
        return scene.blocks[one.block[0]].name, one.place[0, 2]

    assert [acting(x=x) for x in (0.5, 2.0, 3.5)] == [("left", 1.0), ("top", 2.0), ("right", 1.0)]
    with pytest.raises(
        InputError, match=r"force.axle: there is no block above or below \(5, 0\), .* x = 0 to 4"
    ):
        acting(x=5.0)
    with pytest.raises(InputError, match=r"force\.axle\.y: the highest side"):
        acting(x=0.5, y=1.0)
    with pytest.raises(
        InputError, match=r"axle: there is no block .* its width; they reach from x = 0 to 4"
    ):
        acting(x=0.25, width=1.0)


@pytest.mark.parametrize("place", [2.8, 3.5])
def test_a_train_tips_a_slab_over_the_edge_of_its_pier(tmp_path, place):
    """W b = lambda P sum p_i a_i about the edge; the first axle at 3.5 m is beside the slab."""
    blocks = {
        "pier": {"polygon": [[1, 0], [2, 0], [2, 2], [1, 2]], "fixed": True},
        "slab": {"polygon": [[0, 2], [3, 2], [3, 2.5], [0, 2.5]]},
    }
    train = {"x": place, "force": [0.0, -1e3], "axles": [[0.0, 1.0], [1.0, 0.5]]}
    loads = {"dead": {"body": [0.0, -9.81]}, "live": {"force": {"train": train}}}
    scene = Scene.from_tables(
        {
            "blocks": blocks,
            "materials": {"default": {"density": 2000.0}},
            "joints": {"default": {"friction": 0.6}},
            "loads": loads,
        },
        tmp_path,
    )
    arm = sum(
        part * (place - behind - 2.0) for behind, part in train["axles"] if place - behind < 3.0
    )
    weight = 2000.0 * 9.81 * 3.0 * 0.5
    assert limit_load(scene).load_factor == pytest.approx(0.5 * weight / (1e3 * arm), rel=1e-6)


def test_thrust_and_ranges_of_a_roof_are_told():
    roof = {"force": 3e3, "z": 3.0, "y": [0.0, 0.5], "thrust": [0.0, 1e3]}
    told = floor_text(roof, Units("m", 1.0))
    assert "y from 0 m to 0.5 m" in told
    assert told.endswith("thrust 0 kN/m and 1 kN/m")
    tie = {"yield": 3e4, "plate": 0.3}
    assert "plates of 0.3 m" in tie_text(tie, Units("m", 1.0))


def house_with(folder, **tables):
    """A house of 6 m by 4 m, walls of 0.5 m, with an inner wall from x = 3 m."""
    sizes = {"length": 6.0, "width": 4.0, "height": 3.0, "thickness": 0.5, "brick": [1.0, 0.75]}
    blocks = {"builder": "house", "inner": [3.0], **sizes}
    loads = {"dead": DEAD[3], "live": {"direction": [0.0, -1.0, 0.0]}}
    given = {"dimension": 3, "blocks": blocks, "loads": loads, **tables}
    return Scene.from_tables({**BASE, **given}, folder)


def shares(scene, x=(-9.0, 9.0), y=(-9.0, 9.0)):
    """Weight of the floor on what is within x and y, N."""
    on = scene.structure().acting["floors.first"]
    within = (on.place[:, :2] > [x[0], y[0]]) & (on.place[:, :2] < [x[1], y[1]])
    return -on.force[within.all(axis=1), 2].sum()


@pytest.mark.parametrize("height", [1.5, 3.0])
def test_a_floor_of_a_room_lies_on_two_walls(tmp_path, height):
    """w span / 2 on each; what the live load pushes is the floor's mass, too."""
    room = {"z": height, "force": 2000.0, "mass": True, "x": [0.0, 3.5], "y": [0.5, 3.5]}
    scene = house_with(tmp_path, floors={"first": {**room, "span": "x"}})
    half = 2000.0 * 3.0 * 3.5 / 2.0
    assert shares(scene, x=(0.0, 0.5)) == pytest.approx(half, rel=1e-12)
    assert shares(scene, x=(3.0, 3.5)) == pytest.approx(half, rel=1e-12)
    bare = house_with(tmp_path).structure()
    structure = scene.structure()
    assert structure.dead.sum(axis=0)[2] - bare.dead.sum(axis=0)[2] == pytest.approx(-2.0 * half)
    assert structure.live.sum(axis=0)[1] - bare.live.sum(axis=0)[1] == pytest.approx(-2.0 * half)
    told = description(scene, structure)
    assert "2000 N/m2 at z = 1.5 m, x from 0 m to 3.5 m" in told or height == 3.0
    assert "from wall to wall along x, with its mass" in told
    assert "21000 N on" not in told
    assert "10500 N on west" in told
    assert "10500 N on inner_1" in told


def test_a_floor_over_all_rooms_goes_to_the_nearest_walls(tmp_path):
    """Along x from middle to middle of the rooms; strips over walls along x lie on these."""
    scene = house_with(tmp_path, floors={"first": {"z": 3.0, "force": 1000.0, "span": "x"}})
    room = (0.5, 3.5)
    walls = [shares(scene, x, room) for x in ((0.0, 0.5), (3.0, 3.5), (5.5, 6.0))]
    assert walls == pytest.approx([3000.0 * 1.75, 3000.0 * 2.75, 3000.0 * 1.5])
    assert shares(scene, y=(0.0, 0.5)) == pytest.approx(3000.0)
    assert shares(scene) == pytest.approx(24000.0)


def test_a_floor_at_windows_keeps_its_halves(tmp_path):
    """Where a window takes the wall, what is beside it carries the floor, by halves."""
    scene = house_with(
        tmp_path,
        blocks={
            "builder": "house",
            "length": 6.0,
            "width": 4.0,
            "height": 3.0,
            "thickness": 0.5,
            "brick": [1.0, 0.75],
            "openings": {"south": [[2.0, 3.5, 0.75, 2.25]]},
        },
        floors={"first": {"z": 1.5, "force": 1000.0, "x": [0.5, 5.5], "span": "y"}},
    )
    assert shares(scene, y=(0.0, 0.5)) == pytest.approx(10000.0)
    assert shares(scene, y=(3.5, 4.0)) == pytest.approx(10000.0)
    assert shares(scene, x=(2.0, 3.5), y=(0.0, 0.5)) == 0.0


@pytest.mark.parametrize(
    ("floor", "message"),
    [
        ({"z": 3.0, "x": [0.5, 3.0], "y": [0.5, 3.5], "span": "x"}, r"no top side .* x = 0 to 6"),
        (
            {"z": 3.0, "x": [0.5, 3.2], "span": "x"},
            r"span: no wall .* x = 0.5 and 3.2; give x from",
        ),
        ({"z": 3.0, "span": "z"}, "floors.first.span = z must be x or y"),
        (
            {"z": 2.0},
            r"no block has a top side at z = 2; the nearest are at \[0.75, 1.5, 2.25, 3.0\]",
        ),
    ],
)
def test_floors_that_lie_on_no_wall(tmp_path, floor, message):
    with pytest.raises(InputError, match=message):
        house_with(tmp_path, floors={"first": {"force": 1.0, **floor}}).structure()


def test_a_wheel_is_spread_over_what_it_covers(tmp_path):
    """Blocks have the force by the width that they cover; the moment is that of the point."""
    boxes = {"low": (0, 2), "middle": (2, 2.5), "high": (2.5, 4)}
    blocks = {n: {"box": [[a, 0, 0], [b, 3, 1]]} for n, (a, b) in boxes.items()}

    def acting(**force):
        wheel = {"force": [0.0, 0.0, -1000.0], "x": 2.2, "y": 1.0, **force}
        loads = {"dead": DEAD[3], "live": {"force": {"wheel": wheel}}}
        tables = {"dimension": 3, "blocks": blocks, "loads": loads}
        scene = Scene.from_tables({**BASE, **tables}, tmp_path)
        return scene, scene.structure().acting["loads.live.force.wheel"]

    scene, on = acting(width=[1.0, 0.4])
    names = [scene.blocks[k].name for k in on.block]
    assert names == ["low", "middle", "high"]
    assert -on.force[:, 2] == pytest.approx([300.0, 500.0, 200.0])
    assert np.cross(on.place, on.force).sum(axis=0) == pytest.approx([-1000.0, 2200.0, 0.0])
    told = description(scene, scene.structure())
    assert "extent (0, 0, 0) m to (4, 3, 1) m" in told
    assert "on block low, middle, high at (1.7, 0.8, 1) m to (2.7, 1.2, 1) m" in told
    with pytest.raises(InputError, match=r"or a part of its width; .* y = 0 to 3"):
        acting(y=0.1, width=[1.0, 0.4])
    train = [[0.0, 1.0], [2.2, 1.0]]
    assert acting(width=[1.0, 0.4], axles=train)[1].force.sum() == pytest.approx(-1500.0)
    with pytest.raises(InputError, match=r"wheel.width = 1.0 must be two numbers"):
        acting(width=1.0)
    with pytest.raises(InputError, match=r"wheel.width = -1.0 must be"):
        acting(width=[-1.0, 1.0])
    with pytest.raises(InputError, match=r"no block at \(9, 0, 0\); they reach from x = 0 to 4"):
        acting(x=None, y=None, at=[9.0, 0.0, 0.0])


def test_a_spread_force_in_the_plane(tmp_path):
    """A force of width 2 a on a slab, its edge at the pier's: W b = lambda P a / 2 beyond it."""
    blocks = {
        "pier": {"polygon": [[0, 0], [2, 0], [2, 2], [0, 2]], "fixed": True},
        "slab": {"polygon": [[0, 2], [3, 2], [3, 3], [0, 3]]},
    }
    force = {"wheel": {"x": 2.5, "width": 1.0, "force": [0.0, -1000.0]}}
    loads = {"dead": DEAD[2], "live": {"force": force}}
    scene = Scene.from_tables({**BASE, "blocks": blocks, "loads": loads}, tmp_path)
    weight = 2000.0 * 9.81 * 3.0
    assert limit_load(scene).load_factor == pytest.approx(weight * 0.5 / 500.0, rel=1e-6)
