"""Work that a scene does not need is not done, and the answer is the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fenics_contact import (
    JointLaw,
    Scene,
    SolveOptions,
    limit_load,
)
from fenics_contact.analysis.coulomb import CoulombFriction
from fenics_contact.analysis.plan import FIXED_POINT
from fenics_contact.analysis.rigid_blocks import RigidBlocks
from fenics_contact.discretization.discretization import Structure
from fenics_contact.solvers.arclength import CentralPath
from fenics_contact.solvers.block_modes import BlockModes
from fenics_contact.solvers.interior_point import WorkControl
from fenics_contact.solvers.joint_stiffness import SpringStiffness
from tests.helpers import PUSH, WEIGHT, coulomb, on_ground, tresca
from tests.regression.scenes import wall_scene

SMOOTH = JointLaw("frictionless")


def wall(law: JointLaw, **rest: object) -> Scene:
    return replace(wall_scene("W1", law, elements=1), **rest)


class Calls:
    """Counts the calls of a method, or forbids them."""

    def __init__(self, monkeypatch, owner, name, forbid=False):
        self.count, original = 0, getattr(owner, name)

        def called(*args, **options):
            assert not forbid, f"{name} is not needed"
            self.count += 1
            return original(*args, **options)

        monkeypatch.setattr(owner, name, called)


def test_given_friction_is_solved_once(monkeypatch):
    Calls(monkeypatch, CoulombFriction, "_monolithic", forbid=True)
    solves = Calls(monkeypatch, CoulombFriction, "_given_friction")
    result = limit_load(wall(tresca(2000.0)))
    assert result.load_factor == pytest.approx(0.19048, abs=5e-6)
    assert solves.count == len(result.positive.history)
    assert [len(history.steps) for history in result.positive.history] == [1] * solves.count


def test_state_that_attracts_the_fixed_point_needs_no_iteration(monkeypatch):
    iterated = limit_load(wall(coulomb(0.65), solve=SolveOptions(method="fixed-point")))
    Calls(monkeypatch, CoulombFriction, "_given_friction", forbid=True)
    result = limit_load(wall(coulomb(0.65)))
    assert result.load_factor == pytest.approx(iterated.load_factor, rel=1e-5)
    assert f"{FIXED_POINT}: the monolithic step alone found the state" in result.skipped
    assert result.factorizations < iterated.factorizations / 3
    assert not any(item.startswith(FIXED_POINT) for item in iterated.skipped)


def test_state_that_repels_the_fixed_point_is_iterated_for(monkeypatch):
    at_once = limit_load(wall(coulomb(0.65)))
    monkeypatch.setattr(CoulombFriction, "_follow", lambda *_, **__: None)
    monkeypatch.setattr(WorkControl, "repels", lambda *_: True)
    result = limit_load(wall(coulomb(0.65)))
    assert result.load_factor == pytest.approx(at_once.load_factor, rel=1e-6)
    assert len(result.positive.history[0].steps) > 3
    assert not any(item.startswith(FIXED_POINT) for item in result.skipped)


def test_fixed_point_where_the_path_leads_nowhere(monkeypatch):
    monkeypatch.setattr("fenics_contact.analysis.work_control.COARSE", 0)
    monkeypatch.setattr("fenics_contact.solvers.arclength.MAX_STEPS", 0)
    monkeypatch.setattr(CoulombFriction, "_monolithic", lambda *_, **__: None)
    result = limit_load(wall_scene("W3", coulomb(0.65)))
    assert result.load_factor == pytest.approx(0.35582, abs=5e-6)
    assert len(result.positive.history[0].steps) > 3
    assert not any(item.startswith(FIXED_POINT) for item in result.skipped)


def test_few_blocks_need_neither_modes_nor_path(monkeypatch):
    Calls(monkeypatch, BlockModes, "build", forbid=True)
    Calls(monkeypatch, CentralPath, "follow", forbid=True)
    Calls(monkeypatch, CoulombFriction, "_given_friction", forbid=True)
    result = limit_load(wall_scene("W3", coulomb(0.65)))
    assert result.load_factor == pytest.approx(0.35582, abs=5e-6)
    assert result.mode_factorizations == 0


def test_what_few_blocks_find_counts_only_if_it_attracts_the_fixed_point(monkeypatch):
    monkeypatch.setattr(WorkControl, "repels", lambda *_: True)
    result = limit_load(wall_scene("W3", coulomb(0.65)))
    assert result.load_factor == pytest.approx(0.35582, abs=5e-6)
    assert result.mode_factorizations > 0


@pytest.mark.parametrize(("limit", "least"), [("FEW_BLOCKS", 45), ("COARSE", 10)])
def test_more_blocks_and_finer_meshes_begin_with_modes(monkeypatch, limit, least):
    monkeypatch.setattr(f"fenics_contact.analysis.work_control.{limit}", least)
    Calls(monkeypatch, WorkControl, "directly", forbid=True)
    result = limit_load(wall_scene("W3", coulomb(0.65)))
    assert len(result.structure.bodies.centre) == 46
    assert result.mode_factorizations > 0


def test_state_past_a_fold_needs_no_iteration(monkeypatch):
    monkeypatch.setattr("fenics_contact.analysis.work_control.FEW_BLOCKS", 0)
    Calls(monkeypatch, CoulombFriction, "_given_friction", forbid=True)
    Calls(monkeypatch, WorkControl, "repels", forbid=True)
    result = limit_load(wall_scene("W3", coulomb(0.65)))
    assert result.load_factor == pytest.approx(0.35582, abs=5e-6)
    assert len(result.positive.history[0].steps) == 1


def test_one_block_takes_one_solve():
    """Statically determinate: nothing to iterate for."""
    scene = on_ground(wall_mesh(), coulomb(0.3), live=PUSH, dead=WEIGHT)
    result = limit_load(scene)
    assert result.load_factor == pytest.approx(0.3, rel=1e-6)
    assert [len(history.steps) for history in result.positive.history] == [1]


def wall_mesh():
    from fenics_contact.meshing import wall

    return wall([[1]], elements=2)


def test_joints_without_friction_have_no_shear(monkeypatch):
    largest = []
    original = SpringStiffness.factor

    def factor(self, normal, tangential, coupling=None):
        largest.append(float(np.max(tangential, initial=0.0)) / self.mean_diagonal)
        return original(self, normal, tangential, coupling)

    monkeypatch.setattr(SpringStiffness, "factor", factor)
    # Leaning on friction nowhere: a block on rollers would slide at once.
    result = limit_load(wall(SMOOTH))
    assert result.load_factor == pytest.approx(0.0, abs=1e-6)
    assert np.all(result.positive.state.shear == 0.0)
    # The first factor is the bonded one.
    assert max(largest[1:]) < 1e-3


@pytest.mark.parametrize("direction", ["positive", "negative"])
def test_other_direction_is_not_looked_at(direction, monkeypatch):
    both = limit_load(wall(coulomb(0.65), solve=SolveOptions(direction="both")))
    turned = Calls(monkeypatch, Structure, "reversed")
    result = limit_load(wall(coulomb(0.65), solve=SolveOptions(direction=direction)))
    assert turned.count == (direction == "negative")
    assert (result.positive is None) == (direction == "negative")
    if direction == "positive":
        assert result.load_factor == pytest.approx(both.load_factor, rel=1e-9)
    else:
        assert result.load_factor_negative == pytest.approx(both.load_factor_negative, rel=1e-9)
    assert result.factorizations < both.factorizations


def test_state_is_linearised_once(monkeypatch):
    """Whether it attracts the fixed point, and its mode, come from one factor."""
    made = Calls(monkeypatch, SpringStiffness, "factor")
    result = limit_load(wall(coulomb(0.65)))
    steps = result.positive.history[0].steps[0].factorizations
    assert len(result.positive.history) == 1
    assert made.count == 1 + steps + 1  # bonded, the steps, the mode


@pytest.mark.parametrize(
    ("law", "method", "kinds"),
    [
        (coulomb(0.65), "auto", ["lu"]),
        (coulomb(0.65), "monolithic", ["lu"]),
        (coulomb(0.65), "fixed-point", ["cholesky"]),
        (tresca(2e3), "auto", ["cholesky"]),
    ],
)
def test_scene_is_analysed_once(law, method, kinds, monkeypatch):
    """The bonded blocks with what the solver needs afterwards, and alike to rounding."""
    analysed, new_factor = [], SpringStiffness._new_factor

    def noted(self, kind):
        analysed.append(kind)
        return new_factor(self, kind)

    monkeypatch.setattr(SpringStiffness, "_new_factor", noted)
    result = limit_load(wall(law, solve=SolveOptions(method=method)))
    assert result.status == "limit"
    assert analysed == kinds
    plain, coupled = (result.structure.bonded(coupled) for coupled in (False, True))
    for name in ("dead", "live"):
        one, other = getattr(plain, name).array_r, getattr(coupled, name).array_r
        assert one == pytest.approx(other, abs=1e-9 * np.abs(one).max())


def test_mode_that_certifies_needs_no_program(monkeypatch):
    """The static and kinematic load factors meet without it, where the program says."""
    certified = limit_load(wall(coulomb(0.65)))
    certificate = certified.positive.certificate
    blocks = RigidBlocks(
        certified.structure.joints, certified.structure.bodies, certified.scene.comm
    )
    problem = certified.structure.problem
    bound = certified.structure.all_points(problem.bound(certified.positive.state.pressure))
    assert blocks.collapse(bound)[0] == pytest.approx(certified.load_factor, rel=1e-6)
    assert certificate.static_factor == certified.load_factor
    assert certificate.kinematic_factor == pytest.approx(certified.load_factor, rel=1e-6)
    Calls(monkeypatch, RigidBlocks, "collapse", forbid=True)
    again = limit_load(wall(coulomb(0.65)))
    assert again.load_factor == pytest.approx(certified.load_factor, rel=1e-9)
