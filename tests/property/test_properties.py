"""Properties that every scene has: status, bracket, written files, mirror images, units, ranks.

The scenes are random, but the same in every run. With Coulomb friction a scene may have several
collapse states, and a mirrored or scaled one may lead to another of them: the path to a state
depends on rounding where it forks. So load factors are compared only where both runs end in the
same state of all joints; else both answers are right if both are verified and inside the bracket,
which every answer here must be. `benchmarks/random_scenes.py` runs many more scenes by hand.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from mpi4py import MPI
from scipy.spatial import cKDTree

from fenics_contact import LimitLoad, OutputOptions, limit_load
from tests.bank import PLAIN, Variant
from tests.property import independent
from tests.property.independent import Array, Blocks, faults, read, read_vtu, written_faults
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

#: Asked for, and how well load factors of one state must agree then; both relative.
EXACT, AGREED = 1e-9, 1e-6

#: Ways to write a scene that change nothing but rounding.
UNITS = [
    Variant(length=1e-3),
    Variant(young=1e3),
    Variant(length=1e3, force=1e9),
]


@dataclass(frozen=True)
class Answer:
    """A limit load, judged.

    Attributes:
        result: From `limit_load`.
        blocks: The scene as the independent programs see it.
        wrong: What they find.
        files: Arrays of joints.vtu; empty without a limit load.
    """

    result: LimitLoad
    blocks: Blocks
    wrong: list[str]
    files: dict[str, Array]

    @property
    def states(self) -> tuple[Array, Array]:
        """Middles of the joints' facets, over the structure's size, and sums of their states."""
        lines = self.files["connectivity"].astype(int).reshape(-1, 2)
        middle = self.files["points"][lines, :2].mean(axis=1)
        return middle / self.blocks.size, self.files["state"][lines].sum(axis=1)


def answer(draw: Draw, variant: Variant = PLAIN) -> Answer:
    """Solve a scene, write its files and judge both."""
    scene = draw.recipe().scene(draw.elements, variant=variant, tolerance=EXACT)
    scene = replace(scene, output=OutputOptions(pictures=False))
    blocks, result = read(scene), limit_load(scene)
    wrong, files = faults(blocks, result.status, result.load_factor), {}
    if result.status == "limit":
        with tempfile.TemporaryDirectory() as folder:
            result.write(folder)
            wrong += written_faults(blocks, Path(folder), result.load_factor)
            files = read_vtu(Path(folder) / "joints.vtu")
    return Answer(result, blocks, wrong, files)


def same_state(one: Answer, other: Answer, mirrored: bool) -> bool:
    """Whether all joints of two runs open, slip and stick alike."""
    places, states = one.states
    theirs, others = other.states
    _, which = cKDTree(theirs * [-1.0 if mirrored else 1.0, 1.0]).query(places)
    return bool(np.array_equal(states, others[which]))


def compare(draw: Draw, variant: Variant) -> None:
    """A scene and the same written otherwise have the same answer, or two that are right."""
    plain, other = answer(draw), answer(draw, variant)
    assert not plain.wrong and not other.wrong
    statuses = {plain.result.status, other.result.status}
    if "unstable" in statuses:
        assert statuses <= {"unstable", "not_converged"}
    if statuses == {"limit"} and same_state(plain, other, variant.mirrored):
        size = max(abs(plain.result.load_factor), 1e-3 * plain.blocks.typical)
        factors = plain.result.load_factor, other.result.load_factor
        assert abs(factors[0] - factors[1]) <= AGREED * size, factors


@alone
@settings(BUDGET, max_examples=60)
@given(draws())
def test_answer_is_what_independent_programs_and_files_say(draw):
    assert not answer(draw).wrong


@alone
@settings(BUDGET, max_examples=15)
@given(draws(most=16))
def test_mirror_image_has_the_mirrored_answer(draw):
    compare(draw, Variant(mirrored=True))


@alone
@settings(BUDGET, max_examples=15)
@given(draws(most=16))
def test_units_change_nothing(draw):
    compare(draw, UNITS[draw.seed % len(UNITS)])


@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size == 1, reason="needs several ranks")
@pytest.mark.parametrize("kind", KINDS)
def test_ranks_agree_with_one(kind):
    draw = Draw(kind, blocks=9, elements=1, seed=5)
    recipe = draw.recipe()
    scene = recipe.scene(draw.elements, comm=MPI.COMM_SELF, tolerance=EXACT)
    single = limit_load(scene)
    together = limit_load(recipe.scene(draw.elements, tolerance=EXACT))
    assert len(set(MPI.COMM_WORLD.allgather(repr(together.load_factor)))) == 1
    assert together.status == single.status
    assert not faults(read(scene), together.status, together.load_factor)
    if single.status == "limit":
        assert together.load_factor == pytest.approx(single.load_factor, rel=AGREED)


def test_judge_finds_what_is_wrong():
    """A judge that finds nothing proves nothing."""
    scene = Draw("stack", blocks=4, elements=1, seed=1).recipe().scene(1)
    blocks = read(scene)
    upper = blocks.largest()
    assert upper is not None and 0.0 < upper < np.inf
    assert not faults(blocks, "limit", upper)
    assert faults(blocks, "limit", 1.01 * upper)
    assert faults(blocks, "unbounded", np.inf)
    assert faults(blocks, "unstable", np.nan) == [independent.UNPROVED]
    hanging = replace(blocks, dead=-blocks.dead)
    assert not faults(hanging, "unstable", np.nan)
    assert faults(hanging, "limit", 0.0)
