"""Properties that every scene has: status, bracket, written files, mirror images, units, ranks.

The scenes are random, but the same in every run. With Coulomb friction a scene may have several
collapse states, and a mirrored or scaled one may lead to another of them: rounding decides where
paths fork. Even the same blocks may move in the same way under other joint forces, at another load
factor. So load factors are compared only where both runs end in the same state: the same motion
and the same joint forces. Else both answers are right if both are verified and inside the bracket,
as every answer here must be; but this must be the exception.
`benchmarks/random_scenes.py` runs many more scenes by hand.
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
from tests.bank import BANK, PLAIN, Variant
from tests.property.independent import (
    TOLERANCES,
    UNPROVED,
    Array,
    Blocks,
    faults,
    frictionless,
    misses,
    read,
    read_vtu,
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

#: Joint forces of one state agree to this part of the largest.
SAME_FORCES = 1e-3

#: Share of scenes that must end in the same state however they are written.
USUALLY = 0.8

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

    def points(self, mirrored: bool = False) -> tuple[Array, Array]:
        """The joint points of all facets, one after the other.

        Returns:
            Middles of facets and these points, over the structure's size, shape (2 facets, 4), and
            normal force, size of the shear force, both over the largest force, and state, (2
            facets, 3).
        """
        lines = self.files["connectivity"].astype(int).ravel()
        points = self.files["points"][lines, :2] / self.blocks.size
        points = points * [-1.0 if mirrored else 1.0, 1.0]
        middles = np.repeat(points.reshape(-1, 2, 2).mean(axis=1), 2, axis=0)
        force, normal = (self.files[name][lines] for name in ("force", "normal"))
        parts = np.sum(force * normal, axis=1), np.linalg.norm(np.cross(force, normal), axis=1)
        largest = np.linalg.norm(force, axis=1).max() or 1.0
        states = np.repeat(self.files["state"], 2)
        values = np.column_stack([*parts, largest * states]) / largest
        return np.hstack([middles, points]), values


def answer(draw: Draw, variant: Variant = PLAIN) -> Answer:
    """Solve a scene, write its files and judge both."""
    scene = draw.recipe().scene(draw.elements, variant=variant)
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
    """Whether all joints of two runs open, slip and stick alike, under the same forces."""
    places, values = one.points()
    theirs, others = other.points(mirrored)
    far, which = cKDTree(theirs).query(places)
    assert far.max() < 1e-6  # the same facets
    return bool(np.abs(values - others[which]).max() <= SAME_FORCES)


def compared(draw: Draw, variant: Variant) -> bool:
    """Whether a scene and the same written otherwise end in one state; both must be right."""
    plain, other = answer(draw), answer(draw, variant)
    assert not plain.wrong and not other.wrong
    statuses = {plain.result.status, other.result.status}
    if "unstable" in statuses:
        assert statuses <= {"unstable", "not_converged"}
    if statuses != {"limit"} or not same_state(plain, other, variant.mirrored):
        return len(statuses) == 1 and statuses != {"limit"}
    size = max(abs(plain.result.load_factor), 1e-3 * plain.blocks.typical)
    factors = plain.result.load_factor, other.result.load_factor
    assert abs(factors[0] - factors[1]) <= AGREED * size, factors
    return True


@pytest.mark.slow
@alone
@settings(BUDGET, max_examples=60)
@given(draws())
def test_answer_is_what_independent_programs_and_files_say(draw):
    assert not answer(draw).wrong


@alone
def test_unstable_is_proved():
    """Two collapse states found on one side of the dead load do not prove it."""
    assert not answer(Draw("bond", blocks=2, elements=1, seed=0)).wrong


@alone
def test_unstable_scene_is_found_so():
    """HiGHS of scipy 1.10 answers "status 15" where it is asked for any equilibrium here."""
    found = answer(Draw.of_seed(447))
    assert (found.result.status, found.wrong) == ("unstable", [])


@pytest.mark.slow
@alone
def test_mirror_image_has_the_mirrored_answer():
    agreed = []

    @settings(BUDGET, max_examples=15)
    @given(draws(most=16))
    def compare(draw):
        agreed.append(compared(draw, Variant(mirrored=True)))

    compare()
    assert np.mean(agreed) >= USUALLY


@pytest.mark.slow
@alone
def test_units_change_nothing():
    agreed = []

    @settings(BUDGET, max_examples=15)
    @given(draws(most=16))
    def compare(draw):
        agreed.append(compared(draw, UNITS[draw.seed % len(UNITS)]))

    compare()
    assert np.mean(agreed) >= USUALLY


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
