"""What the search in space finds, and tells, where masses, pieces or laws make that hard."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fenics_contact.errors import SolverError
from fenics_contact.scene.toml_tables import read_toml
from fenics_contact.spatial import Scene, builders, crushing, limit_load
from tests.quick import slow, some

GRAVITY = 9.81


def box(low, high):
    return {"box": [list(map(float, low)), list(map(float, high))]}


def scene(blocks, friction=0.6, live=None, law=None, **options):
    return Scene.from_tables(
        {
            "dimension": 3,
            "blocks": blocks,
            "materials": {"default": {"density": 2000.0}},
            "joints": {"default": {"friction": friction, **(law or {})}},
            "loads": {
                "dead": {"body": [0.0, 0.0, -GRAVITY]},
                "live": live or {"direction": [1.0, 0.0, 0.0]},
            },
            "solve": options,
        },
        Path(),
    )


def solved(*arguments, **options):
    return limit_load(scene(*arguments, **options)).collapse


def couple(block, width, level):
    """Forces of 1 kN at both ends of a block of some width, along +y and -y."""
    places = {"a": (0.0, 1.0), "b": (width, -1.0)}
    forces = {
        name: {"block": block, "at": [x, 0.5 * width, level], "force": [0.0, 1e3 * sign, 0.0]}
        for name, (x, sign) in places.items()
    }
    return {"force": forces}


@pytest.mark.parametrize(
    ("wide", "thin", "count"), [(10.0, 0.1, 2), (10.0, 0.05, 1), (30.0, 0.2, 3), (4.0, 0.02, 2)]
)
def test_small_blocks_on_a_large_one(wide, thin, count):
    """They rock about their edge at thickness / height: masses 1e4 to 1e8 apart."""
    blocks = {"raft": box((0, 0, 0), (wide, wide, 0.4 * wide))}
    for k in range(count):
        z = 0.4 * wide + 5 * thin * k
        blocks[f"p{k}"] = box((1, 1, z), (1 + thin, 1 + thin, z + 5 * thin))
    found = solved(blocks)
    assert found.status == "limit"
    assert found.load_factor == pytest.approx(1.0 / (5.0 * count), rel=1e-5)
    assert found.upper == pytest.approx(found.load_factor, rel=1e-5)


def tongues(count):
    """Courses .4 m wide whose tongues, .1 x .1 m, fit into grooves of the next one."""
    blocks = {}
    for k in range(count):
        z = 0.3 * k
        pieces = [box((0, 0, z), (1, 0.4, z + 0.2)), box((0, 0.15, z + 0.2), (1, 0.25, z + 0.3))]
        if k:
            sides = (0.0, 0.15), (0.25, 0.4)
            pieces += [box((0, low, z - 0.1), (1, high, z)) for low, high in sides]
        blocks[f"b{k}"] = {"pieces": pieces}
    return blocks


@pytest.mark.parametrize(("count", "friction"), [(2, 0.5), (3, 0.1), (3, 0.5), (3, 1.5)])
def test_upper_end_of_blocks_that_interlock(count, friction):
    """Grooves let nothing slide across them: the lowest course slides, or the whole turns over."""
    live = {"direction": [0.0, 1.0, 0.0]}
    found = solved(tongues(count), friction, live)
    area = [(0.2 * 0.4, 0.1), (0.1 * 0.1, 0.25), (0.1 * 0.3, -0.05)]  # and heights of centroids
    parts = [(a, 0.3 * k + z) for k in range(count) for a, z in area[: 3 if k else 2]]
    height = sum(a * z for a, z in parts) / sum(a for a, _ in parts)
    assert found.load_factor == pytest.approx(min(friction, 0.2 / height), rel=1e-5)
    assert found.upper == pytest.approx(found.load_factor, rel=1e-5)


def leaning(count):
    """Blocks side by side that lean by 5 degrees, in two courses."""
    lean = math.tan(math.radians(5.0))
    blocks = {}
    for course in range(2):
        for k in range(count):
            low, high = (k - 0.5 * course) * 0.5, (k + 1 - 0.5 * course) * 0.5
            corners = [
                [x + lean * z, y, z]
                for z in (0.4 * course, 0.4 * course + 0.4)
                for x, y in ((low, 0.0), (high, 0.0), (high, 0.4), (low, 0.4))
            ]
            blocks[f"b{course}{k}"] = {"vertices": corners}
    return blocks


@pytest.mark.parametrize("part", [1.0, *slow(0.3, 0.999)])
def test_dilatancy_ends_in_a_limit(part):
    """Where slip opens as much as friction is, nothing lies between state and upper end."""
    friction = 0.35
    angle = math.degrees(math.atan(part * friction)) - 1e-9
    live = {"direction": [-0.4, 0.4, -0.8]}
    found = solved(leaning(3), friction, live, {"dilatancy": angle})
    assert found.status == "limit"
    assert found.load_factor <= found.upper * (1.0 + 1e-6)
    if part == 1.0:
        assert found.load_factor == pytest.approx(found.upper, rel=1e-3)


@pytest.mark.parametrize(("count", "twisted"), [(2, 0), (2, 1), (3, 1), (4, 2)])
def test_twist_ends_near_its_elastic_state(count, twisted):
    """A square twists at .3826 F N a (continuum); sixteen points carry 2.2 % more."""
    blocks = {f"b{k}": box((0, 0, 0.5 * k), (1, 1, 0.5 * k + 0.5)) for k in range(count)}
    found = solved(blocks, 0.5, couple(f"b{twisted}", 1.0, 0.5 * twisted + 0.25))
    weight = 0.5 * 2000.0 * GRAVITY
    by_hand = 0.3826 * 0.5 * weight * (count - twisted) / 1e3
    assert by_hand * 0.999 < found.load_factor < 1.04 * by_hand


def test_motion_of_a_twist_is_that_of_its_corners():
    found = solved({"a": box((0, 0, 0), (1, 1, 0.3))}, 0.5, couple("a", 1.0, 0.15))
    assert np.abs(found.mode[0, :3]).max() < 1e-6
    assert abs(found.mode[0, 5]) * 0.5**0.5 == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("place", some([(0.3, 0.2), (0.3, 0.1), (0.4, 0.3)], 3))
def test_lowest_state_is_no_higher_than_that_of_corner_forces(place):
    """A beam in a slot that fits it: forces at corners are forces of the whole law, too."""
    depth, friction = place
    post = [
        box((0, 0, 0), (0.2, 1, 1.2)),
        box((0.2, 0, 0), (0.2 + depth, 1, 0.5)),
        box((0.2, 0, 0.7), (0.2 + depth, 1, 1.2)),
    ]
    blocks = {
        "post": {"pieces": post, "fixed": True},
        "beam": box((0.2, 0, 0.5), (2, 1, 0.7)),
    }
    corners = solved(blocks, friction, quick=True)
    lowest = solved(blocks, friction, states="lowest")
    assert corners.status == lowest.status == "limit"
    assert lowest.lowest.load_factor <= corners.load_factor * (1.0 + 1e-3)


@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_the_lowest_state_of_a_wall_is_told(friction):
    """Pushed out of its plane it has one state, at thickness / height."""
    live = {"direction": [0.0, 1.0, 0.0]}
    table = scene({"a": box((0, 0, 0), (1, 1, 1))}, friction, live, quick=True, states="lowest")
    blocks = builders.wall(length=1.2, height=0.8, thickness=0.2, brick=(0.4, 0.2))
    result = limit_load(replace(table, blocks=tuple(blocks)))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(0.25, rel=1e-3)
    told = result.summary(verbose=True)
    (line,) = [line for line in told.splitlines() if line.startswith("lower state:")]
    assert line.split(":")[1].strip().startswith("none")


def test_points_file_is_in_equilibrium(tmp_path):
    table = scene(tongues(3), 0.5, {"direction": [0.3, 1.0, 0.0]})
    limit_load(table).write(tmp_path)
    with np.load(tmp_path / "points.npz") as file:
        known = dict(file)
    force = np.einsum("pk,pki->pi", known["force"], known["axes"])
    assert known["area"].min() > 0.0
    left = known["dead"] + known["load_factor"] * known["live"]
    for sign, blocks in zip((-1.0, 1.0), known["blocks"].T, strict=True):
        arm = known["position"] - known["centroid"][blocks]
        np.add.at(left, blocks, sign * np.hstack([force, np.cross(arm, force)]))
    moving = [k for k, name in enumerate(known["names"]) if str(name).startswith("b")]
    assert len(moving) == 3
    assert np.abs(left[moving]).max() < 1e-6 * np.abs(known["dead"]).max()


def crushable(strength):
    blocks = builders.wall(length=1.2, height=0.8, thickness=0.2, brick=(0.4, 0.2))
    live = {"direction": [0.0, 1.0, 0.0]}
    table = scene({"a": box((0, 0, 0), (1, 1, 1))}, 2.0, live, {"compressive_strength": strength})
    return replace(table, blocks=tuple(blocks))


@pytest.mark.parametrize("strength", [1e5, *slow(1e6)])
def test_what_crushing_takes_away_is_told_without_a_mode_of_it(monkeypatch, strength):
    """lambda = (t - W / (f_c b)) / H carries; .25 is that without crushing."""
    whole = crushing.Crushing.limit

    def without_modes(self, model, given, friction, cost):
        if not np.any(cost):
            raise SolverError("no mode")
        return whole(self, model, given, friction, cost)

    monkeypatch.setattr(crushing.Crushing, "limit", without_modes)
    found = limit_load(crushable(strength)).collapse
    by_hand = (0.2 - 2000.0 * GRAVITY * 0.8 * 0.2 / strength) / 0.8
    assert found.load_factor == pytest.approx(by_hand, rel=1e-3)
    assert found.load_factor * (1.0 + found.gap) == pytest.approx(0.25, rel=1e-3)
    assert found.upper == pytest.approx(0.25, rel=1e-4)
    assert found.status == "not_converged" and "misses limit" in found.reason


def test_a_state_without_crushing_is_told_where_there_is_no_other(monkeypatch):
    def none(*arguments):
        raise SolverError("no state")

    monkeypatch.setattr(crushing.Crushing, "limit", none)
    result = limit_load(crushable(1e6))
    assert result.collapse.status == "not_converged"
    assert result.collapse.load_factor == pytest.approx(0.25, rel=1e-4)
    assert result.collapse.residuals["crushing"] > 1e-5
    assert "misses crushing" in result.summary()
    assert "at most 0.25" in result.summary()


def test_scene_file_above_a_megabyte(tmp_path):
    from mpi4py import MPI

    path = tmp_path / "large.toml"
    path.write_text("# " + 3_000_000 * "-" + "\ntitle = 'large'\n")
    assert read_toml(path, MPI.COMM_SELF) == {"title": "large"}
