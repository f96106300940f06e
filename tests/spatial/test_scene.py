"""Scenes in space: what tables and objects become."""

from __future__ import annotations

import numpy as np
import pytest

from fenics_contact import InputError
from fenics_contact.spatial import Block, Foundation, JointLaw, Load, Material, Polyhedron, Scene
from fenics_contact.spatial.limit import collapse_of

TOWER = """
dimension = 3
title = "Two blocks"
[blocks.lower]
box = [[0, 0, 0], [1, 1, 1]]
[blocks.upper]
box = [[0, 0, 1], [1, 1, 2]]
[materials.default]
density = 2000.0
[joints.default]
friction = 0.6
[foundations.ground]
friction = 0.8
[loads.dead]
body = [0, 0, -10]
[loads.live]
direction = [2, 0, 0]
"""


@pytest.fixture
def scene_of(tmp_path):
    """A scene of a text, with overrides."""

    def read(text=TOWER, *overrides):
        path = tmp_path / "scene.toml"
        path.write_text(text)
        return Scene.from_file(path, overrides=overrides)

    return read


def test_blocks_on_the_ground(scene_of):
    structure = scene_of().structure()
    assert [block.name for block in structure.blocks] == ["lower", "upper", "ground"]
    assert [law.friction for law in structure.laws] == [0.6, 0.8]
    assert [law.key for law in structure.laws] == ["joints.default", "foundations.ground"]
    weight = [0.0, 0.0, -20000.0, 0.0, 0.0, 0.0]
    assert structure.dead == pytest.approx(np.array([weight, weight, np.zeros(6)]), abs=1e-9)
    assert structure.live[:2, 0] == pytest.approx(19620.0)
    assert collapse_of(structure).load_factor == pytest.approx(0.5 * 10.0 / 9.81, rel=1e-6)


def test_overrides(scene_of):
    scene = scene_of(TOWER, "joints.default.friction=0.3", "solve.quick=true")
    assert scene.solve.quick
    assert collapse_of(scene.structure()).load_factor == pytest.approx(0.3 * 10.0 / 9.81, rel=1e-6)


def test_objects_are_a_scene_as_tables_are(scene_of):
    boxes = [((0, 0, k), (1, 1, k + 1)) for k in (0, 1)]
    blocks = [
        Block((Polyhedron.box(*corners),), name)
        for corners, name in zip(boxes, ("lower", "upper"), strict=True)
    ]
    scene = Scene(
        blocks=tuple(blocks),
        materials={"default": Material(2000.0)},
        joints={"default": JointLaw(friction=0.6)},
        foundations={"ground": Foundation(friction=0.8)},
        dead=Load((0.0, 0.0, -10.0)),
        live=Load(direction=(2.0, 0.0, 0.0)),
    )
    given = scene_of().structure()
    assert np.array_equal(scene.structure().live, given.live)
    assert scene.structure().laws == given.laws


def test_unknown_keys_are_refused(scene_of):
    with pytest.raises(InputError, match="did you mean 'friction'"):
        scene_of(TOWER, "joints.default.frcition=1.0")
