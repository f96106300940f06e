"""Arguments of wrong types: one message that names the argument, whatever is called."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fenics_contact import (
    BlockMesh,
    EarthPressure,
    EdgeForce,
    Floor,
    InputError,
    JointLaw,
    Load,
    Material,
    Movement,
    OutputOptions,
    Scene,
    SolveOptions,
    Tie,
    equilibrium,
    limit_load,
    stands,
    sweep,
)
from fenics_contact.builders import bridge, facade, retaining_wall
from fenics_contact.drawing import Drawing, LayerRoles, read_dxf
from fenics_contact.meshing import (
    arch,
    buttress,
    default_size,
    model_from_arrays,
    polygons,
    running_bond,
    wall,
    wedge,
)
from tests.bank import block_recipe

TRIANGLE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]

#: What no argument can be; arguments that take one of these are asked for the others.
WRONG = {
    "text": "text",
    "nothing": None,
    "list": [1],
    "empty list": [],
    "list of lists": [[1, "a"]],
    "dict": {"a": 1},
    "dict of numbers": {1: 2},
    "array": np.zeros(3),
    "matrix": np.zeros((2, 2)),
    "array of strings": np.array(["a"]),
    "path": Path("x"),
    "whole number": -1,
    "number": -2.5,
    "truth value": True,
    "object": object(),
    "class": SimpleNamespace,
    "bytes": b"x",
    "not a number": float("nan"),
    "complex number": 1 + 2j,
    "function": print,
    "large number": 10**400,
}

#: Constructors and functions that need no scene, with arguments that go.
PLAIN: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "Material": (Material, {"young": 1e9, "poisson": 0.2, "density": 1e3}),
    "Material.strength": (partial(Material, 1e9, 0.2), {"compressive_strength": None}),
    "JointLaw": (
        JointLaw,
        {"law": "coulomb", "friction": 0.5, "cohesion": 0.0, "gap": 0.0, "opened": "kept"},
    ),
    "JointLaw.more": (
        partial(JointLaw, friction=0.5),
        {"bound": None, "compressive_strength": None, "dilatancy": 0.0, "tensile_strength": 0.0},
    ),
    "EdgeForce": (EdgeForce, {"force": (0.0, -1.0), "x": 0.0, "y": None, "width": 0.0}),
    "EarthPressure": (EarthPressure, {"level": 1.0, "unit_weight": 1e4, "wall_friction": 0.0}),
    "Movement": (Movement, {"displacement": (0.0, 0.0), "rotation": 0.0}),
    "Tie": (Tie, {"from_": (0.0, 0.0), "yield_": 1.0, "to": (1.0, 1.0), "ground": None}),
    "Floor": (Floor, {"force": 1.0, "at": None, "y": 1.0, "x": (0.0, 1.0), "mass": False}),
    "Load": (Load, {"body": (0.0, 0.0), "traction": {}, "tilt": 0.0, "force": {}, "earth": {}}),
    "Load.more": (Load, {"movement": {}, "form": None}),
    "SolveOptions": (SolveOptions, vars(SolveOptions())),
    "OutputOptions": (OutputOptions, vars(OutputOptions())),
    "Scene.from_file": (Scene.from_file, {"path": "x.toml", "comm": None, "overrides": ()}),
    "Scene.from_tables": (Scene.from_tables, {"given": {}, "mesh": print}),
    "BlockMesh.from_file": (
        BlockMesh.from_file,
        {"path": "x.msh", "comm": None, "blocks": "connected"},
    ),
    "BlockMesh.from_model": (BlockMesh.from_model, {"model": None, "blocks": "connected"}),
    "BlockMesh.from_dolfinx": (
        BlockMesh.from_dolfinx,
        {"mesh": None, "cell_tags": None, "facet_tags": None, "names": {1: "a"}},
    ),
    "wall": (wall, {"courses": [[1.0]], "block": (0.4, 0.2), "elements": 1}),
    "running_bond": (running_bond, {"bricks": 1, "courses": 1, "block": (1.0, 1.0), "elements": 1}),
    "polygons": (
        polygons,
        {"outlines": [TRIANGLE], "size": 1.0, "names": ["a"], "groups": {}},
    ),
    "polygons.more": (partial(polygons, [TRIANGLE]), {"quadrilaterals": False}),
    "model_from_arrays": (
        model_from_arrays,
        {"points": TRIANGLE, "cells": {"a": [[0, 1, 2]]}, "facets": {}, "name": "n"},
    ),
    "default_size": (default_size, {"blocks": [np.array(TRIANGLE)]}),
    "arch": (arch, {"voussoirs": 3, "thickness": 0.2, "radius": 1.0, "embrace": 180.0}),
    "wedge": (wedge, {"half_angle": 30.0, "height": 0.5, "length": 3.0, "size": 1.0}),
    "buttress": (buttress, {"courses": 1, "wall_width": 1.0, "foot": 1.0, "size": 1.0}),
    "facade": (facade, {"storeys": 1, "bays": 1, "opening": (1.0, 1.0), "pier": 1.0}),
    "bridge": (bridge, {"span": 4.0, "rise": 1.0, "ring": 0.3, "voussoirs": 5, "pier": (1.0, 2.0)}),
    "retaining_wall": (retaining_wall, {"height": 2.0, "base": 1.0, "top": 1.0, "courses": 2}),
    "Drawing": (Drawing, {"blocks": [TRIANGLE], "names": ["a"], "groups": {}}),
    "Drawing.mesh": (Drawing([np.array(TRIANGLE)], ["a"]).mesh, {"size": 1.0}),
    "LayerRoles": (LayerRoles, vars(LayerRoles())),
    "read_dxf": (read_dxf, {"path": "x.dxf", "unit": "m", "roles": None}),
}


def outcome(call: Callable[..., Any], arguments: dict[str, Any]) -> str:
    """What is wrong with the answer of a call; empty for an `InputError` of one line, or none."""
    try:
        call(**arguments)
    except InputError as error:
        return "" if len(str(error).splitlines()) == 1 else f"{error} has several lines"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""


def faults(call: Callable[..., Any], good: dict[str, Any]) -> dict[str, str]:
    """All that is wrong where one argument of a call is, by argument and value."""
    found = {
        f"{key} = {name}": outcome(call, good | {key: value})
        for key in good
        for name, value in WRONG.items()
    }
    return {key: problem for key, problem in found.items() if problem}


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Some wrong values are names of files."""
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("name", PLAIN)
def test_wrong_types_are_input_errors(name):
    assert faults(*PLAIN[name]) == {}


