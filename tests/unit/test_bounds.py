"""Limit loads of rigid blocks: closed forms, collapse modes, independence of the mesh."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize
from mpi4py import MPI

from fenics_contact import JointLaw, Load, Scene
from fenics_contact.analysis.rigid_blocks import RigidBlocks, straight_faces
from fenics_contact.discretization.joints import GROUND, Joints
from fenics_contact.meshing import polygons, running_bond, wall
from fenics_contact.discretization.discretization import Structure
from tests.helpers import (
    GRAVITY,
    PUSH,
    STONE,
    WEIGHT,
    Drawing,
    coulomb,
    joint_rows,
    mesh_of,
    on_ground,
    tresca,
    whole,
)

DENSITY = STONE.density
B, H = 0.4, 1.0


def blocks_of(scene: Scene) -> tuple[RigidBlocks, Structure]:
    structure = Structure.build(scene)
    return RigidBlocks(structure.joints, structure.bodies, MPI.COMM_WORLD), structure


def single_block(law: JointLaw, live: Load = PUSH, dead: Load = WEIGHT, **options) -> RigidBlocks:
    """A block B wide and H high on rigid ground, pushed by its weight."""
    return blocks_of(on_ground(wall([[1]], (B, H), 1), law, dead, live, **options))[0]


def slope(degrees: float, friction: float) -> RigidBlocks:
    """A block on a slope that falls to the right, pushed down along it by its weight."""
    angle = np.radians(degrees)
    drawing = Drawing.of(wall([[1]], (B, H), 1)).turned(-angle)
    live = Load((GRAVITY * np.cos(angle), -GRAVITY * np.sin(angle)))
    return blocks_of(on_ground(drawing.model(), coulomb(friction), live=live))[0]


@pytest.mark.parametrize("friction", [0.05, 0.39, 0.41, 3.0])
def test_block_slides_or_tips(friction):
    bounds = single_block(coulomb(friction)).bounds()
    assert bounds.upper == pytest.approx(min(friction, B / H), rel=1e-9)
    assert bounds.lower == 0.0
    assert bounds.stands and bounds.stands_frictionless


@pytest.mark.parametrize("friction", [0.05, 3.0])
@pytest.mark.parametrize("count", [2, 6])
def test_stack_slides_or_tips_as_one(count, friction):
    blocks, _ = blocks_of(on_ground(wall([[1]] * count, (0.5, 0.2), 1), coulomb(friction)))
    assert blocks.limit() == pytest.approx(min(friction, 0.5 / (0.2 * count)), rel=1e-9)


@pytest.mark.parametrize(("degrees", "friction"), [(10.0, 0.3), (10.0, 0.9), (5.0, 0.2)])
def test_block_on_a_slope(degrees, friction):
    angle = np.radians(degrees)
    slides = friction * np.cos(angle) - np.sin(angle)
    tips = (B * np.cos(angle) - H * np.sin(angle)) / H
    blocks = slope(degrees, friction)
    assert blocks.limit() == pytest.approx(min(slides, tips), rel=1e-9)
    # Without friction it would not stand at all.
    bounds = blocks.bounds()
    assert bounds.stands and not bounds.stands_frictionless
    assert bounds.lower is None


@pytest.mark.parametrize(("degrees", "friction"), [(20.0, 0.3), (23.0, 0.9), (30.0, 9.0)])
def test_block_on_a_slope_too_steep(degrees, friction):
    blocks = slope(degrees, friction)
    bounds = blocks.bounds()
    assert not bounds.stands and not bounds.stands_frictionless
    assert bounds.lower is None
    assert blocks.stands() is False


@pytest.mark.parametrize("degrees", [16.0, 21.0])
def test_tilting_table_is_stable_up_to_its_angle(degrees):
    # tan(16.7) = 0.3 is the friction, tan(21.8) = 0.4 the slenderness.
    assert slope(degrees, 0.3).stands() == (degrees < 16.7)
    assert slope(degrees, 0.9).stands()


@pytest.mark.parametrize("strength", [100.0, 2000.0, 1e5])
def test_given_shear_strength(strength):
    weight = DENSITY * GRAVITY * B * H
    expected = min(strength * B / weight, B / H)
    assert single_block(tresca(strength)).limit() == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("friction", "strength"), [(0.2, 2e4), (0.9, 2e3), (0.0, 2e3)])
def test_rough_joint_on_a_base_of_given_strength(friction, strength):
    """Faces of both kinds in one program: either slides, or all tips."""
    width, height = 0.5, 0.2
    scene = Scene(
        mesh_of(wall([[1]] * 2, (width, height), 1)),
        {"default": STONE},
        dead=WEIGHT,
        live=PUSH,
        joints={"default": coulomb(friction)},
        foundations={"base": tresca(strength)},
    )
    weight = 2.0 * DENSITY * GRAVITY * width * height
    expected = min(friction, strength * width / weight, width / (2.0 * height))
    assert blocks_of(scene)[0].limit() == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_shear_strength_without_weight():
    # Pressed on top and pushed along its base only: strength times width over the push.
    drawing = Drawing.of(wall([[1]], (1.0, 0.1), 1))
    scene = on_ground(
        drawing.model(),
        tresca(3e3),
        dead=Load(traction={"top": (0.0, -5e4)}),
        live=Load(traction={"left": (1e4, 0.0)}),
    )
    assert blocks_of(scene)[0].limit() == pytest.approx(3e3 * 1.0 / (1e4 * 0.1), rel=1e-9)


def test_frictionless_block_carries_nothing():
    blocks = single_block(JointLaw("frictionless"))
    assert blocks.limit() == pytest.approx(0.0, abs=1e-12)
    assert blocks.limit(friction=False) == pytest.approx(0.0, abs=1e-12)
    assert blocks.stands(friction=False)


def test_block_pressed_on_the_ground_carries_everything():
    blocks = single_block(coulomb(0.5), live=WEIGHT)
    assert blocks.limit() == np.inf
    assert blocks.bounds().upper == np.inf
    assert blocks.collapse(np.zeros(3))[1] is None


def test_block_lifted_by_its_weight():
    assert single_block(coulomb(0.5), live=Load((0.0, GRAVITY))).limit() == pytest.approx(1.0)


def test_inclined_push_locks_or_slides():
    # Down and to the right at 45 degrees: sliding needs F < 1, and the push adds to the pressure.
    live = Load((GRAVITY, -GRAVITY))
    low = blocks_of(on_ground(wall([[1]], (1.0, 0.2), 1), coulomb(0.3), live=live))[0]
    assert low.limit() == pytest.approx(0.3 / 0.7, rel=1e-9)
    high = blocks_of(on_ground(wall([[1]], (1.0, 0.2), 1), coulomb(1.1), live=live))[0]
    assert high.limit() == np.inf


def test_unit_of_force_does_not_matter():
    model = running_bond(2, 2, elements=1)
    limits = []
    for unit in (1e-6, 1.0, 1e6):
        scene = on_ground(
            model,
            coulomb(0.6),
            dead=Load((0.0, -GRAVITY * unit)),
            live=Load((GRAVITY * unit, 0.0)),
        )
        limits.append(blocks_of(scene)[0].limit())
    assert limits == pytest.approx([limits[0]] * 3, rel=1e-9)


def test_load_factor_scales_with_the_live_load():
    usual = single_block(coulomb(0.3)).limit()
    tenth = single_block(coulomb(0.3), live=Load((0.1 * GRAVITY, 0.0))).limit()
    assert tenth == pytest.approx(10.0 * usual, rel=1e-9)


def collapse_of(scene: Scene, strength: float):
    """Load factor, mode as nodal values, and everything needed to judge it."""
    blocks, structure = blocks_of(scene)
    bound = strength * structure.joints.length
    factor, motion = blocks.collapse(bound)
    assert factor is not None and motion is not None
    return factor, motion, bound, structure


@pytest.mark.parametrize("strength", [300.0, 3e3, 1e5])
@pytest.mark.parametrize("shape", ["block", "wall", "lintel"])
def test_collapse_mode_proves_its_load_factor(shape, strength):
    model = {
        "block": lambda: wall([[1]], (B, H), 1),
        "wall": lambda: running_bond(2, 3, elements=1),
        "lintel": lambda: wall([[1, 1, 1], [1, -1, 1], [0.5, 2, 0.5]], elements=1),
    }[shape]()
    factor, motion, bound, structure = collapse_of(on_ground(model, coulomb(0.6)), strength)
    mode = whole(structure.rigid_motion(motion))
    live, dead = whole(structure.problem.live), whole(structure.problem.dead)
    assert live @ mode == pytest.approx(1.0, rel=1e-9)
    b_n, b_t = joint_rows(structure)
    fastest = np.abs(mode).max()
    assert (b_n @ mode).min() > -1e-9 * fastest
    dissipation = bound @ np.abs(b_t @ mode)
    assert dissipation == pytest.approx(factor + dead @ mode, abs=1e-9 * max(dissipation, factor))


def test_collapse_ignores_coulombs_coefficient():
    model = wall([[1]], (B, H), 1)
    weight = DENSITY * GRAVITY * B * H
    for friction in (0.1, 5.0):
        factor, motion, _, _ = collapse_of(on_ground(model, coulomb(friction)), 500.0)
        assert factor == pytest.approx(500.0 * B / weight, rel=1e-9)
        # Sliding: to the right, without rotation.
        assert motion[0] == pytest.approx([1.0 / weight, 0.0, 0.0], rel=1e-9, abs=1e-15)


def test_tipping_block_turns_about_its_edge():
    factor, motion, _, structure = collapse_of(on_ground(wall([[1]], (B, H), 1), coulomb(1.0)), 1e6)
    assert factor == pytest.approx(B / H, rel=1e-9)
    (a, b, c), (x, y) = motion[0], structure.bodies.centre[0]
    assert c < 0.0  # clockwise, to the right
    edge = np.array([a - c * (0.0 - y), b + c * (B - x)])
    assert np.abs(edge).max() < 1e-9 * np.abs(motion[0]).max()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("associative", [True, False])
def test_limit_does_not_depend_on_the_mesh(associative, degree):
    limits = []
    for elements in (1, 2, 4):
        blocks, structure = blocks_of(
            on_ground(running_bond(2, 3, (0.4, 0.2), elements), coulomb(0.55), degree=degree)
        )
        strength = 800.0 * structure.joints.length
        limits.append(blocks.limit() if associative else blocks.collapse(strength)[0])
    assert limits[1:] == pytest.approx([limits[0]] * 2, rel=1e-9)
    assert 0.0 < limits[0] < 1.0


def test_straight_faces_are_the_joints_between_two_blocks():
    structure = Structure.build(on_ground(running_bond(2, 2, (0.4, 0.2), 3), coulomb(0.5)))
    joints = structure.joints
    strength = 1e3 * joints.length
    faces = straight_faces(joints, strength)
    # 2 on the ground, 1 + 2 head joints, and 4 stretches of the bed joint.
    assert len(faces.ends) == 2 + 3 + 4
    along = joints.position[faces.ends[:, 1]] - joints.position[faces.ends[:, 0]]
    length = np.linalg.norm(along, axis=1)
    assert sorted(np.round(length, 12)) == [0.2] * 7 + [0.4] * 2
    assert faces.strength == pytest.approx(1e3 * length, rel=1e-12)
    assert np.array_equal(joints.bodies[faces.ends[:, 0]], joints.bodies[faces.ends[:, 1]])
    assert np.array_equal(np.bincount(faces.of_point), np.where(length > 0.3, 7, 4))
    assert np.all(faces.friction == 0.5)


def test_faces_of_one_block_pair_on_two_lines_are_two():
    angle_iron = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    corner = [(1, 1), (2, 1), (2, 2), (1, 2)]
    structure = Structure.build(on_ground(polygons([angle_iron, corner], 0.5), coulomb(0.5)))
    between = structure.joints.bodies[:, 0] != GROUND
    faces = straight_faces(structure.joints, np.ones(len(between)))
    assert len(np.unique(faces.of_point[between])) == 2


def test_no_joints_no_faces():
    none = np.empty(0)
    joints = Joints(
        nodes=np.empty((0, 2), dtype=np.int64),
        bodies=np.empty((0, 2), dtype=np.int32),
        position=np.empty((0, 2)),
        normal=np.empty((0, 2)),
        length=none,
        law=np.empty(0, dtype=np.int64),
        laws=(),
        names=(),
        segments=np.empty((0, 2), dtype=np.int64),
    )
    assert straight_faces(joints, none).ends.shape == (0, 2)


def test_reversed_load():
    # A heavy traction from the left holds against a push to the left.
    scene = on_ground(
        wall([[1]], (B, H), 1),
        coulomb(0.3),
        dead=Load((0.0, -GRAVITY), {"left": (100.0, 0.0)}),
    )
    forward = blocks_of(scene)[0].limit()
    backward = blocks_of(
        on_ground(
            wall([[1]], (B, H), 1),
            coulomb(0.3),
            dead=scene.dead,
            live=Load((-GRAVITY, 0.0)),
        )
    )[0].limit()
    shift = 100.0 * H / (DENSITY * GRAVITY * B * H)
    assert forward == pytest.approx(0.3 - shift, rel=1e-9)
    assert backward == pytest.approx(0.3 + shift, rel=1e-9)


def test_blocks_on_supports_take_part():
    # A block on a fixed sill, with the friction of their joint only.
    drawing = Drawing.of(wall([[2], [1]], (0.5, 0.2), 1))
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": STONE},
        dead=WEIGHT,
        live=PUSH,
        joints={"default": coulomb(0.3)},
        supports={"base": "fixed"},
    )
    blocks, structure = blocks_of(scene)
    assert structure.bodies.floating.tolist() == [False, True]
    assert blocks.limit() == pytest.approx(0.3, rel=1e-9)


def test_block_between_a_roller_and_a_frictional_floor():
    # A roller at its back takes no shear: the push down along it is held by nothing but the floor.
    drawing = Drawing.of(wall([[1]], (0.5, 0.5), 1))
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": STONE},
        dead=WEIGHT,
        live=Load((0.0, GRAVITY)),
        foundations={"base": coulomb(0.3)},
        supports={"left": "roller"},
    )
    assert blocks_of(scene)[0].limit() == pytest.approx(1.0, rel=1e-9)


def test_all_ranks_have_the_answer():
    blocks = single_block(coulomb(0.3))
    answers = MPI.COMM_WORLD.allgather(blocks.limit())
    assert len(set(answers)) == 1


@pytest.mark.parametrize("friction", [0.3, 0.9])
def test_associative_normal_forces_carry_the_weight(friction):
    blocks = single_block(coulomb(friction))
    pressure = blocks.associative_pressure()
    assert pressure is not None
    assert np.all(pressure >= 0.0)
    weight = -blocks._bodies.dead[0, 1]
    assert pressure.sum() == pytest.approx(weight, rel=1e-8)


def test_no_associative_normal_forces_without_a_limit():
    drawing = Drawing.of(wall([[1]], (0.5, 0.5), 1))
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": STONE},
        dead=WEIGHT,
        live=WEIGHT,  # presses on the ground
        foundations={"base": coulomb(0.3)},
    )
    assert blocks_of(scene)[0].associative_pressure() is None


# ---- normal forces of the associative limit state

WEIGHT_OF_BLOCK = DENSITY * GRAVITY * B * H


@pytest.mark.parametrize("law", [coulomb(0.3), tresca(2e3), coulomb(0.0)])
def test_associative_pressure_of_a_block_is_its_weight(law):
    # It acts where weight and load, at the middle of the block, have their resultant.
    blocks, structure = blocks_of(on_ground(wall([[1]], (B, H), 4), law))
    pressure, x = blocks.associative_pressure(), structure.joints.position[:, 0]
    assert pressure.shape == x.shape
    assert np.all(pressure >= 0.0)
    assert pressure.sum() == pytest.approx(WEIGHT_OF_BLOCK, rel=1e-9)
    moment = WEIGHT_OF_BLOCK * 0.5 * (B + blocks.limit() * H)
    assert pressure @ (x - x.min()) == pytest.approx(moment, rel=1e-8)
    # At the ends of the face only.
    assert np.all(pressure[(x > x.min() + 1e-9) & (x < x.max() - 1e-9)] == 0.0)


def test_associative_pressure_of_a_tipping_block_is_at_its_edge():
    blocks, structure = blocks_of(on_ground(wall([[1]], (B, H), 2), coulomb(1.0)))
    pressure = blocks.associative_pressure()
    expected = np.zeros(len(pressure))
    expected[np.argmax(structure.joints.position[:, 0])] = WEIGHT_OF_BLOCK
    assert pressure == pytest.approx(expected, abs=1e-7 * WEIGHT_OF_BLOCK)


@pytest.mark.parametrize("courses", [1, 4])
def test_associative_pressure_of_a_stack_grows_downwards(courses):
    blocks, structure = blocks_of(on_ground(wall([[1]] * courses, (0.5, 0.2), 2), coulomb(0.3)))
    pressure, y = blocks.associative_pressure(), structure.joints.position[:, 1]
    weight = DENSITY * GRAVITY * 0.5 * 0.2
    for course in range(courses):
        at_bed = np.abs(y - 0.2 * course) < 1e-9
        carried = (courses - course) * weight
        assert pressure[at_bed].sum() == pytest.approx(carried, rel=1e-8)


def test_associative_pressure_on_a_slope():
    angle = np.radians(10.0)
    drawing = Drawing.of(wall([[1]], (B, H), 1)).turned(-angle)
    live = Load((GRAVITY * np.cos(angle), -GRAVITY * np.sin(angle)))
    blocks, _ = blocks_of(on_ground(drawing.model(), coulomb(0.2), live=live))
    total = WEIGHT_OF_BLOCK * np.cos(angle)
    assert blocks.associative_pressure().sum() == pytest.approx(total, rel=1e-9)


def test_associative_pressure_of_a_wall_with_the_shear_of_its_limit_load():
    # Pressures and load factor leave shear forces within friction that hold all blocks.
    from scipy.optimize import linprog

    friction = 0.9
    blocks, structure = blocks_of(
        on_ground(running_bond(2, 3, (0.4, 0.2), elements=1), coulomb(friction))
    )
    pressure, factor = blocks.associative_pressure(), blocks.limit()
    joints, bodies = structure.joints, structure.bodies
    count = len(pressure)
    rows = np.zeros((len(bodies.centre), 3, count, 2))
    for point in range(count):
        for side, sign in ((0, -1.0), (1, 1.0)):
            body = joints.bodies[point, side]
            if body == GROUND:
                continue
            arm = joints.position[point] - bodies.centre[body]
            for k, along in enumerate((joints.normal[point], joints.tangent[point])):
                force = sign * along
                moment = arm[0] * force[1] - arm[1] * force[0]
                rows[body, :, point, k] += [*force, moment / bodies.size]
    rows = rows.reshape(-1, count, 2)
    load = (bodies.dead + factor * bodies.live).ravel()
    # Shear forces at the ends of faces; a face's bound is that of its two ends together.
    faces = straight_faces(joints, joints.shear_strength)
    of_face = (faces.of_point == np.arange(len(faces.ends))[:, None]).astype(float)
    within = friction * (of_face @ pressure) * (1.0 + 1e-7) + 1e-7 * pressure.max()
    weight = DENSITY * GRAVITY
    answer = linprog(
        np.zeros(count),
        np.vstack([of_face, -of_face]) / weight,
        np.tile(within, 2) / weight,
        rows[:, :, 1] / weight,
        -(rows[:, :, 0] @ pressure + load) / weight,
        (None, None),
    )
    assert answer.status == 0, answer.message


def test_no_associative_pressure_where_the_load_locks_the_block():
    # Down and a little to the right, well within the cone of friction.
    blocks = single_block(coulomb(0.5), live=Load((0.1 * GRAVITY, -GRAVITY)))
    assert blocks.limit() == np.inf
    assert blocks.associative_pressure() is None


def test_no_associative_pressure_without_equilibrium():
    # Nothing holds a block on a smooth slope that is lifted off it.
    drawing = Drawing.of(wall([[1]], (B, H), 1)).turned(-np.radians(10.0))
    live = Load((GRAVITY * np.sin(np.radians(10.0)), GRAVITY * np.cos(np.radians(10.0))))
    blocks, _ = blocks_of(on_ground(drawing.model(), JointLaw("frictionless"), live=live))
    assert blocks.limit() is None
    assert blocks.associative_pressure() is None


def test_all_ranks_have_the_pressure():
    blocks, structure = blocks_of(on_ground(running_bond(2, 2, elements=1), coulomb(0.5)))
    pressures = MPI.COMM_WORLD.allgather(blocks.associative_pressure())
    assert all(np.array_equal(pressure, pressures[0]) for pressure in pressures)
    assert pressures[0].shape == structure.joints.length.shape


@pytest.mark.parametrize("friction", [0.05, 3.0])
def test_whether_the_dead_load_stands_is_asked_of_the_simplex_method_alone(friction, monkeypatch):
    """On a slope of 15 degrees a block slides or stands; no interior point method is used."""
    methods, pricing, linprog = [], [], scipy.optimize.linprog

    def noted(*arguments, **options):
        methods.append(arguments[6])
        pricing.append(options["options"].get("simplex_dual_edge_weight_strategy"))
        return linprog(*arguments, **options)

    monkeypatch.setattr("scipy.optimize.linprog", noted)
    blocks = slope(15.0, friction)
    assert blocks.stands() == (friction > np.tan(np.radians(15.0)))
    assert methods == ["highs-ds"]
    assert pricing == ["dantzig"]
    blocks.bounds()
    assert set(methods) >= ({"highs-ipm"} if friction == 3.0 else {"highs-ds"})
