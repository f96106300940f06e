"""The weight on a tilting table: angles by hand, what the console, result.json and report say."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from fenics_contact import Floor, InputError, JointLaw, Load, Scene, SolveOptions, Tie, limit_load
from fenics_contact.console import summary
from fenics_contact.meshing import polygons
from fenics_contact.output.files import result_record
from tests.drawing import rectangle
from tests.helpers import coulomb, on_ground

TILT = Load(tilt=True)
BOTH = SolveOptions(direction="both", fast=True)


def block(friction: float, **options: Any) -> Scene:
    """One of 0.5 m x 1 m."""
    lines = {"base": [((0.0, 0.0), (0.5, 0.0))], "top": [((0.0, 1.0), (0.5, 1.0))]}
    model = polygons([rectangle(0.0, 0.0, 0.5, 1.0)], 0.25, groups=lines)
    return on_ground(model, coulomb(friction), **{"live": TILT, "solve": BOTH, **options})


@pytest.mark.mpi
@pytest.mark.parametrize(("friction", "tangent"), [(0.3, 0.3), (2.0, 0.5)])
def test_block_slides_at_its_friction_and_topples_at_its_width_over_its_height(friction, tangent):
    result = limit_load(block(friction))
    angle = math.degrees(math.atan(tangent))
    record = result_record(result)
    assert result.load_factor == pytest.approx(tangent, rel=1e-6)
    assert result.tilt_angle == record["tilt_angle"]
    assert record["tilt_angle"] == pytest.approx(angle, rel=1e-6)
    assert record["tilt_angle_negative"] == pytest.approx(-angle, rel=1e-6)
    text = summary(result)
    ways = (f"a tilt of {angle:.2f} degrees, down to the {side}" for side in ("right", "left"))
    assert text.startswith(f"it collapses at {', '.join(ways)} (verified)")
    assert record["answer"]["found"][0] == text.splitlines()[0]


def test_all_floors_tilt():
    """Of two thirds of the weight on top: lambda (W 1/2 + Q 1) = (W + Q) 1/4."""
    weight = 2000.0 * 9.81 * 0.5
    floor = Floor(force=4.0 / 3.0 * weight, at="top")
    result = limit_load(block(2.0, floors={"roof": floor}))
    assert result.load_factor == pytest.approx(0.25 * (5 / 3) / (0.5 + 2 / 3), rel=1e-6)


def test_no_angle_for_other_loads():
    assert result_record(limit_load(block(0.3, live=Load((1.0, 0.0)))))["tilt_angle"] is None


def test_scene_read_again_is_the_same():
    scene = block(0.3)
    assert scene.live.body == pytest.approx((9.81, 0.0))
    assert replace(scene, title="again").live == scene.live
    tables = scene.tables() | {"mesh": {"file": "a.msh"}}
    tables.pop("plane")
    assert Scene.from_tables(tables, lambda *_: scene.mesh).live == scene.live


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"live": Load((1.0, 0.0), tilt=True)}, "takes the weight as the live load"),
        ({"dead": Load()}, "turns the weight; give loads.dead.body"),
        ({"dead": Load((0.0, -9.81), tilt=True)}, "loads.dead.tilt = true: give an angle"),
        ({"live": Load(tilt=True, traction={"top": (1.0, 0.0)})}, "loads.live.traction would not"),
        ({"foundations": {"base": JointLaw(friction=0.5, cohesion=1e3)}}, "base.cohesion would"),
        ({"ties": {"rod": Tie((0.2, 0.2), 1e3, ground=(-1.0, 0.0))}}, "ties.rod would not"),
    ],
)
def test_what_a_tilt_does_not_turn_is_refused(change, text):
    with pytest.raises(InputError, match=text):
        block(0.3, **change)
