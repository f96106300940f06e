"""Names and titles of the user in pictures, and pictures that cannot be drawn."""

from __future__ import annotations

from typing import Any

import pytest
from matplotlib.cbook import is_math_text
from matplotlib.figure import Figure
from mpi4py import MPI

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, limit_load
from fenics_contact.meshing import polygons
from fenics_contact.output import figures as output_figures
from fenics_contact.output.plotting import draw_scene
from fenics_contact.output.view import view_of
from fenics_contact.scene.scene import EdgeForce
from fenics_contact.sweeps.points import Parameter, Point, grid
from fenics_contact.sweeps.sweep import draw_sweep
from tests.drawing import rectangle
from tests.helpers import notebook_picture
from tests.quick import some
from tests.system.program import files, result, run_here, write_scene

#: Names that matplotlib would take for formulas, or leave out of a legend.
NAMES = ["a$$b", "x$#$y", r"$\frac{1}{0}$", r"\$5 $^$", "_hidden", "100 % & {", "$_$"]
STONE = Material(1e9, 0.2, 1000.0)


def named(name: str) -> Scene:
    """Three blocks, with a name for all that has one, that slide on the ground at .3."""
    blocks = [rectangle(0.0, 0.5 * k, 1.0, 0.5 * (k + 1)) for k in range(3)]
    groups = {"base": [((0.0, 0.0), (1.0, 0.0))], f"{name} bed": [((0.0, 0.5), (1.0, 0.5))]}
    groups |= {f"{name} side": [((0.0, 0.0), (0.0, 0.5))]}
    model = polygons(blocks, 0.5, ["default", name, name], groups)
    live = Load(
        (10.0, 0.0),
        traction={f"{name} side": (1.0, 0.0)},
        force={f"{name} force": EdgeForce((0.0, -1.0), 0.5)},
    )
    return Scene(
        BlockMesh.from_model(model, MPI.COMM_WORLD),
        {"default": STONE, name: STONE},
        dead=Load((0.0, -10.0)),
        live=live,
        joints={"default": JointLaw(friction=0.5), f"{name} bed": JointLaw(friction=0.4)},
        foundations={"base": JointLaw(friction=0.3)},
        title=f"{name} {name}",
    )


def seen(axes: Any) -> list[str]:
    """All that is written on axes and beside them, as it is drawn."""
    axes.figure.canvas.draw()
    written = [text.get_text() for text in [*axes.texts, *axes.get_legend().get_texts()]]
    written += [axes.get_xlabel(), axes.get_title()]
    assert not any(map(is_math_text, written))
    return [text.replace(r"\$", "$").strip() for text in written]


@pytest.mark.parametrize("name", some(NAMES, 2))
def test_names_are_drawn_as_they_are(name):
    found = limit_load(named(name))
    axes = draw_scene(Figure().subplots(), view_of(found.layout))
    assert {name, f"joints {name} bed", f"{name} side", f"{name} force"} <= set(seen(axes))
    assert name in seen(found.plot(Figure().subplots()))
    assert notebook_picture(found)


@pytest.mark.parametrize("name", NAMES)
def test_a_sweep_is_drawn_with_its_names(name):
    keys = f'materials."{name}".density', "title"
    parameters = [Parameter.of(keys[0], [1.0, 2.0, 3.0]), Parameter.of(keys[1], [name, "b"])]
    points = [Point(values, "limit", 1.0, 1.0, 1.0) for values in grid(parameters)]
    written = seen(draw_sweep(parameters, points))
    assert f'density of materials."{name}"' in written and f"title = {name}" in written
    parameters = [Parameter.of("title", [name, "b", "c"])]
    points = [Point(values, "limit", 1.0 + k) for k, values in enumerate(grid(parameters))]
    axes = draw_sweep(parameters, points)
    assert f"lowest: 1 at {name}" in seen(axes)
    assert axes.get_xticklabels()[0].get_text().replace(r"\$", "$").strip() == name


@pytest.mark.parametrize("layer", ["a$$b", "x$#$y", "_$^$"])
def test_a_drawing_is_drawn_with_its_layers(layer, folder, capsys):
    document = pytest.importorskip("ezdxf").new("R2010", units=6)
    for x, name in ((0.0, layer), (1.0, "plain")):
        corners = rectangle(x, 0.0, x + 1.0, 0.5)
        document.modelspace().add_lwpolyline(corners, close=True, dxfattribs={"layer": name})
    document.saveas("wall.dxf")
    found = run_here(["mesh", "wall.dxf", "--picture", "wall.png"], capsys)
    assert (found.code, found.err) == (0, "") and {"wall.msh", "wall.png"} <= files(folder)


def broken(*_: Any, **__: Any) -> Any:
    """A part of a picture with a fault of its own."""
    raise ValueError("no\nroom")


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("changes", "mesh", "part", "lost", "code"),
    [
        pytest.param({}, "block", "draw_forces", ["forces"], 0, marks=pytest.mark.slow),
        ({"solve.direction": "both"}, "block", "draw_mode", ["collapse", "collapse_negative"], 0),
        ({}, "overhang", "draw_marked", ["collapse"], 3),
        ({"loads.live.body": [0.0, -9.81]}, "block", "draw_marked", ["collapse"], 0),
    ],
)
def test_a_picture_that_cannot_be_drawn_loses_no_result(
    changes, mesh, part, lost, code, folder, capsys, monkeypatch
):
    if MPI.COMM_WORLD.rank == 0:
        write_scene(folder, {"output.pictures": "all"} | changes, mesh)
    MPI.COMM_WORLD.barrier()
    monkeypatch.setattr(output_figures, part, broken)
    found = run_here(["solve", "scene.toml"], capsys)
    assert (found.code, found.err) == (code, "")
    record = result(folder / "scene")
    for name in lost:
        text = f"{name} could not be drawn (ValueError: no room)"
        assert text in record["skipped"] and f"{name}.png" not in record["files"]
        assert f"warning: {text}" in found.out or MPI.COMM_WORLD.rank > 0
    assert "scene.png" in record["files"] and set(record["files"]) < files(folder / "scene")


def test_stands_and_sweeps_lose_no_result(folder, capsys, monkeypatch):
    write_scene(folder)
    monkeypatch.setattr(output_figures, "draw_stress", broken)
    found = run_here(["stands", "scene.toml", "-o", "state"], capsys)
    assert found.code == 0 and "warning: stress could not be drawn" in found.out
    record = result(folder / "state")
    assert record["status"] == "equilibrium" and "ValueError: no room" in record["warnings"][-1]
    assert "state.png" in record["files"] and "stress.png" not in record["files"]
    monkeypatch.setattr("fenics_contact.sweeps.sweep.draw_sweep", broken)
    monkeypatch.setattr("fenics_contact.sweeps.sweep.save", broken)
    vary = ["--vary", "loads.live.body=[5,0]:[10,0]:2"]
    found = run_here(["sweep", "scene.toml", *vary], capsys)
    assert found.code == 0 and found.out.count("could not be drawn") == 2
    assert "lowest load factor 0.2943" in found.out
    assert files(folder / "scene_sweep") == {"sweep.csv", "sweep.json"}
