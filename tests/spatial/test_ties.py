"""Ties of rigid blocks: anchor plates, ring beams, ends that snap to a stone, hand values."""

from __future__ import annotations

import pytest

from fenics_contact import InputError
from fenics_contact.limit_load import Monitor
from fenics_contact.spatial import Scene, limit_load
from fenics_contact.sweeps.sweep import sweep
from tests.system.program import toml

#: Friction, weight of a stone, N, and yield of the tie, N.
FRICTION, WEIGHT, YIELD = 0.3, 2000.0 * 10.0, 4e3
DEAD = {3: [0.0, 0.0, -10.0], 2: [0.0, -10.0]}
LIVE = {3: [10.0, 0.0, 0.0], 2: [10.0, 0.0]}


def box(dimension, x, z):
    """A stone of x[1] - x[0] by z[1] - z[0], m, a metre deep."""
    if dimension == 2:
        return {"polygon": [[x[0], z[0]], [x[1], z[0]], [x[1], z[1]], [x[0], z[1]]]}
    return {"box": [[x[0], 0.0, z[0]], [x[1], 1.0, z[1]]]}


def place(dimension, x, z):
    return [x, z] if dimension == 2 else [x, 0.5, z]


def scene_of(blocks, ties, folder, dimension=3, friction=FRICTION, **more):
    """Stones on the ground under their weight, pushed along x by it."""
    tables = {
        "dimension": dimension,
        "blocks": blocks,
        "materials": {"default": {"density": 2000.0}},
        "joints": {"default": {"friction": friction}},
        "loads": {"dead": {"body": DEAD[dimension]}, "live": {"body": LIVE[dimension]}},
        "ties": ties,
    }
    return Scene.from_tables(tables | more, folder)


def two_stones(dimension):
    """One on the other, each of a cubic metre."""
    return {"low": box(dimension, (0, 1), (0, 1)), "top": box(dimension, (0, 1), (1, 2))}


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(
    ("height", "upper"), [(1.0, 0.5), (0.9, 0.25), (0.8, 0.0), (1.2, 1.0), (1.15, 0.875)]
)
def test_stones_below_a_plate_share_its_force_by_area(tmp_path, dimension, height, upper):
    """F + s Y / W of the upper stone with the part s of the plate; F + Y / 2 W of both."""
    tie = {
        "from": place(dimension, 0.0, height),
        "ground": place(dimension, -3.0, height),
        "yield": YIELD,
        "plate": 0.4,
    }
    scene = scene_of(two_stones(dimension), {"a": tie}, tmp_path, dimension)
    result = limit_load(scene)
    expected = FRICTION + min(upper, 0.5) * YIELD / WEIGHT
    assert result.load_factor == pytest.approx(expected, rel=1e-6)
    bars = result.structure.bars
    assert sum(bar.tie.yield_ for bar in bars) == pytest.approx(YIELD)
    levels = [bar.tie.yield_ * bar.ends[0, 2] for bar in bars]
    assert sum(levels) == pytest.approx(YIELD * height)  # the resultant is the tie's


def test_plates_at_both_ends_share_by_what_stones_have_in_common(tmp_path):
    """Piers of stones with joints at unlike heights: bars along the tie, areas of overlaps."""
    blocks = {f"left{k}": box(3, (0, 1), (z, z + 1)) for k, z in enumerate((0.0, 1.0))}
    blocks["right"] = box(3, (3, 4), (0.0, 1.1))
    blocks["over"] = box(3, (3, 4), (1.1, 2.0))
    ties = {"a": {"from": [0, 0.5, 1.0], "to": [4, 0.5, 1.0], "yield": YIELD, "plate": 0.4}}
    bars = scene_of(blocks, ties, tmp_path).structure().bars
    parts = {bar.blocks: bar.tie.yield_ / YIELD for bar in bars}
    assert parts == pytest.approx({(0, 2): 0.5, (1, 2): 0.25, (1, 3): 0.25})
    assert all(bar.ends[1] - bar.ends[0] == pytest.approx([4, 0, 0]) for bar in bars)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_line_holds_every_stone_on_it(tmp_path, dimension):
    """Of three stones in a row the last one is pushed off: F + Y / W, and F alone without."""
    blocks = {f"s{k}": box(dimension, (k, k + 1), (0, 1)) for k in range(3)}
    ends = {"from": place(dimension, 0.2, 0.5), "to": place(dimension, 2.9, 0.5)}
    push = {"force": {"end": {"block": "s2", "force": LIVE[dimension]}}}
    loads = {"dead": {"body": DEAD[dimension]}, "live": push}
    ring = {"ring": {**ends, "yield": YIELD, "line": []}}
    scene = scene_of(blocks, ring, tmp_path, dimension, loads=loads)
    bars = scene.structure().bars
    assert [bar.blocks for bar in bars] == [(0, 1), (1, 2)]
    assert bars[0].ends[:, 0] == pytest.approx([0.6, 1.5])
    found = limit_load(scene).load_factor * 10.0 / WEIGHT
    assert found == pytest.approx(FRICTION + YIELD / WEIGHT, rel=1e-6)
    bare = limit_load(scene_of(blocks, {}, tmp_path, dimension, loads=loads))
    assert bare.load_factor * 10.0 / WEIGHT == pytest.approx(FRICTION, rel=1e-6)


