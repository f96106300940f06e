"""Stiffness and loads: patch tests, rigid motions, resultants, inclined rollers."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from fenics_contact import InputError, Load, Material, Scene
from fenics_contact.discretization.elasticity import Elasticity, assemble
from fenics_contact.discretization.facets import collect_boundary
from fenics_contact.discretization.materials import displacement_space
from fenics_contact.discretization.supports import Supports, find_supports
from fenics_contact.meshing import polygons
from fenics_contact.output.fields import cell_stresses
from tests.helpers import Drawing, dense, grid_blocks, mesh_of, node_positions, rectangle, rotation

YOUNG, POISSON, DENSITY = 2e9, 0.3, 1500.0
STONE = Material(YOUNG, POISSON, DENSITY)

# No symmetry that could hide an error, and an irregular mesh of triangles.
PANEL = np.array([(0.0, 0.0), (2.0, 0.3), (1.7, 1.4), (0.2, 1.0)])
STRESS = np.array([[3e5, -1.2e5], [-1.2e5, -7e5]])


def scene_of(drawing: Drawing, live: Load, materials=None, **options) -> Scene:
    return Scene(mesh_of(drawing.model()), materials or {"default": STONE}, live, **options)


def assembled(scene: Scene) -> tuple[Elasticity, Supports]:
    space = displacement_space(scene)
    boundary = collect_boundary(scene.mesh, space)
    supports = find_supports(scene, boundary)
    return assemble(scene, space, boundary, supports), supports


def everywhere(elasticity: Elasticity, mine: np.ndarray) -> np.ndarray:
    """A distributed array on every rank."""
    return np.concatenate(elasticity.space.mesh.comm.allgather(mine))


def strain_of(stress: np.ndarray, plane: str) -> np.ndarray:
    """Hooke's law in the plane, from its three-dimensional form."""
    out_of_plane = POISSON * np.trace(stress) if plane == "strain" else 0.0
    total = np.trace(stress) + out_of_plane
    return ((1.0 + POISSON) * stress - POISSON * total * np.eye(2)) / YOUNG


def panel(quadrilaterals: bool = False) -> tuple[Drawing, dict[str, np.ndarray]]:
    """The panel with its sides as groups, and their outward normals."""
    following = np.roll(PANEL, -1, axis=0)
    sides = {f"side{k}": [(PANEL[k], following[k])] for k in range(4)}
    along = (following - PANEL) / np.linalg.norm(following - PANEL, axis=1)[:, None]
    outward = np.column_stack([along[:, 1], -along[:, 0]])  # of corners given anticlockwise
    model = polygons([PANEL], 0.5, groups=sides, quadrilaterals=quadrilaterals)
    return Drawing.of(model), dict(zip(sides, outward, strict=True))


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("quadrilaterals", [False, True])
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_patch_in_uniform_stress_is_in_equilibrium(plane, quadrilaterals, degree):
    drawing, normals = panel(quadrilaterals)
    tractions = {name: tuple(STRESS @ normal) for name, normal in normals.items()}
    scene = scene_of(drawing, Load(traction=tractions), plane=plane, degree=degree)
    elasticity, _ = assembled(scene)
    exact = node_positions(elasticity.space) @ strain_of(STRESS, plane).T
    live = everywhere(elasticity, elasticity.live)
    assert np.abs(live).max() > 1e4
    force = dense(elasticity.stiffness) @ exact.ravel()
    assert force == pytest.approx(live, abs=1e-10 * np.abs(live).max())
    # The tractions of a uniform stress have no resultant.
    assert np.abs(elasticity.live_resultant).max() < 1e-9 * np.abs(live).sum()


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("degrees", [0.0, 30.0])
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_supported_block_reproduces_displacement_and_stress(plane, degrees, degree):
    # A block on two perpendicular rollers, pulled on the other sides; turned, these are inclined.
    turn = rotation(np.radians(degrees))
    outline = rectangle(0, 0, 2, 1)
    sides = zip(outline, [*outline[1:], outline[0]], strict=True)
    groups = dict(zip(("bottom", "right", "top", "left"), ([side] for side in sides), strict=True))
    drawing = Drawing.of(polygons([outline], 0.4, groups=groups)).turned(np.radians(degrees))
    pull, press = 4e5, -9e5
    tractions = {"right": tuple(turn @ [pull, 0.0]), "top": tuple(turn @ [0.0, press])}
    rollers = {"bottom": "roller", "left": "roller"}
    scene = scene_of(
        drawing, Load(traction=tractions), supports=rollers, plane=plane, degree=degree
    )
    elasticity, supports = assembled(scene)
    assert supports.inclined == (degrees != 0.0)
    load = everywhere(elasticity, elasticity.live)
    response = np.linalg.solve(dense(elasticity.stiffness), load)
    sigma = turn @ np.diag([pull, press]) @ turn.T
    exact = node_positions(elasticity.space) @ strain_of(sigma, plane).T
    found = supports.to_cartesian(response, 0)
    assert found == pytest.approx(exact.ravel(), abs=1e-10 * np.abs(exact).max())

    owned = slice(*(2 * bound for bound in elasticity.space.dofmap.index_map.local_range))
    principal = np.array([pull, press, POISSON * (pull + press) * (plane == "strain")])
    von_mises = np.sqrt(0.5 * np.sum((principal - np.roll(principal, 1)) ** 2))
    expected = [sigma[0, 0], sigma[1, 1], sigma[0, 1], von_mises]
    parts = {"space": elasticity.space, "law": elasticity.law}
    whole = SimpleNamespace(scene=scene, cartesian=lambda u: u, **parts)
    stress = cell_stresses(whole, found[owned])
    assert len(stress) > 0
    assert stress == pytest.approx(np.tile(expected, (len(stress), 1)), abs=1e-4)


