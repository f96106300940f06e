"""What ties bring to meshed structures: hand values, other scenes, blocks without a mesh, ranks."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from mpi4py import MPI

from fenics_contact import BlockMesh, Load, Scene, Seismic, Soil, SolveOptions, Tie, limit_load
from fenics_contact.limit_load import Monitor
from fenics_contact.meshing import polygons
from fenics_contact.spatial import Scene as BlockScene
from fenics_contact.spatial import limit_load as limit_load_of_blocks
from tests.bank import GRAVITY
from tests.drawing import rectangle
from tests.helpers import STONE, coulomb, on_ground

#: Weight of a square metre, N per metre of thickness.
UNIT = STONE.density * GRAVITY
#: Two piers and a beam, m.
GATE = [rectangle(0.0, 0.0, 0.5, 2.0), rectangle(2.0, 0.0, 2.5, 2.0), rectangle(0.0, 2.0, 2.5, 2.5)]
ANCHOR = Tie((0.25, 2.25), 4e3, ground=(-2.0, 1.25), stiffness=1e7)
ALL = SolveOptions(range=False, error=False, peak=False)


def tied(blocks: Any, tie: Tie, friction: float, demand: float | None = None, **more: Any) -> Scene:
    """Blocks on the ground with a tie."""
    model = polygons(blocks, 0.5, groups=more.pop("groups", {"base": on_line(blocks)}))
    seismic = Seismic(demand=demand) if demand else None
    options = {"solve": ALL, "seismic": seismic, **more}
    return on_ground(model, coulomb(friction), ties={"a": tie}, **options)


def on_line(blocks: Any) -> Any:
    """Bottom edges on the ground."""
    return [(one[0], one[1]) for one in blocks if one[0][1] == 0.0]


@pytest.mark.parametrize("direction", ["positive", "negative"])
def test_a_gate_with_an_anchor(direction):
    """Without its tie it is the scene without; with the yield that is needed a0* is the demand."""
    scene = tied(GATE, ANCHOR, 0.7, 3.0, solve=replace(ALL, direction=direction))
    end = limit_load(scene).ends[direction]
    found = end.without_ties
    bare = limit_load(replace(scene, ties={})).ends[direction]
    assert found.status == "limit"
    assert found.load_factor == pytest.approx(bare.load_factor, rel=1e-3)
    if direction == "negative":
        assert found.needed == math.inf
        return
    assert abs(found.load_factor) < 0.95 * abs(end.load_factor)
    stronger = replace(ANCHOR, yield_=found.needed * ANCHOR.yield_)
    reached = limit_load(replace(scene, ties={"a": stronger})).ends[direction]
    assert 1.0 - 1e-3 <= reached.seismic.acceleration / 3.0 <= 1.012


def test_a_wall_with_several_states():
    """Without ties it is followed from rest, too: one solve leads to 1.2 in place of .714."""
    bricks = []
    for course in range(3):
        ends = [0.0, *(0.5 * k + 0.25 * (course % 2) for k in range(1 - course % 2, 3)), 1.5]
        lower, upper = 0.25 * course, 0.25 * (course + 1)
        bricks += [rectangle(a, lower, b, upper) for a, b in pairwise(ends)]
    base = {"base": [((0.0, 0.0), (1.5, 0.0))]}
    options = {"groups": base, "solve": replace(ALL, lowest=False)}
    scene = tied(bricks, Tie((0.1, 0.6), 1e3, ground=(-3.0, 0.1)), 1.2, **options)
    found = limit_load(scene).positive.without_ties
    bare = limit_load(replace(scene, ties={}, solve=SolveOptions(fast=True)))
    assert bare.load_factor == pytest.approx(1.0 / 1.4, rel=1e-6)
    assert found.load_factor == pytest.approx(bare.load_factor, rel=1e-3)


def test_a_gate_is_the_same_without_a_mesh(tmp_path):
    scene = tied(GATE, ANCHOR, 0.7, 3.0)
    tables = {
        "dimension": 2,
        "blocks": {f"b{k}": {"polygon": [list(at) for at in one]} for k, one in enumerate(GATE)},
        "materials": {"default": {"density": STONE.density}},
        "joints": {"default": {"friction": 0.7}},
        "loads": {"dead": {"body": [0.0, -GRAVITY]}, "live": {"body": [GRAVITY, 0.0]}},
        "ties": {"a": {"from": ANCHOR.from_, "ground": ANCHOR.ground, "yield": ANCHOR.yield_}},
        "seismic": {"demand": 3.0},
    }
    meshed = limit_load(scene).positive
    rigid = limit_load_of_blocks(BlockScene.from_tables(tables, tmp_path)).ends["positive"]
    assert meshed.load_factor == pytest.approx(rigid.load_factor, rel=1e-3)
    one, other = meshed.without_ties, rigid.without_ties
    assert one.load_factor == pytest.approx(other.load_factor, rel=1e-3)
    assert one.needed == pytest.approx(other.needed, rel=0.02)


def test_a_tie_that_lifts_a_stone_leads_to_a_lower_state(tmp_path):
    """F + (cos a - F sin a) Y / W: at 60 degrees the stone loses more friction than it gains."""
    steep = Tie((2.0, 0.5), 0.2 * 4.0 * UNIT, ground=(3.0, 0.5 + 3.0**0.5))
    towards = replace(ALL, direction="negative")
    scene = tied([rectangle(0.0, 0.0, 4.0, 1.0)], steep, 0.9, solve=towards)
    result = limit_load(scene)
    expected = -0.9 - 0.2 * (0.5 - 0.9 * 0.75**0.5)
    assert result.load_factor_negative == pytest.approx(expected, rel=1e-6)
    found = result.ends["negative"].without_ties
    assert found.load_factor == pytest.approx(-0.9, rel=1e-4)
    assert found.lowest == pytest.approx((expected, -0.9), rel=1e-3)
    assert "ties lead to a lower state than the one without" in result.summary()
    result.write(tmp_path)
    record = json.loads((tmp_path / "result.json").read_text())
    assert record["without_ties"]["negative"]["lowest"] == pytest.approx(found.lowest)


@pytest.mark.mpi
def test_soil_stays_and_ranks_agree():
    """It slides towards the anchor's other side: (F W + Y - P_a) / W, without the tie less Y."""

    def scene(comm: MPI.Comm) -> Scene:
        blocks = [rectangle(0.0, 0.0, 2.0, 1.0)]
        groups = {"base": on_line(blocks), "right": [((2.0, 0.0), (2.0, 1.0))]}
        model = polygons(blocks, 0.5, groups=groups)
        mesh = BlockMesh.from_model(model, comm)
        options = {"solve": replace(ALL, direction="negative"), "seismic": Seismic(demand=4.0)}
        loads = Load((0.0, -GRAVITY)), Load((GRAVITY, 0.0))
        laws = {"joints": {"default": coulomb(0.4)}, "foundations": {"base": coulomb(0.4)}}
        ties = {"a": Tie((0.5, 0.5), 2e3, ground=(3.0, 0.5))}
        soil = {"bank": Soil("right", 0.8, UNIT, 30.0)}
        parts = {"dead": loads[0], "live": loads[1], "ties": ties, "soil": soil, **laws, **options}
        return Scene(mesh, {"default": STONE}, **parts)

    weight, pressure = 2.0 * UNIT, 0.5 * UNIT * 0.8**2 / 3.0
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        end = limit_load(scene(comm)).ends["negative"]
        bare = -0.4 + pressure / weight
        assert end.load_factor == pytest.approx(bare - 2e3 / weight, rel=1e-6)
        assert end.without_ties.load_factor == pytest.approx(bare, rel=1e-3)
        needed = (1.35 * 4.0 / GRAVITY + bare) * weight / 2e3
        assert end.without_ties.needed == pytest.approx(needed, rel=0.02)


def test_a_stone_that_only_a_tie_holds():
    """Without it the upper stone tilts over the edge of the lower one."""
    blocks = [rectangle(0.0, 0.0, 1.0, 1.0), rectangle(0.4, 1.0, 2.4, 2.0)]
    tie = Tie((0.6, 1.5), 1e5, ground=(0.6, -1.0))
    result = limit_load(tied(blocks, tie, 0.5, 0.1))
    assert result.status == "limit"
    assert "from no equilibrium to " in result.summary()


def test_ties_are_left_out_where_that_is_asked():
    for options in (replace(ALL, ties=False), SolveOptions(fast=True)):
        assert limit_load(tied(GATE, ANCHOR, 0.7, solve=options)).positive.without_ties is None


def test_a_stopped_search_without_ties_is_told():
    class Bell(Monitor):
        rings = False

        def phase(self, text):
            self.rings = text == "the collapse without ties"

    bell = Bell()
    result = limit_load(tied(GATE, ANCHOR, 0.7, 3.0), bell, stop=lambda: "the bell" * bell.rings)
    assert result.status == "limit"
    assert "the bell" in result.stopped
    assert "no equilibrium" not in result.summary()