def test_a_ring_goes_round_corners_and_closes(tmp_path):
    places = {"a": (0, 0), "b": (1, 0), "c": (1, 1), "d": (0, 1)}
    blocks = {n: {"box": [[x, y, 0], [x + 1, y + 1, 1]]} for n, (x, y) in places.items()}
    corners = [[1.5, 0.5, 0.9], [1.5, 1.5, 0.9], [0.5, 1.5, 0.9]]
    start = [0.5, 0.5, 0.9]
    tie = {"from": start, "to": start, "yield": 1.0, "stiffness": 1e6, "line": corners}
    bars = scene_of(blocks, {"ring": tie}, tmp_path).structure().bars
    assert [bar.blocks for bar in bars] == [(0, 1), (1, 2), (2, 3), (3, 0)]


def test_an_end_goes_to_the_nearest_stone_of_its_group(tmp_path):
    """In no stone, and on a joint."""
    tie = {"from": [-0.2, 0.5, 1.0], "ground": [-3, 0.5, 1.0], "yield": YIELD, "group": "top"}
    result = limit_load(scene_of(two_stones(3), {"a": tie}, tmp_path))
    assert result.structure.bars[0].blocks == (1, -1)
    assert result.load_factor == pytest.approx(FRICTION + 0.5 * YIELD / WEIGHT, rel=1e-6)


def test_all_wrong_ends_are_told_at_once(tmp_path):
    end = {"ground": [-3, 0.5, 1.0], "yield": YIELD}
    ties = {
        "joint": {"from": [0.5, 0.5, 1.0], **end},
        "air": {"from": [9, 9, 9], "to": [8, 8, 8], "yield": YIELD},
        "far": {"from": [-1.5, 0.5, 0.5], "group": "low", **end},
        "nobody": {"from": [0, 0.5, 0.5], "group": "roof", **end},
        "plate": {"from": [-1, 0.5, 0.5], "plate": 0.4, **end},
        "short": {"from": [0.1, 0.5, 0.5], "to": [0.9, 0.5, 0.5], "line": [], "yield": 1.0},
        "bed": {"from": [0, 0.5, 1.0], "to": [1, 0.5, 1.0], "line": [], "yield": 1.0},
    }
    with pytest.raises(InputError) as error:
        scene_of(two_stones(3), ties, tmp_path).structure()
    for text in (
        "ties.joint.from: there are 2 blocks at (0.5, 0.5, 1), 'low', 'top'",
        "ties.air.from: there is no block at (9, 9, 9)",
        "ties.far.from: the nearest stone of 'low', low, is 1.5 m away",
        "ties.nobody.group: there is no group 'roof'; it has 'default'",
        "ties.plate.from: the plate lies on no block",
        "ties.short: its line meets fewer than two blocks",
        "ties.bed: its line runs along the joint of 'low' and 'top'",
    ):
        assert text in str(error.value)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_sweep_over_a_tie(tmp_path, dimension):
    """The yield and the plate of a tie vary as all keys do."""
    tie = {
        "from": place(dimension, 0.0, 0.9),
        "ground": place(dimension, -3.0, 0.9),
        "yield": YIELD,
        "plate": 0.4,
    }
    file = tmp_path / "scene.toml"
    tables = {
        "dimension": dimension,
        "blocks": two_stones(dimension),
        "materials": {"default": {"density": 2000.0}},
        "joints": {"default": {"friction": FRICTION}},
        "loads": {"dead": {"body": DEAD[dimension]}, "live": {"body": LIVE[dimension]}},
        "ties": {"a": tie},
    }
    file.write_text(toml(tables))
    found = sweep(file, {"ties.a.yield": [2e3, 4e3], "ties.a.plate": [0.4, 0.6]})
    parts = [(1, 0.25), (1, 1.0 / 3.0), (2, 0.25), (2, 1.0 / 3.0)]
    expected = [FRICTION + times * 2e3 * part / WEIGHT for times, part in parts]
    assert found.column("load_factor") == pytest.approx(expected, rel=1e-6)


