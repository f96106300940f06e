"""Stiffness and loads: patch tests, rigid motions, resultants, inclined rollers."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from petsc4py import PETSc

from fenics_contact import InputError, Load, Material, Scene
from fenics_contact.discretization.facets import collect_boundary
from fenics_contact.discretization.elasticity import Elasticity, assemble, displacement_space
from fenics_contact.output.fields import displacement_function, stress_fields
from fenics_contact.meshing import polygons
from fenics_contact.discretization.supports import Supports, find_supports
from tests.helpers import (
    Drawing,
    dense,
    grid_blocks,
    mesh_of,
    node_positions,
    rectangle,
    rotation,
    vector_like,
    whole,
)

YOUNG, POISSON, DENSITY = 2e9, 0.3, 1500.0
STONE = Material(YOUNG, POISSON, DENSITY)

# No symmetry that could hide an error, and an irregular mesh of triangles.
PANEL = [(0.0, 0.0), (2.0, 0.3), (1.7, 1.4), (0.2, 1.0)]
STRESS = np.array([[3e5, -1.2e5], [-1.2e5, -7e5]])


def assembled(scene: Scene) -> tuple[Elasticity, Supports]:
    space = displacement_space(scene)
    boundary = collect_boundary(scene.mesh, space)
    supports = find_supports(scene, boundary)
    return assemble(scene, space, boundary, supports), supports


def solve(elasticity: Elasticity, load: PETSc.Vec) -> PETSc.Vec:
    solver = PETSc.KSP().create(elasticity.stiffness.comm)
    solver.setType("preonly")
    solver.getPC().setType("lu")
    solver.getPC().setFactorSolverType("mumps")
    solver.setOperators(elasticity.stiffness)
    solution = load.duplicate()
    solver.solve(load, solution)
    solver.destroy()
    return solution


def strain_of(stress: np.ndarray, plane: str) -> np.ndarray:
    """Hooke's law in the plane, from its three-dimensional form."""
    out_of_plane = POISSON * np.trace(stress) if plane == "strain" else 0.0
    total = np.trace(stress) + out_of_plane
    return ((1.0 + POISSON) * stress - POISSON * total * np.eye(2)) / YOUNG


def panel(quadrilaterals: bool = False) -> tuple[Drawing, dict[str, np.ndarray]]:
    """The panel with its sides as groups, and their outward normals."""
    corners = np.array(PANEL)
    sides = {
        f"side{k}": [(corners[k], corners[(k + 1) % 4])] for k in range(4)
    }  # anticlockwise: the outside is on the right
    normals = {}
    for name, [(start, end)] in sides.items():
        along = (end - start) / np.linalg.norm(end - start)
        normals[name] = np.array([along[1], -along[0]])
    model = polygons([corners], 0.5, groups=sides, quadrilaterals=quadrilaterals)
    return Drawing.of(model), normals


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("quadrilaterals", [False, True])
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_patch_in_uniform_stress_is_in_equilibrium(plane, quadrilaterals, degree):
    drawing, normals = panel(quadrilaterals)
    tractions = {name: tuple(STRESS @ normal) for name, normal in normals.items()}
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": STONE},
        live=Load(traction=tractions),
        plane=plane,
        degree=degree,
    )
    elasticity, _ = assembled(scene)
    exact = node_positions(elasticity.space) @ strain_of(STRESS, plane).T
    force = elasticity.stiffness.createVecLeft()
    elasticity.stiffness.mult(vector_like(elasticity.live, exact), force)
    live = whole(elasticity.live)
    assert np.abs(live).max() > 1e4
    assert whole(force) == pytest.approx(live, abs=1e-10 * np.abs(live).max())
    # The tractions of a uniform stress have no resultant.
    assert np.abs(elasticity.live_resultant).max() < 1e-9 * np.abs(live).sum()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("degrees", [0.0, 30.0])
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_supported_block_reproduces_stress_and_displacement(plane, degrees, degree):
    # A block on two perpendicular rollers, pulled on the other sides; turned, these are inclined.
    turn = rotation(np.radians(degrees))
    drawing = Drawing.of(
        polygons(
            [rectangle(0, 0, 2, 1)],
            0.4,
            groups={
                "bottom": [((0, 0), (2, 0))],
                "left": [((0, 0), (0, 1))],
                "right": [((2, 0), (2, 1))],
                "top": [((0, 1), (2, 1))],
            },
        )
    ).turned(np.radians(degrees))
    pull, press = 4e5, -9e5
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": STONE},
        live=Load(
            traction={
                "right": tuple(turn @ [pull, 0.0]),
                "top": tuple(turn @ [0.0, press]),
            }
        ),
        supports={"bottom": "roller", "left": "roller"},
        plane=plane,
        degree=degree,
    )
    elasticity, supports = assembled(scene)
    assert supports.inclined == (degrees != 0.0)
    response = solve(elasticity, elasticity.live)
    structure = SimpleNamespace(scene=scene, elasticity=elasticity, supports=supports)
    displacement = displacement_function(structure, response, "u")

    sigma = turn @ np.diag([pull, press]) @ turn.T
    exact = node_positions(elasticity.space) @ strain_of(sigma, plane).T
    supports.to_cartesian(response)
    assert whole(response) == pytest.approx(exact.ravel(), abs=1e-10 * np.abs(exact).max())

    out_of_plane = POISSON * (pull + press) if plane == "strain" else 0.0
    principal = np.array([pull, press, out_of_plane])
    mises = np.sqrt(0.5 * np.sum((principal - np.roll(principal, 1)) ** 2))
    expected = {
        "stress_xx": sigma[0, 0],
        "stress_yy": sigma[1, 1],
        "stress_xy": sigma[0, 1],
        "von_mises": mises,
        "body": 0.0,
    }
    fields = {field.name: field.x.array for field in stress_fields(structure, displacement)}
    assert set(fields) == set(expected)
    for name, value in expected.items():
        assert fields[name] == pytest.approx(np.full(len(fields[name]), value), abs=1e-4), name


