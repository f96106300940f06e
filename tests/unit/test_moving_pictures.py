"""Pictures to a scale, on axes side by side, animated, and moved by a slider."""

from __future__ import annotations

import html
import json
import re
import sys
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from matplotlib import animation
from matplotlib.figure import Figure
from mpi4py import MPI
from PIL import Image

from fenics_contact import InputError, OutputError, SolverError, equilibrium, limit_load
from tests.bank import BANK, block_recipe
from tests.helpers import notebook_picture

WALL = BANK["W3 coulomb 0.65"]
BLOCK = block_recipe(0.4, 1.0, 0.3)


@pytest.fixture(scope="module")
def collapse():
    return limit_load(BLOCK.scene(2, fast=True))


def moved(axes) -> np.ndarray:
    """Corners of the blocks where they are drawn, all of them below one another."""
    return np.concatenate([path.vertices for path in axes.collections[1].get_paths()])


def at_rest(axes) -> np.ndarray:
    return np.concatenate([path.vertices for path in axes.collections[0].get_paths()])


def test_scale_is_a_factor_on_the_displacements(collapse):
    once, twice, rest = (collapse.plot(Figure().subplots(), scale) for scale in (1.0, 2.0, 0.0))
    motion = moved(once) - at_rest(once)
    assert np.linalg.norm(motion, axis=1).max() == pytest.approx(0.08, rel=1e-9)  # 8 % of 1 m
    np.testing.assert_allclose(moved(twice) - at_rest(twice), 2.0 * motion, atol=1e-12)
    np.testing.assert_allclose(moved(rest), at_rest(rest), atol=1e-12)


@pytest.mark.mpi
def test_a_state_says_how_much_its_displacements_are_magnified():
    found = equilibrium(BLOCK.scene(2), 0.2)
    axes = found.plot(Figure().subplots(), scale=2.0)
    largest = MPI.COMM_WORLD.allreduce(
        np.linalg.norm(found.displacement.x.array.reshape(-1, 2), axis=1).max(), MPI.MAX
    )
    forces = found.plot_forces(Figure().subplots())
    if MPI.COMM_WORLD.rank > 0:
        assert axes is None and forces is None
        return
    title = axes.get_title()
    assert title.startswith("displacements x ")
    assert float(title.split()[2]) == pytest.approx(2.0 * 0.08 / largest, rel=5e-3)
    assert forces.get_title() == "joint forces at load factor 0.2"


@pytest.mark.parametrize("scale", [-1.0, float("nan"), 1e9])
def test_scale_that_cannot_be_meant(scale, collapse):
    with pytest.raises(InputError, match="scale = "):
        collapse.plot(scale=scale)


@pytest.mark.parametrize("shape", [(1, 2), (2, 1)])
def test_legend_stays_out_of_the_neighbours_axes(shape):
    result = limit_load(WALL.scene(elements=1, fast=True))
    figure = Figure(figsize=(9.0, 4.0) if shape[0] == 1 else (5.0, 7.0))
    first, second = figure.subplots(*shape).ravel()
    result.plot(first)
    result.plot(second)
    figure.canvas.draw()
    boxes = [axes.get_legend().get_window_extent() for axes in (first, second)]
    assert not boxes[0].overlaps(boxes[1])
    for box, other in zip(boxes, (second, first), strict=True):
        assert not box.overlaps(other.get_tightbbox())
        assert box.x0 >= 0.0 and box.x1 <= figure.bbox.width and box.y0 >= 0.0


@pytest.mark.mpi
def test_thrust_and_stresses_of_any_state_are_drawn(collapse):
    axes = collapse.plot_thrust(Figure().subplots())
    stress = collapse.plot_stress(Figure().subplots())
    state = equilibrium(BLOCK.scene(2), 0.2)
    others = [state.plot_thrust(Figure().subplots()), state.plot_stress(Figure().subplots())]
    if MPI.COMM_WORLD.rank > 0:
        assert [axes, stress, *others] == 4 * [None]
        return
    assert axes.get_title() == "line of thrust at collapse (width: force)"
    assert stress.get_title() == "principal stresses at collapse"
    titles = [one.get_title() for one in others]
    assert titles[1] == "principal stresses at load factor 0.2"
    assert titles[0].startswith("line of thrust at load factor 0.2")


