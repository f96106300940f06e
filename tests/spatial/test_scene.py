"""Scenes in space: what tables and objects become."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import InputError
from fenics_contact.faces.kernel import FaceTolerances, Program, solve
from fenics_contact.faces.system import Equations
from fenics_contact.spatial import (
    Block,
    Floor,
    Force,
    Foundation,
    JointLaw,
    Load,
    Material,
    Movement,
    Plane,
    Polyhedron,
    Scene,
    Seismic,
    Sides,
    Tie,
)
from fenics_contact.spatial.limit import collapse_of
from tests.system.program import run_here

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
        materials={"default": Material(density=2000.0)},
        joints={"default": JointLaw(friction=0.6)},
        foundations={"ground": Foundation(friction=0.8)},
        dead=Load((0.0, 0.0, -10.0)),
        live=Load(direction=(2.0, 0.0, 0.0)),
    )
    given = scene_of().structure()
    assert np.array_equal(scene.structure().live, given.live)
    assert scene.structure().laws == given.laws


WEIGHT = 2000.0 * 10.0 * 2.0
SLIDING = {"friction": 0.2}
ROUGH = {"friction": 5.0}


def block_scene(law=ROUGH, live=None, **more):
    """A block of 1 x 1 x 2 m on the ground, pushed along x by a tenth of its mass per unit."""
    block = Block((Polyhedron.box([0, 0, 0], [1, 1, 2]),), "block")
    return Scene(
        blocks=(block,),
        materials={"default": Material(density=2000.0)},
        foundations={"ground": Foundation(**law)},
        dead=Load((0.0, 0.0, -10.0)),
        live=live or Load((10.0, 0.0, 0.0)),
        **more,
    )


ANCHOR = {"a": Tie((0.0, 0.5, 1.5), 1e4, ground=(0.0, 0.5, -1.0))}
PULLED = {"a": replace(ANCHOR["a"], stiffness=1e8, prestress=5e3)}
WEST = {"west": Sides(normal=(-1.0, 0.0, 0.0))}


@pytest.mark.parametrize(
    ("scene", "limit"),
    [
        (block_scene(), 0.5),
        (block_scene(ties=ANCHOR), 0.5 + 1e4 / WEIGHT),
        (block_scene(ties=PULLED), 0.5 + 1e4 / WEIGHT),
        (block_scene({"friction": 0.2, "cohesion": 1e3}), 0.2 + 1e3 / WEIGHT),
        (block_scene({"law": "tresca", "bound": 1e3}), 1e3 / WEIGHT),
        (
            block_scene({**ROUGH, "cohesion": 5e4, "tensile_strength": 1e4}),
            0.5 + 0.5 * 1e4 / WEIGHT,
        ),
        (block_scene(live=Load((10, 0, 0), profile="triangular")), 0.375),
        (block_scene(live=Load((10, 0, 0), profile=((0, 2.0), (2, 2.0)))), 0.25),
        (
            block_scene(live=Load(traction={"west": (1e4, 0, 0)}), sides=WEST),
            0.5 * WEIGHT / 2e4,
        ),
        (
            block_scene(live=Load(force={"a": Force((1e4, 0, 0), sides="west")}), sides=WEST),
            0.5 * WEIGHT / 1e4,
        ),
        (
            block_scene(live=Load(force={"a": Force((1e4, 0, 0), at=(0.5, 0.5, 2))})),
            0.5 * WEIGHT / 2e4,
        ),
        (
            block_scene(live=Load(force={"a": Force((1e4, 0, 0), block="block")})),
            0.5 * WEIGHT / 1e4,
        ),
        (block_scene(floors={"a": Floor(1e4, z=2.0)}), 0.5 * (WEIGHT + 1e4) / WEIGHT),
        (block_scene(floors={"a": Floor(1e4, z=2.0, x=(0, 0.5))}), 0.5 + 0.75 * 5e3 / WEIGHT),
        (
            block_scene(floors={"a": Floor(9810.0, z=2.0, mass=True)}),
            0.5 * (WEIGHT + 9810.0) / (WEIGHT + 2.0 * 1e4),
        ),
    ],
)  # fmt: skip
def test_a_block_on_the_ground_by_hand(scene, limit):
    assert collapse_of(scene.structure()).load_factor == pytest.approx(limit, rel=1e-5)


@pytest.mark.parametrize(
    ("live", "key"),
    [
        (Load(), "loads.live.body"),
        (Load((10, 0, 1)), "loads.live.body must be horizontal"),
        (Load((10, 0, 0), profile="triangular"), "loads.live.profile"),
        (
            Load((10, 0, 0), force={"a": Force((-1, 0, 0), block="block")}),
            "loads.live.force.a acts",
        ),
    ],
)
def test_a_seismic_check_needs_level_inertia_forces(live, key):
    with pytest.raises(InputError, match=key):
        block_scene(live=live, seismic=Seismic())


def test_a_floor_goes_to_what_is_below_by_area():
    """A plan of 3 x 2 m on walls of 1 and of 0.5 m."""
    boxes = [([0, 0, 0], [1, 2, 3]), ([2.5, 0, 0], [3, 2, 3])]
    blocks = tuple(Block((Polyhedron.box(*box),), str(k)) for k, box in enumerate(boxes))
    scene = Scene(
        blocks=blocks,
        materials={"default": Material(density=1000.0)},
        joints={"default": JointLaw(friction=0.5)},
        floors={"first": Floor(100.0, z=3.0)},
    )
    dead = scene.structure().dead
    assert dead[:2, 2] == pytest.approx([-400.0, -200.0])
    assert dead[:2, 3:] == pytest.approx(0.0, abs=1e-9)


def test_laws_by_groups_names_and_ground():
    boxes = [([0, 0, k], [1, 1, k + 1]) for k in range(4)]
    groups = ["wall", "wall", "floor", "floor"]
    blocks = tuple(
        Block((Polyhedron.box(*box),), f"b{k}", group)
        for k, (box, group) in enumerate(zip(boxes, groups, strict=True))
    )
    joints = {
        "default": JointLaw(friction=0.1),
        "wall": JointLaw(friction=0.2),
        "bed": JointLaw(friction=0.3, between=("floor", "wall")),
        "top": JointLaw(friction=0.4, between=("b2", "b3")),
    }
    scene = Scene(blocks=blocks, materials={"default": Material(density=1.0)}, joints=joints)
    laws = scene.structure().laws
    assert [law.friction for law in laws] == [0.2, 0.1, 0.3, 0.4]
    off = {**joints, "bed": JointLaw(off=True, between=("floor", "wall"))}
    scene = Scene(blocks=blocks, materials={"default": Material(density=1.0)}, joints=off)
    assert [law.friction for law in scene.structure().laws] == [0.2, 0.1, 0.4]


def test_rigid_ground_on_a_slope():
    cosine, sine = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))
    turned = np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])
    box = Polyhedron.box([0, 0, 0], [1, 1, 1])
    block = Block((Polyhedron(box.corners @ turned, box.sides),), "block")
    plane = Plane((0.0, 0.0, 0.0), tuple(turned[2]))
    scene = Scene(
        blocks=(block,),
        materials={"default": Material(density=1000.0)},
        foundations={"slope": Foundation(friction=0.7, plane=plane)},
        dead=Load((0.0, 0.0, -10.0)),
        live=Load(tuple(10.0 * turned[0])),
    )
    assert scene.structure().contacts[0].area == pytest.approx(1.0)
    limit = 0.7 * cosine - sine  # downhill
    assert collapse_of(scene.structure()).load_factor == pytest.approx(limit, rel=1e-6)


def test_a_support_that_settles_gives_its_load_to_others():
    """A rigid beam on three pads, k = E A / (volume)^(1/3): the middle one loses 2/3 k s."""
    pads = tuple(
        Block((Polyhedron.box([2 * k, 0, -1], [2 * k + 0.5, 1, 0]),), f"pad {k}", fixed=True)
        for k in range(3)
    )
    beam = Block((Polyhedron.box([0, 0, 0], [4.5, 1, 0.5]),), "beam")

    def middle(settlement):
        scene = Scene(
            blocks=(*pads, beam),
            materials={"default": Material(density=2000.0, young=1e9)},
            joints={"default": JointLaw(friction=0.6)},
            dead=Load((0, 0, -10), movement={"pad 1": Movement((0, 0, -settlement))}),
        )
        structure = scene.structure()
        model = structure.face_model()
        program = Program(
            model, Equations(model), model.strength, model.friction, model.dilatancy, elastic=True
        )
        state = solve(program, tolerances=FaceTolerances(1e-6, 1e-6, 1e-4))
        return structure.point_forces(state.force)[structure.points.contact == 1, 0].sum()

    stiffness = 1e9 * 0.5 / 2.25 ** (1.0 / 3.0)
    assert middle(0.0) == pytest.approx(15000.0, rel=1e-4)
    assert middle(1e-5) == pytest.approx(15000.0 - stiffness * 1e-5 * 2.0 / 3.0, rel=1e-4)
    assert middle(1e-3) == pytest.approx(0.0, abs=1.0)


def test_check_says_what_is_in_a_scene(tmp_path, capsys):
    path = tmp_path / "scene.toml"
    path.write_text(TOWER.replace("friction = 0.8", "friction = 80.0"))
    found = run_here(["check", str(path)], capsys)
    assert found.code == 0
    for text in (
        "2 blocks and 1 of ground, volume 2 m3, mass 4000 kg",
        "foundation ground: Coulomb friction 80 (89.3 degrees), no tensile strength, 1 contact",
        "dead load: resultant (0, 0, -40000) N",
        "warning: foundations.ground.friction = 80 is very high",
    ):
        assert text in found.out


WALL = """
dimension = 3
[blocks]
builder = "wall"
length = 2.0
height = 1.0
thickness = 0.2
groups.heavy = ["wall_1_*"]
[materials]
default.density = 1000.0
heavy.density = 2000.0
[joints.default]
friction = 0.6
[loads.dead]
body = [0, 0, -10]
[loads.live]
direction = [0, 1, 0]
"""


def test_builder_and_groups_by_patterns_of_names(scene_of):
    scene = scene_of(WALL)
    groups = {block.group for block in scene.blocks}
    assert "heavy" in groups and len(groups) > 1
    for override, message in (
        ("blocks.groups.odd=['nowhere*']", "no block or group is called 'nowhere"),
        ("blocks.legnth=2.0", "did you mean 'length'"),
        ("blocks.builder=barn", "blocks.builder = 'barn' must be one of 'barrel_vault'"),
        ("blocks.length=-1.0", "blocks.length = -1"),
        ("blocks.length=a", "blocks.length = 'a' must be a number"),
    ):
        with pytest.raises(InputError, match=message):
            scene_of(WALL, override)
    with pytest.raises(InputError, match=r"blocks.length is missing"):
        scene_of(WALL.replace("length = 2.0\n", ""))


def test_unknown_keys_are_refused(scene_of):
    with pytest.raises(InputError, match="did you mean 'friction'"):
        scene_of(TOWER, "joints.default.frcition=1.0")
