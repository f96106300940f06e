"""Properties that every scene has: status, bracket, written files, ranks.

The scenes are random, but the same in every run. `benchmarks/random_scenes.py` runs many more.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from mpi4py import MPI

from fenics_contact import LimitLoad, OutputOptions, limit_load
from tests.bank import BANK
from tests.property.independent import (
    TOLERANCES,
    UNPROVED,
    faults,
    frictionless,
    misses,
    read,
    read_written,
    written_faults,
)
from tests.property.scenes import KINDS, Draw
from tests.property.strategies import draws

alone = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="reads the files of one rank")

#: No example database: the scenes depend on nothing but this file.
BUDGET = settings(
    derandomize=True,
    deadline=None,
    database=None,
    phases=(Phase.explicit, Phase.generate, Phase.shrink),
    suppress_health_check=[HealthCheck.too_slow],
)

#: How well load factors of one state must agree, relative.
AGREED = 1e-5


def answer(draw: Draw) -> tuple[LimitLoad, list[str]]:
    """Solve a scene, write its files, and say what independent programs find wrong with both."""
    scene = draw.recipe().scene(draw.elements)
    scene = replace(scene, output=OutputOptions(pictures=False))
    blocks, result = read(scene), limit_load(scene)
    wrong = faults(blocks, result.status, result.load_factor)
    if result.status == "limit":
        with tempfile.TemporaryDirectory() as folder:
            result.write(folder)
            wrong += written_faults(blocks, Path(folder), result.load_factor)
    return result, wrong


@pytest.mark.slow
@alone
@settings(BUDGET, max_examples=60)
@given(draws())
def test_answer_is_what_independent_programs_and_files_say(draw):
    assert not answer(draw)[1]


@alone
def test_unstable_is_proved():
    """Two collapse states found on one side of the dead load do not prove it."""
    assert not answer(Draw("bond", blocks=2, elements=1, seed=0))[1]


@alone
def test_unstable_scene_is_found_so():
    """HiGHS of scipy 1.10 answers "status 15" where it is asked for any equilibrium here."""
    result, wrong = answer(Draw.of_seed(447))
    assert (result.status, wrong) == ("unstable", [])


@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="needs several ranks")
@pytest.mark.parametrize("kind", KINDS)
def test_ranks_agree_with_one(kind):
    draw = Draw(kind, blocks=9, elements=1, seed=5)
    recipe = draw.recipe()
    scene = recipe.scene(draw.elements, comm=MPI.COMM_SELF)
    single = limit_load(scene)
    together = limit_load(recipe.scene(draw.elements))
    assert len(set(MPI.COMM_WORLD.allgather(repr(together.load_factor)))) == 1
    assert together.status == single.status
    assert not faults(read(scene), together.status, together.load_factor)
    if single.status == "limit":
        assert together.load_factor == pytest.approx(single.load_factor, rel=AGREED)


def test_programs_give_known_bounds():
    for name in ("W1 bracket 0.65", "W3 bracket 0.5"):
        blocks = read(BANK[name].scene(comm=MPI.COMM_SELF))
        assert blocks.largest() == pytest.approx(BANK[name].interval[1], abs=6e-6)
        assert blocks.largest(frictionless(blocks.faces)) == pytest.approx(0.0, abs=1e-9)
        assert blocks.violation() == pytest.approx(0.0, abs=1e-9)


def test_judge_finds_what_is_wrong():
    """A judge that finds nothing proves nothing."""
    blocks = read(BANK["W1 bracket 0.65"].scene(comm=MPI.COMM_SELF))
    assert not faults(blocks, "limit", 0.64)
    assert faults(blocks, "limit", 0.65)
    assert faults(blocks, "unbounded", np.inf)
    assert faults(blocks, "unstable", np.nan) == [UNPROVED]
    hanging = replace(blocks, dead=-blocks.dead)
    assert not faults(hanging, "unstable", np.nan)
    assert faults(hanging, "limit", 0.0)


@alone
def test_judge_finds_what_is_wrong_in_files(folder):
    scene = BANK["W1 coulomb 0.65"].scene()
    limit_load(scene).write(folder)
    blocks = read(scene)
    written = read_written(folder, blocks, 0.6399685556)
    assert not {n: v for n, v in misses(blocks, written).items() if v > TOLERANCES[n]}
    pressed = np.argmax(written.normal)
    more = np.where(np.arange(len(written.normal)) == pressed, 1.001, 1.0)
    apart = written.values | {"gap": written.values["gap"] + 1e-3 * more}
    for part, name in (
        ({"normal": more * written.normal}, "equilibrium"),
        ({"normal": written.normal - 1.0}, "tension"),
        ({"shear": 1.01 * written.shear}, "friction"),
        ({"load_factor": 0.641}, "rigid"),
        ({"values": apart}, "open under pressure"),
    ):
        assert misses(blocks, replace(written, **part))[name] > TOLERANCES[name]
