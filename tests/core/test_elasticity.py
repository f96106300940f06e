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


def test_traction_inside_a_block():
    drawing = grid_blocks(((0, 0), (2, 2), (2, 2)))
    drawing.facets["seam"] = np.array([[3, 4]])
    with pytest.raises(InputError, match="'seam': 1 facets lie inside a body"):
        assembled(scene_of(drawing, Load(traction={"seam": (1.0, 0.0)})))