def test_stiffness_resists_no_rigid_motion():
    drawing, _ = panel()
    scene = Scene(mesh_of(drawing.model()), {"default": STONE}, live=Load((1.0, 0.0)))
    elasticity, _ = assembled(scene)
    position = node_positions(elasticity.space)
    motions = [
        np.tile([1.0, 0.0], (len(position), 1)),
        np.tile([0.0, 1.0], (len(position), 1)),
        np.column_stack([-position[:, 1], position[:, 0]]),
    ]
    matrix = dense(elasticity.stiffness)
    for motion in motions:
        assert np.abs(matrix @ motion.ravel()).max() < 1e-14 * np.abs(matrix).sum()
    values = np.linalg.eigvalsh(matrix)
    assert np.abs(values[:3]).max() < 1e-13 * values[-1]
    assert values[3] > 1e-4 * values[-1]


def test_stiffness_is_symmetric_and_does_not_couple_blocks():
    drawing = grid_blocks(((0, 0), (1, 1), (2, 2)), ((0, 1), (1, 1), (2, 2)))
    scene = Scene(mesh_of(drawing.model()), {"default": STONE}, live=Load((1.0, 0.0)))
    elasticity, _ = assembled(scene)
    matrix = dense(elasticity.stiffness)
    assert np.abs(matrix - matrix.T).max() < 1e-15 * np.abs(matrix).max()
    owned = elasticity.space.dofmap.index_map.size_local
    body = np.concatenate(scene.comm.allgather(elasticity.node_body[:owned]))
    apart = np.repeat(body, 2)[:, None] != np.repeat(body, 2)[None, :]
    assert np.any(apart)
    assert np.all(matrix[apart] == 0.0)


def test_body_force_is_density_times_area_times_acceleration():
    # Two blocks of different size and density.
    drawing = grid_blocks(((0, 0), (2, 1), (2, 1)), ((0, 1), (1, 0.5), (1, 1)))
    drawing.cells = {"sill": drawing.cells["blocks"][:2], "post": drawing.cells["blocks"][2:]}
    scene = Scene(
        mesh_of(drawing.model()),
        {"sill": STONE, "post": Material(YOUNG, POISSON, 700.0)},
        live=Load((3.0, 0.0)),
        dead=Load((0.5, -9.81)),
    )
    elasticity, _ = assembled(scene)
    mass = np.array([2.0 * DENSITY, 0.5 * 700.0])
    assert elasticity.centre == pytest.approx(np.array([[1.0, 0.5], [0.5, 1.25]]), abs=1e-15)
    # The nodes' mean is the centre of a rectangle, so that there is no moment.
    none = np.zeros(2)
    dead = np.column_stack([0.5 * mass, -9.81 * mass, none])
    live = np.column_stack([3.0 * mass, none, none])
    assert elasticity.dead_resultant == pytest.approx(dead, rel=1e-13, abs=1e-9)
    assert elasticity.live_resultant == pytest.approx(live, rel=1e-13, abs=1e-9)
    nodal = whole(elasticity.dead).reshape(-1, 2)
    assert nodal.sum(axis=0) == pytest.approx(dead.sum(axis=0)[:2], rel=1e-13)


