"""Displacements of degree 1 and 2 on triangles and quadrilaterals give the same answers."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, limit_load
from fenics_contact.analysis.rigid_blocks import RigidBlocks
from fenics_contact.output.fields import stress_fields
from fenics_contact.meshing import polygons, wall, wedge
from tests.regression.scenes import WALLS, rectangle, wall_scene

GRAVITY = 9.81
COULOMB = {"W1": 0.63997, "W2": 0.56288, "W3": 0.35582}
CELLS = pytest.mark.parametrize("quadrilaterals", [False, True], ids=["triangles", "quads"])
DEGREES = pytest.mark.parametrize("degree", [1, 2], ids=["linear", "quadratic"])


def pushed(model, friction: float, degree: int) -> Scene:
    """Blocks on the ground "base", their weight times the load factor to the right."""
    law = JointLaw("coulomb", friction)
    return Scene(
        BlockMesh.from_model(model),
        {"default": Material(1e9, 0.2, 2000.0)},
        live=Load((GRAVITY, 0.0)),
        dead=Load((0.0, -GRAVITY)),
        joints={"default": law},
        foundations={"base": law},
        degree=degree,
    )


@DEGREES
@CELLS
@pytest.mark.parametrize("name", WALLS)
def test_given_friction_equals_linear_program(name, quadrilaterals, degree):
    law = JointLaw("tresca", bound=2000.0)
    scene = wall_scene(name, law, degree=degree, quadrilaterals=quadrilaterals)
    result = limit_load(scene)
    blocks = RigidBlocks(result.structure.joints, result.structure.bodies, scene.comm)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(blocks.limit(), rel=1e-8)


@DEGREES
@CELLS
@pytest.mark.parametrize("name", COULOMB)
def test_coulomb_wall(name, quadrilaterals, degree):
    law = JointLaw("coulomb", 0.65)
    result = limit_load(wall_scene(name, law, degree=degree, quadrilaterals=quadrilaterals))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(COULOMB[name], rel=2e-4)


@DEGREES
@CELLS
@pytest.mark.parametrize("friction", [0.2, 0.7])
def test_block_slides_or_tips(friction, quadrilaterals, degree):
    model = polygons([rectangle(0, 0, 0.4, 1.0)], 0.1, quadrilaterals=quadrilaterals)
    result = limit_load(pushed(model, friction, degree))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(min(friction, 0.4), rel=1e-6)


@DEGREES
@CELLS
@pytest.mark.parametrize("friction", [0.1, 0.7])
def test_stack_slides_or_tips(friction, quadrilaterals, degree):
    model = wall([[1.0]] * 5, block=(0.5, 0.2), quadrilaterals=quadrilaterals)
    result = limit_load(pushed(model, friction, degree))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(min(friction, 0.5), rel=1e-6)


@DEGREES
@CELLS
@pytest.mark.parametrize("friction", [0.1, 0.3])
def test_wedge_drives_blocks_apart(friction, quadrilaterals, degree):
    """P / W = 2 F / (cot(a + phi) - F); the pressure on the wedge is one block's weight."""
    height, length, half_angle = 0.5, 3.0, 30.0
    half = height * math.tan(math.radians(half_angle))
    weight = 1000.0 * GRAVITY * (length - 0.5 * half) * height
    law = JointLaw("coulomb", friction)
    scene = Scene(
        BlockMesh.from_model(wedge(half_angle, height, length, quadrilaterals=quadrilaterals)),
        {"blocks": Material(1e9, 0.2, 1000.0), "wedge": Material(1e9, 0.2)},
        live=Load(traction={"top": (0.0, -0.5 * weight / half)}),
        dead=Load((0.0, -GRAVITY)),
        joints={"flanks": law},
        foundations={"base": law},
        degree=degree,
    )
    result = limit_load(scene)
    cotangent = 1.0 / math.tan(math.radians(half_angle) + math.atan(friction))
    assert result.status == "limit"
    exact = 2.0 * friction / (cotangent - friction)
    assert result.load_factor == pytest.approx(exact, rel=1e-8)