def test_stiffness_resists_no_rigid_motion():
    elasticity, _ = assembled(scene_of(panel()[0], Load((1.0, 0.0))))
    x, y = node_positions(elasticity.space).T
    none, one = np.zeros_like(x), np.ones_like(x)
    matrix = dense(elasticity.stiffness)
    for motion in ((one, none), (none, one), (-y, x)):
        force = matrix @ np.column_stack(motion).ravel()
        assert np.abs(force).max() < 1e-14 * np.abs(matrix).sum()
    values = np.linalg.eigvalsh(matrix)
    assert np.abs(values[:3]).max() < 1e-13 * values[-1]
    assert values[3] > 1e-4 * values[-1]


def test_stiffness_is_symmetric_and_does_not_couple_blocks():
    drawing = grid_blocks(((0, 0), (1, 1), (2, 2)), ((0, 1), (1, 1), (2, 2)))
    elasticity, _ = assembled(scene_of(drawing, Load((1.0, 0.0))))
    matrix = dense(elasticity.stiffness)
    assert np.abs(matrix - matrix.T).max() < 1e-15 * np.abs(matrix).max()
    owned = elasticity.space.dofmap.index_map.size_local
    body = np.repeat(everywhere(elasticity, elasticity.node_body[:owned]), 2)
    apart = body[:, None] != body
    assert np.any(apart)
    assert np.all(matrix[apart] == 0.0)


def test_body_force_is_density_times_area_times_acceleration():
    # Two blocks of different size and density.
    drawing = grid_blocks(((0, 0), (2, 1), (2, 1)), ((0, 1), (1, 0.5), (1, 1)))
    drawing.cells = {"sill": drawing.cells["blocks"][:2], "post": drawing.cells["blocks"][2:]}
    materials = {"sill": STONE, "post": Material(YOUNG, POISSON, 700.0)}
    scene = scene_of(drawing, Load((3.0, 0.0)), materials, dead=Load((0.5, -9.81)))
    elasticity, _ = assembled(scene)
    mass = np.array([2.0 * DENSITY, 0.5 * 700.0])
    assert elasticity.centre == pytest.approx(np.array([[1.0, 0.5], [0.5, 1.25]]), abs=1e-15)
    # The nodes' mean is the centre of a rectangle, so that there is no moment.
    dead, live = np.outer(mass, [0.5, -9.81, 0.0]), np.outer(mass, [3.0, 0.0, 0.0])
    assert elasticity.dead_resultant == pytest.approx(dead, rel=1e-13, abs=1e-9)
    assert elasticity.live_resultant == pytest.approx(live, rel=1e-13, abs=1e-9)
    nodal = everywhere(elasticity, elasticity.dead).reshape(-1, 2)
    assert nodal.sum(axis=0) == pytest.approx(dead.sum(axis=0)[:2], rel=1e-13)


def test_moment_of_the_weight_about_the_mean_of_the_nodes():
    elasticity, _ = assembled(scene_of(panel()[0], Load((0.0, -2.0))))
    x, y = PANEL.T
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
    load = Load(traction={"right0": (5e3, 0.0), "top1": (0.0, -1e3)})
    elasticity, _ = assembled(scene_of(drawing, load))
    expected = np.array([[5e3 * 1.0, 0.0, 0.0], [0.0, -1e3 * 2.0, 0.0]])
    assert elasticity.live_resultant == pytest.approx(expected, rel=1e-12, abs=1e-9)
    assert np.array_equal(elasticity.dead_resultant, np.zeros((2, 3)))
    size = np.abs(everywhere(elasticity, elasticity.live)).reshape(-1, 2).max(axis=1)
    position = node_positions(elasticity.space)[size > 1e-9]
    right = (np.abs(position[:, 0] - 2.0) < 1e-12) & (position[:, 1] < 1.0 + 1e-12)
    top = np.abs(position[:, 1] - 2.0) < 1e-12
    assert len(position) == 4 + 5
    assert np.all(right | top)


@pytest.mark.parametrize("held", [{}, {"bottom0": "fixed"}])
def test_resultants_add_up_and_are_those_of_the_load_not_of_what_supports_leave(held):
    drawing = grid_blocks(((0, 0), (2, 1), (2, 2)))
    load = Load((0.0, -1.0), {"top0": (0.0, -300.0), "right0": (50.0, 0.0)})
    elasticity, supports = assembled(scene_of(drawing, load, supports=held))
    expected = [50.0, -2.0 * DENSITY - 600.0, 0.0]
    assert elasticity.live_resultant[0] == pytest.approx(expected, rel=1e-12, abs=1e-9)
    forces = everywhere(elasticity, elasticity.live).reshape(-1, 2)
    assert np.all(forces[supports.nodes] == 0.0)


def test_traction_inside_a_block():
    drawing = grid_blocks(((0, 0), (2, 2), (2, 2)))
    drawing.facets["seam"] = np.array([[3, 4]])
    with pytest.raises(InputError, match="'seam': 1 facets lie inside a body"):
        assembled(scene_of(drawing, Load(traction={"seam": (1.0, 0.0)})))
