"""Scenes and results that are pickled and copied: the same numbers, here and in other processes."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import numpy as np
import pytest

from fenics_contact import (
    InputError,
    JointLaw,
    Load,
    OutputOptions,
    Scene,
    SolveOptions,
    limit_load,
)
from fenics_contact.geometry.refinement import refine
from fenics_contact.meshing import polygons
from tests.bank import BANK
from tests.helpers import coulomb, on_ground
from tests.quick import each_once

SCENES = ("W1 coulomb 0.65", "W1 tresca 2 kPa", "arch 15 0.15", "wedge 0.3")


def stored(item):
    return pickle.loads(pickle.dumps(item))


def small() -> Scene:
    return BANK["trilith 0.7"].scene(1)


def one_block() -> Scene:
    """A block that is cut where there are several ranks."""
    corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    base = {"base": [((0.0, 0.0), (1.0, 0.0))]}
    return on_ground(polygons([corners], 0.05, groups=base), coulomb(0.3))


@pytest.mark.mpi
@pytest.mark.parametrize(("name", "make"), each_once(SCENES, [copy.deepcopy, stored]))
def test_a_copied_scene_has_the_same_limit_load(name, make):
    scene = BANK[name].scene(1, fast=True)
    expected = limit_load(scene).load_factor  # to rounding: sums over ranks have no order
    assert limit_load(make(scene)).load_factor == pytest.approx(expected, rel=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["whole", "refined", "cut"])
def test_a_stored_mesh_is_made_again_with_its_numbers(kind):
    """Whole blocks on a rank, triangles that stay where they are, and graph partitioning."""
    mesh = one_block().mesh if kind == "cut" else small().mesh
    if kind == "refined":
        mesh = refine(mesh, np.arange(len(mesh.body)) % 3 == 0)
    again = stored(mesh)
    for found, expected in (
        (again.domain.geometry.x, mesh.domain.geometry.x),
        (again.domain.topology.original_cell_index, mesh.domain.topology.original_cell_index),
        (again.body, mesh.body),
    ):
        assert np.array_equal(found, expected)
    assert copy.deepcopy(mesh).domain is mesh.domain


@pytest.mark.mpi
@pytest.mark.parametrize("make", [copy.deepcopy, stored])
def test_a_copied_result_is_the_result(make):
    result = limit_load(BANK["W1 coulomb 0.65"].scene(1, direction="both", fast=True))
    again = make(result)
    assert repr(again) == repr(result)
    for name in result.joints:
        assert np.array_equal(again.joints[name], result.joints[name]), name
    for name in result.blocks:
        assert np.array_equal(again.blocks[name], result.blocks[name]), name
    for function in ("mode", "displacement"):
        one, other = (getattr(item, function).x.array for item in (again, result))
        assert np.array_equal(one, other)
    assert again.bounds == result.bounds
    assert again.summary() == result.summary()


WRITER = """
import pickle, sys
result = pickle.load(open(sys.argv[1], "rb"))
result.write(sys.argv[2])
print(repr(result), result.scene.mesh)
"""


def test_a_result_is_written_by_another_process(tmp_path):
    scene = replace(small(), output=OutputOptions(capacity=2, pictures=False))
    result = limit_load(scene)
    result.write(tmp_path / "here")
    (tmp_path / "result.pickle").write_bytes(pickle.dumps(result))
    line = [sys.executable, "-c", WRITER, str(tmp_path / "result.pickle"), str(tmp_path / "there")]
    root = Path(__file__).parents[2]
    done = subprocess.run(line, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == f"{result!r} {scene.mesh!r}"
    here, there = (sorted(path.iterdir()) for path in (tmp_path / "here", tmp_path / "there"))
    assert [path.name for path in here] == [path.name for path in there]
    for one, other in zip(here, there, strict=True):
        if one.suffix in (".vtu", ".csv"):
            assert one.read_bytes() == other.read_bytes(), one.name


@pytest.mark.slow
def test_a_result_is_final(tmp_path):
    """Whatever is asked of it, what it holds stays."""
    scene = BANK["stone of 0.0001 on a block"].scene(1)
    result = limit_load(replace(scene, output=OutputOptions(pictures=False)))
    before = {**vars(result)}
    seconds = {**result.seconds}
    ends = {key: (end, end.certificate, end.status) for key, end in result.ends.items()}
    result.summary()
    result.write(tmp_path)
    result.trace_capacity(points=2)
    result.hold_against_brackets()
    assert all(vars(result)[name] is value for name, value in before.items())
    assert result.seconds == seconds
    for key, (end, certificate, status) in ends.items():
        assert result.ends[key] is end
        assert (end.certificate is certificate) and end.status == status
    with pytest.raises(FrozenInstanceError):
        result.stopped = "no"  # type: ignore[misc]


def test_a_mesh_numbered_otherwise_is_refused():
    mesh = stored(small().mesh)
    wrong = replace(mesh.stored, numbering=mesh.stored.numbering[::-1])
    with pytest.raises(InputError, match="solve the scene again here"):
        assert wrong.domain


def push(v, dx, ds):
    return v[0] * dx("blocks")


@pytest.mark.parametrize("live", [Load((9.81, 0.0)), Load(form=push)])
def test_loads_of_all_kinds_are_stored(live):
    corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    base = {"base": [((0.0, 0.0), (1.0, 0.0))]}
    model = polygons([corners], 0.5, groups=base)
    scene = on_ground(model, JointLaw("coulomb", friction=0.3), live=live)
    scene = replace(scene, solve=SolveOptions(fast=True))
    assert stored(limit_load(scene)).load_factor == limit_load(stored(scene)).load_factor
