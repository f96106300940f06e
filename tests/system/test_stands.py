"""`fenics-contact stands`: whether a structure stands, without a live load or at a load factor."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

from fenics_contact import Scene, equilibrium
from tests.system.program import LEFT_OUT, QUIET, result, run, run_here, write_scene

ALONE = {"loads.live": LEFT_OUT}
STEEP = {"foundations.base.friction": 0.3, "joints": {}}

#: Changes of the scene, mesh, exit code, first line.
SCENES = {
    "stands": (ALONE, "block", 0, "it stands under its dead load (verified)"),
    "leans on a slope": (ALONE | STEEP, "gentle", 0, "it stands under its dead load (verified)"),
    "hangs over": (ALONE, "overhang", 3, "it does not stand under its dead load: block"),
    "slides down": (ALONE | STEEP, "steep", 3, "it does not stand under its dead load: block"),
}


@pytest.mark.parametrize("name", SCENES)
def test_a_structure_stands_or_not_without_a_live_load(name, folder, capsys):
    changes, mesh, code, answer = SCENES[name]
    write_scene(folder, QUIET | changes, mesh)
    found = run_here(["stands", "scene.toml"], capsys)
    assert (found.code, found.err) == (code, "")
    assert found.out.startswith(answer) and found.out.endswith("written to scene_state\n")
    found = run_here(["stands", "scene.toml", "-v"], capsys)
    record = result(folder / "scene_state")
    assert record["status"] == ("unstable" if code else "equilibrium")
    assert bool(record["falling_blocks"]) == bool(code)
    assert (
        ("by the forces of joint faces" in found.out) == (record["engine"] == "faces") == (not code)
    )


def test_at_a_load_factor_the_live_load_acts(folder, capsys):
    write_scene(folder, QUIET, "block")
    for factor, code, answer in ((0.29, 0, "it stands"), (0.31, 3, "it does not stand")):
        found = run_here(["stands", "scene.toml", "--load-factor", str(factor)], capsys)
        assert (found.code, found.err) == (code, "")
        assert found.out.startswith(f"{answer} at {factor} g to the right")
        assert result(folder / "scene_state")["load_factor"] == factor


@pytest.mark.parametrize(
    ("changes", "arguments", "words"),
    [
        (ALONE, ["solve"], "ask `fenics-contact stands`"),
        (ALONE, ["stands", "--load-factor", "1"], "loads.live is missing"),
        (ALONE | {"loads.dead": LEFT_OUT}, ["stands"], "loads.dead is missing"),
        ({"loads": LEFT_OUT}, ["stands"], "loads is missing"),
        (ALONE | {"loads.dead": 3}, ["stands"], "must be a table"),
        (QUIET, ["stands", "--load-factor", "nan"], "load_factor = nan must be finite"),
    ],
)
def test_2_without_what_the_question_needs(changes, arguments, words, folder, capsys):
    write_scene(folder, changes, "block")
    command, *options = arguments
    found = run_here([command, "scene.toml", *options], capsys)
    assert (found.code, found.out.replace("reading scene.toml\n", "")) == (2, "")
    assert words in found.err and found.err.count("\n") == 1
    assert not (folder / "scene_state").exists()


def test_warnings_are_of_what_acts(folder, capsys):
    earth = {"loads.dead.earth": {"left": {"level": 0.5, "unit_weight": 18.0}}}
    write_scene(folder, QUIET | ALONE | earth, "block")
    found = run_here(["stands", "scene.toml"], capsys)
    told = [line for line in found.out.splitlines() if line.startswith("warning: ")]
    assert len(told) == 1 and "loads.dead.earth.left" in told[0]


def test_warnings_are_told_by_what_comes_next(folder, capsys):
    """Those of a structure that stands are told by `solve`, and of one that does not here."""
    heavy = {"materials.default.young": 5.0}
    for changes, told in ((heavy, 0), (heavy | ALONE, 1), (heavy | STEEP, 1)):
        write_scene(folder, QUIET | changes, "steep" if changes.keys() & STEEP.keys() else "block")
        found = run_here(["stands", "scene.toml"], capsys)
        assert found.out.count("very soft") == told
        assert ("next: " in found.out) == (not told)
        assert any("very soft" in text for text in result(folder / "scene_state")["warnings"])


def test_a_support_that_moves_needs_no_live_load(folder, capsys):
    moved = {"loads.dead.movement": {"base": {"displacement": [0.0, -0.001]}}}
    write_scene(folder, QUIET | ALONE | moved, "block")
    assert run_here(["stands", "scene.toml"], capsys).code == 0


def test_no_arrow_of_a_live_load_that_does_not_act(folder, capsys):
    write_scene(folder, ALONE | {"output.paraview": False}, "block")
    assert run_here(["stands", "scene.toml"], capsys).code == 0
    assert (folder / "scene_state" / "state.png").exists()
    write_scene(folder, {}, "block")
    scene = Scene.from_file("scene.toml")
    for factor in (0.0, 0.1):
        legend = equilibrium(scene, factor).plot(Figure().subplots()).get_legend()
        texts = [text.get_text() for text in legend.get_texts()]
        assert ("live load" in texts) == (factor != 0.0)


@pytest.mark.slow
def test_ranks_give_the_same_answer(tmp_path):
    write_scene(tmp_path, QUIET | ALONE, "tower")
    found = run(["stands", "scene.toml"], tmp_path, 2)
    assert (found.code, found.out.count("it stands under its dead load")) == (0, 1)