def test_blocks_that_fall_are_drawn():
    scene = BANK["sliding stack -0.001"].scene(1)
    for result in (limit_load(scene), equilibrium(scene, 0.0)):
        axes = result.plot(Figure().subplots())
        assert [text.get_text() for text in axes.texts] == ["0", "1"]
        with pytest.raises(SolverError, match="no joint forces to draw"):
            result.plot_forces()
        with pytest.raises(SolverError, match="no joint forces to draw"):
            result.plot_thrust()
        with pytest.raises(SolverError, match="no stresses to draw: the blocks fall"):
            result.plot_stress()
        assert notebook_picture(result).startswith(b"\x89PNG")


@pytest.mark.mpi
def test_animation_begins_at_rest_and_ends_at_the_collapse(tmp_path):
    path = MPI.COMM_WORLD.bcast(tmp_path) / "collapse.gif"
    limit_load(BLOCK.scene(2, fast=True)).animate(path, seconds=0.5)
    with Image.open(path) as film:
        assert film.n_frames > 2
        first = np.asarray(film.convert("L"), dtype=float)
        film.seek(film.n_frames - 1)
        assert np.abs(np.asarray(film.convert("L"), dtype=float) - first).max() > 50.0
    assert [one.name for one in path.parent.iterdir()] == ["collapse.gif"]


def test_animations_that_cannot_be_made(collapse, tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"path = 'a\.avi' must end with \.gif or \.mp4"):
        collapse.animate("a.avi")
    with pytest.raises(InputError, match="seconds = 0"):
        collapse.animate("a.gif", seconds=0)
    with pytest.raises(OutputError, match=r"cannot write '.*a\.gif': No such file"):
        collapse.animate(tmp_path / "nowhere" / "a.gif")
    monkeypatch.setattr(animation.writers, "is_available", lambda name: False)
    with pytest.raises(InputError, match=r"needs ffmpeg, which is not installed; write a \.gif"):
        collapse.animate("a.mp4")


@pytest.mark.skipif(not animation.writers.is_available("ffmpeg"), reason="needs ffmpeg")
def test_mp4(collapse, tmp_path):
    collapse.animate(tmp_path / "collapse.mp4", seconds=0.5)
    assert b"ftyp" in (tmp_path / "collapse.mp4").read_bytes()[:16]


def test_slider_needs_no_kernel(collapse):
    frame = collapse.slider()._repr_html_()
    page = html.unescape(frame)
    data = json.loads(re.search(r'application/json">(.*?)</script>', page).group(1))
    assert len(data["blocks"]) == len(collapse.blocks["area"])
    assert 'type="range"' in page and "<script>" in page
    assert "src=" not in page and "http" not in page


def test_the_first_plot_of_a_notebook_is_shown(collapse, monkeypatch):
    """matplotlib 3.6 alone shows the second."""
    shell = Mock()
    of_notebooks = SimpleNamespace(get_ipython=lambda: shell, version_info=(8, 24))
    monkeypatch.setattr(
        "matplotlib.get_backend", lambda: "module://matplotlib_inline.backend_inline"
    )
    monkeypatch.delitem(sys.modules, "matplotlib_inline.backend_inline", raising=False)
    monkeypatch.setitem(sys.modules, "IPython", of_notebooks)
    collapse.plot_forces()
    shell.run_line_magic.assert_called_once_with("matplotlib", "inline")


@pytest.mark.parametrize("draw", ["plot", "plot_forces", "plot_thrust"])
def test_a_notebook_that_matplotlib_does_not_fit_is_told_the_cure(draw, collapse, monkeypatch):
    """As matplotlib-inline 0.2 does with matplotlib 3.6."""

    def subplots(**_):
        raise AttributeError("'RcParams' object has no attribute '_get'")

    monkeypatch.setattr("matplotlib.pyplot.subplots", subplots)
    with pytest.raises(InputError, match=r"'_get'.*pip install 'matplotlib-inline<0.2'"):
        getattr(collapse, draw)()
