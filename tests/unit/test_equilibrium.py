"""States at a given load factor: found, mirrored, in steps, and refused where there is none."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import (
    BlockMesh,
    InputError,
    JointLaw,
    Load,
    Material,
    Movement,
    Scene,
    SolveOptions,
    SolverError,
    equilibrium,
    limit_load,
    stands,
)
from fenics_contact.collapse import service_state
from fenics_contact.equilibrium import standing
from fenics_contact.limit_load import Monitor
from fenics_contact.meshing import polygons
from fenics_contact.output.report import write_report
from tests.bank import BANK, GRAVITY, block_recipe, coulomb, sides, wall_recipe
from tests.drawing import rectangle

BLOCK = block_recipe(0.4, 1.0, 0.3)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("method", "name"), [("auto", "W3 coulomb 0.65"), ("fixed-point", "block 0.7")]
)
def test_wall_below_its_limit_load_is_in_equilibrium(method, name):
    found = equilibrium(BANK[name].scene(elements=2, method=method), 0.3)
    assert (found.status, found.reason, found.load_factor) == ("equilibrium", "", 0.3)
    assert max(found.residuals.values()) < 1e-6
    base = found.joints["blocks"][:, 0] < 0
    forces = found.joints["force"][base].sum(axis=0)
    weight = found.blocks["dead_load"].sum(axis=0)[1]
    assert forces == pytest.approx([0.3 * weight, -weight], rel=1e-8)
    assert found.blocks["displacement"].shape == found.blocks["centre"].shape
    assert repr(found) == "<Equilibrium: equilibrium, load factor 0.3>"
    assert MPI.COMM_WORLD.allreduce(float(np.abs(found.displacement.x.array).max())) > 0.0


def test_reversed_load_mirrors_the_state():
    there, back = (equilibrium(BLOCK.scene(2), factor) for factor in (0.2, -0.2))
    assert back.load_factor == back.state.load_factor == -0.2
    assert there.state.work == pytest.approx(-back.state.work, rel=1e-2)  # so is not the mesh
    shear = [found.joints["shear"] @ found.joints["length"] for found in (there, back)]
    assert shear[1] == pytest.approx(-shear[0], rel=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize(("factor", "carried"), [(0.30001, 0.3), (1e6, 0.3), (-0.31, -0.3)])
def test_load_that_is_proved_too_large_costs_no_factorisation(factor, carried):
    found = equilibrium(BLOCK.scene(2), factor)
    assert found.status == "no_equilibrium" and found.load_factor == factor
    assert found.reason == f"with associative friction rigid blocks carry {carried} at most"
    assert found.factorizations == 0


def test_dead_load_that_falls_costs_no_factorisation():
    found = equilibrium(BANK["sliding stack -0.001"].scene(1), 0.0)
    assert found.status == "unstable" and found.falling.tolist() == [0, 1]
    alone = "there is no equilibrium under the dead load alone: blocks 0 at (0.25, 0.1), 1 at"
    assert found.reason.startswith(alone)
    assert found.factorizations == 0


def test_dead_load_that_falls_carries_no_live_load_either():
    found = equilibrium(BANK["sliding stack -0.001"].scene(1), 0.1)
    assert found.status == "no_equilibrium"
    assert found.reason.endswith("rigid blocks do not stand under the dead load alone")


@pytest.mark.mpi
@pytest.mark.parametrize(("name", "answer"), [("block 0.7", True), ("sliding stack -0.001", False)])
def test_does_it_stand(name, answer):
    assert stands(BANK[name].scene(1)) is answer


@pytest.mark.mpi
@pytest.mark.parametrize("factor", [0.0, 0.29, -0.29])
def test_state_of_joint_faces_with_strained_blocks(factor):
    """A block 1.0 m wide and 0.4 m high with friction 0.3: N = W, T = factor W, N e = T 0.2 m."""
    scene = block_recipe(1.0, 0.4, 0.3).scene(2)
    found = standing(scene, factor)
    assert (found.status, found.engine, found.proved) == ("equilibrium", "faces", True)
    assert found.load_factor == factor and found.factorizations <= 2
    weight = -found.blocks["dead_load"].sum(axis=0)[1]
    base = found.joints["blocks"][:, 0] < 0
    force = found.joints["force"][base]
    assert force.sum(axis=0) == pytest.approx([-factor * weight, weight], rel=1e-7, abs=1e-6)
    centre = found.blocks["centre"][0, 0]
    moment = force[:, 1] @ (found.joints["position"][base][:, 0] - centre)
    assert moment == pytest.approx(0.2 * factor * weight, rel=1e-6, abs=1e-3)
    assert "by the forces of joint faces" in found.summary(verbose=True)


def test_faces_answer_where_the_search_on_elastic_blocks_finds_none(monkeypatch):
    def lost(*arguments):
        raise SolverError("lost")

    monkeypatch.setattr(service_state, "raise_load_to", lost)
    found = equilibrium(BLOCK.scene(2), 0.2)
    assert (found.status, found.engine) == ("equilibrium", "faces")
    base = found.joints["blocks"][:, 0] < 0
    weight = -found.blocks["dead_load"].sum(axis=0)[1]
    assert found.joints["force"][base].sum(axis=0) == pytest.approx([-0.2 * weight, weight])


def test_where_a_support_moves_elastic_blocks_are_asked():
    moved = Load(body=(0.0, -GRAVITY), movement={"base": Movement(displacement=(0.0, -0.001))})
    found = standing(replace(BLOCK.scene(2), dead=moved))
    assert (found.status, found.engine) == ("equilibrium", "path")


WEIGHT, LIFT = Load(body=(0.0, -9.81)), Load(body=(0.0, 9.81))
HELD = "not known, held by self-stress if at all"
LOW, HIGH, WIDE = (rectangle(0.0, y, 1.0, y + h) for y, h in ((0.0, 0.5), (0.5, 0.5), (0.0, 0.8)))
NARROWED = [(0.0, 0.0), (1.0, 0.0), (0.9, 0.5), (0.1, 0.5)]


@pytest.mark.parametrize(
    ("blocks", "friction", "live"),
    [
        pytest.param([LOW], 0.5, (0.0, 9.81), id="lifted"),
        pytest.param([LOW], 0.2, (9.81, 0.0), id="pushed", marks=pytest.mark.slow),
        pytest.param([LOW], 0.9, (0.0, -9.81), id="weighed down", marks=pytest.mark.slow),
        pytest.param([LOW, HIGH], 0.6, (9.81, 0.0), id="two blocks", marks=pytest.mark.slow),
        pytest.param([WIDE], 0.3, (-9.81, 3.0), id="pushed up", marks=pytest.mark.slow),
        pytest.param(
            [NARROWED], 0.5, (9.81, 0.0), id="under leaning walls", marks=pytest.mark.slow
        ),
    ],
)
def test_what_only_self_stress_could_hold_has_one_word(blocks, friction, live):
    """Blocks between two walls that nothing presses on them fall, unlike associative ones."""
    scene = between_walls(WEIGHT, blocks, friction, Load(body=live))
    at_rest, pushed, limit = equilibrium(scene, 0.0), equilibrium(scene, 1.0), limit_load(scene)
    for found in (at_rest, pushed, limit):
        assert found.status == "no_equilibrium" and found.factorizations <= 100
    assert at_rest.reason == pushed.reason == limit.reason() and limit.reason().endswith(HELD)
    assert not at_rest.proved and np.isnan(limit.load_factor) and limit.peak is None
    assert (standing(scene).status, standing(scene, 1.0).status) == ("no_equilibrium",) * 2
    with pytest.raises(SolverError, match=f"neither a state nor a proof.*{HELD}"):
        stands(scene)
    both = limit_load(replace(scene, solve=SolveOptions(direction="both")))
    assert (both.status, both.reason()) == ("no_equilibrium", limit.reason())


@pytest.mark.parametrize(("pressed", "answer"), [(1.05, True), (0.95, False)])
def test_a_block_pressed_on_a_rough_wall_stands_by_its_friction(pressed, answer):
    """F p h against the weight, where friction alone holds; lifted, it slides at W + F p h."""
    thrust = pressed * 1000.0 * 9.81 * 0.5 / (0.5 * 0.5)  # Pa: F = 0.5, h = 0.5 m
    dead = replace(WEIGHT, traction={"left": (thrust, 0.0)})
    scene = between_walls(dead, [LOW], walls=("right",))
    assert stands(scene) is answer and equilibrium(scene, 0.0).proved
    lifted = limit_load(scene)
    assert lifted.status == ("limit" if answer else "unstable")
    assert not answer or lifted.load_factor == pytest.approx(1.0 + pressed, rel=1e-6)


def between_walls(dead, blocks=(LOW,), friction=0.5, live=LIFT, walls=("left", "right")):
    """Blocks whose left and right sides are against rigid walls."""
    left, right = ([(one[a], one[b]) for one in blocks] for a, b in ((0, 3), (1, 2)))
    model = polygons(blocks, 0.25, groups={"left": left, "right": right})
    law = JointLaw(friction=friction)
    material = Material(young=1e9, poisson=0.2, density=1000.0)
    mesh, ground = BlockMesh.from_model(model), dict.fromkeys(walls, law)
    joints = {"default": law} if len(blocks) > 1 else {}
    return Scene(mesh, {"default": material}, live, dead, joints=joints, foundations=ground)


#: Blocks, the sides that are held, loaded and moved, the movement, m, and p = E u / L, Pa.
UPRIGHT = [rectangle(0.0, y, 2.0, y + 2.0) for y in (0.0, 2.0, 4.0)]
ASIDE = [rectangle(x, 0.0, x + 2.0, 2.0) for x in (0.0, 2.0)]
PRESSES = {
    "two": (UPRIGHT[:2], (0, 0, 2, 0), (0, 2, 0, 4), (0, 4, 2, 4), (0.0, -0.02), 1000.0),
    "vice": (ASIDE, (0, 0, 0, 2), (2, 2, 4, 2), (4, 0, 4, 2), (-0.04, 0.0), 2000.0),
    "three": (UPRIGHT, (0, 0, 2, 0), (0, 4, 0, 6), (0, 6, 2, 6), (0.0, -0.03), 1000.0),
    "apart": (UPRIGHT[:2], (0, 0, 2, 0), (0, 2, 0, 4), (0, 4, 2, 4), (0.0, 0.02), 0.0),
}


@pytest.mark.parametrize("name", PRESSES)
def test_blocks_pressed_by_a_fixed_support_that_moves(name):
    """No block is free to be pushed by the live load, but in the middle of three."""
    blocks, held, loaded, moved, by, pressure = PRESSES[name]
    groups = sides(held=held, loaded=loaded, moved=moved)
    mesh = BlockMesh.from_model(polygons(blocks, 0.5, groups=groups))
    material = Material(young=2e5, poisson=0.0, density=0.0)
    live = Load(traction={"loaded": (1.0, 0.0) if by[1] else (0.0, -1.0)})
    dead = Load(movement={"moved": Movement(displacement=by)})
    joints, supports = {"default": JointLaw(friction=0.3)}, {"held": "fixed", "moved": "fixed"}
    scene = Scene(mesh, {"default": material}, live, dead, joints=joints, supports=supports)
    found = equilibrium(scene, 0.0)
    assert found.status == "equilibrium" and stands(scene)
    assert found.joints["pressure"] == pytest.approx(pressure, rel=1e-6, abs=1e-6)
    with pytest.raises(InputError, match="the live load is zero on every free body"):
        limit_load(scene)


@pytest.mark.mpi
def test_summary_of_a_state_has_its_verification_joints_and_cost():
    found = equilibrium(BLOCK.scene(2), 0.2)
    assert found.summary() == "it stands at 0.2 g to the right (verified)"
    told, _, first, verified, joints, cost = found.summary(verbose=True).splitlines()
    assert told == found.summary()
    assert first == "equilibrium at load factor 0.2"
    assert verified.startswith("verified: equilibrium ") and "friction" in verified
    assert joints == "joint points: 4 stick, 0 slip, 1 open"
    assert cost.split()[1] == "factorisations,"
    beyond = equilibrium(BLOCK.scene(2), 0.4)
    assert beyond.summary() == "it does not stand at 0.4 g to the right"
    more = "no equilibrium at load factor 0.4: with associative friction"
    assert more in beyond.summary(verbose=True)


@pytest.mark.mpi
def test_files_of_a_state(tmp_path):
    folder = MPI.COMM_WORLD.bcast(tmp_path) / "state"
    scene = BLOCK.scene(2)
    found = equilibrium(scene, 0.2)
    found.write(str(folder))
    record = json.loads((folder / "result.json").read_text())
    assert (record["status"], record["load_factor"]) == ("equilibrium", 0.2)
    assert record["residuals"]["friction"] <= record["tolerances"]["friction"]
    assert record["scene"]["loads"]["dead"]["body"] and record["falling_blocks"] == []
    pictures = {"state.png", "thrust.png", "stress.png", "joints.vtu", "blocks.pvd"}
    assert pictures <= set(record["files"])
    text = (folder / "joints.vtu").read_text()
    assert '"displacement"' in text and '"state"' in text and "collapse_mode" not in text
    with pytest.raises(InputError, match="a state at a given load factor"):
        write_report(folder)


def test_files_of_a_fall(tmp_path):
    scene = BANK["sliding stack -0.001"].scene(1)
    equilibrium(scene, 0.0).write(tmp_path)
    record = json.loads((tmp_path / "result.json").read_text())
    assert (record["status"], record["falling_blocks"]) == ("unstable", [0, 1])
    assert record["files"] == ["collapse.png"]


def test_where_associative_friction_proves_nothing_the_state_is_only_not_found():
    scene = wall_recipe("3x4", coulomb(0.9)).scene(1)
    found = equilibrium(scene, 0.7)  # 0.636, associative 0.826
    assert (found.status, found.state) == ("not_converged", None)
    assert found.reason.startswith("equilibrium was found up to a load factor of 0.63")


def test_steps_matter_where_slip_is_counted_by_step():
    scene = BANK["W3 coulomb 0.65"].scene(elements=2)
    by_step = replace(scene, solve=SolveOptions(control="load", slip="load-steps"))
    once, again = (equilibrium(scene, 0.3, steps) for steps in (1, 4))
    assert again.state.work == pytest.approx(once.state.work, rel=1e-6)
    works = [equilibrium(by_step, 0.3, steps).state.work for steps in (1, 4)]
    assert abs(works[1] / works[0] - 1.0) > 1e-6


def test_dead_load_alone_and_live_load_alone():
    scene = BLOCK.scene(2)
    alone = equilibrium(scene, 0.0)
    as_live = equilibrium(replace(scene, dead=Load(), live=scene.dead))
    assert alone.status == as_live.status == "equilibrium"
    assert as_live.joints["pressure"] == pytest.approx(alone.joints["pressure"], rel=1e-8)


def test_other_direction_is_not_solved_where_the_dead_load_is_in_equilibrium():
    heard = set()

    class Listener(Monitor):
        def step(self, direction, step):
            heard.add(direction)

    result = limit_load(BANK["arch 15 0.15"].scene(), Listener())
    assert result.status == "limit" and heard == {"positive"}


@pytest.mark.parametrize(("factor", "steps"), [(float("nan"), 1), (float("inf"), 1), (0.1, 0)])
def test_numbers_that_cannot_be_meant(factor, steps):
    with pytest.raises(InputError):
        equilibrium(BLOCK.scene(1), factor, steps)