def test_moment_of_the_weight_about_the_mean_of_the_nodes():
    drawing, _ = panel()
    scene = Scene(mesh_of(drawing.model()), {"default": STONE}, live=Load((0.0, -2.0)))
    elasticity, _ = assembled(scene)
    x, y = np.array(PANEL).T
    following = np.roll(x, -1), np.roll(y, -1)
    cross = x * following[1] - following[0] * y
    area = 0.5 * cross.sum()
    centroid = ((x + following[0]) * cross).sum() / (6.0 * area)
    force = -2.0 * DENSITY * area
    moment = (centroid - elasticity.centre[0, 0]) * force
    assert elasticity.live_resultant[0] == pytest.approx([0.0, force, moment], rel=1e-9, abs=1e-9)
    assert elasticity.centre[0] == pytest.approx(node_positions(elasticity.space).mean(axis=0))


def test_traction_is_force_per_length_on_its_group_only():
    drawing = grid_blocks(((0, 0), (2, 1), (4, 3)), ((0, 1), (2, 1), (4, 3)))
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": STONE},
        live=Load(traction={"right0": (5e3, 0.0), "top1": (0.0, -1e3)}),
    )
    elasticity, _ = assembled(scene)
    expected = np.array([[5e3 * 1.0, 0.0, 0.0], [0.0, -1e3 * 2.0, 0.0]])
    assert elasticity.live_resultant == pytest.approx(expected, rel=1e-12, abs=1e-9)
    assert np.array_equal(elasticity.dead_resultant, np.zeros((2, 3)))
    loaded = np.abs(whole(elasticity.live)).reshape(-1, 2).max(axis=1) > 1e-9
    position = node_positions(elasticity.space)[loaded]
    right = (np.abs(position[:, 0] - 2.0) < 1e-12) & (position[:, 1] < 1.0 + 1e-12)
    top = np.abs(position[:, 1] - 2.0) < 1e-12
    assert len(position) == 4 + 5
    assert np.all(right | top)


def test_tractions_add_to_the_body_force():
    drawing = grid_blocks(((0, 0), (2, 1), (2, 2)))
    load = Load((0.0, -1.0), {"top0": (0.0, -300.0), "right0": (50.0, 0.0)})
    scene = Scene(mesh_of(drawing.model()), {"default": STONE}, live=load)
    elasticity, _ = assembled(scene)
    expected = [50.0, -2.0 * DENSITY - 600.0, 0.0]
    assert elasticity.live_resultant[0] == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_resultants_are_those_of_the_load_not_of_what_supports_leave():
    drawing = grid_blocks(((0, 0), (2, 1), (2, 2)))
    scene = Scene(
        mesh_of(drawing.model()),
        {"default": STONE},
        live=Load((0.0, -1.0)),
        supports={"bottom0": "fixed"},
    )
    elasticity, supports = assembled(scene)
    expected = [0.0, -2.0 * DENSITY, 0.0]
    assert elasticity.live_resultant[0] == pytest.approx(expected, rel=1e-12, abs=1e-9)
    assert np.all(whole(elasticity.live).reshape(-1, 2)[supports.nodes] == 0.0)


def test_lame_parameters_of_the_plane_states():
    drawing = grid_blocks(((0, 0), (1, 1), (1, 1)))
    mesh = mesh_of(drawing.model())
    mu = YOUNG / (2 * (1 + POISSON))
    expected = {
        "strain": YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)),
        "stress": YOUNG * POISSON / (1 - POISSON**2),
    }
    for plane, value in expected.items():
        scene = Scene(mesh, {"default": STONE}, live=Load((1.0, 0.0)), plane=plane)
        lame_lambda, lame_mu = assembled(scene)[0].lame
        count = len(lame_mu.x.array)
        assert lame_lambda.x.array == pytest.approx(np.full(count, value), rel=1e-14)
        assert lame_mu.x.array == pytest.approx(np.full(count, mu), rel=1e-14)


def test_traction_inside_a_block():
    drawing = grid_blocks(((0, 0), (2, 2), (2, 2)))
    drawing.facets["seam"] = np.array([[3, 4]])
    load = Load(traction={"seam": (1.0, 0.0)})
    scene = Scene(mesh_of(drawing.model()), {"default": STONE}, live=load)
    with pytest.raises(InputError, match="'seam': 1 facets lie inside a body"):
        assembled(scene)