PATCH = {  # blocks of 2.4 m by 0.8 m with joints of several lengths: gmsh's own irregular cells
    "aligned": [(0, 0, 1.3, 0.4), (1.3, 0, 2.4, 0.4), (0, 0.4, 1.3, 0.8), (1.3, 0.4, 2.4, 0.8)],
    "bonded": [(0, 0, 1.3, 0.5), (1.3, 0, 2.4, 0.5), (0, 0.5, 0.7, 0.8), (0.7, 0.5, 2.4, 0.8)],
}


@DEGREES
@CELLS
@pytest.mark.parametrize("plane", ["strain", "stress"])
@pytest.mark.parametrize("bond", PATCH)
def test_patch_of_blocks_under_uniform_pressure(bond, plane, quadrilaterals, degree):
    """A live load that takes off the pressure from the side: what is left is that from above."""
    pressure = 2e4
    model = polygons(
        [rectangle(*block) for block in PATCH[bond]],
        0.2,
        groups={
            "base": [((0, 0), (2.4, 0))],
            "left": [((0, 0), (0, 0.8))],
            "right": [((2.4, 0), (2.4, 0.8))],
            "top": [((0, 0.8), (2.4, 0.8))],
        },
        quadrilaterals=quadrilaterals,
    )
    scene = Scene(
        BlockMesh.from_model(model),
        {"default": Material(1e9, 0.2)},
        live=Load(traction={"right": (1.0, 0.0)}),
        dead=Load(traction={"top": (0.0, -pressure), "right": (-0.5 * pressure, 0.0)}),
        joints={"default": JointLaw("frictionless")},
        supports={"base": "roller", "left": "roller"},
        plane=plane,
        degree=degree,
    )
    result = limit_load(scene)
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(0.5 * pressure, rel=1e-9)
    fields = {f.name: f.x.array for f in stress_fields(result.structure, result.displacement)}
    exact = {"stress_xx": 0.0, "stress_yy": -pressure, "stress_xy": 0.0}
    for name, value in exact.items():
        np.testing.assert_allclose(fields[name], value, rtol=0.0, atol=1e-8 * pressure)


@DEGREES
@CELLS
def test_paraview_file_keeps_the_degree(quadrilaterals, degree, tmp_path):
    model = polygons([rectangle(0, 0, 0.4, 1.0)], 0.2, quadrilaterals=quadrilaterals)
    result = limit_load(pushed(model, 0.2, degree))
    result.write(tmp_path)
    (file,) = tmp_path.glob("blocks*.vtu")
    text = file.read_text()
    arrays = {
        name: np.array(numbers.split(), dtype=float)
        for name, numbers in re.findall(r'<DataArray[^>]*Name="(\w+)"[^>]*>([^<]*)<', text)
    }
    lagrange = {False: 69, True: 70}[quadrilaterals]  # VTK's triangle and quadrilateral
    nodes = {(False, 1): 3, (False, 2): 6, (True, 1): 4, (True, 2): 9}[quadrilaterals, degree]
    assert np.all(arrays["types"] == lagrange)
    assert np.all(np.diff(arrays["offsets"], prepend=0.0) == nodes)
    points = result.structure.elasticity.space.dofmap.index_map.size_global
    assert len(arrays["displacement"]) == 3 * points


def degree_2_answers() -> dict[str, tuple[str, float]]:
    answers = {}
    for law in (JointLaw("tresca", bound=2000.0), JointLaw("coulomb", 0.65)):
        result = limit_load(wall_scene("W1", law, degree=2, quadrilaterals=True))
        answers[law.law] = (result.status, result.load_factor)
    return answers


RANKS_PROGRAM = """
import json
from mpi4py import MPI
from tests.regression.test_degrees import degree_2_answers

answers = degree_2_answers()
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(answers))
"""


def test_answer_on_two_ranks_is_that_on_one():
    root = Path(__file__).parents[2]
    environment = os.environ | {
        "PYTHONPATH": str(root),
        "OMP_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    }
    command = ["mpirun", "--oversubscribe", "-n", "2", sys.executable, "-c", RANKS_PROGRAM]
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=300, check=True
    )
    two = json.loads(done.stdout.splitlines()[-1])
    for law, (status, factor) in degree_2_answers().items():
        assert two[law][0] == status == "limit"
        assert two[law][1] == pytest.approx(factor, rel=1e-8)
