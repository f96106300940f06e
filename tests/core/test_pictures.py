"""Geometry of pictures: lines of thrust, scales, loads, stresses on a raster, titles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from fenics_contact import JointLaw, Load, limit_load
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.meshing import arch, polygons, running_bond, wall
from fenics_contact.output.fields import stress_raster
from fenics_contact.output.plotting import (
    draw_forces,
    draw_mode,
    draw_scene,
    draw_thrust,
    force_text,
    nice,
    whole_thrust,
)
from fenics_contact.output.view import View, view_of
from fenics_contact.results.bounds import LimitBounds
from fenics_contact.scene.scene import EdgeForce
from fenics_contact.scene.units import rounded_alike
from tests.helpers import PUSH, WEIGHT, on_ground, rectangle

ROUGH = JointLaw(friction=0.8)
STONE_WEIGHT = 2000.0 * 9.81


def solved(scene) -> tuple[View, object]:
    """What pictures show of the collapse of a scene, and its result."""
    result = limit_load(scene)
    assert result.status == "limit"
    return view_of(result.layout, result.collapse.mode, result.collapse.joints), result


def tower(count: int, width: float = 0.5, height: float = 0.5):
    """Square blocks one on the other."""
    levels = height * np.arange(count + 1)
    blocks = [rectangle(0.0, low, width, low + height) for low in levels[:-1]]
    return polygons(blocks, 0.25)


@pytest.mark.mpi
def test_thrust_of_a_tower_passes_where_statics_says():
    count = 4
    view, result = solved(on_ground(tower(count), ROUGH))
    lines, factor = whole_thrust(view), result.load_factor
    assert factor == pytest.approx(1.0 / count, rel=1e-5)
    # Above the joint at height y, blocks of height h = 2 - y: their middle is at y + h / 2.
    level = np.sort(lines.centre[:, 1])
    np.testing.assert_allclose(level, 0.5 * np.arange(count), atol=1e-9)
    place = lines.centre[np.argsort(lines.centre[:, 1]), 0]
    np.testing.assert_allclose(place, 0.25 + factor * 0.5 * (2.0 - level), atol=1e-5)


def test_thrust_under_an_eccentric_load():
    place, force = 0.4, 30.0e3
    push = Load(force={"column": EdgeForce((0.0, -force), place)})
    scene = on_ground(tower(2), ROUGH, dead=Load(WEIGHT.body, force=push.force))
    view, result = solved(scene)
    lines, weight = whole_thrust(view), STONE_WEIGHT * 0.25
    upper = lines.centre[lines.centre[:, 1] > 0.25]
    lever = result.load_factor * weight * 0.25  # the push of the upper block about the joint
    exact = (weight * 0.25 + force * place + lever) / (weight + force)
    assert upper[0, 0] == pytest.approx(exact, abs=1e-5)


SMOOTH_BASE = {"base": JointLaw(friction=0.2)}


def test_a_wall_has_one_line_and_its_sections_are_courses():
    bond = [[1, 1, 1], [0.5, 1, 1, 0.5]] * 2
    push = Load(traction={"left": (1e3, 0.0)})  # no part of the wall stays behind
    scene = on_ground(wall(bond, (0.4, 0.2)), ROUGH, live=push, foundations=SMOOTH_BASE)
    lines = whole_thrust(solved(scene)[0])
    assert len(lines.centre) == len(lines.segments) == 4
    np.testing.assert_allclose(np.ptp(lines.ends[:, :, 0], axis=1), 3 * 0.4, atol=1e-9)


def test_columns_that_move_apart_have_a_line_each_down_to_the_ground():
    pull = Load(traction={"left": (-1e3, 0.0)})
    view, result = solved(on_ground(wall([[1, 1], [1, 1]], (0.5, 0.5)), ROUGH, live=pull))
    assert result.load_factor == pytest.approx(0.5 * STONE_WEIGHT * 0.25 / (1e3 * 0.5), rel=1e-5)
    lines = whole_thrust(view)
    np.testing.assert_allclose(np.ptp(lines.ends[:, :, 0], axis=1), [0.5] * 4, atol=1e-9)
    ground = lines.centre[np.abs(lines.centre[:, 1]) < 1e-9, 0]
    # The left column turns about its toe; the right one stands.
    np.testing.assert_allclose(np.sort(ground), [0.0, 0.75], atol=1e-4)


def test_a_line_does_not_branch():
    rows = [[1, -1, 1], [1, -1, 1], [3], [3]]
    view, _ = solved(on_ground(wall(rows, (0.4, 0.4)), ROUGH, foundations=SMOOTH_BASE))
    heights = whole_thrust(view).segments[:, :, 1]
    # Two pieces in each pier; the lintel carries two piers, and the course above, alone, has none.
    np.testing.assert_allclose(np.sort(heights.max(axis=1)), [0.4, 0.4, 0.8, 0.8], atol=1e-9)


def test_a_facade_has_no_lines_of_thrust():
    rows = [[3, 4], [4, 3], *[[1, -1, 1, -1, 1, -1, 1]] * 2, [7]]
    facade, _ = solved(on_ground(wall(rows, (0.4, 0.4)), JointLaw(friction=0.6)))
    assert len(whole_thrust(facade).segments) == 0
    title = draw_thrust(Figure().subplots(), facade).get_title()
    assert title == "few lines of thrust reach the ground: forces branch"


@pytest.mark.mpi
def test_motions_of_blocks_are_those_of_the_mode():
    _, result = solved(on_ground(tower(2), ROUGH))
    view = view_of(result.layout, result.collapse.mode).blocks
    corners = np.round(view.bodies.corner[view.bodies.block == 1][:, ::2], 9) + 0.0
    assert sorted(corners.tolist()) == [[0.0, 0.5], [0.0, 1.0], [0.5, 0.5], [0.5, 1.0]]
    for (x, _, y), (ux, _, uy, _, turn, _) in zip(view.bodies.centroid, view.motion, strict=True):
        # Both turn about the toe at (0.5, 0), to the right.
        np.testing.assert_allclose([ux, uy], [turn * y, -turn * (x - 0.5)], atol=1e-5)
    assert turn > 0.0


def test_line_of_thrust_of_an_arch_lies_in_the_ring():
    scene = on_ground(arch(9, 0.2), ROUGH, foundations={"springings": ROUGH})
    view, _ = solved(scene)
    lines = whole_thrust(view)
    assert len(lines.centre) == 10 and len(lines.segments) == 9
    radius = np.linalg.norm(lines.centre, axis=1)
    assert 0.9 - 1e-6 <= radius.min() and radius.max() <= 1.1 + 1e-6
    assert radius.min() == pytest.approx(0.9, abs=1e-4)  # hinges
    assert radius.max() == pytest.approx(1.1, abs=1e-4)


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("quadrilaterals", [False, True])
def test_raster_carries_the_weight(degree, quadrilaterals):
    model = polygons([rectangle(0.0, 0.0, 1.0, 0.5)], 0.25, quadrilaterals=quadrilaterals)
    result = limit_load(on_ground(model, JointLaw(friction=0.3), degree=degree))
    raster = stress_raster(result.layout, result.collapse.state.elastic)
    assert raster.area.sum() == pytest.approx(0.5, rel=1e-9)
    inside = raster.area > 0.0
    assert inside.mean() > 0.98
    mean = raster.stress[inside].T @ raster.area[inside] / raster.area.sum()
    # The stress at the centre of a cell is its mean, but for quadrilaterals of degree 2.
    assert mean[1] == pytest.approx(-0.5 * STONE_WEIGHT * 0.5, rel=1e-4)
    coarse = raster.coarser(7)
    assert coarse.area.sum() == pytest.approx(0.5, rel=1e-9)
    full = coarse.area > 0.0
    again = coarse.stress[full].T @ coarse.area[full] / coarse.area.sum()
    np.testing.assert_allclose(again, mean, rtol=1e-9)


@pytest.mark.mpi
def test_loads_are_shown_where_they_act_with_the_names_of_their_groups():
    force = EdgeForce((0.0, -2.0e3), 0.25)
    live = Load(PUSH.body, traction={"left": (1e3, 0.0)}, force={"wheel": force})
    scene = on_ground(wall([[1, 1]], (0.5, 0.5)), ROUGH, live=live)
    with Discretization(scene) as discretization:
        view = view_of(discretization)
        given, turned = view.live, view_of(discretization, sign=-1.0).live
    assert given.tractions.place[:, 0] == pytest.approx(0.0, abs=1e-9)
    assert np.all(given.tractions.pushes) and not np.any(turned.tractions.pushes)
    np.testing.assert_allclose(given.tractions.vector, [[1e3, 0.0]] * 4, atol=1e-9)
    np.testing.assert_allclose(given.forces.place, [[0.25, 0.5]], atol=1e-9)
    np.testing.assert_allclose(turned.forces.vector, [[0.0, 2e3]], atol=1e-9)
    np.testing.assert_allclose(given.body.vector, [[0.5 * STONE_WEIGHT, 0.0]], rtol=1e-9)
    np.testing.assert_allclose(given.body.place, [[0.5, 0.25]], atol=1e-9)
    axes = draw_scene(Figure().subplots(), view)
    entries = [text.get_text() for text in axes.get_legend().get_texts()]
    assert entries == ["foundation base", "dead load", "live load"]
    assert {"left", "wheel"} <= {text.get_text() for text in axes.texts}


def test_titles_have_one_number_of_decimals():
    assert rounded_alike([0.150465309, 0.150465309]) == ["0.15047", "0.15047"]
    assert rounded_alike([31.07346, 33.4]) == ["31.073", "33.400"]
    assert rounded_alike([0.5, 0.0, math.inf]) == ["0.50000", "0", "inf"]
    assert rounded_alike([1.23456e-7, 2e-7]) == ["1.2346e-07", "2.0000e-07"]
    bounds = LimitBounds(None, 0.150465309)
    assert bounds.told(lambda value: rounded_alike([0.15047, value])[1]) == "at most 0.15047"


def test_forces_and_lengths_are_drawn_to_a_round_scale():
    assert [nice(value) for value in (1.0, 1.49, 7.9, 123.0)] == [1.0, 1.0, 6.0, 100.0]
    assert [force_text(force) for force in (5e4, 2.5e6, 3.0)] == ["50 kN/m", "2.5 MN/m", "3 N/m"]
    assert force_text(3e4, "N") == "30 kN"  # of the whole thickness
    view, _ = solved(on_ground(running_bond(4, 4), ROUGH))
    for draw in (draw_mode, draw_thrust):
        axes = draw(Figure().subplots(), view)
        (label,) = (text for text in axes.texts if text.get_text().endswith(" m"))
        bar = next(line for line in axes.lines if line.get_marker() == "|")
        length = float(label.get_text().removesuffix(" m"))
        assert np.ptp(bar.get_xdata()) == pytest.approx(length)
        assert 0.08 * view.size <= length <= 0.2 * view.size
        assert axes.get_ylim()[0] < bar.get_ydata()[0] < view.rest[..., 1].min()


@pytest.mark.mpi
def test_materials_and_states_are_in_the_legend_where_they_are():
    model = polygons(
        [rectangle(0.0, 0.0, 1.0, 0.5), rectangle(0.0, 0.5, 1.0, 1.0)], 0.5, ["stone", "brick"]
    )
    scene = on_ground(model, JointLaw(friction=0.8), foundations={"base": JointLaw(friction=0.3)})
    stone = scene.materials["default"]
    scene = replace(scene, materials={"stone": stone, "brick": stone})
    view, _ = solved(scene)
    assert view.material.tolist() == [0, 1]
    axes = draw_mode(Figure().subplots(), view)
    texts = [text.get_text() for text in axes.get_legend().get_texts()]
    assert texts == ["closed", "slides", "live load", "stone", "brick"]
    for draw in (draw_forces, draw_thrust):
        axes = Figure().subplots()
        assert draw(axes, view) is axes
