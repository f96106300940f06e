"""Blocks that only move, stretch and bend: the reduced structure, and where its path leads."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from fenics_contact import SolveOptions, SolverError, limit_load
from fenics_contact.solvers.block_modes import LOCAL, MODES, RIGID, BlockModes, modes
from fenics_contact.solvers.arclength import CentralPath
from fenics_contact.solvers.nonlinear_elimination import FewPoints
from fenics_contact.solvers.interior_point import (
    AGAIN,
    FEW_BLOCKS,
    TRANSFERS,
    WANDERING,
    PathPoint,
    WorkControl,
    _InteriorPoint,
)
from fenics_contact.meshing import wall
from fenics_contact.solvers.kkt import State
from fenics_contact.analysis.work_control import FIRST_WORK
from fenics_contact.discretization.discretization import Structure
from tests.helpers import (
    Loaded,
    coulomb,
    dense,
    joint_rows,
    node_bodies,
    node_positions,
    on_ground,
    three_blocks,
    tresca,
    vector_like,
    whole,
)
from tests.regression.scenes import wall_scene


@pytest.fixture(scope="module", params=["ground", "inclined roller"])
def structure(request) -> Structure:
    return three_blocks(request.param, elements=2, left="fixed")


@pytest.fixture(scope="module")
def folded() -> Loaded:
    """A wall whose path turns back."""
    return Loaded.of(wall_scene("W3", coulomb(0.65), elements=2))


def basis(structure: Structure) -> np.ndarray:
    return dense(structure.block_modes.basis)


def from_modes(loaded: Loaded) -> tuple[WorkControl, PathPoint]:
    start, scales = loaded.start(FIRST_WORK)
    structure = loaded.structure
    control = WorkControl(structure.problem, structure.springs, lambda: structure.block_modes)
    return control, control.from_modes(start.work, start, scales, 1e-9, 1e-9)


# ---- modes


def test_modes_are_rigid_motions_strains_and_bendings():
    arm = np.random.default_rng(1).normal(size=(5, 2))
    x, y = arm.T
    shapes = modes(arm)
    # Central differences of quadratics are exact.
    step = 0.1
    gradient = np.stack(
        [(modes(arm + d) - modes(arm - d)) / (2.0 * step) for d in step * np.eye(2)], axis=2
    )  # (points, component, direction, mode)
    strain = 0.5 * (gradient + np.swapaxes(gradient, 1, 2))
    none, one = np.zeros(5), np.ones(5)
    expected = {
        (0, 0): [none, none, none, one, none, none, y, none],
        (1, 1): [none, none, none, none, one, none, none, x],
        (0, 1): [none, none, none, none, none, one, none, none],
    }
    for (i, j), columns in expected.items():
        assert strain[:, i, j] == pytest.approx(np.transpose(columns), abs=1e-12)
    assert shapes[:, :, 2] == pytest.approx(np.column_stack([-y, x]))


def test_columns_are_orthonormal_or_zero_and_of_one_block_each(structure):
    columns, body = basis(structure), np.repeat(node_bodies(structure), 2)
    product = columns.T @ columns
    is_mode = np.diag(product) > 0.5
    assert product == pytest.approx(np.diag(is_mode.astype(float)), abs=1e-12)
    assert is_mode.sum() >= len(is_mode) - MODES
    for column, values in enumerate(columns.T):
        assert set(body[values != 0.0]) <= {column // MODES}


def test_linear_displacements_of_free_blocks_are_in_their_span(structure):
    touched = np.zeros(structure.block_modes.count, dtype=bool)
    touched[structure.supports.body] = True
    body = node_bodies(structure)
    free = ~touched[body]
    assert np.any(free)
    position = node_positions(structure.elasticity.space)
    random = np.random.default_rng(2)
    slope, shift = random.normal(size=(2, 2)), random.normal(size=(touched.size, 2))
    u = np.where(free[:, None], position @ slope + shift[body], 0.0).ravel()
    columns = basis(structure)
    assert columns @ (columns.T @ u) == pytest.approx(u, abs=1e-12 * np.abs(u).max())


def test_what_is_held_does_not_move(structure):
    supports = structure.supports
    held = (2 * supports.nodes[:, None] + np.arange(2))[supports.held]
    assert np.all(basis(structure)[held] == 0.0)


def test_a_block_on_few_nodes_or_held_has_fewer_modes():
    """A single triangle has six displacements; a fixed one none that are free."""
    loaded = Structure.build(on_ground(wall([[1]], elements=1), coulomb(0.5)))
    problem = loaded.problem
    nodes = problem.dead.getLocalSize() // 2
    shapes = modes(loaded.elasticity.space.tabulate_dof_coordinates()[:nodes, :2])
    owned = np.arange(nodes) + problem.dead.getOwnershipRange()[0] // 2
    body = np.zeros(nodes, dtype=np.int32)
    sides = loaded.joints.bodies[loaded.operators.points]
    for kept, expected in ((3, 6), (1, 2), (0, 0)):
        some = np.where((owned < kept)[:, None, None], shapes, 0.0)
        made = BlockModes.build(problem, some, body, 1, sides)
        assert np.linalg.matrix_rank(dense(made.basis)) == expected
        assert np.all(np.diag(dense(made.reduced.stiffness)) >= 0.0)
        made.destroy()


# ---- the reduced structure


def test_reduced_structure_is_that_of_the_formula(structure):
    columns, made = basis(structure), structure.block_modes.reduced
    problem = structure.problem
    stiffness = columns.T @ dense(problem.stiffness) @ columns
    none = np.diag(columns.T @ columns) < 0.5
    reduced = dense(made.stiffness)
    unit = np.abs(stiffness).max()
    assert reduced[~none][:, ~none] == pytest.approx(stiffness[~none][:, ~none], abs=1e-12 * unit)
    assert np.all(np.diag(reduced)[none] > 0.0)
    for full, less in ((problem.dead, made.dead), (problem.live, made.live)):
        expected = columns.T @ whole(full)
        assert whole(less) == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())
    for full, less in ((problem.normal, made.normal), (problem.tangential, made.tangential)):
        assert dense(less) == pytest.approx(dense(full) @ columns, abs=1e-12)
    rigid = dense(made.rigid)
    assert rigid == pytest.approx(columns.T @ dense(problem.rigid), abs=1e-12)
    assert reduced @ rigid == pytest.approx(np.zeros_like(rigid), abs=1e-9 * unit)


def test_joint_points_give_what_their_nodes_do_of_themselves(structure):
    made, problem = structure.block_modes, structure.problem
    nodes = np.bincount(node_bodies(structure))
    stiffness = np.diag(dense(problem.stiffness))
    local = LOCAL * np.log(np.repeat(nodes[node_bodies(structure)] / 3.0, 2)) / stiffness
    assert whole(made.local) == pytest.approx(local, rel=1e-12)
    points = structure.operators.points
    for give, rows in zip(made.reduced.give, joint_rows(structure), strict=True):
        assert give == pytest.approx(np.diag(rows @ np.diag(local) @ rows.T)[points], rel=1e-12)
    assert made.of(structure.reversed()).give is made.reduced.give
    assert np.all(made.rigid.reduced.give == 0.0)


@pytest.mark.parametrize("elements", [2, 4, 8])
def test_points_give_what_the_modes_of_a_block_lack(elements):
    """On average, of a brick: K^+ less its part in the modes, below each joint point."""
    structure = Structure.build(on_ground(wall([[1]], elements=elements), coulomb(0.5)))
    problem, made = structure.problem, structure.block_modes
    columns, stiffness = dense(made.basis), dense(problem.stiffness)
    inverse = np.linalg.pinv(stiffness, rcond=1e-9, hermitian=True)
    of_modes = np.linalg.pinv(dense(made.reduced.stiffness), rcond=1e-9, hermitian=True)
    rigid = dense(problem.rigid)
    elastic = np.eye(len(rigid)) - rigid @ rigid.T
    lacking = inverse - elastic @ columns @ of_modes @ columns.T @ elastic
    for give, matrix in zip(made.reduced.give, (problem.normal, problem.tangential), strict=True):
        rows = dense(matrix)
        exact = np.einsum("ij,jk,ik->i", rows, lacking, rows)
        assert give.mean() == pytest.approx(exact.mean(), rel=0.35)


def test_springs_of_the_reduced_structure_are_those_of_the_formula(structure):
    random = np.random.default_rng(3)
    made, count = structure.block_modes, len(structure.joints.length)
    mean = made.springs.mean_diagonal
    normal, tangential = mean * 10.0 ** random.uniform(-3, 3, (2, count))
    coupling = random.uniform(-0.8, 0.8, count) * np.minimum(normal, tangential)
    b_n, b_t = (rows @ basis(structure) for rows in joint_rows(structure))
    matrix = dense(made.reduced.stiffness) + b_n.T @ np.diag(normal) @ b_n
    matrix += b_t.T @ (np.diag(tangential) @ b_t + np.diag(coupling) @ b_n)
    points = structure.operators.points
    made.springs.factor(normal[points], tangential[points], coupling[points])
    right = random.normal(size=len(matrix))
    load = vector_like(made.reduced.dead, right)
    solution = load.duplicate()
    made.springs.solve(load, solution)
    assert matrix @ whole(solution) == pytest.approx(right, abs=1e-8 * np.abs(right).max())


def test_a_state_of_the_modes_is_one_of_the_structure(structure):
    made, count = structure.block_modes, len(structure.operators.points)
    amplitudes = np.random.default_rng(4).normal(size=made.basis.getSize()[1])
    vector = vector_like(made.reduced.dead, amplitudes)
    pressure, shear = np.arange(float(count)), -np.arange(float(count))
    state = made.prolonged(State(vector, 0.5, pressure, shear, 7.0, vector))
    # Moved by their modes, and by what they give next to joint forces.
    problem, moved = structure.problem, basis(structure) @ amplitudes
    forces = dense(problem.normal).T @ pressure + dense(problem.tangential).T @ shear
    given = whole(made.local) * forces
    assert np.abs(given).max() > 0.0
    assert whole(state.displacement) == pytest.approx(moved + given)
    rigid = dense(problem.rigid)
    assert whole(state.strained) == pytest.approx(moved + given - rigid @ (rigid.T @ given))
    rigid_state = made.rigid.prolonged(
        State(vector_like(made.rigid.reduced.dead, 1.0), 0.5, pressure, shear, 7.0)
    )
    assert whole(rigid_state.displacement) == pytest.approx(dense(made.rigid.basis).sum(axis=1))
    assert rigid_state.strained is None


def test_modes_of_a_state_are_their_part_of_its_displacements(structure):
    made, count = structure.block_modes, len(structure.operators.points)
    amplitudes = np.random.default_rng(4).normal(size=made.basis.getSize()[1])
    pressure, shear = np.arange(float(count)), -np.arange(float(count))
    moved = vector_like(structure.problem.dead, basis(structure) @ amplitudes)
    back = made.restricted(State(moved, 0.5, pressure, shear, 7.0, moved))
    kept = np.sum(basis(structure) ** 2, axis=0) > 0.5
    assert whole(back.displacement) == pytest.approx(np.where(kept, amplitudes, 0.0), abs=1e-12)
    assert back.strained is None
    assert (back.load_factor, back.work) == (0.5, 7.0)
    assert back.pressure is pressure and back.shear is shear


def test_a_reversed_load_is_reversed(structure):
    made = structure.block_modes
    reversed_problem = structure.reversed()
    assert made.of(structure.problem) is made.reduced
    assert whole(made.of(reversed_problem).live) == pytest.approx(-whole(made.reduced.live))
    assert made.of(reversed_problem).slip_origin is reversed_problem.slip_origin


def test_rigid_blocks_do_not_strain(structure):
    """But those that supports hold in part."""
    made = structure.block_modes.rigid
    columns, problem = dense(made.basis), made.reduced
    assert made.count == structure.block_modes.count
    assert columns.shape[1] == RIGID * made.count
    body = np.repeat(node_bodies(structure), 2)
    touched = np.isin(np.arange(made.count), structure.supports.body)
    for block in np.flatnonzero(~touched):
        own = columns[:, RIGID * block : RIGID * (block + 1)]
        assert own.T @ own == pytest.approx(np.eye(RIGID), abs=1e-12)
        assert set(body[np.any(own != 0.0, axis=1)]) == {block}
    unit, free = made.springs.mean_diagonal, np.repeat(~touched, RIGID)
    assert unit == structure.block_modes.springs.mean_diagonal
    stiffness = dense(problem.stiffness)
    assert np.abs(stiffness[np.ix_(free, free)]).max() <= 1e-12 * unit
    none = np.all(columns == 0.0, axis=0)
    assert np.diag(stiffness)[none] == pytest.approx(np.full(none.sum(), unit), rel=1e-12)
    for one, of in ((problem.normal, "normal"), (problem.tangential, "tangential")):
        whole_rows = dense(getattr(structure.problem, of))
        assert dense(one) == pytest.approx(whole_rows @ columns, abs=1e-12)


def test_rigid_motions_are_modes(structure):
    """So that a state of rigid blocks is one of blocks that may strain."""
    columns = basis(structure)
    rigid = dense(structure.block_modes.rigid.basis)
    assert columns @ (columns.T @ rigid) == pytest.approx(rigid, abs=1e-12)


# ---- the way through them


@pytest.mark.parametrize("few", [0, FEW_BLOCKS])
def test_modes_lead_to_a_state_of_the_structure(folded, few, monkeypatch):
    monkeypatch.setattr("fenics_contact.solvers.interior_point.FEW_BLOCKS", few)
    structure = folded.structure
    before = structure.factorizations
    control, point = from_modes(folded)
    assert point.followed
    assert max(point.residuals.values()) <= 1e-9
    assert point.state.load_factor == pytest.approx(0.35582, abs=5e-6)
    assert point.steps == structure.factorizations - before
    assert control.factorizations == structure.springs.factorizations + control._of_modes


def test_without_modes_there_is_no_way(folded):
    start, scales = folded.start(FIRST_WORK)
    control = WorkControl(folded.structure.problem, folded.structure.springs)
    with pytest.raises(SolverError, match="there are none"):
        control.from_modes(start.work, start, scales, 1e-9)


def test_many_blocks_are_rigid_first(folded, monkeypatch):
    """And end in the same state; what few blocks do not need is not made."""
    monkeypatch.setattr("fenics_contact.solvers.interior_point.FEW_BLOCKS", 0)
    structure = folded.structure
    structure.__dict__.pop("block_modes", None)
    expected = from_modes(folded)[1].state.load_factor
    assert "rigid" not in structure.block_modes.__dict__
    monkeypatch.setattr("fenics_contact.solvers.interior_point.MANY_BLOCKS", 10)
    before, of_modes = structure.factorizations, structure.block_modes.springs.factorizations
    control, point = from_modes(folded)
    made = structure.block_modes
    assert point.state.load_factor == pytest.approx(expected, rel=1e-8)
    assert made.rigid.factorizations > 0
    assert made.factorizations == made.springs.factorizations + made.rigid.factorizations
    assert structure.mode_factorizations == made.factorizations
    assert point.steps == structure.factorizations - before
    assert control._of_modes == made.factorizations - of_modes
    assert not made.springs._factors and not made.rigid.springs._factors  # no memory is held


def test_where_rigid_blocks_lead_nowhere_their_modes_are_asked(folded, monkeypatch, caplog):
    monkeypatch.setattr("fenics_contact.solvers.interior_point.FEW_BLOCKS", 0)
    expected = from_modes(folded)[1].state.load_factor
    monkeypatch.setattr("fenics_contact.solvers.interior_point.MANY_BLOCKS", 10)
    original, asked = CentralPath.follow, []

    def lost(self, now, products, end, *close):
        asked.append(now.u.getSize())
        if len(asked) == 1:
            now.destroy()
            raise SolverError("lost")
        return original(self, now, products, end, *close)

    monkeypatch.setattr(CentralPath, "follow", lost)
    with caplog.at_level("INFO", logger="fenics_contact"):
        found = from_modes(folded)[1]
    blocks = folded.structure.block_modes.count
    assert asked[:2] == [RIGID * blocks, MODES * blocks]
    assert found.state.load_factor == pytest.approx(expected, rel=1e-8)
    assert "rigid blocks: lost" in caplog.text


@pytest.mark.parametrize(
    ("reached", "taken"),
    [
        ([3], 0),  # to the end: no other is asked for
        ([2, 3], 1),
        ([0, 3], 1),
        ([2, 1, 2], 2),
        ([2, 1, 0], 0),
        ([1, 2, 1], 1),
        ([0, 0, 1], 2),
        ([0, 0, 0], None),
    ],
)
def test_modes_follow_another_path_at_more_work(reached, taken):
    """By the number of states along each, of three; none: it leads nowhere."""
    alive, asked = set(), []

    class Reached:
        def __init__(self, work: float) -> None:
            self.work = work
            alive.add(self)

        def destroy(self) -> None:
            alive.remove(self)

    def at_work(modes, work, start, scales, way):
        assert way.ends == TRANSFERS and not way.grows
        asked.append((work, way.patience))
        count = reached[len(asked) - 1]
        if not count:
            raise SolverError("no luck")
        return [(Reached(work), 0.1**k) for k in range(count)]

    control = SimpleNamespace(_at_work=at_work, _of_modes=0)
    modes = SimpleNamespace(factorizations=0)
    if taken is None:
        with pytest.raises(SolverError, match="no luck"):
            WorkControl._near(control, modes, 2.0, "start", None, few=False)
        assert not alive
    else:
        near = WorkControl._near(control, modes, 2.0, "start", None, few=False)
        assert [state.work for state, _ in near] == [2.0 * AGAIN[taken]] * reached[taken]
        assert alive == {state for state, _ in near}
    works, patience = zip(*asked, strict=True)
    assert works == tuple(2.0 * times for times in AGAIN[: len(reached)])
    assert patience == (WANDERING, WANDERING, np.inf)[: len(reached)]


def test_far_less_is_left_to_the_structure(monkeypatch):
    monkeypatch.setattr("fenics_contact.analysis.work_control.FEW_BLOCKS", 0)
    result = limit_load(wall_scene("W3", coulomb(0.65), elements=2))
    own_steps = result.factorizations - result.mode_factorizations
    assert result.mode_factorizations == result.structure.block_modes.springs.factorizations
    assert 0 < own_steps < result.mode_factorizations
    assert own_steps == result.structure.springs.factorizations
    iterated = result.positive.history[0].steps[0].steps
    assert iterated == result.factorizations - 2  # the bonded structure, and the mode


@pytest.mark.parametrize("alone", [True, False])
@pytest.mark.parametrize(
    ("name", "friction", "elements", "lowest"),
    [
        ("W3", 1.0, 2, 0.3558174),
        ("W2", 1.0, 2, 0.6056877),
        ("W2", 0.8, 2, 0.5835727),
        ("W3", 0.9, 2, 0.3558174),
        ("4x15", 0.76, 3, 0.4077094),
    ],
)
def test_growing_friction_leads_to_the_low_state(
    monkeypatch, name, friction, elements, lowest, alone
):
    """That of the fixed point or a lower one; else the path ends at 0.4168 and 0.6236 with 1.

    Of the others higher ones are 0.5997, 0.3620 and 0.4118.
    """
    scene = wall_scene(name, coulomb(friction), elements)
    assert scene.mesh.body_count <= FEW_BLOCKS
    if not alone:
        monkeypatch.setattr("fenics_contact.analysis.work_control.FEW_BLOCKS", 0)
    assert limit_load(scene).load_factor == pytest.approx(lowest, abs=5e-7)


def test_path_that_modes_do_not_lead_to_is_found_without(monkeypatch):
    """As before there were modes."""

    def lost(*_: object) -> None:
        raise SolverError("no luck")

    monkeypatch.setattr(WorkControl, "_near", lost)
    result = limit_load(wall_scene("W3", coulomb(0.65)))
    assert result.load_factor == pytest.approx(0.35582, abs=5e-6)
    assert result.mode_factorizations == 0


@pytest.fixture
def as_many(monkeypatch) -> None:
    """Walls of few blocks are treated as those of many."""
    monkeypatch.setattr("fenics_contact.solvers.interior_point.FEW_BLOCKS", 0)


def test_modes_are_left_earlier_where_their_end_leads_nowhere(folded, as_many, monkeypatch):
    begun = []
    original = WorkControl._to_end

    def once_lost(self, run, path, now, products, *rest):
        begun.append(products)
        if len(begun) == 1:
            now.destroy()
            raise SolverError("no luck")
        return original(self, run, path, now, products, *rest)

    at_once = from_modes(folded)[1].state.load_factor
    monkeypatch.setattr(WorkControl, "_to_end", once_lost)
    assert from_modes(folded)[1].state.load_factor == pytest.approx(at_once, rel=1e-6)
    assert len(begun) == 2
    assert begun[1] > begun[0]


def test_path_that_leads_nowhere_from_the_modes(folded, as_many, monkeypatch):
    tried = []

    def lost(self, run, path, now, products, *rest):
        tried.append(products)
        now.destroy()
        raise SolverError("no luck")

    monkeypatch.setattr(WorkControl, "_to_end", lost)
    with pytest.raises(SolverError, match="no luck"):
        from_modes(folded)
    assert len(tried) == len(TRANSFERS)
    assert tried == sorted(tried)


def losing(monkeypatch, lost: Callable[[int], bool]) -> list[float]:
    """Let paths be lost at some of their ends, by how many were asked for before."""
    calls: list[float] = []
    original = CentralPath.follow

    def follow(self, now, products, end, *rest):
        calls.append(end)
        if lost(len(calls) - 1):
            now.destroy()
            raise SolverError("lost")
        return original(self, now, products, end, *rest)

    monkeypatch.setattr(CentralPath, "follow", follow)
    return calls


@pytest.mark.parametrize("lost_at", [0, 1, 2])
def test_path_of_the_modes_is_another_one_where_it_was_lost(folded, as_many, lost_at, monkeypatch):
    at_once = from_modes(folded)[1].state
    calls = losing(monkeypatch, lambda before: before == lost_at)
    state = from_modes(folded)[1].state
    assert state.work == AGAIN[1] * at_once.work
    assert folded.structure.problem.live.dot(state.displacement) == pytest.approx(state.work)
    assert state.load_factor == pytest.approx(at_once.load_factor, rel=1e-6)
    assert calls[lost_at + 1] == calls[0]  # begun again


@pytest.mark.parametrize("lost_at", [0, 1, 2])
def test_path_of_the_modes_is_left_where_all_are_lost(folded, as_many, lost_at, monkeypatch):
    """Not if they are lost at once."""
    at_once = from_modes(folded)[1].state.load_factor
    tries = len(AGAIN) * (lost_at + 1)
    calls = losing(monkeypatch, lambda before: before < tries and before % (lost_at + 1) == lost_at)
    if lost_at == 0:
        with pytest.raises(SolverError, match="lost"):
            from_modes(folded)
    else:
        assert from_modes(folded)[1].state.load_factor == pytest.approx(at_once, rel=1e-6)
        assert calls[tries] < calls[0]  # that of the structure


def test_limit_load_where_the_path_was_another_one(as_many, monkeypatch):
    """The work of its state is the one that is told."""
    scene = wall_scene("W3", coulomb(0.65), elements=2)
    monkeypatch.setattr("fenics_contact.analysis.work_control.FEW_BLOCKS", 0)
    expected = limit_load(scene)
    losing(monkeypatch, lambda before: before == 0)
    found = limit_load(scene)
    assert found.status == "limit"
    assert found.load_factor == pytest.approx(expected.load_factor, rel=1e-7)
    assert found.positive.work_ratio == pytest.approx(AGAIN[1] * expected.positive.work_ratio)


def test_no_path_begins_far_from_one(folded, monkeypatch):
    monkeypatch.setattr("fenics_contact.solvers.interior_point.NEAR_ENOUGH", 0.0)
    monkeypatch.setattr(CentralPath, "follow", None)
    with pytest.raises(SolverError, match="no path to begin"):
        from_modes(folded)


@pytest.mark.parametrize("quick", [True, False])
def test_path_of_the_structure_is_followed_where_the_interior_point_method_is_slow(
    quick, folded, monkeypatch
):
    """And only there; both ways lead to the same state."""
    steps = []
    follow, converge = FewPoints.follow, _InteriorPoint.converge

    def counted(self, *args):
        steps.append(self.path.problem is folded.structure.problem)
        return follow(self, *args)

    def slow_at_first(self, now, cold, *args, **options):
        best = converge(self, now, cold, *args, **options)
        if not cold and not quick and not any(steps):
            best.error = 1e-3
        return best

    monkeypatch.setattr(FewPoints, "follow", counted)
    monkeypatch.setattr(_InteriorPoint, "converge", slow_at_first)
    load_factor = from_modes(folded)[1].state.load_factor
    assert load_factor == pytest.approx(0.3558174, abs=5e-7)
    assert steps
    assert any(steps) != quick


@pytest.mark.parametrize(
    ("law", "options"),
    [
        (tresca(2000.0), {}),
        (coulomb(0.65), {"method": "fixed-point"}),
        (coulomb(0.65), {"control": "load"}),
    ],
)
def test_modes_are_not_made_where_they_are_not_used(law, options, monkeypatch):
    monkeypatch.setattr(BlockModes, "build", None)
    monkeypatch.setattr(WorkControl, "from_modes", None)
    scene = on_ground(wall([[1]], elements=1), law, solve=SolveOptions(**options))
    result = limit_load(scene)
    assert result.status == "limit"
    assert result.mode_factorizations == 0