@pytest.fixture(scope="module")
def scene():
    return block_recipe(0.4, 1.0, 0.3).scene(1, fast=True)


def test_scenes_of_wrong_parts(scene):
    assert faults(Scene, vars(scene)) == {}


def test_functions_on_scenes(scene):
    goods = {"scene": None, "monitor": None, "progress": 1, "stop": 1}
    assert faults(limit_load, goods) == {}
    assert faults(partial(equilibrium, scene), {"load_factor": 2.0, "steps": 1}) == {}
    assert faults(stands, {"scene": None}) == {}
    vary = {"foundations.base.friction": [0.3]}
    assert faults(partial(sweep, scene), {"vary": vary, "folder": 1, "jobs": 0}) == {}
    assert faults(partial(sweep, vary=vary), {"scene": None}) == {}


def test_methods_of_results(scene):
    result = limit_load(scene)
    state = equilibrium(scene, 0.1)
    assert faults(result.plot, {"axes": 1, "scale": -1.0}) == {}
    assert faults(state.plot_forces, {"axes": 1}) == {}
    assert faults(result.plot_capacity, {"axes": 1}) == {}
    assert faults(result.animate, {"path": "a", "scale": 1.0, "seconds": 1.0}) == {}
    assert faults(result.with_capacity, {"monitor": 1, "points": -1, "stop": 1}) == {}
    assert faults(partial(result.write, 1), {"hurry": None}) == {}
    assert outcome(state.write, {"folder": 3.0}) == ""


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: wall("text"), "courses = 'text' must be a list"),
        (lambda: wall([["a"]]), r"courses\[0\]\[0\] = 'a' must be a number"),
        (lambda: wall([[1.0]], elements=2.0), "elements = 2.0 must be a whole number"),
        (lambda: wall([[1.0]], block=0.4), r"block = 0.4 must be two numbers, \[x, y\]"),
        (lambda: polygons([TRIANGLE], names="a"), "names = 'a' must be a list of strings"),
        (lambda: polygons([TRIANGLE], size="a"), "size = 'a' must be a number"),
        (lambda: polygons([["a"]]), r"outlines\[0\] = \['a'\] must be an array of numbers"),
        (lambda: read_dxf(3), "path = 3 must be a string"),
        (lambda: facade(pier=float("inf")), "pier = inf must be finite"),
        (lambda: facade(bays=10**9), "bays must be at most 1000000 in size"),
        (lambda: limit_load("wall.toml"), "scene = 'wall.toml' must be a Scene"),
        (lambda: model_from_arrays([1.0], {}, {}), r"points has the shape \(1,\); give \(points"),
        (lambda: BlockMesh.from_model(3), "model = 3 must be a gmsh model, as builders return it"),
        (lambda: Material(None, 0.2), "young = None must be a number"),
        (lambda: OutputOptions(formats="png"), "formats = 'png' must be a list of strings"),
    ],
)
def test_messages_name_the_argument_and_what_it_must_be(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_numbers_of_numpy_are_numbers():
    law = JointLaw(friction=np.float64(0.5))
    size = np.float32(0.5)
    assert law.friction == 0.5 and polygons(np.array([TRIANGLE]), size) is not None
    assert facade(bays=np.int64(1), opening=np.array([1.0, 1.0])).names[0] == "spandrels"