def anchored(dimension, tie=None, folder=None, **more):
    """A flat stone that slides, held by a level anchor of 10 kN or another tie."""
    level = {"from": place(dimension, 0, 0.5), "ground": place(dimension, -3, 0.5), "yield": 1e4}
    blocks = {"stone": box(dimension, (0, 4), (0, 1))}
    return scene_of(blocks, {"a": level | (tie or {})}, folder, dimension, **more)


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_a_tie_brings_and_what_the_demand_needs(tmp_path, dimension):
    """From F to F + Y / W; a0* = lambda g / FC of one part, so that Y = (FC a / g - F) W."""
    weight = 4.0 * WEIGHT
    for demand in (3.0, 20.0, 2.0):
        needed = max((1.35 * demand / 10.0 - FRICTION) * weight / 1e4, 0.0)
        result = limit_load(anchored(dimension, folder=tmp_path, seismic={"demand": demand}))
        found = result.ends["positive"].without_ties
        assert found.status == "limit"
        assert found.load_factor == pytest.approx(FRICTION, rel=1e-6)
        assert needed <= found.needed * (1.0 + 1e-6) <= 1.011 * needed + 1e-9
        assert found.lowest == ()
    told = result.summary().splitlines()
    assert any(line.startswith("ties of 10000 N") and "from 0.306 to" in line for line in told), (
        told
    )
    assert "needed for the demand: no ties" in told


def test_a_tie_that_lifts_a_stone_leads_to_a_lower_state(tmp_path):
    """F + (cos a - F sin a) Y / W: at 60 degrees the stone loses more friction than it gains."""
    steep = {"from": [2.0, 1.0], "ground": [1.0, 1.0 + 3.0**0.5], "yield": 1.6e4}
    result = limit_load(anchored(2, steep, tmp_path, friction=0.9))
    expected = 0.9 + 0.2 * (0.5 - 0.9 * 0.75**0.5)
    assert result.load_factor == pytest.approx(expected, rel=1e-6)
    found = result.ends["positive"].without_ties
    assert found.lowest == pytest.approx((expected, 0.9), rel=1e-4)
    assert "ties lead to a lower state than the one without" in result.summary()


def test_what_no_tie_can_bring(tmp_path):
    """The stone beside the tied one slides off alone, whatever the tie carries."""
    free = {"free": box(2, (9, 10), (0, 1)), "stone": box(2, (0, 4), (0, 1))}
    tie = {"from": [0.0, 0.5], "ground": [-3.0, 0.5], "yield": 1e4}
    scene = scene_of(free, {"a": tie}, tmp_path, 2, seismic={"demand": 3.0})
    result = limit_load(scene)
    assert result.ends["positive"].without_ties.needed == float("inf")
    assert "needed for the demand: not reached by stronger ties" in result.summary()


def test_a_stone_that_only_a_tie_holds(tmp_path):
    """Without it the upper stone tilts over the edge of the lower one."""
    blocks = {"low": box(2, (0, 1), (0, 1)), "top": box(2, (0.4, 2.4), (1, 2))}
    tie = {"from": [0.6, 1.5], "ground": [0.6, -1.0], "yield": 1e5}
    scene = scene_of(blocks, {"a": tie}, tmp_path, 2, seismic={"demand": 0.1})
    result = limit_load(scene)
    found = result.ends["positive"].without_ties
    assert found.status == "unstable"
    assert "from no equilibrium to " in result.summary()


def test_ties_are_left_out_where_that_is_asked(tmp_path):
    for options in ({"ties": False}, {"fast": True}):
        scene = anchored(2, folder=tmp_path, solve=options)
        assert limit_load(scene).ends["positive"].without_ties is None


@pytest.mark.parametrize("asks", [0, 40])
def test_a_stopped_search_without_ties_is_told(tmp_path, asks):
    """Nothing is told of a structure whose search was stopped: neither that it falls, nor less."""

    class Bell(Monitor):
        left = None

        def phase(self, text):
            if text == "the collapse without ties":
                self.left = asks

        def stop(self):
            if self.left is None:
                return ""
            self.left -= 1
            return "the bell rang" * (self.left < 0)

    bell = Bell()
    scene = anchored(2, folder=tmp_path, seismic={"demand": 3.0})
    result = limit_load(scene, bell, stop=bell.stop)
    assert result.status == "limit"
    told = result.summary()
    assert "no equilibrium" not in told
    rang = bell.left < 0
    assert result.stopped.endswith("the bell rang") is rang
    known = result.ends["positive"].answers.get("without_ties")
    if rang and known is not None:
        assert "needed for the demand: not known: stopped by the bell rang" in told
