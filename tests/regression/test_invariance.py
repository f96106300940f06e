"""What must not change a load factor: stiffness, units, numbering, orientation, ranks."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fenics_contact import JointLaw, limit_load
from tests.regression.scenes import Variant, wall_scene

CASES = {
    "tresca": ("W1", JointLaw("tresca", bound=2000.0)),
    "coulomb": ("W1", JointLaw("coulomb", 0.65)),
    "opening": ("W3", JointLaw("coulomb", 0.65)),
}

VARIANTS = {
    "1000 times as stiff": Variant(young=1e3),
    "1000 times as soft": Variant(young=1e-3),
    "millimetres": Variant(length=1e-3),
    "micrometres": Variant(length=1e-6),
    "kilometres and giganewtons": Variant(length=1e3, force=1e9),
    "renumbered": Variant(seed=1),
    "renumbered otherwise": Variant(seed=2),
    "mirrored": Variant(mirrored=True),
}


@pytest.fixture(scope="module")
def plain():
    return {case: limit_load(wall_scene(*arguments)) for case, arguments in CASES.items()}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("case", CASES)
def test_load_factor_is_invariant(plain, case, variant):
    name, law = CASES[case]
    result = limit_load(wall_scene(name, law, variant=VARIANTS[variant]))
    assert result.status == "limit"
    assert result.load_factor == pytest.approx(plain[case].load_factor, rel=1e-8)


def test_reversed_load_on_mirrored_wall_is_the_same(plain):
    """The negative direction of a wall is the positive one of its mirror image, with its sign."""
    name, law = CASES["opening"]
    result = limit_load(wall_scene(name, law, direction="both"))
    assert result.load_factor == pytest.approx(plain["opening"].load_factor, rel=1e-8)
    mirrored = Variant(mirrored=True)
    opposite = limit_load(wall_scene(name, law, variant=mirrored, direction="negative"))
    assert opposite.load_factor_negative == pytest.approx(result.load_factor_negative, rel=1e-8)
    assert result.load_factor_negative < 0.0


RANKS_PROGRAM = """
import json, sys
from mpi4py import MPI
from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, limit_load
from fenics_contact.meshing import polygons
from tests.regression.scenes import rectangle, wall_scene

answers = {}
for name, law, elements in (
    ("W1", JointLaw("tresca", bound=2000.0), 2),
    ("W1", JointLaw("coulomb", 0.65), 2),
    ("W3", JointLaw("coulomb", 0.65), 2),
    ("W4", JointLaw("coulomb", 0.65), 2),
    ("10x10", JointLaw("coulomb", 0.75), 2),
):
    result = limit_load(wall_scene(name, law, elements))
    answers[f"{name} {law.law}"] = (result.status, result.load_factor)
for size in (0.2, 1.0):  # a block of many cells, and one of four: fewer bodies than ranks
    mesh = BlockMesh.from_model(polygons([rectangle(0, 0, 0.4, 1.0)], size), MPI.COMM_WORLD)
    scene = Scene(
        mesh,
        {"default": Material(1e9, 0.2, 2000.0)},
        live=Load((9.81, 0.0)),
        dead=Load((0.0, -9.81)),
        foundations={"base": JointLaw("coulomb", 0.3)},
    )
    result = limit_load(scene)
    answers[f"block {size}"] = (result.status, result.load_factor)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(answers))
"""


def on_ranks(count: int) -> dict[str, tuple[str, float]]:
    root = Path(__file__).parents[2]
    environment = os.environ | {
        "PYTHONPATH": str(root),
        "OMP_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    }
    command = ["mpirun", "--oversubscribe", "-n", str(count), sys.executable, "-c", RANKS_PROGRAM]
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=300, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def test_answer_does_not_depend_on_ranks():
    one = on_ranks(1)
    for count in (2, 3, 4):
        several = on_ranks(count)
        assert several.keys() == one.keys()
        for name, (status, factor) in one.items():
            assert several[name][0] == status == "limit", name
            assert several[name][1] == pytest.approx(factor, rel=1e-8), (name, count)
